"""Contacts of spheres (disks in 2D), one per grain: closed forms.

Two spheres with centers at the distance `d` have the gap ``d - r1 - r2``. If they overlap, the deepest point of one in
the other is ``r1 + r2 - d`` below its surface, but no deeper than the center of the larger sphere.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran.contacts.broad import Pairs


def sphere_contacts(pairs: Pairs, radii: Floats) -> tuple[Floats, Floats, Floats]:
    """Return gap, normal and point, from centroid i, of m pairs of spheres with (n,) radii about the centroids.

    A negative gap is a depth; the normals (m, 3) point from grain i to its partner, along x where the centers coincide.
    """
    gap = np.zeros(pairs.count)
    normal, point = np.zeros((pairs.count, 3)), np.zeros((pairs.count, 3))
    _touch_spheres(pairs.offset, radii[pairs.i], radii[pairs.j], gap, normal, point)
    return gap, normal, point


@kernel
def sphere_gap(distance: float, one: float, other: float) -> float:
    """Return the gap of two spheres from the distance of their centers; a negative gap is a depth."""
    return max(distance - one - other, -max(one, other))


@kernel
def _touch_spheres(offset, one, other, gap, normal, point):  # type: ignore[no-untyped-def]
    """Write gap, normal and point of each pair."""
    for k in range(len(offset)):
        x, y, z = offset[k, 0], offset[k, 1], offset[k, 2]
        distance = math.sqrt(x * x + y * y + z * z)
        gap[k] = sphere_gap(distance, one[k], other[k])
        if distance > 0.0:
            normal[k, 0], normal[k, 1], normal[k, 2] = x / distance, y / distance, z / distance
        else:
            normal[k, 0] = 1.0
        middle = 0.5 * (one[k] + distance - other[k])
        for i in range(3):
            point[k, i] = middle * normal[k, i]
