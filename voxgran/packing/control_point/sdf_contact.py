"""Contact by signed distance: control points of one grain in the field of another, and the other way round.

The points of a grain lie in a tree of spheres. Where the field tells that the center of a sphere is farther from the
other grain than the sphere reaches, none of its points needs to be looked at; so a comparison looks at the few points
that are near. A point is refused where it is nearer than a threshold, which for touching grains is 0 but for two
things. Between points that lie on a smooth surface, the surface bulges towards the other grain; by how much is known
from the curvatures, so that smooth grains never overlap. And grains thinner than the points are wide apart are kept as
far away as it takes that they cannot slip between the points.
"""

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.packing.control_point.distance_fields import ROUGH, SINGLE, STEEP, field_at
from voxgran.packing.control_point.pair_cache import (
    OTHER_POINT,
    PAIR,
    POINT,
    SLACK,
    WAY,
    PairCache,
    claim_row,
    keep_pose,
    moved_since,
    row_of_pair,
)
from voxgran.packing.control_point.point_contact import HORIZON, ROUNDING
from voxgran.packing.control_point.point_trees import placed
from voxgran.packing.control_point.records import (
    CURVATURE,
    HALF_SPACING,
    HALF_THICKNESS,
    RADIUS,
    SURFACE_ERROR,
    Bodies,
    GrainPoses,
    Scratch,
)
from voxgran.packing.control_point.relative_poses import invert, relate
from voxgran.packing.control_point.support_tables import plane_of


@inlined_kernel
def threshold(extent: Floats, p: int, q: int, gap: float) -> float:
    """Return how near the points of grain p may come to grain q, in median diameters as the extents."""
    cover = extent[p, HALF_SPACING]
    bend = max(extent[p, CURVATURE], 0.0) + max(extent[q, CURVATURE], 0.0)
    bulge = min(cover, 0.5 * cover * cover * bend) + extent[p, SURFACE_ERROR] + extent[q, SURFACE_ERROR]
    return gap + max(bulge, cover - extent[q, HALF_THICKNESS])


@bare_kernel
def find_near(
    points: Floats, start: Integers, spheres: Floats, first: Integers, depth: Integers, head: Floats, rows: Floats,
    values: NDArray[np.float32], a: int, b: int, turn: Floats, shift: Floats, scale: float, low: float, high: float,
    plane: Floats, stack: Integers,
) -> tuple[int, float]:  # fmt: skip
    """Look for a point of tree a that is nearer than `low` to the surface of shape b.

    A point p of a lies at ``turn @ p + shift`` in the frame of b, where `turn` is a rotation matrix times `scale`. The
    first arguments are the fields of `Trees` and `Fields`. Points with ``plane[:3] @ p > plane[3]`` are known to be
    farther than `high`. Return a point that is nearer than `low`, or -1, and by how much all are farther, `high` -
    `low` at the most; 0 where one is nearer.
    """
    level, begin, origin = depth[a], first[a], start[a]
    leaves, count = (1 << level) - 1, start[a + 1] - start[a]
    slack, top, steep = high - low, 1, head[b, STEEP]
    rough = head[b, ROUGH] if high >= 0.0 else np.inf
    ux, uy, uz, beyond = plane[0], plane[1], plane[2], plane[3]
    stack[0, 0] = 0
    while top > 0:
        top -= 1
        node = stack[top, 0]
        if node < leaves:
            one, other = 2 * node + 1, 2 * node + 2
            near, far, at = high, high, begin + one
            if ux * spheres[at, 0] + uy * spheres[at, 1] + uz * spheres[at, 2] - scale * spheres[at, 3] <= beyond:
                near = _least(spheres, head, rows, values, at, b, turn, shift, scale, steep, rough)
            at += 1
            if ux * spheres[at, 0] + uy * spheres[at, 1] + uz * spheres[at, 2] - scale * spheres[at, 3] <= beyond:
                far = _least(spheres, head, rows, values, at, b, turn, shift, scale, steep, rough)
            if near > far:
                one, other, near, far = other, one, far, near
            # the nearer one on top
            if far < high:
                stack[top, 0] = other
                top += 1
            if near < high:
                stack[top, 0] = one
                top += 1
            continue
        k = node - leaves
        for i in range(origin + ((k * count) >> level), origin + (((k + 1) * count) >> level)):
            if ux * points[i, 0] + uy * points[i, 1] + uz * points[i, 2] > beyond:
                continue
            told = _told(points, head, rows, values, i, b, turn, shift)
            if told < low:
                return i, 0.0
            slack = min(slack, told - low)
    return -1, slack / steep


@inlined_kernel
def _least(spheres, head, rows, values, at, b, turn, shift, scale, steep, rough):  # type: ignore[no-untyped-def]
    """Return what a field tells at least of the places in a sphere."""
    radius = spheres[at, 3] * scale
    change = min(radius * steep, np.sqrt((radius + SINGLE) ** 2 + rough))
    return _told(spheres, head, rows, values, at, b, turn, shift) - change


