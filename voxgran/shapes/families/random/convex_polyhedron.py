"""Convex polyhedra: convex hulls of random points on a sphere, the simplest model of crushed rock.

Few points give angular grains, many points give nearly round ones. Stretching along the axes gives plates and needles.
The family `polyhedron` has rounded ones, and regular polyhedra, beside them.
"""

import numpy as np

from voxgran._base.arrays import as_count, as_positive
from voxgran._base.config import parameter, parameter_class
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.generating.hulls import MOST_POINTS, points_on_sphere
from voxgran.shapes.mesh import hull_of
from voxgran.shapes.model import Shape


@parameter_class
class ConvexPolyhedron(Sized):
    """Parameters of a convex polyhedron.

    Parameters
    ----------
    points
        number of random points, which become the vertices; from 4 to 100 000.
    aspect
        factors by which the hull is stretched along x, y and z.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.convex_polyhedron(points=12, seed=1)
    Shape('convex_polyhedron', mesh, diameter=1)
    """

    points: int = parameter(20)
    aspect: tuple[float, float, float] = parameter((1.0, 1.0, 1.0))


def make(parameters: ConvexPolyhedron, generator: np.random.Generator) -> Shape:
    """Return a random polyhedron."""
    count = as_count(parameters.points, "points", at_least=4, at_most=MOST_POINTS)
    factors = np.array([as_positive(value, "aspect") for value in parameters.aspect])
    return sized(hull_of(points_on_sphere(count, generator) * factors), parameters.diameter, name="convex_polyhedron")


registration = ShapeFamily(
    summary="convex hull of random points on a sphere", parameters=ConvexPolyhedron, make=make, random=True
)
