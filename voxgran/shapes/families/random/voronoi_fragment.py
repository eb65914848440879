"""Fragments of crushed rock: cells of the Voronoi tessellation of random seeds in a box.

All cells of one tessellation fill the box. With `lengths` a fragment keeps its size, so that ``cell=0`` to
``cell=seeds - 1`` of one seed are the pieces of one rock; `offset` of each shape is its place in the box,
and ``record["cell"]`` the number of the cell.

The Voronoi cells are computed one by one, as convex polyhedra.

References
----------
Okabe, Boots, Sugihara & Chiu 2000, Spatial Tessellations, doi:10.1002/9780470317013: Voronoi cells of random seeds
"""

import itertools
from typing import Literal

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, as_count
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.shapes.family import ShapeFamily, Sized, refuse_both, sized
from voxgran.shapes.generating.hulls import hull_of_corners
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape

#: largest number of seeds
MOST_SEEDS = 100_000


@parameter_class
class VoronoiFragment(Sized):
    """Parameters of a Voronoi fragment.

    Parameters
    ----------
    seeds
        number of seeds in the box, which is that of the cells.
    process
        seeds at independent random points, as in a Poisson process, or jittered about a cubic lattice.
    jitter
        edge of the cube in which each seed of a jittered lattice lies, in lattice spacings; 0 makes cubes.
    boundary
        whether the box is periodic, or its faces bound the cells.
    aspect
        factors by which the cells are stretched along x, y and z; default: (1, 1, 1).
    cell
        which cell, from 0; default: a random one.
    lengths
        edge lengths of the box, in which the fragment keeps its size; replace diameter and aspect.

    Raises
    ------
    InputError
        If a number is out of range, a choice is not known, or the size is given twice.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.voronoi_fragment(seeds=20, seed=1)
    Shape('voronoi_fragment', mesh, diameter=1)
    """

    seeds: int = parameter(64, at_least=2, at_most=MOST_SEEDS)
    process: Literal["random", "jittered"] = parameter("random")
    jitter: float = parameter(1.0, at_least=0.0, at_most=1.0)
    boundary: Literal["periodic", "reflected"] = parameter("periodic")
    aspect: tuple[float, float, float] | None = parameter(None, above=0.0)
    cell: int | None = parameter(None)
    lengths: tuple[float, float, float] | None = parameter(None, unit="length", above=0.0)

    def __post_init__(self) -> None:
        """Check the values."""
        check_bounds(self)
        refuse_both(self.diameter, (("lengths", self.lengths),), aspect=self.aspect)
        if self.cell is not None:
            as_count(self.cell, "cell", at_most=self.seeds - 1)
        side = max(2, round(self.seeds ** (1 / 3)))
        if self.process == "jittered" and side**3 != self.seeds:
            raise InputError(
                f"seeds is {self.seeds}: jittered seeds lie about the points of a cubic lattice; give {side**3}"
            )


def make(parameters: VoronoiFragment, generator: np.random.Generator) -> Shape:
    """Return one cell of the tessellation."""
    lengths = np.array(parameters.lengths or (1.0, 1.0, 1.0))
    seeds = _seeds(parameters, generator) * lengths
    drawn = int(generator.integers(parameters.seeds))
    cell = drawn if parameters.cell is None else parameters.cell
    solid, record = voronoi_cell(seeds, cell, lengths, parameters.boundary), {"cell": cell}
    if parameters.lengths is not None:
        return Shape.of(solid, name="voronoi_fragment", record=record)
    stretched = Mesh(solid.vertices * np.array(parameters.aspect or (1.0, 1.0, 1.0)), solid.faces)
    return sized(stretched, parameters.diameter, name="voronoi_fragment", record=record)


def _seeds(parameters: VoronoiFragment, generator: np.random.Generator) -> Floats:
    """Return the seeds (n, 3) in the unit cube."""
    places = generator.random((parameters.seeds, 3))
    if parameters.process == "random":
        return places
    side = round(parameters.seeds ** (1 / 3))
    lattice = np.indices((side, side, side)).reshape(3, -1).T
    return np.asarray((lattice + 0.5 + parameters.jitter * (places - 0.5)) / side)


registration = ShapeFamily(
    summary="fragment of crushed rock: cell of the Voronoi tessellation of random seeds",
    parameters=VoronoiFragment,
    make=make,
    source="Okabe, Boots, Sugihara & Chiu 2000, Spatial Tessellations, doi:10.1002/9780470317013",
    random=True,
)


#: corners of a cell that are nearer to each other, in bounding radii of the cell, are one
SAME = 1e-9


def voronoi_cell(seeds: Floats, k: int, lengths: Floats, boundary: Literal["periodic", "reflected"]) -> Mesh:
    """Return the Voronoi cell of seed k of (n, 3) seeds in a box from the origin to (3,) lengths.

    The box is periodic, or its faces bound the cells, as images reflected by them do.
    """
    others = np.concatenate([np.delete(seeds, k, axis=0), _images(seeds, lengths, boundary)]) - seeds[k]
    if boundary == "periodic":
        # a cell is no longer than the period along any axis, so that another image is nearer to all of its points
        others = others[(np.abs(others) <= lengths * (1 + SAME)).all(axis=1)]
    # planes n x = 1 of a convex solid about the origin are the corners of its dual, and faces of the dual its corners
    normals = 2 * others / linear.einsum("ni,ni->n", others, others)[:, None]
    dual = load("scipy.spatial").ConvexHull(normals)
    corners = -dual.equations[:, :3] / dual.equations[:, 3:]
    # more than three planes may meet at a point, and the dual then has several triangles in one face
    near = SAME * float(np.abs(corners).max())
    corners = corners[np.unique(np.round(corners / near), axis=0, return_index=True)[1]]
    return hull_of_corners(corners + seeds[k])


def _images(seeds: Floats, lengths: Floats, boundary: Literal["periodic", "reflected"]) -> Floats:
    """Return the images of the seeds around a box: 26 periodic ones, or 6 reflected by its faces."""
    if boundary == "periodic":
        shifts = np.array([shift for shift in itertools.product((-1, 0, 1), repeat=3) if any(shift)])
        return (seeds + (shifts * lengths)[:, None]).reshape(-1, 3)
    images = []
    for axis in range(3):
        for face in (0.0, lengths[axis]):
            image = seeds.copy()
            image[:, axis] = 2 * face - image[:, axis]
            images.append(image)
    return np.concatenate(images)
