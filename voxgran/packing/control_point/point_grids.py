"""Cells of point sets, and the question that is asked of them: which points of two sets are near each other?

Each set has its own lattice of cells in its own frame, one edge of a cell wide, with the points of each cell one after
another. The points of the other set are looked up one by one in the cells around them.
"""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.packing.control_point.point_trees import Trees, keep_near

#: cells along an axis, at most
MOST_CELLS = 64


class PointCells(NamedTuple):
    """Cells of the point sets of some trees.

    Attributes
    ----------
    lattice : (sets, 4) ndarray of float
        Lower corner of the cells and their edge.
    count : (sets, 3) ndarray of int
        Cells along each axis.
    first : (sets,) ndarray of int
        Where the cells of each set begin in `start`.
    start : (cells + sets,) ndarray of int
        Where the points of each cell begin in `order`; after the last cell of a set, where they end.
    order : (n,) ndarray of int
        Points, numbered as in the trees, cell by cell.
    """

    lattice: Floats
    count: Integers  # type: ignore[assignment]
    first: Integers
    start: Integers
    order: Integers


def make_cells(trees: Trees, width: Floats) -> PointCells:
    """Return the cells of the sets of trees, about as wide as asked for, (sets,).

    Parameters
    ----------
    trees : Trees
        The points.
    width : (sets,) ndarray of float
        Wanted edge of the cells of each set.
    """
    sets = len(trees.depth)
    lattice, count = np.zeros((sets, 4)), np.ones((sets, 3), dtype=np.int64)
    starts: list[Integers] = []
    orders: list[Integers] = []
    first = np.zeros(sets, dtype=np.int64)
    for k in range(sets):
        begin, end = trees.start[k], trees.start[k + 1]
        points = trees.points[begin:end]
        low, span = points.min(axis=0), np.ptp(points, axis=0)
        edge = max(float(width[k]), float(span.max()) / MOST_CELLS)
        count[k] = np.floor(span / edge).astype(np.int64) + 1
        number = int(count[k].prod())
        lattice[k] = [*low, edge]
        cell = np.ravel_multi_index(tuple(np.floor((points - low) / edge).astype(np.int64).T), tuple(count[k]))
        orders.append(begin + np.argsort(cell, kind="stable"))
        first[k] = sum(len(part) for part in starts)
        starts.append(begin + np.searchsorted(np.sort(cell), np.arange(number + 1)))
    return PointCells(
        lattice, count, first, np.concatenate(starts).astype(np.int64), np.concatenate(orders).astype(np.int64)
    )


def no_cells() -> PointCells:
    """Return cells of no sets."""
    none = np.zeros(0, dtype=np.int64)
    return PointCells(np.zeros((0, 4)), np.zeros((0, 3), dtype=np.int64), none, none, none)


@bare_kernel
def list_near_in_cells(
    trees: Trees,
    cells: PointCells,
    a: int,
    b: int,
    turn: Floats,
    shift: Floats,
    low: float,
    high: float,
    found: Integers,
) -> tuple[int, float]:
    """List the points of set a, put into the frame of set b, that are nearer than a distance to points of set b.

    As :func:`voxgran.packing.control_point.point_trees.list_near`, whose answers are the same.
    """
    points, counted = trees.points, 0
    corner, edge = cells.lattice[b], cells.lattice[b, 3]
    nx, ny, nz = cells.count[b, 0], cells.count[b, 1], cells.count[b, 2]
    for i in range(trees.start[a], trees.start[a + 1]):
        p, q, r = points[i, 0], points[i, 1], points[i, 2]
        x = turn[0, 0] * p + turn[0, 1] * q + turn[0, 2] * r + shift[0]
        y = turn[1, 0] * p + turn[1, 1] * q + turn[1, 2] * r + shift[1]
        z = turn[2, 0] * p + turn[2, 1] * q + turn[2, 2] * r + shift[2]
        ax, bx = _range(x, corner[0], edge, nx, high)
        ay, by = _range(y, corner[1], edge, ny, high)
        az, bz = _range(z, corner[2], edge, nz, high)
        for cx in range(ax, bx):
            for cy in range(ay, by):
                row = cells.first[b] + (cx * ny + cy) * nz
                for k in range(cells.start[row + az], cells.start[row + max(az, bz)]):
                    j = cells.order[k]
                    dx, dy, dz = x - points[j, 0], y - points[j, 1], z - points[j, 2]
                    square = dx * dx + dy * dy + dz * dz
                    if square < high * high:
                        if square < low * low:
                            found[0, 0], found[0, 1] = i, j
                            return -1, high
                        while counted == len(found):
                            high = low + 0.5 * (high - low)
                            counted = keep_near(points, turn, shift, high, found)
                        if square < high * high:
                            found[counted, 0], found[counted, 1] = i, j
                            counted += 1
    return counted, high


@bare_kernel
def _range(x, corner, edge, count, reach):  # type: ignore[no-untyped-def]
    """Return the first cell that a reach touches along an axis, and the one after the last."""
    room = reach * (1.0 + 1e-9)
    low, high = np.floor((x - room - corner) / edge), np.floor((x + room - corner) / edge)
    return np.int64(min(max(low, 0.0), count)), np.int64(min(max(high + 1.0, 0.0), count))
