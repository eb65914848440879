"""Shares of voxels: which part of each voxel that the surface cuts is solid.

A mesh is cut by 8 x 8 columns through each voxel, along which the length inside is exact; of other shapes 8 x 8 x 8
points (in two dimensions 8 x 8) of each cut voxel are asked.
"""

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.lattice.grid import Grid
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Geometry
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.voxels.closed_form import balls_mask, outline_mask
from voxgran.voxels.scanline import column_shares
from voxgran.voxels.touch import touched_voxels

#: columns, or points, along each edge of a voxel
SAMPLES = 8
#: points asked at once: bounds the memory
POINTS = 2_000_000


def voxel_shares(geometry: Geometry, grid: Grid, mask: Booleans, touched: Booleans) -> Floats:
    """Return the share of each voxel that is solid.

    Parameters
    ----------
    geometry : Mesh or Primitive or Spheres or Outline
        True geometry.
    grid : Grid
        Lattice.
    mask, touched : (nx, ny, nz) ndarray of bool
        Voxels whose center is in the solid, and those that the solid touches.

    Returns
    -------
    (nx, ny, nz) ndarray of float
    """
    if isinstance(geometry, Mesh):
        inner = (geometry.vertices - np.array(grid.origin)) / grid.voxel_size
        cut = touched_voxels(geometry.vertices, geometry.faces, grid)
        share = column_shares(inner, geometry.faces, grid.shape, SAMPLES)
        return np.asarray(np.where(cut, np.clip(share, 0.0, 1.0), mask))
    cut = touched & ~_whole_voxels(geometry, grid)
    share = mask.astype(np.float64)
    indices = np.argwhere(cut)
    step = max(1, POINTS // SAMPLES**geometry.dimension)
    for begin in range(0, len(indices), step):
        part = indices[begin : begin + step]
        share[tuple(part.T)] = _asked(geometry, grid, part)
    return share


def _asked(geometry: Primitive | Spheres | Outline, grid: Grid, indices: Integers) -> Floats:
    """Return the share of the points of each voxel that lie in the solid."""
    steps = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    upward = steps if geometry.dimension == 3 else np.zeros(1)
    inner = np.stack(np.meshgrid(steps, steps, upward, indexing="ij"), axis=-1).reshape(-1, 3)
    points = grid.coordinates(indices)[:, None] + inner[None] * grid.voxel_size
    inside = geometry.contains(points.reshape(-1, 3))
    return np.asarray(inside.reshape(len(indices), -1).mean(axis=1))


def _whole_voxels(geometry: Primitive | Spheres | Outline, grid: Grid) -> Booleans:
    """Return voxels that are wholly solid: all of them, or for unions of balls those that one ball holds."""
    if isinstance(geometry, Spheres):
        return balls_mask(geometry.centers, geometry.radii, grid, cover="whole")
    if isinstance(geometry, Outline):
        return ~outline_mask(geometry, grid, cover="surface")
    # a regular solid is convex: it holds a cube when it holds its corners
    axes = [grid.origin[axis] + np.arange(n + 1) * grid.voxel_size for axis, n in enumerate(grid.shape)]
    corners = np.zeros([len(axis) for axis in axes], dtype=np.bool_)
    y, z = np.meshgrid(axes[1], axes[2], indexing="ij")
    for k, x in enumerate(axes[0]):
        points = np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()])
        corners[k] = geometry.contains(points).reshape(y.shape)
    for axis in range(3):
        corners = np.delete(corners, -1, axis) & np.delete(corners, 0, axis)
    return np.asarray(corners)
