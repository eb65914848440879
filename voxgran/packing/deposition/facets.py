"""The walls of closed meshes and polygons: which triangle a moving sphere touches first, and how far it stays on one.

A sphere rolls exactly on the planes of triangles. On edges and corners that stand out into the container it moves on
the tangent plane by a small step, from which it falls back: its path is approximate there, and the place to which it
comes is exact. It never overlaps them, as they are behind their tangent planes. Edges and corners that do not stand out
are behind triangles and are left out.

Other walls, plane ones and round ones from inside, are those that a sphere touches on a line or a circle.
"""

import math

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import ROUND, UPRIGHT, MeshWalls
from voxgran.geometry.tree import square_to_box
from voxgran.geometry.triangles import closest_on_triangle
from voxgran.geometry.vectors import Vector
from voxgran.packing.deposition.field import (
    CENTER,
    EDGE,
    FACET,
    FIRST,
    KIND,
    MIDDLE,
    REACH,
    SECOND,
    SLIGHT,
    WAY,
    Field,
    Motion,
    touch_sphere,
)
from voxgran.packing.deposition.meetings import LINE, first_root, meet_on_circle, meet_on_line
from voxgran.packing.deposition.tube import ROOTS, next_root, square_on_circle, tube_on_circle

#: step on the tangent plane of an edge or a corner, and how far a sphere goes on beyond the end of a triangle, in radii
HOP, OVER = 0.1, 1e-4
#: distance in radii up to which a triangle is touched
TOUCH = SLIGHT
#: share of the square of a radius by which an edge is passed as if it were not touched
GRAZED = 1e-12
#: sine of the angle above which an edge stands out
SHARP = 1e-9


def standing_out(mesh: MeshWalls) -> NDArray[np.int64]:
    """Return which edges ab, bc, ca and corners a, b, c of the triangles stand out into the container, (m, 6)."""
    corners = mesh.corners
    ends = np.roll(corners, -1, axis=1)
    along = ends - corners
    inward = np.roll(corners, -2, axis=1) - corners
    length = np.maximum((along**2).sum(axis=2, keepdims=True), 1e-300)
    inward = inward - (inward * along).sum(axis=2, keepdims=True) / length * along
    inward /= np.maximum(linear.norm(inward, axis=2, keepdims=True), 1e-300)
    edges = (mesh.normals[:, 1:4] * inward).sum(axis=2) > SHARP
    _, vertex = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    out = np.zeros(int(vertex.max(initial=-1)) + 1, dtype=bool)
    out[vertex[edges]] = True
    out[np.roll(vertex, -1, axis=1)[edges]] = True
    return np.concatenate([edges, out[vertex]], axis=1).astype(np.int64)


@bare_kernel
def touch_facet(field: Field, place: Floats, r: float, row: int, triangle: int) -> bool:
    """Write a contact with a triangle, and return whether the sphere touches it."""
    mesh, contact = field.walls.mesh, field.contacts[row]
    px, py, pz = place[0] + mesh.shift[0], place[1] + mesh.shift[1], place[2] + mesh.shift[2]
    x, y, z, part = closest_on_triangle(mesh.corners, triangle, px, py, pz)
    far = math.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2)
    contact[0], contact[1], contact[2] = (px - x) / far, (py - y) / far, (pz - z) / far
    if part == 0:
        for axis in range(3):
            contact[axis] = -mesh.normals[triangle, 0, axis]
    if field.up == 1:
        contact[2] = 0.0
    contact[CENTER], contact[REACH], contact[KIND] = float(triangle), 0.0, FACET if part == 0 else EDGE
    return far <= r * (1.0 + TOUCH)


@bare_kernel
def still_touched(field: Field, place: Floats, r: float, touching: int) -> int:
    """Drop the contacts with triangles that the sphere has left, and return how many contacts remain."""
    contacts, kept = field.contacts, 0
    for k in range(touching):
        stays = contacts[k, KIND] < FACET or touch_facet(field, place, r, k, int(contacts[k, CENTER]))
        if stays:
            for column in range(contacts.shape[1]):
                contacts[kept, column] = contacts[k, column]
            kept += 1
    return kept


