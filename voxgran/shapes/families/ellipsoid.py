"""Ellipsoids: from needles to disks, smooth and convex."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import as_positive
from voxgran._base.config import parameter
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive


@dataclass(frozen=True, kw_only=True, slots=True)
class Ellipsoid:
    """Parameters of an ellipsoid."""

    aspect: tuple[float, float, float] | None = parameter(None, doc="ratios of the axes; default: (1, 0.8, 0.6)")
    diameter: float | None = parameter(None, doc="equivalent diameter; default: 1", unit="length")
    semi_axes: tuple[float, float, float] | None = parameter(
        None, doc="lengths of the semi-axes; replace aspect and diameter", unit="length"
    )


def make(parameters: Ellipsoid, generator: np.random.Generator) -> Shape:
    """Return the ellipsoid; nothing is random.

    Raises
    ------
    InputError
        If a number is not above 0, or the size or the ratio is given twice.
    """
    refuse_both(parameters.diameter, (("semi_axes", parameters.semi_axes),), aspect=parameters.aspect)
    if parameters.semi_axes is not None:
        return Shape.of(Primitive("ellipsoid", parameters.semi_axes), name="ellipsoid")
    if parameters.diameter is not None:
        as_positive(parameters.diameter, "diameter")
    ratios = parameters.aspect or (1.0, 0.8, 0.6)
    return sized(Primitive("ellipsoid", ratios), parameters.diameter, name="ellipsoid")


registration = ShapeFamily(name="ellipsoid", summary="ellipsoid with three axes", parameters=Ellipsoid, make=make)
