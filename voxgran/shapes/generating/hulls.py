"""Convex hulls: of random points on a sphere, and of points of which some are equal up to rounding."""

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran.shapes.mesh import Mesh, hull_of
from voxgran.shapes.shells import without_unused

#: largest number of points of a hull
MOST_POINTS = 100_000


def points_on_sphere(count: int, generator: np.random.Generator) -> Floats:
    """Return random points (count, 3) on the unit sphere, uniformly distributed over its area."""
    z = 2.0 * generator.random(count) - 1.0
    turn = 2.0 * np.pi * generator.random(count)
    flat = np.sqrt(1.0 - z * z)
    return np.column_stack([flat * libm.cos(turn), flat * libm.sin(turn), z])


def hull_of_corners(points: Floats) -> Mesh:
    """Return the convex hull of (n, 3) points, of which some may be the same corner up to rounding."""
    solid = hull_of(points)
    return Mesh(*without_unused(points, solid.faces))
