"""Nearest features of two triangles, and whether they are a minimum of the distance of their surfaces.

Features are numbered as by :func:`voxgran._base.tree.closest_on_triangle`: 0 face, 1-3 edges, 4-6 corners. A direction
from one surface to another belongs to a minimum if it lies in the normal cone of each feature: no neighbouring face or
edge leads nearer to the other surface.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran._base.tree import closest_on_triangle
from voxgran.settling.finding.distance_grids import SurfaceBodies

#: sine by which a direction may leave a normal cone, where the other feature is a face, and else
WIDE, NARROW = 0.5, 0.05


@bare_kernel
def place_triangle(corner: Floats, t: int, pose: Floats, stretch: float, placed: Floats, k: int) -> None:
    """Write triangle t of j in the frame and unit of i."""
    for c in range(3):
        x, y, z = corner[t, c, 0] * stretch, corner[t, c, 1] * stretch, corner[t, c, 2] * stretch
        for r in range(3):
            placed[k, c, r] = pose[r] / pose[12] + pose[3 + 3 * r] * x + pose[4 + 3 * r] * y + pose[5 + 3 * r] * z


@bare_kernel
def _side_of(one, a, other, b, points):  # type: ignore[no-untyped-def]
    """Write the heights of the corners of other[b] over the plane of one[a] to points[6:9]; return their bound.

    The bound is the distance of a triangle from the plane, 0 if it crosses it and below 0 for a plane that is none.
    """
    ax, ay, az = one[a, 0, 0], one[a, 0, 1], one[a, 0, 2]
    ux, uy, uz = one[a, 1, 0] - ax, one[a, 1, 1] - ay, one[a, 1, 2] - az
    vx, vy, vz = one[a, 2, 0] - ax, one[a, 2, 1] - ay, one[a, 2, 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    low, high = 1e300, -1e300
    for c in range(3):
        height = 0.0
        if length > 0.0:
            x, y, z = other[b, c, 0] - ax, other[b, c, 1] - ay, other[b, c, 2] - az
            height = (nx * x + ny * y + nz * z) / length
        points[6 + c] = abs(height)
        low, high = min(low, height), max(high, height)
    if length == 0.0:
        return -1.0
    return max(low, -high, 0.0)


@bare_kernel
def _keep(points, best, ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """Write two points if they are nearer than the best; return the lesser squared distance."""
    square = (ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2
    if square < best:
        points[0], points[1], points[2] = ax, ay, az
        points[3], points[4], points[5] = bx, by, bz
        return square
    return best


@bare_kernel
def nearest_features(
    one: Floats, a: int, other: Floats, b: int, points: Floats, limit: float, pierce: bool,
) -> tuple[float, int, int]:  # fmt: skip
    """Return squared distance and features of the nearest points of triangles one[a] and other[b], written to points.

    limit: distance beyond which the points are not wanted: the features are then -1 and the square is a lower bound, at
    least that of the limit.  pierce: whether the triangles may cross, which has the distance 0.
    """
    best, mine, theirs = limit * limit, -1, -1
    bound = _side_of(other, b, one, a, points)
    if bound > limit:
        return bound * bound, -1, -1
    pierce = pierce and bound == 0.0
    for c in range(3):
        if points[6 + c] * points[6 + c] <= best:
            x, y, z = one[a, c, 0], one[a, c, 1], one[a, c, 2]
            px, py, pz, feature = closest_on_triangle(other, b, x, y, z)
            square = _keep(points, best, x, y, z, px, py, pz)
            if square < best:
                best, mine, theirs = square, 4 + c, feature
    bound = _side_of(one, a, other, b, points)
    if bound > limit:
        return bound * bound, -1, -1
    pierce = pierce and bound == 0.0
    for c in range(3):
        if points[6 + c] * points[6 + c] <= best:
            x, y, z = other[b, c, 0], other[b, c, 1], other[b, c, 2]
            px, py, pz, feature = closest_on_triangle(one, a, x, y, z)
            square = _keep(points, best, px, py, pz, x, y, z)
            if square < best:
                best, mine, theirs = square, feature, 4 + c
    for c in range(3):
        for d in range(3):
            square = _try_edges(one, a, c, other, b, d, points, best)
            if square < best:
                best, mine, theirs = square, 1 + c, 1 + d
    if pierce:
        for c in range(3):
            if _pierces(one, a, c, other, b, points) or _pierces(other, b, c, one, a, points):
                return 0.0, 0, 0
    return best, mine, theirs


@bare_kernel
def _try_edges(one, i, c, other, j, d, points, best):  # type: ignore[no-untyped-def]
    """Compare with the nearest inner points of edge c of one[i] and edge d of other[j]."""
    c2, d2 = (c + 1) % 3, (d + 1) % 3
    px, py, pz = one[i, c, 0], one[i, c, 1], one[i, c, 2]
    ux, uy, uz = one[i, c2, 0] - px, one[i, c2, 1] - py, one[i, c2, 2] - pz
    qx, qy, qz = other[j, d, 0], other[j, d, 1], other[j, d, 2]
    vx, vy, vz = other[j, d2, 0] - qx, other[j, d2, 1] - qy, other[j, d2, 2] - qz
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    rx, ry, rz = qx - px, qy - py, qz - pz
    along = rx * nx + ry * ny + rz * nz
    if square <= 0.0 or along * along > best * square:
        return best
    s = (ry * vz - rz * vy) * nx + (rz * vx - rx * vz) * ny + (rx * vy - ry * vx) * nz
    t = (ry * uz - rz * uy) * nx + (rz * ux - rx * uz) * ny + (rx * uy - ry * ux) * nz
    if s < 0.0 or s > square or t < 0.0 or t > square:
        return best
    s, t = s / square, t / square
    return _keep(points, best, px + s * ux, py + s * uy, pz + s * uz, qx + t * vx, qy + t * vy, qz + t * vz)


@bare_kernel
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


@bare_kernel
def _in_cone(corner, pseudo, fan, fan_rows, t, feature, x, y, z, slack):  # type: ignore[no-untyped-def]
    """Return whether a unit direction lies in the normal cone of a feature, up to the sine of an angle."""
    if pseudo[t, feature, 0] * x + pseudo[t, feature, 1] * y + pseudo[t, feature, 2] * z <= 0.0:
        return False
    if feature == 0:
        return True
    if feature >= 4:
        for q in range(fan_rows[t, feature - 4, 0], fan_rows[t, feature - 4, 1]):
            if fan[q, 0] * x + fan[q, 1] * y + fan[q, 2] * z > slack:
                return False
        return True
    a, b = feature - 1, feature % 3
    ux, uy, uz = corner[t, b, 0] - corner[t, a, 0], corner[t, b, 1] - corner[t, a, 1], corner[t, b, 2] - corner[t, a, 2]
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    sign = 1.0
    for side in range(2):
        nx, ny, nz = pseudo[t, 0, 0], pseudo[t, 0, 1], pseudo[t, 0, 2]
        if side == 1:
            # the pseudo-normal of an edge is the sum of those of its faces
            nx, ny, nz = pseudo[t, feature, 0] - nx, pseudo[t, feature, 1] - ny, pseudo[t, feature, 2] - nz
            sign = -1.0
        outward = (uy * nz - uz * ny) * x + (uz * nx - ux * nz) * y + (ux * ny - uy * nx) * z
        if sign * outward < -slack * length:
            return False
    return True


@bare_kernel
def is_minimum(
    bodies: SurfaceBodies, s: int, mine: int, t: int, theirs: int, pose: Floats, x: float, y: float, z: float,
    solid_i: int, solid_j: int,
) -> bool:  # fmt: skip
    """Return whether the nearest points of triangles s of i and t of j are a minimum, up to a few degrees.

    (x, y, z): unit direction from i to j in the frame of i.  solid_i, solid_j: 0 for spheres, which have no cones.
    """
    if solid_i != 0:
        slack = WIDE if theirs == 0 else NARROW
        if not _in_cone(bodies.corner, bodies.pseudo, bodies.fan, bodies.fan_rows, s, mine, x, y, z, slack):
            return False
    if solid_j != 0:
        slack = WIDE if mine == 0 else NARROW
        u = -(pose[3] * x + pose[6] * y + pose[9] * z)
        v = -(pose[4] * x + pose[7] * y + pose[10] * z)
        w = -(pose[5] * x + pose[8] * y + pose[11] * z)
        if not _in_cone(bodies.corner, bodies.pseudo, bodies.fan, bodies.fan_rows, t, theirs, u, v, w, slack):
            return False
    return True
