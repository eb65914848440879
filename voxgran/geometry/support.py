"""Support functions of convex solids: the point of a solid that is farthest along a direction.

A solid is a row of numbers: its kind, three dimensions and a rotation matrix; a triangle is its nine coordinates. A
support function is also available for a solid *eroded* by a length r: the set of its points at a depth of at least r.
The erosion of a box, cylinder, cone or spherocylinder is a smaller one; that of an ellipsoid has the support points
s(n) - r n for r up to its smallest radius of curvature.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran.geometry.vectors import Vector

#: kinds of rows; a sphere is a point with a margin, and a segment a spherocylinder of radius 0
POINT, ELLIPSOID, BOX, CYLINDER, CONE, TRIANGLE, SPHEROCYLINDER = 0, 1, 2, 3, 4, 5, 6
#: numbers in a row
ROW = 13


@kernel
def support(row: Floats, erosion: float, x: float, y: float, z: float) -> Vector:
    """Return the support point, along (x, y, z), of an eroded solid centered at the origin."""
    kind = int(row[0])
    if kind == 0:
        return 0.0, 0.0, 0.0
    if kind == 5:
        best, most = 0, -np.inf
        for c in range(3):
            reach = row[4 + 3 * c] * x + row[5 + 3 * c] * y + row[6 + 3 * c] * z
            if reach > most:
                best, most = c, reach
        return row[4 + 3 * best], row[5 + 3 * best], row[6 + 3 * best]
    u = row[4] * x + row[7] * y + row[10] * z
    v = row[5] * x + row[8] * y + row[11] * z
    w = row[6] * x + row[9] * y + row[12] * z
    p, q, r = _support_upright(kind, row, erosion, u, v, w)
    return (
        row[4] * p + row[5] * q + row[6] * r,
        row[7] * p + row[8] * q + row[9] * r,
        row[10] * p + row[11] * q + row[12] * r,
    )


@kernel
def _support_upright(kind, row, erosion, u, v, w):  # type: ignore[no-untyped-def]
    """Return the support point of a solid in its body frame."""
    a, b, c = row[1], row[2], row[3]
    if kind == 1:
        length = math.sqrt((a * u) ** 2 + (b * v) ** 2 + (c * w) ** 2)
        size = math.sqrt(u * u + v * v + w * w)
        if length == 0.0:
            return 0.0, 0.0, 0.0
        inward = erosion / size
        return u * (a * a / length - inward), v * (b * b / length - inward), w * (c * c / length - inward)
    if kind == 2:
        a, b, c = 0.5 * a - erosion, 0.5 * b - erosion, 0.5 * c - erosion
        return a if u >= 0.0 else -a, b if v >= 0.0 else -b, c if w >= 0.0 else -c
    if kind == 6:
        share = (a - erosion) / max(math.sqrt(u * u + v * v + w * w), 1e-300)
        return share * u, share * v, share * w + (0.5 * b if w >= 0.0 else -0.5 * b)
    flat = math.sqrt(u * u + v * v)
    if kind == 3:
        ring = (a - erosion) / flat if flat > 0.0 else 0.0
        tall = 0.5 * b - erosion
        return u * ring, v * ring, tall if w >= 0.0 else -tall
    # the cone keeps its angle: its base rises by the erosion and its apex sinks by more
    apex = 0.75 * b - erosion * math.sqrt(a * a + b * b) / a
    base = erosion - 0.25 * b
    radius = a * (apex - base) / b
    if w * b >= flat * a:
        return 0.0, 0.0, apex
    ring = radius / flat if flat > 0.0 else 0.0
    return u * ring, v * ring, base


@kernel
def erosion_limit(row: Floats) -> float:
    """Return the largest exact erosion of a solid: its inner radius, or its smallest radius of curvature."""
    a, b, c = row[1], row[2], row[3]
    if row[0] == 1.0:
        return min(a, b, c) ** 2 / max(a, b, c)
    if row[0] == 2.0:
        return 0.5 * min(a, b, c)
    if row[0] == 3.0:
        return min(a, 0.5 * b)
    if row[0] == 4.0:
        return a * b / (a + math.sqrt(a * a + b * b))
    return a if row[0] == 6.0 else 0.0
