"""Clump by CLUMP (clump-python): python clumps_clump.py MESH.stl COUNT SPHERES.npz.

The greedy choice on the Euclidean distance transform, with 50 voxels along the shortest side and an overlap of 0.6.
Prints the CPU seconds, without those of loading the program.
"""

import sys
import time

import numpy as np
import trimesh
from CLUMP import GenerateClump_Euclidean_3D

began = time.process_time()
made = GenerateClump_Euclidean_3D(sys.argv[1], int(sys.argv[2]), 0, 50, 0.6)
clump = made[1] if isinstance(made, tuple) else made
sys.stdout.write(f"{time.process_time() - began}\n")
# the program returns centers in the frame of the middle of the bounding box
middle = trimesh.load_mesh(sys.argv[1]).bounds.mean(axis=0)
np.savez(sys.argv[3], centers=np.asarray(clump.positions) + middle, radii=np.asarray(clump.radii).ravel())
