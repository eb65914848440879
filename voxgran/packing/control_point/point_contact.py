"""Where grains meet: control points of one against the KD-tree of another, and against the walls.

The surface of each grain is sampled so that every point of it has a control point within half a spacing. Where two
surfaces cross, each has a control point within half of its spacing from there; so two grains whose control points keep
the mean of their spacings do not cross. Flat and round walls are convex and are tested exactly, by the corners of the
convex hull of a grain; the mesh of a closed container is sampled like a grain.
"""

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.vectors import Vector, dot
from voxgran.packing.control_point.point_trees import list_near, placed, point_distance
from voxgran.packing.control_point.records import (
    COUNT,
    HALF_SPACING,
    HALF_THICKNESS,
    OTHER_POINT,
    POINT,
    RADIUS,
    Bodies,
    GrainPoses,
    Pairs,
    Scratch,
    claim_row,
    keep_pose,
)
from voxgran.packing.control_point.relative_poses import invert, relate

#: how much farther than needed points are listed, in diameters
HORIZON = 0.04


@bare_kernel
def still_refused_by_points(pairs: Pairs, row: int, a: int, b: int) -> bool:
    """Return whether two control points that the cache lists for grains a < b are too near in the pose at hand.

    Where no point has moved by the slack since the grains were compared, only the points that were listed then can be
    too near.
    """
    cache, scratch, points = pairs.cache, pairs.scratch, pairs.bodies.trees.points
    low = least_distance(pairs, a, b) / pairs.grains.diameter[b]
    one, other = cache.pairs[row, POINT], cache.pairs[row, OTHER_POINT]
    if one >= 0 and point_distance(points, one, other, scratch.relative, scratch.shift) < low:
        return True
    for k in range(cache.pairs[row, COUNT]):
        one, other = cache.lists[row, k, 0], cache.lists[row, k, 1]
        if point_distance(points, one, other, scratch.relative, scratch.shift) < low:
            cache.pairs[row, POINT], cache.pairs[row, OTHER_POINT] = one, other
            return True
    return False


@inlined_kernel
def least_distance(pairs: Pairs, a: int, b: int) -> float:
    """Return how near control points of two grains may come: surfaces that cross, or come nearer than the gap, have
    nearer ones.
    """
    return pairs.gap + pairs.grains.extent[a, HALF_SPACING] + pairs.grains.extent[b, HALF_SPACING]


@inlined_kernel
def may_hold(grains: GrainPoses, a: int, b: int, moved: float) -> bool:
    """Return whether points have moved so far that one grain can have come to hold the other."""
    return moved > grains.extent[a, HALF_THICKNESS] or moved > grains.extent[b, HALF_THICKNESS]


@bare_kernel
def overlaps_by_points(pairs: Pairs, g: int, j: int, way: Vector, moved: float) -> bool:
    """Return whether grain g, in the pose that is tried, comes nearer than a gap to grain j, or one holds the other.

    `way` leads from the center of j, or of its image, to that of g; j may be g, for an image of its own. `moved` bounds
    how far the points of g came: where that is little, no grain can have come to hold the other.
    """
    a, b = min(g, j), max(g, j)
    grains, bodies, scratch = pairs.grains, pairs.bodies, pairs.scratch
    shape_a, shape_b, unit = grains.shape[a], grains.shape[b], grains.diameter[b]
    distance = least_distance(pairs, a, b)
    reach = grains.extent[a, RADIUS] + grains.extent[b, RADIUS] + distance
    if dot(way, way) > reach * reach:
        return False
    relate(grains, scratch, g, j, way)
    low, scale = distance / unit, grains.diameter[a] / unit
    count, high = list_points(bodies, scratch, shape_a, shape_b, scale, low, low + HORIZON * min(1.0, scale))
    if a != b:
        _remember(pairs.cache, scratch, a * len(grains.shape) + b, high - low, count)
    if count < 0:
        return True
    if not may_hold(grains, a, b, moved):
        return False
    if holds(bodies, shape_a, shape_b, scratch.relative, scratch.shift):
        return True
    invert(scratch.relative, scratch.shift, scale)
    return holds(bodies, shape_b, shape_a, scratch.relative, scratch.shift)


@bare_kernel
def list_points(
    bodies: Bodies, scratch: Scratch, a: int, b: int, scale: float, low: float, high: float
) -> tuple[int, float]:
    """List the near control points of two shapes in the relative pose at hand."""
    pose = (scratch.relative, scratch.shift, scale)
    return list_near(bodies.trees, a, b, pose, low, high, scratch.stack, scratch.listed)


@bare_kernel
def _remember(cache, scratch, pair, slack, count):  # type: ignore[no-untyped-def]
    """Note the result of a comparison; one that refused (count -1) adds its two points to those noted before."""
    row, listed = claim_row(cache.pairs, cache.poses, pair), scratch.listed
    if count < 0:
        cache.pairs[row, POINT], cache.pairs[row, OTHER_POINT] = listed[0, 0], listed[0, 1]
        return
    cache.pairs[row, POINT], cache.pairs[row, COUNT] = -1, count
    keep_pose(cache.poses, row, scratch.relative, scratch.shift, slack)
    for k in range(count):
        cache.lists[row, k, 0], cache.lists[row, k, 1] = listed[k, 0], listed[k, 1]


@bare_kernel
def holds(bodies: Bodies, a: int, b: int, turn: Floats, shift: Floats) -> bool:
    """Return whether the solid b holds the first control point of a; surfaces do not cross when this is asked, so one
    tells for all.
    """
    x, y, z = placed(bodies.trees.points, bodies.trees.start[a], turn, shift)
    if x * x + y * y + z * z > bodies.radius[b] * bodies.radius[b]:
        return False
    return is_within(bodies.triangles, bodies.triangle_start[b], bodies.triangle_start[b + 1], x, y, z)


@bare_kernel
def is_within(triangles: Floats, begin: int, end: int, x: float, y: float, z: float) -> bool:
    """Return whether a point lies in the solid that triangles `begin` ... `end` - 1 bound: by the crossings of a ray
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
    """Return whether a ray from (x, y) along +x crosses an edge; the same for both directions of the edge."""
    if (ay > y) == (by > y):
        return False
    if ay > by:
        ax, ay, bx, by = bx, by, ax, ay
    return x < ax + (y - ay) * (bx - ax) / (by - ay)
