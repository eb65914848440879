"""Cones: circular, with a sharp tip and a sharp rim."""

import numpy as np

from voxgran._base.config import parameter_class
from voxgran.shapes.families.regular.cylinder import Cylinder, round_solid
from voxgran.shapes.family import ShapeFamily
from voxgran.shapes.model import Shape


@parameter_class
class Cone(Cylinder):
    """Parameters of a cone: those of a cylinder.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.cone(radius=1.0, height=3.0).volume, 4)
    3.1416
    """


def make(parameters: Cone, generator: np.random.Generator) -> Shape:
    """Return the cone, its axis along z; nothing is random."""
    return round_solid("cone", parameters)


registration = ShapeFamily(summary="circular cone", parameters=Cone, make=make)
