"""Lists of the pairs of triangles, of two grains, that may be within a distance, kept until the grains have moved.

Leaves of the tree of boxes of each grain that are near the surface of the other are found with its grid of distances.
Their triangles are sorted out by heights along a few directions, and pairs of them by their bounding spheres and by
the planes of the triangles and those through their edges. Each of these tests gives a lower bound of the distance,
which is kept with the pair: the nearest points are computed only where the bound, less the motion since, is within the
margin.
"""

import math

from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.contacts.manifolds.rows import Grains
from voxgran.contacts.manifolds.surface_contacts import grid_bound, to_cells, write_turn
from voxgran.contacts.manifolds.surface_memory import (
    LOST,
    NEAR,
    SurfaceWork,
    copy_numbers,
    is_kept,
    motion_since,
    way_gone,
)

#: distance beyond the margin within which triangles are listed, in median diameters and in radii of the smaller grain
SLACK, SLACK_OF_RADIUS = 8e-3, 0.02
#: triangles of one grain that are looked at together
GROUP = 8


@bare_kernel
def _list_leaves(work, way, body, guest, reach):  # type: ignore[no-untyped-def]
    """List the leaves of the tree of a guest within reach of the surface of a body.

    way: 0 where the body is that of grain i, 1 where it is that of j.  Returns their number and a bound of the others.
    """
    bodies, turn, nodes, listed = work.bodies, work.turn[way], work.listed[1 - way], work.listed[way]
    sphere, mine, theirs = bodies.sphere, work.now[12 + way], work.now[13 - way]
    root = bodies.first[guest, 4]
    leaves = (bodies.first[guest + 1, 4] - root) // 2
    clear, count, done, end = 1e9, 0, 0, 1
    nodes[0] = 0
    # level by level; whatever is looked at is written, and counts if it is near: no branch waits for a distance
    while done < end:
        node = nodes[done]
        done += 1
        k = root + node
        x, y, z = to_cells(turn, sphere[k, 0], sphere[k, 1], sphere[k, 2])
        apart = grid_bound(bodies, body, x, y, z) * mine - sphere[k, 3] * theirs
        clear = min(clear, apart if apart > reach else 1e9)
        if node < leaves:
            nodes[end], nodes[end + 1] = 2 * node + 1, 2 * node + 2
            end += 0 if apart > reach else 2
        else:
            listed[count] = k
            count += 0 if apart > reach else 1
    return count, clear


@bare_kernel
def _place_leaves(work, way, count):  # type: ignore[no-untyped-def]
    """Write the triangles of listed leaves: corners, bounding spheres, normals and skins; return how many they are.

    way: 0 for those of j, whose corners are turned to the frame and unit of i.  plane: (t, 21) center (3) and radius of
    the bounding sphere, unit normal (3), skin, height of the plane; room for `_write_sides`.  number: (t,) triangles.
    """
    bodies, listed, pose, move = work.bodies, work.listed[way], work.now, way == 0
    placed, plane, number = work.placed[way], work.plane[way], work.number[way]
    stretch, many = pose[13] / pose[12], 0
    for m in range(count):
        k = listed[m]
        for t in range(bodies.box_rows[k, 0], bodies.box_rows[k, 1]):
            row, skin, normal = plane[many], bodies.skin[t], bodies.pseudo[t, 0]
            for r in range(3):
                if move:
                    a, b, c = pose[3 + 3 * r], pose[4 + 3 * r], pose[5 + 3 * r]
                    at = pose[r] / pose[12]
                    row[r] = at + stretch * (a * skin[1] + b * skin[2] + c * skin[3])
                    row[4 + r] = a * normal[0] + b * normal[1] + c * normal[2]
                    for q in range(3):
                        corner = bodies.corner[t, q]
                        placed[many, q, r] = at + stretch * (a * corner[0] + b * corner[1] + c * corner[2])
                else:
                    row[r], row[4 + r] = skin[1 + r], normal[r]
                    for q in range(3):
                        placed[many, q, r] = bodies.corner[t, q, r]
            row[3], row[7] = (skin[4] * stretch, skin[0] * stretch) if move else (skin[4], skin[0])
            first = placed[many, 0]
            row[8] = row[4] * first[0] + row[5] * first[1] + row[6] * first[2]
            number[many] = t
            many += 1
    return many


