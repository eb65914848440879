"""Triangles: areas, enclosed volume, nearest points of a triangle and of two.

The nearest points of two disjoint triangles are a corner and a point of a face, or points of two edges; if the
triangles intersect, an edge of one pierces the other. Features of a triangle are numbered 0 for its face, 1 to 3 for
its edges ab, bc, ca and 4 to 6 for its corners a, b, c.
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.vectors import Vector, along, corner_of, cross, dot, sub

#: square of the sine of an angle of a triangle up to which its plane is not used
SLIVER = 1e-6


def normals_of(triangles: Floats) -> Floats:
    """Return the normals of (m, 3, 3) triangles, (m, 3), each as long as twice the area."""
    u, v = ((triangles[:, k] - triangles[:, 0]).T for k in (1, 2))
    # as NumPy does in several times as long
    return np.column_stack([u[i] * v[j] - u[j] * v[i] for i, j in ((1, 2), (2, 0), (0, 1))])


def areas_of(triangles: Floats) -> Floats:
    """Return the areas of (m, 3, 3) triangles, (m,)."""
    return np.asarray(linear.norm(normals_of(triangles), axis=1) / 2)


def enclosed_volume(vertices: Floats, faces: Integers) -> float:
    """Return the volume that closed triangles enclose; it is most accurate where the origin lies among them."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float(linear.einsum("fi,fi->", a, np.cross(b, c)) / 6)


@bare_kernel
def closest_on_triangle(corners: Floats, k: int, x: float, y: float, z: float) -> tuple[float, float, float, int]:
    """Return the point of triangle k nearest to (x, y, z), and its feature.

    By the regions of the corners and edges (Ericson 2005, Real-time collision detection, section 5.1.5).
    """
    a, b, c = corner_of(corners, k, 0), corner_of(corners, k, 1), corner_of(corners, k, 2)
    point, u, v = (x, y, z), sub(b, a), sub(c, a)
    d1, d2 = dot(u, sub(point, a)), dot(v, sub(point, a))
    if d1 <= 0.0 and d2 <= 0.0:
        return a[0], a[1], a[2], 4
    d3, d4 = dot(u, sub(point, b)), dot(v, sub(point, b))
    if d3 >= 0.0 and d4 <= d3:
        return b[0], b[1], b[2], 5
    side_c = d1 * d4 - d3 * d2
    if side_c <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        px, py, pz = along(a, d1 / (d1 - d3), u)
        return px, py, pz, 1
    d5, d6 = dot(u, sub(point, c)), dot(v, sub(point, c))
    if d6 >= 0.0 and d5 <= d6:
        return c[0], c[1], c[2], 6
    side_b = d5 * d2 - d1 * d6
    if side_b <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        px, py, pz = along(a, d2 / (d2 - d6), v)
        return px, py, pz, 3
    side_a = d3 * d6 - d5 * d4
    if side_a <= 0.0 and d4 >= d3 and d5 >= d6:
        px, py, pz = along(b, (d4 - d3) / ((d4 - d3) + (d5 - d6)), sub(c, b))
        return px, py, pz, 2
    share = 1.0 / (side_a + side_b + side_c)
    px, py, pz = along(along(a, side_b * share, u), side_c * share, v)
    return px, py, pz, 0


@bare_kernel
def box_gap(one: Floats, i: int, other: Floats, j: int) -> float:
    """Return the squared distance of the boxes around two triangles."""
    square = 0.0
    for k in range(3):
        low = min(one[i, 0, k], one[i, 1, k], one[i, 2, k])
        high = max(one[i, 0, k], one[i, 1, k], one[i, 2, k])
        other_low = min(other[j, 0, k], other[j, 1, k], other[j, 2, k])
        other_high = max(other[j, 0, k], other[j, 1, k], other[j, 2, k])
        gap = max(low - other_high, other_low - high, 0.0)
        square += gap * gap
    return square


