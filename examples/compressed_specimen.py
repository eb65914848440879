"""
Specimens under a stress
========================

Polyhedra that are compressed isotropically and along one axis, without gravity, from the same loose places. The script
prints the solid fraction of each specimen, its axial stresses, the share of its grains that bear no forces, and whether
`equilibrium` proves that the others are in balance. The loose grains and the isotropic specimen are drawn, with the
forces between its grains.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments
from voxgran.report.force_chains import picture_forces
from voxgran.report.scenes import picture_cut

[folder] = arguments(__doc__, folder=Path("out/compressed_specimen"))
folder.mkdir(parents=True, exist_ok=True)
rocks = [vg.make_shape("convex_polyhedron", seed=seed) for seed in range(5)]
loose = vg.pack(rocks, vg.Box((6, 6, 14), periodic="xyz"), method="rsa", count=200, seed=1)
specimens = {"isotropic": vg.compress(loose, shear="held"), "oedometric": vg.compress(loose, axes="z")}
for name, specimen in specimens.items():
    proof = vg.equilibrium(specimen).attrs
    print(
        f"{name}  solid fraction {specimen.solid_fraction:.3f}  "
        f"stresses {np.round(np.diag(specimen.forces.stress), 2).tolist()}  "
        f"bear nothing {proof['share_of_rattlers']:.2f}  in balance {proof['share_at_rest_without_rattlers']:.3f}  "
        f"verified {vg.verify(specimen).ok}"
    )

# %%
# **Loose grains, the specimen and its forces**
figure = Figure(figsize=(12, 4.2), layout="constrained")
pictures = {
    "loose": picture_cut(loose),
    "compressed": picture_cut(specimens["isotropic"]),
    "forces between the grains": picture_forces(specimens["isotropic"]),
}
for panel, (title, picture) in zip(figure.subplots(1, 3), pictures.items(), strict=True):
    panel.imshow(picture)
    panel.set_title(title)
    panel.axis("off")
# Picture: Polyhedra scattered in a periodic cell; the same grains after the cell was compressed; and the forces between
#   them as tubes, thick where forces are large.
figure.savefig(folder / "compressed_specimen.png", dpi=110)
