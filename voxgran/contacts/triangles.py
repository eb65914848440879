"""Nearest points of two triangles, and of two surfaces with box trees.

The nearest points of two disjoint triangles are a corner and a point of a face, or points of two edges; if the
triangles intersect, an edge of one pierces the other. All fifteen cases and the six piercings are tested in double
precision.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.tree import TriangleTree, closest_on_triangle

#: corners, low, high and start of a box tree, as kernels take them
TreeArrays = tuple[Floats, Floats, Floats, Integers]


def nearest_points(
    one: TriangleTree, other: TriangleTree, *, matrix: Floats, offset: Floats, reach: float = math.inf
) -> tuple[float, Floats, Floats]:
    """Return the distance of two surfaces and the nearest point of each, in the frame and unit of `one`.

    The distance is 0 if the surfaces meet, infinite if nothing is within `reach`.
    """
    found = np.zeros(6)
    turn, place = np.ascontiguousarray(matrix), np.ascontiguousarray(offset)
    square = find_nearest_pair(one.arrays, other.arrays, turn, np.abs(matrix), place, float(reach), found)
    return math.sqrt(square), found[:3], found[3:]


@kernel
def pair_bound(
    one: TreeArrays, a: int, other: TreeArrays, b: int, matrix: Floats, size: Floats, offset: Floats
) -> float:
    """Return a lower bound of the squared distance of box a from the contents of box b."""
    _, low, high, _ = one
    _, other_low, other_high, _ = other
    bound = 0.0
    for i in range(3):
        center, half = offset[i], 0.0
        for j in range(3):
            center += matrix[i, j] * 0.5 * (other_low[b, j] + other_high[b, j])
            half += size[i, j] * 0.5 * (other_high[b, j] - other_low[b, j])
        gap = max(low[a, i] - center - half, center - half - high[a, i], 0.0)
        bound += gap * gap
    return bound


@kernel
def find_nearest_pair(
    one: TreeArrays, other: TreeArrays, matrix: Floats, size: Floats, offset: Floats, reach: float, found: Floats
) -> float:
    """Traverse both trees, closer boxes first; write both points and return the squared distance."""
    corners, low, high, start = one
    other_corners, other_low, other_high, other_start = other
    best, hit = reach * reach, False
    leaves, other_leaves = len(low) // 2, len(other_low) // 2
    stack, bounds = np.zeros((256, 2), dtype=np.int64), np.zeros(256)
    turned, points, depth = np.zeros((16, 3, 3)), np.zeros(6), 1
    while depth > 0:
        depth -= 1
        a, b = stack[depth, 0], stack[depth, 1]
        if bounds[depth] > best:
            continue
        if a >= leaves and b >= other_leaves:
            turn_triangles(other_corners, other_start[b, 0], other_start[b, 1], matrix, offset, turned)
            for i in range(start[a, 0], start[a, 1]):
                for j in range(other_start[b, 1] - other_start[b, 0]):
                    if box_gap(corners, i, turned, j) > best:
                        continue
                    square = triangle_distance(corners, i, turned, j, points)
                    if square < best or (not hit and square == best):
                        best, hit = square, True
                        for k in range(6):
                            found[k] = points[k]
            if best == 0.0 and hit:
                return 0.0
            continue
        wide = 0.0
        for i in range(3):
            wide += abs(high[a, i] - low[a, i])
            for j in range(3):
                wide -= size[i, j] * (other_high[b, j] - other_low[b, j])
        split_one = a < leaves and (wide >= 0.0 or b >= other_leaves)
        for side in range(2):
            c = 2 * a + 1 + side if split_one else a
            d = b if split_one else 2 * b + 1 + side
            stack[depth + side, 0], stack[depth + side, 1] = c, d
            bounds[depth + side] = pair_bound(one, c, other, d, matrix, size, offset)
        if bounds[depth] < bounds[depth + 1]:
            for k in range(2):
                stack[depth, k], stack[depth + 1, k] = stack[depth + 1, k], stack[depth, k]
            bounds[depth], bounds[depth + 1] = bounds[depth + 1], bounds[depth]
        depth += 2
    return best if hit else np.inf


@kernel
def turn_triangles(corners: Floats, first: int, last: int, matrix: Floats, offset: Floats, turned: Floats) -> None:
    """Write the triangles first ... last in the frame of the other surface."""
    for k in range(first, last):
        for c in range(3):
            for i in range(3):
                turned[k - first, c, i] = (
                    matrix[i, 0] * corners[k, c, 0]
                    + matrix[i, 1] * corners[k, c, 1]
                    + matrix[i, 2] * corners[k, c, 2]
                    + offset[i]
                )


@kernel
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


@kernel
def triangle_distance(one: Floats, i: int, other: Floats, j: int, points: Floats) -> float:
    """Return the squared distance of triangles one[i] and other[j]; write the nearest points."""
    best = np.inf
    for c in range(3):
        x, y, z = other[j, c, 0], other[j, c, 1], other[j, c, 2]
        px, py, pz, _ = closest_on_triangle(one, i, x, y, z)
        best = _keep_nearer(points, best, px, py, pz, x, y, z)
        x, y, z = one[i, c, 0], one[i, c, 1], one[i, c, 2]
        px, py, pz, _ = closest_on_triangle(other, j, x, y, z)
        best = _keep_nearer(points, best, x, y, z, px, py, pz)
    for c in range(3):
        for d in range(3):
            best = _try_edges(one, i, c, other, j, d, points, best)
    for c in range(3):
        if best > 0.0 and (_pierces(one, i, c, other, j, points) or _pierces(other, j, c, one, i, points)):
            best = 0.0
    return best


@kernel
def _keep_nearer(points, best, ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """Write two points where they are nearer than the best ones; return the lesser squared distance."""
    square = (ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2
    if square < best:
        points[0], points[1], points[2] = ax, ay, az
        points[3], points[4], points[5] = bx, by, bz
        return square
    return best


@kernel
def _try_edges(one, i, c, other, j, d, points, best):  # type: ignore[no-untyped-def]
    """Compare with the nearest inner points of edge c of one[i] and edge d of other[j].

    Cross products keep the digits that the usual difference of squares loses for nearly parallel edges; the ends of
    edges are corners, which are tested elsewhere.
    """
    c2, d2 = (c + 1) % 3, (d + 1) % 3
    px, py, pz = one[i, c, 0], one[i, c, 1], one[i, c, 2]
    ux, uy, uz = one[i, c2, 0] - px, one[i, c2, 1] - py, one[i, c2, 2] - pz
    qx, qy, qz = other[j, d, 0], other[j, d, 1], other[j, d, 2]
    vx, vy, vz = other[j, d2, 0] - qx, other[j, d2, 1] - qy, other[j, d2, 2] - qz
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    rx, ry, rz = qx - px, qy - py, qz - pz
    s = (ry * vz - rz * vy) * nx + (rz * vx - rx * vz) * ny + (rx * vy - ry * vx) * nz
    t = (ry * uz - rz * uy) * nx + (rz * ux - rx * uz) * ny + (rx * uy - ry * ux) * nz
    if square <= 0.0 or s < 0.0 or s > square or t < 0.0 or t > square:
        return best
    s, t = s / square, t / square
    return _keep_nearer(points, best, px + s * ux, py + s * uy, pz + s * uz, qx + t * vx, qy + t * vy, qz + t * vz)


@kernel
def _pierces(one, i, c, other, j, points):  # type: ignore[no-untyped-def]
    """Return whether edge c of one[i] pierces other[j]; write the point."""
    c2 = (c + 1) % 3
    ax, ay, az = other[j, 0, 0], other[j, 0, 1], other[j, 0, 2]
    ux, uy, uz = other[j, 1, 0] - ax, other[j, 1, 1] - ay, other[j, 1, 2] - az
    vx, vy, vz = other[j, 2, 0] - ax, other[j, 2, 1] - ay, other[j, 2, 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    px, py, pz = one[i, c, 0], one[i, c, 1], one[i, c, 2]
    qx, qy, qz = one[i, c2, 0], one[i, c2, 1], one[i, c2, 2]
    above = nx * (px - ax) + ny * (py - ay) + nz * (pz - az)
    below = nx * (qx - ax) + ny * (qy - ay) + nz * (qz - az)
    if above * below >= 0.0:
        return False
    t = above / (above - below)
    x, y, z = px + t * (qx - px), py + t * (qy - py), pz + t * (qz - pz)
    for d in range(3):
        d2 = (d + 1) % 3
        ax, ay, az = other[j, d, 0], other[j, d, 1], other[j, d, 2]
        ux, uy, uz = other[j, d2, 0] - ax, other[j, d2, 1] - ay, other[j, d2, 2] - az
        wx, wy, wz = x - ax, y - ay, z - az
        side = nx * (uy * wz - uz * wy) + ny * (uz * wx - ux * wz) + nz * (ux * wy - uy * wx)
        if side < 0.0:
            return False
    points[0], points[1], points[2] = x, y, z
    points[3], points[4], points[5] = x, y, z
    return True
