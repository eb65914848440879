"""Disks: the two-dimensional spheres."""

import numpy as np

from voxgran._base.config import parameter_class
from voxgran.shapes.families.regular.sphere import Sphere
from voxgran.shapes.family import ShapeFamily, round_radius
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline


@parameter_class
class Disk(Sphere):
    """Parameters of a disk: those of a sphere.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.disk(radius=1.0).volume, 4)  # its area
    3.1416
    """


def make(parameters: Disk, generator: np.random.Generator) -> Shape:
    """Return the disk; nothing is random."""
    radius = round_radius(parameters.diameter, parameters.radius)
    return Shape.of(Outline("disk", radius=radius), name="disk")


registration = ShapeFamily(summary="disk, in 2D", parameters=Disk, make=make, dimension=2)
