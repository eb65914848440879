"""Points of a grain near one flat wall or wall of revolution.

A convex function, such as the distance from a plane, a line or a point, is largest at corners, on rims, at apices or
on curved surfaces. The farthest point of an ellipsoid, or of a rim, from a point or an axis satisfies a secular
equation with one root above the largest squared semi-axis (Golub 1973, doi:10.1137/1015032).
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.candidates import add_candidate
from voxgran.contacts.manifolds.wall_bodies import CONE, CYLINDER, ELLIPSOID, POINTS, WallBodies
from voxgran.geometry.walls import directions_toward

#: halvings of the bracket of a root, after which it has the width of rounding
HALVINGS = 70
#: steps from the side opposite to the farthest point to a second maximum of the distance
STEPS = 30
#: directions around a cone between which the farthest points of a smooth solid are looked for, and the golden section
DIRECTIONS, GOLDEN = 32, 0.5 * (3.0 - math.sqrt(5.0))
#: cosine between two directions above which they are one
SAME = 0.98


@bare_kernel
def support_of(kind: int, size: Floats, ring: int, vx: float, vy: float, vz: float) -> tuple[float, float, float]:
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
    return 0 if kind == POINTS else (2 if kind == CYLINDER else 1)


@bare_kernel
def set_frame(bodies: WallBodies, shape: int, matrix: Floats) -> None:
    """Write the axes of a smooth solid in space."""
    turn, frame = bodies.turn[shape], bodies.frame
    for i in range(3):
        for k in range(3):
            frame[i, k] = matrix[i, 0] * turn[0, k] + matrix[i, 1] * turn[1, k] + matrix[i, 2] * turn[2, k]


@bare_kernel
def support_arm(
    bodies: WallBodies, shape: int, scale: float, ring: int, nx: float, ny: float, nz: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the arm of the support point along a normal, of a smooth solid whose frame is set."""
    w = bodies.frame
    vx, vy, vz = (
        w[0, 0] * nx + w[1, 0] * ny + w[2, 0] * nz,
        w[0, 1] * nx + w[1, 1] * ny + w[2, 1] * nz,
        w[0, 2] * nx + w[1, 2] * ny + w[2, 2] * nz,
    )
    x, y, z = support_of(bodies.kind[shape], bodies.size[shape], ring, vx, vy, vz)
    return (
        scale * (w[0, 0] * x + w[0, 1] * y + w[0, 2] * z),
        scale * (w[1, 0] * x + w[1, 1] * y + w[1, 2] * z),
        scale * (w[2, 0] * x + w[2, 1] * y + w[2, 2] * z),
    )


@bare_kernel
def near_plane(
    bodies: WallBodies, shape: int, scale: float, m: Floats, nx: float, ny: float, nz: float, room: float,
    reach: float, smooth: object,
) -> int:  # fmt: skip
    """Write the points within reach of a plane with a normal, `room` from the centroid; return how many there are.

    smooth: None where no shape is a smooth solid.
    """
    found, point, margin = bodies.found, bodies.point, bodies.margin
    ux, uy, uz = (
        m[0, 0] * nx + m[1, 0] * ny + m[2, 0] * nz,
        m[0, 1] * nx + m[1, 1] * ny + m[2, 1] * nz,
        m[0, 2] * nx + m[1, 2] * ny + m[2, 2] * nz,
    )
    c = 0
    for k in range(bodies.start[shape], bodies.start[shape + 1]):
        x, y, z, r = point[k, 0], point[k, 1], point[k, 2], margin[k]
        gap = room - scale * (x * ux + y * uy + z * uz + r)
        if gap <= reach:
            ax = scale * (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + r * nx)
            ay = scale * (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + r * ny)
            az = scale * (m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + r * nz)
            c = add_candidate(found, c, ax, ay, az, nx, ny, nz, gap)
    if smooth is None:
        return c
    kind = bodies.kind[shape]
    if kind != POINTS:
        set_frame(bodies, shape, m)
        for ring in range(rings_of(kind)):
            ax, ay, az = support_arm(bodies, shape, scale, ring, nx, ny, nz)
            gap = room - ax * nx - ay * ny - az * nz
            if gap <= reach:
                c = add_candidate(found, c, ax, ay, az, nx, ny, nz, gap)
    return c


