"""Voxels of shapes in closed form: balls, unions of balls, regular solids, disks and polygons."""

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran.lattice.grid import Grid
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.voxels.touch import touched_voxels

#: which point of a voxel decides: its center, the one nearest to the middle of a ball, or the one farthest from it
_REACH = {"center": 0.0, "touch": -0.5, "whole": 0.5}


def balls_mask(centers: Floats, radii: Floats, grid: Grid, *, cover: str) -> Booleans:
    """Return the voxels of a union of balls.

    Parameters
    ----------
    centers : (n, 3) ndarray of float
        Centers, in the unit of lengths.
    radii : (n,) ndarray of float
        Radii.
    grid : Grid
        Lattice.
    cover : {"center", "touch", "whole"}
        Whether the center of a voxel must lie in a closed ball, the closed cube meet one, or one hold the whole cube.

    Returns
    -------
    (nx, ny, nz) ndarray of bool
    """
    mask = np.zeros(grid.shape, dtype=np.bool_)
    reach = _REACH[cover] * grid.voxel_size
    for center, radius in zip(centers, radii, strict=True):
        low = np.maximum(grid.indices(center[None] - radius)[0] - 1, 0)
        high = np.minimum(grid.indices(center[None] + radius)[0] + 2, grid.shape)
        if (low >= high).any():
            continue
        x, y, z = (
            np.maximum(np.abs(grid.centers(axis)[low[axis] : high[axis]] - center[axis]) + reach, 0.0) ** 2
            for axis in range(3)
        )
        near = x[:, None, None] + y[None, :, None] + z[None, None, :] <= radius**2 * (1 + 1e-12)
        mask[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] |= near
    return mask


def primitive_centers(solid: Primitive, grid: Grid, offset: Floats) -> Booleans:
    """Return the voxels whose center lies in a regular solid at a (3,) offset."""
    mask = np.zeros(grid.shape, dtype=np.bool_)
    y, z = np.meshgrid(grid.centers(1), grid.centers(2), indexing="ij")
    for k, x in enumerate(grid.centers(0)):
        points = np.column_stack([np.full(y.size, x), y.ravel(), z.ravel()]) - offset
        mask[k] = solid.contains(points).reshape(y.shape)
    return mask


def outline_mask(outline: Outline, grid: Grid, *, cover: str) -> Booleans:
    """Return the pixels of an outline, (nx, ny, 1); the z of the lattice is not looked at."""
    if outline.kind == "disk":
        flat = Grid((grid.origin[0], grid.origin[1], -grid.voxel_size / 2), grid.voxel_size, (*grid.shape[:2], 1))
        center, radius = np.array([[*outline.center, 0.0]]), np.array([outline.radius])
        if cover == "surface":
            # without the z of the cube, the corner farthest from the middle lies outside
            return balls_mask(center, radius, flat, cover="touch") & ~_whole_pixels(outline, flat)
        return balls_mask(center, radius, flat, cover=cover)
    if cover == "surface":
        return _touched_pixels(outline, grid)
    x, y = np.meshgrid(grid.centers(0), grid.centers(1), indexing="ij")
    inside = outline.contains(np.column_stack([x.ravel(), y.ravel()])).reshape(*x.shape, 1)
    return inside | _touched_pixels(outline, grid) if cover == "touch" else inside


def _whole_pixels(outline: Outline, grid: Grid) -> Booleans:
    """Return the pixels that a disk holds without touching their corners from inside."""
    half = grid.voxel_size / 2
    x, y = (np.abs(grid.centers(axis) - outline.center[axis]) + half for axis in range(2))
    return np.asarray((x[:, None] ** 2 + y[None, :] ** 2 < outline.radius**2)[:, :, None])


def _touched_pixels(outline: Outline, grid: Grid) -> Booleans:
    """Return the pixels that the sides of a polygon touch: upright faces through one layer of voxels."""
    rim, n = outline.vertices, len(outline.vertices)
    low, high = (np.column_stack([rim, np.full(n, grid.origin[2] + part * grid.voxel_size)]) for part in (0.25, 0.75))
    k = np.arange(n)
    after = (k + 1) % n
    faces = np.concatenate([np.column_stack([k, after, n + k]), np.column_stack([after, n + after, n + k])])
    return touched_voxels(np.concatenate([low, high]), faces, grid)
