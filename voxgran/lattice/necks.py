"""Basins of a distance map, the necks between them, and which of them are one grain.

Each maximum of the distance to the void has a basin (watershed). Basins are merged from the widest neck on, as long as
the neck is hardly narrower than the smaller of the two: the same as markers by h-maxima, of the distance where the
decrease is a length, of its logarithm where it is a share (Soille 2004, Morphological image analysis,
doi:10.1007/978-3-662-05088-0), and at the cost of one watershed for all of them. Every neck is known in the end.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers


@dataclass(frozen=True, slots=True)
class Pairs:
    """Pairs of labels that have faces in common, and the largest distance to the void on those faces."""

    one: Integers  # (n,), the smaller label
    other: Integers  # (n,)
    neck: Floats  # (n,)


def pairs_of(labels: NDArray[np.int32], distance: NDArray[np.float32]) -> Pairs:
    """Return the pairs of labels above 0 with faces in common; the distance of a face is the lesser of its voxels'."""
    ones, others, necks = [], [], []
    for axis in range(3):
        ahead, behind = np.moveaxis(labels, axis, 0)[:-1], np.moveaxis(labels, axis, 0)[1:]
        apart = (ahead != behind) & (ahead > 0) & (behind > 0)
        ones.append(np.minimum(ahead[apart], behind[apart]))
        others.append(np.maximum(ahead[apart], behind[apart]))
        near, far = np.moveaxis(distance, axis, 0)[:-1], np.moveaxis(distance, axis, 0)[1:]
        necks.append(np.minimum(near[apart], far[apart]))
    one, other = np.concatenate(ones).astype(np.int64), np.concatenate(others).astype(np.int64)
    return widest(one, other, np.concatenate(necks).astype(np.float64))


def widest(one: Integers, other: Integers, neck: Floats) -> Pairs:
    """Return each pair once, with its widest neck."""
    low, high = np.minimum(one, other), np.maximum(one, other)
    order = np.lexsort((-neck, high, low))
    low, high, neck = low[order], high[order], neck[order]
    first = np.ones(len(low), dtype=bool)
    first[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
    return Pairs(low[first], high[first], neck[first])


def merged(peaks: Floats, pairs: Pairs, *, decrease: float | None, share: float) -> tuple[Integers, Pairs, Floats]:
    """Merge basins (n,), given by the largest distance in each, across their necks in decreasing width.

    Two of them are merged if the neck is narrower than the smaller one by less than `decrease` or, if that is None, if
    it is above `share` of it. Returned are the basin that each belongs to (n,), the necks that were merged, between the
    basins that they then joined, and the ratio of each such neck to the smaller of the two.
    """
    root, tops, ratios = list(range(len(peaks))), peaks.tolist(), []

    def found(basin: int) -> int:
        while root[basin] != basin:
            root[basin] = root[root[basin]]
            basin = root[basin]
        return basin

    order = np.argsort(-pairs.neck, kind="stable")
    joined = []
    for k in order.tolist():
        one, other, neck = found(int(pairs.one[k])), found(int(pairs.other[k])), float(pairs.neck[k])
        if one == other:
            continue
        low, high = (one, other) if tops[one] < tops[other] else (other, one)
        if neck > share * tops[low] if decrease is None else tops[low] - neck < decrease:
            root[low] = high
            joined.append(k)
            ratios.append(neck / tops[low])
    some = np.array(joined, dtype=np.int64)
    basins = np.array([found(k) for k in range(len(root))], dtype=np.int64)
    return basins, Pairs(pairs.one[some], pairs.other[some], pairs.neck[some]), np.array(ratios)
