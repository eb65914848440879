"""voxgran's own: parity along columns of voxel centers, in double precision, without any library but numba."""

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.lattice.grid import Grid
from voxgran.voxels.backend import Backend
from voxgran.voxels.scanline import centers_inside


def occupy(vertices: Floats, faces: Integers, grid: Grid) -> Booleans:
    """Return the mask of voxels whose center lies inside."""
    return centers_inside((vertices - np.array(grid.origin)) / grid.voxel_size, faces, grid.shape)


registration = Backend(name="scanline", summary="parity along columns, double precision", occupy=occupy, band=1e-9)
