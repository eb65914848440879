"""Where grains meet: control points of one against the KD-tree of another, and against the walls.

The surface of each grain is sampled so that every point of it has a control point within half a spacing. Where two
surfaces cross, each has a control point within half of its spacing from there; so two grains whose control points keep
the mean of their spacings do not cross. Flat and round walls are convex and are tested exactly, by the corners of the
convex hull of a grain; the mesh of a closed container is sampled like a grain.
"""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.packing.trees import Trees, list_near, point_distance

#: kinds of walls
FLAT, ROUND, MESH = 0, 1, 2
#: how much farther than needed points are listed, in diameters
HORIZON = 0.04
#: more than rounding does to a distance, in diameters
ROUNDING = 1e-9


class Bodies(NamedTuple):
    """The shapes at unit diameter; with a mesh container, the last tree and the last triangles are its own.

    `spacing` is twice the covering radius of the control points. The points `hull` with room `margin` around each hold
    the solid in their convex hull.
    """

    trees: Trees
    radius: Floats
    spacing: Floats
    hull: Floats
    hull_start: Integers
    margin: Floats
    triangles: Floats
    triangle_start: Integers


class Bed(NamedTuple):
    """Where the grains are, how long a step each one tries at the most, and its `extent`.

    The extent of a grain is its bounding radius, half the spacing of its points, and volume over surface.
    """

    position: Floats
    orientation: Floats
    placed: Integers
    step: Floats
    shape: Integers
    diameter: Floats
    extent: Floats


class Walls(NamedTuple):
    """The container: its bounds, which axes have walls and which are periodic, the radius of a round one."""

    kind: int
    lower: Floats
    upper: Floats
    walled: Integers
    periodic: Integers
    radius: float
    offset: Floats


class Memory(NamedTuple):
    """What is known of pairs of grains that were compared: tables in which later pairs push out earlier ones.

    `pairs` has the number of the pair (-1: none), the two control points that refused it last (-1: none), and how many
    rows of `lists` are filled; `poses` a relative pose (turn row by row, shift) and a slack. In that pose, all control
    points were farther apart than they must be by the slack, those in `lists` excepted.
    """

    pairs: Integers
    poses: Floats
    lists: Integers


class Scratch(NamedTuple):
    """Room for the pose that is tried, for a relative pose, for a walk over two trees, and for neighbours to be
    compared.
    """

    place: Floats
    quaternion: Floats
    turn: Floats
    relative: Floats
    shift: Floats
    stack: Integers
    found: Integers
    pending: Integers


