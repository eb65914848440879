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
from voxgran.contacts.manifolds.distance_grids import SurfaceBodies
from voxgran.contacts.manifolds.rows import SURFACE, ContactRows, Grains, PairList
from voxgran.contacts.manifolds.surface_contacts import field_candidates
from voxgran.contacts.manifolds.surface_memory import (
    SurfaceWork,
    copy_numbers,
    spacing_of,
    write_pose,
    write_spread,
)
from voxgran.contacts.manifolds.triangle_depths import crossing_depths
from voxgran.contacts.manifolds.triangle_features import is_minimum, nearest_features, place_triangle
from voxgran.contacts.manifolds.triangle_lists import near_triangles
from voxgran.geometry.tree import is_behind, search_triangles

#: contact points of a pair, at most
MOST = 8
#: distance, by the grids, within which points of surfaces that cross are found
OVERSIGHT = 0.02
#: gap from which on a pair counts as separate while its rows are kept
SEPARATE = 1e-6
#: distance, in radii of the pair, below which rounding could hide an overlap
ROUNDING = 1e-12


@bare_kernel
def exact_candidates(
    grains: Grains, bodies: SurfaceBodies, work: SurfaceWork, p: int, count: int, way: float, i: int, j: int,
    margin: float,
) -> tuple[int, float]:  # fmt: skip
    """Write the contact points of listed pairs of triangles; return their number and the exact gap.

    The gap is -1e9 where triangles cross or the center of a sphere lies in a mesh, and 1e9 where none are within the
    margin.
    """
    pose, points, placed, apart = work.now, work.points, work.placed[0], work.apart[p]
    stretch, unit, turn = pose[13] / pose[12], pose[12], grains.matrix[i]
    solid_i, solid_j = bodies.frame[grains.shape[i], 7], bodies.frame[grains.shape[j], 7]
    pierce = solid_i != 0 and solid_j != 0
    spare, k, low, best = work.candidate[len(work.candidate) - 1], 0, 1e9, 1e9
    for q in range(count):
        s, t = work.found[q, 0], work.found[q, 1]
        place_triangle(bodies.corner, t, pose, stretch, placed, 0)
        skin = bodies.skin[s, 0] + bodies.skin[t, 0] * stretch
        square, mine, theirs = nearest_features(bodies.corner, s, placed, 0, points, margin / unit + skin, pierce)
        length = math.sqrt(square)
        gap = (length - skin) * unit
        if work.found[q, 2] >= 0:
            # when the list was made the distance was at least this
            apart[work.found[q, 2]] = max(apart[work.found[q, 2]], gap - way)
        if mine < 0:
            continue
        if length == 0.0:
            return 0, -1e9
        dx, dy, dz = (
            (points[3] - points[0]) / length,
            (points[4] - points[1]) / length,
            (points[5] - points[2]) / length,
        )
        good = is_minimum(bodies, s, mine, t, theirs, pose, dx, dy, dz, solid_i, solid_j)
        if not good and not pierce and gap < -0.5 * skin * unit and _is_inside(bodies, work, i, j, grains.shape):
            return 0, -1e9
        if not good and gap >= low:
            continue
        if gap < low:
            low = gap
            work.pose[p, 1, 16], work.pose[p, 1, 17], work.pose[p, 1, 18] = dx, dy, dz
        best = min(best, gap) if good else best
        row = work.candidate[k] if good else spare
        inner = bodies.skin[s, 0]
        x, y, z = points[0] + inner * dx, points[1] + inner * dy, points[2] + inner * dz
        for r in range(3):
            row[r] = unit * (turn[r, 0] * x + turn[r, 1] * y + turn[r, 2] * z)
            row[3 + r] = turn[r, 0] * dx + turn[r, 1] * dy + turn[r, 2] * dz
        row[6] = gap
        k += 1 if good else 0
    if low < best:
        # rounding may leave the nearest points out of their cones
        copy_numbers(work.candidate[k], spare, 8)
        k += 1
    return k, low


@bare_kernel
def _holds(bodies, work, body, x, y, z):  # type: ignore[no-untyped-def]
    """Return whether the triangles of a body enclose a point in its frame."""
    first, last = bodies.first[body, 4], bodies.first[body + 1, 4]
    low, high = bodies.low[first], bodies.high[first]
    if (
        bodies.frame[body, 7] == 0.0
        or x < low[0]
        or y < low[1]
        or z < low[2]
        or x > high[0]
        or y > high[1]
        or z > high[2]
    ):
        return False
    _, k, feature, px, py, pz = search_triangles(
        bodies.corner, bodies.low[first:last], bodies.high[first:last], bodies.box_rows[first:last], x, y, z, 1e100,
        work.stack,
    )  # fmt: skip
    return is_behind(bodies.pseudo, k, feature, x - px, y - py, z - pz)


