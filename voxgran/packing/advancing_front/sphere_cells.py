"""Cells of the spheres of a front, and whether a position is free."""

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.geometry.level_grid import LevelGrid, empty_grid, link_at, unlink_at

#: a sphere and its periodic image as one number: the index of the sphere times 2 ** BITS, plus the image
BITS = 5
IMAGES = 2**BITS
#: the image without a shift; image i is shifted by i % 3 - 1, i // 3 % 3 - 1 and i // 9 - 1 lengths
HERE = 13
#: largest number of cells per sphere
SPARE = 2


def lay_cells(lengths: Floats, periods: Floats, radii: Floats, dimension: int) -> LevelGrid:
    """Return empty cells for spheres, from the lower corner of a box of these lengths that repeats by `periods`."""
    given = radii if len(radii) else np.ones(1)
    level = np.floor(libm.log2(given.max() / given)).astype(np.int64)
    used, number = np.unique(level, return_counts=True)
    largest = np.array([given[level == k].max() for k in used])
    axes = np.arange(3) < dimension
    span = np.where(axes, lengths, 1.0)
    full = np.maximum(np.floor(span / (2 * largest[:, None])), 1).astype(np.int64)
    full[:, ~axes] = 1
    count = np.array([_fewer(row, SPARE * int(many)) for row, many in zip(full, number, strict=True)])
    # along periodic axes the cells fill the length exactly
    periodic = periods.diagonal() > 0.0
    full = np.where(periodic, count, full)
    wraps = ((count < full) | periodic).astype(np.int64)
    reach, width = np.tile(largest[:, None], (1, 3)), np.ascontiguousarray(span / full, dtype=np.float64)
    return empty_grid(periods, reach, width, count, wraps, len(radii))


def _fewer(count: Integers, most: int) -> Integers:
    """Return numbers of cells whose product is at most `most`, the same along all axes that are reduced."""
    side = 1
    while side < count.max() and np.minimum(count, side + 1).prod() <= most:
        side += 1
    return np.minimum(count, side)


@bare_kernel
def link(cells: LevelGrid, spheres: Floats, sphere: int) -> None:
    """Link a sphere into its cell."""
    x, y, z, r = spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2], spheres[sphere, 3]
    link_at(cells, sphere, _level_of(cells, r), x, y, z)


@bare_kernel
def unlink(cells: LevelGrid, spheres: Floats, sphere: int) -> None:
    """Remove the sphere that was linked last."""
    x, y, z, r = spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2], spheres[sphere, 3]
    unlink_at(cells, sphere, _level_of(cells, r), x, y, z)


@bare_kernel
def _level_of(cells, r):  # type: ignore[no-untyped-def]
    """Return the level of a radius."""
    level = 0
    while level + 1 < len(cells.first) and r <= cells.reach[level + 1, 0]:
        level += 1
    return level


@bare_kernel
def link_all(cells: LevelGrid, spheres: Floats, many: int) -> None:
    """Link the first spheres, in their order."""
    for sphere in range(many):
        link(cells, spheres, sphere)
