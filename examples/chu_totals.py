"""
Grains against candidates in the schemes of Chu 2011
====================================================

Totals of the eight schemes against the number of candidates, in 2D and 3D, with assemblies and contact normals. The
rectangle is that of the paper, 20 x 40 cm, with radii of 0.3, 0.4 and 0.5 cm in the shares 4 : 3 : 3 and its
congruential coordinates, as in :doc:`chu_rsa`. The box of 10 x 10 x 10 cm holds spheres of the same radii; the paper
has no counterpart of it. Its coordinates are those of a Philox generator, since the axes of the congruential sequence
are shifts of one short cycle.

The script prints a table and writes it (chu_totals.csv) with the totals against the candidates (chu_totals.svg), the
assemblies of schemes 1, 3, 4b and 4d, with the middle section of the box (chu_assemblies.png), and their contact
normals (chu_normals.svg): roses in 2D, and in 3D maps of equal areas of the upper hemisphere, whose center is z.

Arguments: folder, number of random orders of the radii, largest number of candidates in 2D (twice that in 3D).
"""

import csv
import warnings
from pathlib import Path

import numpy as np
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments

folder, orders, most = arguments(__doc__, folder=Path("out/chu_totals"), orders=5, most=5000)
radii, shares, touching = np.array([0.3, 0.4, 0.5]), np.array([0.4, 0.3, 0.3]), 1e-7
schemes = ("classic", "1", "2", "3", "4a", "4b", "4c", "4d")
moving = ("1", "3", "4b", "4d")  # those that move candidates until they touch; the others have no contacts
paper = {"1": 1008, "3": 1075, "4b": 1103, "4d": 1119}  # sums of the counts by radius for 5000 candidates
grains = {2: vg.make_shape("disk"), 3: vg.make_shape("sphere")}
containers = {2: vg.Rectangle((20, 40)), 3: vg.Box((10, 10, 10))}
candidates = {2: np.array([0.1, 0.2, 0.4, 0.7, 1.0]) * most}
candidates[3] = 2 * candidates[2]
# the schemes differ in the number of candidates that are placed, so this warning is expected
warnings.filterwarnings("ignore", "[0-9]+ of [0-9]+ grains were placed")


# %%
# **A scheme and what is measured**
def packed(dimension, scheme, many, seed):
    """Return the packing of one scheme with one order of radii; all candidates are tried, none is added."""
    return vg.pack(
        grains[dimension],
        containers[dimension],
        method="rsa",
        scheme=scheme,
        retry="scan",
        until="tries",
        tries=1,
        count=int(many),
        sizes=vg.sizes.discrete(2 * radii, 10 * shares, independent=True),
        numbers="lcg" if dimension == 2 else "philox",
        seed=seed,
    )


def measured(packing):
    """Return the total, the solid fraction, the coordination number, and the largest miss of a share of the sizes."""
    placed = np.array([np.isclose(packing.diameters, 2 * radius).mean() for radius in radii])
    coordination = 2 * len(packing.contacts(touching).normal) / packing.count
    return [packing.count, packing.solid_fraction, coordination, np.abs(placed - shares).max()]


def anisotropy(normals):
    """Return the difference of the extreme principal values of the fabric tensor over their mean, 0 if isotropic."""
    values = np.linalg.eigvalsh(normals.T @ normals / len(normals))
    return (values[-1] - values[0]) * len(values)


# %%
# **How assemblies and directions are drawn**
def draw_assembly(panel, packing):
    """Draw disks, or the section of spheres at half the height, coloured by their radius."""
    dimension, radius = packing.dimension, packing.diameters / 2
    height = 0.0 if dimension == 2 else packing.position[:, 2] - packing.container.lengths[2] / 2
    cut = 2 * np.sqrt(np.clip(radius**2 - np.square(height), 0, None))
    shown = np.flatnonzero(cut)
    disks = EllipseCollection(
        cut[shown], cut[shown], np.zeros(len(shown)), units="xy", offsets=packing.position[shown, :2]
    )
    disks.set(offset_transform=panel.transData, array=radius[shown], cmap="viridis", clim=(0.25, 0.55))
    panel.add_collection(disks)
    width, height = packing.container.lengths[:2]
    panel.set(xlim=(0, width), ylim=(0, height), aspect="equal", xticks=[], yticks=[])