@bare_kernel
def end_on_facets(field: Field, motion: Motion) -> float:
    """Return how far along a motion the sphere stays on the triangles, edges and corners that it keeps."""
    kind, place, r, kept, radius = motion
    contacts, vectors, mesh, end = field.contacts, field.vectors, field.walls.mesh, math.inf
    for k in range(kept):
        if contacts[k, KIND] == EDGE:
            end = min(end, HOP * r if kind == LINE else HOP * r / radius)
        if contacts[k, KIND] != FACET:
            continue
        triangle = int(contacts[k, CENTER])
        for i in range(3):
            gx, gy, gz, length = _across_edge(mesh, triangle, i)
            corner = mesh.corners[triangle, i]
            base = place if kind == LINE else vectors[MIDDLE]
            inside = OVER * r * length
            inside += gx * (base[0] + mesh.shift[0] - corner[0]) + gy * (base[1] + mesh.shift[1] - corner[1])
            inside += gz * (base[2] + mesh.shift[2] - corner[2])
            if kind == LINE:
                rate = gx * vectors[WAY, 0] + gy * vectors[WAY, 1] + gz * vectors[WAY, 2]
                if rate < -SLIGHT * length:
                    end = min(end, max(inside / -rate, 0.0))
            else:
                a = -radius * (gx * vectors[FIRST, 0] + gy * vectors[FIRST, 1] + gz * vectors[FIRST, 2])
                b = -radius * (gx * vectors[SECOND, 0] + gy * vectors[SECOND, 1] + gz * vectors[SECOND, 2])
                end = min(end, first_root(a, b, inside, 0.0))
    return end


@bare_kernel
def _across_edge(mesh, triangle, i):  # type: ignore[no-untyped-def]
    """Return a vector in the plane of a triangle across its edge i, inward, and its length."""
    one, two, normal = mesh.corners[triangle, i], mesh.corners[triangle, (i + 1) % 3], mesh.normals[triangle, 0]
    ex, ey, ez = two[0] - one[0], two[1] - one[1], two[2] - one[2]
    gx, gy, gz = normal[1] * ez - normal[2] * ey, normal[2] * ex - normal[0] * ez, normal[0] * ey - normal[1] * ex
    return gx, gy, gz, math.sqrt(gx * gx + gy * gy + gz * gz)


@bare_kernel
def first_facet(field: Field, motion: Motion, middle: Vector, around: float, end: float) -> tuple[float, int]:
    """Return how far along a motion the first triangle is touched, up to `end`, and its number, -1 for none.

    The sphere keeps within `around` of `middle`.
    """
    mesh = field.walls.mesh
    stack, leaves, best, first = mesh.stack, len(mesh.low) // 2, end, -1
    x, y, z = middle[0] + mesh.shift[0], middle[1] + mesh.shift[1], middle[2] + mesh.shift[2]
    stack[0], depth, square = 0, 1, around * around
    while depth > 0:
        depth -= 1
        node = stack[depth]
        if square_to_box(mesh.low, mesh.high, node, x, y, z) > square:
            continue
        if node < leaves:
            stack[depth], stack[depth + 1] = 2 * node + 1, 2 * node + 2
            depth += 2
            continue
        for triangle in range(mesh.start[node, 0], mesh.start[node, 1]):
            touched = False
            for k in range(motion.kept):
                touched = touched or (field.contacts[k, KIND] >= FACET and int(field.contacts[k, CENTER]) == triangle)
            # a sphere that moves across the normal of a contact comes no nearer to the triangle
            if touched:
                continue
            t = _meet_face(field, motion, triangle)
            for part in range(3):
                if field.edges[triangle, part] == 1:
                    t = min(t, _meet_edge(field, motion, triangle, part))
                if field.edges[triangle, 3 + part] == 1:
                    t = min(t, _meet_corner(field, motion, triangle, part))
            if t <= best:
                best, first = t, triangle
    return best, first


@bare_kernel
def _meet_face(field, motion, triangle):  # type: ignore[no-untyped-def]
    """Return how far along a motion the sphere touches a triangle within its edges."""
    kind, place, r, _, radius = motion
    vectors, mesh = field.vectors, field.walls.mesh
    normal, corner = mesh.normals[triangle, 0], mesh.corners[triangle, 0]
    base = place if kind == LINE else vectors[MIDDLE]
    gap = -r
    for axis in range(3):
        gap -= normal[axis] * (base[axis] + mesh.shift[axis] - corner[axis])
    if kind == LINE:
        rate = normal[0] * vectors[WAY, 0] + normal[1] * vectors[WAY, 1] + normal[2] * vectors[WAY, 2]
        if rate <= SLIGHT or gap < -SLIGHT * r:
            return math.inf
        t = max(gap / rate, 0.0)
    else:
        a = radius * (normal[0] * vectors[FIRST, 0] + normal[1] * vectors[FIRST, 1] + normal[2] * vectors[FIRST, 2])
        b = radius * (normal[0] * vectors[SECOND, 0] + normal[1] * vectors[SECOND, 1] + normal[2] * vectors[SECOND, 2])
        if a > gap + 0.5 * SLIGHT * r:
            # beyond the plane, which is touched once the sphere is back
            size = math.hypot(a, b)
            if size <= abs(gap):
                return math.inf
            t = math.atan2(b, a) - math.acos(gap / size)
            t = t + 2.0 * math.pi if t < 0.0 else t
        else:
            t = first_root(a, b, gap, 0.5 * SLIGHT * r)
        if t == math.inf:
            return math.inf
    x, y, z = _place_on(vectors, motion, t)
    for i in range(3):
        gx, gy, gz, length = _across_edge(mesh, triangle, i)
        corner = mesh.corners[triangle, i]
        inside = gx * (x + mesh.shift[0] - corner[0]) + gy * (y + mesh.shift[1] - corner[1])
        inside += gz * (z + mesh.shift[2] - corner[2])
        if inside < -SLIGHT * r * length:
            return math.inf
    return t


