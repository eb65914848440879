"""Container ``bowl``: what lies within a sphere and below a disk."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from voxgran._base.arrays import as_length, as_number, as_points
from voxgran.containers.model import Boundary, ContainerKind
from voxgran.geometry.walls import Round, planes_across
from voxgran.shapes.tessellate import revolved

#: rings of the mesh, from the lowest point to the rim
RINGS = 24


@dataclass(frozen=True)
class Bowl:
    """A bowl with its lowest point at z = 0, closed by a disk.

    Parameters
    ----------
    radius : float
        Radius of the sphere, in the unit of lengths.
    depth : float
        Height of the disk, at most the radius.
    """

    radius: float
    depth: float
    kind: ClassVar[str] = "bowl"
    dimension: ClassVar[int] = 3
    periodic: ClassVar[tuple[bool, bool, bool]] = (False, False, False)

    def __post_init__(self):
        as_length(self.radius, "radius of the bowl")
        as_number(self.depth, "depth of the bowl", above=0.0, at_most=self.radius)

    @property
    def volume(self):
        """Volume of the cap of a sphere."""
        return math.pi / 3 * self.depth**2 * (3 * self.radius - self.depth)

    @property
    def bounds(self):
        """Lower and upper corner, (2, 3)."""
        rim = math.sqrt(self.depth * (2 * self.radius - self.depth))
        return np.array([[-rim, -rim, 0.0], [rim, rim, self.depth]])

    @property
    def boundary(self):
        """The sphere and the disk."""
        return Boundary((planes_across(self.bounds, "z")[1], Round((0.0, 0.0, self.radius), self.radius, axes=3)))

    def signed_distance(self, points):
        """Return the distance of (n, 3) points from the nearest wall, negative inside."""
        return self.boundary.signed_distance(as_points(points))

    def mesh(self):
        """Return vertices and triangles of the walls, for pictures."""
        angles = np.linspace(0.0, math.acos(1 - self.depth / self.radius), RINGS)
        return revolved([(self.radius * (1 - math.cos(a)), self.radius * math.sin(a)) for a in angles])[:2]

    def scaled(self, factor):
        """Return the bowl with all lengths multiplied."""
        return Bowl(self.radius * factor, self.depth * factor)

    def to_mapping(self):
        """Return kind and parameters."""
        return {"kind": self.kind, "radius": self.radius, "depth": self.depth}


registration = ContainerKind(name="bowl", container=Bowl)
