"""
One packing of each family of sphere methods
============================================

Spheres and disks are packed by ten methods, from random growth to exact gaskets. Each packing is checked against the
true shapes. The script prints the number of grains, the solid fraction of the container, the mean number of contacts
within a thousandth of a mean diameter, and the CPU seconds.

Arguments: folder, number of grains (1500 in the documentation).
"""

import time
from pathlib import Path

from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.scenes import picture_packing

folder, grains = arguments(__doc__, folder=Path("out/sphere_families"), grains=600)
sphere, disk = vg.make_shape("sphere"), vg.make_shape("disk")
edge, side = 0.95 * grains ** (1 / 3), 0.95 * grains**0.5
box, square = vg.Box((edge, edge, edge)), vg.Rectangle((side, side))
column, basin = vg.Box((edge, edge, edge), periodic="xy"), vg.Rectangle((side, side), periodic="x")
rock = vg.load_shape(vg.data_file("eros.obj"))
graded = vg.sizes.lognormal(0.8, 0.25)
few = {"count": grains}
CASES = {
    "expand, 0.50": (sphere, box, {"method": "expand", "solid_fraction": 0.5, "sizes": graded}),
    "jam": (sphere, box, {"method": "jam", "sizes": graded}),
    "multilayer, 0.55": (sphere, box, {"method": "multilayer", "solid_fraction": 0.55, "sizes": graded}),
    "deposition": (sphere, column, {"method": "deposition", "count": grains, "sizes": graded}),
    "deposition, sticking": (disk, basin, {"method": "deposition", "sticking": 1.0, "count": grains // 4}),
    "growth": (disk, square, {"method": "growth", **few}),
    "random_apollonian": (disk, square, {"method": "random_apollonian", **few}),
    "apollonian": (disk, vg.Disk(side / 2), {"method": "apollonian", **few}),
    "tetrahedral": (sphere, vg.ClosedMesh(rock), {"method": "tetrahedral", "count": 2 * grains}),
    "jam, in a polygon": (
        disk,
        vg.Polygon([(0, 0), (side, 0), (side, side), (side / 2, side / 3), (0, side)]),
        {"method": "jam", "sizes": graded},
    ),
}


# %%
# **All packings**
folder.mkdir(parents=True, exist_ok=True)
figure = Figure(figsize=(15, 6.4), layout="constrained")
for panel, (name, (shape, container, options)) in zip(figure.subplots(2, 5).ravel(), CASES.items(), strict=True):
    began = time.process_time()
    packing = vg.pack(shape, container, seed=1, **options)
    seconds = time.process_time() - began
    contacts = 2 * packing.contacts(1e-3 * packing.diameters.mean()).count / packing.count
    print(
        f"{name:20s} grains {packing.count:6d}  solid fraction {packing.solid_fraction:.4f}  contacts {contacts:.2f}  "
        f"{seconds:5.2f} s  verified {vg.verify(packing).ok}"
    )
    vg.save(packing, folder / f"{name.replace(', ', '_').replace(' ', '_')}.vtp", overwrite=True)
    panel.imshow(picture_packing(packing))
    panel.set_title(f"{name}: {packing.solid_fraction:.3f}", fontsize=10)
    panel.axis("off")
# Picture: Ten packings of spheres and disks, each with its method and solid fraction above it.
figure.savefig(folder / "sphere_families.png", dpi=100)
