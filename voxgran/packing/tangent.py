"""Where a ball of a given radius touches two or three balls, or balls and flat walls: kernels in closed form.

Everything is about the center of the first ball, so that far from the origin no digits are lost. The closed form is
followed by steps of Newton until the distances agree to the last digits; a position whose distances do not is no
position. Of the two solutions the one on the left of the given order is returned: exchange two for the other one.
"""

import math

from voxgran._base.kernels import bare_kernel

#: largest difference of a distance from the sum of the radii, in radii of the new ball and in distances
NEAR, ROUNDING = 1e-13, 1e-15
#: steps of Newton, at most
STEPS = 4
#: squared sine below which three centers lie on a line
ON_A_LINE = 1e-12


@bare_kernel
def foot_of_balls(
    ux: float, uy: float, uz: float, vx: float, vy: float, vz: float, d1: float, d2: float, d3: float
) -> tuple[bool, float, float, float, float, float, float]:
    """Return whether there are points at distances d1, d2, d3 from 0, u and v, their middle, and the way to the left.

    The points are the middle plus and minus the way, which has the direction of u x v.
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
def touch_balls(
    ux: float, uy: float, uz: float, vx: float, vy: float, vz: float, d1: float, d2: float, d3: float, near: float
) -> tuple[bool, float, float, float]:
    """Return whether there is a point at distances d1, d2, d3 from 0, u and v, and the one on the side of u x v.

    `near` is how far off the distances may be.
    """
    found, x, y, z, hx, hy, hz = foot_of_balls(ux, uy, uz, vx, vy, vz, d1, d2, d3)
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
def touch_disks(ux: float, uy: float, d1: float, d2: float, near: float, side: float) -> tuple[bool, float, float]:
    """Return whether a point in the plane is at distances d1 and d2 from 0 and u, and the one on the left of u.

    Where `side` is -1 it is the one on the right.
    """
    uu = ux * ux + uy * uy
    if uu <= 0.0:
        return False, 0.0, 0.0
    along = 0.5 * ((d1 - d2) * (d1 + d2) + uu) / uu
    height = d1 * d1 - along * along * uu
    if height < 0.0:
        return False, 0.0, 0.0
    up = side * math.sqrt(height / uu)
    x, y = along * ux - up * uy, along * uy + up * ux
    for step in range(STEPS):
        bx, by = x - ux, y - uy
        la, lb = math.sqrt(x * x + y * y), math.sqrt(bx * bx + by * by)
        fa, fb = la - d1, lb - d2
        if max(abs(fa), abs(fb)) <= near:
            return True, x, y
        area = x * by - y * bx
        if step == STEPS - 1 or area == 0.0:
            break
        fa, fb = fa * la / area, fb * lb / area
        x, y = x - (fa * by - fb * y), y - (fb * x - fa * bx)
    return False, 0.0, 0.0
