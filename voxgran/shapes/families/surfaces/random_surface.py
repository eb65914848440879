"""Random surfaces: sheets whose height is a sum of random waves.

Sajjadi & Khalili (2015) pack random volumes and surfaces. The surfaces made here are smooth and never intersect
themselves.
"""

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import as_positive
from voxgran._base.config import parameter, parameter_class
from voxgran.shapes.families.surfaces.sheet import lattice_faces
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.mesh import Surface
from voxgran.shapes.model import Shape

#: cells per shortest wavelength along each edge
CELLS = 8
#: upper bounds of the height (above it rounding makes faces intersect), of the number of waves and of the wave number
#: (both cost time and memory)
HIGHEST, MOST_WAVES, SHORTEST = 10.0, 10_000, 64.0


@parameter_class
class RandomSurface(Sized):
    """Parameters of a random surface.

    Parameters
    ----------
    aspect
        ratio of the edges along x and y of the flat sheet.
    height
        root mean square height, in mean edge lengths.
    waves
        number of waves.
    max_frequency
        largest number of periods per mean edge length; the smallest is half of it.
    diameter
        diameter of the disk of equal area; default: 1.

    Raises
    ------
    InputError
        If a number is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.random_surface(height=0.1, seed=1).is_open
    True
    """

    aspect: tuple[float, float] = parameter((1.0, 1.0))
    height: float = parameter(0.15, at_least=0.0, at_most=HIGHEST)
    waves: int = parameter(6, at_least=1, at_most=MOST_WAVES)
    max_frequency: float = parameter(1.5, above=0.0, at_most=SHORTEST)


def make(parameters: RandomSurface, generator: np.random.Generator) -> Shape:
    """Return a random surface."""
    edges = np.array([as_positive(value, "aspect") for value in parameters.aspect])
    edges /= edges.mean()
    columns, rows = (max(4, int(np.ceil(CELLS * parameters.max_frequency * edge))) for edge in edges)
    x, y = np.meshgrid(edges[0] * np.arange(columns + 1) / columns, edges[1] * np.arange(rows + 1) / rows)
    turn, start = 2 * np.pi * generator.random((2, parameters.waves))
    number = 2 * np.pi * parameters.max_frequency * (0.5 + 0.5 * generator.random(parameters.waves))
    z = np.zeros_like(x)
    for k in range(parameters.waves):
        z += libm.sin(number[k] * (libm.cos(turn[k]) * x + libm.sin(turn[k]) * y) + start[k])
    z -= z.mean()
    z *= parameters.height / np.sqrt((z**2).mean())
    vertices = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    return sized(Surface(vertices, lattice_faces(columns, rows)), parameters.diameter, name="random_surface")


registration = ShapeFamily(
    summary="open surface: a sheet whose height is a sum of random waves",
    parameters=RandomSurface,
    make=make,
    random=True,
    is_open=True,
)
