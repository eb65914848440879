"""Tori: rings of circular section, the simplest solid with a hole."""

import math

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.scalars import cube_root
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import sides_of

#: largest ratio of the minor to the major radius: the hole keeps a width that rounding does not close
FATTEST = 0.999


@parameter_class
class Torus:
    """Parameters of a torus.

    Parameters
    ----------
    aspect
        ratio of the minor to the major radius; default: 0.4.
    diameter
        equivalent diameter; default: 1.
    major_radius
        radius of the circle about which the section turns; with minor_radius, replaces aspect and diameter.
    minor_radius
        radius of the circular section; requires major_radius.
    tolerance
        largest distance of the mesh from the true surface, in equivalent diameters.

    Raises
    ------
    InputError
        If a number is out of range, the size is given twice or in part, or the minor radius leaves no hole.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.torus(major_radius=2.0, minor_radius=0.5, tolerance=0.02).bounds[1].round(6).tolist()
    [2.5, 2.474554, 0.475528]
    """

    aspect: float | None = parameter(None, at_least=0.001, at_most=FATTEST)
    diameter: float | None = parameter(None, unit="length", above=0.0)
    major_radius: float | None = parameter(None, unit="length", above=0.0)
    minor_radius: float | None = parameter(None, unit="length", above=0.0)
    tolerance: float = parameter(0.002, at_least=1e-4, at_most=0.1)

    def __post_init__(self) -> None:
        """Check the values."""
        check_bounds(self)
        major, minor = self.major_radius, self.minor_radius
        refuse_both(self.diameter, (("major_radius", major), ("minor_radius", minor)), aspect=self.aspect)
        if major is not None and minor is not None and not 0.001 * major <= minor <= FATTEST * major:
            raise InputError(
                f"minor_radius is {minor:g}: it must be between 0.001 and {FATTEST} of the major radius {major:g}, so "
                "that the ring has a hole; change one of them"
            )


def make(parameters: Torus, generator: np.random.Generator) -> Shape:
    """Return the torus, its axis along z; nothing is random."""
    major, minor = parameters.major_radius, parameters.minor_radius
    if major is None or minor is None:
        solid = _mesh(1.0, parameters.aspect or 0.4, parameters.tolerance)
        return sized(solid, parameters.diameter, name="torus")
    return Shape.of(_mesh(major, minor, parameters.tolerance), name="torus")


def _mesh(major: float, minor: float, tolerance: float) -> Mesh:
    """Return the mesh of a torus with vertices on the true surface, of plane quadrilaterals.

    Half of the tolerance is taken by the sides of the section and half by those of the outer circle.
    """
    error = tolerance / 2 * cube_root(12 * math.pi * major * minor**2)
    around, across = sides_of(major + minor, error), sides_of(minor, error)
    turn, tilt = 2 * np.pi * np.arange(around) / around, 2 * np.pi * np.arange(across) / across
    flat = (major + minor * libm.cos(tilt))[None, :]
    x, y, z = libm.cos(turn)[:, None] * flat, libm.sin(turn)[:, None] * flat, minor * libm.sin(tilt)
    vertices = np.stack([x, y, np.broadcast_to(z, x.shape)], axis=-1).reshape(-1, 3)
    i, j = (index.ravel() for index in np.indices((around, across)))
    a, d = i * across + j, i * across + (j + 1) % across
    b, c = (a + across) % len(vertices), (d + across) % len(vertices)
    return Mesh(vertices, np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]).astype(np.int64))


registration = ShapeFamily(summary="ring of circular section", parameters=Torus, make=make)
