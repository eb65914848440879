"""Pairs of triangles of two surfaces that are near each other.

They are listed by a traversal of both box trees, with bounds of the distance from the grids, and the list is kept until
the grains have moved.
"""

import math

from voxgran._base.kernels import bare_kernel
from voxgran.settling.contact_rows import Grains
from voxgran.settling.finding.distance_grids import SurfaceBodies
from voxgran.settling.finding.surface_contacts import grid_bound, write_turn
from voxgran.settling.finding.surface_memory import NEAR, SurfaceWork, copy_numbers, is_kept, motion_since
from voxgran.settling.finding.triangle_features import nearest_features, place_triangle

#: distance beyond the margin within which triangles are listed
SLACK = 2e-3


@bare_kernel
def _list_leaves(  # type: ignore[no-untyped-def]
    ball, root, leaves, turn, mine, theirs, grid, at, frame, corner, skin, first, last, reach, stack, listed,
):  # fmt: skip
    """List the leaves of a tree within reach of the surface of a body; return their number and a bound of the others.

    ball: spheres around the boxes of all trees, of which this one starts at `root`.  turn: its map to the cells of the
    body.  mine, theirs: scales of the body and of the tree.
    """
    clear, count, depth = 1e9, 0, 1
    stack[0] = 0
    while depth > 0:
        depth -= 1
        node = stack[depth]
        k = root + node
        px, py, pz = ball[k, 0], ball[k, 1], ball[k, 2]
        x = turn[0] * px + turn[1] * py + turn[2] * pz + turn[9]
        y = turn[3] * px + turn[4] * py + turn[5] * pz + turn[10]
        z = turn[6] * px + turn[7] * py + turn[8] * pz + turn[11]
        apart = grid_bound(grid, at, frame, corner, skin, first, last, x, y, z) * mine - ball[k, 3] * theirs
        if apart > reach:
            clear = min(clear, apart)
        elif node < leaves:
            stack[depth], stack[depth + 1] = 2 * node + 2, 2 * node + 1
            depth += 2
        else:
            listed[count] = k
            count += 1
    return count, clear


@bare_kernel
def _heights(corner, s, normal, x, y, z, points):  # type: ignore[no-untyped-def]
    """Return the least and the largest height of three points over the plane through (x, y, z) with a unit normal."""
    low, high = 1e300, -1e300
    for c in range(3):
        height = (
            normal[0] * (corner[s, c, 0] - x) + normal[1] * (corner[s, c, 1] - y) + normal[2] * (corner[s, c, 2] - z)
        )
        low, high = min(low, height), max(high, height)
    return low, high


@bare_kernel
def _faces_away(corner, pseudo, s, t, pose, placed, slack, limit, points):  # type: ignore[no-untyped-def]
    """Return whether triangles s of i and placed[0], t of j, are no place of a least distance within a limit.

    At the places where the distance is least, there are faces at both that see the other: triangles that lie behind the
    plane of the other by more than the slack are not among them. Nor are those above it by more than the limit.
    """
    low, high = _heights(placed, 0, pseudo[s, 0], corner[s, 0, 0], corner[s, 0, 1], corner[s, 0, 2], points)
    if high < -slack or low > limit:
        return True
    x, y, z = pseudo[t, 0, 0], pseudo[t, 0, 1], pseudo[t, 0, 2]
    normal = points[9:12]
    for r in range(3):
        normal[r] = pose[3 + 3 * r] * x + pose[4 + 3 * r] * y + pose[5 + 3 * r] * z
    low, high = _heights(corner, s, normal, placed[0, 0, 0], placed[0, 0, 1], placed[0, 0, 2], points)
    return high < -slack or low > limit


