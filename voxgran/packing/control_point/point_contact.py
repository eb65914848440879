"""Where grains meet: control points of one against the KD-tree of another, and against the walls.

The surface of each grain is sampled so that every point of it has a control point within half a spacing. Where two
surfaces cross, each has a control point within half of its spacing from there; so two grains whose control points keep
the mean of their spacings do not cross. Flat and round walls are convex and are tested exactly, by the corners of the
convex hull of a grain; the mesh of a closed container is sampled like a grain.
"""

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.packing.control_point.pair_cache import (
    COUNT,
    OTHER_POINT,
    PAIR,
    POINT,
    SLACK,
    PairCache,
    claim_row,
    keep_pose,
    moved_since,
    row_of_pair,
)
from voxgran.packing.control_point.point_trees import list_near, placed, point_distance
from voxgran.packing.control_point.records import HALF_SPACING, HALF_THICKNESS, RADIUS, Bodies, GrainPoses, Scratch
from voxgran.packing.control_point.relative_poses import invert, relate

#: how much farther than needed points are listed, in diameters
HORIZON = 0.04
#: more than rounding does to a distance, in diameters
ROUNDING = 1e-9


@bare_kernel
def cached_answer_by_points(
    orientation: Floats, diameter: Floats, extent: Floats, pairs: Integers, poses: Floats, lists: Integers,
    points: Floats, turn: Floats, relative: Floats, shift: Floats, g: int, j: int, gap: float, dx: float, dy: float,
    dz: float, moved: float,
) -> int:  # fmt: skip
    """Return from the cache whether grain g meets grain j as in `overlaps_by_points`: 0 no, 1 yes, 2 unknown.

    Where no point has moved by the slack since the grains were compared, only the points that were listed then can be
    too near. The answers are those that comparing the grains again would give.
    """
    a, b = min(g, j), max(g, j)
    pair = a * len(diameter) + b
    entry = row_of_pair(len(pairs), pair)
    if pairs[entry, PAIR] != pair:
        return 2
    relate(orientation, diameter, turn, relative, shift, g, j, dx, dy, dz)
    low = (gap + extent[a, HALF_SPACING] + extent[b, HALF_SPACING]) / diameter[b]
    one, other = pairs[entry, POINT], pairs[entry, OTHER_POINT]
    if one >= 0 and point_distance(points, one, other, relative, shift) < low:
        return 1
    for k in range(pairs[entry, COUNT]):
        if point_distance(points, lists[entry, k, 0], lists[entry, k, 1], relative, shift) < low:
            pairs[entry, POINT], pairs[entry, OTHER_POINT] = lists[entry, k, 0], lists[entry, k, 1]
            return 1
    if moved > extent[a, HALF_THICKNESS] or moved > extent[b, HALF_THICKNESS]:
        return 2
    way = moved_since(poses, entry, relative, shift, extent[a, RADIUS] / diameter[a])
    return 0 if way + ROUNDING < poses[entry, SLACK] else 2


@bare_kernel
def overlaps_by_points(
    grains: GrainPoses, bodies: Bodies, cache: PairCache, scratch: Scratch, g: int, j: int, gap: float, dx: float,
    dy: float, dz: float, moved: float,
) -> bool:  # fmt: skip
    """Return whether grain g, in the pose that is tried, comes nearer than a gap to grain j, or one holds the other.

    (dx, dy, dz) is the way from the center of j, or of its image, to that of g; j may be g, for an image of its own.
    `scratch.turn` is the rotation of g; `moved` bounds how far its points came: where that is little, no grain can
    have come to hold the other.
    """
    a, b = min(g, j), max(g, j)
    shape_a, shape_b, size_a, size_b = grains.shape[a], grains.shape[b], grains.diameter[a], grains.diameter[b]
    # surfaces that cross, or come nearer than the gap, have control points nearer than this
    distance = gap + grains.extent[a, HALF_SPACING] + grains.extent[b, HALF_SPACING]
    reach = grains.extent[a, RADIUS] + grains.extent[b, RADIUS] + distance
    if dx * dx + dy * dy + dz * dz > reach * reach:
        return False
    relative, shift = scratch.relative, scratch.shift
    relate(grains.orientation, grains.diameter, scratch.turn, relative, shift, g, j, dx, dy, dz)
    low, scale = distance / size_b, size_a / size_b
    count, high = list_points(bodies, scratch, shape_a, shape_b, scale, low, low + HORIZON * min(1.0, scale))
    if a != b:
        pair = a * len(grains.shape) + b
        _remember(cache.pairs, cache.poses, cache.lists, pair, relative, shift, high - low, scratch.found, count)
    if count < 0:
        return True
    if moved <= grains.extent[a, HALF_THICKNESS] and moved <= grains.extent[b, HALF_THICKNESS]:
        return False
    if holds(bodies, shape_a, shape_b, relative, shift):
        return True
    invert(relative, shift, scale)
    return holds(bodies, shape_b, shape_a, relative, shift)


@bare_kernel
def list_points(
    bodies: Bodies, scratch: Scratch, a: int, b: int, scale: float, low: float, high: float
) -> tuple[int, float]:
    """List the near control points of two shapes in the relative pose at hand."""
    trees = bodies.trees
    return list_near(
        *(trees.points, trees.start, trees.spheres, trees.first, trees.depth, a, b, scratch.relative, scratch.shift),
        *(scale, low, high, scratch.stack, scratch.found),
    )


@bare_kernel
def _remember(pairs, poses, lists, pair, relative, shift, slack, found, count):  # type: ignore[no-untyped-def]
    """Note what a comparison found; one that refused (count -1) adds its two points to what was known before."""
    entry = claim_row(pairs, poses, pair)
    if count < 0:
        pairs[entry, POINT], pairs[entry, OTHER_POINT] = found[0, 0], found[0, 1]
        return
    pairs[entry, POINT], pairs[entry, COUNT] = -1, count
    keep_pose(poses, entry, relative, shift, slack)
    for k in range(count):
        lists[entry, k, 0], lists[entry, k, 1] = found[k, 0], found[k, 1]


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
