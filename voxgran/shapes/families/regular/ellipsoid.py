"""Ellipsoids: from needles to disks, smooth and convex."""

import numpy as np

from voxgran._base.config import parameter, parameter_class
from voxgran.shapes.family import ShapeFamily, Sized, regular_solid
from voxgran.shapes.model import Shape


@parameter_class
class Ellipsoid(Sized):
    """Parameters of an ellipsoid.

    Parameters
    ----------
    aspect
        ratios of the axes; default: (1, 0.8, 0.6).
    semi_axes
        lengths of the semi-axes; replace aspect and diameter.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.ellipsoid(semi_axes=(1, 2, 3)).volume, 4)
    25.1327
    """

    aspect: tuple[float, float, float] | None = parameter(None)
    semi_axes: tuple[float, float, float] | None = parameter(None, unit="length")


def make(parameters: Ellipsoid, generator: np.random.Generator) -> Shape:
    """Return the ellipsoid; nothing is random."""
    axes, ratios = parameters.semi_axes, parameters.aspect or (1.0, 0.8, 0.6)
    return regular_solid("ellipsoid", parameters, given=(("semi_axes", axes),), lengths=axes, ratios=ratios)


registration = ShapeFamily(summary="ellipsoid with three axes", parameters=Ellipsoid, make=make)
