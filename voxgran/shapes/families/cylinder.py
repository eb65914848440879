"""Cylinders: pellets, tablets and rods."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from voxgran._base.arrays import as_positive
from voxgran._base.config import parameter
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive


@dataclass(frozen=True, kw_only=True, slots=True)
class Cylinder:
    """Parameters of a cylinder."""

    aspect: float | None = parameter(None, doc="ratio of the height to the diameter of the base; default: 1")
    diameter: float | None = parameter(None, doc="equivalent diameter; default: 1", unit="length")
    radius: float | None = parameter(
        None, doc="radius of the base; with height, replaces aspect and diameter", unit="length"
    )
    height: float | None = parameter(None, doc="height; requires radius", unit="length")


def make(parameters: Cylinder, generator: np.random.Generator) -> Shape:
    """Return the cylinder, its axis along z; nothing is random.

    Raises
    ------
    InputError
        As :func:`round_solid`.
    """
    return round_solid("cylinder", parameters)


def round_solid(kind: Literal["cylinder", "cone"], parameters: Cylinder) -> Shape:
    """Return a cylinder or cone, its axis along z.

    Raises
    ------
    InputError
        If a number is not above 0, or the size is given twice or in part, or the ratio twice.
    """
    lengths = (("radius", parameters.radius), ("height", parameters.height))
    refuse_both(parameters.diameter, lengths, aspect=parameters.aspect)
    if parameters.radius is not None and parameters.height is not None:
        return Shape.of(Primitive(kind, (parameters.radius, parameters.height)), name=kind)
    if parameters.diameter is not None:
        as_positive(parameters.diameter, "diameter")
    ratio = 1.0 if parameters.aspect is None else as_positive(parameters.aspect, "aspect")
    return sized(Primitive(kind, (0.5, ratio)), parameters.diameter, name=kind)


registration = ShapeFamily(name="cylinder", summary="circular cylinder", parameters=Cylinder, make=make)
