"""
Spheres and polyhedra by the advancing front
============================================

A box, a cylinder, a scanned rock and a rectangle are filled by the advancing front until no further grain fits. Each
packing is checked against the true shapes. The script prints the number of grains, the solid fraction of the whole
container and of its inner part, the coordination number (contacts within a billionth of a diameter, counted by a k-d
tree), the largest residual distance of these contacts, and the Kolmogorov-Smirnov distance between the placed and the
requested sizes.

Arguments: folder, number of grains (20,000 in the documentation).
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.scenes import picture_cut, picture_packing

folder, grains = arguments(__doc__, folder=Path("out/advancing_front"), grains=6000)
sphere, disk = vg.make_shape("sphere"), vg.make_shape("disk")
rocks = [vg.make_shape("convex_polyhedron", seed=seed, points=points) for seed, points in enumerate((8, 14, 30))]
# edge of a cube (side of a square) that this number of grains of unit diameter fills to 0.6 (0.8)
edge = (grains * np.pi / 6 / 0.6) ** (1 / 3)
side = (grains * np.pi / 4 / 0.8) ** 0.5
asteroid = vg.load_shape(vg.data_file("itokawa_lp.obj"))
asteroid = asteroid.scaled(edge / asteroid.volume ** (1 / 3))
CASES = {
    "graded box": (sphere, vg.Box((edge, edge, edge)), vg.sizes.uniform(0.6, 1.2), {}),
    "cylinder": (sphere, vg.Cylinder(0.54 * edge, 1.09 * edge), vg.sizes.lognormal(0.85, 0.25), {"order": "lowest"}),
    "rock": (sphere, vg.ClosedMesh(asteroid), vg.sizes.discrete([0.7, 1.0, 1.4], [0.5, 0.35, 0.15]), {}),
    "polyhedra": (rocks, vg.Box((edge / 3,) * 3), vg.sizes.uniform(0.5, 0.8), {}),
    "disks": (disk, vg.Rectangle((side, side)), vg.sizes.uniform(0.5, 1.5), {}),
}


# %%
# **What is measured**
#
# Two functions count contacts and measure the solid fraction, without the library's own measures.
def distances(packing):
    """Return the gaps of all close pairs of spheres, in mean diameters, and the indices of the pairs."""
    radius = packing.bounding_radii
    pairs = cKDTree(packing.position).query_pairs(2.001 * radius.max(), output_type="ndarray")
    apart = np.linalg.norm(packing.position[pairs[:, 0]] - packing.position[pairs[:, 1]], axis=1)
    return (apart - radius[pairs].sum(axis=1)) / (2 * radius.mean()), pairs


def inner_fraction(packing, points=200_000):
    """Return the share of random points in the middle half of the bounds that lie in a sphere."""
    low, high = packing.container.bounds
    generator = np.random.Generator(np.random.Philox(1))
    where = low + (high - low) * (0.25 + 0.5 * generator.random((points, 3)))
    radius = np.append(packing.bounding_radii, 0.0)
    away, sphere = cKDTree(packing.position).query(where, k=16, distance_upper_bound=radius.max())
    return float((away <= radius[sphere]).any(axis=1).mean())


# %%
# **Packings and pictures**
#
# Spheres are cut open in the pictures; colours show the diameter.
folder.mkdir(parents=True, exist_ok=True)
figure = Figure(figsize=(15, 3.6), layout="constrained")
panels = figure.subplots(1, len(CASES))
for panel, (name, (shapes, container, sizes, options)) in zip(panels, CASES.items(), strict=True):
    packing = vg.pack(shapes, container, method="advancing_front", mode="dense", sizes=sizes, seed=1, **options)
    gap, pairs = distances(packing)
    touching = np.abs(gap) < 1e-9
    print(
        f"{name:10s} grains {packing.count:6d}  solid fraction {packing.solid_fraction:.4f}  "
        f"of spheres inside {inner_fraction(packing):.4f}  coordination {2 * touching.sum() / packing.count:.3f}  "
        f"residual {np.abs(gap[touching]).max():.0e}  gradation {packing.provenance['missed']['gradation']:.4f}  "
        f"verified {vg.verify(packing).ok}"
    )
    vg.save(packing, folder / f"{name.replace(' ', '_')}.vtp", overwrite=True)
    draw = picture_packing if name in ("disks", "rock") else picture_cut
    panel.imshow(draw(packing))
    panel.set_title(f"{name}: {packing.count} grains, {packing.solid_fraction:.3f}")
    panel.axis("off")
# Picture: A cut box, a cut cylinder, an asteroid made of spheres, a cut box of polyhedra and a rectangle of disks,
#   each filled densely, with colours from dark for small to bright for large grains.
figure.savefig(folder / "advancing_front.png", dpi=110)