@bare_kernel
def _sort_out(placed, plane, number, many, x, y, z, level, sign):  # type: ignore[no-untyped-def]
    """Keep the triangles that reach a level along a unit direction (sign 1: upwards, -1: downwards); return how many.

    The level is that of `_extreme` of the other grain less the reach.
    """
    kept = 0
    for n in range(many):
        high = -1e300
        for c in range(3):
            high = max(high, sign * (x * placed[n, c, 0] + y * placed[n, c, 1] + z * placed[n, c, 2]))
        if high + plane[n, 7] < level:
            continue
        if kept < n:
            for c in range(3):
                for r in range(3):
                    placed[kept, c, r] = placed[n, c, r]
            copy_numbers(plane[kept], plane[n], 9)
            number[kept] = number[n]
        kept += 1
    return kept


@bare_kernel
def _extreme(placed, plane, many, x, y, z, sign):  # type: ignore[no-untyped-def]
    """Return the largest height of triangles with their skins along a unit direction, with a sign."""
    high = -1e300
    for n in range(many):
        for c in range(3):
            height = sign * (x * placed[n, c, 0] + y * placed[n, c, 1] + z * placed[n, c, 2])
            high = max(high, height + plane[n, 7])
    return high


@inlined_kernel
def _least_height(placed, n, x, y, z):  # type: ignore[no-untyped-def]
    """Return the least and the largest height of a triangle along a direction."""
    a = x * placed[n, 0, 0] + y * placed[n, 0, 1] + z * placed[n, 0, 2]
    b = x * placed[n, 1, 0] + y * placed[n, 1, 1] + z * placed[n, 1, 2]
    c = x * placed[n, 2, 0] + y * placed[n, 2, 1] + z * placed[n, 2, 2]
    return min(a, b, c), max(a, b, c)


@bare_kernel
def _write_sides(placed, plane, many):  # type: ignore[no-untyped-def]
    """Write the planes through the edges of triangles, at right angles to them: unit normal outwards (3), height."""
    for n in range(many):
        row = plane[n]
        for c in range(3):
            at, d = 9 + 4 * c, (c + 1) % 3
            px, py, pz = placed[n, c, 0], placed[n, c, 1], placed[n, c, 2]
            ux, uy, uz = placed[n, d, 0] - px, placed[n, d, 1] - py, placed[n, d, 2] - pz
            x, y, z = uy * row[6] - uz * row[5], uz * row[4] - ux * row[6], ux * row[5] - uy * row[4]
            length = math.sqrt(x * x + y * y + z * z)
            part = 1.0 / length if length > 0.0 else 0.0
            row[at], row[at + 1], row[at + 2] = x * part, y * part, z * part
            row[at + 3] = row[at] * px + row[at + 1] * py + row[at + 2] * pz


@inlined_kernel
def _beside(plane, other, m, bound, limit):  # type: ignore[no-untyped-def]
    """Return a lower bound of the distance of triangle m of others from one, by the planes through the edges of it.

    It is at least `bound`, and no more than the first one above the limit.
    """
    for at in (9, 13, 17):
        low, _ = _least_height(other, m, plane[at], plane[at + 1], plane[at + 2])
        bound = max(bound, low - plane[at + 3])
        if bound > limit:
            break
    return bound


@inlined_kernel
def _bound_of(mine, my_plane, n, theirs, their_plane, m, reach, slack):  # type: ignore[no-untyped-def]
    """Return a lower bound of the distance of two triangles with skins, 1e9 if they face away from each other.

    At the places where the distance is least, there are faces at both that see the other: triangles that lie behind the
    plane of the other by more than the slack are not among them.
    """
    one, other = my_plane[n], their_plane[m]
    limit = reach + one[7] + other[7]
    low, high = _least_height(theirs, m, one[4], one[5], one[6])
    bound = max(low - one[8], 0.0)
    if high < one[8] - slack or bound > limit:
        return 1e9
    low, high = _least_height(mine, n, other[4], other[5], other[6])
    bound = max(bound, low - other[8])
    if high < other[8] - slack or bound > limit:
        return 1e9
    bound = _beside(one, theirs, m, bound, limit)
    if bound <= limit:
        bound = _beside(other, mine, n, bound, limit)
    return bound - one[7] - other[7] if bound <= limit else 1e9


