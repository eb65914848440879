"""Winding numbers of closed triangles about points: inside or outside, in double precision."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel


def winding_numbers(triangles: Floats, points: Floats) -> Floats:
    """Return the generalized winding numbers (n,) of closed triangles (m, 3, 3) about points: 1 inside, 0 outside.

    References
    ----------
    Van Oosterom & Strackee 1983, The solid angle of a plane triangle, doi:10.1109/TBME.1983.325207
    """
    numbers = np.zeros(len(points))
    _sum_angles(np.ascontiguousarray(triangles), np.ascontiguousarray(points), numbers)
    return numbers


@kernel
def _sum_angles(triangles, points, numbers):  # type: ignore[no-untyped-def]
    """Sum the solid angles of all triangles about each point."""
    for k in range(len(points)):
        total = 0.0
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        for f in range(len(triangles)):
            ax, ay, az = triangles[f, 0, 0] - px, triangles[f, 0, 1] - py, triangles[f, 0, 2] - pz
            bx, by, bz = triangles[f, 1, 0] - px, triangles[f, 1, 1] - py, triangles[f, 1, 2] - pz
            cx, cy, cz = triangles[f, 2, 0] - px, triangles[f, 2, 1] - py, triangles[f, 2, 2] - pz
            la = np.sqrt(ax * ax + ay * ay + az * az)
            lb = np.sqrt(bx * bx + by * by + bz * bz)
            lc = np.sqrt(cx * cx + cy * cy + cz * cz)
            over = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            under = la * lb * lc + (ax * bx + ay * by + az * bz) * lc
            under += (bx * cx + by * cy + bz * cz) * la + (cx * ax + cy * ay + cz * az) * lb
            total += np.arctan2(over, under)
        numbers[k] = total / (2.0 * np.pi)
