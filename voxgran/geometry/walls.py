"""Walls in closed form: planes across an axis, and walls of revolution: cylinders, cones and spheres.

The reach of a point at a wall of revolution is its distance from the axis or, of a sphere, from the center. At a cone
it is the sine of the angle between the wall and the horizontal times that distance, less the cosine times the height
above the center. Its gradient is the unit normal; the distance from the wall is the reach less the radius of the wall.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel


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

    def distance(self, points: Floats) -> Floats:
        """Return the distance (n,) of points (n, 3) from the wall, positive on the side of the grains."""
        return np.asarray((points[:, self.axis] - self.level) * self.inward)


def planes_across(bounds: Floats, axes: str) -> tuple[Plane, ...]:
    """Return the two walls at the bounds (2, 3) across each axis of ``"xyz"`` that is named."""
    return tuple(
        Plane(f"{name}_{side}", axis, float(bounds[end, axis]), 1 - 2 * end)
        for axis, name in enumerate("xyz")
        if name in axes
        for end, side in enumerate(("low", "high"))
    )


class Round(NamedTuple):
    """A wall of revolution around the grains: a cylinder or a cone along z, or a sphere."""

    center: tuple[float, float, float]  # of a cylinder or a cone, a point of its axis
    radius: float  # reach of the points of the wall
    axes: int = 2  # around which it closes: 3 for a sphere
    cosine: float = 1.0  # of the outward normal with the horizontal
    sine: float = 0.0  # 0 but for a cone

    @property
    def kind(self) -> str:
        """``"cylinder"``, ``"cone"`` or ``"sphere"``."""
        return "sphere" if self.axes == 3 else "cone" if self.sine else "cylinder"

    @property
    def row(self) -> Floats:
        """The wall for kernels, (7,): center, 1 for a sphere and else 0, cosine, sine, radius."""
        return np.array([*self.center, self.axes - 2, self.cosine, self.sine, self.radius], dtype=np.float64)

    def distance(self, points: Floats) -> Floats:
        """Return the distance (n,) of points (n, 3) from the wall, positive on the side of the grains."""
        return self.radius - self.reach(points - np.array(self.center))

    def reach(self, away: Floats) -> Floats:
        """Return the reach (n,) of points by their places (n, 3) relative to the center."""
        return np.asarray(self.cosine * np.linalg.norm(away[:, : self.axes], axis=1) + self.sine * away[:, 2])

    def along(self, points: Floats, axes: tuple[int, int, int]) -> tuple[Floats, Floats]:
        """Return between which distances from points (n, 3), along the last one of the axes, lines are inside.

        They are NaN for lines that miss.
        """
        away, axis = points - np.array(self.center), axes[2]
        if self.sine and axis == 2:
            end = (self.radius - self.cosine * np.hypot(away[:, 0], away[:, 1])) / self.sine - away[:, 2]
            open_end = np.full(len(end), -np.inf if self.sine > 0 else np.inf)
            return np.minimum(end, open_end), np.maximum(end, open_end)
        width = np.maximum((self.radius - self.sine * away[:, 2]) / self.cosine, 0.0) if self.sine else self.radius
        rest = np.full(len(away), width) ** 2
        for other in axes[:2]:
            if other < self.axes:
                rest -= away[:, other] ** 2
        half = np.sqrt(np.where(rest > 0, rest, np.nan))
        half = half if axis < self.axes else np.where(rest > 0, np.inf, np.nan)
        return -away[:, axis] - half, -away[:, axis] + half


def cone(center: tuple[float, float, float], radius: float, angle: float) -> Round:
    """Return a cone that has a radius at the height of its center and widens upward at an angle from the horizontal.

    The angle is in radians, above 0 and below pi; above pi / 2 the cone narrows upward.
    """
    return Round(center, radius * math.sin(angle), 2, math.sin(angle), -math.cos(angle))


@bare_kernel
def reach_of(row: Floats, x: float, y: float, z: float) -> float:
    """Return the reach of a point at a wall of revolution, given by its row."""
    return reach_from(row, x - row[0], y - row[1], z - row[2])


@bare_kernel
def reach_from(row: Floats, dx: float, dy: float, dz: float) -> float:
    """Return the reach of a point by its place relative to the center."""
    flat = dz * row[3]
    return row[4] * math.sqrt(dx * dx + dy * dy + flat * flat) + row[5] * dz


@bare_kernel
def least_reach(row: Floats, x: float, y: float, z: float, ex: float, ey: float, ez: float) -> float:
    """Return a lower bound of the reach of the points of a box with its middle at (x, y, z) and half extents."""
    dx, dy = max(abs(x - row[0]) - ex, 0.0), max(abs(y - row[1]) - ey, 0.0)
    dz = z - row[2]
    flat = row[3] * max(abs(dz) - ez, 0.0)
    return row[4] * math.sqrt(dx * dx + dy * dy + flat * flat) + row[5] * dz - abs(row[5]) * ez


@bare_kernel
def directions_toward(x: float, y: float, radius: float, count: int) -> tuple[float, float]:
    """Return the first of so many angles about the z axis, and their step, in which points of a disk at (x, y) lie.

    They go all around where the disk holds the axis.
    """
    away = math.sqrt(x * x + y * y)
    if away <= radius:
        return 0.0, 2.0 * math.pi / count
    half = math.asin(radius / away)
    return math.atan2(y, x) - half, 2.0 * half / count
