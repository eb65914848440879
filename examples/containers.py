"""
Containers
==========

The same grains at rest in a box, a cylinder, a sphere, two hoppers, a drum, a tilted periodic cell and a scanned rock.
The script prints the number of grains in each and whether they overlap nothing, and draws the beds, cut open.
"""

from pathlib import Path

from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.scenes import picture_cut

folder, count = arguments(__doc__, folder=Path("out/containers"), count=150)
folder.mkdir(parents=True, exist_ok=True)
grains = [vg.make_shape("convex_polyhedron", seed=seed) for seed in range(3)]
rock = vg.load_shape(vg.data_file("eros.obj"))
containers = {
    "Box": vg.Box((6, 6, 9)),
    "Cylinder": vg.Cylinder(radius=3.5, height=9),
    "Sphere": vg.Sphere(radius=5),
    "Hopper": vg.Hopper(radius=5, outlet=2.6, angle=60, bin_height=5),
    "Hopper, a wedge": vg.Hopper(radius=4, outlet=2.6, angle=60, length=6, bin_height=5),
    "Drum": vg.Drum(radius=4, length=7, axis="x"),
    "Box, tilted and periodic": vg.Box((6, 6, 9), periodic="xy", tilt=(2.5, 0, 0)),
    "ClosedMesh": vg.ClosedMesh(rock.scaled(9 / rock.diameter)),
}

# %%
# **The beds, cut open**
figure = Figure(figsize=(13, 6.6), layout="constrained")
for panel, (title, container) in zip(figure.subplots(2, 4).ravel(), containers.items(), strict=True):
    bed = vg.pack(grains, container, "gravity", count=count, sizes=vg.sizes.uniform(0.8, 1.2), seed=1)
    print(f"{title:25s} {bed.count} grains  verified {vg.verify(bed).ok}")
    panel.imshow(picture_cut(bed, legend=False))
    panel.set_title(title)
    panel.axis("off")
# Picture: Polyhedra at rest in a box, a cylinder, a sphere, a conical and a wedge-shaped hopper, a drum across gravity,
#   a tilted periodic cell, and inside of a scanned rock.
figure.savefig(folder / "containers.png", dpi=110)
