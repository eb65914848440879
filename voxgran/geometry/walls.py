"""Walls in closed form: planes across an axis, and walls of revolution: cylinders, cones, spheres and other planes.

The reach of a point at a wall of revolution is its distance from the axis or, of a sphere, from the center. At a cone
it is the sine of the angle between the wall and a plane across the axis times that distance, less the cosine times the
height above the center along the axis. A plane in any direction is the cone of the angle 180 degrees about its outward
normal. The gradient of the reach is the unit normal; the distance from the wall is the reach less the radius of the
wall.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.geometry.vectors import Vector, along, dot, times, vector_at

#: axis of walls that are upright
UP = (0.0, 0.0, 1.0)


class Plane(NamedTuple):
    """A plane wall across an axis; `inward` is +1 where the grains lie on the side of larger coordinates, else -1."""

    name: str
    axis: int
    level: float
    inward: int

    @property
    def normal(self) -> Floats:
        """Unit normal (3,) that points to the grains."""
        return np.eye(3)[self.axis] * self.inward + 0.0

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
    """A wall of revolution around the grains: a cylinder or a cone, a sphere, or a plane across its axis."""

    center: tuple[float, float, float]  # of a cylinder or a cone, a point of its axis
    radius: float  # reach of the points of the wall
    axes: int = 2  # around which it closes: 3 for a sphere
    cosine: float = 1.0  # of the outward normal with a plane across the axis; 0 for a plane
    sine: float = 0.0  # 0 for a cylinder and a sphere
    axis: tuple[float, float, float] = UP  # unit vector; of a plane, its outward normal

    @property
    def kind(self) -> str:
        """``"cylinder"``, ``"cone"``, ``"plane"`` or ``"sphere"``."""
        return "sphere" if self.axes == 3 else "cylinder" if not self.sine else "cone" if self.cosine else "plane"

    @property
    def is_upright(self) -> bool:
        """Whether the axis is along z."""
        return self.axis == UP

    @property
    def frame(self) -> Floats:
        """Rotation (3, 3) into axes of which the last one is that of the wall."""
        away = np.array(self.axis)
        if np.count_nonzero(away) == 1 and away.max() == 1.0:
            return np.roll(np.eye(3), int(away.argmax()) - 2, axis=1)
        first = np.cross(away, np.eye(3)[np.abs(away).argmin()])
        first /= linear.norm(first)
        return np.stack([first, np.cross(away, first), away])

    @property
    def row(self) -> Floats:
        """The wall for kernels, (16,): center, 1 for a sphere and else 0, cosine, sine, radius, frame."""
        numbers = [*self.center, self.axes - 2, self.cosine, self.sine, self.radius, *self.frame.ravel()]
        return np.array(numbers, dtype=np.float64)

    def distance(self, points: Floats) -> Floats:
        """Return the distance (n,) of points (n, 3) from the wall, positive on the side of the grains."""
        return self.radius - self.reach(points - np.array(self.center))

    def reach(self, away: Floats) -> Floats:
        """Return the reach (n,) of points by their places (n, 3) relative to the center."""
        if not self.is_upright:
            away = linear.matmul(away, self.frame.T)
        return np.asarray(self.cosine * linear.norm(away[:, : self.axes], axis=1) + self.sine * away[:, 2])

    def along(self, points: Floats, axes: tuple[int, int, int]) -> tuple[Floats, Floats]:
        """Return between which distances from points (n, 3), along the last one of the axes, lines are inside.

        They are NaN for lines that miss.
        """
        frame = np.eye(3) if self.is_upright else self.frame
        away = points - np.array(self.center)
        away = away if self.is_upright else linear.matmul(away, frame.T)
        way, flat = frame[: self.axes, axes[2]], away[:, : self.axes]
        slope, square = self.sine * float(frame[2, axes[2]]), self.cosine**2 * float(linear.matmul(way, way))
        # what the cosine times the distance from the axis may be, at the points
        room = self.radius - self.sine * away[:, 2]
        if not square:
            room = room - self.cosine * linear.norm(flat, axis=1)
            if not slope:
                end = np.where(room >= 0, np.inf, np.nan)
                return -end, end
            open_end = np.full(len(room), -np.inf if slope > 0 else np.inf)
            return np.minimum(room / slope, open_end), np.maximum(room / slope, open_end)
        if not slope:
            middle = -linear.matmul(flat, way) / linear.matmul(way, way)
            rest = np.maximum(room / self.cosine, 0.0) ** 2
            for k in range(self.axes):
                rest = rest - (flat[:, k] + middle * way[k]) ** 2
            half = np.sqrt(np.where(rest > 0, rest, np.nan) / linear.matmul(way, way))
            return middle - half, middle + half
        # both nappes of the cone: (square - slope^2) t^2 + 2 b t + c <= 0
        a = square - slope**2
        b, c = (
            self.cosine**2 * linear.matmul(flat, way) + room * slope,
            self.cosine**2 * (flat**2).sum(axis=1) - room**2,
        )
        rest = b * b - a * c
        root = np.sqrt(np.where(rest > 0, rest, 0.0 if a < 0 else np.nan))
        both = np.sort(np.stack([-b - root, -b + root]) / a, axis=0)
        if a > 0:
            return tuple(np.where(room - slope * both.mean(axis=0) > 0, both, np.nan))
        # one half-line lies in each nappe, this one in the nappe of the grains
        return (np.full(len(b), -np.inf), both[0]) if slope > 0 else (both[1], np.full(len(b), np.inf))


def cone(center: tuple[float, float, float], radius: float, angle: float) -> Round:
    """Return a cone that has a radius at the height of its center and widens upward at an angle from the horizontal.

    The angle is in radians, above 0 and below pi; above pi / 2 the cone narrows upward.
    """
    return Round(center, radius * math.sin(angle), 2, math.sin(angle), -math.cos(angle))


def plane(point: tuple[float, float, float], outward: tuple[float, float, float]) -> Round:
    """Return the plane through a point that ends the grains along its outward unit normal."""
    return Round(point, 0.0, 2, 0.0, 1.0, outward)


@bare_kernel
def reach_of(row: Floats, x: float, y: float, z: float) -> float:
    """Return the reach of a point at a wall of revolution, given by its row."""
    return reach_from(row, x - row[0], y - row[1], z - row[2])


@bare_kernel
def reach_from(row: Floats, dx: float, dy: float, dz: float) -> float:
    """Return the reach of a point by its place relative to the center."""
    dx, dy, dz = in_frame(row, (dx, dy, dz))
    flat = dz * row[3]
    return row[4] * math.sqrt(dx * dx + dy * dy + flat * flat) + row[5] * dz


@bare_kernel
def least_reach(row: Floats, x: float, y: float, z: float, ex: float, ey: float, ez: float) -> float:
    """Return a lower bound of the reach of the points of a box with its middle at (x, y, z) and half extents."""
    dx, dy, dz = in_frame(row, (x - row[0], y - row[1], z - row[2]))
    if row[15] != 1.0:
        ex, ey, ez = (
            abs(row[7]) * ex + abs(row[8]) * ey + abs(row[9]) * ez,
            abs(row[10]) * ex + abs(row[11]) * ey + abs(row[12]) * ez,
            abs(row[13]) * ex + abs(row[14]) * ey + abs(row[15]) * ez,
        )
    dx, dy = max(abs(dx) - ex, 0.0), max(abs(dy) - ey, 0.0)
    flat = row[3] * max(abs(dz) - ez, 0.0)
    return row[4] * math.sqrt(dx * dx + dy * dy + flat * flat) + row[5] * dz - abs(row[5]) * ez


@bare_kernel
def in_frame(row: Floats, a: Vector) -> Vector:
    """Return a vector along the axes of the frame of a wall, given by its row; as it is for an upright wall."""
    if row[15] == 1.0:
        return a
    return dot(a, vector_at(row, 7)), dot(a, vector_at(row, 10)), dot(a, vector_at(row, 13))


@bare_kernel
def out_of_frame(row: Floats, a: Vector) -> Vector:
    """Return a vector that is given along the axes of the frame of a wall."""
    if row[15] == 1.0:
        return a
    first = along(times(vector_at(row, 7), a[0]), a[1], vector_at(row, 10))
    return along(first, a[2], vector_at(row, 13))


@bare_kernel
def directions_toward(x: float, y: float, radius: float, count: int) -> tuple[float, float]:
    """Return the first of so many angles about the axis, and their step, in which points of a disk at (x, y) lie.

    They go all around where the disk holds the axis.
    """
    away = math.sqrt(x * x + y * y)
    if away <= radius:
        return 0.0, 2.0 * math.pi / count
    half = math.asin(radius / away)
    return math.atan2(y, x) - half, 2.0 * half / count
