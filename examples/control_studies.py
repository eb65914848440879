"""
What influences a bed of control points
=======================================

Four small studies of control-point packing: feeding rate, way of feeding, boundaries, and shape of the grains. Each
study changes one condition of the same bed: spheres fed at the default rate into a box with periodic sides, half as
wide as the bed is high, which settles after the walk. The script prints the bulk solid fraction (which needs 50 grains
away from walls and surface), the mean height of the grains above the floor in diameters, and the CPU seconds of
a run, as means over several seeds. It writes a table, with the yardstick of the benchmarks beside the seconds, and a
figure with error bars of two standard errors.

Arguments: folder, number of grains, sweeps, number of seeds (400 400 3 in the documentation).
"""

import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import arguments, write_rows

folder, count, sweeps, seeds = arguments(__doc__, folder=Path("out/control_studies"), count=150, sweeps=60, seeds=1)
width = (0.6 * count) ** (1 / 3)
periodic = vg.Box((width, width, 4 * width), "xy")
studies = {
    "feeding rate": {str(rate): {"rate": rate} for rate in (0.003, 0.01, 0.05, 0.2)},
    "way of feeding": {
        "rain": {},
        "rain, a lid": {"lid": True},
        "layers": {"feed": "layers"},
        "at once": {"feed": "at_once"},
    },
    "boundaries": {
        "periodic": {},
        "walls": {"container": vg.Box((width, width, 4 * width))},
        "cylinder": {"container": vg.Cylinder(width / np.sqrt(np.pi), 4 * width)},
    },
    "shape": {
        "sphere": {},
        "ellipsoid": {"shape": vg.make_shape("ellipsoid", aspect=(1.25, 1.0, 0.8))},
        "cube": {"shape": vg.make_shape("box")},
        "octahedron": {"shape": vg.make_shape("platonic", solid="octahedron")},
    },
}
usual = {"method": "control_point", "sweeps": sweeps, "cycles": 4, "spacing": 0.2}
known = {}


# %%
# **One bed**
def measured(seed, shape=None, container=periodic, **options):
    """Return bulk solid fraction, mean height and seconds of one bed; results are cached."""
    key = (seed, str(shape), str(container), str(options))
    if key not in known:
        began = time.process_time()
        solid = shape or vg.make_shape("sphere")
        packing = vg.pack(solid, container, count=count, seed=seed, **usual, **options)
        seconds = time.process_time() - began
        assert vg.verify(packing).ok
        bulk = float(vg.measure(packing, which=["density"])["/"].bulk_solid_fraction)
        known[key] = bulk, float(packing.position[:, 2].mean()), seconds
    return known[key]


# %%
# **All beds**
#
# A bed of 150 grains between walls has too few grains in its bulk for a solid fraction; the figure states that.
# More grains, sweeps and seeds are arguments of the script.
# compile first, so that this is not timed
vg.pack(vg.make_shape("sphere"), periodic, method="control_point", count=2, sweeps=1)
figure = Figure(figsize=(11, 6), layout="constrained")
rows = []
for panel, (study, choices) in zip(figure.subplots(2, 2).flat, studies.items(), strict=True):
    for place, (choice, options) in enumerate(choices.items()):
        beds = np.array([measured(seed, **options) for seed in range(1, seeds + 1)])
        bulk, height, seconds = beds.mean(axis=0)
        error = beds[:, 0].std(ddof=1) / np.sqrt(seeds) if seeds > 1 else 0.0
        rows.append([study, choice, f"{bulk:.4f}", f"{error:.4f}", f"{height:.3f}", f"{seconds:.2f}"])
        print(
            f"{study:14s} {choice:12s} bulk {bulk:.4f} (standard error {error:.4f})  mean height {height:.3f}  "
            f"{seconds:.2f} s"
        )
        if np.isnan(bulk):
            panel.text(place, 0.5, "too few grains\nin the bulk", ha="center", transform=panel.get_xaxis_transform())
        panel.errorbar(place, bulk, 2 * error, fmt="o", color="C0", capsize=3)
    panel.set_xticks(range(len(choices)), list(choices))
    panel.set(title=study, ylabel="bulk solid fraction")
    panel.set_xlim(-0.5, len(choices) - 0.5)
    panel.margins(y=0.2)
folder.mkdir(parents=True, exist_ok=True)
# Picture: Bulk solid fraction for each feeding rate, way of feeding, boundary and shape, as points with error bars.
figure.savefig(folder / "control_studies.svg")
head = "study,choice,bulk_solid_fraction,standard_error,mean_height,seconds"
write_rows(folder / "control_studies.csv", head, rows)
