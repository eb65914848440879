"""
Which packings rest?
====================

Spheres packed by four methods in a box with a floor. `verify` looks for overlaps and escapes, `equilibrium` for forces
that balance every grain at the contacts that are there. The script prints both, and draws the share of the grains whose
residual force is below a value.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments

folder, count = arguments(__doc__, folder=Path("out/checked_beds"), count=400)
folder.mkdir(parents=True, exist_ok=True)
width = float(np.ceil(np.cbrt(0.8 * count)))
box = vg.Box((width, width, 1.6 * width), periodic="xy")
loose = vg.pack(vg.shapes.sphere(), box, "digital", count=count, settle=False)
beds = {
    "gravity": vg.pack(vg.shapes.sphere(), box, "gravity", count=count),
    "deposition": vg.pack(vg.shapes.sphere(), box, "deposition", count=count),
    "digital, not settled": loose,
    "digital, settled": vg.settle(loose),
}

# %%
# **Residuals**
figure = Figure(figsize=(6, 3.6), layout="constrained")
axes = figure.subplots()
for name, bed in beds.items():
    check, rest = vg.verify(bed), vg.equilibrium(bed)
    share = rest.attrs["share_at_rest"]
    print(f"{name}: overlapping pairs {check.overlapping_pairs}, escaped {check.escaped}, at rest {share:.3f}")
    axes.step(np.sort(np.maximum(rest.residual, 1e-9)), np.arange(1, bed.count + 1) / bed.count, label=name)
axes.axvline(0.01, color="0.5", linestyle=":")
axes.set(
    xscale="log", xlabel="residual force, in weights of the grain", ylabel="share of the grains below", ylim=(0, 1.02)
)
axes.legend(frameon=False)
# Picture: Share of the grains whose residual force is below a value, for beds by gravity, by deposition, and by a
#   digital walk before and after settling; a dotted line marks a hundredth of the weight, below which a grain rests.
figure.savefig(folder / "checked_beds.png", dpi=110)
