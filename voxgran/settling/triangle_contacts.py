"""Exact contacts of pairs with a non-convex mesh, and the proof that they are separate, from their triangles.

The pairs of triangles that are near each other are listed by a traversal of both box trees, and the list is kept until
the grains have moved. Contact points are the nearest points of features: corner and face, edge and edge, and so on;
those that are no minima of the distance, as their direction is not in the normal cones of both features, are left out.
The least gap is the distance of the surfaces. Where surfaces cross, points and directions come from the grids.
"""

import math

from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.tree import is_behind, search_triangles
from voxgran.settling.contact_rows import SURFACE
from voxgran.settling.surface_contacts import field_candidates
from voxgran.settling.surface_memory import (
    NEAR,
    copy_numbers,
    is_kept,
    motion_since,
    restore,
    spacing_of,
    write_pose,
    write_spread,
)
from voxgran.settling.triangle_features import is_minimum, nearest_features

#: contact points of a pair, at most
MOST = 8
#: distance beyond the margin within which triangles are listed
SLACK = 4e-3
#: distance, by the grids, within which points of surfaces that cross are found
OVERSIGHT = 0.02
#: distance, in radii of the pair, below which rounding could hide an overlap
ROUNDING = 1e-12


@bare_kernel
def _bound(bodies, a, b, pose, stretch):  # type: ignore[no-untyped-def]
    """Return a lower bound of the squared distance of two boxes in the frame and unit of i."""
    square = 0.0
    px, py, pz = bodies.low[b, 0], bodies.low[b, 1], bodies.low[b, 2]
    qx, qy, qz = bodies.high[b, 0], bodies.high[b, 1], bodies.high[b, 2]
    cx, cy, cz = 0.5 * stretch * (px + qx), 0.5 * stretch * (py + qy), 0.5 * stretch * (pz + qz)
    hx, hy, hz = 0.5 * stretch * (qx - px), 0.5 * stretch * (qy - py), 0.5 * stretch * (qz - pz)
    for r in range(3):
        u, v, w = pose[3 + 3 * r], pose[4 + 3 * r], pose[5 + 3 * r]
        center = pose[r] / pose[12] + u * cx + v * cy + w * cz
        half = abs(u) * hx + abs(v) * hy + abs(w) * hz
        gap = max(bodies.low[a, r] - center - half, center - half - bodies.high[a, r], 0.0)
        square += gap * gap
    return square


@bare_kernel
def _place_triangle(bodies, t, pose, stretch, placed, k):  # type: ignore[no-untyped-def]
    """Write triangle t of j in the frame and unit of i."""
    for c in range(3):
        x, y, z = bodies.corner[t, c, 0] * stretch, bodies.corner[t, c, 1] * stretch, bodies.corner[t, c, 2] * stretch
        for r in range(3):
            placed[k, c, r] = pose[r] / pose[12] + pose[3 + 3 * r] * x + pose[4 + 3 * r] * y + pose[5 + 3 * r] * z


@bare_kernel
def _list_triangles(bodies, work, one, other, reach):  # type: ignore[no-untyped-def]
    """List the pairs of triangles within reach, in lengths of the bed, of shapes whose pose is in `work.now`.

    Returns their number, or -1 if there are too many, and the least distance of the others.
    """
    pose, stack, bound, placed = work.now, work.stack, work.bound, work.placed
    stretch, unit = pose[13] / pose[12], pose[12]
    limit = (reach / unit) ** 2
    base, root = bodies.box_first[one], bodies.box_first[other]
    leaves, other_leaves = (bodies.box_first[one + 1] - base) // 2, (bodies.box_first[other + 1] - root) // 2
    clear, count, depth = 1e18, 0, 1
    stack[0, 0], stack[0, 1] = 0, 0
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        square = _bound(bodies, base + a, root + b, pose, stretch)
        if square > limit:
            clear = min(clear, square)
            continue
        if a >= leaves and b >= other_leaves:
            first, last = bodies.box_rows[root + b, 0], bodies.box_rows[root + b, 1]
            for t in range(first, last):
                _place_triangle(bodies, t, pose, stretch, placed, t - first)
            for s in range(bodies.box_rows[base + a, 0], bodies.box_rows[base + a, 1]):
                for t in range(first, last):
                    skin = bodies.skin[s] + bodies.skin[t] * stretch
                    square, feature, _ = nearest_features(
                        bodies.corner, s, placed, t - first, work.points, reach / unit + skin, True
                    )
                    apart = math.sqrt(square) - skin
                    if feature < 0:
                        clear = min(clear, apart * apart)
                    elif count >= len(work.found):
                        return -1, 0.0
                    else:
                        work.found[count, 0], work.found[count, 1], work.found_apart[count] = s, t, apart * unit
                        count += 1
            continue
        if a < leaves and (b >= other_leaves or _is_larger(bodies, base + a, root + b, stretch)):
            stack[depth, 0], stack[depth, 1] = 2 * a + 1, b
            stack[depth + 1, 0], stack[depth + 1, 1] = 2 * a + 2, b
        else:
            stack[depth, 0], stack[depth, 1] = a, 2 * b + 1
            stack[depth + 1, 0], stack[depth + 1, 1] = a, 2 * b + 2
        depth += 2
    return count, math.sqrt(clear) * unit


