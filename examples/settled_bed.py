"""
Beds at rest, and the forces in them
====================================

Polyhedra that grow from random seeds and settle, the same bed shaken, and spheres after a digital walk. The script
prints the bulk solid fraction of each bed, the mean coordination number, the share of the grains that `equilibrium`
proves to rest, and the largest force at a contact. The packings are saved with their forces. A loose bed is drawn
before and after it settles, with the forces between its grains.
"""

from pathlib import Path

from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.force_chains import picture_forces
from voxgran.report.scenes import picture_cut

[folder] = arguments(__doc__, folder=Path("out/settled_bed"))
folder.mkdir(parents=True, exist_ok=True)
rocks = [vg.make_shape("convex_polyhedron", seed=seed) for seed in range(5)]
box, sizes = vg.Box((5, 5, 14), periodic="xy"), vg.sizes.lognormal(1.0, 0.2)
poured = vg.pack(rocks, box, method="gravity", count=150, sizes=sizes, friction=0.5, seed=1)
beds = {
    "poured": poured,
    "shaken": vg.settle(poured, friction=0.5, shaking={"acceleration": 1.0, "duration": 30.0}),
    "walked": vg.pack(vg.make_shape("sphere"), box, method="digital", count=150, sweeps=200, settle={"friction": 0.3}),
}
for name, bed in beds.items():
    rest = vg.equilibrium(bed, friction=bed.forces.friction)
    numbers = vg.measure(bed, which=["density", "coordination"])
    print(
        f"{name}  bulk solid fraction {float(numbers['bulk_solid_fraction']):.3f}  "
        f"coordination {float(numbers['mean_coordination_number']):.2f}  at rest {rest.attrs['share_at_rest']:.3f}  "
        f"largest force {bed.forces.magnitude.max():.1f} weights  verified {vg.verify(bed).ok}"
    )
    vg.save(bed, folder / f"{name}.vtp", overwrite=True)

# %%
# **A loose bed before and after settling**
loose = vg.pack(rocks, vg.Box((8, 8, 10), periodic="xy"), method="rsa", count=120, sizes=sizes, seed=1)
settled = vg.settle(loose, gravity="-z")
figure = Figure(figsize=(12, 4.2), layout="constrained")
pictures = {
    "before": picture_cut(loose),
    "settled": picture_cut(settled),
    "forces between the grains": picture_forces(settled),
}
for panel, (title, picture) in zip(figure.subplots(1, 3), pictures.items(), strict=True):
    panel.imshow(picture)
    panel.set_title(title)
    panel.axis("off")
# Picture: Polyhedra scattered in a box; the same grains after settling as a bed; and the forces between them as
#   tubes, thick where forces are large.
figure.savefig(folder / "settled_bed.png", dpi=110)
