"""Clump by multisphere: python clumps_multisphere.py MESH.stl COUNT SPHERES.npz.

The program voxelizes the mesh, with 100 voxels along its longest side, and takes spheres from the distance transform
of what is left. Prints the CPU seconds, without those of loading the program.
"""

import sys
import time

import multisphere
import numpy as np

mesh = multisphere.load_mesh(sys.argv[1])
began = time.process_time()
pack = multisphere.multisphere_from_mesh(mesh, div=100, max_spheres=int(sys.argv[2]))
sys.stdout.write(f"{time.process_time() - began}\n")
np.savez(sys.argv[3], centers=np.asarray(pack.centers), radii=np.asarray(pack.radii))