@bare_kernel
def plane_gap(one: Floats, i: int, other: Floats, j: int) -> float:
    """Return the squared distance of triangle other[j] from the plane of one[i]; 0 where it meets the plane."""
    a = corner_of(one, i, 0)
    u, v = sub(corner_of(one, i, 1), a), sub(corner_of(one, i, 2), a)
    normal = cross(u, v)
    p = dot(normal, sub(corner_of(other, j, 0), a))
    q = dot(normal, sub(corner_of(other, j, 1), a))
    r = dot(normal, sub(corner_of(other, j, 2), a))
    gap = max(min(p, q, r), -max(p, q, r), 0.0)
    square = dot(normal, normal)
    # the normal of a sliver has lost its digits
    if square <= SLIVER * dot(u, u) * dot(v, v):
        return 0.0
    return gap * gap / square


@bare_kernel
def triangle_distance(one: Floats, i: int, other: Floats, j: int, points: Floats) -> float:
    """Return the squared distance of triangles one[i] and other[j]; write the nearest points."""
    best = np.inf
    for c in range(3):
        x, y, z = corner_of(other, j, c)
        px, py, pz, _ = closest_on_triangle(one, i, x, y, z)
        best = keep_nearer(points, best, (px, py, pz), (x, y, z))
        x, y, z = corner_of(one, i, c)
        px, py, pz, _ = closest_on_triangle(other, j, x, y, z)
        best = keep_nearer(points, best, (x, y, z), (px, py, pz))
    for c in range(3):
        for d in range(3):
            best = try_edges(one, i, c, other, j, d, points, best, np.inf)
    for c in range(3):
        if best > 0.0 and (pierces(one, i, c, other, j, points) or pierces(other, j, c, one, i, points)):
            best = 0.0
    return best


@inlined_kernel
def keep_nearer(points: Floats, best: float, a: Vector, b: Vector) -> float:
    """Write two points where they are nearer than the best ones; return the lesser squared distance."""
    square = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
    if square < best:
        points[0], points[1], points[2] = a
        points[3], points[4], points[5] = b
        return square
    return best


@inlined_kernel
def try_edges(
    one: Floats, i: int, c: int, other: Floats, j: int, d: int, points: Floats, best: float, limit: float
) -> float:
    """Compare with the nearest inner points of edge c of one[i] and edge d of other[j]; return the lesser square.

    Edges whose lines are further apart than the root of `limit` are not compared.
    Cross products keep the digits that the usual difference of squares loses for nearly parallel edges; the ends of
    edges are corners, which are tested elsewhere.
    """
    p, q = corner_of(one, i, c), corner_of(other, j, d)
    u, v, r = sub(corner_of(one, i, (c + 1) % 3), p), sub(corner_of(other, j, (d + 1) % 3), q), sub(q, p)
    normal = cross(u, v)
    square, apart = dot(normal, normal), dot(r, normal)
    if square <= 0.0 or apart * apart > limit * square:
        return best
    s, t = dot(cross(r, v), normal), dot(cross(r, u), normal)
    if s < 0.0 or s > square or t < 0.0 or t > square:
        return best
    return keep_nearer(points, best, along(p, s / square, u), along(q, t / square, v))


@bare_kernel
def pierces(one: Floats, i: int, c: int, other: Floats, j: int, points: Floats) -> bool:
    """Return whether edge c of one[i] pierces other[j]; write the point."""
    a = corner_of(other, j, 0)
    normal = cross(sub(corner_of(other, j, 1), a), sub(corner_of(other, j, 2), a))
    p, q = corner_of(one, i, c), corner_of(one, i, (c + 1) % 3)
    above, below = dot(normal, sub(p, a)), dot(normal, sub(q, a))
    if above * below >= 0.0:
        return False
    point = along(p, above / (above - below), sub(q, p))
    for d in range(3):
        a = corner_of(other, j, d)
        if dot(normal, cross(sub(corner_of(other, j, (d + 1) % 3), a), sub(point, a))) < 0.0:
            return False
    points[0], points[1], points[2] = point
    points[3], points[4], points[5] = point
    return True
