"""Convex polyhedra: convex hulls of random points on a sphere, the simplest model of crushed rock.

Few points give angular grains, many points give nearly round ones. Stretching along the axes gives plates and needles.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, as_count, as_positive
from voxgran._base.config import parameter
from voxgran.shapes.family import ShapeFamily, sized
from voxgran.shapes.mesh import hull_of
from voxgran.shapes.model import Shape

#: largest number of points of a hull
MOST_POINTS = 100_000


@dataclass(frozen=True, kw_only=True, slots=True)
class ConvexPolyhedron:
    """Parameters of a convex polyhedron."""

    points: int = parameter(20, doc="number of random points, which become the vertices; from 4 to 100 000")
    aspect: tuple[float, float, float] = parameter(
        (1.0, 1.0, 1.0), doc="factors by which the hull is stretched along x, y and z"
    )
    diameter: float | None = parameter(None, doc="equivalent diameter; default: 1", unit="length")


def make(parameters: ConvexPolyhedron, generator: np.random.Generator) -> Shape:
    """Return a random polyhedron."""
    count = as_count(parameters.points, "points", at_least=4, at_most=MOST_POINTS)
    factors = np.array([as_positive(value, "aspect") for value in parameters.aspect])
    return sized(hull_of(_on_sphere(count, generator) * factors), parameters.diameter, name="convex_polyhedron")


def _on_sphere(count: int, generator: np.random.Generator) -> Floats:
    """Return random points on the unit sphere, uniformly distributed over its area."""
    z = 2.0 * generator.random(count) - 1.0
    turn = 2.0 * np.pi * generator.random(count)
    flat = np.sqrt(1.0 - z * z)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])


registration = ShapeFamily(
    name="convex_polyhedron",
    summary="convex hull of random points on a sphere",
    parameters=ConvexPolyhedron,
    make=make,
    random=True,
)
