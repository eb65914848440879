"""Random surfaces: sheets whose height is a sum of random waves.

Sajjadi & Khalili 2015 pack random volumes and surfaces; these surfaces are smooth and never cross themselves.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import as_count, as_number, as_positive
from voxgran._base.config import parameter
from voxgran.shapes.families.sheet import lattice_faces
from voxgran.shapes.family import ShapeFamily, sized
from voxgran.shapes.model import Shape
from voxgran.shapes.surface import Surface

#: cells along an edge in the length of the shortest wave
CELLS = 8
#: bounds: of the height, beyond which rounding makes faces cross, and of what costs time and memory
HIGHEST, MOST_WAVES, SHORTEST = 10.0, 10_000, 64.0


@dataclass(frozen=True, kw_only=True, slots=True)
class RandomSurface:
    """Parameters of a random surface.

    Raises
    ------
    InputError
        If a number is out of range.
    """

    aspect: tuple[float, float] = parameter((1.0, 1.0), doc="ratio of its edges, along x and y, before it has height")
    height: float = parameter(0.15, doc="root mean square of its height, in the mean of its edges; at most 10")
    waves: int = parameter(6, doc="number of waves; at most 10 000")
    most: float = parameter(
        1.5, doc="waves along the mean of its edges, at most; each has at least half as many; up to 64"
    )
    diameter: float | None = parameter(
        None, doc="equivalent diameter, of a disk of equal area; left out: 1", unit="length"
    )

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
    summary="sheet whose height is a sum of random waves; an open surface",
    parameters=RandomSurface,
    make=make,
    random=True,
    is_open=True,
)