@bare_kernel
def _place_on(vectors, motion, t):  # type: ignore[no-untyped-def]
    """Return the place on a line or a circle."""
    if motion.kind == LINE:
        place, way = motion.place, vectors[WAY]
        return place[0] + t * way[0], place[1] + t * way[1], place[2] + t * way[2]
    cos, sin = motion.radius * math.cos(t), motion.radius * math.sin(t)
    return (
        vectors[MIDDLE, 0] + cos * vectors[FIRST, 0] + sin * vectors[SECOND, 0],
        vectors[MIDDLE, 1] + cos * vectors[FIRST, 1] + sin * vectors[SECOND, 1],
        vectors[MIDDLE, 2] + cos * vectors[FIRST, 2] + sin * vectors[SECOND, 2],
    )


@bare_kernel
def _meet_corner(field, motion, triangle, part):  # type: ignore[no-untyped-def]
    """Return how far along a motion the sphere touches a corner."""
    mesh = field.walls.mesh
    corner = mesh.corners[triangle, part]
    x, y, z = corner[0] - mesh.shift[0], corner[1] - mesh.shift[1], corner[2] - mesh.shift[2]
    if motion.kind == LINE:
        return meet_on_line(motion.place, field.vectors[WAY], x, y, z, motion.r)
    return meet_on_circle(field, motion.kept, motion.radius, x, y, z, motion.r)


@bare_kernel
def _meet_edge(field, motion, triangle, part):  # type: ignore[no-untyped-def]
    """Return how far along a motion the sphere touches an edge between its ends."""
    kind, place, r, _, radius = motion
    vectors, mesh = field.vectors, field.walls.mesh
    one, two = mesh.corners[triangle, part], mesh.corners[triangle, (part + 1) % 3]
    ex, ey, ez = two[0] - one[0], two[1] - one[1], two[2] - one[2]
    length = math.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / length, ey / length, ez / length
    base = place if kind == LINE else vectors[MIDDLE]
    mx, my, mz = base[0] + mesh.shift[0] - one[0], base[1] + mesh.shift[1] - one[1], base[2] + mesh.shift[2] - one[2]
    m = mx * ex + my * ey + mz * ez
    mm = mx * mx + my * my + mz * mz - m * m
    if kind == LINE:
        w = vectors[WAY, 0] * ex + vectors[WAY, 1] * ey + vectors[WAY, 2] * ez
        along = vectors[WAY, 0] * mx + vectors[WAY, 1] * my + vectors[WAY, 2] * mz - m * w
        across, beyond = 1.0 - w * w, mm - r * r
        square = along * along - across * beyond
        if along > -SLIGHT * r or square <= GRAZED * r * r:
            return math.inf
        t = max(beyond / (math.sqrt(square) - along), 0.0)
        return t if 0.0 <= m + t * w <= length else math.inf
    f = vectors[FIRST, 0] * ex + vectors[FIRST, 1] * ey + vectors[FIRST, 2] * ez
    s = vectors[SECOND, 0] * ex + vectors[SECOND, 1] * ey + vectors[SECOND, 2] * ez
    mf = vectors[FIRST, 0] * mx + vectors[FIRST, 1] * my + vectors[FIRST, 2] * mz - m * f
    ms = vectors[SECOND, 0] * mx + vectors[SECOND, 1] * my + vectors[SECOND, 2] * mz - m * s
    c, a1, b1, a2, b2 = square_on_circle(mm, mf, ms, 1.0 - f * f, 1.0 - s * s, -f * s, radius)
    c -= r * r * (1.0 - GRAZED)
    beyond, slope = c + a1 + a2, b1 + 2.0 * b2
    if abs(beyond) <= SLIGHT * r * r:
        # what touches the edge already meets it if it moves toward it, and leaves it if it moves along it
        if slope > -SLIGHT * r * radius:
            if slope < SLIGHT * r * radius:
                return math.inf
        else:
            return 0.0 if 0.0 <= m + radius * f <= length else math.inf
    return _next_on_edge((c, a1, b1, a2, b2), (m, f, s), radius, length)