def draw_normals(panel, normals):
    """Draw a rose of contact normals, or their density on the upper hemisphere in equal areas; return the map."""
    normals = np.concatenate([normals, -normals])
    angle = np.arctan2(normals[:, 1], normals[:, 0]) % (2 * np.pi)
    panel.set_xticks([0, np.pi / 2], ["x", "y"])
    panel.set_yticks([])
    panel.grid(visible=False)
    if normals.shape[1] == 2:
        panel.hist(angle, bins=36, range=(0, 2 * np.pi), density=True)
        return None
    up = normals[:, 2] > 0
    # the area of a cap of the sphere is proportional to the square of this distance from the center of the map
    distance = np.sqrt(np.clip(1 - normals[up, 2], 0, 1))
    edges = np.linspace(0, 2 * np.pi, 25), np.sqrt(np.linspace(0, 1, 8))
    counts = np.histogram2d(angle[up], distance, bins=edges)[0]
    return panel.pcolormesh(*edges, counts.T / counts.mean(), vmin=0, vmax=2, cmap="viridis", rasterized=True)


# %%
# **All schemes and numbers of candidates**
# colours of Okabe & Ito, which colour-blind readers tell apart
colors = ("#000000", "#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#D55E00", "#CC79A7")
looks = dict(zip(schemes, zip(colors, "os^vDP*X", strict=True), strict=True))
totals = Figure(figsize=(10, 4), layout="constrained")
assemblies, roses = (Figure(figsize=(10, height), layout="constrained") for height in (7.5, 5.5))
pictures = assemblies.subplots(2, 4, height_ratios=(2, 1))
polar = roses.subplots(2, 4, subplot_kw={"projection": "polar"})
table = [["dimension", "scheme", "candidates", "placed", "standard_error", "solid_fraction", "coordination"]]
table[0] += ["miss_of_shares", "anisotropy", "near_x"]
for row, (dimension, panel) in enumerate(zip((2, 3), totals.subplots(1, 2), strict=True)):
    print(f"{dimension}D {'scheme':8s} placed (standard error)  solid fraction  coordination  miss  anisotropy  near x")
    for scheme in schemes:
        lines = []
        for many in candidates[dimension]:
            packings = [packed(dimension, scheme, many, seed) for seed in range(orders)]
            values = np.array([measured(packing) for packing in packings])
            placed, fraction, coordination, miss = values.mean(axis=0)
            error = values[:, 0].std(ddof=1) / np.sqrt(orders) if orders > 1 else 0.0
            lines.append([placed, error])
            normals = np.concatenate([packing.contacts(touching).normal[:, :dimension] for packing in packings])
            # of isotropic normals, 1/3 in 2D and 1 - cos 30 in 3D lie within 30 degrees of x
            near = np.mean(np.abs(normals[:, 0]) > np.cos(np.deg2rad(30))) if len(normals) else np.nan
            fabric = [anisotropy(normals) if len(normals) else np.nan, near]
            texts = [f"{placed:.1f}", f"{error:.1f}", f"{fraction:.4f}", f"{coordination:.3f}", f"{miss:.3f}"]
            texts += [f"{value:.3f}" for value in fabric]
            table.append([dimension, scheme, int(many), *texts])
        print(f"   {scheme:8s} {texts[0]:>8s} ({texts[1]:>4s}) " + "  ".join(f"{text:>10s}" for text in texts[2:]))
        panel.errorbar(
            candidates[dimension], *np.transpose(lines), c=looks[scheme][0], marker=looks[scheme][1], label=scheme
        )
        if dimension == 2 and scheme in paper and most == 5000:
            panel.plot(5000, paper[scheme], "k_", ms=14, label="paper" if scheme == "4d" else None)
        if scheme in moving:
            column = moving.index(scheme)
            draw_assembly(pictures[row, column], packings[0])
            pictures[row, column].set(title=f"{dimension}D, scheme {scheme}: {packings[0].count}")
            image = draw_normals(polar[row, column], normals)
            polar[row, column].set(title=f"{dimension}D, scheme {scheme}:\n{len(normals) // orders} contacts")
    panel.set(title=f"{dimension}D", xlabel="candidates", ylabel="grains placed")
    panel.legend(frameon=False, ncols=2)
roses.colorbar(image, ax=polar[1], label="density over isotropic")
folder.mkdir(parents=True, exist_ok=True)
# Picture: Grains placed against candidates, in 2D and 3D: all eight schemes rise and flatten; the classic scheme is
#   lowest.
totals.savefig(folder / "chu_totals.svg")
# Picture: Disks in a rectangle, and the middle section of spheres in a box, for schemes 1, 3, 4b and 4d, coloured by
#   radius.
assemblies.savefig(folder / "chu_assemblies.png", dpi=80)
# Picture: Contact normals of the same schemes: roses in 2D and maps of the hemisphere in 3D, even for schemes 1 and
#   3, dense near x for schemes 4b and 4d.
roses.savefig(folder / "chu_normals.svg")
with (folder / "chu_totals.csv").open("w", newline="") as file:
    csv.writer(file, lineterminator="\n").writerows(table)
