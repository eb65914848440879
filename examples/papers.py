"""
Items of the three papers
=========================

Random volumes and surfaces in the manner of figures 2 to 6 of Sajjadi & Khalili (2015), and numbers for what the three
papers say in words: order and rotation in random placing, paths, growth, gaskets, control points under gravity and
vibration, least porosities, and random addition that is expanded and brought to rest. Figures 7 to 9 are made by the
examples on lattice directions and on the first contact of two bodies.

Arguments: folder, number of grains.
"""

import warnings
from pathlib import Path

import matplotlib.image
import numpy as np

import voxgran as vg
from benchmarks.model import arguments

folder, count = arguments(__doc__, folder=Path("out/papers"), count=400)
rows_in = folder / "rows"
rows_in.mkdir(parents=True, exist_ok=True)
warnings.simplefilter("ignore", vg.PackingWarning)

# %%
# **Figures 2 to 5: volumes and surfaces**
SEEDS = range(6)
unions = [vg.make_shape("solid_union", seed=seed) for seed in SEEDS]
smooth = [vg.make_shape("solid_union", seed=seed, kinds=("sphere", "ellipsoid")) for seed in SEEDS]
ranges = [vg.make_shape("solid_union", seed=1, solids=n, lengths=(low, 1.0)) for n in (2, 8) for low in (0.2, 0.5, 0.9)]
spheres = [vg.make_shape("sphere_assembly", seed=seed, probability=0.5) for seed in SEEDS]
shapes = [*unions, *(union.skin() for union in unions), *ranges, *smooth, *spheres]
# Picture: Unions of solids and their surfaces (figure 2), unions of other numbers and dimensions of base solids
#   (figure 3), unions of spheres and ellipsoids (figure 4), and assemblies of spheres (figure 5).
vg.save_gallery(shapes, folder / "papers.png", columns=len(SEEDS), overwrite=True)

# %%
# **Figure 6: volumes reproduced by the cluster method**
rows = []
for seed in SEEDS[:2]:
    clumps = [vg.fit_clump(unions[seed], method="cluster", max_spheres=most) for most in (10, 30, 100)]
    overlaps = ", ".join(f"{clump.errors.iou:.3f} ({clump.count} spheres)" for clump in clumps)
    print(f"clumps of union {seed}: overlap {overlaps}")
    vg.save_clump_picture(clumps, rows_in / f"{seed}.png", overwrite=True)
    rows.append(matplotlib.image.imread(rows_in / f"{seed}.png"))
# Picture: Two unions, and beside each its clumps of at most 10, 30 and 100 spheres by the cluster method (figure 6).
matplotlib.image.imsave(folder / "papers_clumps.png", np.concatenate(rows))


# %%
# **Placing at random, along paths, by growth and in gaps**
def told(item, packings):
    """Print the solid fraction and the number of grains of packings."""
    parts = [f"{name} {packing.solid_fraction:.3f} ({packing.count})" for name, packing in packings.items()]
    print(f"{item}: " + ", ".join(parts))


cell, tall = vg.Box((8, 8, 8), periodic="xyz"), vg.Box((6, 6, 40), periodic="xy")
sphere, disk = vg.make_shape("sphere"), vg.make_shape("disk")
sizes = vg.sizes.lognormal(1.0, 0.35)
many = {"count": 4 * count, "until": "tries", "tries": 20 * count, "seed": 1}
told(
    "order", {order: vg.pack(sphere, cell, "rsa", sizes=sizes, order=order, **many) for order in ("random", "largest")}
)
plane, square = vg.Rectangle((10, 10), "xy"), vg.make_shape("polygon", corners=4)
rotations = {"as they come": 0, "rotated": 20}
told(
    "growing squares",
    {name: vg.pack(square, plane, "random_apollonian", count=4 * count, rotate=n) for name, n in rotations.items()},
)
told("front", {mode: vg.pack(sphere, cell, "advancing_front", mode=mode) for mode in ("loose", "dense")})
told(
    "growth",
    {f"rates from {rate:g}": vg.pack(sphere, cell, "growth", count=count, slowest=rate) for rate in (1.0, 0.1)},
)
told("gasket", {"disks": vg.pack(disk, vg.Disk(1.0), "apollonian", count=10 * count)})
told("gasket", {"spheres": vg.pack(sphere, vg.Sphere(1.0), "apollonian", count=10 * count)})


def bulk(packing):
    """Return the solid fraction away from the walls and the surface of a bed."""
    return float(packing.measure("density").bulk_solid_fraction)


for sticking in (0.0, 0.5, 1.0):
    deposit = vg.pack(sphere, tall, "deposition", count=count, sticking=sticking)
    print(f"deposit, sticking {sticking:g}: {bulk(deposit):.3f}")

# %%
# **Control points: gravity, vibration, distance, points**
WAYS = {
    "as by default": {},
    "weak gravity": {"gravity_bias": 0.1},
    "no vibration": {"vibration_up": 0.0},
    "distance 0.1": {"distance": 0.1},
    "all points": {"points": "all"},
}
for name, asked in WAYS.items():
    bed = vg.pack(unions, tall, "control_point", count=count // 4, seed=1, settle=False, **asked)
    gap = float(bed.contacts(0.5).gap.min())
    print(f"control points, {name}: mean height {bed.position[:, 2].mean():.2f}, least gap {gap:.3f}")

# %%
# **Least porosities, and random addition that is expanded and brought to rest**
flat = vg.Packing.of(disk, vg.Rectangle((1, 3**0.5), "xy"), position=[(0, 0, 0), (0.5, 0.75**0.5, 0)])
corners = 0.5**0.5 * np.array([(0, 0, 0), (1, 1, 0), (1, 0, 1), (0, 1, 1)])
dense = vg.Packing.of(sphere, vg.Box((2**0.5,) * 3, "xyz"), position=corners)
print(f"least porosity: disks {1 - flat.solid_fraction:.4f}, spheres {1 - dense.solid_fraction:.4f}")
COLUMNS = {
    "disks": (disk, vg.Rectangle((20, 40), periodic="x"), "-y", 0.75),
    "spheres": (sphere, vg.Box((8, 8, 20), periodic="xy"), "-z", 0.55),
}
for name, (shape, column, down, fraction) in COLUMNS.items():
    placed = vg.pack(shape, column, "rsa", count=count, sizes=sizes, seed=1)
    expanded = vg.pack([], column, "expand", start=placed, solid_fraction=fraction)
    rested = vg.settle(expanded, gravity=down)
    print(
        f"{name}: random addition {placed.solid_fraction:.3f}, expanded {expanded.solid_fraction:.3f}, "
        f"at rest {bulk(rested):.3f}"
    )
