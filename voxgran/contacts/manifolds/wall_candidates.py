"""Points of a grain near one flat wall or wall of revolution.

A convex function, such as the distance from a plane, a line or a point, is largest at corners, on rims, at apices or
on curved surfaces. The farthest point of an ellipsoid, or of a rim, from a point or an axis satisfies a secular
equation with one root above the largest squared semi-axis (Golub 1973, doi:10.1137/1015032).
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.candidates import add_candidate
from voxgran.contacts.manifolds.rows import Grains
from voxgran.contacts.manifolds.smooth_distance import HALVINGS, foot_on_ellipsoid
from voxgran.contacts.manifolds.wall_bodies import CONE, CYLINDER, ELLIPSOID, POINTS, SPHEROCYLINDER, WallBodies
from voxgran.geometry.vectors import Vector, add, along, dot, rotate, rotate_back, row_of, sub, times, vector_at
from voxgran.geometry.walls import directions_toward, in_frame, out_of_frame

#: steps from the side opposite to the farthest point to a second maximum of the distance
STEPS = 30
#: directions around a cone between which the farthest points of a smooth solid are looked for, and the golden section
DIRECTIONS, GOLDEN = 32, 0.5 * (3.0 - math.sqrt(5.0))
#: cosine between two directions above which they are one
SAME = 0.98


@bare_kernel
def support_of(kind: int, size: Floats, ring: int, vx: float, vy: float, vz: float) -> Vector:
    """Return the support point of an ellipsoid, or of a rim of a cylinder or cone, in its own axes.

    Along the axis of a rim, where all of its points are equal, it is the middle of the rim.
    """
    if kind == ELLIPSOID:
        x, y, z = vx * size[0], vy * size[1], vz * size[2]
        length = max(math.sqrt(x * x + y * y + z * z), 1e-300)
        return x * size[0] / length, y * size[1] / length, z * size[2] / length
    height = -0.25 * size[1] if kind == CONE else (ring - 0.5) * size[1]
    flat = math.sqrt(vx * vx + vy * vy)
    share = size[0] / flat if flat > 1e-14 else 0.0
    return share * vx, share * vy, height


@bare_kernel
def rings_of(kind: int) -> int:
    """Return how many smooth curves or surfaces of a kind have support points."""
    return 0 if kind in (POINTS, SPHEROCYLINDER) else (2 if kind == CYLINDER else 1)


@bare_kernel
def set_frame(bodies: WallBodies, shape: int, matrix: Floats) -> None:
    """Write the axes of a smooth solid in space."""
    turn, frame = bodies.turn[shape], bodies.frame
    for i in range(3):
        for k in range(3):
            frame[i, k] = matrix[i, 0] * turn[0, k] + matrix[i, 1] * turn[1, k] + matrix[i, 2] * turn[2, k]


@bare_kernel
def support_arm(bodies: WallBodies, shape: int, scale: float, ring: int, normal: Vector) -> Vector:
    """Return the arm of the support point along a normal, of a smooth solid whose frame is set."""
    vx, vy, vz = rotate_back(bodies.frame, normal)
    point = support_of(bodies.kind[shape], bodies.size[shape], ring, vx, vy, vz)
    return times(rotate(bodies.frame, point), scale)


@bare_kernel
def near_plane(bodies: WallBodies, grains: Grains, g: int, normal: Vector, room: float, reach: float) -> int:
    """Write the points within reach of a plane with a normal, `room` from the centroid; return how many there are."""
    shape, scale, m, c = grains.shape[g], grains.scale[g], grains.matrix[g], 0
    way = rotate_back(m, normal)
    for k in range(bodies.start[shape], bodies.start[shape + 1]):
        point, r = row_of(bodies.point, k), bodies.margin[k]
        gap = room - scale * (dot(point, way) + r)
        if gap <= reach:
            arm = times(along(rotate(m, point), r, normal), scale)
            c = add_candidate(bodies.found, c, arm, normal, gap)
    kind = bodies.kind[shape]
    if kind != POINTS:
        set_frame(bodies, shape, m)
        for ring in range(rings_of(kind)):
            ax, ay, az = support_arm(bodies, shape, scale, ring, normal)
            gap = room - ax * normal[0] - ay * normal[1] - az * normal[2]
            if gap <= reach:
                c = add_candidate(bodies.found, c, (ax, ay, az), normal, gap)
    return c


@bare_kernel
def near_round(bodies: WallBodies, grains: Grains, g: int, wall: Floats, reach: float) -> int:
    """Write the points within reach of a wall of revolution, given by its row; return how many there are."""
    shape, scale, m, c = grains.shape[g], grains.scale[g], grains.matrix[g], 0
    place = in_frame(wall, sub(row_of(grains.position, g), vector_at(wall, 0)))
    dx, dy, dz = place
    for k in range(bodies.start[shape], bodies.start[shape + 1]):
        arm = in_frame(wall, times(rotate(m, row_of(bodies.point, k)), scale))
        c = _add_round(bodies.found, c, arm, scale * bodies.margin[k], place, wall, reach)
    kind, frame = bodies.kind[shape], bodies.frame
    if kind != POINTS:
        set_frame(bodies, shape, m)
        for k in range(3):
            column = in_frame(wall, (frame[0, k], frame[1, k], frame[2, k]))
            frame[0, k], frame[1, k], frame[2, k] = column
    if wall[5] != 0.0:
        return _near_cone(bodies, shape, scale, place, wall, reach, c)
    for ring in range(rings_of(kind)):
        normal = _farthest_way(bodies, shape, scale, ring, dx, dy, dz, wall[3])
        c = _add_round(bodies.found, c, support_arm(bodies, shape, scale, ring, normal), 0.0, place, wall, reach)
        # a long grain may touch at both of its ends
        other = times(normal, -1.0)
        for _ in range(STEPS):
            arm = support_arm(bodies, shape, scale, ring, other)
            x, y, z = add(place, arm)
            ahead = (x, y, z * wall[3])
            length = math.sqrt(dot(ahead, ahead))
            if length == 0.0 or dot(ahead, normal) > SAME * length:
                break
            change = 1.0 - dot(ahead, other) / length
            other = ahead[0] / length, ahead[1] / length, ahead[2] / length
            if change < 1e-12:
                c = _add_round(bodies.found, c, arm, 0.0, place, wall, reach)
                break
    return c


@bare_kernel
def _add_round(found, c, arm, r, place, wall, reach):  # type: ignore[no-untyped-def]
    """Add the point of a sphere of radius r that is nearest to a wall of revolution, if it is within reach.

    place: of the centroid, from the middle of the wall; with the arm, in the frame of the wall.
    """
    x, y, z = add(place, arm)
    flat = (x, y, z * wall[3])
    length = math.sqrt(dot(flat, flat))
    cosine, sine = wall[4], wall[5]
    gap = wall[6] - (cosine * length + sine * z) - r
    if gap > reach:
        return c
    normal = (cosine, 0.0, sine)
    if length > 0.0:
        normal = cosine * flat[0] / length, cosine * flat[1] / length, cosine * flat[2] / length + sine
    normal = out_of_frame(wall, normal)
    return add_candidate(found, c, along(out_of_frame(wall, arm), r, normal), normal, gap)


@bare_kernel
def _near_cone(bodies, shape, scale, place, wall, reach, c):  # type: ignore[no-untyped-def]
    """Add the points of a smooth solid or its rims that are nearest to a cone, of each side that has one."""
    kind, size, frame, (dx, dy, _) = bodies.kind[shape], bodies.size[shape], bodies.frame, place
    for ring in range(rings_of(kind)):
        height = 0.0 if kind == ELLIPSOID else scale * support_of(kind, size, ring, 0.0, 0.0, 1.0)[2]
        wide = scale * (max(size[0], size[1], size[2]) if kind == ELLIPSOID else size[0])
        start, step = directions_toward(dx + frame[0, 2] * height, dy + frame[1, 2] * height, wide, DIRECTIONS)
        before = _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, start - step)[1]
        now = _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, start)[1]
        for k in range(DIRECTIONS + 1):
            angle = start + k * step
            after = _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, angle + step)[1]
            if now >= before and now > after:
                low, high = angle - step, angle + step
                for _ in range(HALVINGS):
                    one, two = low + GOLDEN * (high - low), high - GOLDEN * (high - low)
                    if (
                        _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, one)[1]
                        >= _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, two)[1]
                    ):
                        high = two
                    else:
                        low = one
                arm, _ = _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, 0.5 * (low + high))
                c = _add_round(bodies.found, c, arm, 0.0, place, wall, reach)
            before, now = now, after
    return c


@bare_kernel
def _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, angle):  # type: ignore[no-untyped-def]
    """Return the arm of the support point along the normal of a cone at an angle, and how far it is along this."""
    u, v = math.cos(angle), math.sin(angle)
    nx, ny, nz = wall[4] * u, wall[4] * v, wall[5]
    ax, ay, az = support_arm(bodies, shape, scale, ring, (nx, ny, nz))
    return (ax, ay, az), (dx + ax) * nx + (dy + ay) * ny + az * nz


@bare_kernel
def _farthest_way(bodies, shape, scale, ring, dx, dy, dz, flat):  # type: ignore[no-untyped-def]
    """Return the direction from the axis or center of a round wall to the farthest point of a smooth solid or rim."""
    w, size, kind = bodies.frame, bodies.size[shape], bodies.kind[shape]
    sx, sy, sz = scale * size[0], scale * size[1], scale * size[2]
    if kind != ELLIPSOID:
        height = scale * support_of(kind, size, ring, 0.0, 0.0, 1.0)[2]
        dx, dy, dz = dx + w[0, 2] * height, dy + w[1, 2] * height, dz + w[2, 2] * height
        sy, sz = sx, 0.0
    if flat == 1.0:
        px, py, pz = rotate_back(w, (dx, dy, dz))
        return rotate(w, _farthest_point(sx, sy, sz, px, py, pz))
    # semi-axes of the projected ellipse
    xx = (sx * w[0, 0]) ** 2 + (sy * w[0, 1]) ** 2 + (sz * w[0, 2]) ** 2
    yy = (sx * w[1, 0]) ** 2 + (sy * w[1, 1]) ** 2 + (sz * w[1, 2]) ** 2
    xy = sx * sx * w[0, 0] * w[1, 0] + sy * sy * w[0, 1] * w[1, 1] + sz * sz * w[0, 2] * w[1, 2]
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    cosine, sine = math.cos(angle), math.sin(angle)
    long = xx * cosine * cosine + 2.0 * xy * cosine * sine + yy * sine * sine
    short = xx * sine * sine - 2.0 * xy * cosine * sine + yy * cosine * cosine
    px, py = cosine * dx + sine * dy, cosine * dy - sine * dx
    u, v, _ = _farthest_point(math.sqrt(max(long, 0.0)), math.sqrt(max(short, 0.0)), 0.0, px, py, 0.0)
    return cosine * u - sine * v, sine * u + cosine * v, 0.0


@bare_kernel
def _farthest_point(a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return the direction from the origin to its farthest point of an ellipsoid with semi-axes a to c at (x, y, z)."""
    u, v, t = foot_on_ellipsoid(a, b, c, (x, y, z), -1.0)
    px = abs(x) + a * u
    py = abs(y) + b * v
    pz = abs(z) + c * t
    length = max(math.sqrt(px * px + py * py + pz * pz), 1e-300)
    px, py, pz = px / length, py / length, pz / length
    return (px if x >= 0.0 else -px), (py if y >= 0.0 else -py), (pz if z >= 0.0 else -pz)