@bare_kernel
def _mean_normal(plane, many, others):  # type: ignore[no-untyped-def]
    """Return the sum of the normals of the triangles of i less that of the triangles of j."""
    x, y, z = 0.0, 0.0, 0.0
    for n in range(many):
        x, y, z = x + plane[1, n, 4] / many, y + plane[1, n, 5] / many, z + plane[1, n, 6] / many
    for m in range(others):
        x, y, z = x - plane[0, m, 4] / others, y - plane[0, m, 5] / others, z - plane[0, m, 6] / others
    return x, y, z


@bare_kernel
def _enclose_groups(plane, many, groups):  # type: ignore[no-untyped-def]
    """Write spheres around groups of `GROUP` triangles, which follow each other in a tree: center (3) and radius."""
    for first in range(0, many, GROUP):
        last, sphere = min(first + GROUP, many), groups[first // GROUP]
        for r in range(3):
            low, high = 1e300, -1e300
            for n in range(first, last):
                low, high = min(low, plane[n, r]), max(high, plane[n, r])
            sphere[r] = 0.5 * (low + high)
        sphere[3] = 0.0
        for n in range(first, last):
            square = (plane[n, 0] - sphere[0]) ** 2 + (plane[n, 1] - sphere[1]) ** 2 + (plane[n, 2] - sphere[2]) ** 2
            sphere[3] = max(sphere[3], math.sqrt(square) + plane[n, 3])


@inlined_kernel
def _is_near(sphere, other, wide, behind):  # type: ignore[no-untyped-def]
    """Return whether a sphere reaches another triangle, before its plane and near it, up to `wide` or `behind` it.

    sphere: center (3) and radius, which holds the skin.  other: a row of `plane`.
    """
    x, y, z, radius = sphere[0], sphere[1], sphere[2], sphere[3]
    square = (other[0] - x) ** 2 + (other[1] - y) ** 2 + (other[2] - z) ** 2
    height = other[4] * x + other[5] * y + other[6] * z - other[8]
    return (
        square <= (other[3] + wide + radius) ** 2 and height >= -radius - behind and height <= radius + other[7] + wide
    )


@bare_kernel
def _pair_triangles(work, others, many, unit, reach, slack):  # type: ignore[no-untyped-def]
    """List the pairs of placed triangles that may be within reach; return their number, -1 if they are too many."""
    count = 0
    mine, my_plane, theirs, their_plane = work.placed[1], work.plane[1], work.placed[0], work.plane[0]
    wide, behind, groups = reach / unit, slack / unit, work.candidate
    _enclose_groups(my_plane, many, groups)
    _write_sides(mine, my_plane, many)
    _write_sides(theirs, their_plane, others)
    for m in range(others):
        other = their_plane[m]
        for group in range((many + GROUP - 1) // GROUP):
            if not _is_near(groups[group], other, wide, behind):
                continue
            for n in range(GROUP * group, min(GROUP * group + GROUP, many)):
                one = my_plane[n]
                if not _is_near(one, other, wide, behind):
                    continue
                height = one[4] * other[0] + one[5] * other[1] + one[6] * other[2] - one[8]
                if height < -other[3] - behind or height > other[3] + one[7] + wide:
                    continue
                bound = _bound_of(mine, my_plane, n, theirs, their_plane, m, wide, behind)
                if bound > 1e8:
                    continue
                if count >= len(work.found):
                    return -1
                work.found[count, 0], work.found[count, 1] = work.number[1, n], work.number[0, m]
                work.found_apart[count] = bound * unit
                count += 1
    return count


@bare_kernel
def _list_triangles(grains, work, i, j, reach, slack, nearest):  # type: ignore[no-untyped-def]
    """List the pairs of triangles within reach of a pair whose pose is in `work.now`.

    nearest: a direction (3) from i to j in the frame of i along which they were nearest.  Returns their number, -1 if
    they are too many, and the distance that all others have at least.
    """
    clear, bodies, pose = 1e9, work.bodies, work.now
    unit, many, others = pose[12], 0, 0
    for way in range(2):
        one, other = (grains.shape[i], grains.shape[j]) if way == 0 else (grains.shape[j], grains.shape[i])
        write_turn(bodies.frame[one], way, pose, work.turn[way])
        leaves, apart = _list_leaves(work, way, one, other, reach)
        clear = min(clear, apart)
        if leaves == 0:
            return 0, clear
        count = _place_leaves(work, way, leaves)
        if way == 0:
            others = count
        else:
            many = count
    for turn in range(2):
        x, y, z = pose[0], pose[1], pose[2]
        if turn == 1:
            x, y, z = nearest[0], nearest[1], nearest[2]
            if x == 0.0 and y == 0.0 and z == 0.0:
                x, y, z = _mean_normal(work.plane, many, others)
        length = math.sqrt(x * x + y * y + z * z)
        if length == 0.0:
            continue
        x, y, z = x / length, y / length, z / length
        top = _extreme(work.placed[1], work.plane[1], many, x, y, z, 1.0)
        base = _extreme(work.placed[0], work.plane[0], others, x, y, z, -1.0)
        many = _sort_out(work.placed[1], work.plane[1], work.number[1], many, x, y, z, -base - reach / unit, 1.0)
        others = _sort_out(work.placed[0], work.plane[0], work.number[0], others, x, y, z, -top - reach / unit, -1.0)
    return _pair_triangles(work, others, many, unit, reach, slack), min(clear, reach)


@bare_kernel
def _renew(grains, work, p, i, j, margin):  # type: ignore[no-untyped-def]
    """List the near triangles of a pair, and keep the list; return the number in `work.found`, and a bound of others.

    Without a list that is kept (too many triangles, or no room), `work.key` says so.
    """
    key, old = work.key[p, 1], work.pose[p, 1]
    if not (key[0] == i and key[1] == j):
        old[16] = old[17] = old[18] = 0.0
    slack = min(SLACK, SLACK_OF_RADIUS * min(grains.radius[i], grains.radius[j]))
    count, clear = _list_triangles(grains, work, i, j, margin + slack, slack, old[16:19])
    key[0], key[1], key[2] = i, j, -1
    copy_numbers(old, work.now, 14)
    copy_numbers(work.last[p], work.now, 14)
    old[15], old[19] = -1.0, 0.0
    # of more triangles than can be kept the nearer ones are
    kept = 0
    for _ in range(6):
        kept = 0
        for q in range(count):
            kept += 1 if work.found_apart[q] <= margin + slack else 0
        if kept <= NEAR:
            break
        slack *= 0.5
        clear = min(clear, margin + slack)
    old[14] = clear
    if count < 0 or kept > NEAR:
        return count, clear
    if kept > key[4]:
        room = kept + kept // 4 + 1
        if work.span[0] + room > work.span[1]:
            # what it has of the pool is nothing; how much it wants stands in the place of its first entry
            key[2], key[3], key[4] = LOST, room, 0
            return count, clear
        key[3], key[4] = work.span[0], room
        work.span[0] += room
    key[2] = kept
    to = key[3]
    for q in range(count):
        if work.found_apart[q] <= margin + slack:
            work.near[to, 0], work.near[to, 1] = work.found[q, 0], work.found[q, 1]
            work.apart[to] = work.found_apart[q]
            to += 1
    return count, clear


@bare_kernel
def least_distance(work: SurfaceWork, p: int) -> float:
    """Return a lower bound of the distance of the surfaces of a pair plus its way until now, -1 without a list."""
    key, least = work.key[p, 1], work.pose[p, 1, 14]
    for q in range(key[3], key[3] + key[2]):
        least = min(least, work.apart[q])
    return least if key[2] >= 0 else -1.0


@bare_kernel
def near_triangles(
    grains: Grains, work: SurfaceWork, p: int, i: int, j: int, margin: float
) -> tuple[int, float, float]:
    """List in `work.found` the pairs of triangles that may be within a margin; return their number, -1 if too many.

    The pose is in `work.now`. The third number is the entry in the pool, -1 without one. Returns too the
    distance that all others have at least, and the way that the pair has gone since the list was made.
    """
    key, old = work.key[p, 1], work.pose[p, 1]
    moved = 0.0
    kept = is_kept(key, i, j)
    if kept:
        moved = motion_since(work.now, old, grains.radius[i], grains.radius[j])
        kept = old[14] - moved > margin
    if not kept:
        count, clear = _renew(grains, work, p, i, j, margin)
        if key[2] < 0:
            for q in range(count):
                work.found[q, 2] = -1
            return count, clear, 0.0
        moved = 0.0
    count, way = 0, way_gone(work, p, grains.radius[i], grains.radius[j])
    for q in range(key[3], key[3] + key[2]):
        if work.apart[q] - way <= margin:
            work.found[count, 0], work.found[count, 1], work.found[count, 2] = work.near[q, 0], work.near[q, 1], q
            count += 1
    return count, old[14] - moved, way
