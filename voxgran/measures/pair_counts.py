"""Numbers of pairs of points by their distance, from a cell list."""

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel

#: cells of the list per reach
CELLS = 3


def pair_counts(
    points: Floats, step: float, bins: int, *, edges: Floats, periodic: Booleans
) -> tuple[Integers, Floats]:
    """Return the numbers of ordered pairs (bins,) by distance, and the sums (bins,) of their squares over the points.

    Bin 0 reaches from 0 to half a `step`, bin k > 0 from ``(k - 0.5) * step`` to ``(k + 0.5) * step``. Points (n, 3)
    are counted with their nearest images on periodic axes, the periods of which are `edges` (3,), at least twice the
    end of the last bin.
    """
    total, squares = np.zeros(bins, np.int64), np.zeros(bins)
    if len(points) < 2:
        return total, squares
    reach = (bins - 0.5) * step
    low = points.min(axis=0)
    extent = np.ptp(points, axis=0)
    span = np.where(periodic, edges, np.maximum(extent, reach))
    inside = np.where(periodic, (points - low) % span, points - low)
    # about as many cells as points, at most
    wide = periodic | (extent > 0)
    most = int(np.ceil(2 * len(points) ** (1 / max(int(wide.sum()), 1))))
    cells = np.where(wide, np.clip(np.floor(span * CELLS / reach), 1, most), 1).astype(np.int64)
    index = np.minimum((inside / span * cells).astype(np.int64), cells - 1)
    around = np.minimum(np.ceil(reach / span * cells).astype(np.int64), cells)
    flat = (index[:, 0] * cells[1] + index[:, 1]) * cells[2] + index[:, 2]
    order = np.argsort(flat, kind="stable")
    start = np.searchsorted(flat[order], np.arange(int(np.prod(cells)) + 1))
    wraps = np.where(periodic, span, 0.0)
    _count(inside[order], index[order], start, cells, around, wraps, 1.0 / step, reach, total, squares)
    return total, squares


@kernel
def _count(points, index, start, cells, around, wraps, scale, reach, total, squares):  # type: ignore[no-untyped-def]
    """Add the numbers of pairs, and their squares."""
    row = np.zeros(len(total), np.int64)
    limit = reach * reach
    hx, hy, hz = 0.5 * wraps[0], 0.5 * wraps[1], 0.5 * wraps[2]
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        row[:] = 0
        for a in range(3):
            first[a], last[a] = index[i, a] - around[a], index[i, a] + around[a] + 1
            if wraps[a] == 0.0:
                first[a], last[a] = max(first[a], 0), min(last[a], cells[a])
            elif last[a] - first[a] > cells[a]:
                first[a], last[a] = 0, cells[a]
        for cx in range(first[0], last[0]):
            for cy in range(first[1], last[1]):
                column = ((cx % cells[0]) * cells[1] + cy % cells[1]) * cells[2]
                for cz in range(first[2], last[2]):
                    cell = column + cz % cells[2]
                    for j in range(start[cell], start[cell + 1]):
                        dx, dy, dz = abs(points[j, 0] - x), abs(points[j, 1] - y), abs(points[j, 2] - z)
                        dx = wraps[0] - dx if wraps[0] > 0.0 and dx > hx else dx
                        dy = wraps[1] - dy if wraps[1] > 0.0 and dy > hy else dy
                        dz = wraps[2] - dz if wraps[2] > 0.0 and dz > hz else dz
                        square = dx * dx + dy * dy + dz * dz
                        if square < limit and j != i:
                            bin_ = int(np.sqrt(square) * scale + 0.5)
                            if bin_ < len(row):
                                row[bin_] += 1
        for k in range(len(row)):
            total[k] += row[k]
            squares[k] += float(row[k]) * row[k]
