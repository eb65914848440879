"""Exact contacts of pairs with a non-convex mesh, and the proof that they are separate, from their triangles.

The pairs of triangles that are near each other are listed by a traversal of both box trees, and the list is kept until
the grains have moved. Contact points are the nearest points of features: corner and face, edge and edge, and so on;
those that are no minima of the distance, as their direction is not in the normal cones of both features, are left out.
The least gap is the distance of the surfaces. Where surfaces cross a little, the depths of corners behind faces and of
edges behind edges are negative gaps; where they cross deeply, points and directions come from the grids.
"""

import math

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.contacts.manifolds.blocks import Blocks, pairs_of_kind
from voxgran.contacts.manifolds.rows import SURFACE, ContactRows, Grains, Pair, PairList, Search, offset_of
from voxgran.contacts.manifolds.surface_contacts import field_candidates
from voxgran.contacts.manifolds.surface_memory import (
    SurfaceWork,
    copy_numbers,
    is_kept,
    spacing_of,
    tidy,
    way_gone,
    write_pose,
    write_spread,
)
from voxgran.contacts.manifolds.triangle_depths import crossing_curve, crossing_depths
from voxgran.contacts.manifolds.triangle_features import is_minimum, nearest_features, place_triangle
from voxgran.contacts.manifolds.triangle_lists import least_distance, near_triangles
from voxgran.geometry.tree import encloses
from voxgran.geometry.vectors import along, corner_of, dot, rotate, sub, times, vector_at

#: contact points of a pair, at most
MOST = 8
#: distance, by the grids, within which points of surfaces that cross are found
OVERSIGHT = 0.02
#: distance beyond the margin to which distances of triangles are found: they are not looked at again so soon
FARTHER = 3e-3
#: gap from which on a pair counts as separate while it moves by less
SEPARATE = 1e-6
#: distance, in radii of the pair, below which rounding could hide an overlap
ROUNDING = 1e-12


@bare_kernel
def exact_candidates(
    grains: Grains, work: SurfaceWork, p: int, count: int, way: float, i: int, j: int, margin: float, separate: bool
) -> tuple[int, float]:
    """Write the contact points of listed pairs of triangles; return their number and the exact gap.

    separate: whether the grains are known to be, as they have moved by less than their last gap.

    The gap is -1e9 where triangles cross or the center of a sphere lies in a mesh, and 1e9 where none are within the
    margin.
    """
    bodies, pose, points, placed, apart = work.bodies, work.now, work.points, work.placed[0], work.apart
    stretch, unit, turn = pose[13] / pose[12], pose[12], grains.matrix[i]
    solid_i, solid_j = bodies.frame[grains.shape[i], 7], bodies.frame[grains.shape[j], 7]
    pierce = solid_i != 0 and solid_j != 0
    wide = (margin + FARTHER) / unit
    spare, k, low, best, last = work.candidate[len(work.candidate) - 1], 0, 1e9, 1e9, -1
    normal, relative = (0.0, 0.0, 0.0), pose[3:12].reshape((3, 3))
    for q in range(count):
        s, t = work.found[q, 0], work.found[q, 1]
        if t != last:
            place_triangle(bodies.corner, t, pose, stretch, placed, 0)
            normal, last = rotate(relative, corner_of(bodies.pseudo, t, 0)), t
        skin = bodies.skin[s, 0] + bodies.skin[t, 0] * stretch
        square, mine, theirs = nearest_features(
            bodies.corner,
            s,
            placed,
            0,
            points,
            wide + skin,
            pierce and not separate,
            corner_of(bodies.pseudo, s, 0),
            normal,
        )
        length = math.sqrt(square)
        gap = (length - skin) * unit
        if work.found[q, 2] >= 0:
            # not before the pair has gone farther than this can the triangles be nearer than the margin
            apart[work.found[q, 2]] = max(apart[work.found[q, 2]], gap + way)
        if mine < 0 or gap >= margin:
            continue
        if length == 0.0:
            return 0, -1e9
        near = vector_at(points, 0)
        dx, dy, dz = sub(vector_at(points, 3), near)
        direction = dx / length, dy / length, dz / length
        good = is_minimum(bodies, s, mine, t, theirs, pose, direction, solid_i, solid_j)
        if not good and not pierce and gap < -0.5 * skin * unit and _is_inside(grains, work, i, j):
            return 0, -1e9
        if not good and gap >= low:
            continue
        if gap < low:
            low = gap
            work.pose[p, 1, 16], work.pose[p, 1, 17], work.pose[p, 1, 18] = direction
        best = min(best, gap) if good else best
        row = work.candidate[k] if good else spare
        row[0], row[1], row[2] = times(rotate(turn, along(near, bodies.skin[s, 0], direction)), unit)
        row[3], row[4], row[5] = rotate(turn, direction)
        row[6] = gap
        k += 1 if good else 0
    if low < best:
        # the nearest points are out of their cones: by rounding, or as seen from within a solid
        if not separate and _is_inside(grains, work, i, j):
            return 0, -1e9
        copy_numbers(work.candidate[k], spare, 8)
        k += 1
    return k, low


