"""Sheets: rectangles without thickness, flat or rolled about the y axis."""

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Integers, as_number, as_positive
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.shapes.family import ShapeFamily, Sized, refuse_both, sized
from voxgran.shapes.mesh import Surface
from voxgran.shapes.model import Shape

#: largest angle between adjacent strips of a rolled sheet, in degrees
STRIP = 7.5


@parameter_class
class Sheet(Sized):
    """Parameters of a sheet.

    Parameters
    ----------
    aspect
        ratio of the edges along x and y; default: (1, 1).
    roll
        angle through which the sheet is rolled along x, in degrees, in [0, 360): 0 is flat, 180 is half a pipe; the
        curvature is this angle divided by the length along x.
    diameter
        diameter of the disk of equal area; default: 1.
    lengths
        edge lengths along x and y; replace aspect and diameter.

    Raises
    ------
    InputError
        If the angle is negative, or so large that the sheet would touch itself.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.shapes.sheet(lengths=(2, 1)).surface_area, 6)
    2.0
    """

    aspect: tuple[float, float] | None = parameter(None)
    roll: float = parameter(0.0)
    lengths: tuple[float, float] | None = parameter(None, unit="length")

    def __post_init__(self) -> None:
        """Check that the sheet does not close on itself."""
        if as_number(self.roll, "roll", at_least=0.0) >= 360.0:
            raise InputError(f"roll is {self.roll:g} degrees: a sheet meets itself at 360; give less")


def make(parameters: Sheet, generator: np.random.Generator) -> Shape:
    """Return the sheet; nothing is random. A rolled sheet consists of flat strips at most 7.5 degrees apart."""
    refuse_both(parameters.diameter, (("lengths", parameters.lengths),), aspect=parameters.aspect)
    length, width = (as_positive(value, "an edge") for value in parameters.lengths or parameters.aspect or (1, 1))
    strips = max(1, int(np.ceil(parameters.roll / STRIP)))
    share = np.arange(strips + 1) / strips - 0.5
    x, z = length * share, np.zeros(strips + 1)
    if parameters.roll:
        angle = np.deg2rad(parameters.roll)
        # the strips together are as long as the sheet
        radius = length / (2 * strips * libm.sin(angle / (2 * strips)))
        x, z = radius * libm.sin(angle * share), radius * (1.0 - libm.cos(angle * share))
    rows = [np.column_stack([x, np.full(strips + 1, y), z]) for y in (-width / 2, width / 2)]
    geometry = Surface(np.concatenate(rows), lattice_faces(strips, 1))
    if parameters.lengths is not None:
        return Shape.of(geometry, name="sheet")
    return sized(geometry, parameters.diameter, name="sheet")


def lattice_faces(columns: int, rows: int) -> Integers:
    """Return the (2 * columns * rows, 3) triangles of a lattice of cells; corners are numbered along x first."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows))
    a = (j * (columns + 1) + i).ravel()
    b, c, d = a + 1, a + columns + 2, a + columns + 1
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])


registration = ShapeFamily(
    summary="open surface: a rectangle without thickness, flat or rolled", parameters=Sheet, make=make, is_open=True
)
