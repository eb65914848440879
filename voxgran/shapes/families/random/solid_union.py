"""Unions of random base solids: angular or rounded grains with edges, dents and re-entrant corners.

Each grain is the union of a few boxes, cylinders, cones, ellipsoids and spheres of random dimensions. Each base solid
lies on a work plane of random orientation through the origin, with a random shift limited so that the solid contains a
sphere of a tenth of its size around the origin. The union is therefore connected, and no two solids merely touch.

References
----------
Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element Analysis of
Discontinuous Materials: random shapes as unions of base solids on work planes of random orientation
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats, Integers, as_count, as_number, as_positive
from voxgran._base.config import parameter
from voxgran._base.errors import InputError
from voxgran._base.rotation import random_rotations, rotation_matrices
from voxgran.shapes.boolean import united
from voxgran.shapes.family import ShapeFamily
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import revolved, sphere, unit_box

Kind = Literal["box", "cylinder", "cone", "ellipsoid", "sphere"]

#: radius of the sphere around the origin that each base solid contains, as a fraction of its size
CORE = 0.1
#: largest number of base solids of a grain
MOST_SOLIDS = 1000
#: number of subdivisions of the icosahedron, and number of sides of cylinders and cones
SUBDIVISIONS, SIDES = 2, 48


@dataclass(frozen=True, kw_only=True, slots=True)
class SolidUnion:
    """Parameters of a union of base solids.

    Raises
    ------
    InputError
        If a number is out of range.
    """

    solids: int | tuple[int, int] = parameter(
        (3, 6), doc="number of base solids, or a range to draw it from; from 1 to 1000"
    )
    kinds: tuple[Kind, ...] = parameter(
        ("box", "cylinder", "cone", "ellipsoid", "sphere"), doc="kinds of base solids to draw from"
    )
    lengths: tuple[float, float] = parameter(
        (0.4, 1.0), doc="range of each dimension of a base solid, before scaling to diameter"
    )
    diameter: float | None = parameter(None, doc="equivalent diameter; default: 1", unit="length")

    def __post_init__(self) -> None:
        """Check the ranges."""
        low, high = self.solids if isinstance(self.solids, tuple) else (self.solids, self.solids)
        as_count(high, "solids", at_least=as_count(low, "solids", at_least=1), at_most=MOST_SOLIDS)
        if not self.kinds:
            raise InputError("kinds is empty: at least one kind of base solid is needed; name one")
        least, most = self.lengths
        as_number(least, "lengths", above=0.0, at_most=as_positive(most, "lengths"))
        if least < 0.35 * most:
            raise InputError(
                f"lengths are {least} to {most}: the smallest must be at least 0.35 of the largest, so that each solid "
                "holds a sphere around the origin; move them together"
            )
        if self.diameter is not None:
            as_positive(self.diameter, "diameter")


def make(parameters: SolidUnion, generator: np.random.Generator) -> Shape:
    """Return a random union."""
    solids = parameters.solids
    low, high = solids if isinstance(solids, tuple) else (solids, solids)
    count = int(generator.integers(low, high, endpoint=True))
    vertices, faces = united([_base_solid(parameters, generator) for _ in range(count)])
    raw = Shape.from_mesh(vertices, faces, name="solid_union")
    factor = (parameters.diameter or 1.0) / raw.diameter
    return Shape.of(Mesh(raw.vertices * factor, raw.faces.copy()), name="solid_union")


def _base_solid(parameters: SolidUnion, generator: np.random.Generator) -> tuple[Floats, Integers]:
    """Return vertices and faces of one random base solid that contains the origin."""
    kind = parameters.kinds[int(generator.integers(len(parameters.kinds)))]
    least, most = parameters.lengths
    x, y, z = (float(value) for value in least + (most - least) * generator.random(3))
    lengths = {
        "box": (x, y, z),
        "ellipsoid": (x, y, z),
        "sphere": (x, x, x),
        "cylinder": (x, x, z),
        "cone": (x, x, z),
    }[kind]
    extents = np.array(lengths)
    vertices, faces = _unit_solid(kind)
    shift = _origin(kind, extents, generator)
    turn = rotation_matrices(random_rotations(generator, 1))[0]
    return (vertices * extents - shift) @ turn.T, faces


def _unit_solid(kind: Kind) -> tuple[Floats, Integers]:
    """Return a base solid of unit extents, centered at the middle of its bounding box."""
    if kind == "box":
        vertices, faces, _ = unit_box()
    elif kind == "cylinder":
        vertices, faces, _ = revolved([(-0.5, 0.5), (0.5, 0.5)], sides=SIDES)
    elif kind == "cone":
        vertices, faces, _ = revolved([(-0.5, 0.5), (0.5, 0.0)], sides=SIDES)
    else:
        vertices, faces, _ = sphere(SUBDIVISIONS)
        vertices = vertices / 2
    return vertices, faces


def _origin(kind: Kind, extents: Floats, generator: np.random.Generator) -> Floats:
    """Return a random point of a base solid at a depth of at least CORE times its size."""
    while True:
        point = (generator.random(3) - 0.5) * extents
        if _depth(kind, point, extents) >= CORE * extents.max():
            return point


def _depth(kind: Kind, point: Floats, extents: Floats) -> float:
    """Return a lower bound of the depth of a point below the surface of a base solid."""
    half = extents / 2
    flat = float(np.hypot(point[0], point[1]))
    if kind == "box":
        return float((half - np.abs(point)).min())
    if kind == "cylinder":
        return float(min(half[0] - flat, half[2] - abs(point[2])))
    if kind == "cone":
        side = (half[0] * (half[2] - point[2]) - extents[2] * flat) / np.hypot(half[0], extents[2])
        return float(min(side, point[2] + half[2]))
    return float(half.min() * (1.0 - np.linalg.norm(point / half)))


registration = ShapeFamily(
    name="solid_union",
    summary="union of random boxes, cylinders, cones, ellipsoids and spheres",
    parameters=SolidUnion,
    make=make,
    source="Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element "
    "Analysis of Discontinuous Materials",
    random=True,
    libraries=("manifold3d",),
)