@bare_kernel
def _holds(work, body, x, y, z):  # type: ignore[no-untyped-def]
    """Return whether the triangles of a body enclose a point in its frame."""
    bodies = work.bodies
    first, last = bodies.first[body, 4], bodies.first[body + 1, 4]
    return bodies.frame[body, 7] != 0.0 and encloses(
        bodies.corner, bodies.pseudo, bodies.low[first:last], bodies.high[first:last], bodies.box_rows[first:last],
        (x, y, z), work.stack,
    )  # fmt: skip


@bare_kernel
def _is_inside(grains, work, i, j):  # type: ignore[no-untyped-def]
    """Return whether one of two grains whose surfaces do not cross lies in the other: a corner or a sphere."""
    bodies, pose, one, other = work.bodies, work.now, grains.shape[i], grains.shape[j]
    mine, theirs = bodies.first[one, 3], bodies.first[other, 3]
    for s in range(mine, bodies.first[one + 1, 3] if bodies.frame[one, 7] == 0.0 else mine + 1):
        x, y, z = sub(times(corner_of(bodies.corner, s, 0), pose[12]), vector_at(pose, 0))
        u = (pose[3] * x + pose[6] * y + pose[9] * z) / pose[13]
        v = (pose[4] * x + pose[7] * y + pose[10] * z) / pose[13]
        w = (pose[5] * x + pose[8] * y + pose[11] * z) / pose[13]
        if _holds(work, other, u, v, w):
            return True
    for t in range(theirs, bodies.first[other + 1, 3] if bodies.frame[other, 7] == 0.0 else theirs + 1):
        x, y, z = times(corner_of(bodies.corner, t, 0), pose[13])
        u = (pose[0] + pose[3] * x + pose[4] * y + pose[5] * z) / pose[12]
        v = (pose[1] + pose[6] * x + pose[7] * y + pose[8] * z) / pose[12]
        w = (pose[2] + pose[9] * x + pose[10] * y + pose[11] * z) / pose[12]
        if _holds(work, one, u, v, w):
            return True
    return False


@bare_kernel
def _exact_pair(grains, work, p, i, j, margin):  # type: ignore[no-untyped-def]
    """Write the candidates of a pair whose pose is in `work.now`; return their number and the exact gap.

    The gap is -1e9 where the grains overlap, or a bound of it beyond the margin.
    """
    old, apart = work.pose[p, 1], -1.0
    if is_kept(work.key[p, 1], i, j):
        apart = old[15] - way_gone(work, p, grains.radius[i], grains.radius[j])
        if apart > margin:
            return 0, apart
    count, clear, way = near_triangles(grains, work, p, i, j, margin)
    if count < 0:
        # more triangles than are listed are near each other only where grains lie deep in each other
        return 0, -1e9
    k, low = exact_candidates(grains, work, p, count, way, i, j, margin, apart > SEPARATE)
    old[15] = low + way if low > 0.0 else -1.0
    if k == 0 and low > 0.0:
        if apart <= SEPARATE and _is_inside(grains, work, i, j):
            return 0, -1e9
        # listed pairs are all beyond the margin now
        old[15] = least_distance(work, p)
        return 0, clear if count == 0 else min(clear, margin)
    return k, low


