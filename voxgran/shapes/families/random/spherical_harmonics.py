"""Star-shaped grains from spherical harmonics: of a power law, or siblings of a scanned grain.

The logarithm of the radius is a random field on the sphere, so that the radius is positive whatever is drawn. The
power of the field in each degree, that is, on each length scale, follows a power law of the degree, or is that of a
given shape (`like`). Each degree keeps its power exactly; how it is distributed among its harmonics is random, with
equal probability for all directions. One scan so makes any number of siblings.

The record of a shape has its `powers`, one for each degree from 0 (which is the size, and 0 here), and for a sibling
the `share_hidden`: the part of the directions in which a ray from the centroid leaves the given shape more than once.
There the outermost place is taken.

References
----------
Garboczi 2002, doi:10.1016/S0008-8846(02)00836-0: radii of aggregates as sums of spherical harmonics
"""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, as_positive
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.files import load_shape
from voxgran.shapes.formats.mesh_files import WRITERS
from voxgran.shapes.generating.base import check_base, made_base
from voxgran.shapes.generating.radii import radii_of
from voxgran.shapes.generating.spherical_fields import (
    coefficients_of,
    coefficients_of_powers,
    field_values,
    powers_of,
    sphere_quadrature,
)
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import sphere

#: degrees of the quadrature above those of the spectrum, since the radii of a scan have sharp edges
MORE = 24
#: largest degree
HIGHEST = 64


@parameter_class
class SphericalHarmonics(Sized):
    """Parameters of a grain from spherical harmonics.

    Parameters
    ----------
    like
        solid whose spectrum the grain has: a mesh file, a family, a table of family, seed and parameters, or a Shape.
    degree
        largest degree of the harmonics.
    roughness
        standard deviation of the logarithm of the radius over the sphere; default: 0.15.
    exponent
        exponent of the power law by which the power falls with the degree, from degree 2 on; default: 3.
    aspect
        factors by which the grain is stretched along x, y and z.
    subdivisions
        number of subdivisions of the icosahedron.

    Raises
    ------
    UnknownNameError
        If `like` is the name of no family.
    InputError
        If a number is out of range, or `like` is no solid, or is given together with `roughness` or `exponent`.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.spherical_harmonics(degree=4, subdivisions=2, roughness=0.1, seed=1)
    Shape('spherical_harmonics', mesh, diameter=1)
    """

    like: str | Shape | Mapping[str, Any] | None = parameter(None)
    degree: int = parameter(16, at_least=2, at_most=HIGHEST)
    roughness: float | None = parameter(None, at_least=0.0, at_most=1.0)
    exponent: float | None = parameter(None, at_least=0.0, at_most=20.0)
    aspect: tuple[float, float, float] = parameter((1.0, 1.0, 1.0))
    subdivisions: int = parameter(4, at_least=2, at_most=6)

    def __post_init__(self) -> None:
        """Check the numbers and what the grain is like."""
        check_bounds(self)
        if self.like is None:
            return
        for name in ("roughness", "exponent"):
            if getattr(self, name) is not None:
                raise InputError(f"like and {name} are both given: each makes the spectrum; leave one out")
        if not _is_file(self.like):
            check_base(self.like, called="like")


def make(parameters: SphericalHarmonics, generator: np.random.Generator) -> Shape:
    """Return a random grain."""
    record: dict[str, Any] = {}
    if parameters.like is None:
        powers = power_law(parameters)
    else:
        powers, record["share_hidden"] = spectrum_of(_given(parameters.like), parameters.degree)
    directions, faces, _ = sphere(parameters.subdivisions)
    stretch = np.array([as_positive(value, "aspect") for value in parameters.aspect])
    radius = libm.exp(field_values(*coefficients_of_powers(powers, generator), directions))
    mesh = Mesh(radius[:, None] * directions * stretch, faces)
    return sized(mesh, parameters.diameter, name="spherical_harmonics", record={"powers": powers, **record})


def power_law(parameters: SphericalHarmonics) -> Floats:
    """Return the power (degree + 1,) of each degree."""
    roughness = 0.15 if parameters.roughness is None else parameters.roughness
    exponent = 3.0 if parameters.exponent is None else parameters.exponent
    degrees = np.arange(2, parameters.degree + 1, dtype=np.float64)
    law = libm.power(degrees, -exponent)
    return np.array([0.0, 0.0, *(roughness**2 * law / law.sum())])


# a scan that makes a thousand siblings is expanded once; the last few are kept
@lru_cache(maxsize=8)
def spectrum_of(shape: Shape, degree: int) -> tuple[Floats, float]:
    """Return the power (degree + 1,) of each degree of the logarithm of the radius of a shape, 0 for degree 0, and the
    share of directions in which a ray leaves it more than once.

    Raises
    ------
    InputError
        If the centroid of the shape lies outside of it.
    """
    directions, weights = sphere_quadrature(degree + 1 + MORE)
    radii, hidden = radii_of(shape, directions)
    powers = powers_of(*coefficients_of(degree + 1, directions, weights, libm.log(radii)))
    powers[0] = 0.0
    return powers, hidden


def _is_file(like: str | Shape | Mapping[str, Any]) -> bool:
    """Return whether a shape is named by its file."""
    return isinstance(like, str) and Path(like).suffix.lower() in WRITERS


def _given(like: str | Shape | Mapping[str, Any]) -> Shape:
    """Return the shape that the grain is like; a random family without a seed is made with the seed 0."""
    if isinstance(like, str) and _is_file(like):
        return load_shape(like)
    return made_base(like if not isinstance(like, str) else {"family": like, "seed": 0}, stream(0, "like"))


registration = ShapeFamily(
    summary="star-shaped grain of a given spectrum, of a power law or that of a scan",
    parameters=SphericalHarmonics,
    make=make,
    source="Garboczi 2002, doi:10.1016/S0008-8846(02)00836-0",
    random=True,
)
