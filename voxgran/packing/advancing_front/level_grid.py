"""Hierarchical grid of linked cells for the spheres of a front: whether a position is free, and which spheres are near.

Spheres of similar radius (within a factor of two) share a level, and each level has cells of its own width, so that a
thousandfold range of sizes takes a few levels only.

Random sequential addition has a grid of its own (:mod:`voxgran.packing.rsa.level_grid`): here centers and radii are
rows of one array, spheres are removed again, images are counted, and cells may be shared by distant spheres, which the
queries of the front need for their speed.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel

#: indices of spheres, in half the bytes
Links: TypeAlias = NDArray[np.int32]
#: a sphere and its periodic image as one number: the index of the sphere times 2 ** BITS, plus the image
BITS = 5
IMAGES = 2**BITS
#: the image without a shift; image i is shifted by i % 3 - 1, i // 3 % 3 - 1 and i // 9 - 1 lengths
HERE = 13
#: largest number of cells per sphere
SPARE = 2


class SphereCells(NamedTuple):
    """Linked cells of spheres, level by level.

    span: (3,) lengths of the periodic axes, 0 of others.  largest: radius of the largest sphere of each level, falling.
    width, count: (k, 3) edges and numbers of the cells.  wraps: (k, 3), 1 where the cells repeat along an axis: as
    images of a periodic axis, or on others to limit their number; distant spheres then share a cell.  first: first cell
    of each level in `head`.  head: the last sphere of each cell; after: the sphere before each (-1: none).
    """

    span: Floats
    largest: Floats
    width: Floats
    count: Integers  # type: ignore[assignment]
    wraps: Integers
    first: Integers
    head: Links
    after: Links


def lay_cells(lengths: Floats, periodic: Integers, radii: Floats, dimension: int) -> SphereCells:
    """Return empty cells for spheres.

    Parameters
    ----------
    lengths : (3,) ndarray of float
        Lengths of the box of all centers, from its lower corner.
    periodic : (3,) ndarray of int
        Which axes are periodic, as 0 or 1.
    radii : (n,) ndarray of float
        Radii of all spheres.
    dimension : int
        2 or 3.

    Returns
    -------
    SphereCells
    """
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
    full = np.where(periodic == 1, count, full)
    cells = np.concatenate([[0], np.cumsum(count.prod(axis=1))]).astype(np.int64)
    wraps = ((count < full) | (periodic == 1)).astype(np.int64)
    widths = np.ascontiguousarray(span / full, dtype=np.float64)
    head, after = (np.full(many, -1, dtype=np.int32) for many in (int(cells[-1]), len(radii)))
    return SphereCells(span * periodic, largest, widths, count, wraps, cells[:-1], head, after)


def _fewer(count: Integers, most: int) -> Integers:
    """Return numbers of cells whose product is at most `most`, the same along all axes that are reduced."""
    side = 1
    while side < count.max() and np.minimum(count, side + 1).prod() <= most:
        side += 1
    return np.minimum(count, side)


@bare_kernel
def level_of(cells: SphereCells, r: float) -> int:
    """Return the level of a radius."""
    level = 0
    while level + 1 < len(cells.largest) and r <= cells.largest[level + 1]:
        level += 1
    return level


@bare_kernel
def _cell_of(cells: SphereCells, spheres: Floats, sphere: int) -> int:
    """Return the cell of a sphere."""
    level = level_of(cells, spheres[sphere, 3])
    flat = 0
    for axis in range(3):
        count = cells.count[level, axis]
        at = math.floor(spheres[sphere, axis] / cells.width[level, axis])
        if cells.wraps[level, axis] and cells.span[axis] == 0.0:
            at -= at // count * count
        # rounding may move a sphere on a face beyond the last cell
        flat = flat * count + min(max(at, 0), count - 1)
    return cells.first[level] + flat


@bare_kernel
def link(cells: SphereCells, spheres: Floats, sphere: int) -> None:
    """Enter a sphere."""
    cell = _cell_of(cells, spheres, sphere)
    cells.after[sphere] = cells.head[cell]
    cells.head[cell] = sphere


@bare_kernel
def unlink(cells: SphereCells, spheres: Floats, sphere: int) -> None:
    """Remove the sphere that was linked last."""
    cells.head[_cell_of(cells, spheres, sphere)] = cells.after[sphere]


@bare_kernel
def link_all(cells: SphereCells, spheres: Floats, many: int) -> None:
    """Link the first spheres, in their order."""
    for sphere in range(many):
        link(cells, spheres, sphere)


@bare_kernel
def cell_range(cells: SphereCells, level: int, axis: int, at: float, reach: float) -> tuple[int, int]:
    """Return the first and the last cell within reach along an axis; they may lie beyond the ends if cells repeat."""
    width, count = cells.width[level, axis], cells.count[level, axis]
    low, high = math.floor((at - reach) / width), math.floor((at + reach) / width)
    if not cells.wraps[level, axis]:
        return min(max(low, 0), count - 1), min(max(high, 0), count - 1)
    if cells.span[axis] == 0.0 and high - low >= count:
        return 0, count - 1
    return low, high


@bare_kernel
def is_free(cells: SphereCells, spheres: Floats, x: float, y: float, z: float, r: float, slack: float) -> bool:
    """Return whether a sphere would overlap no other by more than the slack."""
    for level in range(len(cells.largest)):
        if not _is_free_within(cells, spheres, level, x, y, z, r, slack, r + cells.largest[level]):
            return False
    return True


@bare_kernel
def _is_free_within(cells, spheres, level, x, y, z, r, slack, reach):  # type: ignore[no-untyped-def]
    """Return whether a sphere would overlap none of a level, in the cells within reach."""
    i0, i1 = cell_range(cells, level, 0, x, reach)
    j0, j1 = cell_range(cells, level, 1, y, reach)
    k0, k1 = cell_range(cells, level, 2, z, reach)
    ni, nj, nk = cells.count[level, 0], cells.count[level, 1], cells.count[level, 2]
    for i in range(i0, i1 + 1):
        turn_i = 0 if 0 <= i < ni else i // ni
        px = x - turn_i * cells.span[0]
        row_i = (i - turn_i * ni) * nj
        for j in range(j0, j1 + 1):
            turn_j = 0 if 0 <= j < nj else j // nj
            py = y - turn_j * cells.span[1]
            row = cells.first[level] + (row_i + j - turn_j * nj) * nk
            for k in range(k0, k1 + 1):
                turn_k = 0 if 0 <= k < nk else k // nk
                pz = z - turn_k * cells.span[2]
                sphere = cells.head[row + k - turn_k * nk]
                while sphere >= 0:
                    dx, dy, dz = px - spheres[sphere, 0], py - spheres[sphere, 1], pz - spheres[sphere, 2]
                    apart = r + spheres[sphere, 3] - slack
                    if dx * dx + dy * dy + dz * dz < apart * apart:
                        return False
                    sphere = cells.after[sphere]
    return True