@bare_kernel
def _is_larger(bodies, a, b, stretch):  # type: ignore[no-untyped-def]
    """Return whether the sum of the edges of box a is larger than that of box b."""
    wide = 0.0
    for r in range(3):
        wide += bodies.high[a, r] - bodies.low[a, r] - stretch * (bodies.high[b, r] - bodies.low[b, r])
    return wide >= 0.0


@bare_kernel
def near_triangles(grains, bodies, work, p, i, j, margin):  # type: ignore[no-untyped-def]
    """List in `work.found` the pairs of triangles that may be within a margin; return their number, -1 if too many.

    The pose is in `work.now`. Returns too the distance that all others have at least.
    """
    pose, key, old = work.now, work.key[p, 1], work.pose[p, 1]
    if is_kept(key, i, j):
        way = motion_since(pose, old, grains.radius[i], grains.radius[j])
        if old[14] - way > margin:
            count = 0
            for q in range(key[2]):
                if work.apart[p, q] - way <= margin:
                    work.found[count, 0], work.found[count, 1] = work.near[p, q, 0], work.near[p, q, 1]
                    count += 1
            return count, old[14] - way
    one, other = grains.shape[i], grains.shape[j]
    slack = min(SLACK + 0.5 * margin, 0.05 * min(grains.radius[i], grains.radius[j]))
    count, clear = _list_triangles(bodies, work, one, other, margin + slack)
    if count < 0 or count > NEAR:
        # what is beyond the margin only may be too much to be kept
        count, clear = _list_triangles(bodies, work, one, other, margin)
    key[0], key[1], key[2] = i, j, count if count <= NEAR else -1
    copy_numbers(old, pose)
    old[14] = clear
    for q in range(min(count, NEAR)):
        work.near[p, q, 0], work.near[p, q, 1], work.apart[p, q] = (
            work.found[q, 0],
            work.found[q, 1],
            work.found_apart[q],
        )
    return count, clear


@bare_kernel
def exact_candidates(grains, bodies, work, count, i, j, margin):  # type: ignore[no-untyped-def]
    """Write the contact points of listed pairs of triangles; return their number and the exact gap.

    The gap is -1e9 where triangles cross or the center of a sphere lies in a mesh, and 1e9 where none are within the
    margin.
    """
    pose, points, placed = work.now, work.points, work.placed
    stretch, unit, turn = pose[13] / pose[12], pose[12], grains.matrix[i]
    solid_i, solid_j = bodies.solid[grains.shape[i]], bodies.solid[grains.shape[j]]
    pierce = solid_i != 0 and solid_j != 0
    spare, k, low, best = work.candidate[len(work.candidate) - 1], 0, 1e9, 1e9
    for q in range(count):
        s, t = work.found[q, 0], work.found[q, 1]
        _place_triangle(bodies, t, pose, stretch, placed, 0)
        skin = bodies.skin[s] + bodies.skin[t] * stretch
        square, mine, theirs = nearest_features(bodies.corner, s, placed, 0, points, margin / unit + skin, pierce)
        if mine < 0:
            continue
        length = math.sqrt(square)
        if length == 0.0:
            return 0, -1e9
        gap = (length - skin) * unit
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
        low = min(low, gap)
        best = min(best, gap) if good else best
        row = work.candidate[k] if good else spare
        inner = bodies.skin[s]
        x, y, z = points[0] + inner * dx, points[1] + inner * dy, points[2] + inner * dz
        for r in range(3):
            row[r] = unit * (turn[r, 0] * x + turn[r, 1] * y + turn[r, 2] * z)
            row[3 + r] = turn[r, 0] * dx + turn[r, 1] * dy + turn[r, 2] * dz
        row[6] = gap
        k += 1 if good else 0
    if low < best:
        # rounding may leave the nearest points out of their cones
        copy_numbers(work.candidate[k], spare)
        k += 1
    return k, low


@bare_kernel
def _holds(bodies, work, body, x, y, z):  # type: ignore[no-untyped-def]
    """Return whether the triangles of a body enclose a point in its frame."""
    first, last = bodies.box_first[body], bodies.box_first[body + 1]
    low, high = bodies.low[first], bodies.high[first]
    if bodies.solid[body] == 0 or x < low[0] or y < low[1] or z < low[2] or x > high[0] or y > high[1] or z > high[2]:
        return False
    _, k, feature, px, py, pz = search_triangles(
        bodies.corner, bodies.low[first:last], bodies.high[first:last], bodies.box_rows[first:last], x, y, z, 1e100,
        work.listed[0],
    )  # fmt: skip
    return is_behind(bodies.pseudo, k, feature, x - px, y - py, z - pz)