@bare_kernel
def _crossing_candidates(grains, work, p, i, j, offset, margin):  # type: ignore[no-untyped-def]
    """Write candidates of a pair that overlaps, the least gap at most 0; return number and gap.

    They come from the triangles where surfaces cross, and else from the grids.
    """
    count, _, _ = near_triangles(grains, work, p, i, j, margin)
    if count > 0:
        k, least = crossing_depths(grains, work, count, i, j, margin)
        if k == 0:
            k, least = crossing_curve(grains, work, count, i, j)
        if k > 0:
            return k, least
    k, _ = field_candidates(grains, work, p, i, j, offset, margin + OVERSIGHT)
    least = 1e9
    for q in range(k):
        least = min(least, work.candidate[q, 6])
    if k == 0:
        row, length = work.candidate[0], math.sqrt(dot(offset, offset))
        for r in range(3):
            row[r] = 0.5 * offset[r]
            row[3 + r] = offset[r] / length if length > 0.0 else (1.0 if r == 2 else 0.0)
        row[6] = 0.0
        return 1, 0.0
    if least > 0.0:
        for q in range(k):
            work.candidate[q, 6] -= least
        least = 0.0
    return k, least


def find_triangle_contacts(search: Search, work: Blocks[SurfaceWork], rows: ContactRows, m: int) -> int:
    """Write the exact contacts of the pairs with a non-convex mesh from row m on; return the new number of rows.

    Arguments and the value -1 are those of
    :func:`voxgran.contacts.manifolds.surface_contacts.find_surface_contacts`; the room of a pair is not subtracted. The
    gaps of the pairs and whether they are proven to be separate are in `work.gap` and `work.proven`. What is remembered
    does not depend on `pairs.bound`, which is written, not read: the gaps of the other finder are too large. The rows
    of pairs that overlap follow those of all others. If m is -1 no rows are written and `pairs` is left as it is.
    Pairs known to be separate whose surfaces have moved by no more than `reuse` since keep their old rows.
    """
    made = work.find(_find_exact, search, rows, m, chosen=pairs_of_kind(search.grains, search.pairs, SURFACE))
    overlap = np.isneginf(work.arrays.gap[: len(search.pairs.i)])
    if made >= 0 and overlap.any():
        # a kernel of its own: beds without overlap need not wait for its compilation
        made = work.find(_find_crossing, search, rows, made, chosen=overlap)
    tidy(work, len(search.pairs.i))
    return made


@kernel
def _find_exact(search, work, rows, m, begin, end):  # type: ignore[no-untyped-def]
    """Write the contacts of pairs from `begin` to `end` - 1 that do not overlap, and the gaps of all."""
    grains, pairs, margin, silent = search.grains, search.pairs, search.margin, m < 0
    used, free, size = work.used[0], len(work.apart) - work.used[0], max(len(pairs.i), 1)
    work.span[0], work.span[1] = used + free * begin // size, used + free * end // size
    for p in range(begin, end):
        i, j = pairs.i[p], pairs.j[p]
        work.gap[p] = math.inf
        if max(grains.kind[i], grains.kind[j]) != SURFACE:
            continue
        way = grains.way[i] + grains.way[j] - pairs.way[p]
        if search.reuse > 0.0 and way <= search.reuse and pairs.bound[p] > SEPARATE:
            m = _keep_rows(pairs, work, p, rows, m)
            if m < 0:
                return -1
            continue
        offset = offset_of(search, p)
        far, radii = math.sqrt(dot(offset, offset)), grains.radius[i] + grains.radius[j]
        k, low, rounding = 0, far - radii, ROUNDING * (far + radii)
        if low <= margin:
            write_pose(grains, i, j, offset, work.now)
            k, low = _exact_pair(grains, work, p, i, j, max(margin, 4.0 * rounding))
        work.gap[p] = -math.inf if low == -1e9 else (low if low <= margin else math.inf)
        work.proven[p] = low > 2.0 * rounding
        if silent:
            continue
        work.saved[p, 0], work.saved[p, 1] = pairs.first[p], pairs.count[p]
        pairs.first[p], pairs.count[p] = m, 0
        pairs.bound[p], pairs.way[p] = low, grains.way[i] + grains.way[j]
        if k == 0:
            continue
        m = _write_pair(search, work, p, offset, rows, m, k)
        if m < 0:
            return -1
    return m


