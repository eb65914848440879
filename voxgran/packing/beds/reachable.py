"""Room that grains can reach around fixed ones: without the pores that are too narrow for a grain, between these or
between them and walls.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.contacts.inside import Occupied
from voxgran.packing.beds.filling import ROUNDING, with_middles
from voxgran.packing.problem import Problem, random_points

#: radius of the sphere that finds room wherever grains do, in diameters of the smallest one
NARROWEST = 0.5
#: mean distance of the points by which the room is known, in that radius, their largest number, and how far the next of
#: them is at the most, in their mean distances
SPACING, MOST_POINTS, NEXT = 0.6, 2_000_000, 0.5


def reachable(problem: Problem) -> Problem:
    """Return a task without its fixed grains, in the room that they leave for grains of the smallest size."""
    free = problem.apart
    if not isinstance(free.container, Occupied) or not free.count:
        return free
    return replace(free, container=Reachable(free.container, NARROWEST * float(free.diameter.min())))


@dataclass(frozen=True, eq=False)
class Reachable:
    """What spheres of a radius cover where they find room: the morphological opening of a container with solids.

    Near solids it is known by random points; all else is that of the container.
    """

    container: Occupied
    radius: float

    def __getattr__(self, name: str) -> Any:
        return getattr(self.container, name)

    @cached_property
    def _points(self) -> Floats:
        """Random points between the solids."""
        many = self.container.volume / self._spacing**self.container.dimension
        return random_points(self.container, math.ceil(many), stream(0, "reachable"))

    @cached_property
    def _spacing(self) -> float:
        """Mean distance of the points."""
        return max(SPACING * self.radius, (self.container.volume / MOST_POINTS) ** (1.0 / self.container.dimension))

    @cached_property
    def _centers(self) -> Any:
        """Tree of the points at which spheres find room; None without any."""
        # a slit hardly wider than a grain has its middle between them
        points = with_middles(self._points, self.container)
        clear = points[np.asarray(self.container.signed_distance(points)) <= ROUNDING - self.radius]
        return load("scipy.spatial").cKDTree(clear) if len(clear) else None

    @cached_property
    def volume(self) -> float:
        """Volume, estimated from points."""
        return self.container.volume * float((self.signed_distance(self._points) <= 0.0).mean())

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest wall or solid, negative where grains can be."""
        places = np.asarray(points, dtype=np.float64)
        depth = self.container.depth(places)
        found = np.maximum(self.container.container.signed_distance(places), depth)
        # a solid and a wall, too, may leave a pore between them that is too narrow
        near = np.flatnonzero((found < 0.0) & (found > -self.radius) & (depth > -2.0 * self.radius))
        if self._centers is None or not len(near):
            found[near] = np.abs(found[near])
            return found
        away = self._centers.query(places[near])[0]
        # each of these spheres is in the room, so that seeds in the mouth of a pore, which would grow into it, are not
        inside = self.radius + NEXT * self._spacing - away
        found[near] = np.where(inside >= 0.0, np.maximum(found[near], -inside), np.abs(found[near]))
        return found
