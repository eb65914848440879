"""
Open surfaces and solids in one packing
=======================================

Random surfaces, sheets and shells are packed with solid grains, like the volumes and surfaces of Sajjadi & Khalili
(2015). Open surfaces have no interior, so their control points are compared with those of other grains. They are fed
into a periodic box together with random solids and spheres. Two checks show that none crosses another: the exact
verification of the packing, and VTK's collision filter for each close pair.
"""

from pathlib import Path

import numpy as np
import pyvista
from matplotlib.image import imsave

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.scenes import picture_packing

[folder] = arguments(__doc__, folder=Path("out/open_surfaces"))
surfaces = [vg.make_shape("random_surface", seed=seed, diameter=1.3) for seed in (1, 2, 3)]
surfaces += [vg.make_shape("sheet", roll=150, diameter=1.2), vg.make_shape("shell", diameter=1.2)]
solids = [vg.make_shape("solid_union", seed=seed) for seed in (3, 7)] + [vg.make_shape("sphere", diameter=0.8)]
box = vg.Box((3.5, 3.5, 7), periodic="xy")
packing = vg.pack(
    [*surfaces, *solids],
    box,
    method="control_point",
    contact="kdtree",
    count=60,
    seed=1,
    spacing=0.1,
    sweeps=1000,
    cycles=4,
)


# %%
# **No surface crosses another**
def placed(grain, image=(0, 0, 0)):
    """Return a grain in its pose, or a periodic image of it, as PolyData."""
    corners = packing.world_vertices(grain) + np.array(image) * (box.bounds[1] - box.bounds[0])
    return pyvista.PolyData.from_regular_faces(corners, packing.shapes[packing.shape_id[grain]].faces)


open_ones = np.array([shape.is_open for shape in packing.shapes])[packing.shape_id]
near = packing.contacts(0.12)
crossings = sum(
    placed(i).collision(placed(j, image))[1] > 0 for i, j, image in zip(near.i, near.j, near.image, strict=True)
)
proof = vg.verify(packing)
print(f"grains {packing.count}, {open_ones.sum()} of them open surfaces  verified {proof.ok}")
print(f"near pairs {len(near.gap)}  crossing by VTK {crossings}  least gap {near.gap.min():.3f}")
specific = packing.surface_areas.sum() / box.volume
print(f"solid fraction {packing.solid_fraction:.3f}  surface per volume of the box {specific:.3f}")
folder.mkdir(parents=True, exist_ok=True)
vg.save(packing, folder / "open_surfaces.vtp", overwrite=True)
# Picture: Curved sheets, shells and solid grains in a box, coloured by shape.
imsave(folder / "open_surfaces.png", picture_packing(packing, color_by="shape", window=(700, 760)))
