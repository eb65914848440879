"""Open3D: occupancy of the voxel centers by ray casting.

Ray casting is in single precision, so the body is centered and scaled to size 1, and the majority of several rays
decides. The rays differ little, and all of them may pass through the same edge and be miscounted: the body is rotated
so that no edge of a regular body lies in their direction, and the caller decides voxels near the surface (`ROUND_OFF`).
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.geometry.rotation import normalized, rotation_matrices
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask

#: number of points in a query, which limits the memory
POINTS = 2_000_000
#: number of rays for each point; with one ray the result is sometimes wrong
RAYS = 5
#: distance from the surface, relative to the size of the body, within which a result may be wrong
ROUND_OFF = 1e-4
#: a rotation without symmetry
TURN = (0.877, 0.262, -0.371, 0.159)


def open3d_inside(vertices: Floats, faces: Integers, grid: Grid) -> PackedMask:
    """Return the voxels whose center lies inside."""
    open3d = load("open3d")
    turn = rotation_matrices(normalized(np.array([TURN])))[0].T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, size = (low + high) / 2, float((high - low).max())
    scene = open3d.t.geometry.RaycastingScene()
    body = linear.matmul((vertices - middle) / size, turn).astype(np.float32)
    scene.add_triangles(open3d.core.Tensor(body), open3d.core.Tensor(faces.astype(np.uint32)))
    x, y, z = ((grid.centers(axis) - middle[axis]) / size for axis in range(3))
    bits = PackedMask.empty(grid.shape)
    thick = max(1, POINTS // (grid.shape[1] * grid.shape[2]))
    for begin in range(0, grid.shape[0], thick):
        slab = linear.matmul(np.stack(np.meshgrid(x[begin : begin + thick], y, z, indexing="ij"), axis=-1), turn)
        votes = scene.compute_occupancy(open3d.core.Tensor(slab.astype(np.float32)), nsamples=RAYS)
        bits.words[begin : begin + thick] = PackedMask.from_mask(votes.numpy() > 0.5).words
    return bits
