"""Balls in cells by size: is a place free, and what is near it.

Balls of alike radius (within a factor of two) share a level, and each level has cells of its own width, so that a
thousandfold range of sizes costs no more than some levels.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel

#: balls by number, in half the bytes
Links: TypeAlias = NDArray[np.int32]
#: a ball and the image in which it is meant, as one number: the ball times 2 ** BITS, plus the image
BITS = 5
IMAGES = 2**BITS
#: the image without a shift; image i is shifted by i % 3 - 1, i // 3 % 3 - 1 and i // 9 - 1 lengths
HERE = 13
#: width of a cell, in diameters of the largest ball of its level
WIDTH = 1.0


class BallCells(NamedTuple):
    """Linked cells of balls, level by level.

    largest: radius of the largest ball of each level, falling.  width: (k, 3) of the cells.  count: (k, 3) of them.
    first: of each level in `head`.  head: the last ball of each cell; after: the ball before each (-1: none).
    """

    largest: Floats
    width: Floats
    count: Integers  # type: ignore[assignment]
    first: Integers
    head: Links
    after: Links


def lay_cells(lengths: Floats, radii: Floats, dimension: int) -> BallCells:
    """Return empty cells for balls.

    Parameters
    ----------
    lengths : (3,) ndarray of float
        Of the box that holds all centers, from its lower corner; periodic axes are whole.
    radii : (n,) ndarray of float
        Of all balls that may come.
    dimension : int
        2 or 3.

    Returns
    -------
    BallCells
    """
    top = float(radii.max(initial=1e-300))
    level = np.floor(np.log2(top / np.maximum(radii, 1e-300))).astype(np.int64)
    used, number = np.unique(level, return_counts=True)
    largest = np.array([radii[level == k].max() for k in used]) if len(used) else np.ones(1)
    number = number if len(used) else np.ones(1, dtype=np.int64)
    volume = float(np.prod(lengths[:dimension]))
    # no more cells than balls
    width = np.maximum(2 * WIDTH * largest, (volume / number) ** (1 / dimension))
    count = np.maximum(np.floor(lengths / width[:, None]), 1).astype(np.int64)
    count[:, dimension:] = 1
    cells = np.concatenate([[0], np.cumsum(count.prod(axis=1))]).astype(np.int64)
    span = np.where(np.arange(3) < dimension, lengths, 1.0)
    return BallCells(
        *(largest, np.ascontiguousarray(span / count), count, cells[:-1]),
        *(np.full(int(cells[-1]), -1, dtype=np.int32), np.full(len(radii), -1, dtype=np.int32)),
    )


@bare_kernel
def level_of(cells: BallCells, r: float) -> int:
    """Return the level that a radius belongs to."""
    level = 0
    while level + 1 < len(cells.largest) and r <= cells.largest[level + 1]:
        level += 1
    return level


@bare_kernel
def _cell_of(cells: BallCells, balls: Floats, ball: int) -> int:
    """Return the cell that a ball lies in."""
    level = level_of(cells, balls[ball, 3])
    flat = 0
    for axis in range(3):
        count = cells.count[level, axis]
        at = math.floor(balls[ball, axis] / cells.width[level, axis])
        flat = flat * count + min(max(at, 0), count - 1)
    return cells.first[level] + flat


@bare_kernel
def link(cells: BallCells, balls: Floats, ball: int) -> None:
    """Enter a ball."""
    cell = _cell_of(cells, balls, ball)
    cells.after[ball] = cells.head[cell]
    cells.head[cell] = ball


@bare_kernel
def unlink(cells: BallCells, balls: Floats, ball: int) -> None:
    """Take out the ball that was entered last."""
    cells.head[_cell_of(cells, balls, ball)] = cells.after[ball]


@bare_kernel
def link_all(cells: BallCells, balls: Floats, many: int) -> None:
    """Enter the first balls, in their order."""
    for ball in range(many):
        link(cells, balls, ball)


@bare_kernel
def cell_range(cells: BallCells, level: int, axis: int, at: float, reach: float, periodic: int) -> tuple[int, int]:
    """Return the first and the last cell within reach along an axis; on periodic ones they may lie beyond the ends."""
    width, count = cells.width[level, axis], cells.count[level, axis]
    low, high = math.floor((at - reach) / width), math.floor((at + reach) / width)
    if periodic:
        return low, high
    return min(max(low, 0), count - 1), min(max(high, 0), count - 1)


@bare_kernel
def is_free(
    cells: BallCells,
    balls: Floats,
    lengths: Floats,
    periodic: Integers,
    x: float,
    y: float,
    z: float,
    r: float,
    slack: float,
) -> bool:
    """Tell whether a ball would overlap none by more than the slack."""
    for level in range(len(cells.largest)):
        reach = r + cells.largest[level]
        i0, i1 = cell_range(cells, level, 0, x, reach, periodic[0])
        j0, j1 = cell_range(cells, level, 1, y, reach, periodic[1])
        k0, k1 = cell_range(cells, level, 2, z, reach, periodic[2])
        ni, nj, nk = cells.count[level, 0], cells.count[level, 1], cells.count[level, 2]
        for i in range(i0, i1 + 1):
            turn_i = 0 if 0 <= i < ni else i // ni
            px = x - turn_i * lengths[0]
            row_i = (i - turn_i * ni) * nj
            for j in range(j0, j1 + 1):
                turn_j = 0 if 0 <= j < nj else j // nj
                py = y - turn_j * lengths[1]
                row = cells.first[level] + (row_i + j - turn_j * nj) * nk
                for k in range(k0, k1 + 1):
                    turn_k = 0 if 0 <= k < nk else k // nk
                    pz = z - turn_k * lengths[2]
                    ball = cells.head[row + k - turn_k * nk]
                    while ball >= 0:
                        dx, dy, dz = px - balls[ball, 0], py - balls[ball, 1], pz - balls[ball, 2]
                        apart = r + balls[ball, 3] - slack
                        if dx * dx + dy * dy + dz * dz < apart * apart:
                            return False
                        ball = cells.after[ball]
    return True