@bare_kernel
def near_round(
    bodies: WallBodies, shape: int, scale: float, m: Floats, x: float, y: float, z: float, wall: Floats, reach: float,
    smooth: object,
) -> int:  # fmt: skip
    """Write the points within reach of a wall of revolution, given by its row; return how many there are.

    The centroid is at (x, y, z).
    """
    point, margin, c = bodies.point, bodies.margin, 0
    dx, dy, dz, flat = x - wall[0], y - wall[1], z - wall[2], wall[3]
    for k in range(bodies.start[shape], bodies.start[shape + 1]):
        x, y, z = point[k, 0], point[k, 1], point[k, 2]
        ax = scale * (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z)
        ay = scale * (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z)
        az = scale * (m[2, 0] * x + m[2, 1] * y + m[2, 2] * z)
        c = _add_round(bodies.found, c, ax, ay, az, scale * margin[k], dx, dy, dz, wall, reach)
    if smooth is None:
        return c
    kind = bodies.kind[shape]
    if kind != POINTS:
        set_frame(bodies, shape, m)
    if wall[5] != 0.0:
        return _near_cone(bodies, shape, scale, dx, dy, dz, wall, reach, c)
    for ring in range(rings_of(kind)):
        nx, ny, nz = _farthest_way(bodies, shape, scale, ring, dx, dy, dz, flat)
        ax, ay, az = support_arm(bodies, shape, scale, ring, nx, ny, nz)
        c = _add_round(bodies.found, c, ax, ay, az, 0.0, dx, dy, dz, wall, reach)
        # a long grain may touch at both of its ends
        ox, oy, oz = -nx, -ny, -nz
        for _ in range(STEPS):
            ax, ay, az = support_arm(bodies, shape, scale, ring, ox, oy, oz)
            px, py, pz = dx + ax, dy + ay, (dz + az) * flat
            length = math.sqrt(px * px + py * py + pz * pz)
            if length == 0.0 or px * nx + py * ny + pz * nz > SAME * length:
                break
            change = 1.0 - (px * ox + py * oy + pz * oz) / length
            ox, oy, oz = px / length, py / length, pz / length
            if change < 1e-12:
                c = _add_round(bodies.found, c, ax, ay, az, 0.0, dx, dy, dz, wall, reach)
                break
    return c


@bare_kernel
def _add_round(found, c, ax, ay, az, r, dx, dy, dz, wall, reach):  # type: ignore[no-untyped-def]
    """Add the point of a sphere of radius r that is nearest to a wall of revolution, if it is within reach."""
    px, py, pz = dx + ax, dy + ay, (dz + az) * wall[3]
    length = math.sqrt(px * px + py * py + pz * pz)
    cosine, sine = wall[4], wall[5]
    gap = wall[6] - (cosine * length + sine * (dz + az)) - r
    if gap > reach:
        return c
    if length == 0.0:
        return add_candidate(found, c, ax + r * cosine, ay, az + r * sine, cosine, 0.0, sine, gap)
    nx, ny, nz = cosine * px / length, cosine * py / length, cosine * pz / length + sine
    return add_candidate(found, c, ax + r * nx, ay + r * ny, az + r * nz, nx, ny, nz, gap)


