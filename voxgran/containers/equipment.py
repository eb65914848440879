"""What containers share: all those that are known by their parameters, and those of several walls.

The space within the walls is a solid of revolution about one axis, or lies within planes, cylinders, cones and spheres.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import pairwise
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, as_length, as_place, as_points, as_positive
from voxgran._base.calls import explained_methods
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.containers.model import Boundary, Surface
from voxgran.geometry.walls import Round, cone, planes_across
from voxgran.shapes.mesh import Mesh, hull_of
from voxgran.shapes.model import Shape
from voxgran.shapes.tessellate import revolved, sphere

#: widths of an outlet, in diameters of spheres, below which arches form over it (Zuriguel et al. 2005,
#: doi:10.1103/PhysRevE.71.051303: 4.94)
ARCHING = 5.0

#: largest ratio of the lengths of a container: beyond, walls are lost in the rounding of the others
MOST_RATIO = 1e9


class Space(NamedTuple):
    """What lies within walls: its boundary, bounds (2, 3), volume and its relative error, and a mesh for pictures."""

    boundary: Boundary
    bounds: Floats
    volume: float
    error: float
    vertices: Floats
    faces: Integers


@explained_methods
class Parametric(ExplainedAttributes):
    """A container known by its parameters: a frozen dataclass whose fields are the keys of its mapping.

    A kind gives its fields, of which those that are None are left out, and their lengths.
    """

    kind: ClassVar[str]
    _lengths: ClassVar[tuple[str, ...]]  # fields that are lengths or places
    dimension: ClassVar[int] = 3
    periodic: ClassVar[tuple[bool, bool, bool]] = (False, False, False)

    def _check_lengths(self, **given: Any) -> None:
        """Check the lengths in the fields, or the lengths that are given instead, and store them as numbers."""
        spare = {field.name for field in fields(self) if field.default is None}  # type: ignore[arg-type]
        for name in self._lengths:
            value = given[name] if given else getattr(self, name)
            if name == "origin":
                self._set(name, tuple(as_place(value, "origin", length=self.dimension).tolist()))
            elif value is not None or name not in spare:
                self._set(name, as_length(value, f"{name} of the {self.kind}"))
        lengths = {name: getattr(self, name) for name in self._lengths if name != "origin"}
        known = sorted((length, name) for name, length in lengths.items() if length is not None)
        if known and known[-1][0] > MOST_RATIO * known[0][0]:
            raise InputError(
                f"{known[-1][1]} of the {self.kind} is {known[-1][0]:g}: it must be at most {MOST_RATIO:g} times its "
                f"{known[0][1]}, {known[0][0]:g}; correct one of them"
            )

    def _set(self, name: str, value: Any) -> None:
        """Set a field."""
        object.__setattr__(self, name, value)

    def scaled(self, factor: float) -> Self:
        """Return the container with all lengths multiplied.

        Raises
        ------
        InputError
            If the factor is not above 0, or a length is not between 1e-60 and 1e60 any longer.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Funnel(radius=2, outlet=1, height=2).scaled(2.0).radius
        4.0
        """
        times = as_positive(factor, "factor")
        return replace(self, **{name: multiplied(getattr(self, name), times) for name in self._lengths})  # type: ignore[type-var]

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Funnel(radius=2, outlet=1, height=2).to_mapping()
        {'kind': 'funnel', 'radius': 2.0, 'outlet': 1.0, 'height': 2.0, 'origin': [0.0, 0.0, 0.0]}
        """
        found = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        return {"kind": self.kind} | {name: _plain(value) for name, value in found.items() if value is not None}


