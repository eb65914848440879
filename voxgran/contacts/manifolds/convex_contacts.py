"""Contact points of grains made of convex parts: unions of spheres, other primitives, convex meshes.

Each pair of spheres of two unions within the margin is a contact, in closed form. Of other parts the gap and normal are
those of :mod:`voxgran.contacts.manifolds.convex_distance`, which starts along the normal of the step before; faces that
lie on each other get further contact points (:mod:`voxgran.contacts.manifolds.face_contacts`).
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.contacts.manifolds.blocks import Blocks, pairs_of_kind
from voxgran.contacts.manifolds.convex_bodies import ConvexWork
from voxgran.contacts.manifolds.convex_distance import ellipsoid_gap, part_gap
from voxgran.contacts.manifolds.face_contacts import SAME, write_face_contacts
from voxgran.contacts.manifolds.rows import CONVEX, ContactRows, Grains, Search, begin_pair, write_contact
from voxgran.geometry.vectors import add, along, dot, row_of, sub, times, vector_at


def find_convex_contacts(search: Search, work: Blocks[ConvexWork], rows: ContactRows, m: int) -> int:
    """Write rows m, ... for the pairs of kind `CONVEX`; return the next row.

    Returns -1 if there is no space in `rows`; what was known of pairs is then to be restored.
    """
    place_grains(search.grains, work.arrays)
    chosen = pairs_of_kind(search.grains, search.pairs, CONVEX)
    return work.find(_find, search, rows, m, chosen=chosen)


@kernel
def place_grains(grains: Grains, work: ConvexWork) -> None:
    """Write the corners and rows of all grains, rotated and scaled."""
    bodies = work.bodies
    for i in range(len(grains.shape)):
        s, turn, scale = grains.shape[i], grains.matrix[i], grains.scale[i]
        _place_corners(bodies, s, turn, scale, work, work.first[i])
        kind = bodies.kind[s]
        if kind != 0 and kind != 2 and kind >= 0:
            place_row(bodies.row[s], turn, scale, work.row[i])
            if kind == 1:
                _write_form(work.row[i], work.form[i])


@bare_kernel
def _place_corners(bodies, s, turn, f, work, start):  # type: ignore[no-untyped-def]
    """Write the corners of a shape, rotated and scaled, from row `start`, and their radii."""
    xx, xy, xz = f * turn[0, 0], f * turn[0, 1], f * turn[0, 2]
    yx, yy, yz = f * turn[1, 0], f * turn[1, 1], f * turn[1, 2]
    zx, zy, zz = f * turn[2, 0], f * turn[2, 1], f * turn[2, 2]
    to, corner, placed = start - bodies.first[s], bodies.corner, work.corner
    for q in range(bodies.first[s], bodies.first[s + 1]):
        x, y, z = corner[q, 0], corner[q, 1], corner[q, 2]
        placed[to + q, 0] = xx * x + xy * y + xz * z
        placed[to + q, 1] = yx * x + yy * y + yz * z
        placed[to + q, 2] = zx * x + zy * y + zz * z
        work.radius[to + q] = f * bodies.radius[q]


@bare_kernel
def place_row(row: Floats, turn: Floats, f: float, placed: Floats) -> None:
    """Write the row of an ellipsoid, cylinder or cone, rotated and scaled."""
    placed[0] = row[0]
    for c in range(3):
        placed[1 + c] = f * row[1 + c]
        for d in range(3):
            placed[4 + 3 * c + d] = turn[c, 0] * row[4 + d] + turn[c, 1] * row[7 + d] + turn[c, 2] * row[10 + d]


@bare_kernel
def _write_form(placed, form):  # type: ignore[no-untyped-def]
    """Write the matrix of the quadratic form of an ellipsoid."""
    for c in range(3):
        d, other = (c + 1) % 3, (c + 2) % 3
        form[c], mixed = 0.0, 0.0
        for k in range(3):
            square = placed[1 + k] * placed[1 + k]
            form[c] += square * (placed[4 + 3 * c + k] * placed[4 + 3 * c + k])
            mixed += square * placed[4 + 3 * c + k] * placed[4 + 3 * d + k]
        # xy, yz and zx are numbers 3, 5 and 4
        form[3 if other == 2 else (5 if other == 0 else 4)] = mixed


@kernel
def _find(search, work, rows, m, begin, end):  # type: ignore[no-untyped-def]
    """Write the contacts of the pairs from `begin` to `end` - 1; return the next row, or -1."""
    grains, pairs, bodies = search.grains, search.pairs, work.bodies
    for p in range(begin, end):
        near, pair = begin_pair(search, p, m, CONVEX, search.margin + pairs.room[p])
        if not near:
            continue
        kind_i, kind_j = bodies.kind[grains.shape[pair.i]], bodies.kind[grains.shape[pair.j]]
        normal, gap = pairs.normal[p], _look_of(search, pair)
        if kind_i > 0 and kind_j > 0:
            one, two = _solid(grains, work, pair.i), _solid(grains, work, pair.j)
            start = _first_direction(normal, pair.offset, True)
            m, gap = _touch_two(search, work, rows, m, pair, one, two, start, normal, pairs.corners[p])
        elif kind_i == 0 and kind_j == 0:
            m, gap = _touch_spheres(search, work, rows, m, pair, normal)
        elif kind_i >= 0 and kind_j >= 0:
            m, gap = _touch_union(search, work, rows, m, pair, normal, pairs.corners[p])
        if m < 0:
            return -1
        pairs.bound[p], pairs.count[p] = gap, m - pairs.first[p]
    return m


@inlined_kernel
def _look_of(search, pair):  # type: ignore[no-untyped-def]
    """Return up to which gap gaps are known, so that a pair that is farther apart is not looked at in each step."""
    return pair.reach + search.margin


@bare_kernel
def _select_near(work, i, place, radius, look, selected):  # type: ignore[no-untyped-def]
    """Write which spheres of a union are near a sphere, relative to the centroid; return how many."""
    many = 0
    for q in range(work.first[i], work.first[i + 1]):
        way, reach = sub(row_of(work.corner, q), place), work.radius[q] + radius + look
        if dot(way, way) <= reach * reach:
            selected[many] = q
            many += 1
    return many


@bare_kernel
def _touch_spheres(search, work, rows, m, pair, normal):  # type: ignore[no-untyped-def]
    """Write the contacts of two unions of spheres; return the next row and the gap, and write the normal."""
    look, offset, corner, radius = _look_of(search, pair), pair.offset, work.corner, work.radius
    best, theirs = look, 0
    mine = _select_near(work, pair.i, offset, search.grains.radius[pair.j], look, work.one)
    if mine > 0:
        theirs = _select_near(work, pair.j, times(offset, -1.0), search.grains.radius[pair.i], look, work.two)
    for s in range(mine):
        a = work.one[s]
        for t in range(theirs):
            b = work.two[t]
            way = sub(add(offset, row_of(corner, b)), row_of(corner, a))
            far = radius[a] + radius[b] + look
            square = dot(way, way)
            if square > far * far:
                continue
            distance = math.sqrt(square)
            gap = distance - radius[a] - radius[b]
            n = (0.0, 0.0, 1.0)
            if distance > 0.0:
                n = way[0] / distance, way[1] / distance, way[2] / distance
            if gap < best:
                best = gap
                normal[0], normal[1], normal[2] = n
            if gap >= pair.reach:
                continue
            if m >= len(rows.row):
                return -1, best
            arm = along(row_of(corner, a), radius[a], n)
            other_arm = sub(along(arm, gap, n), offset)
            write_contact(rows, m, pair, n, arm, other_arm, gap - pair.rest, 0.5 * min(radius[a], radius[b]))
            m += 1
    return m, best


@bare_kernel
def _touch_union(search, work, rows, m, pair, normal, corners):  # type: ignore[no-untyped-def]
    """Write the contacts of a union of spheres and a solid; return the next row and the gap."""
    grains, look = search.grains, _look_of(search, pair)
    first = work.bodies.kind[grains.shape[pair.i]] == 0
    # the union, and the solid relative to it
    u, other, sign = (pair.i, pair.j, 1.0) if first else (pair.j, pair.i, -1.0)
    many = _select_near(work, u, times(pair.offset, sign), grains.radius[other], look, work.one)
    solid, best = _solid(grains, work, other), look
    # the normals of several spheres differ from each other
    single = work.first[u + 1] - work.first[u] == 1
    for k in range(many):
        q = work.one[k]
        sphere = (0, u, q, q + 1, 0, work.radius[q])
        start = _first_direction(normal, along(pair.offset, -sign, row_of(work.corner, q)), single)
        one, two = (sphere, solid) if first else (solid, sphere)
        before = vector_at(normal, 0)
        m, gap = _touch_two(search, work, rows, m, pair, one, two, start, normal, corners)
        if m < 0:
            return -1, best
        if gap < best:
            best = gap
        else:
            normal[0], normal[1], normal[2] = before
    return m, best


@inlined_kernel
def _solid(grains, work, i):  # type: ignore[no-untyped-def]
    """Return a grain as a part of `convex_distance`."""
    s, lo = grains.shape[i], work.first[i]
    kind = work.bodies.kind[s]
    return kind, i, lo, work.first[i + 1], work.bodies.first[s], work.radius[lo] if kind == 2 else 0.0


@inlined_kernel
def _first_direction(normal, way, remembered):  # type: ignore[no-untyped-def]
    """Return the normal of the step before, or that from center to center."""
    if remembered and normal[0] <= 1.5:
        return vector_at(normal, 0)
    distance = math.sqrt(dot(way, way))
    if distance > 0.0:
        return way[0] / distance, way[1] / distance, way[2] / distance
    return 0.0, 0.0, 1.0


@bare_kernel
def _touch_two(search, work, rows, m, pair, one, two, start, normal, corners):  # type: ignore[no-untyped-def]
    """Write the contacts of two parts, and their normal; return the next row and the gap."""
    grains, look, near, offset = search.grains, _look_of(search, pair), work.simplex.near, pair.offset
    kind_i, i, lo_i, _, _, radius_i = one
    kind_j, j, lo_j, _, _, radius_j = two
    thick = min(
        radius_i if kind_i == 0 else work.bodies.thick[grains.shape[i]] * grains.scale[i],
        radius_j if kind_j == 0 else work.bodies.thick[grains.shape[j]] * grains.scale[j],
    )
    if kind_i <= 1 and kind_j <= 1:
        center, place = (0.0, 0.0, 0.0), offset
        if kind_i == 0:
            center = row_of(work.corner, lo_i)
            place = sub(place, center)
        if kind_j == 0:
            place = add(place, row_of(work.corner, lo_j))
        gap, n = ellipsoid_gap(work.form[i], radius_i, work.form[j], radius_j, place, start, look, near)
        near[3], near[4], near[5] = add(center, vector_at(near, 3))
    else:
        gap, n = part_gap(work, one, two, offset, start, thick, look, corners)
    normal[0], normal[1], normal[2] = n
    if gap >= pair.reach:
        return m, gap
    if m >= len(rows.row):
        return -1, gap
    arm = along(vector_at(near, 3), radius_i, n)
    write_contact(rows, m, pair, n, arm, sub(along(arm, gap, n), offset), gap - pair.rest, SAME * thick)
    m += 1
    if kind_i >= 2 and kind_j >= 2:
        m = write_face_contacts(grains, work, rows, m, pair, n, thick)
    return m, gap