@bare_kernel
def _is_inside(bodies, work, i, j, shape):  # type: ignore[no-untyped-def]
    """Return whether a grain, whose surface does not cross that of the other, lies in it: a corner or a sphere of it."""
    pose = work.now
    one, other = shape[i], shape[j]
    mine, theirs = bodies.corner_first[one], bodies.corner_first[other]
    for s in range(mine, bodies.corner_first[one + 1] if bodies.solid[one] == 0 else mine + 1):
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
    for t in range(theirs, bodies.corner_first[other + 1] if bodies.solid[other] == 0 else theirs + 1):
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
    count, clear = near_triangles(grains, bodies, work, p, i, j, margin)
    if count < 0:
        # more triangles than fit are near each other only where grains lie deep in each other
        return 0, -1e9
    k, low = exact_candidates(grains, bodies, work, count, i, j, margin)
    if k == 0 and low > 0.0:
        if _is_inside(bodies, work, i, j, grains.shape):
            return 0, -1e9
        # listed pairs are all beyond the margin now
        return 0, clear if count == 0 else min(clear, margin)
    return k, low


@bare_kernel
def _crossing_candidates(grains, bodies, work, p, i, j, offset, margin):  # type: ignore[no-untyped-def]
    """Write candidates of a pair that overlaps, from the grids, the least gap at most 0; return number and gap."""
    k, low = field_candidates(grains, bodies, work, p, i, j, offset, margin + OVERSIGHT)
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


@kernel
def find_triangle_contacts(grains, bodies, work, pairs, size, rows, m, margin, rest):  # type: ignore[no-untyped-def]
    """Write the exact contacts of the pairs with a non-convex mesh from row m on; return the new number of rows.

    Arguments and the value -1 are those of :func:`voxgran.settling.surface_contacts.find_surface_contacts`; the room of
    a pair is not subtracted. What is remembered does not depend on `pairs.bound`, which is written, not read: of the
    other finder it would be too large.
    """
    offset = work.offset
    for p in range(size):
        i, j = pairs.i[p], pairs.j[p]
        work.saved[p, 0] = -1
        if max(grains.kind[i], grains.kind[j]) != SURFACE:
            continue
        first, count = pairs.first[p], pairs.count[p]
        work.saved[p, 0], work.saved[p, 1] = first, count
        pairs.first[p], pairs.count[p] = m, 0
        square = 0.0
        for r in range(3):
            offset[r] = grains.position[j, r] + pairs.shift[p, r] - grains.position[i, r]
            square += offset[r] * offset[r]
        pairs.way[p] = grains.way[i] + grains.way[j]
        reach = grains.radius[i] + grains.radius[j]
        if square > (reach + margin) ** 2:
            pairs.bound[p] = math.sqrt(square) - reach
            continue
        write_pose(grains, i, j, pairs.shift[p], work.now)
        k, low = _exact_pair(grains, bodies, work, p, i, j, margin)
        if low == -1e9:
            k, low = _crossing_candidates(grains, bodies, work, p, i, j, offset, margin)
        pairs.bound[p] = low
        if k == 0:
            continue
        spacing = spacing_of(grains.radius[i], grains.radius[j])
        after = write_spread(rows, m, i, j, offset, work.candidate, k, MOST, margin, rest, spacing, first, count)
        if after < 0:
            restore(pairs, work.saved, p)
            return -1
        for r in range(3):
            pairs.normal[p, r] = rows.row[m, r]
        pairs.count[p] = after - m
        m = after
    return m


@kernel
def prove_separate(grains, bodies, work, pairs, size, reach, gap, proven):  # type: ignore[no-untyped-def]
    """Write which pairs with a non-convex mesh are proven to be separate; return the number of those that are not.

    grains, bodies, work, pairs, size: as :func:`find_triangle_contacts`.  reach: distance up to which gaps are wanted.
    gap: (cap,) exact distances of the surfaces, infinite beyond reach, minus infinity where they cross or one grain
    lies in the other; of spheres and of tessellated primitives a lower bound.  proven: (cap,) of bool; rows of other
    pairs are left as they are.  A pair of which nothing was near is looked at again only when the grains have moved.
    """
    bad = 0
    for p in range(size):
        i, j = pairs.i[p], pairs.j[p]
        if max(grains.kind[i], grains.kind[j]) != SURFACE:
            continue
        square, radii = 0.0, grains.radius[i] + grains.radius[j]
        for r in range(3):
            square += (grains.position[j, r] + pairs.shift[p, r] - grains.position[i, r]) ** 2
        gap[p], proven[p] = math.inf, True
        if square > (radii + reach) ** 2:
            continue
        write_pose(grains, i, j, pairs.shift[p], work.now)
        rounding = ROUNDING * (radii + math.sqrt(square))
        near = max(reach, 4.0 * rounding)
        _, low = _exact_pair(grains, bodies, work, p, i, j, near)
        gap[p] = -math.inf if low == -1e9 else (low if low <= reach else math.inf)
        proven[p] = low > 2.0 * rounding
        bad += 0 if proven[p] else 1
    return bad
