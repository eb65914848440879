"""Cells of the spheres of a front, and whether a position is free."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.geometry.level_grid import (
    LevelGrid,
    cells_near,
    empty_grid,
    first_in_cell,
    image_shift,
    link_at,
    unlink_at,
)
from voxgran.geometry.vectors import sub

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
    level = np.floor(np.log2(given.max() / given)).astype(np.int64)
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


@bare_kernel
def is_free(cells: LevelGrid, spheres: Floats, x: float, y: float, z: float, r: float, slack: float) -> bool:
    """Return whether a sphere would overlap no other by more than the slack."""
    for level in range(len(cells.first)):
        if not _is_free_within(cells, spheres, level, x, y, z, r, slack, r + cells.reach[level, 0]):
            return False
    return True


@bare_kernel
def _is_free_within(cells, spheres, level, x, y, z, r, slack, reach):  # type: ignore[no-untyped-def]
    """Return whether a sphere would overlap none of a level, in the cells within reach."""
    low, high = cells_near(cells, level, x, y, z, (reach, reach, reach))
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            for k in range(low[2], high[2]):
                sphere, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                px, py, pz = sub((x, y, z), image_shift(cells, ti, tj, tk))
                while sphere >= 0:
                    dx, dy, dz = px - spheres[sphere, 0], py - spheres[sphere, 1], pz - spheres[sphere, 2]
                    apart = r + spheres[sphere, 3] - slack
                    if dx * dx + dy * dy + dz * dz < apart * apart:
                        return False
                    sphere = cells.after[sphere]
    return True
