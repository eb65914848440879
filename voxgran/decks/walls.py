"""Walls of a container as engines take them: planes, one round wall, or triangles."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.manifolds.convex_bodies import is_convex
from voxgran.containers.equipment import tangent_mesh
from voxgran.containers.model import boundary_of, periods_of
from voxgran.geometry.periods import turns_of
from voxgran.geometry.walls import Plane, Round, plane
from voxgran.settling.materials import wall_names

#: most planes by which a convex container is written
MOST_PLANES = 200
#: most that the triangles of a cylinder or cone lie outside of it, in median diameters; least and most of its sides
ROUND_ERROR, FEWEST_SIDES, MOST_SIDES = 1e-3, 24, 1000


class Platen(NamedTuple):
    """A plane wall that moves along its normal so that the grains press on it with a force.

    It moves inward with the `speed` times what the force lacks of the one asked for, over that: as a damper with the
    acoustic impedance of the grains, which takes up waves. The wall that is opposite stands still.
    """

    plane: Plane
    force: float  # N
    speed: float  # m/s, where nothing presses on it


@dataclass(frozen=True, eq=False)
class Walls:
    """Walls of a container and a lid, in the unit of the assembly that they are of.

    Attributes
    ----------
    bounds : (2, 3) ndarray of float
        Lower and upper corner of the container.
    periodic : tuple of bool
        Whether each axis is periodic.
    periods : (3, 3) ndarray of float
        Vectors by which the container repeats, 0 for axes that are not periodic.
    planes : tuple of Plane
        Plane walls, a lid among them.
    round : Round or None
        Cylinder or sphere; the center of a cylinder is that of its base.
    mesh : tuple of ndarray or None
        Vertices (v, 3) and triangles (f, 3) of a container with other walls, with normals that point away from the
        grains. A polygon has the triangles of the prism upon it.
    convex : bool
        Whether the triangles bound a convex solid.
    others : mapping
        All walls of the container in closed form by their names, where they are neither planes across an axis nor one
        upright cylinder or sphere alone; the triangles touch them from outside.
    """

    bounds: Floats
    periodic: tuple[bool, bool, bool]
    periods: Floats
    planes: tuple[Plane, ...]
    round: Round | None
    mesh: tuple[Floats, Integers] | None
    convex: bool
    others: Mapping[str, Round] = field(default_factory=dict)

    @classmethod
    def of(cls, assembly: Assembly) -> "Walls":
        """Return the walls of the container of an assembly, and its lid."""
        container = assembly.container
        boundary, bounds = boundary_of(container), np.asarray(container.bounds, dtype=np.float64)
        planes = [*boundary.planes] if boundary.is_usual else []
        lid = assembly.lid
        if lid is not None:
            axis = int(np.abs(lid.normal).argmax())
            away = 1 if lid.normal[axis] > 0 else -1
            planes.append(Plane("lid", axis, float(lid.level * away), -away))
        solid = boundary.solid
        mesh = None if solid is None else (solid.vertices + np.array(solid.offset), solid.faces)
        mesh = mesh if boundary.is_usual else container.mesh()
        # what lies within planes and walls of revolution is convex
        convex = bool(boundary.round) if solid is None else is_convex(solid.geometry)
        wall = boundary.cylinder or boundary.sphere
        others: dict[str, Round] = {}
        if boundary.round and not boundary.is_usual:
            across = (plane(tuple((one.level * np.abs(one.normal)).tolist()), tuple((-one.normal).tolist()))
                      for one in boundary.planes)  # fmt: skip
            others = dict(zip(wall_names(boundary), (*across, *boundary.round), strict=True))
            width = float((bounds[1] - bounds[0]).max()) / 2
            sides = sides_of(width, float(np.median(assembly.diameters)))
            mesh = tangent_mesh(list(others.values()), "container", sides)[:2]
        return cls(bounds, container.periodic, periods_of(container), tuple(planes), wall, mesh, convex, others)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the walls."""
        planes = tuple(plane.name for plane in self.planes)
        return planes + ("round",) * (self.round is not None) + tuple(self.surfaces)

    @cached_property
    def surfaces(self) -> dict[str, tuple[Floats, Integers]]:
        """Vertices and triangles of each wall that is made of triangles, by its name: ``"mesh"``, or those of `others`,
        of which each triangle lies on the nearest one.
        """
        if self.mesh is None or not self.others:
            return {} if self.mesh is None else {"mesh": self.mesh}
        vertices, faces = self.mesh
        middles = vertices[faces].mean(axis=1)
        nearest = np.abs([wall.distance(middles) for wall in self.others.values()]).argmin(axis=0)
        return {name: (vertices, faces[nearest == k]) for k, name in enumerate(self.others) if (nearest == k).any()}

    @property
    def needs_triangles(self) -> bool:
        """Whether a wall is neither a plane nor a cylinder."""
        return self.mesh is not None or (self.round is not None and self.round.kind == "sphere")

    @cached_property
    def slopes(self) -> Floats:
        """A point and the unit normal toward the grains (k, 2, 3) of each plane of a wedge, or another container of
        oblique planes; none of other walls, and of more planes than :data:`MOST_PLANES`.
        """
        if self.mesh is None or not self.convex or self.others:
            return np.zeros((0, 2, 3))
        found = planes_of(*self.mesh)
        return found if len(found) <= MOST_PLANES else found[:0]

    def wrapped(self, points: Floats) -> tuple[Floats, Integers]:
        """Return points (n, 3) within the periodic bounds, and how many periods they were moved by."""
        image = turns_of(points, self.bounds[0], self.periods)
        return points - linear.matmul(image, self.periods), image

    def distances(self, points: Floats, corners: "Floats | None" = None) -> list[Floats]:
        """Return the distances (n,) of points (n, 3) from each plane and other wall in closed form, positive within.

        Parameters
        ----------
        points : (n, 3) ndarray of float
            In the unit of the walls.
        corners : (2, 3) ndarray of float, optional
            Where the corners of the container are after planes have moved; default: where they were.
        """
        way = np.zeros((2, 3)) if corners is None else corners - self.bounds
        planes = [one._replace(level=one.level + float(way[int(one.inward < 0), one.axis])) for one in self.planes]
        walls = (*planes, *(() if self.round is None else (self.round,)), *self.others.values())
        return [wall.distance(points) for wall in walls]


def planes_of(vertices: Floats, faces: Integers) -> Floats:
    """Return a point and the unit normal into a convex mesh (k, 2, 3) of each plane that its triangles lie in."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= linear.norm(normal, axis=1, keepdims=True)
    _, first = np.unique(np.round(normal, 6), axis=0, return_index=True)
    return np.stack([corners[first, 0], -normal[first]], axis=1)


def sides_of(radius: float, diameter: float) -> int:
    """Return how many sides a polygon around a circle has, by the median diameter of the grains."""
    # 0 of a circle that is far wider than the grains
    angle = math.acos(1 / (1 + ROUND_ERROR * diameter / radius))
    return MOST_SIDES if angle * MOST_SIDES < math.pi else max(math.ceil(math.pi / angle), FEWEST_SIDES)
