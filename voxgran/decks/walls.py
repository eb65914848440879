"""Walls of a container as engines take them: planes, one round wall, or triangles."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.manifolds.convex_bodies import is_convex
from voxgran.containers.model import UNKNOWN, boundary_of


class Plane(NamedTuple):
    """A plane wall across an axis; `inward` is +1 where the grains lie on the side of larger coordinates, else -1."""

    name: str
    axis: int
    level: float
    inward: int

    @property
    def normal(self) -> Floats:
        """Unit normal (3,) that points to the grains."""
        return np.eye(3)[self.axis] * self.inward


class RoundWall(NamedTuple):
    """A cylinder along z or a sphere around the grains; the center of a cylinder is that of its base."""

    kind: Literal["cylinder", "sphere"]
    center: Floats
    radius: float


@dataclass(frozen=True, eq=False)
class Walls:
    """Walls of a container and a lid, in the unit of the assembly that they are of.

    Attributes
    ----------
    bounds : (2, 3) ndarray of float
        Lower and upper corner of the container.
    periodic : tuple of bool
        Whether each axis is periodic.
    planes : tuple of Plane
        Plane walls, a lid among them.
    round : RoundWall or None
        Cylinder or sphere.
    mesh : tuple of ndarray or None
        Vertices (v, 3) and triangles (f, 3) of a container that is neither, of a polygon those of the prism upon it;
        their normals point away from the grains.
    convex : bool
        Whether the triangles bound a convex solid.
    """

    bounds: Floats
    periodic: tuple[bool, bool, bool]
    planes: tuple[Plane, ...]
    round: RoundWall | None
    mesh: tuple[Floats, Integers] | None
    convex: bool

    @classmethod
    def of(cls, assembly: Assembly) -> "Walls":
        """Return the walls of the container of an assembly, and its lid."""
        container = assembly.container
        boundary, bounds = boundary_of(container), np.asarray(container.bounds, dtype=np.float64)
        planes = [
            Plane(f"{'xyz'[axis]}_{side}", axis, float(bounds[end, axis]), 1 - 2 * end)
            for axis in range(3)
            for end, side in enumerate(("low", "high"))
            if boundary.flat[axis]
        ]
        lid = assembly.lid
        if lid is not None:
            axis = int(np.abs(lid.normal).argmax())
            away = 1 if lid.normal[axis] > 0 else -1
            planes.append(Plane("lid", axis, float(lid.level * away), -away))
        kinds: dict[int, Literal["cylinder", "sphere"]] = {2: "cylinder", 3: "sphere"}
        kind = kinds.get(boundary.round_axes)
        wall = None if kind is None else RoundWall(kind, np.array(boundary.center, dtype=float), boundary.radius)
        solid = boundary.solid
        mesh = None if solid is None else (solid.vertices + np.array(solid.offset), solid.faces)
        mesh = container.mesh() if boundary is UNKNOWN else mesh
        convex = solid is not None and is_convex(solid.geometry)
        return cls(bounds, container.periodic, tuple(planes), wall, mesh, convex)

    def distances(self, points: Floats) -> list[Floats]:
        """Return the distances (n,) of points (n, 3) from each plane and from a round wall, positive within.

        Parameters
        ----------
        points : (n, 3) ndarray of float
            In the unit of the walls.
        """
        found = [(points[:, plane.axis] - plane.level) * plane.inward for plane in self.planes]
        if self.round is not None:
            flat = slice(0, 2) if self.round.kind == "cylinder" else slice(0, 3)
            found.append(self.round.radius - np.linalg.norm((points - self.round.center)[:, flat], axis=1))
        return found
