"""
From spheres to polyhedra
=========================

A dense advancing front of spheres becomes a bed of polyhedra in three steps: a hull is inscribed in each sphere, the
hulls grow, and the bed settles. Each sphere is replaced by its own convex hull of random points. The hulls grow until
each touches a neighbour or a wall. The script prints the solid fraction and the mean height after each stage, the
growth factors and the resulting change of the gradation, and draws the stages.

Arguments: folder, edge of the box in mean diameters.
"""

from pathlib import Path

from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.scenes import picture_cut

folder, side = arguments(__doc__, folder=Path("out/hulls_in_spheres"), side=4.0)

# %%
# **Spheres, hulls, growth and settling**
box = vg.Box((side, side, side))
sizes = vg.sizes.uniform(0.6, 1.2)
spheres = vg.pack(
    vg.make_shape("sphere"), box, method="advancing_front", mode="dense", order="lowest", sizes=sizes, seed=1
)
hulls = [vg.make_shape("convex_polyhedron", seed=k, points=12) for k in range(spheres.count)]
inscribed = vg.inscribe(spheres, hulls, shape_id=range(spheres.count), seed=1)
grown = vg.grow(inscribed)
settled = vg.settle(grown, gravity="-z")
stages = {"spheres": spheres, "inscribed": inscribed, "grown": grown, "settled": settled}

# %%
# **Numbers and pictures of the stages**
folder.mkdir(parents=True, exist_ok=True)
figure = Figure(figsize=(12, 3.4), layout="constrained")
for panel, (name, packing) in zip(figure.subplots(1, 4), stages.items(), strict=True):
    print(
        f"{name:10s} grains {packing.count:5d}  solid fraction {packing.solid_fraction:.4f}  "
        f"height {packing.position[:, 2].mean():.3f}  verified {vg.verify(packing).ok}"
    )
    vg.save(packing, folder / f"{name}.vtp", overwrite=True)
    panel.imshow(picture_cut(packing))
    panel.set_title(f"{name}: {packing.solid_fraction:.3f}")
    panel.axis("off")
growth = grown.provenance["growth"]
print(
    f"hulls grown by {growth['mean_factor']:.3f} on average, "
    f"{growth['largest_factor']:.2f} at the most; touching {growth['touching']:.3f}; "
    f"gradation moved by {growth['gradation_distance']:.3f}"
)
# Picture: A cut box of spheres, the smaller hulls in them, the hulls after growth, and after settling, when the bed
#   is lower.
figure.savefig(folder / "hulls_in_spheres.png", dpi=110)
