"""Disks: the two-dimensional spheres."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.config import parameter
from voxgran.shapes.family import ShapeFamily, round_radius
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline


@dataclass(frozen=True, kw_only=True, slots=True)
class Disk:
    """Parameters of a disk."""

    diameter: float | None = parameter(None, doc="diameter; left out: 1", unit="length")
    radius: float | None = parameter(None, doc="radius, in place of the diameter", unit="length")


def make(parameters: Disk, generator: np.random.Generator) -> Shape:
    """Return the disk; nothing is random.

    Raises
    ------
    InputError
        If the diameter or the radius is not above 0, or both are given.
    """
    radius = round_radius(parameters.diameter, parameters.radius)
    return Shape.of(Outline("disk", radius=radius), name="disk")


registration = ShapeFamily(name="disk", summary="disk, in 2D", parameters=Disk, make=make, dimension=2)
