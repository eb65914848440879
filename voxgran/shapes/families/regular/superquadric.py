"""Superquadrics: one formula from boxes over cylinders and ellipsoids to octahedra and pinched stars.

The solid is ``(|x/a|^(2/e2) + |y/b|^(2/e2))^(e2/e1) + |z/c|^(2/e1) <= 1``. With both exponents 1 it is an ellipsoid.
An exponent e1 near 0 makes flat ends with sharp rims, and e2 near 0 a rectangular section; 2 makes straight edges, and
above 2 the solid is pinched and no longer convex.

The mesh is a spherical product of two polygons with corners on the two curves. It is convex where the solid is, and its
vertices lie on the true surface.

References
----------
Barr 1981, Superquadrics and angle-preserving transformations, doi:10.1109/MCG.1981.1673799
"""

import math

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.lazy import load
from voxgran._base.scalars import cube_root
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import spherical_product

#: places on a chord at which its distance from the curve is taken
PLACES = (0.25, 0.5, 0.75)


@parameter_class
class Superquadric:
    """Parameters of a superquadric.

    Parameters
    ----------
    e1
        exponent along z: near 0 flat ends, 1 round, 2 straight cones, above 2 pinched.
    e2
        exponent in the xy-plane: near 0 a rectangle, 1 round, 2 a rhombus, above 2 a star.
    aspect
        ratios of the axes; default: (1, 1, 1).
    diameter
        equivalent diameter; default: 1.
    semi_axes
        lengths of the semi-axes; replace aspect and diameter.
    tolerance
        largest distance of the mesh from the true surface, in equivalent diameters.

    Raises
    ------
    InputError
        If a number is out of range, or the size is given twice.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.superquadric(e1=0.5, e2=0.5, aspect=(1, 1, 2), tolerance=0.05)
    Shape('superquadric', mesh, diameter=1)
    """

    e1: float = parameter(0.5, at_least=0.02, at_most=4.0)
    e2: float = parameter(0.5, at_least=0.02, at_most=4.0)
    aspect: tuple[float, float, float] | None = parameter(None, above=0.0)
    diameter: float | None = parameter(None, unit="length", above=0.0)
    semi_axes: tuple[float, float, float] | None = parameter(None, unit="length", above=0.0)
    tolerance: float = parameter(0.002, at_least=1e-4, at_most=0.1)

    def __post_init__(self) -> None:
        """Check the values."""
        check_bounds(self)
        refuse_both(self.diameter, (("semi_axes", self.semi_axes),), aspect=self.aspect)


def make(parameters: Superquadric, generator: np.random.Generator) -> Shape:
    """Return the superquadric, whose vertices lie on the true surface; nothing is random."""
    axes = np.array(parameters.semi_axes or parameters.aspect or (1.0, 1.0, 1.0))
    solid = _mesh(parameters.e1, parameters.e2, axes, parameters.tolerance)
    if parameters.semi_axes is not None:
        return Shape.of(solid, name="superquadric")
    return sized(solid, parameters.diameter, name="superquadric")


def volume_of(e1: float, e2: float, semi_axes: Floats) -> float:
    """Return the volume of a superquadric in closed form, by beta functions."""
    beta = load("scipy.special").beta
    return float(2 * np.prod(semi_axes) * e1 * e2 * beta(e1 / 2 + 1, e1) * beta(e2 / 2, e2 / 2))


def _mesh(e1: float, e2: float, axes: Floats, tolerance: float) -> Mesh:
    """Return the mesh of a superquadric: the spherical product of two polygons, each with half of the tolerance."""
    error = tolerance / 2 * cube_root(6 / math.pi * volume_of(e1, e2, axes))
    quarter = superellipse(e2, axes[:2], error)
    half = np.concatenate([quarter[:-1], quarter[:0:-1] * [-1, 1]])
    section = np.concatenate([half, -half])
    rise = superellipse(e1, np.array([axes[:2].max(), axes[2]]), error)[:, ::-1] / [1, axes[:2].max()]
    profile = np.concatenate([rise[:0:-1] * [-1, 1], rise])
    vertices, faces = spherical_product(profile.tolist(), section.tolist())
    return Mesh(vertices, faces)


def superellipse(exponent: float, axes: Floats, error: float) -> Floats:
    """Return points (n, 2) of the quarter of ``|x/a|^(2/e) + |y/b|^(2/e) = 1`` from (a, 0) to (0, b).

    Chords are bisected, the new point lying on the ray through the middle, until all are within an error of the curve.
    """
    # where both terms are equal, which is the corner of a rounded rectangle, a point must lie
    points = np.array([[1.0, 0.0], [0.5 ** (exponent / 2)] * 2, [0.0, 1.0]])
    while True:
        a, b = points[:-1], points[1:]
        far = np.max([_distance(a + place * (b - a), axes, exponent) for place in PLACES], axis=0) > error
        if not far.any():
            return points * axes
        middle = (a[far] + b[far]) / 2
        middle /= _norm(middle[:, 0], middle[:, 1], exponent)[:, None]
        points = np.insert(points, np.flatnonzero(far) + 1, middle, axis=0)


def _norm(one: Floats, two: Floats, exponent: float) -> Floats:
    """Return ``(one^p + two^p)^(1/p)`` with p = 2 / exponent, for numbers of at least 0, without overflow."""
    large, small = np.maximum(one, two), np.minimum(one, two)
    return np.asarray(large * libm.power(1 + libm.power(small / large, 2 / exponent), exponent / 2))


def _distance(points: Floats, axes: Floats, exponent: float) -> Floats:
    """Return a bound of the distance (n,) of points from the curve: the shortest way along the ray, x or y.

    The points (n, 2) are those of unit axes, the distances those of the true ones.
    """
    x, y = points.T
    radial = linear.norm(points * axes, axis=1) * np.abs(1 / _norm(x, y, exponent) - 1)
    power = 2 / exponent
    along_x = axes[0] * np.abs(libm.power(1 - libm.power(np.minimum(y, 1.0), power), 1 / power) - x)
    along_y = axes[1] * np.abs(libm.power(1 - libm.power(np.minimum(x, 1.0), power), 1 / power) - y)
    return np.asarray(np.min([radial, along_x, along_y], axis=0))


registration = ShapeFamily(
    summary="superquadric, from boxes and cylinders to ellipsoids, octahedra and stars",
    parameters=Superquadric,
    make=make,
    source="Barr 1981, doi:10.1109/MCG.1981.1673799",
)
