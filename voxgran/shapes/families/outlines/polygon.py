"""Polygons in two dimensions: regular ones, optionally stretched, or any simple polygon given by its corners."""

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import as_count, as_positive
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline

#: largest number of corners of a regular polygon
MOST_CORNERS = 10_000


@parameter_class
class Polygon(Sized):
    """Parameters of a polygon.

    Parameters
    ----------
    corners
        number of corners of a regular polygon; default: 6.
    stretch
        factor by which x is stretched before scaling to diameter; default: 1.
    diameter
        diameter of the disk of equal area; default: 1.
    vertices
        corners in counterclockwise order; replace corners, stretch and diameter.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.polygon(vertices=[(0, 0), (2, 0), (2, 1), (0, 1)]).volume  # its area
    2.0
    """

    corners: int | None = parameter(None)
    stretch: float | None = parameter(None)
    vertices: tuple[tuple[float, float], ...] | None = parameter(None, unit="length")


def make(parameters: Polygon, generator: np.random.Generator) -> Shape:
    """Return the polygon; nothing is random.

    Raises
    ------
    InputError
        If a regular polygon has fewer than 3 or more than 10 000 corners, a number is not above 0, the polygon is not
        simple, or the size or the form is given twice.
    """
    if parameters.vertices is not None:
        if parameters.diameter is not None:
            raise InputError("diameter and vertices are both given: each makes the size; leave one out")
        for name, value in (("corners", parameters.corners), ("stretch", parameters.stretch)):
            if value is not None:
                raise InputError(f"{name} and vertices are both given: each makes the form; leave one out")
        outline = Outline("polygon", vertices=np.array(parameters.vertices, dtype=np.float64))
        return Shape.of(outline, name="polygon")
    count = (
        6 if parameters.corners is None else as_count(parameters.corners, "corners", at_least=3, at_most=MOST_CORNERS)
    )
    angles = 2 * np.pi * (np.arange(count) + 0.5) / count
    ring = np.column_stack([libm.cos(angles), libm.sin(angles)])
    ring[:, 0] *= 1.0 if parameters.stretch is None else as_positive(parameters.stretch, "stretch")
    return sized(Outline("polygon", vertices=ring), parameters.diameter, name="polygon")


registration = ShapeFamily(summary="simple polygon, in 2D", parameters=Polygon, make=make, dimension=2)
