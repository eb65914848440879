"""Rough sheets: rectangles whose height is a random field, as measured on fractures and on machined surfaces."""

from typing import Any

import numpy as np

from voxgran._base.arrays import as_positive
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import TooLargeError
from voxgran.shapes.families.surfaces.sheet import lattice_faces
from voxgran.shapes.family import ShapeFamily, refuse_both, sized
from voxgran.shapes.mesh import Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.roughness.fields import draw_field
from voxgran.shapes.roughness.measuring import lattice_statistics, moments_of
from voxgran.shapes.roughness.parameters import Roughness
from voxgran.shapes.roughness.roughen import MOST_FACES, ends_of

#: cells along an edge at least, so that there is something to measure
FEWEST = 8


@parameter_class
class RoughSheet(Roughness):
    """Parameters of a rough sheet.

    Heights and lengths are in the unit of `lengths`; without them, in mean edges of the flat sheet, which is scaled
    with its heights until the area of the rough surface is that of the disk of the given diameter.

    Parameters
    ----------
    aspect
        ratio of the edges along x and y of the flat sheet; default: (1, 1).
    diameter
        diameter of the disk whose area is that of the rough surface; default: 1.
    lengths
        edge lengths along x and y of the flat sheet; replace aspect and diameter.

    Raises
    ------
    InputError
        If a number is out of range, or a parameter is given that its method does not have.

    Examples
    --------
    >>> import voxgran as vg
    >>> sheet = vg.shapes.rough_sheet(lengths=(10, 10), rms=0.1, correlation_length=1.0, seed=1)
    >>> round(vg.surface_statistics(sheet).rms, 2)
    0.1
    """

    aspect: tuple[float, float] | None = parameter(None)
    diameter: float | None = parameter(None, unit="length")
    lengths: tuple[float, float] | None = parameter(None, unit="length")


def make(parameters: RoughSheet, generator: np.random.Generator) -> Shape:
    """Return a rough sheet; its heights have the mean 0 and exactly the root mean square that is asked for.

    Raises
    ------
    TooLargeError
        If the shortest wavelength needs more than 400,000 faces.
    """
    refuse_both(parameters.diameter, (("lengths", parameters.lengths),), aspect=parameters.aspect)
    edges = np.array([as_positive(value, "an edge") for value in parameters.lengths or parameters.aspect or (1, 1)])
    if parameters.lengths is None:
        edges /= edges.mean()
    field = parameters.on(2 * float(np.sqrt(edges.prod() / np.pi)), 2)
    cells = np.maximum(np.ceil(edges / field.edge), FEWEST)
    if 2 * cells.prod() > MOST_FACES:
        least = field.shortest * float(np.sqrt(2 * cells.prod() / MOST_FACES))
        raise TooLargeError(
            f"shortest is {field.shortest:.4g}: a sheet of {2 * cells.prod():.3g} faces would be needed to resolve it, "
            f"at most {MOST_FACES} are made; give at least {least:.2g}"
        )
    columns, rows = (int(n) for n in cells)
    x, y = (length * np.arange(n + 1) / n for length, n in zip(edges, (columns, rows), strict=True))
    places = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    drawn = draw_field(field, np.zeros(2), edges, edges / cells, generator).at(places.reshape(-1, 2))
    heights = field.rms * moments_of(drawn, np.full(drawn.size, 1 / drawn.size))[0].reshape(places.shape[:2])
    vertices = np.column_stack([*places.transpose(2, 1, 0).reshape(2, -1), heights.T.ravel()])
    geometry = Surface(vertices, lattice_faces(columns, rows))
    raw = 2 * float(np.sqrt(geometry.surface_area / np.pi))
    factor = 1.0 if parameters.lengths is not None else (parameters.diameter or 1.0) / raw
    told: dict[str, Any] = {
        "roughness_method": field.method,
        "roughness_shortest": factor * field.shortest,
        "roughness_rms": 0.0,
    }
    if field.rms:
        found = lattice_statistics(factor * heights, factor * edges / cells, tuple(factor * e for e in ends_of(field)))
        told |= {f"roughness_{name}": value for name, value in found.recorded().items()}
    if parameters.lengths is not None:
        return Shape.of(geometry, name="rough_sheet", record=told)
    return sized(geometry, parameters.diameter, name="rough_sheet", record=told)


registration = ShapeFamily(
    summary="open surface: a rectangle whose height is a random field",
    parameters=RoughSheet,
    make=make,
    source="Patir 1978, doi:10.1016/0043-1648(78)90157-6",
    random=True,
    is_open=True,
)
