"""Polyhedra, sharp or rounded: hulls of random points on a sphere or ellipsoid, Platonic and Archimedean solids.

Rounded ones are Minkowski sums with a sphere: the sphere is swept over the polyhedron. They are meshes whose vertices
lie on the true surface, closed and convex.

References
----------
Schneider & Weil 2008, Stochastic and Integral Geometry, doi:10.1007/978-3-540-78859-1: hulls of random points on a
sphere, and the volume of Minkowski sums with spheres
"""

import math
from typing import Literal, TypeAlias

import numpy as np

from voxgran._base.arrays import Floats, as_count
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.scalars import cube_root
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.generating.hulls import MOST_POINTS, points_on_sphere
from voxgran.shapes.generating.regular_solids import ArchimedeanSolid, PlatonicSolid, corners_of
from voxgran.shapes.generating.sphere_swept import sphere_swept, steiner_volume
from voxgran.shapes.mesh import hull_of
from voxgran.shapes.model import Shape

Solid: TypeAlias = Literal["random", PlatonicSolid, ArchimedeanSolid]


@parameter_class
class Polyhedron(Sized):
    """Parameters of a polyhedron.

    Parameters
    ----------
    solid
        hull of random points, or the name of a Platonic or Archimedean solid.
    points
        number of random points, or a range to draw it from; from 4 to 100 000; default: (8, 20).
    aspect
        factors by which the corners are stretched along x, y and z.
    mirror
        whether to take the mirror image, such as the other form of a snub solid.
    rounding
        radius of the sphere that is swept over the polyhedron, as a fraction of the equivalent diameter of the sharp
        polyhedron; 0: sharp edges.
    tolerance
        largest distance of the mesh from the true rounded surface, in equivalent diameters.

    Raises
    ------
    InputError
        If a number is out of range, or points are given for a regular solid.

    Examples
    --------
    >>> import voxgran as vg
    >>> len(vg.shapes.polyhedron(solid="cube").vertices)
    8
    """

    solid: Solid = parameter("random")
    points: int | tuple[int, int] | None = parameter(None)
    aspect: tuple[float, float, float] = parameter((1.0, 1.0, 1.0), above=0.0)
    mirror: bool = parameter(False)
    rounding: float = parameter(0.0, at_least=0.0, at_most=10.0)
    tolerance: float = parameter(0.002, at_least=1e-4, at_most=0.1)

    def __post_init__(self) -> None:
        """Check the values."""
        check_bounds(self)
        if self.points is not None:
            if self.solid != "random":
                raise InputError(f"points is given for solid {self.solid!r}, which has its own corners; leave it out")
            low, high = self.points if isinstance(self.points, tuple) else (self.points, self.points)
            least = as_count(low, "points", at_least=4, at_most=MOST_POINTS)
            as_count(high, "points", at_least=least, at_most=MOST_POINTS)


def make(parameters: Polyhedron, generator: np.random.Generator) -> Shape:
    """Return a polyhedron."""
    corners = _corners(parameters, generator) * np.array(parameters.aspect)
    if parameters.mirror:
        corners = -corners
    solid = hull_of(corners)
    if parameters.rounding:
        corners = corners / Shape.of(solid, name="polyhedron").diameter
        size = cube_root(6 / math.pi * steiner_volume(corners, parameters.rounding))
        solid = sphere_swept(corners, parameters.rounding, parameters.tolerance * size)
    return sized(solid, parameters.diameter, name="polyhedron")


def _corners(parameters: Polyhedron, generator: np.random.Generator) -> Floats:
    """Return the corners before they are stretched."""
    if parameters.solid != "random":
        return corners_of(parameters.solid)
    points = parameters.points or (8, 20)
    low, high = points if isinstance(points, tuple) else (points, points)
    return points_on_sphere(int(generator.integers(low, high, endpoint=True)), generator)


registration = ShapeFamily(
    summary="hull of random points, Platonic or Archimedean solid; sharp or rounded by a sphere",
    parameters=Polyhedron,
    make=make,
    source="Schneider & Weil 2008, Stochastic and Integral Geometry, doi:10.1007/978-3-540-78859-1",
    random=True,
)
