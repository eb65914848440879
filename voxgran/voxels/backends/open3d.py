"""Open3D: occupancy of the voxel centers by ray casting.

Ray casting is in single precision; the body is therefore centered and brought to size 1, and several rays vote. The
rays differ little, so that all of them may pass through the same edge and be miscounted: the body is turned to where no
edge of a regular body lies in their direction, and what is near to the surface is settled elsewhere (`band`).
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.rotation import normalized, rotation_matrices
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask
from voxgran.voxels.backend import Backend

#: points asked at once: bounds the memory
POINTS = 2_000_000
#: rays that vote on each point; with one ray signs are sometimes wrong
RAYS = 5
#: a rotation without symmetry
TURN = (0.877, 0.262, -0.371, 0.159)


def occupy(vertices: Floats, faces: Integers, grid: Grid) -> PackedMask:
    """Return the voxels whose center lies inside."""
    open3d = load("open3d")
    turn = rotation_matrices(normalized(np.array([TURN])))[0].T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, size = (low + high) / 2, float((high - low).max())
    scene = open3d.t.geometry.RaycastingScene()
    body = ((vertices - middle) / size @ turn).astype(np.float32)
    scene.add_triangles(open3d.core.Tensor(body), open3d.core.Tensor(faces.astype(np.uint32)))
    x, y, z = ((grid.centers(axis) - middle[axis]) / size for axis in range(3))
    bits = PackedMask.empty(grid.shape)
    thick = max(1, POINTS // (grid.shape[1] * grid.shape[2]))
    for begin in range(0, grid.shape[0], thick):
        slab = np.stack(np.meshgrid(x[begin : begin + thick], y, z, indexing="ij"), axis=-1) @ turn
        votes = scene.compute_occupancy(open3d.core.Tensor(slab.astype(np.float32)), nsamples=RAYS)
        bits.words[begin : begin + thick] = PackedMask.of(votes.numpy() > 0.5).words
    return bits


registration = Backend(name="open3d", summary="Open3D's ray casting, several rays a voxel", occupy=occupy, band=1e-4)
