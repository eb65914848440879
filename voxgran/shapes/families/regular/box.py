"""Boxes: cuboids from cubes to plates and rods."""

import numpy as np

from voxgran._base.config import parameter, parameter_class
from voxgran.shapes.family import ShapeFamily, Sized, regular_solid
from voxgran.shapes.model import Shape


@parameter_class
class Box(Sized):
    """Parameters of a box.

    Parameters
    ----------
    aspect
        ratios of the edge lengths; default: (1, 1, 1).
    lengths
        edge lengths; replace aspect and diameter.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.box(lengths=(1, 2, 3)).volume
    6.0
    """

    aspect: tuple[float, float, float] | None = parameter(None)
    lengths: tuple[float, float, float] | None = parameter(None, unit="length")


def make(parameters: Box, generator: np.random.Generator) -> Shape:
    """Return the box; nothing is random."""
    lengths, ratios = parameters.lengths, parameters.aspect or (1.0, 1.0, 1.0)
    return regular_solid("box", parameters, given=(("lengths", lengths),), lengths=lengths, ratios=ratios)


registration = ShapeFamily(summary="cuboid with edges along x, y and z", parameters=Box, make=make)
