"""Grains of a binary image by the SNOW algorithm of porespy: python segmentation_snow.py SOLID.npz LABELS.npz.

The input has the solid voxels and their distance to the void, which knows the edges of voxels; the output has labels.
Prints the CPU seconds.
"""

import sys
import time

import numpy as np
import porespy

porespy.settings.tqdm["disable"] = True
with np.load(sys.argv[1], allow_pickle=False) as given:
    solid, distance = given["solid"], given["distance"]
began = time.process_time()
# r_max and sigma as by default
found = porespy.filters.snow_partitioning(im=solid, dt=distance)
seconds = time.process_time() - began
np.savez(sys.argv[2], labels=np.asarray(found.regions) * solid)
print(seconds)  # noqa: T201
