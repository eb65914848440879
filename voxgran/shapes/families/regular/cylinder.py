"""Cylinders: pellets, tablets and rods."""

from typing import Literal

import numpy as np

from voxgran._base.arrays import as_positive
from voxgran._base.config import parameter, parameter_class
from voxgran.shapes.family import ShapeFamily, Sized, regular_solid
from voxgran.shapes.model import Shape


@parameter_class
class Cylinder(Sized):
    """Parameters of a cylinder.

    Parameters
    ----------
    aspect
        ratio of the height to the diameter of the base; default: 1.
    radius
        radius of the base; with height, replaces aspect and diameter.
    height
        height; requires radius.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.cylinder(radius=1.0, height=2.0).volume, 4)
    6.2832
    """

    aspect: float | None = parameter(None)
    radius: float | None = parameter(None, unit="length")
    height: float | None = parameter(None, unit="length")


def make(parameters: Cylinder, generator: np.random.Generator) -> Shape:
    """Return the cylinder, its axis along z; nothing is random."""
    return round_solid("cylinder", parameters)


def round_solid(kind: Literal["cylinder", "cone"], parameters: Cylinder) -> Shape:
    """Return a cylinder or cone, its axis along z."""
    radius, height = parameters.radius, parameters.height
    lengths = None if radius is None or height is None else (radius, height)
    ratio = 1.0 if parameters.aspect is None else as_positive(parameters.aspect, "aspect")
    given = (("radius", radius), ("height", height))
    return regular_solid(kind, parameters, given=given, lengths=lengths, ratios=(0.5, ratio))


registration = ShapeFamily(summary="circular cylinder", parameters=Cylinder, make=make)
