"""Contact by signed distance: control points of one grain in the field of another, and the other way round.

The points of a grain lie in a tree of spheres. Where the field tells that the center of a sphere is farther from the
other grain than the sphere reaches, none of its points needs to be looked at; so a comparison looks at the few points
that are near. A point is refused where it is nearer than a threshold, which for touching grains is 0 but for two
things. Between points that lie on a smooth surface, the surface bulges towards the other grain; by how much is known
from the curvatures, so that smooth grains never overlap. And grains thinner than the points are wide apart are kept as
far away as it takes that they cannot slip between the points.
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.vectors import Vector, dot, row_of, sub
from voxgran.packing.control_point.distance_fields import ROUGH, SINGLE, STEEP, Fields, field_at, plane_of
from voxgran.packing.control_point.point_contact import HORIZON
from voxgran.packing.control_point.point_trees import Pose, Trees, leaf_of, placed
from voxgran.packing.control_point.records import (
    CURVATURE,
    HALF_SPACING,
    HALF_THICKNESS,
    OTHER_POINT,
    PAIR,
    POINT,
    RADIUS,
    SURFACE_ERROR,
    WAY,
    Pairs,
    claim_row,
    keep_pose,
    row_of_pair,
)
from voxgran.packing.control_point.relative_poses import invert, relate


@inlined_kernel
def threshold(extent: Floats, p: int, q: int, gap: float) -> float:
    """Return how near the points of grain p may come to grain q, in median diameters as the extents."""
    cover = extent[p, HALF_SPACING]
    bend = max(extent[p, CURVATURE], 0.0) + max(extent[q, CURVATURE], 0.0)
    bulge = min(cover, 0.5 * cover * cover * bend) + extent[p, SURFACE_ERROR] + extent[q, SURFACE_ERROR]
    return gap + max(bulge, cover - extent[q, HALF_THICKNESS])


@bare_kernel
def find_near(
    trees: Trees, fields: Fields, a: int, b: int, pose: Pose, low: float, high: float, plane: Floats, stack: Integers
) -> tuple[int, float]:
    """Look for a point of tree a that is nearer than `low` to the surface of shape b.

    `pose` is that of a in the frame of b. Points with ``plane[:3] @ p > plane[3]`` are known to be farther than `high`.
    Return a point that is nearer than `low`, or -1, and by how much all are farther, `high` - `low` at the most; 0
    where one is nearer.
    """
    (turn, shift, scale), spheres, leaves = pose, trees.spheres, (1 << trees.depth[a]) - 1
    slack, top, steep = high - low, 1, fields.head[b, STEEP]
    rough = fields.head[b, ROUGH] if high >= 0.0 else np.inf
    normal, beyond = (plane[0], plane[1], plane[2]), plane[3]
    stack[0, 0] = 0
    while top > 0:
        top -= 1
        node = stack[top, 0]
        if node < leaves:
            one, other = 2 * node + 1, 2 * node + 2
            near, far, at = high, high, trees.first[a] + one
            if dot(normal, row_of(spheres, at)) - scale * spheres[at, 3] <= beyond:
                near = _least(spheres, fields, at, b, pose, steep, rough)
            at += 1
            if dot(normal, row_of(spheres, at)) - scale * spheres[at, 3] <= beyond:
                far = _least(spheres, fields, at, b, pose, steep, rough)
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
        begin, end = leaf_of(trees, a, node - leaves)
        for i in range(begin, end):
            if dot(normal, row_of(trees.points, i)) > beyond:
                continue
            distance = field_at(fields, b, placed(trees.points, i, turn, shift))
            if distance < low:
                return i, 0.0
            slack = min(slack, distance - low)
    return -1, slack / steep


@inlined_kernel
def _least(spheres, fields, at, b, pose, steep, rough):  # type: ignore[no-untyped-def]
    """Return the least distance from shape b that its field allows in a sphere."""
    turn, shift, scale = pose
    radius = spheres[at, 3] * scale
    change = min(radius * steep, np.sqrt((radius + SINGLE) ** 2 + rough))
    return field_at(fields, b, placed(spheres, at, turn, shift)) - change


@inlined_kernel
def still_refused_by_sdf(pairs: Pairs, row: int, a: int, b: int) -> bool:
    """Return whether the control point that refused grains a < b last, if any, is too near in the pose at hand."""
    grains, bodies, (turn, shift) = pairs.grains, pairs.bodies, (pairs.scratch.relative, pairs.scratch.shift)
    point, points = pairs.cache.pairs[row, POINT], bodies.trees.points
    if point < 0:
        return False
    if pairs.cache.pairs[row, OTHER_POINT] == 0:
        distance = field_at(bodies.fields, grains.shape[b], placed(points, point, turn, shift))
        return distance < threshold(grains.extent, a, b, pairs.gap) / grains.diameter[b]
    # a point of b in the frame of a
    scale = grains.diameter[a] / grains.diameter[b]
    (x, y, z), part = sub(row_of(points, point), (shift[0], shift[1], shift[2])), 1.0 / (scale * scale)
    place = (
        part * (turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z),
        part * (turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z),
        part * (turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z),
    )
    return (
        field_at(bodies.fields, grains.shape[a], place) < threshold(grains.extent, b, a, pairs.gap) / grains.diameter[a]
    )


@inlined_kernel
def overlaps_by_sdf(pairs: Pairs, g: int, j: int, way: Vector, moved: float) -> bool:
    """Return whether a control point of grain g, in the pose that is tried, comes too near to grain j, or the other
    way.

    `way` leads from the center of j, or of its image, to that of g; j may be g, for an image of its own. `moved` bounds
    how far the points of g came. Asked one way, it is the grain with the finer points whose points are tested, and one
    point of the other grain, so that a grain within another is found.
    """
    a, b = min(g, j), max(g, j)
    grains, bodies, scratch, gap = pairs.grains, pairs.bodies, pairs.scratch, pairs.gap
    extent, size_a, size_b = grains.extent, grains.diameter[a], grains.diameter[b]
    shape_a, shape_b = grains.shape[a], grains.shape[b]
    low, back_low = threshold(extent, a, b, gap), threshold(extent, b, a, gap)
    reach = extent[a, RADIUS] + extent[b, RADIUS] + max(low, back_low)
    if dot(way, way) > reach * reach:
        return False
    relate(grains, scratch, g, j, way)
    scale, finer = size_a / size_b, extent[a, HALF_SPACING] <= extent[b, HALF_SPACING]
    # what is learned for later is of no use to grains that move farther than that at once
    room = HORIZON * min(1.0, scale) if moved <= 2.0 * HORIZON else 0.0
    point, slack, back = np.int64(-1), room, False
    _write_cached_way(pairs, g, a, b)
    if bodies.both or finer:
        point, slack = _find(bodies, scratch, shape_a, shape_b, scale, low / size_b, room)
    else:
        slack = min(slack, _room_of_first(bodies, scratch, shape_a, shape_b, low / size_b))
    if slack < 0.0:
        return True
    if point < 0:
        back = True
        invert(scratch.relative, scratch.shift, scale)
        _turn_way(scratch.relative, scratch.way)
        if bodies.both or not finer:
            point, other = _find(bodies, scratch, shape_b, shape_a, 1.0 / scale, back_low / size_a, room / scale)
        else:
            other = _room_of_first(bodies, scratch, shape_b, shape_a, back_low / size_a)
        slack = min(slack, scale * other)
        if slack < 0.0:
            return True
    if point < 0 and gap < 0.0:
        # points of the surface do not tell of grains whose centers nearly coincide: their cores must keep apart too
        slack = min(slack, scale * _core_room(bodies, scratch, shape_b, shape_a, 1.0 / scale, gap / size_a))
        relate(grains, scratch, g, j, way)
        slack = min(slack, _core_room(bodies, scratch, shape_a, shape_b, scale, gap / size_b))
        if slack < 0.0:
            return True
    if a != b:
        if point < 0:
            relate(grains, scratch, g, j, way)
        row = claim_row(pairs.cache.pairs, pairs.cache.poses, a * len(grains.diameter) + b)
        if point >= 0:
            pairs.cache.pairs[row, POINT], pairs.cache.pairs[row, OTHER_POINT] = point, 1 if back else 0
        else:
            keep_pose(pairs.cache.poses, row, scratch.relative, scratch.shift, slack)
    return bool(point >= 0)


@inlined_kernel
def _find(bodies, scratch, s, t, scale, low, room):  # type: ignore[no-untyped-def]
    """Look for a near point of shape s in the field of shape t."""
    _write_plane(bodies.reaches, scratch, t, low + room)
    pose = (scratch.relative, scratch.shift, scale)
    return find_near(bodies.trees, bodies.fields, s, t, pose, low, low + room, scratch.plane, scratch.stack)


@inlined_kernel
def _write_cached_way(pairs, g, a, b):  # type: ignore[no-untyped-def]
    """Write the direction along which two grains were farthest apart, from b to a, in the frame of b; or zero."""
    cache, pair = pairs.cache, a * len(pairs.grains.diameter) + b
    row, way = row_of_pair(len(cache.pairs), pair), pairs.scratch.way
    q = pairs.scratch.quaternion if g == b else pairs.grains.orientation[b]
    x, y, z = cache.poses[row, WAY], cache.poses[row, WAY + 1], cache.poses[row, WAY + 2]
    if a == b or cache.pairs[row, PAIR] != pair:
        x, y, z = 0.0, 0.0, 0.0
    # the other way round is minus the vector part
    tx, ty, tz = 2 * (q[3] * y - q[2] * z), 2 * (q[1] * z - q[3] * x), 2 * (q[2] * x - q[1] * y)
    way[0] = x + q[0] * tx - q[2] * tz + q[3] * ty
    way[1] = y + q[0] * ty - q[3] * tx + q[1] * tz
    way[2] = z + q[0] * tz - q[1] * ty + q[2] * tx


@inlined_kernel
def _write_plane(reaches, scratch, t, high):  # type: ignore[no-untyped-def]
    """Write the plane of `find_near` across a way that begins at shape t."""
    x, y, z = scratch.way[0], scratch.way[1], scratch.way[2]
    plane, shift, relative = scratch.plane, scratch.shift, scratch.relative
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
    place = placed(bodies.trees.points, bodies.trees.start[s], scratch.relative, scratch.shift)
    return (field_at(bodies.fields, t, place) - low) / bodies.fields.head[t, STEEP]


@bare_kernel
def _core_room(bodies, scratch, s, t, scale, gap):  # type: ignore[no-untyped-def]
    """Return how much farther than it must be the sphere at the center of shape s is from shape t; below 0 too near."""
    fields, shift = bodies.fields, scratch.shift
    core = -scale * min(field_at(fields, s, (0.0, 0.0, 0.0)), 0.0)
    distance = field_at(fields, t, (shift[0], shift[1], shift[2]))
    return (distance - core - gap) / fields.head[t, STEEP]
