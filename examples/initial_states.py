"""
Hoppers, layers, obstacles and fibres
=====================================

A hopper filled by gravity, two layers upon each other, a bed around a bar that stands in the container, and fibres with
an orientation tensor, as in the scenes of these names. The script prints the number of grains of each, whether they
overlap nothing and, of beds, which share of the grains is proven to rest; the packings are drawn, cut open.
"""

from pathlib import Path

from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.scenes import picture_cut

[folder] = arguments(__doc__, folder=Path("out/initial_states"))
folder.mkdir(parents=True, exist_ok=True)
sphere, fibre = vg.shapes.sphere(), vg.make_shape("spherocylinder", radius=5, height=100)
mould = vg.Box((7, 7, 9))
across = (0.7071067811865476, 0, 0.7071067811865476, 0)
bar = vg.Packing.of(
    vg.make_shape("cylinder", radius=0.8, height=7.0), mould, position=[(3.5, 3.5, 2.5)], orientation=[across]
)
layers = [
    {"shapes": vg.shapes.sphere(diameter=10), "height": 30, "density": 2650},
    {"shapes": sphere, "height": 20, "density": 2500, "sizes": vg.sizes.uniform(5, 7)},
]
tensor = vg.orientations.tensor([[0.7, 0.05, 0], [0.05, 0.22, 0], [0, 0, 0.08]])
packings = {
    "hopper": vg.pack(
        sphere,
        vg.Hopper(radius=6, outlet=2.6, angle=60, bin_height=6),
        "gravity",
        count=600,
        sizes=vg.sizes.uniform(0.8, 1.2),
        seed=3,
    ),
    "layers": vg.pack_layers(layers, vg.Box((50, 50, 120), periodic="xy"), friction=0.3, seed=1, unit="mm"),
    "bed around a bar": vg.pack(
        sphere, mould, "gravity", count=220, obstacles=bar, sizes=vg.sizes.lognormal(1.0, 0.15), seed=1
    ),
    "oriented fibres": vg.pack(
        fibre, vg.Box((300, 300, 300), periodic="xyz"), "rsa", count=450, orientations=tensor, seed=1
    ),
}
for title, packing in packings.items():
    rest = "" if packing.gravity is None else f"  at rest {packing.forces.share_at_rest:.3f}"
    print(f"{title:18s} {packing.count:4d} grains  verified {vg.verify(packing).ok}{rest}")

# %%
# **The packings, cut open**
figure = Figure(figsize=(13, 3.9), layout="constrained")
for panel, (title, packing) in zip(figure.subplots(1, 4), packings.items(), strict=True):
    panel.imshow(picture_cut(packing, legend=False))
    panel.set_title(title)
    panel.axis("off")
# Picture: Spheres at rest in a conical hopper with a bin above it; gravel with a layer of sand upon it; a bed of
#   spheres around a cylindrical bar; and rods that lie along one axis mostly.
figure.savefig(folder / "initial_states.png", dpi=110)
