"""Hollow cylinders: with several equal holes along the axis, as catalyst pellets have them."""

import numpy as np

from voxgran._base.config import parameter, parameter_class
from voxgran.shapes.families.regular.ring import Ring, pierced
from voxgran.shapes.family import ShapeFamily
from voxgran.shapes.model import Shape


@parameter_class
class HollowCylinder(Ring):
    """Parameters of a hollow cylinder: those of a ring, and the number of its holes.

    Parameters
    ----------
    holes
        number of equal holes, on a circle about the axis where they are several, with walls of equal width between each
        other and at the mantle.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.hollow_cylinder(holes=4, bore=0.3).diameter, 6)
    1.0
    """

    holes: int = parameter(4, at_least=1, at_most=100)


def make(parameters: HollowCylinder, generator: np.random.Generator) -> Shape:
    """Return the hollow cylinder, its axis along z; nothing is random."""
    return pierced(parameters, parameters.holes, name="hollow_cylinder")


registration = ShapeFamily(summary="cylinder with several holes along its axis", parameters=HollowCylinder, make=make)