@kernel
def _find_crossing(search, work, rows, m, begin, end):  # type: ignore[no-untyped-def]
    """Write the contacts of the pairs from `begin` to `end` - 1 that overlap."""
    grains, pairs = search.grains, search.pairs
    for p in range(begin, end):
        if work.gap[p] != -math.inf:
            continue
        i, j, offset = pairs.i[p], pairs.j[p], offset_of(search, p)
        write_pose(grains, i, j, offset, work.now)
        k, low = _crossing_candidates(grains, work, p, i, j, offset, search.margin)
        pairs.first[p], pairs.bound[p] = m, low
        m = _write_pair(search, work, p, offset, rows, m, k)
        if m < 0:
            return -1
    return m


@bare_kernel
def _keep_rows(pairs, work, p, rows, m):  # type: ignore[no-untyped-def]
    """Write the old rows of a pair from row m on; return the new number of rows, or -1."""
    first, count = pairs.first[p], pairs.count[p]
    pairs.first[p] = m
    if m + count > len(rows.row):
        return -1
    for k in range(count):
        copy_numbers(rows.row[m + k], rows.old[first + k], 14)
        rows.row[m + k, 14] = rows.row[m + k, 15] = 0.0
        rows.i[m + k], rows.j[m + k] = pairs.i[p], pairs.j[p]
    return m + count


@bare_kernel
def _write_pair(search, work, p, offset, rows, m, k):  # type: ignore[no-untyped-def]
    """Write the deepest of k candidates of a pair, whose old rows are saved; return the new number of rows, or -1."""
    grains, pairs = search.grains, search.pairs
    i, j = pairs.i[p], pairs.j[p]
    pair = Pair(i, j, offset, work.saved[p, 0], work.saved[p, 1], search.margin, search.rest)
    after = write_spread(rows, m, pair, work.candidate, k, MOST, spacing_of(grains.radius[i], grains.radius[j]))
    if after < 0:
        return -1
    pairs.count[p] = after - m
    return after


def prove_separate(
    grains: Grains, pairs: PairList, work: Blocks[SurfaceWork], rows: ContactRows, reach: float
) -> tuple[Floats, Booleans]:
    """Return exact gaps of pairs with a non-convex mesh, and whether they are proven to be separate.

    Parameters
    ----------
    grains, pairs, work, rows
        As :func:`find_triangle_contacts`; of the work the lists of near triangles are used and renewed, and nothing is
        written to pairs and rows. A pair is traversed again only when its grains have moved.
    reach : float
        Distance up to which gaps are wanted.

    Returns
    -------
    gap : (p,) ndarray of float
        Distances of the surfaces, infinite beyond the reach and for pairs of other kinds, minus infinity where surfaces
        cross or one grain lies in the other. Of tessellated primitives it is a lower bound.
    proven : (p,) ndarray of bool
        Whether the grains are separate; false for pairs of other kinds.
    """
    shared, size = work.arrays, len(pairs.i)
    shared.gap[:size], shared.proven[:size] = np.inf, False
    find_triangle_contacts(Search(grains, pairs, reach, 0.0), work, rows, -1)
    return shared.gap[:size].copy(), shared.proven[:size].copy()
