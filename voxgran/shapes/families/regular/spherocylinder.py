"""Spherocylinders: cylinders with hemispherical ends, the capsules of pharmacy and of models of rods."""

import numpy as np

from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive


@parameter_class
class Spherocylinder:
    """Parameters of a spherocylinder.

    Parameters
    ----------
    aspect
        ratio of the height, ends included, to the diameter of the cylinder; default: 2.
    diameter
        equivalent diameter; default: 1.
    radius
        radius of cylinder and ends; with height, replaces aspect and diameter.
    height
        height, ends included: at least twice the radius, which it requires.

    Raises
    ------
    InputError
        If a number is out of range, the size is given twice or in part, or the height is below twice the radius.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.spherocylinder(radius=1.0, height=2.0).volume, 2)
    4.19
    """

    aspect: float | None = parameter(None, at_least=1.0)
    diameter: float | None = parameter(None, unit="length", above=0.0)
    radius: float | None = parameter(None, unit="length", above=0.0)
    height: float | None = parameter(None, unit="length", above=0.0)

    def __post_init__(self) -> None:
        """Check the values."""
        check_bounds(self)
        refuse_both(self.diameter, (("radius", self.radius), ("height", self.height)), aspect=self.aspect)
        if self.radius is not None and self.height is not None and self.height < 2 * self.radius:
            raise InputError(
                f"height is {self.height:g}: the two ends alone have {2 * self.radius:g}; give at least that, or a "
                "smaller radius"
            )


def make(parameters: Spherocylinder, generator: np.random.Generator) -> Shape:
    """Return the spherocylinder, its axis along z; nothing is random."""
    radius, height = parameters.radius, parameters.height
    if radius is not None and height is not None:
        return Shape.of(_solid(radius, height), name="spherocylinder")
    return sized(_solid(0.5, parameters.aspect or 2.0), parameters.diameter, name="spherocylinder")


def _solid(radius: float, height: float) -> Primitive:
    """Return a spherocylinder of the given total height; it is a sphere if the height is its diameter."""
    length = height - 2 * radius
    return Primitive("spherocylinder", (radius, length)) if length > 0 else Primitive("sphere", (radius,))


registration = ShapeFamily(summary="cylinder with hemispherical ends", parameters=Spherocylinder, make=make)
