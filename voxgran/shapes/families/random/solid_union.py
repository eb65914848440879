"""Unions of random base solids: angular or rounded grains with edges, dents and re-entrant corners.

Each grain is the union of a few boxes, cylinders, cones, ellipsoids and spheres of random dimensions. Each base solid
lies on a work plane of random orientation through the origin, with a random shift limited so that the solid contains a
sphere around the origin, of a quarter of the radius of its inscribed sphere. Each ray from the origin therefore leaves
the union once: it is of one piece, without cavities, and no two solids merely touch.

Round base solids have flat facets, as much outside as inside, so that their volume is exact.

The flat facets are as few as an error allows, without a bias of the volume. Facets inscribed in a sphere or cylinder
take away from its volume. Here the circle of a cylinder or cone is replaced by the regular polygon of equal area, and
the sphere by the geodesic polyhedron of equal volume: the surfaces of solid and facets cross each other, and the volume
is exact. The error is the volume between both surfaces, on both sides, relative to the volume of the solid. For
polygons of n sides it is close to 2.53 / n**2, for geodesic polyhedra of frequency f (20 f**2 faces) close to 0.118 /
f**2: a fifth of what inscribed facets lack.

References
----------
Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element Analysis of
Discontinuous Materials: random shapes as unions of base solids on work planes of random orientation
"""

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeVar

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_count, as_number, as_positive
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.geometry.rotation import random_rotations
from voxgran.geometry.triangles import normals_of
from voxgran.shapes.boolean import united
from voxgran.shapes.family import ShapeFamily, Sized, sized
from voxgran.shapes.generating.star import is_star_shaped
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.repairing.diagnose import merged, refuse_dirty
from voxgran.shapes.tessellate import geodesic, revolved, unit_box

N = TypeVar("N", int, float)
Kind = Literal["box", "cylinder", "cone", "ellipsoid", "sphere"]

#: radius of the sphere around the origin that each base solid contains, in radii of its inscribed sphere
CORE = 0.25
#: largest number of base solids of a grain
MOST_SOLIDS = 1000
#: smallest ratio of two dimensions of a base solid
THINNEST = 0.02
#: largest error of the facets of a base solid, however small it is
COARSEST = 0.1
#: names of the dimensions that are drawn for each kind
DRAWN: dict[Kind, tuple[str, ...]] = {
    "box": ("length x", "length y", "length z"),
    "cylinder": ("diameter", "height"),
    "cone": ("diameter", "height"),
    "ellipsoid": ("axis x", "axis y", "axis z"),
    "sphere": ("diameter",),
}