@bare_kernel
def _next_on_edge(terms, edge, radius, length):  # type: ignore[no-untyped-def]
    """Return the first angle after 0 at which a circle comes nearer to a line than it may, between its ends."""
    (c, a1, b1, a2, b2), (m, f, s), t = terms, edge, 0.0
    for _ in range(ROOTS):
        t = next_root(c, a1, b1, a2, b2, t, 2.0 * math.pi)
        if t == math.inf:
            return math.inf
        cos, sin = math.cos(t), math.sin(t)
        slope = b1 * cos - a1 * sin + 2.0 * (b2 * math.cos(2.0 * t) - a2 * math.sin(2.0 * t))
        if slope <= 0.0 and 0.0 <= m + radius * (f * cos + s * sin) <= length:
            return t
    return math.inf


#: numbers of walls beside those across the axes: none, around a point, around an axis
NO_WALL, ROUND_WALL, TUBE_WALL = -1, 3, 4


@bare_kernel
def is_round(field: Field) -> bool:
    """Return whether there is a wall around a point; that of a disk is one as well."""
    return field.walls.kind == ROUND or (field.walls.kind == UPRIGHT and field.up == 1)


@bare_kernel
def touch_round(field: Field, place: Floats, r: float, row: int) -> None:
    """Write a contact with the wall around a point."""
    middle = field.walls.middle
    touch_sphere(field, place, row, middle[0], middle[1], middle[2], r - field.walls.radius)


@bare_kernel
def wall_on_line(field: Field, place: Floats, r: float) -> tuple[float, int, float]:
    """Return how far the first wall is, its number and the sign of its normal; `NO_WALL` where nothing ends the line.

    Toward the center there are no walls, and the line ends beyond the center.
    """
    way = field.vectors[WAY]
    if field.central:
        far = 0.0
        for axis in range(3):
            far += (place[axis] - field.target[axis]) ** 2
        return 2.0 * math.sqrt(far), NO_WALL, 0.0
    end, wall, side = math.inf, NO_WALL, 0.0
    for axis in range(3):
        if field.flat[axis] == 1 and abs(way[axis]) > SLIGHT:
            goal = r if way[axis] < 0.0 else field.lengths[axis] - r
            away = max((goal - place[axis]) / way[axis], 0.0)
            if away < end:
                end, wall, side = away, axis, 1.0 if way[axis] < 0.0 else -1.0
    if is_round(field):
        along, room, middle = 0.0, (field.walls.radius - r) ** 2, field.walls.middle
        for axis in range(3):
            along += way[axis] * (place[axis] - middle[axis])
            room -= (place[axis] - middle[axis]) ** 2
        # of the two forms of the root that without a difference
        root = math.sqrt(max(along * along + room, 0.0))
        away = room / (root + along) if along > 0.0 else root - along
        end, wall = max(away, 0.0), ROUND_WALL
    return end, wall, side


@bare_kernel
def wall_on_circle(field: Field, r: float, kept: int, radius: float, end: float) -> tuple[float, int, float]:
    """Return the angle up to `end` at which the sphere touches a wall, its number, and the sign of its normal."""
    vectors, contacts, best, wall, side = field.vectors, field.contacts, end, NO_WALL, 0.0
    if field.central:
        return best, wall, side
    for axis in range(3):
        if field.flat[axis] == 0:
            continue
        for sign in (-1.0, 1.0):
            # toward the upper wall along an axis for 1
            known = False
            for k in range(kept):
                known = known or (contacts[k, REACH] == 0.0 and contacts[k, axis] == -sign)
            if known:
                continue
            a, b = sign * radius * vectors[FIRST, axis], sign * radius * vectors[SECOND, axis]
            limit = field.lengths[axis] - r if sign > 0.0 else -r
            c = limit - sign * vectors[MIDDLE, axis]
            angle = first_root(a, b, c, SLIGHT * r)
            if angle <= best:
                best, wall, side = angle, axis, -sign
    if is_round(field):
        middle = field.walls.middle
        angle = meet_on_circle(field, kept, radius, middle[0], middle[1], middle[2], r - field.walls.radius)
        if angle <= best:
            best, wall = angle, ROUND_WALL
    elif field.walls.kind == UPRIGHT:
        angle = tube_on_circle(field, r, radius, best)
        if angle <= best:
            best, wall = angle, TUBE_WALL
    return best, wall, side
