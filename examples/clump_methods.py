"""
Clumps of spheres by each method
================================

The same solids are reproduced by each method of clump fitting, as pictures and as a table of errors. The picture is in
the manner of figure 6 of Sajjadi & Khalili (2015): each row is a solid and its clumps, coloured by the distance from
the true surface.

Arguments: folder, number of spheres (50 in the documentation).
"""

from pathlib import Path

import matplotlib.image
import numpy as np

import voxgran as vg
from benchmarks.model import arguments

folder, spheres = arguments(__doc__, folder=Path("out/clump_methods"), spheres=15)
rows_in = folder / "rows"
rows_in.mkdir(parents=True, exist_ok=True)

# %%
# **Three solids, each fitted by all methods**
rows = []
scans = [vg.load_shape(vg.data_file(name)) for name in ("eros.obj", "itokawa_lp.obj")]
solids = [*scans, vg.make_shape("box")]
for solid in solids:
    clumps = [vg.fit_clump(solid, method=method, max_spheres=spheres) for method in vg.clump_methods()]
    for clump in clumps:
        errors = clump.errors
        unit = solid.diameter
        print(
            f"{solid.name:12} {clump.method:13} {clump.count:3} spheres: overlap {errors.iou:.3f}, "
            f"volume {errors.volume:+.3f}, inertia {errors.inertia:.3f}, farthest {errors.surface_max:.3f}, "
            f"radii {np.min(clump.radii) / unit:.3f} to {np.max(clump.radii) / unit:.3f}"
        )
    vg.save_clump_picture(clumps, rows_in / f"{solid.name}.png", overwrite=True)
    rows.append(matplotlib.image.imread(rows_in / f"{solid.name}.png"))
# Picture: Eros, Itokawa and a cube, and beside each its clumps of spheres by six methods, coloured by the distance
#   from the true surface.
matplotlib.image.imsave(folder / "clump_methods.png", np.concatenate(rows))
print(f"pictures in {folder}")
