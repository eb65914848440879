"""Regular solids in closed form: sphere, ellipsoid, box, cylinder, cone, spherocylinder."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers, check_lengths, read_only
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.geometry.rotation import product, quaternions_of, rotation_matrices
from voxgran.shapes.tessellate import SIDES, revolved, sphere, unit_box

Kind = Literal["sphere", "ellipsoid", "box", "cylinder", "cone", "spherocylinder"]

#: sides of the polygons that stand for the circles of a spherocylinder, also of a coarse one
ROUND_SIDES, COARSE_SIDES = 64, 16
#: names of the dimensions of each kind
DIMENSIONS: dict[Kind, tuple[str, ...]] = {
    "sphere": ("radius",),
    "ellipsoid": ("semi-axis x", "semi-axis y", "semi-axis z"),
    "box": ("length x", "length y", "length z"),
    "cylinder": ("radius", "height"),
    "cone": ("radius", "height"),
    "spherocylinder": ("radius", "distance of the centers of its ends"),
}


@dataclass(frozen=True, eq=False)
class Primitive:
    """Regular convex solid with its centroid at the origin, and its axis along z before rotation.

    Attributes
    ----------
    kind : str
        One of :data:`DIMENSIONS`.
    dimensions : tuple of float
        Radius, semi-axes, edges, radius and height, or radius and distance of the centers of the ends, in the unit of
        lengths.
    rotation : tuple of float
        Unit quaternion (w, x, y, z) of its rotation.

    Raises
    ------
    InputError
        If the number of dimensions is not that of the kind, or one is not between 1e-60 and 1e60.
    """

    kind: Kind
    dimensions: tuple[float, ...]
    rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    dimension = 3

    def __post_init__(self) -> None:
        names = DIMENSIONS[self.kind]
        good = [math.isfinite(value) and value > 0 for value in self.dimensions]
        if len(good) != len(names) or not all(good):
            raise InputError(
                f"{self.kind} has dimensions {self.dimensions}: give {', '.join(names)}, each finite and above 0"
            )
        check_lengths(self.dimensions, f"dimension of the {self.kind}")

    @property
    def centroid(self) -> Floats:
        """Centroid, (3,): the origin."""
        return np.zeros(3)

    @cached_property
    def matrix(self) -> Floats:
        """Rotation matrix, (3, 3)."""
        return read_only(rotation_matrices(np.array([self.rotation]))[0])

    @cached_property
    def volume(self) -> float:
        """Volume in closed form."""
        d = self.dimensions  # multiplied, since a power may round in another way in another unit
        if self.kind == "sphere":
            return 4 / 3 * math.pi * d[0] * d[0] * d[0]
        if self.kind == "ellipsoid":
            return 4 / 3 * math.pi * d[0] * d[1] * d[2]
        if self.kind == "box":
            return d[0] * d[1] * d[2]
        if self.kind == "spherocylinder":
            return math.pi * d[0] * d[0] * (d[1] + 4 / 3 * d[0])
        return math.pi * d[0] * d[0] * d[1] / (1 if self.kind == "cylinder" else 3)

    @cached_property
    def surface_area(self) -> float:
        """Surface area in closed form (ellipsoid: DLMF 19.33.1)."""
        d = self.dimensions
        if self.kind == "sphere":
            return 4 * math.pi * d[0] * d[0]
        if self.kind == "ellipsoid":
            longest = max(d)
            a, b, c = ((value / longest) ** 2 for value in d)  # fourth powers of lengths would overflow
            return float(4 * math.pi * load("scipy.special").elliprg(a * b, a * c, b * c)) * longest * longest
        if self.kind == "box":
            return 2 * (d[0] * d[1] + d[1] * d[2] + d[2] * d[0])
        if self.kind == "cylinder":
            return 2 * math.pi * d[0] * (d[0] + d[1])
        if self.kind == "spherocylinder":
            return 2 * math.pi * d[0] * (2 * d[0] + d[1])
        return math.pi * d[0] * (d[0] + math.hypot(d[0], d[1]))

    @cached_property
    def inertia(self) -> Floats:
        """Inertia tensor about the centroid at unit density, (3, 3)."""
        d, v = self.dimensions, self.volume
        if self.kind in ("sphere", "ellipsoid"):
            squares = np.array(d * 3 if self.kind == "sphere" else d) ** 2 / 5
        elif self.kind == "box":
            squares = np.array(d) ** 2 / 12
        elif self.kind == "cylinder":
            squares = np.array([d[0], d[0], d[1]]) ** 2 / (4, 4, 12)
        elif self.kind == "spherocylinder":
            r, h = d[0], d[1] / 2
            # barrel and ends, per volume of the whole: their shares are as h to 2 / 3 r
            wide, far = r * r * (h / 4 + 2 / 15 * r), h * h * h / 3 + 2 / 3 * r * (h * h + 3 / 4 * h * r + r * r / 5)
            squares = np.array([wide, wide, far]) / (h + 2 / 3 * r)
        else:
            squares = 3 * np.array([d[0], d[0], d[1]]) ** 2 / (20, 20, 80)
        body = np.diag(v * (squares.sum() - squares))
        return read_only(linear.matmul(linear.matmul(self.matrix, body), self.matrix.T))

    @cached_property
    def bounding_radius(self) -> float:
        """Radius of the smallest bounding sphere about the centroid."""
        d = self.dimensions
        if self.kind in ("sphere", "ellipsoid"):
            return max(d)
        if self.kind == "box":
            return math.sqrt(sum(value * value for value in d)) / 2
        if self.kind == "cylinder":
            return math.hypot(d[0], d[1] / 2)
        if self.kind == "spherocylinder":
            return d[0] + d[1] / 2
        return max(0.75 * d[1], math.hypot(d[0], d[1] / 4))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner."""
        ends = self.support(np.vstack([-np.eye(3), np.eye(3)]))
        return ends[:3].diagonal(), ends[3:].diagonal()

    def support(self, directions: Floats) -> Floats:
        """Return the (n, 3) support points of the solid along (n, 3) directions."""
        return linear.matmul(self._body_support(linear.matmul(directions, self.matrix)), self.matrix.T)

    def _body_support(self, u: Floats) -> Floats:
        """Return the support points of the solid before rotation."""
        d = self.dimensions
        if self.kind in ("sphere", "ellipsoid"):
            axes = np.array(d * 3 if self.kind == "sphere" else d)
            stretched = u * axes
            return stretched * axes / np.maximum(linear.norm(stretched, axis=1, keepdims=True), 1e-300)
        if self.kind == "box":
            return np.where(u >= 0, 0.5, -0.5) * np.array(d)
        if self.kind == "spherocylinder":
            out = d[0] * u / np.maximum(linear.norm(u, axis=1, keepdims=True), 1e-300)
            return out + np.where(u[:, 2:] >= 0, 0.5, -0.5) * [0.0, 0.0, d[1]]
        flat = np.hypot(u[:, 0], u[:, 1])
        ring = d[0] * u[:, :2] / np.maximum(flat, 1e-300)[:, None]
        if self.kind == "cylinder":
            return np.column_stack([ring, np.where(u[:, 2] >= 0, 0.5, -0.5) * d[1]])
        top = u[:, 2] * d[1] >= flat * d[0]
        return np.column_stack([np.where(top[:, None], 0.0, ring), np.where(top, 0.75, -0.25) * d[1]])

    def contains(self, points: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return the mask of the (n, 3) points in the closed solid."""
        p, d = linear.matmul(points, self.matrix), self.dimensions
        if self.kind in ("sphere", "ellipsoid"):
            axes = np.array(d * 3 if self.kind == "sphere" else d)
            inside = ((p / axes) ** 2).sum(axis=1) <= 1.0
        elif self.kind == "box":
            inside = (np.abs(p) <= np.array(d) / 2).all(axis=1)
        elif self.kind == "cylinder":
            inside = (np.hypot(p[:, 0], p[:, 1]) <= d[0]) & (np.abs(p[:, 2]) <= d[1] / 2)
        elif self.kind == "spherocylinder":
            inside = linear.norm(from_axis(p, d[1]), axis=1) <= d[0]
        else:
            share = 0.75 - p[:, 2] / d[1]
            inside = (share <= 1.0) & (np.hypot(p[:, 0], p[:, 1]) <= d[0] * share)
        return inside

    def content(self) -> bytes:
        """Return the bytes from which the key of the shape is computed."""
        return self.kind.encode() + np.array([*self.dimensions, *self.rotation]).tobytes()

    def rotated(self, matrix: Floats) -> "Primitive":
        """Return the solid rotated by a (3, 3) rotation matrix."""
        turn = product(quaternions_of(matrix[None])[0], np.array(self.rotation))
        w, x, y, z = (float(value) for value in turn)
        return Primitive(self.kind, self.dimensions, (w, x, y, z))

    def scaled(self, factor: float) -> "Primitive":
        """Return the solid with all dimensions multiplied."""
        return Primitive(self.kind, tuple(value * factor for value in self.dimensions), self.rotation)

    def circumscribed(self) -> tuple[Floats, Integers]:
        """Return vertices and faces of a tessellation that contains the true solid."""
        vertices, faces, error = Primitive(self.kind, self.dimensions).tessellation()
        if self.kind in ("sphere", "ellipsoid"):
            vertices = vertices / (1 - sphere()[2])
        elif self.kind == "spherocylinder":
            # the inscribed polyhedron holds the solid that is thinner by its error
            radius = self.dimensions[0]
            vertices = vertices * (radius / (radius - error))
        elif self.kind != "box":
            vertices = vertices / np.array([math.cos(math.pi / SIDES), math.cos(math.pi / SIDES), 1.0])
        return linear.matmul(vertices, self.matrix.T), faces

    def tessellation(self, *, coarse: bool = False) -> tuple[Floats, Integers, float]:
        """Return vertices, faces and their largest distance from the true surface.

        Vertices lie on the true surface, so the tessellation is inscribed. There are at most 192 of them in a coarse
        one.
        """
        d, sides = self.dimensions, COARSE_SIDES if coarse else ROUND_SIDES
        if self.kind in ("sphere", "ellipsoid"):
            axes = np.array(d * 3 if self.kind == "sphere" else d)
            vertices, faces, error = sphere(2 if coarse else 4)
            vertices, error = vertices * axes, error * float(axes.max())
        elif self.kind == "box":
            vertices, faces, error = unit_box()
            vertices = vertices * np.array(d)
        elif self.kind == "spherocylinder":
            vertices, faces, error = revolved(self.profile(sides), sides=sides)
            # chords of the circle and of the meridian
            error *= 2
        else:
            vertices, faces, error = revolved(self.profile(SIDES))
        return linear.matmul(vertices, self.matrix.T), faces, error

    def profile(self, sides: int) -> list[tuple[float, float]]:
        """Return heights and radii of a cylinder, a cone or a spherocylinder of revolution, from bottom to top.

        Of circles there are as many chords as `sides`, a multiple of 4.
        """
        radius, height = self.dimensions
        if self.kind == "cylinder":
            return [(-height / 2, radius), (height / 2, radius)]
        if self.kind == "cone":
            return [(-height / 4, radius), (0.75 * height, 0.0)]
        angles = 2 * np.pi / sides * np.arange(1, sides // 4 + 1)
        end = list(zip(height / 2 + radius * libm.cos(angles), radius * libm.sin(angles), strict=True))
        bottom = [(-rise, flat) for rise, flat in end]
        return [(-height / 2 - radius, 0.0), *bottom, *end[::-1], (height / 2 + radius, 0.0)]


def from_axis(points: Floats, length: float) -> Floats:
    """Return the vectors (n, 3) to points from the nearest points of a segment of the z axis about the origin."""
    return points - np.clip(points[:, 2:], -length / 2, length / 2) * [0.0, 0.0, 1.0]
