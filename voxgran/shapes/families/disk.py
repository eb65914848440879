"""Disks: the two-dimensional spheres."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import as_positive
from voxgran._base.config import parameter
from voxgran.shapes.family import ShapeFamily
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline


@dataclass(frozen=True, kw_only=True, slots=True)
class Disk:
    """Parameters of a disk."""

    diameter: float = parameter(1.0, doc="diameter", unit="length")


def make(parameters: Disk, generator: np.random.Generator) -> Shape:
    """Return the disk; nothing is random.

    Raises
    ------
    InputError
        If the diameter is not above 0.
    """
    radius = as_positive(parameters.diameter, "diameter") / 2
    return Shape.of(Outline("disk", radius=radius), name="disk")


registration = ShapeFamily(name="disk", summary="disk, in 2D", parameters=Disk, make=make, dimension=2)