@bare_kernel
def write_matrix(q: Floats, matrix: Floats) -> None:
    """Write the rotation matrix of a unit quaternion."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@bare_kernel
def is_outside(bed: Bed, bodies: Bodies, walls: Walls, scratch: Scratch, g: int, moved: float) -> bool:
    """Tell whether a grain in the pose that is tried reaches beyond a wall; `moved` bounds how far its points came."""
    if walls.kind == MESH:
        return _is_outside_mesh(bed, bodies, walls, scratch, g, moved)
    s, size = bed.shape[g], bed.diameter[g]
    margin, begin, end = bodies.margin[s] * size, bodies.hull_start[s], bodies.hull_start[s + 1]
    walled, lower, upper = walls.walled, walls.lower, walls.upper
    place, turn, hull, radius = scratch.place, scratch.turn, bodies.hull, bed.extent[g, 0]
    if _is_beyond_flat(place, turn, hull, begin, end, size, walled, lower, upper, radius, margin):
        return True
    if walls.kind == FLAT:
        return False
    return _is_beyond_round(place, turn, hull, begin, end, size, walls.offset, walls.radius - margin, radius)


@bare_kernel
def recall(
    orientation: Floats,
    diameter: Floats,
    extent: Floats,
    pairs: Integers,
    poses: Floats,
    lists: Integers,
    points: Floats,
    turn: Floats,
    relative: Floats,
    shift: Floats,
    g: int,
    j: int,
    gap: float,
    dx: float,
    dy: float,
    dz: float,
    moved: float,
) -> int:
    """Tell from memory whether grain g meets grain j as in `meets`: 0 no, 1 yes, 2 unknown.

    Where no point has moved by the slack since the grains were compared, only the points that were listed then can be
    too near. The answers are those that comparing the grains again would give.
    """
    a, b = min(g, j), max(g, j)
    pair = a * len(diameter) + b
    entry = _entry(len(pairs), pair)
    if pairs[entry, 0] != pair:
        return 2
    _relate(orientation, diameter, turn, relative, shift, g, j, dx, dy, dz)
    low = (gap + extent[a, 1] + extent[b, 1]) / diameter[b]
    if pairs[entry, 1] >= 0 and point_distance(points, pairs[entry, 1], pairs[entry, 2], relative, shift) < low:
        return 1
    for k in range(pairs[entry, 3]):
        if point_distance(points, lists[entry, k, 0], lists[entry, k, 1], relative, shift) < low:
            pairs[entry, 1], pairs[entry, 2] = lists[entry, k, 0], lists[entry, k, 1]
            return 1
    if moved > extent[a, 2] or moved > extent[b, 2]:
        return 2
    way, spin = 0.0, 0.0
    for m in range(3):
        way += (shift[m] - poses[entry, 9 + m]) ** 2
        for n in range(3):
            spin += (relative[m, n] - poses[entry, 3 * m + n]) ** 2
    # two rotations differ by a matrix with two equal singular values and a zero
    way = np.sqrt(way) + np.sqrt(0.5 * spin) * extent[a, 0] / diameter[a]
    return 0 if way + ROUNDING < poses[entry, 12] else 2


@bare_kernel
def meets(
    bed: Bed,
    bodies: Bodies,
    memory: Memory,
    scratch: Scratch,
    g: int,
    j: int,
    gap: float,
    dx: float,
    dy: float,
    dz: float,
    moved: float,
) -> bool:
    """Tell whether grain g, in the pose that is tried, comes nearer than a gap to grain j, or one holds the other.

    (dx, dy, dz) is the way from the center of j, or of its image, to that of g; j may be g, for an image of its own.
    `scratch.turn` is the rotation of g; `moved` bounds how far its points came: where that is little, no grain can
    have come to hold the other.
    """
    a, b = min(g, j), max(g, j)
    shape_a, shape_b, size_a, size_b = bed.shape[a], bed.shape[b], bed.diameter[a], bed.diameter[b]
    # surfaces that cross, or come nearer than the gap, have control points nearer than this
    distance = gap + bed.extent[a, 1] + bed.extent[b, 1]
    reach = bed.extent[a, 0] + bed.extent[b, 0] + distance
    if dx * dx + dy * dy + dz * dz > reach * reach:
        return False
    relative, shift = scratch.relative, scratch.shift
    _relate(bed.orientation, bed.diameter, scratch.turn, relative, shift, g, j, dx, dy, dz)
    low, scale = distance / size_b, size_a / size_b
    count, high = _list(bodies, scratch, shape_a, shape_b, scale, low, low + HORIZON * min(1.0, scale))
    if a != b:
        pair = a * len(bed.shape) + b
        _remember(memory.pairs, memory.poses, memory.lists, pair, relative, shift, high - low, scratch.found, count)
    if count < 0:
        return True
    if moved <= bed.extent[a, 2] and moved <= bed.extent[b, 2]:
        return False
    if _holds(bodies, shape_a, shape_b, relative, shift):
        return True
    _invert(relative, shift, scale)
    return _holds(bodies, shape_b, shape_a, relative, shift)


@bare_kernel
def _is_beyond_flat(place, turn, hull, begin, end, size, walled, lower, upper, radius, margin):  # type: ignore[no-untyped-def]
    """Tell whether a point of the convex hull lies beyond a flat wall."""
    for axis in range(3):
        x, low, high = place[axis], lower[axis] + margin, upper[axis] - margin
        if walled[axis] == 0 or low + radius < x < high - radius:
            continue
        t, u, v = turn[axis, 0], turn[axis, 1], turn[axis, 2]
        for k in range(begin, end):
            along = x + size * (t * hull[k, 0] + u * hull[k, 1] + v * hull[k, 2])
            if along < low or along > high:
                return True
    return False


@bare_kernel
def _is_beyond_round(place, turn, hull, begin, end, size, offset, room, radius):  # type: ignore[no-untyped-def]
    """Tell whether a point of the convex hull lies outside of a cylinder along z."""
    x, y = place[0] - offset[0], place[1] - offset[1]
    if np.sqrt(x * x + y * y) + radius < room:
        return False
    for k in range(begin, end):
        px = x + size * (turn[0, 0] * hull[k, 0] + turn[0, 1] * hull[k, 1] + turn[0, 2] * hull[k, 2])
        py = y + size * (turn[1, 0] * hull[k, 0] + turn[1, 1] * hull[k, 1] + turn[1, 2] * hull[k, 2])
        if room < 0.0 or px * px + py * py > room * room:
            return True
    return False


@bare_kernel
def _is_outside_mesh(bed, bodies, walls, scratch, g, moved):  # type: ignore[no-untyped-def]
    """Tell whether a grain meets the mesh of the container, or lies outside of it."""
    s, size, last = bed.shape[g], bed.diameter[g], len(bodies.spacing) - 1
    distance = bed.extent[g, 1] + 0.5 * bodies.spacing[last]
    for k in range(3):
        scratch.shift[k] = scratch.place[k] - walls.offset[k]
        for m in range(3):
            scratch.relative[k, m] = size * scratch.turn[k, m]
    if _list(bodies, scratch, s, last, size, distance, distance)[0] < 0:
        return True
    return moved > bed.extent[g, 2] and not _holds(bodies, s, last, scratch.relative, scratch.shift)


@bare_kernel
def _list(bodies, scratch, a, b, scale, low, high):  # type: ignore[no-untyped-def]
    """List the near control points of two shapes in the relative pose at hand."""
    trees = bodies.trees
    return list_near(
        *(trees.points, trees.start, trees.balls, trees.first, trees.depth, a, b, scratch.relative, scratch.shift),
        *(scale, low, high, scratch.stack, scratch.found),
    )


@bare_kernel
def _relate(orientation, diameter, turn, relative, shift, g, j, dx, dy, dz):  # type: ignore[no-untyped-def]
    """Write the pose of the grain of lower number in the frame of the other, whose diameter is the unit."""
    w, x, y, z = orientation[j, 0], orientation[j, 1], orientation[j, 2], orientation[j, 3]
    r0, r1, r2 = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    r3, r4, r5 = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    r6, r7, r8 = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    if j == g:
        # an image of its own goes along with the pose that is tried
        r0, r1, r2 = turn[0, 0], turn[0, 1], turn[0, 2]
        r3, r4, r5 = turn[1, 0], turn[1, 1], turn[1, 2]
        r6, r7, r8 = turn[2, 0], turn[2, 1], turn[2, 2]
    unit = diameter[max(g, j)]
    scale = diameter[min(g, j)] / unit
    for k in range(3):
        t, u, v = turn[0, k], turn[1, k], turn[2, k]
        p, q, r = (
            scale * (t * r0 + u * r3 + v * r6),
            scale * (t * r1 + u * r4 + v * r7),
            scale * (t * r2 + u * r5 + v * r8),
        )
        if g > j:
            relative[k, 0], relative[k, 1], relative[k, 2] = p, q, r
            shift[k] = -(t * dx + u * dy + v * dz) / unit
        else:
            relative[0, k], relative[1, k], relative[2, k] = p, q, r
    if g <= j:
        shift[0] = (r0 * dx + r3 * dy + r6 * dz) / unit
        shift[1] = (r1 * dx + r4 * dy + r7 * dz) / unit
        shift[2] = (r2 * dx + r5 * dy + r8 * dz) / unit


@bare_kernel
def _invert(relative, shift, scale):  # type: ignore[no-untyped-def]
    """Turn the relative pose around: the pose of the second grain in the frame of the first."""
    x, y, z = shift[0], shift[1], shift[2]
    for k in range(3):
        shift[k] = -(relative[0, k] * x + relative[1, k] * y + relative[2, k] * z) / (scale * scale)
    for k in range(3):
        relative[k, k] /= scale * scale
        for m in range(k):
            relative[k, m], relative[m, k] = relative[m, k] / (scale * scale), relative[k, m] / (scale * scale)


@bare_kernel
def _entry(room, pair):  # type: ignore[no-untyped-def]
    """Return the entry of a pair in a table whose length is a power of two."""
    return (pair * 2654435761 >> 7) & (room - 1)


@bare_kernel
def _remember(pairs, poses, lists, pair, relative, shift, slack, found, count):  # type: ignore[no-untyped-def]
    """Note what a comparison found; one that refused (count -1) adds its two points to what was known before."""
    entry = _entry(len(pairs), pair)
    if count < 0:
        if pairs[entry, 0] != pair:
            pairs[entry, 0], pairs[entry, 3], poses[entry, 12] = pair, 0, -1.0
        pairs[entry, 1], pairs[entry, 2] = found[0, 0], found[0, 1]
        return
    pairs[entry, 0], pairs[entry, 1], pairs[entry, 3], poses[entry, 12] = pair, -1, count, slack
    for m in range(3):
        poses[entry, 9 + m] = shift[m]
        for n in range(3):
            poses[entry, 3 * m + n] = relative[m, n]
    for k in range(count):
        lists[entry, k, 0], lists[entry, k, 1] = found[k, 0], found[k, 1]


@bare_kernel
def _holds(bodies, a, b, turn, shift):  # type: ignore[no-untyped-def]
    """Tell whether the solid b holds the first control point of a; surfaces do not cross when this is asked, so one
    tells for all.
    """
    points, i = bodies.trees.points, bodies.trees.start[a]
    x = turn[0, 0] * points[i, 0] + turn[0, 1] * points[i, 1] + turn[0, 2] * points[i, 2] + shift[0]
    y = turn[1, 0] * points[i, 0] + turn[1, 1] * points[i, 1] + turn[1, 2] * points[i, 2] + shift[1]
    z = turn[2, 0] * points[i, 0] + turn[2, 1] * points[i, 1] + turn[2, 2] * points[i, 2] + shift[2]
    if x * x + y * y + z * z > bodies.radius[b] * bodies.radius[b]:
        return False
    return is_within(bodies.triangles, bodies.triangle_start[b], bodies.triangle_start[b + 1], x, y, z)


@bare_kernel
def is_within(triangles: Floats, begin: int, end: int, x: float, y: float, z: float) -> bool:
    """Tell whether a point lies in the solid that triangles `begin` ... `end` - 1 bound: by the crossings of a ray
    along z.

    Half-open edges make the ray hit one of two triangles that share an edge. In 2D, triangles lie in the plane of the
    point, and are hit where they hold it.
    """
    inside = False
    for k in range(begin, end):
        ax, ay, az = triangles[k, 0, 0], triangles[k, 0, 1], triangles[k, 0, 2]
        bx, by, bz = triangles[k, 1, 0], triangles[k, 1, 1], triangles[k, 1, 2]
        cx, cy, cz = triangles[k, 2, 0], triangles[k, 2, 1], triangles[k, 2, 2]
        hit = _is_left_of(ax, ay, bx, by, x, y) != _is_left_of(bx, by, cx, cy, x, y)
        if hit != _is_left_of(cx, cy, ax, ay, x, y):
            nx = (by - ay) * (cz - az) - (bz - az) * (cy - ay)
            ny = (bz - az) * (cx - ax) - (bx - ax) * (cz - az)
            nz = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
            if az - (nx * (x - ax) + ny * (y - ay)) / nz >= z:
                inside = not inside
    return inside


@bare_kernel
def _is_left_of(ax, ay, bx, by, x, y):  # type: ignore[no-untyped-def]
    """Tell whether a ray from (x, y) along +x crosses an edge; the same for both directions of the edge."""
    if (ay > y) == (by > y):
        return False
    if ay > by:
        ax, ay, bx, by = bx, by, ax, ay
    return x < ax + (y - ay) * (bx - ax) / (by - ay)
