"""
Rains of cubes, random growth and sponges
=========================================

Volumes that are born from voxels, with numbers and a picture. The script prints, for each family, the cubes, the
triangles, how far the volume is from that of the cubes (for turned cubes, how many standard errors from that of random
points), and the dimension of a sponge.
"""

import math
from pathlib import Path

import numpy as np

import voxgran as vg
from benchmarks.model import arguments
from voxgran.geometry.rotation import rotation_matrices

[folder] = arguments(__doc__, folder=Path("out/shapes_voxels"))
folder.mkdir(parents=True, exist_ok=True)


for family, cubes, parameters in (
    ("voxel_rain", 500, {"cubes": 400, "width": (10, 10)}),
    ("random_growth", 500, {"cubes": 500}),
    ("random_growth", 100_000, {"cubes": 100_000}),
    ("sierpinski_sponge", 8000, {"kind": "menger", "levels": 3}),
):
    shape = vg.make_shape(family, seed=1, edge=1.0, **parameters)
    error = abs(shape.volume / cubes - 1)
    print(f"{family:18s} cubes {cubes:6d}  triangles {len(shape.faces):6d}  error of the volume {error:.0e}")

# %%
# **Volume by random points, and the dimension of a sponge**
shape = vg.make_shape("cube_rain", seed=1)
centers, edges = shape.record["centers"], shape.record["edges"]
turns = rotation_matrices(shape.record["orientations"])
points = np.random.Generator(np.random.Philox(1)).uniform(*shape.bounds, (400_000, 3))
inside = np.zeros(len(points), dtype=bool)
for center, edge, turn in zip(centers, edges, turns, strict=True):
    inside |= (np.abs((points - center) @ turn) <= edge / 2).all(axis=1)
box, share = float(np.prod(np.diff(shape.bounds, axis=0))), float(inside.mean())
score = (box * share - shape.volume) / (box * math.sqrt(share * (1 - share) / len(points)))
print(
    f"cube_rain          cubes {len(edges):6d}  triangles {len(shape.faces):6d}  "
    f"random points differ by {score:+.1f} standard errors"
)
sponge = vg.make_shape("sierpinski_sponge", kind="menger")
print(f"sierpinski_sponge  dimension {sponge.record['dimension']:.6f}, log 20 / log 3 = {math.log(20, 3):.6f}")

# %%
# **All families in one picture**
size = {"cubes": 4000}
shapes = [
    *(
        vg.make_shape("voxel_rain", seed=1, cubes=2000, width=(14, 14), base="ellipse", deposition=rule)
        for rule in ("ballistic", "random", "relaxed")
    ),
    vg.make_shape("voxel_rain", seed=1, cubes=500, width=(40, 2)),
    *(vg.make_shape("cube_rain", seed=seed, cubes=cubes) for seed, cubes in ((1, 12), (2, 40))),
    vg.make_shape("cube_rain", seed=3, cubes=40, fall="down"),
    vg.make_shape("cube_rain", seed=4, cubes=40, overlap=0.8, edges=(0.2, 1.0)),
    *(vg.make_shape("random_growth", seed=1, power=power, **size) for power in (-4.0, 0.0, 4.0)),
    vg.make_shape("random_growth", seed=1, aspect=(3, 2, 1), **size),
    vg.make_shape("sierpinski_sponge", kind="menger", levels=3),
    vg.make_shape("sierpinski_sponge", kind="carpet", levels=3),
    vg.make_shape("sierpinski_sponge", levels=3, removed=9, seed=1),
    vg.make_shape("sierpinski_sponge", levels=4, divisions=2, kept=0.8, seed=1),
]
# Picture: Heaps of equal cubes, clusters of turned cubes, grown bodies from porous to smooth, and four sponges.
vg.save_gallery(shapes, folder / "shapes_voxels.png", columns=8, overwrite=True)
