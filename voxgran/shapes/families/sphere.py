"""Spheres: grains without orientation, supported by every packing method."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import as_positive
from voxgran._base.config import parameter
from voxgran.shapes.family import ShapeFamily
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive


@dataclass(frozen=True, kw_only=True, slots=True)
class Sphere:
    """Parameters of a sphere."""

    diameter: float = parameter(1.0, doc="diameter", unit="length")


def make(parameters: Sphere, generator: np.random.Generator) -> Shape:
    """Return the sphere; nothing is random.

    Raises
    ------
    InputError
        If the diameter is not above 0.
    """
    radius = as_positive(parameters.diameter, "diameter") / 2
    return Shape.of(Primitive("sphere", (radius,)), name="sphere")


registration = ShapeFamily(name="sphere", summary="sphere", parameters=Sphere, make=make)
