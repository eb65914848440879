"""Positions at which a sphere of given radius touches three spheres, or spheres and walls, in closed form.

Coordinates are relative to the center of the first sphere, so that no digits are lost far from the origin. The closed
form is followed by Newton steps until the distances agree to the last digits; otherwise the position is rejected. Of
the two solutions the order of the three determines one: exchanging two of them gives the other.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.packing.advancing_front.sphere_cells import BITS, HERE, IMAGES

#: walls are negative numbers: -1 - 2 * axis for a low one, -2 - 2 * axis for a high one, the plane of disks, and the
#: side of an upright cylinder
PLANE, SIDE = -7, -8
#: after the side of a cylinder: opposite a sphere, above it and below it
ABOVE, BENEATH = -9, -10
#: largest difference of a distance from the sum of the radii, in radii of the new sphere and in distances
NEAR, ROUNDING = 1e-13, 1e-15
#: largest numbers of Newton steps, and of bisections of an angle
STEPS, HALVINGS = 4, 80
#: squared sine below which three centers lie on a line
ON_A_LINE = 1e-12


@bare_kernel
def foot_of_spheres(
    ux: float, uy: float, uz: float, vx: float, vy: float, vz: float, d1: float, d2: float, d3: float
) -> tuple[bool, float, float, float, float, float, float]:
    """Return whether there are points at distances d1, d2, d3 from 0, u and v, their midpoint, and half their distance.

    The points are the midpoint plus and minus the vector returned last, which has the direction of u x v.
    """
    uu, vv, uv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, ux * vx + uy * vy + uz * vz
    det = uu * vv - uv * uv
    if det <= ON_A_LINE * uu * vv:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    along_u = 0.5 * ((d1 - d2) * (d1 + d2) + uu)
    along_v = 0.5 * ((d1 - d3) * (d1 + d3) + vv)
    s, t = (along_u * vv - along_v * uv) / det, (along_v * uu - along_u * uv) / det
    x, y, z = s * ux + t * vx, s * uy + t * vy, s * uz + t * vz
    height = d1 * d1 - (x * x + y * y + z * z)
    if height < 0.0:
        return False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    up = math.sqrt(height / det)
    return True, x, y, z, up * (uy * vz - uz * vy), up * (uz * vx - ux * vz), up * (ux * vy - uy * vx)


@bare_kernel
def touch_spheres(
    ux: float, uy: float, uz: float, vx: float, vy: float, vz: float, d1: float, d2: float, d3: float, near: float
) -> tuple[bool, float, float, float]:
    """Return whether there is a point at distances d1, d2, d3 from 0, u and v, and the one on the side of u x v.

    `near` is the tolerance of the distances.
    """
    found, x, y, z, hx, hy, hz = foot_of_spheres(ux, uy, uz, vx, vy, vz, d1, d2, d3)
    if not found:
        return False, 0.0, 0.0, 0.0
    x, y, z = x + hx, y + hy, z + hz
    for step in range(STEPS):
        bx, by, bz, cx, cy, cz = x - ux, y - uy, z - uz, x - vx, y - vy, z - vz
        la = math.sqrt(x * x + y * y + z * z)
        lb = math.sqrt(bx * bx + by * by + bz * bz)
        lc = math.sqrt(cx * cx + cy * cy + cz * cz)
        fa, fb, fc = la - abs(d1), lb - abs(d2), lc - abs(d3)
        if max(abs(fa), abs(fb), abs(fc)) <= near:
            return True, x, y, z
        if step == STEPS - 1 or min(la, lb, lc) == 0.0:
            break
        # rows a, b, c of the Jacobian are the unit vectors from the centers
        ax, ay, az = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        volume = x * ax + y * ay + z * az
        if volume == 0.0:
            break
        fa, fb, fc = fa * la / volume, fb * lb / volume, fc * lc / volume
        x, y, z = (
            x - (fa * ax + fb * (cy * z - cz * y) + fc * (y * bz - z * by)),
            y - (fa * ay + fb * (cz * x - cx * z) + fc * (z * bx - x * bz)),
            z - (fa * az + fb * (cx * y - cy * x) + fc * (x * by - y * bx)),
        )
    return False, 0.0, 0.0, 0.0


@bare_kernel
def touch_disks(ux: float, uy: float, d1: float, d2: float, near: float) -> tuple[bool, float, float]:
    """Return whether a point in the plane is at distances d1 and d2 from 0 and u, and the one on the left of u.

    If d2 is negative it is the one on the right, at the distance -d2.
    """
    uu = ux * ux + uy * uy
    if uu <= 0.0:
        return False, 0.0, 0.0
    along = 0.5 * ((d1 - d2) * (d1 + d2) + uu) / uu
    height = d1 * d1 - along * along * uu
    if height < 0.0:
        return False, 0.0, 0.0
    up = math.copysign(math.sqrt(height / uu), d2)
    x, y = along * ux - up * uy, along * uy + up * ux
    for step in range(STEPS):
        bx, by = x - ux, y - uy
        la, lb = math.sqrt(x * x + y * y), math.sqrt(bx * bx + by * by)
        fa, fb = la - d1, lb - abs(d2)
        if max(abs(fa), abs(fb)) <= near:
            return True, x, y
        area = x * by - y * bx
        if step == STEPS - 1 or area == 0.0:
            break
        fa, fb = fa * la / area, fb * lb / area
        x, y = x - (fa * by - fb * y), y - (fb * x - fa * bx)
    return False, 0.0, 0.0


@bare_kernel
def center_of(spheres: Floats, periods: Floats, ref: int) -> tuple[float, float, float]:
    """Return the center of a sphere in its periodic image."""
    sphere, image = ref >> BITS, ref & (IMAGES - 1)
    x, y, z = spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2]
    if image != HERE:
        i, j, k = image % 3 - 1, image // 3 % 3 - 1, image // 9 - 1
        x += i * periods[0, 0] + j * periods[1, 0] + k * periods[2, 0]
        y += j * periods[1, 1] + k * periods[2, 1]
        z += k * periods[2, 2]
    return x, y, z


@bare_kernel
def place_at(
    spheres: Floats, lengths: Floats, periods: Floats, a: int, b: int, c: int, r: float
) -> tuple[bool, float, float, float]:
    """Return whether a sphere of radius r can touch a, b and c, and its center.

    Spheres precede walls. The position is on the left of the circuit of three spheres, or of the line from one sphere
    to the other seen along the axis across the wall; for one sphere the order of two walls decides.
    """
    ax, ay, az = center_of(spheres, periods, a)
    d1 = spheres[a >> BITS, 3] + r
    if b < 0:
        if c in (ABOVE, BENEATH):
            return _across_from(lengths, ax, ay, az, d1, r, 1.0 if c == ABOVE else -1.0)
        if SIDE in (b, c):
            return _at_side_and_flat(
                lengths, ax, ay, az, d1, min(b, c) + max(b, c) - SIDE, r, 1.0 if c == SIDE else -1.0
            )
        return _at_two_walls(lengths, ax, ay, az, d1, b, c, r)
    ux, uy, uz = center_of(spheres, periods, b)
    ux, uy, uz, d2 = ux - ax, uy - ay, uz - az, spheres[b >> BITS, 3] + r
    if c == SIDE:
        return _at_side(lengths, (ax, ay, az), (ux, uy, uz), d1, d2, r)
    if c < 0:
        return _at_wall(lengths, (ax, ay, az), (ux, uy, uz), d1, d2, c, r)
    vx, vy, vz = center_of(spheres, periods, c)
    d3 = spheres[c >> BITS, 3] + r
    near = NEAR * r + ROUNDING * max(d1, d2, d3)
    found, x, y, z = touch_spheres(ux, uy, uz, vx - ax, vy - ay, vz - az, d1, d2, d3, near)
    return found, ax + x, ay + y, az + z


@bare_kernel
def _across(lengths, wall, r):  # type: ignore[no-untyped-def]
    """Return the axis of a flat wall, and the coordinate along it of a sphere that touches the wall."""
    axis = (-1 - wall) // 2
    if wall == PLANE:
        return 2, 0.0
    return axis, (r if (-1 - wall) % 2 == 0 else lengths[axis] - r)


@bare_kernel
def _at_wall(lengths, a, u, d1, d2, wall, r):  # type: ignore[no-untyped-def]
    """Return whether a sphere can touch two spheres, at a and a + u, and a flat wall, and its center."""
    (axis, at), (ax, ay, az), (ux, uy, uz) = _across(lengths, wall, r), a, u
    if axis == 0:
        w, along, s, t = at - ax, ux, uy, uz
    elif axis == 1:
        w, along, s, t = at - ay, uy, uz, ux
    else:
        w, along, s, t = at - az, uz, ux, uy
    one, two = (d1 - w) * (d1 + w), (d2 - w + along) * (d2 + w - along)
    if one < 0.0 or two < 0.0:
        return False, 0.0, 0.0, 0.0
    near = NEAR * r + ROUNDING * max(d1, d2)
    found, p, q = touch_disks(s, t, math.sqrt(one), math.sqrt(two), near)
    if axis == 0:
        return found, at, ay + p, az + q
    if axis == 1:
        return found, ax + q, at, az + p
    return found, ax + p, ay + q, at


@bare_kernel
def _at_two_walls(lengths, ax, ay, az, d, first, second, r):  # type: ignore[no-untyped-def]
    """Return whether a sphere can touch a sphere and two flat walls, and its center; their order decides the side."""
    one, at = _across(lengths, first, r)
    two, where = _across(lengths, second, r)
    x = at if one == 0 else (where if two == 0 else ax)
    y = at if one == 1 else (where if two == 1 else ay)
    z = at if one == 2 else (where if two == 2 else az)
    height = d * d - (x - ax) ** 2 - (y - ay) ** 2 - (z - az) ** 2
    if height < 0.0 or one == two:
        return False, 0.0, 0.0, 0.0
    up = math.sqrt(height) if one < two else -math.sqrt(height)
    free = 3 - one - two
    return True, x + (up if free == 0 else 0.0), y + (up if free == 1 else 0.0), z + (up if free == 2 else 0.0)


@bare_kernel
def _across_from(lengths, ax, ay, az, d, r, up):  # type: ignore[no-untyped-def]
    """Return whether a sphere in a tube can touch a sphere and the opposite side, and its center."""
    off, out = math.hypot(ax - 0.5 * lengths[0], ay - 0.5 * lengths[0]), 0.5 * lengths[0] - r
    height = (d - off - out) * (d + off + out)
    if height < 0.0 or out < -ROUNDING * lengths[0]:
        return False, 0.0, 0.0, 0.0
    part = out / off if off > 0.0 else 0.0
    x, y = 0.5 * lengths[0] - part * (ax - 0.5 * lengths[0]), 0.5 * lengths[0] - part * (ay - 0.5 * lengths[0])
    return True, x if off > 0.0 else x + out, y, az + up * math.sqrt(height)


@bare_kernel
def _at_side_and_flat(lengths, ax, ay, az, d, wall, r, side):  # type: ignore[no-untyped-def]
    """Return whether a sphere can touch a sphere and the side and an end of an upright cylinder, and its center."""
    _, at = _across(lengths, wall, r)
    level, out = (d - at + az) * (d + at - az), 0.5 * lengths[0] - r
    if level < 0.0 or out < 0.0:
        return False, 0.0, 0.0, 0.0
    ux, uy = 0.5 * lengths[0] - ax, 0.5 * lengths[0] - ay
    near = NEAR * r + ROUNDING * max(d, lengths[0])
    found, x, y = touch_disks(ux, uy, math.sqrt(level), side * out, near)
    return found, ax + x, ay + y, at


@bare_kernel
def _at_side(lengths, a, u, d1, d2, r):  # type: ignore[no-untyped-def]
    """Return whether a sphere can touch two spheres and the side of an upright cylinder, and its center.

    The centers that touch both spheres are a circle; it is searched to the left from its outermost point.
    """
    nothing, (ax, ay, az), (ux, uy, uz) = (False, 0.0, 0.0, 0.0), a, u
    radius, uu = 0.5 * lengths[0], ux * ux + uy * uy + uz * uz
    along = 0.5 * ((d1 - d2) * (d1 + d2) + uu) / uu
    height = d1 * d1 - along * along * uu
    mx, my = ax - radius + along * ux, ay - radius + along * uy
    share = (mx * ux + my * uy) / uu
    ex, ey, ez = mx - share * ux, my - share * uy, -share * uz
    length = math.sqrt(ex * ex + ey * ey + ez * ez)
    if height < 0.0 or length <= ON_A_LINE * radius:
        return nothing
    wide, long = math.sqrt(height), math.sqrt(uu)
    ex, ey, ez = ex / length, ey / length, ez / length
    fx, fy, fz = (uy * ez - uz * ey) / long, (uz * ex - ux * ez) / long, (ux * ey - uy * ex) / long
    near, low, high = NEAR * r + ROUNDING * lengths[0], 0.0, math.pi
    below = math.hypot(mx + wide * ex, my + wide * ey) - radius + r
    above = math.hypot(mx - wide * ex, my - wide * ey) - radius + r
    if below < 0.0 or above > 0.0:
        return nothing
    for _ in range(HALVINGS):
        turn = 0.5 * (low + high)
        c, s = wide * math.cos(turn), wide * math.sin(turn)
        beyond = math.hypot(mx + c * ex + s * fx, my + c * ey + s * fy) - radius + r
        if abs(beyond) <= near:
            return (
                True,
                ax + along * ux + c * ex + s * fx,
                ay + along * uy + c * ey + s * fy,
                az + along * uz + c * ez + s * fz,
            )
        if beyond > 0.0:
            low = turn
        else:
            high = turn
    return nothing
