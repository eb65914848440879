"""Random surfaces: sheets whose height is a sum of random waves.

Sajjadi & Khalili (2015) pack random volumes and surfaces. The surfaces made here are smooth and never intersect
themselves.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import as_count, as_number, as_positive
from voxgran._base.config import parameter
from voxgran.shapes.families.sheet import lattice_faces
from voxgran.shapes.family import ShapeFamily, sized
from voxgran.shapes.model import Shape
from voxgran.shapes.surface import Surface

#: cells per shortest wavelength along each edge
CELLS = 8
#: upper bounds of the height (above it rounding makes faces intersect), of the number of waves and of the wave number
#: (both cost time and memory)
HIGHEST, MOST_WAVES, SHORTEST = 10.0, 10_000, 64.0


@dataclass(frozen=True, kw_only=True, slots=True)
class RandomSurface:
    """Parameters of a random surface.

    Raises
    ------
    InputError
        If a number is out of range.
    """

    aspect: tuple[float, float] = parameter((1.0, 1.0), doc="ratio of the edges along x and y of the flat sheet")
    height: float = parameter(0.15, doc="root mean square height, in mean edge lengths, in [0, 10]")
    waves: int = parameter(6, doc="number of waves, from 1 to 10 000")
    most: float = parameter(
        1.5, doc="largest number of periods per mean edge length, in (0, 64]; the smallest is half of it"
    )
    diameter: float | None = parameter(None, doc="diameter of the disk of equal area; default: 1", unit="length")

    def __post_init__(self) -> None:
        """Check the ranges."""
        as_number(self.height, "height", at_least=0.0, at_most=HIGHEST)
        as_count(self.waves, "waves", at_least=1, at_most=MOST_WAVES)
        as_number(self.most, "most", above=0.0, at_most=SHORTEST)


def make(parameters: RandomSurface, generator: np.random.Generator) -> Shape:
    """Return a random surface.

    Raises
    ------
    InputError
        If an edge or the diameter is not above 0.
    """
    if parameters.diameter is not None:
        as_positive(parameters.diameter, "diameter")
    edges = np.array([as_positive(value, "aspect") for value in parameters.aspect])
    edges /= edges.mean()
    columns, rows = (max(4, int(np.ceil(CELLS * parameters.most * edge))) for edge in edges)
    x, y = np.meshgrid(edges[0] * np.arange(columns + 1) / columns, edges[1] * np.arange(rows + 1) / rows)
    turn, start = 2 * np.pi * generator.random((2, parameters.waves))
    number = 2 * np.pi * parameters.most * (0.5 + 0.5 * generator.random(parameters.waves))
    z = np.zeros_like(x)
    for k in range(parameters.waves):
        z += np.sin(number[k] * (np.cos(turn[k]) * x + np.sin(turn[k]) * y) + start[k])
    z -= z.mean()
    z *= parameters.height / np.sqrt((z**2).mean())
    vertices = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    return sized(Surface(vertices, lattice_faces(columns, rows)), parameters.diameter, name="random_surface")


registration = ShapeFamily(
    name="random_surface",
    summary="open surface: a sheet whose height is a sum of random waves",
    parameters=RandomSurface,
    make=make,
    random=True,
    is_open=True,
)
