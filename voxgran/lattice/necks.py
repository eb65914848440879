"""Basins of a distance map, the necks between them, and which of them are one grain.

Each maximum of the distance to the void has a basin (watershed). Basins are merged from the widest neck on, as long as
the neck is hardly narrower than the smaller of the two. Where the decrease is a length, these are the markers by
h-maxima of the distance (Soille 2004, Morphological image analysis, doi:10.1007/978-3-662-05088-0), at the cost of one
watershed for all of them. Otherwise two numbers decide: the ratio of the neck to the smaller part, and the excess, by
which the ellipsoid with the moments of the union is larger than the ellipsoids of the parts. Every neck is known in
the end.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel

#: by how much an excess of one reduces the score of two parts
BENT = 0.15
#: logistic regressions of what is wrong in images of known grains (spheres, ellipsoids, polyhedra, rocks): weights of
#: the ratio, of the excess, of the size of both parts together, and 1
PARTED, JOINED = (12.7, -1.86, -2.6, -10.1), (-28.3, 4.54, 1.46, 23.5)
#: least spread of sizes, range of the relative sizes, and grains by which sizes count half
SPREAD, SIZES, FEW = 0.6, (-1.5, 3.0), 10


@dataclass(frozen=True, slots=True)
class Pairs:
    """Pairs of labels that have faces in common, and the largest distance to the void on those faces."""

    one: Integers  # (n,), the smaller label
    other: Integers  # (n,)
    neck: Floats  # (n,), or (n, 2) as `peak` of basins


@dataclass(frozen=True, slots=True)
class Basins:
    """Basins 1 ... n; entry 0 is the void."""

    peak: Floats  # (n + 1, 2), largest distance to the void; the second one has that within the border planes, too
    moments: Integers  # (n + 1, 10), numbers of voxels, sums of their indices x, y, z and of xx, yy, zz, xy, xz, yz
    pairs: Pairs

    def joined(self, root: Integers) -> "Basins":
        """Return the basins of which each has what the basins have that belong to it, without pairs."""
        peak, moments = np.zeros_like(self.peak), np.zeros_like(self.moments)
        np.maximum.at(peak, root, self.peak)
        np.add.at(moments, root, self.moments)
        none = np.zeros(0, dtype=np.int64)
        return Basins(peak, moments, Pairs(none, none, np.zeros((0, 2))))

    def alike(self, pairs: Pairs) -> tuple[Floats, Floats]:
        """Return ratio and excess (n,) of the basins of each pair."""
        smaller = np.minimum(self.peak[pairs.one], self.peak[pairs.other])
        return (pairs.neck / smaller).mean(axis=1), _excess(self.moments[pairs.one], self.moments[pairs.other])


def score(ratio: Any, excess: Any) -> Any:
    """Return how much two parts are like one grain: 1 if nothing parts them, less the narrower and the more bent."""
    return ratio - BENT * excess


def relative_sizes(volumes: Floats, among: Floats) -> Floats:
    """Return how large volumes, (n,), are among those of all grains, (m,): 0 for the median, 1 for one spread above.

    The spread of the logarithms is that of the middle half, as of a normal distribution. Few grains tell little of it.
    """
    if not len(among):
        return np.zeros(len(volumes))
    low, middle, high = np.quantile(libm.log(among), (0.25, 0.5, 0.75))
    size = (libm.log(volumes) - middle) / max((high - low) / 1.349, SPREAD)
    return np.asarray(np.clip(size, *SIZES) * len(among) / (len(among) + FEW))


def doubt(ratio: Floats, excess: Floats, size: Floats, within: Any) -> Floats:
    """Return the probability, (n,), that two parts were parted, or joined where `within`, wrongly."""
    terms = np.stack([ratio, excess, size, np.ones(len(ratio))], axis=1)
    odds = np.where(within, linear.matmul(terms, np.array(JOINED)), linear.matmul(terms, np.array(PARTED)))
    return np.asarray(1.0 / (1.0 + libm.exp(-np.clip(odds, -50.0, 50.0))))


def _excess(one: Integers, other: Integers) -> Floats:
    """Return by how much the ellipsoid of the union is larger than the ellipsoids of the parts, over the smaller one.

    Each ellipsoid has the second moments, (n, 10), of its part; whole parts of a convex body have about none.
    """
    both, first, second = (_ellipsoids(each) for each in (one + other, one, other))
    return (both - first - second) / np.minimum(first, second)


def _ellipsoids(moments: Integers) -> Floats:
    """Return volumes, but for a factor that all have in common, of the ellipsoids with some moments (n, 10)."""
    sums = moments.T.astype(np.float64)
    x, y, z, xx, yy, zz, xy, xz, yz = sums[1:] / sums[0]
    # a voxel is a cube, not a point
    xx, yy, zz = xx - x * x + 1 / 12, yy - y * y + 1 / 12, zz - z * z + 1 / 12
    xy, xz, yz = xy - x * y, xz - x * z, yz - y * z
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    return np.asarray(np.sqrt(np.maximum(determinant, 12.0**-3)))


def tally(
    labels: NDArray[np.int32], distance: NDArray[np.float32], start: Integers, count: int
) -> tuple[Integers, Floats]:
    """Return moments (count + 1, 10) and largest distances (count + 1,) of labels; `start` is the first voxel."""
    found: tuple[Integers, Floats] = _tally(np.ascontiguousarray(labels), np.ascontiguousarray(distance), start, count)
    return found


@kernel
def _tally(labels, distance, start, n):  # type: ignore[no-untyped-def]
    """Return moments and largest distances of labels; those of label 0 are 0."""
    moments, peak = np.zeros((n + 1, 10), dtype=np.int64), np.zeros(n + 1)
    nx, ny, nz = labels.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                label = labels[i, j, k]
                if label > 0:
                    x, y, z = start[0] + i, start[1] + j, start[2] + k
                    for place, term in enumerate((1, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z)):
                        moments[label, place] += term
                    peak[label] = max(peak[label], distance[i, j, k])
    return moments, peak


def basins_from(
    peak: Floats, moments: Integers, pairs: Pairs, planes: Iterable[tuple[NDArray[np.int32], NDArray[np.float32]]]
) -> Basins:
    """Return basins by their largest distances (n + 1,), moments, pairs with necks (n,), and the planes of the border.

    What the border cuts is no narrower than its section there, whose distances to the void within the plane count.
    """
    wide, ones, others = peak.copy(), [pairs.one], [pairs.other]
    necks = [np.stack([pairs.neck, pairs.neck], axis=1)]
    for labels, distance in planes:
        np.maximum.at(wide, labels.ravel(), distance.ravel())
        found = pairs_of(labels, distance)
        ones.append(found.one)
        others.append(found.other)
        necks.append(np.stack([np.zeros(len(found.one)), found.neck], axis=1))
    wide[0] = 0.0
    every = widest(np.concatenate(ones), np.concatenate(others), np.concatenate(necks))
    return Basins(np.stack([peak, wide], axis=1), moments, every)


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


def touching(labels: NDArray[np.integer[Any]], periodic: Sequence[bool], *, faces: int) -> Integers:
    """Return with how many others each label 0 ... n of an image has so many faces of voxels in common or more."""
    n, keys = int(labels.max(initial=0)) + 1, []
    for axis in range(3):
        lines = np.moveaxis(labels, axis, 0)
        ahead, behind = (np.roll(lines, -1, axis=0), lines) if periodic[axis] else (lines[1:], lines[:-1])
        apart = (ahead != behind) & (ahead > 0) & (behind > 0)
        pair = np.sort(np.stack([ahead[apart], behind[apart]]).astype(np.int64), axis=0)
        keys.append(pair[0] * n + pair[1])
    found, shared = np.unique(np.concatenate(keys), return_counts=True)
    return np.bincount(np.concatenate(np.divmod(found[shared >= faces], n)), minlength=n)


def widest(one: Integers, other: Integers, neck: Floats) -> Pairs:
    """Return each pair once, with its widest neck, (n,) or (n, 2)."""
    low, high = np.minimum(one, other), np.maximum(one, other)
    order = np.lexsort((high, low))
    low, high = low[order], high[order]
    first = np.ones(len(low), dtype=bool)
    first[1:] = (low[1:] != low[:-1]) | (high[1:] != high[:-1])
    if len(low):
        neck = np.maximum.reduceat(neck[order], np.flatnonzero(first))
    return Pairs(low[first], high[first], neck)


def merged(basins: Basins, *, decrease: float | None, share: float) -> tuple[Integers, Pairs, Floats, Floats]:
    """Merge basins across their necks in decreasing width.

    Two of them are merged if the neck is narrower than the smaller one by less than `decrease` or, if that is None, if
    their score is above `share`. Returned are the basin that each belongs to (n + 1,), the necks that were merged,
    between the basins that they then joined, and ratio and excess of each such neck.
    """
    pairs, root, tops = basins.pairs, list(range(len(basins.peak))), basins.peak.tolist()
    moments, joined, found = basins.moments.copy(), [], []

    def top(basin: int) -> int:
        while root[basin] != basin:
            root[basin] = root[root[basin]]
            basin = root[basin]
        return basin

    order = np.argsort(-pairs.neck[:, 0], kind="stable")
    rows = zip(order.tolist(), pairs.one[order].tolist(), pairs.other[order].tolist(), strict=True)
    for (k, one, other), (neck, wide) in zip(rows, pairs.neck[order].tolist(), strict=True):
        low, high = sorted((top(one), top(other)), key=lambda basin: tops[basin][0])
        ratio = 0.5 * (neck / tops[low][0] + wide / min(tops[low][1], tops[high][1]))
        # the ellipsoid of both is hardly smaller than that of the larger part: the excess is at least about -1
        near = tops[low][0] - neck < decrease if decrease is not None else ratio > share - BENT
        if low == high or not near:
            continue
        excess = float(_excess(moments[low : low + 1], moments[high : high + 1])[0])
        if decrease is None and not score(ratio, excess) > share:
            continue
        root[low], tops[high] = high, [max(each) for each in zip(tops[low], tops[high], strict=True)]
        moments[high] += moments[low]
        joined.append(k)
        found.append((ratio, excess))
    some, terms = np.array(joined, dtype=np.int64), np.array(found).reshape(-1, 2)
    belongs = np.array([top(k) for k in range(len(root))], dtype=np.int64)
    return belongs, Pairs(pairs.one[some], pairs.other[some], pairs.neck[some]), terms[:, 0], terms[:, 1]
