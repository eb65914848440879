"""Whether two grains of true shapes have a point in common.

Convex parts are apart if a plane separates them, which the algorithm of Gilbert, Johnson and Keerthi finds
(:mod:`voxgran.contacts.manifolds.convex_distance`). Two boxes are compared along their fifteen axes (Gottschalk, Lin &
Manocha 1996, doi:10.1145/237170.237244), which is faster. Parts for which rounding hides such a plane count as meeting:
what is accepted is apart. Of shapes of many parts, the pairs whose bounding spheres overlap are found by their trees.
Two meshes whose triangles do not meet overlap only if one lies inside the other.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.convex_contacts import place_row
from voxgran.contacts.manifolds.convex_distance import Part, distance_along, tables_of
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.geometry.tree import encloses

#: distance, in diameters, up to which parts count as meeting, and the difference of bounds at which the search ends
TOUCHING, CLOSE = 1e-12, 1e-13
#: largest number of parts of a shape that is placed at once, and that wait in a search
MOST_WAITING = 254


@bare_kernel
def place_relative(shapes: TrueShapes) -> None:
    """Write the rotation from the frame of another grain to that of the new one, from both rotations."""
    mine, other, relative = shapes.work.turn, shapes.work.other, shapes.work.relative
    for i in range(3):
        for j in range(3):
            relative[i, j] = mine[0, i] * other[0, j] + mine[1, i] * other[1, j] + mine[2, i] * other[2, j]


@bare_kernel
def shapes_meet(shapes: TrueShapes, a: int, b: int, x: float, y: float, z: float, stretch: float) -> bool:
    """Return whether shape a and shape b have a point in common.

    x, y, z: centroid of b in the frame of a, in the unit of a.  stretch: unit of b in that of a.  The rotation from b
    to a is in `work.relative`.
    """
    if shapes.box[b, 0] > 0.0:
        if shapes.box[a, 0] > 0.0:
            return not _boxes_apart(shapes.box[a], shapes.box[b], shapes.work.relative, x, y, z, stretch)
        if a == len(shapes.turns):
            return _is_sphere_at_box(shapes.box[b], shapes.work.relative, x, y, z, stretch)
    if shapes.hull[a] >= 0 and shapes.hull[b] >= 0:
        if not _parts_meet(shapes, a, b, shapes.hull[a], shapes.hull[b], x, y, z, stretch):
            return False
        if shapes.first[a + 1, 0] - shapes.first[a, 0] == 1 and shapes.first[b + 1, 0] - shapes.first[b, 0] == 1:
            return True
    return surfaces_meet(shapes, a, b, x, y, z, stretch) or is_nested(shapes, a, b, x, y, z, stretch)


@bare_kernel
def _boxes_apart(mine, other, turn, x, y, z, stretch):  # type: ignore[no-untyped-def]
    """Return whether one of the fifteen axes separates two boxes of these half edges, by more than rounding."""
    for i in range(3):
        step = x if i == 0 else (y if i == 1 else z)
        half = 0.0
        for j in range(3):
            half += abs(turn[i, j]) * other[j]
        if abs(step) > mine[i] + stretch * half + TOUCHING:
            return True
    for j in range(3):
        half = 0.0
        for i in range(3):
            half += abs(turn[i, j]) * mine[i]
        if abs(x * turn[0, j] + y * turn[1, j] + z * turn[2, j]) > half + stretch * other[j] + TOUCHING:
            return True
    for i in range(3):
        k, m = (i + 1) % 3, (i + 2) % 3
        along, across = (y, z) if i == 0 else ((z, x) if i == 1 else (x, y))
        for j in range(3):
            u, v = (j + 1) % 3, (j + 2) % 3
            half = mine[k] * abs(turn[m, j]) + mine[m] * abs(turn[k, j])
            half += stretch * (other[u] * abs(turn[i, v]) + other[v] * abs(turn[i, u]))
            if abs(across * turn[k, j] - along * turn[m, j]) > half + TOUCHING:
                return True
    return False


@bare_kernel
def _is_sphere_at_box(half, turn, x, y, z, stretch):  # type: ignore[no-untyped-def]
    """Return whether the sphere of radius 1 about the origin meets a box."""
    square = 0.0
    for j in range(3):
        step = abs(x * turn[0, j] + y * turn[1, j] + z * turn[2, j]) - stretch * half[j]
        square += max(step, 0.0) ** 2
    return square < 1.0


@bare_kernel
def placed(
    turn: Floats, stretch: float, x: float, y: float, z: float, px: float, py: float, pz: float
) -> tuple[float, float, float]:
    """Return a point of the frame of b in the frame of a."""
    return (
        x + stretch * (turn[0, 0] * px + turn[0, 1] * py + turn[0, 2] * pz),
        y + stretch * (turn[1, 0] * px + turn[1, 1] * py + turn[1, 2] * pz),
        z + stretch * (turn[2, 0] * px + turn[2, 1] * py + turn[2, 2] * pz),
    )


@bare_kernel
def _parts_meet(shapes, a, b, p, q, x, y, z, stretch):  # type: ignore[no-untyped-def]
    """Return whether part p of shape a and part q of shape b have a point in common, or rounding may hide one."""
    work, mine, other = shapes.work, shapes.part_sphere[p], shapes.part_sphere[q]
    turn = work.relative
    dx, dy, dz = placed(turn, stretch, x, y, z, other[0], other[1], other[2])
    dx, dy, dz = dx - mine[0], dy - mine[1], dz - mine[2]
    square, reach = dx * dx + dy * dy + dz * dz, mine[3] + stretch * other[3]
    if square >= reach * reach:
        return False
    if shapes.part[p, 0] == 0 and shapes.part[q, 0] == 0:
        return True
    if square == 0.0:
        dx = 1.0
    two = place_part(shapes, b, q, stretch)
    margin = shapes.margin[p] + stretch * shapes.margin[q] + TOUCHING
    one = (shapes.part[p, 0], a, shapes.part[p, 1], shapes.part[p, 2], shapes.part[p, 3], 0.0)
    tables = tables_of(shapes.bodies, work)
    distance = distance_along(tables, one, two, (x, y, z), (dx, dy, dz), margin, CLOSE, work.simplex)
    return not distance > margin


@bare_kernel
def place_part(shapes: TrueShapes, b: int, q: int, stretch: float) -> Part:
    """Write part q of shape b, rotated by `work.relative` and scaled, and return it as a part for the distance."""
    work, turn = shapes.work, shapes.work.relative
    begin, end = shapes.part[q, 1], shapes.part[q, 2]
    room = len(work.corner) - (end - begin)
    for k in range(end - begin):
        corner = work.corner[begin + k]
        px, py, pz = placed(turn, stretch, 0.0, 0.0, 0.0, corner[0], corner[1], corner[2])
        work.corner[room + k, 0], work.corner[room + k, 1], work.corner[room + k, 2] = px, py, pz
    if end == begin:
        place_row(work.row[b], turn, stretch, work.row[len(work.row) - 1])
    return shapes.part[q, 0], len(work.row) - 1, room, len(work.corner), shapes.part[q, 3], 0.0


@bare_kernel
def surfaces_meet(shapes: TrueShapes, a: int, b: int, x: float, y: float, z: float, stretch: float) -> bool:
    """Return whether a part of shape a and a part of shape b meet, as `shapes_meet` does."""
    turn, stack = shapes.work.relative, shapes.work.stack
    box, other_box = shapes.first[a, 1], shapes.first[b, 1]
    leaves, other_leaves = (shapes.first[a + 1, 1] - box) // 2, (shapes.first[b + 1, 1] - other_box) // 2
    stack[0, 0], stack[0, 1], depth = 0, 0, 1
    while depth > 0:
        depth -= 1
        i, j = stack[depth, 0], stack[depth, 1]
        mine, other = shapes.sphere[box + i], shapes.sphere[other_box + j]
        dx, dy, dz = placed(turn, stretch, x, y, z, other[0], other[1], other[2])
        reach = mine[3] + stretch * other[3]
        if (dx - mine[0]) ** 2 + (dy - mine[1]) ** 2 + (dz - mine[2]) ** 2 >= reach * reach:
            continue
        if i >= leaves and j >= other_leaves:
            for p in range(shapes.rows[box + i, 0], shapes.rows[box + i, 1]):
                for q in range(shapes.rows[other_box + j, 0], shapes.rows[other_box + j, 1]):
                    if _parts_meet(shapes, a, b, p, q, x, y, z, stretch):
                        return True
            continue
        if depth >= MOST_WAITING:
            # not reached by trees of up to 2**60 parts
            return True
        split = i < leaves and (j >= other_leaves or mine[3] >= stretch * other[3])
        stack[depth, 0], stack[depth, 1] = 2 * i + 1 if split else i, j if split else 2 * j + 1
        stack[depth + 1, 0], stack[depth + 1, 1] = 2 * i + 2 if split else i, j if split else 2 * j + 2
        depth += 2
    return False


@bare_kernel
def is_nested(shapes: TrueShapes, a: int, b: int, x: float, y: float, z: float, stretch: float) -> bool:
    """Return whether one of two shapes whose surfaces do not meet lies in the other, as `shapes_meet` does."""
    turn, first = shapes.work.relative, shapes.first
    if shapes.closed[a]:
        # each sphere of a union is tested, one point of any other shape
        for q in range(first[b, 0], first[b + 1, 0] if shapes.part[first[b, 0], 0] == 0 else first[b, 0] + 1):
            px, py, pz = point_of(shapes, q)
            px, py, pz = placed(turn, stretch, x, y, z, px, py, pz)
            if holds(shapes, a, px, py, pz):
                return True
    if shapes.closed[b]:
        for p in range(first[a, 0], first[a + 1, 0] if shapes.part[first[a, 0], 0] == 0 else first[a, 0] + 1):
            px, py, pz = point_of(shapes, p)
            px, py, pz = (px - x) / stretch, (py - y) / stretch, (pz - z) / stretch
            u = turn[0, 0] * px + turn[1, 0] * py + turn[2, 0] * pz
            v = turn[0, 1] * px + turn[1, 1] * py + turn[2, 1] * pz
            w = turn[0, 2] * px + turn[1, 2] * py + turn[2, 2] * pz
            if holds(shapes, b, u, v, w):
                return True
    return False


@bare_kernel
def point_of(shapes: TrueShapes, p: int) -> tuple[float, float, float]:
    """Return a point of part p."""
    if shapes.part[p, 2] > shapes.part[p, 1]:
        corner = shapes.work.corner[shapes.part[p, 1]]
        return corner[0], corner[1], corner[2]
    return shapes.part_sphere[p, 0], shapes.part_sphere[p, 1], shapes.part_sphere[p, 2]


@bare_kernel
def holds(shapes: TrueShapes, s: int, x: float, y: float, z: float) -> bool:
    """Return whether the triangles of shape s enclose a point in its frame."""
    box, end = shapes.first[s, 1], shapes.first[s + 1, 1]
    begin, last = shapes.first[s, 2], shapes.first[s + 1, 2]
    return encloses(
        shapes.triangle[begin:last], shapes.pseudo[begin:last], shapes.low[box:end], shapes.high[box:end],
        shapes.start[box:end], (x, y, z), shapes.work.boxes,
    )  # fmt: skip


@bare_kernel
def meets_itself(
    periods: Floats, shapes: TrueShapes, s: int, f: float, radius: float
) -> bool:  # fmt: skip
    """Return whether the new grain meets one of its own images, by the (3, 3) periods of the container."""
    work, p, far = shapes.work, periods, 2.0 * radius
    highest_z = _turns_within(p[2, 2], 0.0, far)[1]
    for i in range(3):
        for j in range(3):
            work.relative[i, j] = 1.0 if i == j else 0.0
    # the image on the other side is the same pair
    for kz in range(highest_z + 1):
        dz = kz * p[2, 2]
        lowest_y, highest_y = _turns_within(p[1, 1], kz * p[2, 1], far)
        for ky in range(lowest_y if kz > 0 else 0, highest_y + 1):
            dy, away = ky * p[1, 1] + kz * p[2, 1], ky * p[1, 0] + kz * p[2, 0]
            lowest_x, highest_x = _turns_within(p[0, 0], away, far)
            for kx in range(lowest_x if kz > 0 or ky > 0 else 1, highest_x + 1):
                dx = kx * p[0, 0] + away
                if dx * dx + dy * dy + dz * dz < far * far:
                    x, y, z = in_frame(work.turn, f, dx, dy, dz)
                    if shapes_meet(shapes, s, s, x, y, z, 1.0):
                        return True
    return False


@bare_kernel
def _turns_within(length, away, reach):  # type: ignore[no-untyped-def]
    """Return the least and the largest number of lengths that lead from `away` to within reach of 0; 0 without one."""
    if length == 0.0:
        return 0, 0
    return math.ceil((-reach - away) / length), math.floor((reach - away) / length)


@bare_kernel
def in_frame(turn: Floats, f: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a vector in the frame and unit of the new grain."""
    return (
        (turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z) / f,
        (turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z) / f,
        (turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z) / f,
    )