@bare_kernel
def _is_inside(bodies, work, i, j, shape):  # type: ignore[no-untyped-def]
    """Return whether one of two grains whose surfaces do not cross lies in the other: a corner or a sphere."""
    pose = work.now
    one, other = shape[i], shape[j]
    mine, theirs = bodies.first[one, 3], bodies.first[other, 3]
    for s in range(mine, bodies.first[one + 1, 3] if bodies.frame[one, 7] == 0.0 else mine + 1):
        x, y, z = (
            bodies.corner[s, 0, 0] * pose[12],
            bodies.corner[s, 0, 1] * pose[12],
            bodies.corner[s, 0, 2] * pose[12],
        )
        x, y, z = x - pose[0], y - pose[1], z - pose[2]
        u = (pose[3] * x + pose[6] * y + pose[9] * z) / pose[13]
        v = (pose[4] * x + pose[7] * y + pose[10] * z) / pose[13]
        w = (pose[5] * x + pose[8] * y + pose[11] * z) / pose[13]
        if _holds(bodies, work, other, u, v, w):
            return True
    for t in range(theirs, bodies.first[other + 1, 3] if bodies.frame[other, 7] == 0.0 else theirs + 1):
        x, y, z = (
            bodies.corner[t, 0, 0] * pose[13],
            bodies.corner[t, 0, 1] * pose[13],
            bodies.corner[t, 0, 2] * pose[13],
        )
        u = (pose[0] + pose[3] * x + pose[4] * y + pose[5] * z) / pose[12]
        v = (pose[1] + pose[6] * x + pose[7] * y + pose[8] * z) / pose[12]
        w = (pose[2] + pose[9] * x + pose[10] * y + pose[11] * z) / pose[12]
        if _holds(bodies, work, one, u, v, w):
            return True
    return False


@bare_kernel
def _exact_pair(grains, bodies, work, p, i, j, margin):  # type: ignore[no-untyped-def]
    """Write the candidates of a pair whose pose is in `work.now`; return their number and the exact gap.

    The gap is -1e9 where the grains overlap, or a bound of it beyond the margin.
    """
    count, clear, way = near_triangles(grains, bodies, work, p, i, j, margin)
    if count < 0:
        # more triangles than are listed are near each other only where grains lie deep in each other
        return 0, -1e9
    k, low = exact_candidates(grains, bodies, work, p, count, way, i, j, margin)
    if k == 0 and low > 0.0:
        if _is_inside(bodies, work, i, j, grains.shape):
            return 0, -1e9
        # listed pairs are all beyond the margin now
        return 0, clear if count == 0 else min(clear, margin)
    return k, low


@bare_kernel
def _crossing_candidates(grains, bodies, work, p, i, j, offset, margin):  # type: ignore[no-untyped-def]
    """Write candidates of a pair that overlaps, the least gap at most 0; return number and gap.

    They come from the triangles where surfaces cross a little, and else from the grids.
    """
    count, _, _ = near_triangles(grains, bodies, work, p, i, j, margin)
    if count > 0:
        k, least = crossing_depths(grains, bodies, work, count, i, j, margin)
        if k > 0:
            return k, least
    k, _ = field_candidates(grains, bodies, work, p, i, j, offset, margin + OVERSIGHT)
    least = 1e9
    for q in range(k):
        least = min(least, work.candidate[q, 6])
    if k == 0:
        row, length = work.candidate[0], math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
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


def find_triangle_contacts(
    grains: Grains, bodies: SurfaceBodies, work: Blocks[SurfaceWork], pairs: PairList, size: int,
    rows: ContactRows, m: int, margin: float, rest: float, *, reuse: float = 0.0,
) -> int:  # fmt: skip
    """Write the exact contacts of the pairs with a non-convex mesh from row m on; return the new number of rows.

    Arguments and the value -1 are those of
    :func:`voxgran.contacts.manifolds.surface_contacts.find_surface_contacts`; the room of a pair is not subtracted. The
    gaps of the pairs and whether they are proven to be separate are in `work.gap` and `work.proven`. What is remembered
    does not depend on `pairs.bound`, which is written, not read: the gaps of the other finder are too large. The rows
    of pairs that overlap follow those of all others. If m is -1 no rows are written and `pairs` is left as it is.
    Pairs known to be separate whose surfaces have moved by no more than `reuse` since keep their old rows.
    """

    def find(own: SurfaceWork, part: ContactRows, start: int, first: int, last: int) -> int:
        return int(_find_exact(grains, bodies, own, pairs, part, start, margin, rest, reuse, first, last))

    def find_crossing(own: SurfaceWork, part: ContactRows, start: int, first: int, last: int) -> int:
        return int(_find_crossing(grains, bodies, own, pairs, part, start, margin, rest, first, last))

    chosen = pairs_of_kind(grains, pairs, size, SURFACE)
    made = work.find(find, pairs=pairs, chosen=chosen, rows=rows, m=m)
    overlap = np.isneginf(work.arrays.gap[:size])
    if made >= 0 and overlap.any():
        # a kernel of its own: beds without overlap need not wait for its compilation
        made = work.find(find_crossing, pairs=pairs, chosen=overlap, rows=rows, m=made)
    return made


