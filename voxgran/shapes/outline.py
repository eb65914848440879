"""A disk or a simple polygon as the true geometry of a grain in two dimensions, in the plane z = 0."""

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, Integers, as_choice, as_length, as_place, as_points, read_only
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.shapes.mesh import Moments

#: number of sides of the polygon that represents a disk in pictures and files
SIDES = 96


@dataclass(frozen=True, eq=False)
class Outline(Moments):
    """Boundary of a grain in the plane.

    Attributes
    ----------
    kind : {"disk", "polygon"}
        Kind of the outline.
    radius : float
        Radius of a disk, in the unit of lengths; 0 for a polygon.
    vertices : (n, 2) ndarray of float
        Corners of a polygon, counterclockwise; empty for a disk.
    center : tuple of float
        Center of a disk.

    Raises
    ------
    InputError
        If the radius is not between 1e-60 and 1e60, or the polygon has fewer than three corners, intersects or touches
        itself, is clockwise or has no area.
    """

    kind: Literal["disk", "polygon"]
    radius: float = 0.0
    vertices: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    center: tuple[float, float] = (0.0, 0.0)

    dimension = 2

    def __post_init__(self) -> None:
        as_choice(self.kind, "kind", ("disk", "polygon"))
        corners = as_points(self.vertices, "vertices", dimension=2).copy()
        if self.kind == "disk":
            object.__setattr__(self, "radius", as_length(self.radius, "radius"))
            object.__setattr__(self, "center", tuple(as_place(self.center, "center", length=2).tolist()))
            corners = corners[:0]
        else:
            _refuse_crooked(corners)
        object.__setattr__(self, "vertices", read_only(corners))

    @cached_property
    def surface_area(self) -> float:
        """Perimeter."""
        if self.kind == "disk":
            return 2 * math.pi * self.radius
        return float(linear.norm(np.roll(self.vertices, -1, axis=0) - self.vertices, axis=1).sum())

    @cached_property
    def bounding_radius(self) -> float:
        """Largest distance of a point from the origin of the frame."""
        if self.kind == "disk":
            return math.hypot(*self.center) + self.radius
        return float(linear.norm(self.vertices, axis=1).max())

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner, in the plane z = 0."""
        corners, radius = (np.array([self.center]), self.radius) if self.kind == "disk" else (self.vertices, 0.0)
        low, high = corners.min(axis=0) - radius, corners.max(axis=0) + radius
        return np.append(low, 0.0), np.append(high, 0.0)

    @cached_property
    def _moments(self) -> tuple[float, Floats, Floats]:
        """Area, centroid and inertia; a polygon is a sum of triangles with one of its corners (Green's theorem)."""
        if self.kind == "disk":
            area = math.pi * self.radius * self.radius  # multiplied, since a power may round in another way
            second = area * self.radius * self.radius / 4 * np.eye(2)
            middle = np.array(self.center)
        else:
            p = self.vertices - self.vertices[0]
            q = np.roll(p, -1, axis=0)
            cross = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
            area = float(cross.sum() / 2)
            total = p + q
            middle = (cross[:, None] * total).sum(axis=0) / (6 * area)
            second = linear.einsum("k,ki,kj->ij", cross, p, p) + linear.einsum("k,ki,kj->ij", cross, q, q)
            second = (second + linear.einsum("k,ki,kj->ij", cross, total, total)) / 24
            second = second - area * np.outer(middle, middle)
            middle = self.vertices[0] + middle
        polar = second[0, 0] + second[1, 1]
        inertia = np.diag([second[1, 1], second[0, 0], polar])
        inertia[0, 1] = inertia[1, 0] = -second[0, 1]
        return area, read_only(np.array([*middle, 0.0])), read_only(inertia)

    def contains(self, points: Floats) -> Booleans:
        """Return the mask of the (n, 3) or (n, 2) points in the closed region; z is ignored."""
        p = np.asarray(points, dtype=np.float64)[:, :2]
        if self.kind == "disk":
            return np.asarray(((p - np.array(self.center)) ** 2).sum(axis=1) <= self.radius**2)
        inside = np.zeros(len(p), dtype=np.bool_)
        border = np.zeros(len(p), dtype=np.bool_)
        for a, b in zip(self.vertices, np.roll(self.vertices, -1, axis=0), strict=True):
            side = (b[0] - a[0]) * (p[:, 1] - a[1]) - (b[1] - a[1]) * (p[:, 0] - a[0])
            inside ^= ((a[1] <= p[:, 1]) != (b[1] <= p[:, 1])) & ((side > 0) == (b[1] > a[1]))
            border |= (side == 0) & (((p - a) * (p - b)).sum(axis=1) <= 0)
        return inside | border

    def signed_distance(self, points: Floats) -> Floats:
        """Return the distance of (n, 3) points in the plane from the boundary, negative inside."""
        if self.kind == "disk":
            return np.asarray(linear.norm(points - np.array([*self.center, 0.0]), axis=1) - self.radius)
        p = points[:, None, :2]
        a, b = self.vertices, np.roll(self.vertices, -1, axis=0)
        along = b - a
        share = np.clip(((p - a) * along).sum(axis=2) / (along**2).sum(axis=1), 0.0, 1.0)
        distance = linear.norm(p - a - share[..., None] * along, axis=2).min(axis=1)
        side = along[:, 0] * (p[..., 1] - a[:, 1]) - along[:, 1] * (p[..., 0] - a[:, 0])
        crosses = ((a[:, 1] <= p[..., 1]) != (b[:, 1] <= p[..., 1])) & ((side > 0) == (b[:, 1] > a[:, 1]))
        return np.where(crosses.sum(axis=1) % 2 == 1, -distance, distance)

    def content(self) -> bytes:
        """Return the bytes from which the key of the shape is computed."""
        numbers = np.array([self.radius, *self.center])
        return self.kind.encode() + numbers.tobytes() + self.vertices.tobytes()

    def moved(self, offset: Floats) -> "Outline":
        """Return the outline shifted by the x and y of a (3,) offset."""
        x, y = (float(value) for value in np.array(self.center) + offset[:2])
        return self._with(self.radius, self.vertices + offset[:2], (x, y))

    def rotated(self, matrix: Floats) -> "Outline":
        """Return the outline rotated about the origin by a (3, 3) rotation matrix about z."""
        turn = matrix[:2, :2]
        x, y = (float(value) for value in linear.matmul(turn, np.array(self.center)))
        return self._with(self.radius, linear.matmul(self.vertices, turn.T), (x, y))

    def scaled(self, factor: float) -> "Outline":
        """Return the outline scaled about the origin."""
        center = (self.center[0] * factor, self.center[1] * factor)
        return self._with(self.radius * factor, self.vertices * factor, center)

    def _with(self, radius: float, vertices: Floats, center: tuple[float, float]) -> "Outline":
        """Return an outline of the same kind without checks, since the transformed polygon remains simple."""
        other = object.__new__(Outline)
        values = {"kind": self.kind, "radius": radius, "vertices": read_only(vertices), "center": center}
        for name, value in values.items():
            object.__setattr__(other, name, value)
        return other

    def tessellation(self) -> tuple[Floats, Integers, float]:
        """Return vertices and faces in the plane z = 0, and their largest distance from the true outline."""
        if self.kind == "disk":
            angles = 2 * np.pi * np.arange(SIDES) / SIDES
            ring = self.radius * np.column_stack([libm.cos(angles), libm.sin(angles)]) + self.center
            k = np.arange(1, SIDES - 1)
            faces = np.column_stack([np.zeros_like(k), k, k + 1])
            error = self.radius * (1 - math.cos(math.pi / SIDES))
        else:
            ring, error = self.vertices, 0.0
            faces = load("manifold3d").triangulate([np.ascontiguousarray(ring)])
        vertices = np.column_stack([ring, np.zeros(len(ring))])
        return vertices, np.array(faces, dtype=np.int64), error


def is_simple(corners: Floats) -> bool:
    """Return whether a polygon neither intersects nor touches itself."""
    return _first_crossing(corners) is None


def _refuse_crooked(corners: Floats) -> None:
    """Check that the polygon is simple and counterclockwise."""
    n = len(corners)
    if n < 3:
        raise InputError(f"polygon has {n} corners: it needs at least 3; add corners")
    crossing = _first_crossing(corners)
    if crossing is not None:
        raise InputError(
            f"polygon meets itself at edges {crossing[0]} and {crossing[1]}: its boundary must be one simple "
            "loop; remove repeated corners and crossings"
        )
    p = corners - corners[0]
    q = np.roll(p, -1, axis=0)
    area = (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum() / 2
    if area <= 0:
        raise InputError(f"polygon has the area {area:.6g}: its corners must run counterclockwise; reverse their order")


def _first_crossing(corners: Floats) -> tuple[int, int] | None:
    """Return the first two edges with a common point other than a shared corner."""
    n = len(corners)
    a, b = corners, np.roll(corners, -1, axis=0)
    for i in range(n):
        others = np.arange(i + 1, n)
        if (a[i] == b[i]).all():
            return i, (i + 1) % n
        c, d = a[others], b[others]
        one, two = _side(a[i], b[i], c), _side(a[i], b[i], d)
        three, four = _side(c, d, a[i]), _side(c, d, b[i])
        meet = (one * two <= 0) & (three * four <= 0) & _boxes_meet(a[i], b[i], c, d)
        next_one = (others == i + 1) | ((others == n - 1) & (i == 0))
        # adjacent edges share a corner; they meet elsewhere only if one folds back onto the other
        shared = np.where((others == i + 1)[:, None], b[i], a[i])
        far_here = np.where((others == i + 1)[:, None], a[i], b[i])
        far_there = np.where((others == i + 1)[:, None], d, c)
        folded = ((far_here - shared) * (far_there - shared)).sum(axis=1) > 0
        straight = _side(shared, far_here, far_there) == 0
        bad = np.where(next_one, straight & folded, meet)
        if bad.any():
            return i, int(others[bad.argmax()])
    return None


def _side(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the orientation of the triangle a, b, c."""
    u, v = np.asarray(b) - a, np.asarray(c) - a
    return np.sign(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])


def _boxes_meet(a: Floats, b: Floats, c: Floats, d: Floats) -> Booleans:
    """Return whether the bounding boxes of edge (a, b) and edges (c, d) have a point in common."""
    apart = (np.maximum(a, b) < np.minimum(c, d)) | (np.maximum(c, d) < np.minimum(a, b))
    return np.asarray(~apart.any(axis=1))
