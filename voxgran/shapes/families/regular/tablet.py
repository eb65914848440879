"""Tablets: cylinders with spherical caps."""

import math

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.scalars import cube_root
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import revolved, sides_of


@parameter_class
class Tablet:
    """Parameters of a tablet.

    Parameters
    ----------
    aspect
        ratio of the height, caps included, to the diameter of the cylinder; default: 0.5.
    cap
        ratio of the height of a cap to the diameter of the cylinder, at most half of aspect, which is
        the default below 0.1.
    diameter
        equivalent diameter; default: 1.
    radius
        radius of the cylinder; with height and cap_height, replaces aspect, cap and diameter.
    height
        height, caps included; requires radius and cap_height.
    cap_height
        height of a cap, at most the radius and half of the height; requires radius and height.
    tolerance
        largest distance of the mesh from the true surface, in equivalent diameters.

    Raises
    ------
    InputError
        If a number is out of range, the size is given twice or in part, or the caps are higher than the tablet.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.tablet(radius=4.0, height=4.0, cap_height=1.0).bounds[1].round(1).tolist()
    [4.0, 4.0, 2.0]
    """

    aspect: float | None = parameter(None, at_least=0.002, at_most=1000.0)
    cap: float | None = parameter(None, at_least=0.001, at_most=0.5)
    diameter: float | None = parameter(None, unit="length", above=0.0)
    radius: float | None = parameter(None, unit="length", above=0.0)
    height: float | None = parameter(None, unit="length", above=0.0)
    cap_height: float | None = parameter(None, unit="length", above=0.0)
    tolerance: float = parameter(0.002, at_least=1e-4, at_most=0.1)

    def __post_init__(self) -> None:
        """Check the values."""
        check_bounds(self)
        lengths = (("radius", self.radius), ("height", self.height), ("cap_height", self.cap_height))
        refuse_both(self.diameter, lengths, aspect=self.aspect, cap=self.cap)
        radius, height, cap = _lengths_of(self)
        if not 0.001 * radius <= cap <= min(radius, 0.5 * height):
            name, value = ("cap", 0.5 * cap / radius) if self.radius is None else ("cap_height", cap)
            most = min(radius, 0.5 * height) * (1.0 if self.radius is not None else 0.5 / radius)
            raise InputError(
                f"{name} is {value:g}: it must be at least a thousandth of the radius and at most {most:g}, so that "
                "caps are no higher than half of the tablet and no deeper than half a sphere; change it"
            )


def make(parameters: Tablet, generator: np.random.Generator) -> Shape:
    """Return the tablet, its axis along z; nothing is random."""
    solid = _mesh(*_lengths_of(parameters), parameters.tolerance)
    if parameters.radius is not None:
        return Shape.of(solid, name="tablet")
    return sized(solid, parameters.diameter, name="tablet")


def _lengths_of(parameters: Tablet) -> tuple[float, float, float]:
    """Return the radius, height and height of a cap, those of a cylinder of unit diameter where ratios are given."""
    radius, height, cap = parameters.radius, parameters.height, parameters.cap_height
    if radius is None or height is None or cap is None:
        aspect = 0.5 if parameters.aspect is None else parameters.aspect
        return 0.5, aspect, min(0.1, 0.5 * aspect) if parameters.cap is None else parameters.cap
    return radius, height, cap


def volume_of(radius: float, height: float, cap: float) -> float:
    """Return the volume of a tablet in closed form."""
    return math.pi * (radius**2 * (height - 2.0 * cap) + cap * (3.0 * radius**2 + cap**2) / 3.0)


def _mesh(radius: float, height: float, cap: float, tolerance: float) -> Mesh:
    """Return the mesh of a tablet, convex, with vertices on the true surface.

    Half of the tolerance is taken by the sides of the circle and half by those of the profile.
    """
    error = tolerance / 2.0 * cube_root(6.0 / math.pi * volume_of(radius, height, cap))
    curvature = (radius**2 + cap**2) / (2.0 * cap)
    angle = 2.0 * math.atan2(cap, radius)
    tilt = np.linspace(0.0, angle, 1 + math.ceil(sides_of(curvature, error) * angle / (2.0 * math.pi)))[1:-1]
    rise, flat = height / 2.0 - curvature * (1.0 - libm.cos(tilt)), curvature * libm.sin(tilt)
    # from the pole to the rim, and the same below
    upper = [(height / 2.0, 0.0), *zip(rise.tolist(), flat.tolist(), strict=True), (height / 2.0 - cap, radius)]
    lower = [(-z, across) for z, across in upper]
    profile = lower + upper[::-1] if height > 2.0 * cap else lower + upper[-2::-1]
    vertices, faces, _ = revolved(profile, sides=sides_of(radius, error))
    return Mesh(vertices, faces)


registration = ShapeFamily(summary="cylinder with spherical caps", parameters=Tablet, make=make)
