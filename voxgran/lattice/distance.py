"""Distances on a lattice."""

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran._base.lazy import load


def inside_distance(mask: Booleans, voxel_size: float) -> Floats:
    """Return the distance of each taken voxel's center from the nearest free voxel, less half a voxel.

    That is how large a ball about the center may be before it leaves the taken voxels, within half a voxel's diagonal;
    free voxels get 0. What lies beyond the lattice counts as free.

    Parameters
    ----------
    mask : (nx, ny, nz) ndarray of bool
        Taken voxels.
    voxel_size : float
        Edge of a voxel, in the unit of lengths.
    """
    padded = np.pad(mask, 1)
    distance = load("scipy.ndimage").distance_transform_edt(padded)[1:-1, 1:-1, 1:-1]
    return np.asarray(np.maximum(distance - 0.5, 0.0) * voxel_size)