@inlined_kernel
def _told(points, head, rows, values, i, b, turn, shift):  # type: ignore[no-untyped-def]
    """Return what the field of a shape tells of a point that is turned and shifted."""
    x, y, z = placed(points, i, turn, shift)
    return field_at(head, rows, values, b, x, y, z)


@bare_kernel
def _told_back(points, head, rows, values, i, b, turn, shift, scale):  # type: ignore[no-untyped-def]
    """Return what the field of a shape tells of a point in whose frame the shape is turned and shifted."""
    x, y, z = points[i, 0] - shift[0], points[i, 1] - shift[1], points[i, 2] - shift[2]
    part = 1.0 / (scale * scale)
    return field_at(
        *(head, rows, values, b),
        part * (turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z),
        part * (turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z),
        part * (turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z),
    )


@inlined_kernel
def cached_answer_by_sdf(
    orientation: Floats, diameter: Floats, extent: Floats, shape: Integers, pairs: Integers, poses: Floats,
    points: Floats, head: Floats, rows: Floats, values: NDArray[np.float32], turn: Floats, relative: Floats,
    shift: Floats, g: int, j: int, gap: float, dx: float, dy: float, dz: float,
) -> int:  # fmt: skip
    """Return from the cache whether grain g meets grain j as in `overlaps_by_sdf`: 0 no, 1 yes, 2 unknown.

    The answers are those that comparing the grains again would give.
    """
    a, b = min(g, j), max(g, j)
    pair = a * len(diameter) + b
    row = row_of_pair(len(pairs), pair)
    if pairs[row, PAIR] != pair:
        return 2
    relate(orientation, diameter, turn, relative, shift, g, j, dx, dy, dz)
    point = pairs[row, POINT]
    if point >= 0 and pairs[row, OTHER_POINT] == 0:
        if (
            _told(points, head, rows, values, point, shape[b], relative, shift)
            < threshold(extent, a, b, gap) / diameter[b]
        ):
            return 1
    elif point >= 0:
        scale = diameter[a] / diameter[b]
        told = _told_back(points, head, rows, values, point, shape[a], relative, shift, scale)
        if told < threshold(extent, b, a, gap) / diameter[a]:
            return 1
    # points of b that are near a lie within its radius, the threshold and the slack, which is small
    radius = (extent[a, RADIUS] + threshold(extent, b, a, max(gap, 0.0))) / diameter[a] + 2.0 * HORIZON
    return 0 if moved_since(poses, row, relative, shift, radius) + ROUNDING < poses[row, SLACK] else 2


@inlined_kernel
def overlaps_by_sdf(
    grains: GrainPoses, bodies: Bodies, cache: PairCache, scratch: Scratch, g: int, j: int, gap: float, dx: float,
    dy: float, dz: float, moved: float,
) -> bool:  # fmt: skip
    """Return whether a control point of grain g, in the pose that is tried, comes too near to grain j, or the other
    way.

    (dx, dy, dz) is the way from the center of j, or of its image, to that of g; j may be g, for an image of its own.
    `moved` bounds how far the points of g came. Asked one way, it is the grain with the finer points whose points are
    tested, and one point of the other grain, so that a grain within another is found.
    """
    a, b = min(g, j), max(g, j)
    extent, size_a, size_b = grains.extent, grains.diameter[a], grains.diameter[b]
    low, back_low = threshold(extent, a, b, gap), threshold(extent, b, a, gap)
    reach = extent[a, RADIUS] + extent[b, RADIUS] + max(low, back_low)
    if dx * dx + dy * dy + dz * dz > reach * reach:
        return False
    relative, shift, scale = scratch.relative, scratch.shift, size_a / size_b
    relate(grains.orientation, grains.diameter, scratch.turn, relative, shift, g, j, dx, dy, dz)
    finer = extent[a, HALF_SPACING] <= extent[b, HALF_SPACING]
    # what is learned for later is of no use to grains that move farther than that at once
    room = HORIZON * min(1.0, scale) if moved <= 2.0 * HORIZON else 0.0
    point, slack, back = np.int64(-1), room, False
    _write_cached_way(grains, cache, scratch, g, a, b)
    if bodies.both or finer:
        point, slack = _find(bodies, scratch, grains.shape[a], grains.shape[b], scale, low / size_b, room)
    else:
        slack = min(slack, _room_of_first(bodies, scratch, grains.shape[a], grains.shape[b], low / size_b))
    if slack < 0.0:
        return True
    if point < 0:
        invert(relative, shift, scale)
        _turn_way(relative, scratch.way)
        if bodies.both or not finer:
            back = True
            point, other = _find(
                bodies, scratch, grains.shape[b], grains.shape[a], 1.0 / scale, back_low / size_a, room / scale
            )
            slack = min(slack, scale * other)
        else:
            other = _room_of_first(bodies, scratch, grains.shape[b], grains.shape[a], back_low / size_a)
            slack = min(slack, scale * other)
        if slack < 0.0:
            return True
    if point < 0 and gap < 0.0:
        # points of the surface do not tell of grains whose centers nearly coincide: their cores must keep apart too
        other = _core_room(bodies, scratch, grains.shape[b], grains.shape[a], 1.0 / scale, gap / size_a)
        slack = min(slack, scale * other)
        relate(grains.orientation, grains.diameter, scratch.turn, relative, shift, g, j, dx, dy, dz)
        slack = min(slack, _core_room(bodies, scratch, grains.shape[a], grains.shape[b], scale, gap / size_b))
        if slack < 0.0:
            return True
    if a != b:
        if point < 0:
            relate(grains.orientation, grains.diameter, scratch.turn, relative, shift, g, j, dx, dy, dz)
        _remember_field(cache, a * len(grains.diameter) + b, relative, shift, point, back, slack)
    return bool(point >= 0)


