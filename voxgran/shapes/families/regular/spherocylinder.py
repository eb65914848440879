"""Spherocylinders: cylinders with hemispherical ends, the capsules of pharmacy and of models of rods.

The mesh is convex, and its vertices lie on the true surface.
"""

import math

import numpy as np

from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.scalars import cube_root
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import revolved


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
    tolerance
        largest distance of the mesh from the true surface, in equivalent diameters.

    Raises
    ------
    InputError
        If a number is out of range, the size is given twice or in part, or the height is below twice the radius.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.spherocylinder(radius=1.0, height=2.0).volume, 2)
    4.16
    """

    aspect: float | None = parameter(None, at_least=1.0)
    diameter: float | None = parameter(None, unit="length", above=0.0)
    radius: float | None = parameter(None, unit="length", above=0.0)
    height: float | None = parameter(None, unit="length", above=0.0)
    tolerance: float = parameter(0.002, at_least=1e-4, at_most=0.1)

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
    if radius is None or height is None:
        solid = _mesh(1.0, 2.0 * (parameters.aspect or 2.0), parameters.tolerance)
        return sized(solid, parameters.diameter, name="spherocylinder")
    return Shape.of(_mesh(radius, height, parameters.tolerance), name="spherocylinder")


def volume_of(radius: float, height: float) -> float:
    """Return the volume of a spherocylinder of a total height."""
    return math.pi * radius**2 * (height - 2 / 3 * radius)


def _mesh(radius: float, height: float, tolerance: float) -> Mesh:
    """Return the mesh of a spherocylinder; circle and meridian take half of the tolerance each."""
    error = tolerance / 2 * cube_root(6 / math.pi * volume_of(radius, height))
    # the chord of an angle t lies r (1 - cos(t / 2)) inside of the circle; the angles divide a quarter evenly
    steps = max(2, math.ceil(math.pi / 4 / math.acos(max(1 - error / radius, 0.5))))
    angles = np.pi / 2 * np.arange(1, steps + 1) / steps
    flat, rise = radius * np.sin(angles), height / 2 - radius * (1 - np.cos(angles))
    rise[-1] = height / 2 - radius
    top = np.column_stack([rise, flat])[::-1]
    bottom = top[::-1] * [-1, 1]
    middle = bottom if rise[-1] > 0 else bottom[:-1]
    profile = [(-height / 2, 0.0), *middle.tolist(), *top.tolist(), (height / 2, 0.0)]
    vertices, faces, _ = revolved(profile, sides=4 * steps)
    return Mesh(vertices, faces)


registration = ShapeFamily(summary="cylinder with hemispherical ends", parameters=Spherocylinder, make=make)
