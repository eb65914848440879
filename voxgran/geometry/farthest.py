"""Largest distance of the points of a convex solid from a given point, in closed form for all solids but ellipsoids."""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel

#: number of bisections after which the bracket of a root has the width of one bit
HALVINGS = 200


@bare_kernel
def farthest_of_row(row: Floats, x: float, y: float, z: float) -> float:
    """Return the largest distance from the origin of a solid, which is no point, centered at (x, y, z).

    row: of :mod:`voxgran.geometry.support`. The farthest point of a ring lies on the side away from the origin. On an
    ellipsoid with the semi-axes a it is p + a u with u = a p / (m - a ** 2), where the multiplier m is the root above
    the largest a ** 2 at which u has length 1; if there is none, the remainder of u points along the longest axis.
    """
    a, b, c = row[1], row[2], row[3]
    u = row[4] * x + row[7] * y + row[10] * z
    v = row[5] * x + row[8] * y + row[11] * z
    w = row[6] * x + row[9] * y + row[12] * z
    if row[0] == 2.0:
        p, q, r = abs(u) + 0.5 * a, abs(v) + 0.5 * b, abs(w) + 0.5 * c
        return math.sqrt(p * p + q * q + r * r)
    if row[0] == 6.0:
        return math.sqrt(u * u + v * v + (abs(w) + 0.5 * b) ** 2) + a
    flat = math.sqrt(u * u + v * v) + a
    if row[0] == 3.0:
        tall = abs(w) + 0.5 * b
        return math.sqrt(flat * flat + tall * tall)
    if row[0] == 4.0:
        base, apex = w - 0.25 * b, w + 0.75 * b
        return math.sqrt(max(flat * flat + base * base, (flat - a) ** 2 + apex * apex))
    top = max(a, b, c) ** 2
    p, q, r = a * abs(u), b * abs(v), c * abs(w)
    low, high = top, top + math.sqrt(p * p + q * q + r * r) + 1e-300
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if _square_for(p, middle - a * a) + _square_for(q, middle - b * b) + _square_for(r, middle - c * c) <= 1.0:
            high = middle
        else:
            low = middle
    p, q, r = math.sqrt(_square_for(p, high - a * a)), math.sqrt(_square_for(q, high - b * b)), 0.0
    r = math.sqrt(_square_for(c * abs(w), high - c * c))
    # what is left of the unit vector points along the longest axis
    rest = max(1.0 - p * p - q * q - r * r, 0.0)
    if a * a == top:
        p = math.sqrt(p * p + rest)
    elif b * b == top:
        q = math.sqrt(q * q + rest)
    else:
        r = math.sqrt(r * r + rest)
    return math.sqrt((abs(u) + a * p) ** 2 + (abs(v) + b * q) ** 2 + (abs(w) + c * r) ** 2)


@bare_kernel
def _square_for(lever, distance):  # type: ignore[no-untyped-def]
    """Return the square of a component of the vector for a multiplier; infinite at a pole."""
    return (lever / distance) ** 2 if lever > 0.0 else 0.0
