"""
Unions of solids, assemblies of spheres, superspheres
=====================================================

Unions of base solids, assemblies of spheres, and volumes inflated toward spheres, in one picture. The script prints for
each row the median run time and the mean sphericity, and for unions how the surface area converges with the chord
error.

Arguments: folder, number of shapes in a row.
"""

import time
from pathlib import Path

import numpy as np

import voxgran as vg
from benchmarks.model import arguments

folder, count = arguments(__doc__, folder=Path("out/shapes_unions"), count=7)
ROWS = {
    "solid_union": {},
    "solid_union, boxes": {"kinds": ["box"], "counts": [4], "box": ((0.9, 1.0), (0.4, 0.8), (0.2, 0.4))},
    "sphere_assembly": {"probability": 0.5},
    "superspherize": {},
    "superspherize, cubes": {"base": "box", "inflations": 6, "half_angles": (25.0, 60.0), "radii": (0.6, 0.8)},
}

shapes = []
for name, parameters in ROWS.items():
    family, seconds = name.split(",")[0], []
    for seed in vg.seeds_of_shapes(1, count):
        began = time.process_time()
        shapes.append(vg.make_shape(family, seed=seed, **parameters))
        seconds.append(time.process_time() - began)
    sphericity = float(vg.describe(shapes[-count:], which=["sphericity"]).sphericity.mean())
    print(f"{name:21s} {1e3 * np.median(seconds):6.1f} ms  sphericity {sphericity:.3f}")

# %%
# **Convergence with the chord error**
# volumes relative to a box that is part of each union, as exact as the digits
EXACT = 1e-4
for error in (2e-2, 2e-3, 5e-4):
    found = []
    for seed in range(count):
        coarse, fine = (
            vg.make_shape("solid_union", seed=seed, chord_error=value).surface_area for value in (error, EXACT)
        )
        found.append(abs(coarse / fine - 1))
    print(f"chord error {error:.0e}  surface area of unions of one volume to {max(found):.1e}")

folder.mkdir(parents=True, exist_ok=True)
# Picture: Rows of unions of solids, unions of boxes, assemblies of spheres, inflated bodies and inflated cubes.
vg.save_gallery(shapes, folder / "shapes_unions.png", columns=count, overwrite=True)
