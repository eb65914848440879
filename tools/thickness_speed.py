"""Measure the time and error of local thickness against a twin on SciPy: thickness_speed.py FILE.csv

Each line is an image of spheres in the lower part of a box, above which a pore as wide as the box is empty. The twin
takes SIZES radii between the smallest and the largest, as users of distance transforms do: for each it finds the voxels
within that radius of a voxel that is as far from the solid. Seconds are CPU seconds, after a first call.
"""

import time
from collections.abc import Callable

import numpy as np
from scipy import ndimage

import voxgran as vg
from benchmarks.model import arguments, write_rows

EDGES = (40, 80, 120, 160)
#: edge of a voxel
VOXEL = 0.05
#: radii of the twin
SIZES = 25


def image(edge: int) -> np.ndarray:
    """Return the pores of a box of edge x edge x 4 / 3 edge voxels, a quarter of which holds spheres."""
    size, height = edge * VOXEL, edge * VOXEL / 3
    box = vg.Box((size, size, height))
    bed = vg.pack(vg.shapes.sphere(diameter=10 * VOXEL), box, "rsa", solid_fraction=0.25, seed=1)
    solid = vg.to_image(bed, VOXEL, labels=False)
    return ~np.pad(solid, ((0, 0), (0, 0), (0, edge)))


def twin(pores: np.ndarray) -> np.ndarray:
    """Return the local thickness in steps of the size, the image within walls."""
    inside = np.pad(pores, 1)
    distance = ndimage.distance_transform_edt(inside)
    found = np.zeros(inside.shape)
    for radius in np.geomspace(1.0, distance.max(), SIZES):
        found[ndimage.distance_transform_edt(distance < radius) < radius] = 2 * radius
    return np.where(inside, found, 0)[1:-1, 1:-1, 1:-1]


def timed(function: Callable[[np.ndarray], np.ndarray], pores: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the seconds of a call and its result."""
    began = time.process_time()
    result = function(pores)
    return time.process_time() - began, result


def ours(pores: np.ndarray) -> np.ndarray:
    """Return the local thickness within walls."""
    return vg.local_thickness(np.pad(pores, 1))[1:-1, 1:-1, 1:-1]


def main() -> None:
    """Write the table."""
    [target] = arguments(__doc__, "file")
    ours(image(EDGES[0]))
    rows = []
    for edge in EDGES:
        pores = image(edge)
        seconds, exact = timed(ours, pores)
        seconds_of_twin, steps = timed(twin, pores)
        error = float(np.abs(steps - exact)[pores].mean() / exact[pores].mean())
        row = {"voxels": pores.size, "widest_pore": f"{exact.max():.1f}", "seconds": f"{seconds:.2f}"}
        rows.append(row | {"seconds_of_twin": f"{seconds_of_twin:.2f}", "mean_error_of_twin": f"{error:.3f}"})
    write_rows(target, ",".join(rows[0]), [row.values() for row in rows])


if __name__ == "__main__":
    main()
