"""Hierarchical grid of linked cells, for neighbour searches among grains of any size ratio.

Grains of similar size share a level, and each level has cells of its own that are about as wide as its largest grain,
so that a query visits few cells of each level. A query walks over the cells of `cells_near`, and in each from the grain
of `first_in_cell` on along `after`.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.periods import slopes_of

#: half edges of a region along the axes
Reach: TypeAlias = tuple[float, float, float]
#: largest number of cells per grain of a level
SPARE = 2


class LevelGrid(NamedTuple):
    """Cells of all levels, level by level, for positions from the lower corner of the container.

    Linked positions lie in the cell of the container, whose edges may be tilted; other positions lie anywhere.

    span: lengths of the periodic axes, 0 of others.  periods, slopes: the vectors by which the container repeats and
    what leads to coordinates along them (:mod:`voxgran.geometry.periods`).  reach: (k, 3) largest half extents of each
    level.  width, count: (k, 3) edges and numbers of the cells.  wraps: (k, 3), 1 where the cells repeat along an axis:
    as images of a periodic axis, or on others to limit their number; distant grains then share a cell.  first: first
    cell of each level in `head`.  filled: number of linked grains of each level.  head: the grain linked last in each
    cell; after: the grain linked before each (-1: none).
    """

    span: Floats
    periods: Floats
    slopes: Floats
    reach: Floats
    width: Floats
    count: Integers  # type: ignore[assignment]
    wraps: Integers
    first: Integers
    filled: Integers
    head: NDArray[np.int32]
    after: NDArray[np.int32]


def empty_grid(
    periods: Floats, reach: Floats, width: Floats, count: Integers, wraps: Integers, grains: int
) -> LevelGrid:
    """Return a grid for so many grains, none of which is linked, by the (3, 3) periods of the container."""
    along = periods.diagonal().copy(), periods, slopes_of(periods)
    first = np.concatenate([[0], np.cumsum(count.prod(axis=1))]).astype(np.int64)
    # untouched zeros take no memory until grains are linked
    links = np.full(int(first[-1]), -1, dtype=np.int32), np.zeros(grains, dtype=np.int32)
    return LevelGrid(*along, reach, width, count, wraps, first[:-1], np.zeros(len(count), dtype=np.int64), *links)


def level_cells(lengths: Floats, periods: Floats, reach: Floats, dimension: int) -> tuple[LevelGrid, Integers]:
    """Return empty cells for spheres of half ranges `reach`, (n,), and the level of each; level 0 has the largest.

    lengths: of the bounds of the container.  periods: (3, 3) vectors by which it repeats.
    """
    level = np.floor(libm.log2(reach.max() / reach)).astype(np.int64)
    used, level, number = np.unique(level, return_inverse=True, return_counts=True)
    largest = np.array([reach[level == k].max() for k in range(len(used))])
    rows = np.ascontiguousarray(np.tile(largest[:, None], (1, 3)))
    return cells_of(lengths, periods, rows, number, dimension), level.astype(np.int64)


def cells_of(lengths: Floats, periods: Floats, reach: Floats, number: Integers, dimension: int) -> LevelGrid:
    """Return empty cells of levels of the largest half ranges `reach`, (k, 3), and of so many grains each, (k,).

    lengths: of the bounds of the container.  periods: (3, 3) vectors by which it repeats.
    """
    axes = np.arange(3) < dimension
    span, wide = np.where(axes, lengths, 1.0), np.where(axes & (reach > 0.0), reach, np.inf)
    full = np.maximum(np.floor(span / (2 * wide)), 1)
    # about as many cells as grains, of one shape
    share = np.minimum(1.0, libm.power(SPARE * number / full.prod(axis=1), 1.0 / dimension))
    count = np.where(axes, np.maximum(np.floor(full * share[:, None]), 1), 1).astype(np.int64)
    wraps = np.tile(periods.diagonal() > 0.0, (len(number), 1)).astype(np.int64)
    return empty_grid(periods, reach, np.ascontiguousarray(span / count), count, wraps, int(number.sum()))


@inlined_kernel
def link_at(cells: LevelGrid, grain: int, level: int, x: float, y: float, z: float) -> None:
    """Link a grain at (x, y, z) into its cell."""
    cell = _cell_at(cells, level, x, y, z)
    cells.after[grain] = cells.head[cell]
    cells.head[cell] = grain
    cells.filled[level] += 1


@inlined_kernel
def unlink_at(cells: LevelGrid, grain: int, level: int, x: float, y: float, z: float) -> None:
    """Remove the grain that was linked last."""
    cells.head[_cell_at(cells, level, x, y, z)] = cells.after[grain]
    cells.filled[level] -= 1


@inlined_kernel
def _cell_at(cells, level, x, y, z):  # type: ignore[no-untyped-def]
    """Return the cell of a position."""
    x, y = x + cells.slopes[0] * y + cells.slopes[1] * z, y + cells.slopes[2] * z
    i, j, k = _index_at(cells, level, 0, x), _index_at(cells, level, 1, y), _index_at(cells, level, 2, z)
    return cells.first[level] + (i * cells.count[level, 1] + j) * cells.count[level, 2] + k


@inlined_kernel
def _index_at(cells, level, axis, x):  # type: ignore[no-untyped-def]
    """Return the index of a cell along an axis."""
    count = cells.count[level, axis]
    index = math.floor(x / cells.width[level, axis])
    if cells.wraps[level, axis] and cells.span[axis] == 0.0:
        index -= index // count * count
    # rounding may move a grain on a face beyond the last cell
    return min(max(index, 0), count - 1)


@inlined_kernel
def cells_near(
    cells: LevelGrid, level: int, x: float, y: float, z: float, reach: Reach
) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
    """Return the first cell within reach (along each axis) of a position, and the one after the last.

    They may lie beyond the ends of axes along which the cells repeat.
    """
    u, v, w = cells.slopes[0], cells.slopes[1], cells.slopes[2]
    x, y = x + u * y + v * z, y + w * z
    reach = reach[0] + abs(u) * reach[1] + abs(v) * reach[2], reach[1] + abs(w) * reach[2], reach[2]
    i0, i1 = _cells_along(cells, level, 0, x, reach[0])
    j0, j1 = _cells_along(cells, level, 1, y, reach[1])
    k0, k1 = _cells_along(cells, level, 2, z, reach[2])
    return (i0, j0, k0), (i1 + 1, j1 + 1, k1 + 1)


@inlined_kernel
def first_in_cell(cells: LevelGrid, level: int, i: int, j: int, k: int) -> tuple[int, int, int, int]:
    """Return the grain linked last in a cell (-1: none), and how many periods along each axis the cell lies beyond."""
    ni, nj, nk = cells.count[level, 0], cells.count[level, 1], cells.count[level, 2]
    ti = 0 if 0 <= i < ni else i // ni
    tj = 0 if 0 <= j < nj else j // nj
    tk = 0 if 0 <= k < nk else k // nk
    return cells.head[cells.first[level] + ((i - ti * ni) * nj + j - tj * nj) * nk + k - tk * nk], ti, tj, tk


@inlined_kernel
def turns_at(cells: LevelGrid, x: float, y: float, z: float) -> tuple[int, int, int]:
    """Return by how many periods along each axis a position lies beyond the cell of the container."""
    span = cells.span
    x, y = x + cells.slopes[0] * y + cells.slopes[1] * z, y + cells.slopes[2] * z
    return (
        math.floor(x / span[0]) if span[0] > 0.0 else 0,
        math.floor(y / span[1]) if span[1] > 0.0 else 0,
        math.floor(z / span[2]) if span[2] > 0.0 else 0,
    )


@inlined_kernel
def image_shift(cells: LevelGrid, ti: int, tj: int, tk: int) -> tuple[float, float, float]:
    """Return the vector of so many periods along each axis."""
    p = cells.periods
    return ti * p[0, 0] + tj * p[1, 0] + tk * p[2, 0], tj * p[1, 1] + tk * p[2, 1], tk * p[2, 2]


@inlined_kernel
def _cells_along(cells, level, axis, x, reach):  # type: ignore[no-untyped-def]
    """Return the first and the last cell within reach along an axis."""
    width, count = cells.width[level, axis], cells.count[level, axis]
    low, high = math.floor((x - reach) / width), math.floor((x + reach) / width)
    if not cells.wraps[level, axis]:
        return min(max(low, 0), count - 1), min(max(high, 0), count - 1)
    if cells.span[axis] == 0.0 and high - low >= count:
        return 0, count - 1
    return low, high


@bare_kernel
def is_free(cells: LevelGrid, spheres: Floats, x: float, y: float, z: float, r: float, slack: float) -> bool:
    """Return whether a sphere would overlap none of those that are linked by more than the slack.

    spheres: (n, 4) centers from the lower corner of the container, and radii.
    """
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
                sx, sy, sz = image_shift(cells, ti, tj, tk)
                px, py, pz = x - sx, y - sy, z - sz
                while sphere >= 0:
                    dx, dy, dz = px - spheres[sphere, 0], py - spheres[sphere, 1], pz - spheres[sphere, 2]
                    apart = r + spheres[sphere, 3] - slack
                    if dx * dx + dy * dy + dz * dz < apart * apart:
                        return False
                    sphere = cells.after[sphere]
    return True
