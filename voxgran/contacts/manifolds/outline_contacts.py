"""Contacts of polygons with polygons and disks, in the plane.

Surfaces that are apart are nearest at a corner of one of them. Each corner near the other polygon is compared with its
edges, so that edges that lie on each other have two contacts, and a corner in a notch one with each of its sides.
Convex polygons that overlap are pushed apart across the edge by which that takes the shortest way.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.contacts.manifolds.blocks import Blocks, pairs_of_kind
from voxgran.contacts.manifolds.candidates import add_candidate, choose_candidates, is_candidate, write_candidates
from voxgran.contacts.manifolds.rows import OUTLINE, ContactRows, Search, begin_pair
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline

#: most contacts of a pair
MOST = 6
#: edges of a polygon that one point touches, at most
EDGES = 3
#: cosine of the normals of two edges above which they count as one
ONE_EDGE = 0.98
#: least distance of contacts where there are many, in diameters of the smaller shape
SPREAD = 0.1


class OutlineBodies(NamedTuple):
    """Disks and polygons as their contacts need them, and work space.

    start: (s + 1,) first corner of each shape, and vertex: (v, 2) corners of the polygons, counterclockwise.
    center, radius: (s, 2) and (s,) of disks; the radius of a polygon is 0.  spread: (s,) least distance of contacts.
    convex: (s,) 1 for polygons that are convex.  placed: (2, v, 2) corners of a pair.  found: (k, 8) candidates.
    seen: (3, 4) edge points and normals.
    """

    start: Integers
    vertex: Floats
    center: Floats
    radius: Floats
    spread: Floats
    convex: Integers
    placed: Floats
    found: Floats
    seen: Floats


#: arrays of these that each thread has for itself
SCRATCH = ("placed", "found", "seen")


def outline_bodies(shapes: tuple[Shape, ...]) -> Blocks[OutlineBodies]:
    """Return the tables of shapes in the plane; those of other shapes are empty.

    Parameters
    ----------
    shapes : tuple of Shape
        Shapes of the grains; s of them.

    Returns
    -------
    OutlineBodies
        Tables in the unit of lengths of the shapes.
    """
    vertices, center, radius = [np.zeros((0, 2))], np.zeros((len(shapes), 2)), np.zeros(len(shapes))
    for k, shape in enumerate(shapes):
        geometry = shape.geometry
        vertices.append(geometry.vertices if isinstance(geometry, Outline) else np.zeros((0, 2)))
        if isinstance(geometry, Outline) and geometry.kind == "disk":
            center[k], radius[k] = geometry.center, geometry.radius
    counts = [len(item) for item in vertices]
    spread = np.array([SPREAD * shape.diameter for shape in shapes])
    most, convex = max(counts), np.array([_is_convex(item) for item in vertices[1:]], dtype=np.int64)
    bodies = OutlineBodies(
        *(np.cumsum(counts).astype(np.int64), np.concatenate(vertices), center, radius, spread, convex),
        *(np.zeros((2, most, 2)), np.zeros((2 * EDGES * most + 64, 8)), np.zeros((EDGES, 4))),
    )
    return Blocks(bodies, SCRATCH)


def _is_convex(vertex: Floats) -> bool:
    """Return whether corners (v, 2), counterclockwise, are those of a convex polygon, up to rounding."""
    ahead = np.roll(vertex, -1, axis=0) - vertex
    after = np.roll(ahead, -1, axis=0)
    turn = ahead[:, 0] * after[:, 1] - ahead[:, 1] * after[:, 0]
    return len(vertex) > 2 and bool((turn >= -1e-9 * np.abs(vertex).max() ** 2).all())


def find_outline_contacts(search: Search, bodies: Blocks[OutlineBodies], rows: ContactRows, m: int) -> int:
    """Write where polygons are near polygons and disks, from row m; return the next row, or -1 where rows are full.

    A contact has the normal from i to j, the arms of a point on each surface, and the gap minus the rest distance and
    the room of the pair, which is at most the margin. Gaps of grains that are apart are exact; where a corner is inside
    the other grain the gap is minus its distance from the nearest edge. Pairs of two disks are left alone.

    Parameters
    ----------
    search : Search
        Grains, not wrapped along periodic axes, and near pairs. Of those with a polygon `first` and `count` are
        replaced, and of those that are looked at also `bound` (the gap, or a lower bound) and `way`.
    bodies : OutlineBodies
        Tables of the shapes.
    rows : ContactRows
        Rows that are written.
    m : int
        First row.

    Returns
    -------
    int
        The row after the last one; -1 where the rows are full: what was known of pairs is then to be restored.
    """
    return bodies.find(_find, search, rows, m, chosen=pairs_of_kind(search.grains, search.pairs, OUTLINE))


@kernel
def _find(search, bodies, rows, m, begin, end):  # type: ignore[no-untyped-def]
    """Write the contacts of the pairs from `begin` to `end` - 1; return the next row, or -1."""
    grains, pairs = search.grains, search.pairs
    for p in range(begin, end):
        near, pair = begin_pair(search, p, m, OUTLINE, search.margin + search.rest + pairs.room[p])
        if not near:
            continue
        i, j = pair.i, pair.j
        # gaps are known beyond the reach, so that the pair can be passed over for a while
        least, kept, found = pair.reach + search.margin, 0, bodies.found
        for k in range(_near_pair(grains, bodies, i, j, pair.offset[0], pair.offset[1], least)):
            least = min(least, found[k, 6])
            if found[k, 6] <= pair.reach:
                for column in range(7):
                    found[kept, column] = found[k, column]
                kept += 1
        pairs.bound[p] = least
        spread = min(bodies.spread[grains.shape[i]] * grains.scale[i], bodies.spread[grains.shape[j]] * grains.scale[j])
        kept = choose_candidates(found, kept, MOST, spread)
        m = write_candidates(rows, m, pair, found, kept)
        if m < 0:
            return -1
        pairs.count[p] = kept
    return m


@bare_kernel
def _near_pair(grains, bodies, i, j, ox, oy, reach):  # type: ignore[no-untyped-def]
    """Write the candidates of a pair, relative to the centroid of i; return how many there are."""
    one, other = grains.shape[i], grains.shape[j]
    ni = _place(grains, bodies, i, 0, 0.0, 0.0)
    nj = _place(grains, bodies, j, 1, ox, oy)
    c = 0
    for side in range(2):
        # corners or the disk of this side against the edges of the other
        mine, its, many, most = side, 1 - side, ni if side == 0 else nj, nj if side == 0 else ni
        shape, grain = (one, i) if side == 0 else (other, j)
        if most == 0:
            continue
        radius = bodies.radius[shape] * grains.scale[grain]
        far = (grains.radius[j] if side == 0 else grains.radius[i]) + reach + radius
        x0, y0 = (ox, oy) if side == 0 else (0.0, 0.0)
        sign = -1.0 if side == 0 else 1.0
        for k in range(many if many > 0 else 1):
            if many > 0:
                x, y = bodies.placed[mine, k, 0], bodies.placed[mine, k, 1]
            else:
                x, y = _disk_center(grains, bodies, grain)
                if side == 1:
                    x, y = x + ox, y + oy
            if (x - x0) ** 2 + (y - y0) ** 2 <= far * far:
                c = _near_point(bodies, c, its, most, x, y, radius, sign, reach)
    if bodies.convex[one] == 1 and bodies.convex[other] == 1:
        return _parted(bodies, c, ni, nj, reach)
    if ni > 0 and nj > 0:
        c = _crossing(bodies, c, ni, nj, ox, oy)
    return c


@bare_kernel
def _parted(bodies, c, ni, nj, reach):  # type: ignore[no-untyped-def]
    """Put contacts across the edge by which the shortest way parts two convex polygons in the place of the candidates.

    The edge nearest to a corner that is inside may be another one: near the common end of two edges that lie on each
    other it would push the polygons along these edges. Where the polygons do not overlap the candidates stay.
    """
    best, side, at = -math.inf, 0, 0
    for mine in range(2):
        many, others = (ni, nj) if mine == 0 else (nj, ni)
        for k in range(many):
            nx, ny = _edge_normal(bodies.placed[mine], many, k)
            least = math.inf
            for q in range(others):
                dx = bodies.placed[1 - mine, q, 0] - bodies.placed[mine, k, 0]
                dy = bodies.placed[1 - mine, q, 1] - bodies.placed[mine, k, 1]
                least = min(least, dx * nx + dy * ny)
            if least >= 0.0:
                return c
            if least > best:
                best, side, at = least, mine, k
    many, others = (ni, nj) if side == 0 else (nj, ni)
    edge, facing, opposite = bodies.placed[side], bodies.placed[1 - side], math.inf
    nx, ny = _edge_normal(edge, many, at)
    met = 0
    for q in range(others):
        mx, my = _edge_normal(facing, others, q)
        if nx * mx + ny * my < opposite:
            opposite, met = nx * mx + ny * my, q
    # the deepest corner is an end of the edge that faces this one; both ends may lie beyond those of this edge, the
    # deepest one only where the edges are parallel
    end, last = (at + 1) % many, (met + 1) % others
    if (facing[last, 0] - facing[met, 0]) * nx + (facing[last, 1] - facing[met, 1]) * ny < 0.0:
        met, last = last, met
    px, py = facing[met, 0], facing[met, 1]
    ux, uy, near, far = facing[last, 0] - px, facing[last, 1] - py, 0.0, 1.0
    slope = ux * ny - uy * nx
    if slope != 0.0:
        one = ((edge[at, 0] - px) * ny - (edge[at, 1] - py) * nx) / slope
        other = ((edge[end, 0] - px) * ny - (edge[end, 1] - py) * nx) / slope
        far = max(min(max(one, other), 1.0), 0.0)
        near = min(max(min(one, other), 0.0), far)
    sign, c = 1.0 if side == 0 else -1.0, 0
    for turn in range(2):
        share = near if turn == 0 else far
        x, y = px + share * ux, py + share * uy
        gap = (x - edge[at, 0]) * nx + (y - edge[at, 1]) * ny
        if turn == 1 and (gap > reach or far == near):
            break
        # the point on the surface of i: that of its edge, or of the facing one
        ax, ay = (x - gap * nx, y - gap * ny) if side == 0 else (x, y)
        c = add_candidate(bodies.found, c, (ax, ay, 0.0), (sign * nx, sign * ny, 0.0), gap)
    return c


@bare_kernel
def _place(grains, bodies, grain, side, x, y):  # type: ignore[no-untyped-def]
    """Write the corners of a polygon whose centroid is at (x, y); return how many they are."""
    m, scale, shape = grains.matrix[grain], grains.scale[grain], grains.shape[grain]
    first = bodies.start[shape]
    many = bodies.start[shape + 1] - first
    for k in range(many):
        u, v = bodies.vertex[first + k, 0], bodies.vertex[first + k, 1]
        bodies.placed[side, k, 0] = x + scale * (m[0, 0] * u + m[0, 1] * v)
        bodies.placed[side, k, 1] = y + scale * (m[1, 0] * u + m[1, 1] * v)
    return many


@bare_kernel
def _disk_center(grains, bodies, grain):  # type: ignore[no-untyped-def]
    """Return the center of a disk relative to its centroid."""
    m, scale, shape = grains.matrix[grain], grains.scale[grain], grains.shape[grain]
    u, v = bodies.center[shape, 0], bodies.center[shape, 1]
    return scale * (m[0, 0] * u + m[0, 1] * v), scale * (m[1, 0] * u + m[1, 1] * v)


@bare_kernel
def _near_point(bodies, c, its, most, x, y, radius, sign, reach):  # type: ignore[no-untyped-def]
    """Add the contacts of a corner, or a disk about it, with a polygon; `sign` is -1 where the corner is of grain i.

    The normals found point from the polygon to the corner; those written point from i to j.
    """
    known, inside = 0, False
    while known < EDGES:
        distance, qx, qy, nx, ny = _next_edge(bodies, its, most, x, y, reach + radius, known)
        if distance == math.inf:
            break
        if known == 0 and distance < 0.0:
            inside = True
        gap = distance - radius
        if gap > reach:
            break
        # the point on the surface of i: that of the corner's grain, or of the polygon
        ax, ay = (x - radius * nx, y - radius * ny) if sign < 0.0 else (qx, qy)
        # two corners that face each other are found from both
        arm, normal = (ax, ay, 0.0), (sign * nx, sign * ny, 0.0)
        if not is_candidate(bodies.found, c, arm, normal, 1e-6 * reach):
            c = add_candidate(bodies.found, c, arm, normal, gap)
        if inside:
            break
        seen = bodies.seen[known]
        seen[0], seen[1], seen[2], seen[3] = qx, qy, nx, ny
        known += 1
    return c


@bare_kernel
def _next_edge(bodies, its, most, x, y, reach, known):  # type: ignore[no-untyped-def]
    """Return the signed distance of a point from the nearest edge that those known do not stand for.

    Also the nearest point of the edge, and the normal there. The distance is negative inside, which only the nearest
    edge of all tells, and infinite where no edge is within reach; of the nearest edge it is always known.
    """
    corner, best, at, where = bodies.placed[its], math.inf, -1, 0.0
    limit = math.inf if known == 0 else reach * reach
    fx, fy = x, y
    for k in range(most):
        n = k + 1 if k + 1 < most else 0
        ax, ay = corner[k, 0], corner[k, 1]
        ux, uy = corner[n, 0] - ax, corner[n, 1] - ay
        share = min(max(((x - ax) * ux + (y - ay) * uy) / (ux * ux + uy * uy), 0.0), 1.0)
        qx, qy = ax + share * ux, ay + share * uy
        square = (x - qx) ** 2 + (y - qy) ** 2
        if square >= best or square > limit:
            continue
        if known > 0:
            length, new = math.sqrt(square), ux * (y - ay) - uy * (x - ax) <= 0.0
            for q in range(known):
                old = bodies.seen[q]
                # beyond the tangent of a known point there is no obstacle before that point is
                ahead = (qx - old[0]) * old[2] + (qy - old[1]) * old[3]
                along = (x - qx) * old[2] + (y - qy) * old[3]
                if ahead < 1e-6 * reach or along > ONE_EDGE * length:
                    new = False
            if not new:
                continue
        best, at, where, fx, fy = square, k, share, qx, qy
    if at < 0:
        return math.inf, x, y, 0.0, 0.0
    nx, ny = _edge_normal(corner, most, at)
    if where == 0.0 or where == 1.0:
        neighbour = (at + (1 if where == 1.0 else most - 1)) % most
        ox, oy = _edge_normal(corner, most, neighbour)
        nx, ny = nx + ox, ny + oy
    distance = math.sqrt(best)
    outward = (x - fx) * nx + (y - fy) * ny >= 0.0
    if distance > 1e-14 * (abs(x) + abs(y)):
        sign = 1.0 if outward else -1.0
        nx, ny = sign * (x - fx), sign * (y - fy)
    length = max(math.sqrt(nx * nx + ny * ny), 1e-300)
    return (distance if outward else -distance), fx, fy, nx / length, ny / length


@bare_kernel
def _edge_normal(corner, most, k):  # type: ignore[no-untyped-def]
    """Return the outward normal of an edge of a polygon."""
    n = k + 1 if k + 1 < most else 0
    ux, uy = corner[n, 0] - corner[k, 0], corner[n, 1] - corner[k, 1]
    length = math.sqrt(ux * ux + uy * uy)
    return uy / length, -ux / length


@bare_kernel
def _crossing(bodies, c, ni, nj, ox, oy):  # type: ignore[no-untyped-def]
    """Add a contact where edges of two polygons cross while no corner of one is inside the other, as in a cross.

    Its normal is that of the centroids, and its depth half the distance of the crossings.
    """
    for k in range(c):
        if bodies.found[k, 6] < 0.0:
            return c
    # only edges within the bounds of the other polygon can cross it
    low_x, low_y, high_x, high_y = math.inf, math.inf, -math.inf, -math.inf
    for q in range(nj):
        bx, by = bodies.placed[1, q, 0], bodies.placed[1, q, 1]
        low_x, low_y, high_x, high_y = min(low_x, bx), min(low_y, by), max(high_x, bx), max(high_y, by)
    many, x, y, lx, ly, hx, hy = 0, 0.0, 0.0, math.inf, math.inf, -math.inf, -math.inf
    for k in range(ni):
        n = k + 1 if k + 1 < ni else 0
        ax, ay = bodies.placed[0, k, 0], bodies.placed[0, k, 1]
        ux, uy = bodies.placed[0, n, 0] - ax, bodies.placed[0, n, 1] - ay
        if min(ax, ax + ux) > high_x or max(ax, ax + ux) < low_x or min(ay, ay + uy) > high_y:
            continue
        if max(ay, ay + uy) < low_y:
            continue
        for q in range(nj):
            r = q + 1 if q + 1 < nj else 0
            bx, by = bodies.placed[1, q, 0], bodies.placed[1, q, 1]
            vx, vy = bodies.placed[1, r, 0] - bx, bodies.placed[1, r, 1] - by
            across = ux * vy - uy * vx
            s = (bx - ax) * vy - (by - ay) * vx
            t = (bx - ax) * uy - (by - ay) * ux
            if across < 0.0:
                across, s, t = -across, -s, -t
            if across > 0.0 and 0.0 < s < across and 0.0 < t < across:
                px, py = ax + s / across * ux, ay + s / across * uy
                many, x, y = many + 1, x + px, y + py
                lx, ly, hx, hy = min(lx, px), min(ly, py), max(hx, px), max(hy, py)
    if many == 0:
        return c
    depth = 0.5 * math.sqrt((hx - lx) ** 2 + (hy - ly) ** 2)
    length = math.sqrt(ox * ox + oy * oy)
    nx, ny = (ox / length, oy / length) if length > 0.0 else (1.0, 0.0)
    x, y = x / many + 0.5 * depth * nx, y / many + 0.5 * depth * ny
    return add_candidate(bodies.found, c, (x, y, 0.0), (nx, ny, 0.0), -depth)