@bare_kernel
def _pair_leaves(  # type: ignore[no-untyped-def]
    corner, skin, pseudo, ball, box_rows, pose, mine, many, theirs, others, reach, slack, placed, points, center,
    found, found_apart,
):  # fmt: skip
    """List the pairs of triangles within reach, in lengths of the bed, of two lists of leaves.

    Returns their number, or -1 if triangles cross or are too many. Pairs that face away from each other are left out.
    """
    stretch, unit, count = pose[13] / pose[12], pose[12], 0
    for m in range(others):
        k = theirs[m]
        x, y, z = ball[k, 0] * stretch, ball[k, 1] * stretch, ball[k, 2] * stretch
        for r in range(3):
            center[m, r] = pose[r] / unit + pose[3 + 3 * r] * x + pose[4 + 3 * r] * y + pose[5 + 3 * r] * z
        center[m, 3] = ball[k, 3] * stretch + reach / unit
    for n in range(many):
        a = mine[n]
        for m in range(others):
            square = (center[m, 0] - ball[a, 0]) ** 2 + (center[m, 1] - ball[a, 1]) ** 2
            square += (center[m, 2] - ball[a, 2]) ** 2
            if square > (center[m, 3] + ball[a, 3]) ** 2:
                continue
            b = theirs[m]
            for t in range(box_rows[b, 0], box_rows[b, 1]):
                x, y, z = skin[t, 1] * stretch, skin[t, 2] * stretch, skin[t, 3] * stretch
                cx = pose[0] / unit + pose[3] * x + pose[4] * y + pose[5] * z
                cy = pose[1] / unit + pose[6] * x + pose[7] * y + pose[8] * z
                cz = pose[2] / unit + pose[9] * x + pose[10] * y + pose[11] * z
                radius = skin[t, 4] * stretch + reach / unit
                square = (ball[a, 0] - cx) ** 2 + (ball[a, 1] - cy) ** 2 + (ball[a, 2] - cz) ** 2
                if square > (ball[a, 3] + radius) ** 2:
                    continue
                place_triangle(corner, t, pose, stretch, placed, 0)
                for s in range(box_rows[a, 0], box_rows[a, 1]):
                    square = (skin[s, 1] - cx) ** 2 + (skin[s, 2] - cy) ** 2 + (skin[s, 3] - cz) ** 2
                    both = skin[s, 0] + skin[t, 0] * stretch
                    limit = reach / unit + both
                    if square > (skin[s, 4] + radius) ** 2:
                        continue
                    if _faces_away(corner, pseudo, s, t, pose, placed, slack / unit, limit, points):
                        continue
                    square, feature, _ = nearest_features(corner, s, placed, 0, points, limit, both == 0.0)
                    if feature < 0:
                        continue
                    if count >= len(found) or (both == 0.0 and square == 0.0):
                        return -1
                    found[count, 0], found[count, 1] = s, t
                    found_apart[count] = (math.sqrt(square) - both) * unit
                    count += 1
    return count


@bare_kernel
def _list_triangles(grains, bodies, work, i, j, reach, slack):  # type: ignore[no-untyped-def]
    """List the pairs of triangles within reach of a pair whose pose is in `work.now`.

    Returns their number, -1 if they cross, and the distance that all others have at least.
    """
    clear, many, others = 1e9, 0, 0
    for way in range(2):
        one, other = (grains.shape[i], grains.shape[j]) if way == 0 else (grains.shape[j], grains.shape[i])
        write_turn(bodies.frame[one], way, work.now, work.turn[way])
        root = bodies.first[other, 4]
        count, apart = _list_leaves(
            bodies.ball, root, (bodies.first[other + 1, 4] - root) // 2, work.turn[way],
            work.now[12 + way], work.now[13 - way], bodies.grid, bodies.first[one, 2], bodies.frame[one], bodies.corner,
            bodies.skin, bodies.first[one, 3], bodies.first[one + 1, 3], reach, work.stack, work.listed[way],
        )  # fmt: skip
        clear = min(clear, apart)
        if count == 0:
            return 0, clear
        if way == 0:
            others = count
        else:
            many = count
    count = _pair_leaves(
        bodies.corner, bodies.skin, bodies.pseudo, bodies.ball, bodies.box_rows, work.now, work.listed[1], many,
        work.listed[0], others, reach, slack, work.placed, work.points, work.candidate, work.found, work.found_apart,
    )  # fmt: skip
    return count, min(clear, reach)


@bare_kernel
def near_triangles(
    grains: Grains, bodies: SurfaceBodies, work: SurfaceWork, p: int, i: int, j: int, margin: float,
) -> tuple[int, float]:  # fmt: skip
    """List in `work.found` the pairs of triangles that may be within a margin; return their number, -1 if they cross.

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
    slack = min(SLACK + 0.25 * margin, 0.02 * min(grains.radius[i], grains.radius[j]))
    count, clear = _list_triangles(grains, bodies, work, i, j, margin + slack, slack)
    key[0], key[1], key[2] = i, j, -1
    # of more triangles than can be kept the nearer ones are
    for _ in range(4):
        kept = 0
        for q in range(count):
            kept += 1 if work.found_apart[q] <= margin + slack else 0
        if kept <= NEAR:
            break
        slack *= 0.5
        clear = min(clear, margin + slack)
    if count < 0 or kept > NEAR:
        return count, clear
    key[2] = kept
    copy_numbers(old, pose, 14)
    old[14] = clear
    kept = 0
    for q in range(count):
        if work.found_apart[q] <= margin + slack:
            work.near[p, kept, 0], work.near[p, kept, 1] = work.found[q, 0], work.found[q, 1]
            work.apart[p, kept] = work.found_apart[q]
            kept += 1
    return count, clear
