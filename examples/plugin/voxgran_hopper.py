"""Container ``hopper``: a cone above an outlet that a disk closes."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from voxgran._base.arrays import as_length, as_number, as_points
from voxgran.containers.make import ContainerKind
from voxgran.containers.model import Boundary
from voxgran.geometry.walls import cone, planes_across
from voxgran.shapes.tessellate import revolved


@dataclass(frozen=True)
class Hopper:
    """A conical hopper with its closed outlet at z = 0.

    Parameters
    ----------
    radius : float
        Radius at the top, in the unit of lengths.
    outlet : float
        Radius of the outlet, below that at the top.
    angle : float
        Angle between the wall and the horizontal, in degrees.
    """

    radius: float
    outlet: float
    angle: float = 60.0
    kind: ClassVar[str] = "hopper"
    dimension: ClassVar[int] = 3
    periodic: ClassVar[tuple[bool, bool, bool]] = (False, False, False)

    def __post_init__(self):
        as_length(self.outlet, "outlet of the hopper")
        as_number(self.radius, "radius of the hopper", above=self.outlet)
        as_number(self.angle, "angle of the hopper", above=0.0, at_most=89.0)

    @property
    def height(self):
        """Height of the top above the outlet."""
        return (self.radius - self.outlet) * math.tan(math.radians(self.angle))

    @property
    def volume(self):
        """Volume of the frustum of a cone."""
        return math.pi / 3 * self.height * (self.radius**2 + self.radius * self.outlet + self.outlet**2)

    @property
    def bounds(self):
        """Lower and upper corner, (2, 3)."""
        return np.array([[-self.radius, -self.radius, 0.0], [self.radius, self.radius, self.height]])

    @property
    def boundary(self):
        """The cone, the disk that closes the outlet and the one at the top."""
        wall = cone((0.0, 0.0, 0.0), self.outlet, math.radians(self.angle))
        return Boundary((*planes_across(self.bounds, "z"), wall))

    def signed_distance(self, points):
        """Return the distance of (n, 3) points from the nearest wall, negative inside."""
        return self.boundary.signed_distance(as_points(points))

    def mesh(self):
        """Return vertices and triangles of the walls, for pictures and for engines without cones."""
        return revolved([(0.0, self.outlet), (self.height, self.radius)])[:2]

    def scaled(self, factor):
        """Return the hopper with all lengths multiplied."""
        return Hopper(self.radius * factor, self.outlet * factor, self.angle)

    def to_mapping(self):
        """Return kind and parameters."""
        return {"kind": self.kind, "radius": self.radius, "outlet": self.outlet, "angle": self.angle}


registration = ContainerKind(name="hopper", container=Hopper)
