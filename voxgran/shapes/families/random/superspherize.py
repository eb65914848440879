"""Volumes inflated toward spheres: angular solids with round bulges, or pebbles where much is inflated.

A base volume is inflated several times, each time toward a sphere of random center and radius, by a random amount and
in a cone of random directions. Parts of the base beyond all spheres keep their edges. The amounts that were reached are
recorded: where the center of an inflation does not see the whole surface they may be less than drawn, down to 0.

References
----------
Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element Analysis of
Discontinuous Materials, cite the method as superspherize of Johnson 2005. That source was not at hand; the formula of
the inflation is our own (voxgran/shapes/generating/inflation.py).
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from voxgran._base.arrays import as_number, as_positive
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.generating.base import check_base, made_base
from voxgran.shapes.generating.inflation import DEPTH, Inflation, inflated
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape

#: largest number of centers that are drawn for an inflation; after them it is left out
TRIES = 50


@parameter_class
class Superspherize(Sized):
    """Parameters of a volume inflated toward spheres.

    Parameters
    ----------
    base
        volume that is inflated: a family, a table of family, seed and its parameters, or a Shape.
    inflations
        number of spheres toward which it is inflated.
    amounts
        how far the surface moves toward a sphere, a number or a range; above 0, at most 1: all the way.
    radii
        radius of the spheres in equivalent diameters of the base, a number or a range; at most 10.
    half_angles
        half angle of the cone in which the surface is inflated, a number or a range; 180 is everywhere.
    spread
        how far the centers lie from the centroid, as part of the way to a random point of the base.
    longest_edge
        longest edge of the mesh, in equivalent diameters of the base.

    Raises
    ------
    UnknownNameError
        If the base is the name of no family.
    InputError
        If a number is out of range, or the base is no solid.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.superspherize(inflations=1, longest_edge=0.3, seed=1)
    Shape('superspherize', mesh, diameter=1)
    """

    base: str | Shape | Mapping[str, Any] = parameter("convex_polyhedron")
    inflations: int = parameter(4, at_least=1, at_most=100)
    amounts: float | tuple[float, float] = parameter((0.5, 1.0))
    radii: float | tuple[float, float] = parameter((0.4, 0.65))
    half_angles: float | tuple[float, float] = parameter((40.0, 110.0), unit="degrees")
    spread: float = parameter(0.5, at_least=0.0, at_most=1.0)
    longest_edge: float = parameter(0.08, at_least=0.01, at_most=0.5)

    def __post_init__(self) -> None:
        """Check the ranges and the base."""
        check_bounds(self)
        for name, most in (("amounts", 1.0), ("radii", 10.0), ("half_angles", 180.0)):
            low, high = _ends(getattr(self, name))
            as_number(high, name, above=0.0, at_most=most)
            as_number(low, name, above=0.0, at_most=as_positive(high, name))
        check_base(self.base)


def make(parameters: Superspherize, generator: np.random.Generator) -> Shape:
    """Return an inflated volume."""
    base = made_base(parameters.base, generator)
    vertices, faces = base.vertices, base.faces
    amounts = np.zeros(parameters.inflations)
    for k in range(parameters.inflations):
        inflation = _drawn(parameters, base, generator)
        if inflation is not None:
            vertices, faces, amounts[k] = inflated(vertices, faces, inflation, parameters.longest_edge * base.diameter)
    mesh = Mesh(vertices.copy(), faces.copy())
    return sized(mesh, parameters.diameter, name="superspherize", record={"base": base.name, "amounts": amounts})


def _drawn(parameters: Superspherize, base: Shape, generator: np.random.Generator) -> Inflation | None:
    """Draw an inflation; None where no center was found deep enough in the base, which is very thin."""
    amount, radius, half_angle = (
        low + (high - low) * float(generator.random())
        for low, high in map(_ends, (parameters.amounts, parameters.radii, parameters.half_angles))
    )
    z, turn = 2.0 * float(generator.random()) - 1.0, 2.0 * math.pi * float(generator.random())
    flat = math.sqrt(1.0 - z * z)
    axis = np.array([flat * math.cos(turn), flat * math.sin(turn), z])
    low, high = base.bounds
    points = low + (high - low) * generator.random((TRIES, 3))
    centers = parameters.spread * points[base.contains(points)]
    deep = centers[base.signed_distance(centers) < -DEPTH * base.diameter]
    if not len(deep):
        return None
    return Inflation(deep[0], radius * base.diameter, amount, axis, math.radians(half_angle))


def _ends(value: float | tuple[float, float]) -> tuple[float, float]:
    """Return the ends of a range; those of a number are equal to it."""
    return value if isinstance(value, tuple) else (value, value)


registration = ShapeFamily(
    summary="volume inflated toward random spheres",
    parameters=Superspherize,
    make=make,
    source="Johnson 2005, as cited by Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes "
    "for Discrete Element Analysis of Discontinuous Materials",
    random=True,
)
