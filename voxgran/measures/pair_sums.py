"""Numbers and weights of pairs of points by their distance, from a cell list."""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran.geometry.periods import along_edges, face_distances, wrapped

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


def pair_sums(points: Floats, weights: Floats, step: float, bins: int, *, periods: Floats) -> PairSums:
    """Return sums over the pairs of points (n, 3) with weights (n,), by distance.

    Bin 0 reaches from 0 to half a `step`, bin k > 0 from ``(k - 0.5) * step`` to ``(k + 0.5) * step``. Points are
    counted with their nearest images, by the (3, 3) periods of the container, whose faces are at least twice the end of
    the last bin apart.
    """
    sums = np.zeros((5, bins))
    if len(points) < 2:
        return PairSums(*sums)
    reach = (bins - 0.5) * step
    low, periodic = points.min(axis=0), periods.diagonal() > 0.0
    extent = np.ptp(points, axis=0)
    span = np.where(periodic, periods.diagonal(), np.maximum(extent, reach))
    inside = wrapped(points, low, periods) - low
    wide = periodic | (extent > 0)
    across = np.where(periodic, face_distances(periods), span)
    cells = np.where(wide, np.maximum(across * CELLS / reach, 1.0), 1.0)
    # a few cells per point, at most
    most = 8 * len(points)
    cells = np.maximum(cells / max(1.0, float(np.prod(cells)) / most) ** (1 / max(int(wide.sum()), 1)), 1.0)
    cells = np.minimum(cells, most).astype(np.int64)
    # an open axis may end below the corner of a tilted cell by rounding only
    index = np.clip((along_edges(inside, periods) / span * cells).astype(np.int64), 0, cells - 1)
    around = np.minimum(np.ceil(reach / across * cells).astype(np.int64), cells)
    flat = (index[:, 0] * cells[1] + index[:, 1]) * cells[2] + index[:, 2]
    order = np.argsort(flat, kind="stable")
    start = np.searchsorted(flat[order], np.arange(int(np.prod(cells)) + 1))
    packed = np.column_stack([inside, weights])[order]
    _add_pairs(packed, index[order], start, cells, around, periods, 1.0 / step, reach, float(weights.sum()), sums)
    return PairSums(*sums)


@kernel
def _add_pairs(packed, index, start, cells, around, p, scale, reach, whole, sums):  # type: ignore[no-untyped-def]
    """Add the sums over all pairs, rows of `sums` in the order of :class:`PairSums`."""
    bins = sums.shape[1]
    many, row, row_squares = np.zeros(bins, np.int64), np.zeros(bins), np.zeros(bins)
    limit = reach * reach
    first, last = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for i in range(len(packed)):
        x, y, z, w = packed[i, 0], packed[i, 1], packed[i, 2], packed[i, 3]
        many[:], row[:], row_squares[:] = 0, 0.0, 0.0
        for a in range(3):
            first[a], last[a] = index[i, a] - around[a], index[i, a] + around[a] + 1
            if p[a, a] == 0.0:
                first[a], last[a] = max(first[a], 0), min(last[a], cells[a])
        for cx in range(first[0], last[0]):
            for cy in range(first[1], last[1]):
                column = ((cx % cells[0]) * cells[1] + cy % cells[1]) * cells[2]
                for cz in range(first[2], last[2]):
                    cell, a, b, c = column + cz % cells[2], cx // cells[0], cy // cells[1], cz // cells[2]
                    px = x - (a * p[0, 0] + b * p[1, 0] + c * p[2, 0])
                    py, pz = y - (b * p[1, 1] + c * p[2, 1]), z - c * p[2, 2]
                    for j in range(start[cell], start[cell + 1]):
                        dx, dy, dz = packed[j, 0] - px, packed[j, 1] - py, packed[j, 2] - pz
                        square = dx * dx + dy * dy + dz * dz
                        if square < limit and j != i:
                            k = int(np.sqrt(square) * scale + 0.5)
                            if k < bins:
                                many[k] += 1
                                row[k] += packed[j, 3]
                                row_squares[k] += packed[j, 3] * packed[j, 3]
        for k in range(bins):
            q = w * row[k]
            sums[0, k] += many[k]
            sums[1, k] += q
            sums[2, k] += w * w * row_squares[k]
            sums[3, k] += q * q
            sums[4, k] += q * w * (whole - w)
