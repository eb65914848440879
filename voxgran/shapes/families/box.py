"""Boxes: cuboids from cubes to plates and rods."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import as_positive
from voxgran._base.config import parameter
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive


@dataclass(frozen=True, kw_only=True, slots=True)
class Box:
    """Parameters of a box."""

    aspect: tuple[float, float, float] | None = parameter(None, doc="ratios of the edge lengths; default: (1, 1, 1)")
    diameter: float | None = parameter(None, doc="equivalent diameter; default: 1", unit="length")
    lengths: tuple[float, float, float] | None = parameter(
        None, doc="edge lengths; replace aspect and diameter", unit="length"
    )


def make(parameters: Box, generator: np.random.Generator) -> Shape:
    """Return the box; nothing is random.

    Raises
    ------
    InputError
        If a number is not above 0, or the size or the ratio is given twice.
    """
    refuse_both(parameters.diameter, (("lengths", parameters.lengths),), aspect=parameters.aspect)
    if parameters.lengths is not None:
        return Shape.of(Primitive("box", parameters.lengths), name="box")
    if parameters.diameter is not None:
        as_positive(parameters.diameter, "diameter")
    return sized(Primitive("box", parameters.aspect or (1.0, 1.0, 1.0)), parameters.diameter, name="box")


registration = ShapeFamily(name="box", summary="cuboid with edges along x, y and z", parameters=Box, make=make)