@bare_kernel
def _near_cone(bodies, shape, scale, dx, dy, dz, wall, reach, c):  # type: ignore[no-untyped-def]
    """Add the points of a smooth solid or its rims that are nearest to a cone, of each side that has one."""
    kind, size, frame = bodies.kind[shape], bodies.size[shape], bodies.frame
    for ring in range(rings_of(kind)):
        height = 0.0 if kind == ELLIPSOID else scale * support_of(kind, size, ring, 0.0, 0.0, 1.0)[2]
        wide = scale * (max(size[0], size[1], size[2]) if kind == ELLIPSOID else size[0])
        start, step = directions_toward(dx + frame[0, 2] * height, dy + frame[1, 2] * height, wide, DIRECTIONS)
        before = _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, start - step)[3]
        now = _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, start)[3]
        for k in range(DIRECTIONS + 1):
            angle = start + k * step
            after = _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, angle + step)[3]
            if now >= before and now > after:
                low, high = angle - step, angle + step
                for _ in range(HALVINGS):
                    one, two = low + GOLDEN * (high - low), high - GOLDEN * (high - low)
                    if (
                        _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, one)[3]
                        >= _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, two)[3]
                    ):
                        high = two
                    else:
                        low = one
                ax, ay, az, _ = _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, 0.5 * (low + high))
                c = _add_round(bodies.found, c, ax, ay, az, 0.0, dx, dy, dz, wall, reach)
            before, now = now, after
    return c


@bare_kernel
def _beyond_cone(bodies, shape, scale, ring, dx, dy, wall, angle):  # type: ignore[no-untyped-def]
    """Return the arm of the support point along the normal of a cone at an angle, and how far it is along this."""
    u, v = math.cos(angle), math.sin(angle)
    nx, ny, nz = wall[4] * u, wall[4] * v, wall[5]
    ax, ay, az = support_arm(bodies, shape, scale, ring, nx, ny, nz)
    return ax, ay, az, (dx + ax) * nx + (dy + ay) * ny + az * nz


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
        px, py, pz = (
            w[0, 0] * dx + w[1, 0] * dy + w[2, 0] * dz,
            w[0, 1] * dx + w[1, 1] * dy + w[2, 1] * dz,
            w[0, 2] * dx + w[1, 2] * dy + w[2, 2] * dz,
        )
        u, v, t = _farthest_point(sx, sy, sz, px, py, pz)
        return (
            w[0, 0] * u + w[0, 1] * v + w[0, 2] * t,
            w[1, 0] * u + w[1, 1] * v + w[1, 2] * t,
            w[2, 0] * u + w[2, 1] * v + w[2, 2] * t,
        )
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
    """Return the direction from the origin to its farthest point of an ellipsoid with semi-axes a, b, c at (x, y, z).

    With a multiplier k the unit vector u of the point is a x / (k - a^2) and so on.
    """
    la, lb, lc = a * abs(x), b * abs(y), c * abs(z)
    aa, bb, cc = a * a, b * b, c * c
    top = max(aa, bb, cc)
    low, high = top, top + math.sqrt(la * la + lb * lb + lc * lc)
    for _ in range(HALVINGS):
        k = 0.5 * (low + high)
        if k <= low or k >= high:
            break
        # no division: k may be at a pole
        square = (
            (0.0 if la == 0.0 else (la / (k - aa)) ** 2)
            + (0.0 if lb == 0.0 else (lb / (k - bb)) ** 2)
            + (0.0 if lc == 0.0 else (lc / (k - cc)) ** 2)
        )
        if square <= 1.0:
            high = k
        else:
            low = k
    u = la / (high - aa) if la > 0.0 and high > aa else 0.0
    v = lb / (high - bb) if lb > 0.0 and high > bb else 0.0
    t = lc / (high - cc) if lc > 0.0 and high > cc else 0.0
    # what is missing from unit length lies along the longest axis
    if aa == top:
        u = math.sqrt(max(1.0 - v * v - t * t, 0.0))
    elif bb == top:
        v = math.sqrt(max(1.0 - u * u - t * t, 0.0))
    else:
        t = math.sqrt(max(1.0 - u * u - v * v, 0.0))
    px = abs(x) + a * u
    py = abs(y) + b * v
    pz = abs(z) + c * t
    length = max(math.sqrt(px * px + py * py + pz * pz), 1e-300)
    px, py, pz = px / length, py / length, pz / length
    return (px if x >= 0.0 else -px), (py if y >= 0.0 else -py), (pz if z >= 0.0 else -pz)
