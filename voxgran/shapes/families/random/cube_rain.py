"""Rain of turned cubes: cubes of random size and orientation fall on a cluster, each along a line, and stick in it.

Each cube falls towards a random cube of the cluster, from a random direction or from above, until it has sunk into any
cube by a given part of the smaller of the two edges. How deep two cubes are in each other is known in closed form, by
the separating axes of their faces and edges, so that each cube overlaps the cluster and the union is one piece.

The record of a shape holds centers (n, 3), edges (n,) and orientations (n, 4), unit quaternions (w, x, y, z), of the
cubes: lengths in equivalent diameters, from the centroid, in the frame in which the shape was made.

References
----------
Dev 2013, as surveyed by Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete
Element Analysis of Discontinuous Materials
"""

from typing import Literal

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, as_number, as_positive
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.shapes.boolean import united
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import unit_box

MOST_CUBES = 1000


@parameter_class
class CubeRain(Sized):
    """Parameters of a rain of turned cubes.

    Parameters
    ----------
    cubes
        number of cubes; from 1 to 1000.
    edges
        range of the edges of the cubes, before scaling to diameter.
    overlap
        how deep a cube sinks into another, in edges of the smaller one; from 0.01 to 0.9.
    fall
        from where cubes fall: from all sides, or from above.

    Raises
    ------
    InputError
        If a parameter is out of range.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.cube_rain(cubes=5, seed=1)
    Shape('cube_rain', mesh, diameter=1)
    """

    cubes: int = parameter(12, at_least=1, at_most=MOST_CUBES)
    edges: tuple[float, float] = parameter((0.5, 1.0))
    overlap: float = parameter(0.3, at_least=0.01, at_most=0.9)
    fall: Literal["around", "down"] = parameter("around")

    def __post_init__(self) -> None:
        """Check all parameters."""
        check_bounds(self)
        least, most = self.edges
        as_number(least, "edges", above=0.0, at_most=as_positive(most, "edges"))
        as_number(most / least, "the ratio of the largest to the smallest of edges", at_most=100.0)


def make(parameters: CubeRain, generator: np.random.Generator) -> Shape:
    """Return the union of the cubes."""
    least, most = parameters.edges
    edges = least + (most - least) * generator.random(parameters.cubes)
    orientations = random_rotations(generator, parameters.cubes)
    turns = rotation_matrices(orientations)
    centers = np.zeros((parameters.cubes, 3))
    for k in range(1, parameters.cubes):
        centers[k] = _landed(centers[:k], edges[: k + 1], turns[: k + 1], parameters, generator)
    corners, faces, _ = unit_box()
    solids = [(linear.matmul(edges[k] * corners, turns[k].T) + centers[k], faces) for k in range(parameters.cubes)]
    raw = Shape.from_mesh(*united(solids), name="cube_rain")
    places = (centers - raw.offset) / raw.diameter
    record = {"centers": places, "edges": edges / raw.diameter, "orientations": orientations}
    return sized(raw.geometry, parameters.diameter, name="cube_rain", record=record)


def _landed(
    centers: Floats, edges: Floats, turns: Floats, parameters: CubeRain, generator: np.random.Generator
) -> Floats:
    """Return the center of a cube, the last of the edges and rotations, that falls on others of (n, 3) centers."""
    aim = int(generator.integers(len(centers)))
    direction, across = _line(parameters.fall, generator)
    # within this distance of a center every line leads into the cube
    reach = (edges[aim] + edges[-1]) / 2 - parameters.overlap * min(edges[aim], edges[-1])
    start = centers[aim] + reach * across - (2 * float(edges.sum()) + np.ptp(centers, axis=0).sum()) * direction
    enter, leave = _interval(start - centers, direction, edges, turns, parameters.overlap)
    return np.asarray(start + enter[enter < leave].min() * direction)


def _line(fall: str, generator: np.random.Generator) -> tuple[Floats, Floats]:
    """Return a direction of fall, and a random point of the unit disk normal to it."""
    radius, turn = np.sqrt(generator.random()), 2 * np.pi * generator.random()
    frame = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    if fall == "around":
        frame = rotation_matrices(random_rotations(generator, 1))[0]
    return frame[2], radius * (libm.cos(turn) * frame[0] + libm.sin(turn) * frame[1])


def _interval(away: Floats, direction: Floats, edges: Floats, turns: Floats, overlap: float) -> tuple[Floats, Floats]:
    """Return between which distances along a line a cube is deep enough in each of n others, (n,) and (n,).

    The cube begins `away` (n, 3) from their centers. Two cubes are as deep in each other as their shadows on the axis
    on which these overlap least, among the normals of their faces and the cross products of their edges.
    """
    one, two = turns[:-1], np.broadcast_to(turns[-1], turns[:-1].shape)
    crossed = np.cross(one.transpose(0, 2, 1)[:, :, None], two.transpose(0, 2, 1)[:, None]).reshape(-1, 9, 3)
    axes = np.concatenate([one.transpose(0, 2, 1), two.transpose(0, 2, 1), crossed], axis=1)
    length = linear.norm(axes, axis=2, keepdims=True)
    # edges that are parallel give no axis of their own
    axes = np.where(length > 1e-9, axes / np.maximum(length, 1e-9), axes[:, :1])
    half = (
        edges[:-1, None] * np.abs(linear.matmul(axes, one)).sum(axis=2)
        + edges[-1] * np.abs(linear.matmul(axes, turns[-1])).sum(axis=2)
    ) / 2 - overlap * np.minimum(edges[:-1], edges[-1])[:, None]
    begin, speed = linear.einsum("nak,nk->na", axes, away), linear.matmul(axes, direction)
    steep = np.where(np.abs(speed) < 1e-300, 1e-300, speed)
    first, last = (-half - begin) / steep, (half - begin) / steep
    return np.minimum(first, last).max(axis=1), np.maximum(first, last).min(axis=1)


registration = ShapeFamily(
    summary="union of cubes of random size and orientation that fall on each other and stick",
    parameters=CubeRain,
    make=make,
    source="Dev 2013, as surveyed by Sajjadi & Khalili 2015",
    random=True,
    libraries=("manifold3d",),
)