@kernel
def _find_exact(grains, bodies, work, pairs, rows, m, margin, rest, reuse, begin, end):  # type: ignore[no-untyped-def]
    """Write the contacts of pairs from `begin` to `end` - 1 that do not overlap, and the gaps of all."""
    offset, silent = work.now[16:19], m < 0
    for p in range(begin, end):
        i, j = pairs.i[p], pairs.j[p]
        work.gap[p] = math.inf
        if max(grains.kind[i], grains.kind[j]) != SURFACE:
            continue
        way = grains.way[i] + grains.way[j] - pairs.way[p]
        if reuse > 0.0 and way <= reuse and pairs.bound[p] > SEPARATE:
            m = _keep_rows(pairs, work, p, rows, m)
            if m < 0:
                return -1
            continue
        far = _write_offset(grains, pairs, p, offset)
        radii = grains.radius[i] + grains.radius[j]
        k, low, rounding = 0, far - radii, ROUNDING * (far + radii)
        if low <= margin:
            write_pose(grains.matrix, grains.scale, i, j, offset, work.now)
            k, low = _exact_pair(grains, bodies, work, p, i, j, max(margin, 4.0 * rounding))
        work.gap[p] = -math.inf if low == -1e9 else (low if low <= margin else math.inf)
        work.proven[p] = low > 2.0 * rounding
        if silent:
            continue
        work.saved[p, 0], work.saved[p, 1] = pairs.first[p], pairs.count[p]
        pairs.first[p], pairs.count[p] = m, 0
        pairs.bound[p], pairs.way[p] = low, grains.way[i] + grains.way[j]
        if k == 0:
            continue
        m = _write_pair(grains, work, pairs, p, offset, rows, m, k, margin, rest)
        if m < 0:
            return -1
    return m


@kernel
def _find_crossing(grains, bodies, work, pairs, rows, m, margin, rest, begin, end):  # type: ignore[no-untyped-def]
    """Write the contacts of the pairs from `begin` to `end` - 1 that overlap."""
    offset = work.now[16:19]
    for p in range(begin, end):
        if work.gap[p] != -math.inf:
            continue
        i, j = pairs.i[p], pairs.j[p]
        _write_offset(grains, pairs, p, offset)
        write_pose(grains.matrix, grains.scale, i, j, offset, work.now)
        k, low = _crossing_candidates(grains, bodies, work, p, i, j, offset, margin)
        pairs.first[p], pairs.bound[p] = m, low
        m = _write_pair(grains, work, pairs, p, offset, rows, m, k, margin, rest)
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
def _write_offset(grains, pairs, p, offset):  # type: ignore[no-untyped-def]
    """Write where the second grain of a pair lies relative to the first one; return the distance."""
    i, j, square = pairs.i[p], pairs.j[p], 0.0
    for r in range(3):
        offset[r] = grains.position[j, r] + pairs.shift[p, r] - grains.position[i, r]
        square += offset[r] * offset[r]
    return math.sqrt(square)


@bare_kernel
def _write_pair(grains, work, pairs, p, offset, rows, m, k, margin, rest):  # type: ignore[no-untyped-def]
    """Write the deepest of k candidates of a pair, whose old rows are saved; return the new number of rows, or -1."""
    i, j = pairs.i[p], pairs.j[p]
    first, count = work.saved[p, 0], work.saved[p, 1]
    spacing = spacing_of(grains.radius[i], grains.radius[j])
    after = write_spread(rows, m, i, j, offset, work.candidate, k, MOST, margin, rest, spacing, first, count)
    if after < 0:
        return -1
    for r in range(3):
        pairs.normal[p, r] = rows.row[m, r]
    pairs.count[p] = after - m
    return after


def prove_separate(
    grains: Grains, bodies: SurfaceBodies, work: Blocks[SurfaceWork], *, pairs: PairList, size: int,
    rows: ContactRows, reach: float,
) -> tuple[Floats, Booleans]:  # fmt: skip
    """Return exact gaps of pairs with a non-convex mesh, and whether they are proven to be separate.

    Parameters
    ----------
    grains, bodies, work, pairs, size, rows
        As :func:`find_triangle_contacts`; of the work the lists of near triangles are used and renewed, and nothing is
        written to pairs and rows. A pair is traversed again only when its grains have moved.
    reach : float
        Distance up to which gaps are wanted.

    Returns
    -------
    gap : (size,) ndarray of float
        Distances of the surfaces, infinite beyond the reach and for pairs of other kinds, minus infinity where surfaces
        cross or one grain lies in the other. Of tessellated primitives it is a lower bound.
    proven : (size,) ndarray of bool
        Whether the grains are separate; false for pairs of other kinds.
    """
    shared = work.arrays
    shared.gap[:size], shared.proven[:size] = np.inf, False
    find_triangle_contacts(grains, bodies, work, pairs, size, rows, -1, reach, 0.0)
    return shared.gap[:size].copy(), shared.proven[:size].copy()