@parameter_class
class SolidUnion(Sized):
    """Parameters of a union of base solids.

    Parameters
    ----------
    solids
        number of base solids, or a range to draw it from; from 1 to 1000.
    kinds
        kinds of base solids to draw from.
    counts
        numbers of base solids of each of `kinds`, or ranges to draw them from; in place of `solids`.
    lengths
        range of each dimension of a base solid, before scaling to diameter.
    box
        edges of boxes, each a number or a range; default: lengths.
    cylinder
        diameter and height of cylinders, each a number or a range; default: lengths.
    cone
        diameter and height of cones, each a number or a range; default: lengths.
    ellipsoid
        axes of ellipsoids from end to end, each a number or a range; default: lengths.
    sphere
        diameter of spheres, a number or a range; default: lengths.
    chord_error
        volume between round base solids and their flat facets, relative to their volume.

    Raises
    ------
    InputError
        If a number is out of range, or `counts` does not fit `kinds` or is given beside `solids`.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.shapes.solid_union(solids=3, kinds=("box",), seed=1)
    Shape('solid_union', mesh, diameter=1)
    """

    solids: int | tuple[int, int] = parameter((3, 6))
    kinds: tuple[Kind, ...] = parameter(("box", "cylinder", "cone", "ellipsoid", "sphere"))
    counts: tuple[int | tuple[int, int], ...] | None = parameter(None)
    lengths: tuple[float, float] = parameter((0.4, 1.0))
    box: tuple[float | tuple[float, float], float | tuple[float, float], float | tuple[float, float]] | None = (
        parameter(None)
    )
    cylinder: tuple[float | tuple[float, float], float | tuple[float, float]] | None = parameter(None)
    cone: tuple[float | tuple[float, float], float | tuple[float, float]] | None = parameter(None)
    ellipsoid: tuple[float | tuple[float, float], float | tuple[float, float], float | tuple[float, float]] | None = (
        parameter(None)
    )
    sphere: float | tuple[float, float] | None = parameter(None)
    chord_error: float = parameter(2e-3, at_least=1e-5, at_most=COARSEST)

    def __post_init__(self) -> None:
        """Check the ranges."""
        check_bounds(self)
        if not self.kinds:
            raise InputError("kinds is empty: at least one kind of base solid is needed; name one")
        low, high = _ends(self.solids)
        least = as_count(low, "solids", at_least=1, at_most=MOST_SOLIDS)
        as_count(high, "solids", at_least=least, at_most=MOST_SOLIDS)
        if self.counts is not None:
            self._check_counts(self.counts)
        for kind in self.kinds:
            self._check_ranges(kind)

    def ranges(self, kind: Kind) -> list[tuple[float, float]]:
        """Return the ranges of the dimensions that are drawn for a kind."""
        given = getattr(self, kind)
        if given is None:
            return [self.lengths] * len(DRAWN[kind])
        return [_ends(item) for item in ((given,) if kind == "sphere" else given)]

    def _check_counts(self, counts: tuple[int | tuple[int, int], ...]) -> None:
        """Check the numbers of solids of each kind."""
        if self.solids != type(self).__dataclass_fields__["solids"].default:
            raise InputError("counts and solids are both given: each is the number of base solids; leave one out")
        if len(counts) != len(self.kinds):
            raise InputError(
                f"counts has {len(counts)} entries and kinds has {len(self.kinds)}: give a number for each of "
                f"{', '.join(self.kinds)}"
            )
        ends = [_ends(item) for item in counts]
        for low, high in ends:
            as_count(high, "counts", at_least=as_count(low, "counts", at_most=MOST_SOLIDS), at_most=MOST_SOLIDS)
        if not sum(low for low, _ in ends):
            raise InputError("counts may all be 0: a union needs at least one base solid; raise one of them")
        as_count(sum(high for _, high in ends), "sum of counts", at_most=MOST_SOLIDS)

    def _check_ranges(self, kind: Kind) -> None:
        """Check the ranges of the dimensions of a kind."""
        name = "lengths" if getattr(self, kind) is None else kind
        ranges = self.ranges(kind)
        for least, most in ranges:
            as_number(least, name, above=0.0, at_most=as_positive(most, name))
        least, most = min(low for low, _ in ranges), max(high for _, high in ranges)
        if len(ranges) > 1 and least < THINNEST * most:
            raise InputError(
                f"{name} gives dimensions from {least} to {most}: the smallest must be at least {THINNEST} of the "
                "largest; move them together"
            )


@dataclass(frozen=True)
class BaseSolid:
    """A base solid of a union, and the (3,) position of its centroid; it contains the origin."""

    solid: Primitive
    position: Floats


def make(parameters: SolidUnion, generator: np.random.Generator) -> Shape:
    """Return a random union."""
    solids = base_solids(parameters, generator)
    vertices, faces = union_of(solids, parameters.chord_error)
    record = {"kinds": tuple(base.solid.kind for base in solids)}
    # the work planes have no place: a container of this shape lies about its centroid
    return replace(
        sized(Mesh(vertices, faces), parameters.diameter, name="solid_union", record=record), offset=(0.0, 0.0, 0.0)
    )


def union_of(solids: list[BaseSolid], error: float) -> tuple[Floats, Integers]:
    """Return vertices and faces of the union, whose surface is about as near to the true one everywhere."""
    largest = max(base.solid.volume for base in solids)
    meshes = []
    for base in solids:
        own = error * math.cbrt(largest / base.solid.volume)
        vertices, faces = faceted(base.solid, min(own, COARSEST))
        meshes.append((vertices + base.position, faces))
    vertices, faces = merged(*united(meshes))
    if not is_star_shaped(vertices, faces, np.zeros(3)):
        refuse_dirty(vertices, faces, "solid_union")
    return vertices, faces


def base_solids(parameters: SolidUnion, generator: np.random.Generator) -> list[BaseSolid]:
    """Draw the base solids of a union."""
    kinds: list[Kind]
    if parameters.counts is None:
        number = int(generator.integers(*_ends(parameters.solids), endpoint=True))
        kinds = [parameters.kinds[k] for k in generator.integers(len(parameters.kinds), size=number)]
    else:
        numbers = [int(generator.integers(*_ends(item), endpoint=True)) for item in parameters.counts]
        kinds = [kind for kind, number in zip(parameters.kinds, numbers, strict=True) for _ in range(number)]
    return [_base_solid(kind, parameters.ranges(kind), generator) for kind in kinds]


