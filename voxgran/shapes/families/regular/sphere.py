"""Spheres: grains without orientation, supported by every packing method."""

import numpy as np

from voxgran._base.config import parameter, parameter_class
from voxgran.shapes.family import ShapeFamily, Sized, round_radius
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive


@parameter_class
class Sphere(Sized):
    """Parameters of a sphere.

    Parameters
    ----------
    diameter
        diameter; default: 1.
    radius
        radius, in place of the diameter.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.sphere(radius=1.0).volume, 4)
    4.1888
    """

    radius: float | None = parameter(None, unit="length")


def make(parameters: Sphere, generator: np.random.Generator) -> Shape:
    """Return the sphere; nothing is random."""
    radius = round_radius(parameters.diameter, parameters.radius)
    return Shape.of(Primitive("sphere", (radius,)), name="sphere")


registration = ShapeFamily(summary="sphere", parameters=Sphere, make=make)
