"""voxgran's own: parity along columns on bits, in double precision, without any library but numba."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import DirtyMeshError
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask
from voxgran.voxels.backend import Backend
from voxgran.voxels.scanline import centers_inside


def occupy(vertices: Floats, faces: Integers, grid: Grid) -> PackedMask:
    """Return the voxels whose center lies inside.

    Raises
    ------
    DirtyMeshError
        If a column of centers crosses the surface an odd number of times: it has a hole.
    """
    bits, odd = centers_inside((vertices - np.array(grid.origin)) / grid.voxel_size, faces, grid.shape)
    if odd:
        raise DirtyMeshError(
            f"the surface leaves {odd} columns of voxels open: a solid must be closed; mend it with "
            "voxgran.repair, or take voxgran.voxelize_mesh, which settles small holes"
        )
    return bits


registration = Backend(name="scanline", summary="parity along columns, exact and bit-packed", occupy=occupy, band=0.0)
