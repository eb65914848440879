"""
The eight schemes of Chu 2011
=============================

Chu 2011 generates granular samples by random sequential addition with sorted coordinates. The script follows its eight
schemes as far as the text of the paper defines them. A rectangle of 20 x 40 cm is filled with disks of radii 0.3, 0.4
and 0.5 cm in the shares 4 : 3 : 3 from 5000 candidates, whose coordinates come from the linear congruential sequence of
the paper. The paper does not state the order of the radii; the table contains means over ten random orders. It is an
interpretation, not a reproduction: the number of corrections, the inset of the centers and the treatment of retained
radii were chosen to match the numbers of the paper, and no triple of counts is met exactly.

Columns: disks by radius, all disks, survival rate of the coordinates, porosity, coordination number, anisotropy of the
contact normals (difference of the principal values of the fabric tensor over their mean; 0 if isotropic) and the angle
of its axis from x, share of contact normals within 30 degrees of x (1/3 if isotropic); for
the schemes that the paper counts, its numbers and by how much more disks are placed here.

Arguments: folder, number of random orders, largest number of corrections (2).
"""

import warnings
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments

folder, orders, corrections = arguments(__doc__, folder=Path("out/chu_rsa"), orders=10, corrections=2)
candidates, radii, touching = 5000, (0.3, 0.4, 0.5), 1e-7
schemes = ("classic", "1", "2", "3", "4a", "4b", "4c", "4d")
paper = {"1": (547, 271, 190), "3": (505, 306, 264), "4b": (521, 314, 268), "4d": (453, 339, 327)}
sizes = vg.sizes.discrete([2 * radius for radius in radii], [4, 3, 3], independent=True)
# the schemes differ in the number of candidates that are placed, so this warning is expected
warnings.filterwarnings("ignore", "[0-9]+ of [0-9]+ grains were placed")


# %%
# **A scheme and what is measured**
def replay(scheme, seed, *, many=candidates, retry="scan"):
    """Return the packing of one scheme with one order of radii."""
    return vg.pack(
        vg.make_shape("disk"),
        vg.Rectangle((20, 40)),
        method="rsa",
        scheme=scheme,
        retry=retry,
        count=many,
        tries=1,
        corrections=corrections,
        numbers="lcg",
        sizes=sizes,
        seed=seed,
    )


def measured(packing):
    """Return counts by radius, all, survival rate of the coordinates, porosity and coordination number."""
    counts = [int(np.isclose(packing.diameters, 2 * radius).sum()) for radius in radii]
    coordination = 2 * len(packing.contacts(touching).normal) / packing.count
    return [*counts, packing.count, packing.count / candidates, packing.porosity, coordination]


def fabric(normals):
    """Return the anisotropy of contact normals, the angle of its axis, and the share of normals near x."""
    values, axes = np.linalg.eigh(normals.T @ normals / len(normals))
    angle = np.rad2deg(np.arctan2(axes[1, 1], axes[0, 1]))
    near_x = np.abs(normals[:, 0]) > np.cos(np.deg2rad(30))
    return 2 * (values[1] - values[0]), (angle + 90) % 180 - 90, near_x.mean()


# %%
# **All schemes**
#
# Only schemes that move candidates until they touch have contacts, whose directions are drawn.
figure = Figure(figsize=(11, 3.2), layout="constrained")
panels = iter(figure.subplots(1, 4, subplot_kw={"projection": "polar"}))
print("scheme    0.3   0.4   0.5     all (sd)  survival  porosity  coordination  anisotropy  axis   near x")
for scheme in schemes:
    packings = [replay(scheme, seed) for seed in range(orders)]
    rows = np.array([measured(packing) for packing in packings])
    mean, spread = rows.mean(axis=0), rows[:, 3].std()
    normals = np.concatenate([packing.contacts(touching).normal[:, :2] for packing in packings])
    rose = "{:10.2f}  {:4.0f}  {:7.2f}".format(*fabric(normals)) if len(normals) else " " * 25
    print(
        f"{scheme:8s} {mean[0]:5.0f} {mean[1]:5.0f} {mean[2]:5.0f}  {mean[3]:6.0f} ({spread:2.0f})  {mean[4]:8.3f}  "
        f"{mean[5]:8.3f}  {mean[6]:12.2f}  {rose.rstrip()}".rstrip()
    )
    if scheme in paper:
        rest, all_of = "               0.305          1.89" if scheme == "4d" else "", sum(paper[scheme])
        more = 100 * (mean[3] / all_of - 1)
        print("  paper  {:5d} {:5d} {:5d}  {:6d}   {:+.1f} %{}".format(*paper[scheme], all_of, more, rest))
    if len(normals):
        panel, angles = next(panels), np.arctan2(normals[:, 1], normals[:, 0])
        panel.hist(np.concatenate([angles, angles + np.pi]) % (2 * np.pi), bins=36, density=True)
        panel.set(title=f"scheme {scheme}: {len(normals) // orders} contacts", yticks=[])
print("words of the paper: a retained radius is tried at the next coordinate only")
for scheme in ("2", "3", "4c", "4d"):
    mean = np.mean([measured(replay(scheme, seed, retry="next")) for seed in range(orders)], axis=0)
    print(f"{scheme:8s} {mean[0]:5.0f} {mean[1]:5.0f} {mean[2]:5.0f}  {mean[3]:6.0f}")
folder.mkdir(parents=True, exist_ok=True)
# Picture: Four polar histograms of contact normals: nearly round for schemes 1 and 3, and drawn out along x for
#   schemes 4b and 4d, which sort coordinates along x.
figure.savefig(folder / "chu_rsa.svg")
