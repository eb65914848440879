"""Fit clumps of spheres to a scanned body and print their errors."""

from pathlib import Path

import voxgran as vg

body = vg.load_shape(Path(__file__).parents[1] / "data" / "itokawa_lp.obj")
for spheres in (10, 50):
    clump = vg.fit_clump(body, max_spheres=spheres)
    errors = clump.errors
    print(f"{clump.count} spheres: overlap {errors.iou:.3f}, volume {errors.volume:+.3f}, inertia {errors.inertia:.3f}")