def _base_solid(kind: Kind, ranges: list[tuple[float, float]], generator: np.random.Generator) -> BaseSolid:
    """Draw dimensions, orientation and position of one base solid."""
    lengths = [float(low + (high - low) * generator.random()) for low, high in ranges]
    halves = tuple(length / 2 for length in lengths)
    dimensions = {
        "box": tuple(lengths),
        "cylinder": (halves[0], lengths[-1]),
        "cone": (halves[0], lengths[-1]),
        "ellipsoid": halves,
        "sphere": halves,
    }[kind]
    w, x, y, z = (float(value) for value in random_rotations(generator, 1)[0])
    solid = Primitive(kind, dimensions, (w, x, y, z))
    # by convexity the point is at least as deep as the core
    point = CORE * _deepest(solid) + (1.0 - CORE) * _inside(solid, generator)
    return BaseSolid(solid, -linear.matmul(solid.matrix, point))


def _deepest(solid: Primitive) -> Floats:
    """Return the center of an inscribed sphere, in the frame of the solid before rotation."""
    if solid.kind != "cone":
        return np.zeros(3)
    radius, height = solid.dimensions
    return np.array([0.0, 0.0, radius * height / (radius + math.hypot(radius, height)) - height / 4])


def _inside(solid: Primitive, generator: np.random.Generator) -> Floats:
    """Return a random point of a solid, uniform in its volume, in its frame before rotation."""
    d = solid.dimensions
    u, v, w = (float(value) for value in generator.random(3))
    if solid.kind == "box":
        return (np.array([u, v, w]) - 0.5) * d
    turn = 2 * math.pi * w
    if solid.kind in ("sphere", "ellipsoid"):
        z, far = 2 * u - 1, math.cbrt(v)
        flat = math.sqrt(1 - z * z)
        return far * np.array([flat * math.cos(turn), flat * math.sin(turn), z]) * d
    flat, z = d[0] * math.sqrt(u), (v - 0.5) * d[1]
    if solid.kind == "cone":
        below = math.cbrt(v)
        flat, z = flat * below, (0.75 - below) * d[1]
    return np.array([flat * math.cos(turn), flat * math.sin(turn), z])


def _ends(value: N | tuple[N, N]) -> tuple[N, N]:
    """Return the ends of a range; those of a number are equal to it."""
    return value if isinstance(value, tuple) else (value, value)


registration = ShapeFamily(
    summary="union of random boxes, cylinders, cones, ellipsoids and spheres",
    parameters=SolidUnion,
    make=make,
    source="Sajjadi & Khalili 2015, Generating, Reproducing and Packaging of Random Volumes for Discrete Element "
    "Analysis of Discontinuous Materials",
    random=True,
    libraries=("manifold3d",),
)


#: largest product of the error of a geodesic polyhedron and the square of its frequency
POLYHEDRON = 0.122


def sides_for(error: float) -> int:
    """Return the number of sides of a polygon that differs from the circle of equal area by at most an error."""
    return max(3, math.ceil(math.sqrt(2.5326 / error + 2.15)))


def frequency_for(error: float) -> int:
    """Return the frequency of a geodesic polyhedron that differs by at most an error from the sphere of its volume."""
    return math.ceil(math.sqrt(POLYHEDRON / error))


def faceted(solid: Primitive, error: float) -> tuple[Floats, Integers]:
    """Return vertices and faces of a solid with facets of exactly its volume.

    `error` is the volume between the facets and the curved surface, relative to the volume of the solid.
    """
    d = solid.dimensions
    if solid.kind == "box":
        vertices, faces, _ = unit_box()
        vertices = vertices * np.array(d)
    elif solid.kind in ("sphere", "ellipsoid"):
        vertices, faces = geodesic(frequency_for(error))
        sixth = linear.einsum("fi,fi->", normals_of(vertices[faces]), vertices[faces[:, 0]]) / 6
        vertices = vertices * math.cbrt(4 / 3 * math.pi / sixth) * np.array(d * 3 if solid.kind == "sphere" else d)
    else:
        sides = sides_for(error)
        wider = math.sqrt(2 * math.pi / (sides * math.sin(2 * math.pi / sides)))
        vertices, faces, _ = revolved([(z, wider * radius) for z, radius in solid.profile(sides)], sides=sides)
    return linear.matmul(vertices, solid.matrix.T), faces