@explained_methods
class Equipment(Parametric, ABC):
    """A container of several walls, which gives the space within them."""

    @property
    @abstractmethod
    def space(self) -> Space:
        """The space within the walls."""

    def doubt(self, diameter: float) -> str:
        """Return what speaks against packing grains of a median diameter, as a sentence; ``""`` if nothing does.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Hopper(radius=5, outlet=1.5).doubt(1.0)[:64]
        'outlet of the hopper is 3 wide, 3 median diameters of the grains'
        """
        if not (outlet := getattr(self, "outlet", None)) or 2 * outlet >= ARCHING * diameter:
            return ""
        effect = "is smaller than a grain and will arch" if 2 * outlet < diameter else "will arch"
        return (
            f"outlet of the {self.kind} is {2 * outlet:.6g} wide, {2 * outlet / diameter:.3g} median diameters of the "
            f"grains: it {effect} once it is opened, as outlets narrower than about {ARCHING:g} diameters do; give a "
            f"radius of {ARCHING * diameter / 2:.3g} or more, or leave it closed"
        )

    @property
    def volume(self) -> float:
        """Volume."""
        return self.space.volume

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3)."""
        return self.space.bounds.copy()

    @property
    def boundary(self) -> Boundary:
        """The walls in closed form."""
        return self.space.boundary

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest wall, negative inside.

        Outside, near edges, it is a lower bound of the distance where a wall is round.

        Raises
        ------
        InputError
            If the points are not an (n, 3) array of finite numbers.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Funnel(radius=2, outlet=1, height=2).signed_distance([(0, 0, 0.5), (0, 0, 3)]).tolist()
        [-0.5, 1.0]
        """
        p, solid = as_points(points), self.boundary.solid
        if solid is None:
            return self.boundary.signed_distance(p)
        assert isinstance(solid.geometry, Mesh)
        return solid.geometry.tree.signed_distance(p - np.array(solid.offset))

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the boundary.

        Examples
        --------
        >>> import voxgran as vg
        >>> vertices, faces = vg.Funnel(radius=2, outlet=1, height=2).mesh()
        >>> float(vertices[:, 0].max())
        2.0
        """
        return self.space.vertices.copy(), self.space.faces.copy()


def multiplied(value: Any, factor: float) -> Any:
    """Return a length, a place or several of them multiplied; None as it is."""
    with np.errstate(over="ignore"):
        return None if value is None else (np.array(value) * factor).tolist()


def _plain(value: Any) -> Any:
    """Return a value with lists in place of tuples."""
    return [_plain(one) for one in value] if isinstance(value, tuple) else value


#: tangent planes of a cylinder or cone, subdivisions of a sphere
SIDES, SUBDIVISIONS = 96, 3
#: corners nearer to each other, in lengths of the space, are one; the shift keeps round numbers away from the rounding
ONE_CORNER, SHIFT = 1e-9, 0.3183
#: lines in each of two directions by which a volume is found, several times
LINES = (320, 288, 256)
#: halvings of the way from the middle to the walls
HALVINGS = 60


def revolved_space(profile: Sequence[tuple[float, float]], origin: Sequence[float], axis: int = 2) -> Space:
    """Return what lies within a convex profile of heights and radii, from below, about an axis through a point."""
    away = np.eye(3)[axis]
    way = _place(away)
    walls, volume = [], 0.0
    for (z, r), (above, wide) in pairwise(profile):
        center = _place(np.array(origin) + z * away)
        wall = Round(center, r) if r == wide else cone(center, r, math.atan2(above - z, wide - r))
        walls.append(wall._replace(axis=way))
        volume += math.pi / 3 * (above - z) * (r * r + r * wide + wide * wide)
    vertices, faces, _ = revolved(profile)
    vertices = linear.matmul(vertices, walls[0].frame) + np.array(origin)
    reach = max(r for _, r in profile) * (1.0 - away)
    bounds = np.array(origin) + np.array([profile[0][0] * away - reach, profile[-1][0] * away + reach])
    return Space(Boundary((*planes_across(bounds, "xyz"[axis]), *walls)), bounds, volume, 0.0, vertices, faces)


def space_within(walls: Sequence[Round], where: str) -> Space:
    """Return what lies within all walls.

    What planes alone bound is a polyhedron, whose volume is exact; else the volume is the sum of the lengths of lines,
    and its error twice the largest difference of sums over lines of different distances.

    Raises
    ------
    InputError
        If nothing lies within all walls, or what does is not bounded.
    """
    # a power of two as the unit: containers that are scaled by one have the same bits
    numbers = [*(abs(x) for wall in walls for x in wall.center), *(wall.radius for wall in walls)]
    unit = 2.0 ** math.floor(math.log2(max(numbers, default=1.0) or 1.0))
    scaled = [w._replace(center=_place(np.array(w.center) / unit), radius=w.radius / unit) for w in walls]
    vertices, faces, middle = tangent_mesh(scaled, where)
    bounds = np.array([vertices.min(axis=0), vertices.max(axis=0)])
    if all(wall.kind == "plane" for wall in walls):
        shape = Shape.from_mesh(vertices * unit, faces, name="container")
        made = shape.vertices + np.array(shape.offset)
        return Space(Boundary((Surface(shape),)), bounds * unit, shape.volume, 0.0, made, shape.faces)
    boundary = Boundary(tuple(scaled))
    volumes = [_volume(boundary, bounds, count) for count in LINES]
    # corners of the tangent planes, moved to the walls
    low, high = np.zeros(len(vertices)), np.ones(len(vertices))
    for _ in range(HALVINGS):
        half = (low + high) / 2
        inside = boundary.signed_distance(middle + half[:, None] * (vertices - middle)) < 0
        low, high = np.where(inside, half, low), np.where(inside, high, half)
    hull = hull_of(_distinct(middle + low[:, None] * (vertices - middle)))
    volume, error = volumes[0] * unit**3, 2 * float(np.ptp(volumes)) / volumes[0]
    return Space(Boundary(tuple(walls)), bounds * unit, volume, error, hull.vertices * unit, hull.faces)


def tangent_mesh(walls: Sequence[Round], where: str, sides: int = SIDES) -> tuple[Floats, Integers, Floats]:
    """Return vertices and triangles of the polyhedron of planes that touch walls from outside, and a point within.

    Raises
    ------
    InputError
        If nothing lies within all walls, or what does is not bounded.
    """
    tangents = [_tangents(wall, sides) for wall in walls]
    normals, levels = (np.concatenate(rows) for rows in zip(*tangents, strict=True))
    optimize, spatial = load("scipy.optimize"), load("scipy.spatial")
    free = [(None, None)] * 3
    room = np.ones((len(normals), 1))
    found = optimize.linprog([0, 0, 0, -1], A_ub=np.hstack([normals, room]), b_ub=levels, bounds=[*free, (None, 1.0)])
    if not found.success or found.x[3] <= ONE_CORNER:
        raise InputError(f"{where}: nothing lies within all of its {len(walls)} walls; turn or move them")
    middle = np.asarray(found.x[:3])
    for axis in range(3):
        for sign, side in ((1.0, "high"), (-1.0, "low")):
            cost = -sign * np.eye(3)[axis]
            if not optimize.linprog(cost, A_ub=normals, b_ub=levels, bounds=free).success:
                raise InputError(
                    f"{where}: what lies within its {len(walls)} walls has no end at the {side} end of "
                    f"{'xyz'[axis]}; add a wall there"
                )
    cut = spatial.HalfspaceIntersection(np.column_stack([normals, -levels]), middle)
    mesh = hull_of(_distinct(cut.intersections))
    return mesh.vertices, mesh.faces, middle


def _place(vector: Floats) -> tuple[float, float, float]:
    """Return a vector as a tuple."""
    x, y, z = vector.tolist()
    return x, y, z


def _tangents(wall: Round, sides: int) -> tuple[Floats, Floats]:
    """Return normals (k, 3) and levels (k,) of planes that touch a wall from outside."""
    if wall.kind == "sphere":
        normals = np.concatenate([sphere(SUBDIVISIONS)[0], np.eye(3), -np.eye(3)])
    elif wall.kind == "plane":
        normals = np.array([wall.axis])
    else:
        angle = 2 * math.pi * np.arange(sides) / sides
        around = np.stack([libm.cos(angle), libm.sin(angle)], axis=1) * wall.cosine
        normals = linear.matmul(np.column_stack([around, np.full(sides, wall.sine)]), wall.frame)
    return normals, linear.matmul(normals, np.array(wall.center)) + wall.radius


def _distinct(points: Floats) -> Floats:
    """Return the points (n, 3) that are corners of their convex hull, each once."""
    _, first = np.unique(np.round(points / ONE_CORNER + SHIFT), axis=0, return_index=True)
    points = points[np.sort(first)]
    return np.asarray(points[np.sort(load("scipy.spatial").ConvexHull(points).vertices)])


def _volume(boundary: Boundary, bounds: Floats, count: int) -> float:
    """Return the volume within walls of revolution by so many lines along z in each of two directions."""
    low, step = bounds[0], (bounds[1] - bounds[0]) / count
    x, y = (low[k] + (np.arange(count) + 0.5) * step[k] for k in range(2))
    points = np.stack([*np.meshgrid(x, y, indexing="ij"), np.full((count, count), low[2])], axis=-1).reshape(-1, 3)
    start, end = boundary.along(points, (0, 1, 2))
    return float(np.nansum(end - start) * step[0] * step[1])
