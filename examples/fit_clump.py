"""
A clump of spheres for a scanned body
=====================================

Clumps of 10 and of 50 spheres are fitted to a scan of the asteroid Itokawa. The script prints how much of the volume
the clump and the body share (intersection over union), and the errors of volume and inertia; the picture is coloured by
the distance from the true surface.
"""

from pathlib import Path

import voxgran as vg
from benchmarks.model import arguments

[folder] = arguments(__doc__, folder=Path("out/fit_clump"))
body = vg.load_shape(vg.data_file("itokawa_lp.obj"))
clumps = []
for spheres in (10, 50):
    clump = vg.fit_clump(body, max_spheres=spheres)
    clumps.append(clump)
    errors = clump.errors
    print(f"{clump.count} spheres: overlap {errors.iou:.3f}, volume {errors.volume:+.3f}, inertia {errors.inertia:.3f}")

# %%
# **The body beside its clumps**

# Picture: The asteroid Itokawa, a clump of 10 spheres, and a smoother one of 50 spheres.
vg.save_clump_picture(clumps, folder / "fit_clump.png", overwrite=True)
