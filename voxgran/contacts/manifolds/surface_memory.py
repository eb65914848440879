"""What the finders of contacts between surfaces remember of each pair: its pose, and what was near in it.

Between two looks at a pair no point of one surface moves, relative to the other, farther than `motion_since` states; so
long as this is less than what the list of near points or triangles allows, the list is complete.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.blocks import Blocks
from voxgran.contacts.manifolds.distance_grids import SurfaceBodies
from voxgran.contacts.manifolds.rows import ContactRows, Grains, Pair, PairList, write_contact
from voxgran.geometry.vectors import Vector, along, dot, rotate_back, row_of, sub, vector_at

#: points that are kept of a pair, and pairs of triangles
POINTS, NEAR = 128, 2048
#: entries of the pool of lists for each pair of grains at first
FIRST = 32
#: length of a list that found no room in the pool
LOST = -2
#: pairs of triangles of one pair of grains that are listed at once
LISTED = 16384
#: what the square of its distance from the centroid counts of the gap of a point
TIE = 1e-12
#: cosine of normals between which near points are one contact
SAME = 0.7


class SurfaceWork(NamedTuple):
    """Tables of the shapes, and work arrays of both finders for `cap` pairs; a pair that takes row p overwrites what
    the pair before it kept there.

    gap: (cap,) exact distances of the surfaces at the last exact look: infinite beyond the margin, minus infinity where
    grains overlap.  proven: (cap,) whether the grains were proven to be separate.
    pose: (cap, 2, 20) poses when the pair was listed, by points and by triangles: offset (3) and rotation (9) of j in
    the frame of i, both scales, the distance beyond which nothing was listed; of triangles a distance that the
    surfaces, neither of which was in the other, had then at least, -1 if unknown, the direction in which they were
    nearest, and the way that they have gone since, relative to each other.  last: (cap, 14) pose at the last exact
    look.  key: (cap, 2, 5): i, j, and the lengths of both lists of points, or the length of the list of triangles,
    -1 without a list, its first entry in the pool and the number of entries that it has there, 0 for a `LOST` one,
    whose first entry is the number that it wants.  leaf: (cap, POINTS)
    points of j, then of i.  near: (pool, 2) triangles of i and of j, and apart: (pool,) lower bounds of their
    distances plus the way that their grains had gone then, the lists of all pairs.  used: (1,) entries in use, from the
    first one on.  saved: (cap, 2) first and count of pairs that overlap, before a call.
    candidate: (LISTED, 8) contact points: place on i from its centroid (3), normal (3), gap.  now: (28,) a pose and an
    offset.  turn: (2, 12) maps to the cells of grids.  listed: (2, c) points or leaves.  found: (LISTED, 3) pairs of
    triangles.  found_apart: (LISTED,) bounds of their distances, or distances of points.  stack: (256,), points: (16,):
    of searches.  placed: (2, t, 3, 3), plane: (2, t, 21) and number: (2, t): triangles of j and of i in the frame of i.
    span: (2,) first entry of the pool that is free for a block of pairs, and the one after its last.
    """

    bodies: SurfaceBodies
    gap: Floats
    proven: NDArray[np.bool_]
    pose: Floats
    last: Floats
    key: Integers
    leaf: NDArray[np.int32]
    near: NDArray[np.int32]
    apart: Floats
    used: Integers
    saved: Integers
    candidate: Floats
    now: Floats
    turn: Floats
    listed: Integers
    found: Integers
    found_apart: Floats
    stack: Integers
    points: Floats
    placed: Floats
    plane: Floats
    number: Integers
    span: Integers


#: arrays of the work that each thread has for itself
SCRATCH = (
    *("candidate", "now", "turn", "listed", "found", "found_apart", "stack", "points", "placed", "plane", "number"),
    "span",
)


def surface_work(bodies: SurfaceBodies, cap: int) -> Blocks[SurfaceWork]:
    """Return what the kernels work with, for lists of up to `cap` pairs, without memory."""
    counts = np.diff(bodies.first, axis=0).max(axis=0, initial=1)
    scratch = max(LISTED, int(2 * counts[0]), int(counts[4]))
    work = SurfaceWork(
        bodies=bodies,
        **_rows_of_pairs(cap),
        near=np.zeros((FIRST * cap, 2), dtype=np.int32),
        apart=np.zeros(FIRST * cap),
        used=np.zeros(1, dtype=np.int64),
        candidate=np.zeros((scratch, 8)),
        now=np.zeros(28),
        turn=np.zeros((2, 12)),
        listed=np.zeros((2, int(counts.max())), dtype=np.int64),
        found=np.zeros((LISTED, 3), dtype=np.int64),
        found_apart=np.zeros(scratch),
        stack=np.zeros(256, dtype=np.int64),
        points=np.zeros(16),
        placed=np.zeros((2, int(counts[3]), 3, 3)),
        plane=np.zeros((2, int(counts[3]), 21)),
        number=np.zeros((2, int(counts[3])), dtype=np.int64),
        span=np.zeros(2, dtype=np.int64),
    )
    return Blocks(work, SCRATCH)


def _rows_of_pairs(cap: int) -> dict[str, Any]:
    """Return the arrays that have a row for each of `cap` pairs, of which nothing is known."""
    return {
        "gap": np.full(cap, np.inf),
        "proven": np.zeros(cap, dtype=np.bool_),
        "pose": np.zeros((cap, 2, 20)),
        "last": np.zeros((cap, 14)),
        "key": np.tile(np.array([-1, -1, -1, 0, 0]), (cap, 2, 1)),
        "leaf": np.zeros((cap, POINTS), dtype=np.int32),
        "saved": np.zeros((cap, 2), dtype=np.int64),
    }


def follow_pairs(work: Blocks[SurfaceWork], old: PairList, new: PairList) -> None:
    """Move what is remembered of the pairs of a list to their rows in another one; both are in lexical order."""
    arrays, size = work.arrays, len(new.i)
    cap = len(arrays.key) if size <= len(arrays.key) else size + size // 4
    made, many = _rows_of_pairs(cap), int(max(old.j.max(initial=0), new.j.max(initial=0))) + 1
    before, now = many * old.i + old.j, many * new.i + new.j
    # images of one pair keep their order; poses tell whether they are the same ones
    row = np.searchsorted(before, now) + np.arange(size) - np.searchsorted(now, now)
    some = np.flatnonzero(np.append(before, np.full(size, -1))[row] == now)
    for name in ("pose", "last", "key", "leaf"):
        made[name][some] = getattr(arrays, name)[row[some]]
    if cap > len(arrays.key):
        more = max(FIRST * cap - len(arrays.apart), 0)
        made |= {"near": np.pad(arrays.near, ((0, more), (0, 0))), "apart": np.pad(arrays.apart, (0, more))}
    work.replace(**made)


def tidy(work: Blocks[SurfaceWork], size: int) -> None:
    """Move the lists of triangles of the first pairs to the front of the pool, once most of it is in use.

    The pool grows where lists found no room in it, which are made again when their pairs are next looked at.
    """
    arrays = work.arrays
    arrays.key[size:, 1, 2:] = -1, 0, 0
    key = arrays.key[:, 1]
    lost, cap = key[:, 2] == LOST, len(arrays.apart)
    wanted = int(key[lost, 3].sum())
    key[lost, 2:4] = -1, 0
    arrays.used[0] = (key[:, 3] + key[:, 4]).max(initial=0)
    if not wanted and 4 * arrays.used[0] <= 3 * cap:
        return
    count = np.maximum(key[:, 2], 0)
    first = np.cumsum(count) - count
    total = int(count.sum())
    source = np.arange(total) + np.repeat(key[:, 3] - first, count)
    cap = max(cap, 2 * (total + wanted))
    near, apart = np.zeros((cap, 2), dtype=np.int32), np.zeros(cap)
    near[:total], apart[:total] = arrays.near[source], arrays.apart[source]
    key[:, 3], key[:, 4], arrays.used[0] = first, count, total
    work.replace(near=near, apart=apart)


@bare_kernel
def write_pose(grains: Grains, i: int, j: int, offset: Vector, pose: Floats) -> None:
    """Write offset and rotation of grain j in the frame of grain i, and both scales."""
    turn, scale = grains.matrix, grains.scale
    pose[0], pose[1], pose[2] = rotate_back(turn[i], offset)
    for r in range(3):
        for c in range(3):
            pose[3 + 3 * r + c] = (
                turn[i, 0, r] * turn[j, 0, c] + turn[i, 1, r] * turn[j, 1, c] + turn[i, 2, r] * turn[j, 2, c]
            )
    pose[12], pose[13] = scale[i], scale[j]


@bare_kernel
def motion_since(pose: Floats, old: Floats, radius_i: float, radius_j: float) -> float:
    """Return how far, at most, a point of one surface has moved relative to the other since an old pose."""
    way, turn = 0.0, 0.0
    for k in range(3):
        way += (pose[k] - old[k]) ** 2
    for k in range(3, 12):
        turn += (pose[k] - old[k]) ** 2
    # a rotation by t has the Frobenius norm 2 sqrt(2) sin(t / 2) and moves points by 2 sin(t / 2) of their distance
    grown = abs(1.0 - old[12] / pose[12]) * radius_i + abs(1.0 - old[13] / pose[13]) * radius_j
    return 1.000001 * (math.sqrt(way) + math.sqrt(0.5 * turn) * radius_j + grown)


@bare_kernel
def way_gone(work: SurfaceWork, p: int, radius_i: float, radius_j: float) -> float:
    """Return the way that a pair has gone to the pose in `work.now` since its list of triangles was made."""
    old = work.pose[p, 1]
    old[19] += motion_since(work.now, work.last[p], radius_i, radius_j)
    copy_numbers(work.last[p], work.now, 14)
    return old[19]


@bare_kernel
def copy_numbers(target: NDArray[Any], source: NDArray[Any], count: int) -> None:
    """Copy the first numbers of a row."""
    for k in range(count):
        target[k] = source[k]


@bare_kernel
def is_kept(key: Integers, i: int, j: int) -> bool:
    """Return whether a row of the memory has the lists of a pair."""
    return key[0] == i and key[1] == j and key[2] >= 0


@bare_kernel
def spacing_of(radius_i: float, radius_j: float) -> float:
    """Return how far apart the contact points of a pair are, at least, unless their normals differ."""
    return min(0.15, 0.15 * min(radius_i, radius_j))


@bare_kernel
def write_spread(rows: ContactRows, m: int, pair: Pair, candidate: Floats, k: int, most: int, spacing: float) -> int:
    """Write the deepest of k candidates that are apart from each other, at most `most`; return the new number of rows.

    Returns -1 if the rows are full.
    """
    left, at, best, last = 0, -1, 1e300, m + most
    for q in range(k):
        row = candidate[q]
        if row[6] < pair.reach:
            # of points at one height, as between parallel faces, the outer ones are kept
            place = vector_at(row, 0)
            row[7] = row[6] - TIE * dot(place, place)
            left, at, best = _keep_candidate(candidate, q, left, at, best)
    while at >= 0 and m < last:
        if m >= len(rows.i):
            return -1
        chosen, gap = at, candidate[at, 6]
        arm, normal = row_of(candidate, at), vector_at(candidate[at], 3)
        other_arm = sub(along(arm, gap, normal), pair.offset)
        write_contact(rows, m, pair, normal, arm, other_arm, gap - pair.rest, 0.5 * spacing)
        m += 1
        count, left, at, best = left, 0, -1, 1e300
        for q in range(count):
            way, cosine = sub(row_of(candidate, q), arm), dot(vector_at(candidate[q], 3), normal)
            if q != chosen and (dot(way, way) >= spacing * spacing or cosine <= SAME):
                left, at, best = _keep_candidate(candidate, q, left, at, best)
    return m


@bare_kernel
def _keep_candidate(candidate, q, left, at, best):  # type: ignore[no-untyped-def]
    """Move candidate q up to place `left`; return the number of those kept, and place and score of the best of them."""
    if left < q:
        copy_numbers(candidate[left], candidate[q], 8)
    if candidate[left, 7] < best:
        return left + 1, left, candidate[left, 7]
    return left + 1, at, best
