"""Numbers and weights of pairs of points by their distance, from a cell list."""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran._base.kernels import kernel

#: cells of the list per reach
CELLS = 3


class PairSums(NamedTuple):
    """Sums over ordered pairs (i, j) of points with weights w, by distance, each (bins,).

    ``q_i`` is the sum of ``w_i * w_j`` over the points j at a distance in the bin.
    """

    pairs: Floats  # number of pairs
    weight: Floats  # sum of w_i * w_j
    own: Floats  # sum of (w_i * w_j)**2
    squares: Floats  # sum of q_i**2 over the points
    cross: Floats  # sum of q_i * w_i * (the sum of all other weights) over the points


def pair_sums(
    points: Floats, weights: Floats, step: float, bins: int, *, edges: Floats, periodic: Booleans
) -> PairSums:
    """Return sums over the pairs of points (n, 3) with weights (n,), by distance.

    Bin 0 reaches from 0 to half a `step`, bin k > 0 from ``(k - 0.5) * step`` to ``(k + 0.5) * step``. Points are
    counted with their nearest images on periodic axes, the periods of which are `edges` (3,), at least twice the end
    of the last bin.
    """
    found = PairSums(*np.zeros((5, bins)))
    if len(points) < 2:
        return found
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
    arguments = inside[order], weights[order], index[order], start, cells, around, wraps, 1.0 / step, reach
    _add_pairs(*arguments, float(weights.sum()), *found)
    return found


@kernel
def _add_pairs(
    points, weights, index, start, cells, around, wraps, scale, reach, whole, pairs, weight, own, squares, cross
):  # type: ignore[no-untyped-def]
    """Add the sums over all pairs; the arrays of :class:`PairSums` come last."""
    bins = len(pairs)
    many, row, row_squares = np.zeros(bins, np.int64), np.zeros(bins), np.zeros(bins)
    limit = reach * reach
    hx, hy, hz = 0.5 * wraps[0], 0.5 * wraps[1], 0.5 * wraps[2]
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        many[:], row[:], row_squares[:] = 0, 0.0, 0.0
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
                            k = int(np.sqrt(square) * scale + 0.5)
                            if k < bins:
                                many[k] += 1
                                row[k] += weights[j]
                                row_squares[k] += weights[j] * weights[j]
        w = weights[i]
        for k in range(bins):
            q = w * row[k]
            pairs[k] += many[k]
            weight[k] += q
            own[k] += w * w * row_squares[k]
            squares[k] += q * q
            cross[k] += q * w * (whole - w)