@inlined_kernel
def _find(bodies, scratch, s, t, scale, low, room):  # type: ignore[no-untyped-def]
    """Look for a near point of shape s in the field of shape t."""
    trees, fields = bodies.trees, bodies.fields
    _write_plane(bodies.reaches, scratch.relative, scratch.shift, scratch.way, scratch.plane, t, low + room)
    return find_near(
        *(trees.points, trees.start, trees.spheres, trees.first, trees.depth, fields.head, fields.rows, fields.values),
        *(s, t, scratch.relative, scratch.shift, scale, low, low + room, scratch.plane),
        scratch.stack,
    )


@inlined_kernel
def _write_cached_way(grains, cache, scratch, g, a, b):  # type: ignore[no-untyped-def]
    """Write the direction along which two grains were farthest apart, from b to a, in the frame of b; or zero."""
    pair = a * len(grains.diameter) + b
    row, way, q = row_of_pair(len(cache.pairs), pair), scratch.way, grains.orientation[b]
    if g == b:
        q = scratch.quaternion
    x, y, z = cache.poses[row, WAY], cache.poses[row, WAY + 1], cache.poses[row, WAY + 2]
    if a == b or cache.pairs[row, PAIR] != pair:
        x, y, z = 0.0, 0.0, 0.0
    # the other way round is minus the vector part
    tx, ty, tz = 2 * (q[3] * y - q[2] * z), 2 * (q[1] * z - q[3] * x), 2 * (q[2] * x - q[1] * y)
    way[0] = x + q[0] * tx - q[2] * tz + q[3] * ty
    way[1] = y + q[0] * ty - q[3] * tx + q[1] * tz
    way[2] = z + q[0] * tz - q[1] * ty + q[2] * tx


@inlined_kernel
def _write_plane(reaches, relative, shift, way, plane, t, high):  # type: ignore[no-untyped-def]
    """Write the plane of `find_near` across a way that begins at shape t."""
    x, y, z = way[0], way[1], way[2]
    plane[0], plane[1], plane[2], plane[3] = 0.0, 0.0, 0.0, np.inf
    if (x == 0.0 and y == 0.0 and z == 0.0) or high > reaches.limit[t]:
        return
    px, py, pz = plane_of(reaches.values, t, x, y, z)
    wide = high * reaches.stretch[t] if high > 0.0 else high
    plane[3] = wide + (px - shift[0]) * x + (py - shift[1]) * y + (pz - shift[2]) * z
    for k in range(3):
        plane[k] = relative[0, k] * x + relative[1, k] * y + relative[2, k] * z


@bare_kernel
def _turn_way(relative, way):  # type: ignore[no-untyped-def]
    """Turn a way around and into the frame of the other shape, after the relative pose was."""
    x, y, z = way[0], way[1], way[2]
    square = 0.0
    for k in range(3):
        way[k] = -(relative[k, 0] * x + relative[k, 1] * y + relative[k, 2] * z)
        square += way[k] * way[k]
    for k in range(3):
        way[k] /= max(np.sqrt(square), 1e-300)


@bare_kernel
def _room_of_first(bodies, scratch, s, t, low):  # type: ignore[no-untyped-def]
    """Return how much farther than it must be the first point of shape s is from shape t; below 0 too near."""
    trees, fields, first = bodies.trees, bodies.fields, bodies.trees.start[s]
    told = _told(trees.points, fields.head, fields.rows, fields.values, first, t, scratch.relative, scratch.shift)
    return (told - low) / fields.head[t, STEEP]


@bare_kernel
def _core_room(bodies, scratch, s, t, scale, gap):  # type: ignore[no-untyped-def]
    """Return how much farther than it must be the sphere at the center of shape s is from shape t; below 0 too near."""
    fields, shift = bodies.fields, scratch.shift
    core = -scale * min(field_at(fields.head, fields.rows, fields.values, s, 0.0, 0.0, 0.0), 0.0)
    told = field_at(fields.head, fields.rows, fields.values, t, shift[0], shift[1], shift[2])
    return (told - core - gap) / fields.head[t, STEEP]


@bare_kernel
def _remember_field(cache, pair, relative, shift, point, back, slack):  # type: ignore[no-untyped-def]
    """Note the point that refused a pose beside what was known before, or the slack of a pose that was not refused."""
    row = claim_row(cache.pairs, cache.poses, pair)
    if point >= 0:
        cache.pairs[row, POINT], cache.pairs[row, OTHER_POINT] = point, 1 if back else 0
        return
    keep_pose(cache.poses, row, relative, shift, slack)
