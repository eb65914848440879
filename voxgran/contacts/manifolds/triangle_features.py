"""Nearest features of two triangles, and whether they are a minimum of the distance of their surfaces.

Features are numbered as in :mod:`voxgran.geometry.triangles`. A direction from one surface to another belongs to a
minimum if it lies in the normal cone of each feature: no neighbouring face or edge leads nearer to the other surface.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.contacts.manifolds.distance_grids import SurfaceBodies
from voxgran.geometry.triangles import closest_on_triangle, keep_nearer, pierces, try_edges
from voxgran.geometry.vectors import Vector, corner_of, cross, dot, row_of, sub

#: sine by which a direction may leave a normal cone, where the other feature is a face, and else
WIDE, NARROW = 0.5, 0.05
#: share of a squared distance that rounding may take
ROUND_OFF = 1e-9


@inlined_kernel
def place_triangle(corner: Floats, t: int, pose: Floats, stretch: float, placed: Floats, k: int) -> None:
    """Write triangle t of j in the frame and unit of i."""
    for r in range(3):
        at, a, b, c = (
            pose[r] / pose[12],
            pose[3 + 3 * r] * stretch,
            pose[4 + 3 * r] * stretch,
            pose[5 + 3 * r] * stretch,
        )
        for q in range(3):
            placed[k, q, r] = at + a * corner[t, q, 0] + b * corner[t, q, 1] + c * corner[t, q, 2]


@inlined_kernel
def _side_of(normal, one, a, other, b, points):  # type: ignore[no-untyped-def]
    """Write the heights of the corners of other[b] over the plane of one[a] to points[6:9]; return their bound.

    The bound is the distance of a triangle from the plane, 0 if it crosses it.
    """
    origin, low, high = corner_of(one, a, 0), 1e300, -1e300
    for c in range(3):
        height = dot(normal, sub(corner_of(other, b, c), origin))
        points[6 + c] = abs(height)
        low, high = min(low, height), max(high, height)
    return max(low, -high, 0.0)


@bare_kernel
def nearest_features(
    one: Floats, a: int, other: Floats, b: int, points: Floats, limit: float, pierce: bool, normal: Vector,
    other_normal: Vector,
) -> tuple[float, int, int]:  # fmt: skip
    """Return squared distance and features of the nearest points of triangles one[a] and other[b], written to points.

    limit: distance beyond which the points are not wanted: the features are then -1 and the square is a lower bound, at
    least that of the limit.  pierce: whether the triangles may cross, which has the distance 0.  normal, other_normal:
    unit normals of both, or zeros.
    """
    best, mine, theirs = limit * limit, -1, -1
    bound = _side_of(other_normal, other, b, one, a, points)
    if bound > limit:
        return bound * bound, -1, -1
    pierce, least = pierce and bound == 0.0, bound
    for c in range(3):
        if points[6 + c] * points[6 + c] <= best:
            x, y, z = one[a, c, 0], one[a, c, 1], one[a, c, 2]
            px, py, pz, feature = closest_on_triangle(other, b, x, y, z)
            square = keep_nearer(points, best, (x, y, z), (px, py, pz))
            if square < best:
                best, mine, theirs = square, 4 + c, feature
    bound = _side_of(normal, one, a, other, b, points)
    if bound > limit:
        return bound * bound, -1, -1
    pierce = pierce and bound == 0.0
    least = max(least, bound)
    for c in range(3):
        if points[6 + c] * points[6 + c] <= best:
            x, y, z = other[b, c, 0], other[b, c, 1], other[b, c, 2]
            px, py, pz, feature = closest_on_triangle(one, a, x, y, z)
            square = keep_nearer(points, best, (px, py, pz), (x, y, z))
            if square < best:
                best, mine, theirs = square, feature, 4 + c
    if least > 0.0 and least * least >= best * (1.0 - ROUND_OFF):
        # a corner is as near as the plane of the other triangle: nothing is nearer
        return best, mine, theirs
    for c in range(3):
        for d in range(3):
            square = try_edges(one, a, c, other, b, d, points, best, best)
            if square < best:
                best, mine, theirs = square, 1 + c, 1 + d
    if pierce:
        for c in range(3):
            if pierces(one, a, c, other, b, points) or pierces(other, b, c, one, a, points):
                return 0.0, 0, 0
    return best, mine, theirs


@inlined_kernel
def _in_cone(bodies, t, feature, direction, slack):  # type: ignore[no-untyped-def]
    """Return whether a unit direction lies in the normal cone of a feature, up to the sine of an angle."""
    if dot(corner_of(bodies.pseudo, t, feature), direction) <= 0.0:
        return False
    if feature == 0:
        return True
    if feature >= 4:
        for q in range(bodies.fan_rows[t, feature - 4, 0], bodies.fan_rows[t, feature - 4, 1]):
            if dot(row_of(bodies.fan, q), direction) > slack:
                return False
        return True
    edge = sub(corner_of(bodies.corner, t, feature % 3), corner_of(bodies.corner, t, feature - 1))
    least = -slack * math.sqrt(dot(edge, edge))
    face = corner_of(bodies.pseudo, t, 0)
    # the pseudo-normal of an edge is the sum of those of its faces
    other = sub(corner_of(bodies.pseudo, t, feature), face)
    return dot(cross(edge, face), direction) >= least and -dot(cross(edge, other), direction) >= least


@inlined_kernel
def is_minimum(
    bodies: SurfaceBodies, s: int, mine: int, t: int, theirs: int, pose: Floats, direction: Vector, solid_i: int,
    solid_j: int,
) -> bool:  # fmt: skip
    """Return whether the nearest points of triangles s of i and t of j are a minimum, up to a few degrees.

    direction: unit vector from i to j in the frame of i.  solid_i, solid_j: 0 for spheres, which have no cones.
    """
    if solid_i != 0 and not _in_cone(bodies, s, mine, direction, WIDE if theirs == 0 else NARROW):
        return False
    if solid_j != 0:
        x, y, z = direction
        back = (
            -(pose[3] * x + pose[6] * y + pose[9] * z),
            -(pose[4] * x + pose[7] * y + pose[10] * z),
            -(pose[5] * x + pose[8] * y + pose[11] * z),
        )
        return _in_cone(bodies, t, theirs, back, WIDE if mine == 0 else NARROW)
    return True
