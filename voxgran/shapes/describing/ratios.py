"""Ratios that describe the form of a shape: each descriptor once, with its formula and source; and the smallest box,
whose edges are the principal lengths.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import normalized, random_rotations, rotation_matrices
from voxgran.shapes.describing.curvature import roundness
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

#: orientations that are compared at first, best ones that are turned by small angles, and those that end on edges
TRIED, TURNED, IMPROVED = 2000, 12, 3
#: largest of the small angles, in radians, and how often they are halved
ANGLE, HALVED = 0.15, 12
#: largest number of improvements of one orientation
MOST_STEPS = 30


def principal_lengths(shape: Shape) -> Floats:
    """Return the edges (3,) of the smallest box around a shape, largest first; in 2D those of the rectangle and 0.

    The box has the least volume of all orientations (in 2D, and for a flat surface, the least area). It is exact in 2D
    and for solids in closed form. For others it is the best of many orientations, improved by small turns and then by
    turning the box about one of its axes after the other to the best angle until none improves it.

    References
    ----------
    .. [1] Toussaint 1983, rotating calipers: a smallest rectangle has an edge in common with the convex hull
    .. [2] Chang, Gorissen & Melchior 2011, doi:10.1145/2019627.2019641: local minima on the rotation group
    """
    geometry = shape.geometry
    if isinstance(geometry, Primitive) and geometry.kind != "cone":
        d = geometry.dimensions
        edges = {
            "sphere": (2 * d[0],) * 3,
            "ellipsoid": tuple(2 * value for value in d),
            "box": d,
            "cylinder": (2 * d[0], 2 * d[0], d[-1]),
            "spherocylinder": (2 * d[0], 2 * d[0], 2 * d[0] + d[-1]),
        }[geometry.kind]
        return np.sort(np.array(edges))[::-1]
    if shape.is_sphere:
        return np.where(np.arange(3) < shape.dimension, 2 * shape.bounding_radius, 0.0)
    if shape.dimension == 2:
        return np.array([*sorted(_rectangle(shape.vertices[:, :2])[0], reverse=True), 0.0])
    hull = corners_of_hull(shape.vertices)
    if hull.shape[1] == 2:
        return np.array([*sorted(_rectangle(hull)[0], reverse=True), 0.0])
    turns = rotation_matrices(random_rotations(stream(0, "boxes"), TRIED))
    turns = np.concatenate([linear.svd(hull - hull.mean(axis=0))[2][None], turns])
    turns = turns[np.argsort(_volumes(hull, turns), kind="stable")[:TURNED]]
    ways = np.indices((3, 3, 3)).reshape(3, -1).T - 1.0
    for level in range(HALVED):
        small = normalized(np.column_stack([np.ones(len(ways)), ANGLE / 2 ** (level + 1) * ways]))
        near = linear.matmul(rotation_matrices(small)[None], turns[:, None]).reshape(-1, 3, 3)
        best = _volumes(hull, near).reshape(len(turns), -1).argmin(axis=1)
        turns = near.reshape(len(turns), -1, 3, 3)[np.arange(len(turns)), best]
    order = np.argsort(_volumes(hull, turns), kind="stable")[:IMPROVED]
    found = [_improved(hull, turns[k]) for k in order]
    return np.sort(min(found, key=lambda edges: float(edges.prod())))[::-1]


def corners_of_hull(points: Floats) -> Floats:
    """Return the points (n, 3) that are corners of the convex hull; of points in a plane, (n, 2) in its coordinates."""
    middle = points.mean(axis=0)
    _, spread, axes = linear.svd(points - middle)
    if spread[2] <= 1e-12 * spread[0]:
        return np.asarray(linear.matmul(points - middle, axes[:2].T))
    return np.asarray(points[load("scipy.spatial").ConvexHull(points).vertices])


def _edges(points: Floats, turns: Floats) -> Floats:
    """Return the edges (m, 3) of the boxes around points along the rows of rotation matrices (m, 3, 3)."""
    return np.asarray(_spans(np.ascontiguousarray(points), np.ascontiguousarray(turns)))


def _volumes(points: Floats, turns: Floats) -> Floats:
    """Return the volumes (m,) of the boxes around points along the rows of rotation matrices (m, 3, 3)."""
    return np.asarray(_edges(points, turns).prod(axis=1))


@kernel
def _spans(points, turns):  # type: ignore[no-untyped-def]
    """Return the edges of `_edges`."""
    edges = np.empty((len(turns), 3))
    for turn in range(len(turns)):
        for axis in range(3):
            a, b, c = turns[turn, axis, 0], turns[turn, axis, 1], turns[turn, axis, 2]
            low, high = np.inf, -np.inf
            for k in range(len(points)):
                along = a * points[k, 0] + b * points[k, 1] + c * points[k, 2]
                low, high = min(low, along), max(high, along)
            edges[turn, axis] = high - low
    return edges


def _rectangle(points: Floats) -> tuple[Floats, Floats]:
    """Return the edges (2,) of the smallest rectangle around points in the plane, and the direction of the first."""
    found = _smallest(points[np.lexsort((points[:, 1], points[:, 0]))])
    return found[:2], found[2:]


@kernel
def _smallest(points):  # type: ignore[no-untyped-def]
    """Return edges and direction of `_rectangle`; the points are sorted by x, then y."""
    hull, count = np.empty(2 * len(points), np.int64), 0
    for side in range(2):
        first = count
        for step in range(len(points)):
            k = step if side == 0 else len(points) - 1 - step
            while count - first > 1:
                i, j = hull[count - 2], hull[count - 1]
                turn = (points[j, 0] - points[i, 0]) * (points[k, 1] - points[i, 1])
                if turn > (points[j, 1] - points[i, 1]) * (points[k, 0] - points[i, 0]):
                    break
                count -= 1
            hull[count] = k
            count += 1
        # the last one begins the other side
        count -= 1
    best, found = np.inf, np.zeros(4)
    for h in range(count):
        i, j = hull[h], hull[(h + 1) % count]
        x, y = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
        length = math.sqrt(x * x + y * y)
        if length == 0.0:
            continue
        x, y = x / length, y / length
        low, high, near, far = np.inf, -np.inf, np.inf, -np.inf
        for g in range(count):
            along = x * points[hull[g], 0] + y * points[hull[g], 1]
            away = x * points[hull[g], 1] - y * points[hull[g], 0]
            low, high, near, far = min(low, along), max(high, along), min(near, away), max(far, away)
        if (high - low) * (far - near) < best:
            best = (high - low) * (far - near)
            found[0], found[1], found[2], found[3] = high - low, far - near, x, y
    return found


def _improved(points: Floats, turn: Floats) -> Floats:
    """Return the edges of a box after it was turned about its axes until no turn makes it smaller."""
    edges, axis, since = _edges(points, turn[None])[0], 0, 0
    for _ in range(MOST_STEPS):
        one, two = turn[(axis + 1) % 3], turn[(axis + 2) % 3]
        (wide, deep), way = _rectangle(np.column_stack([linear.matmul(points, one), linear.matmul(points, two)]))
        smaller = wide * deep < edges[(axis + 1) % 3] * edges[(axis + 2) % 3] * (1 - 1e-12)
        if smaller:
            first = way[0] * one + way[1] * two
            turn = np.roll(np.array([turn[axis], first, np.cross(turn[axis], first)]), axis, axis=0)
            edges = np.roll(np.array([edges[axis], wide, deep]), axis)
        since = 0 if smaller else since + 1
        axis = (axis + 1) % 3
        if since == 2:
            break
    return edges


@dataclass(frozen=True)
class Form:
    """A shape whose descriptors are asked for; what several of them need is computed once.

    Attributes
    ----------
    shape : Shape
        The shape.
    """

    shape: Shape

    @cached_property
    def lengths(self) -> Floats:
        """Edges of the smallest box, (3,), largest first; NaN for the third in 2D (Blott & Pye 2008,
        doi:10.1111/j.1365-3091.2007.00892.x).
        """
        edges = principal_lengths(self.shape)
        return edges if self.shape.dimension == 3 else np.array([edges[0], edges[1], math.nan])


@dataclass(frozen=True, slots=True, kw_only=True)
class Descriptor:
    """One descriptor of the form of shapes.

    Attributes
    ----------
    long_name, formula, source : str
        What it is, how it is computed, and who defined it.
    compute : callable
        Function of a :class:`Form` that returns a number, NaN where it is not defined.
    power : int
        Power of length that is its unit; in 2D, volumes are areas and areas are perimeters.
    """

    long_name: str
    formula: str
    compute: Callable[[Form], float]
    power: int = 0
    source: str = ""

    def power_in(self, dimension: int) -> int:
        """Return the power of length that is the unit in 2D or 3D."""
        return self.power if dimension == 3 or self.power < 2 else self.power - 1


def sphericity(form: Form) -> float:
    """Return the surface area of the sphere of equal volume over that of the shape; in 2D, the perimeters of disks."""
    shape = form.shape
    if shape.is_open:
        return math.nan
    if shape.dimension == 2:
        return math.sqrt(4 * math.pi * shape.volume) / shape.surface_area
    return math.pi * shape.diameter**2 / shape.surface_area


def convexity(form: Form) -> float:
    """Return the volume (in 2D the area) of a shape over that of its convex hull."""
    shape = form.shape
    if shape.is_open:
        return math.nan
    if shape.is_sphere or isinstance(shape.geometry, Primitive):
        return 1.0
    hull = load("scipy.spatial").ConvexHull(shape.vertices[:, : shape.dimension])
    return min(1.0, shape.volume / float(hull.volume))


#: all descriptors by their names
DESCRIPTORS: Mapping[str, Descriptor] = {
    "volume": Descriptor(long_name="volume (in 2D area)", formula="V", compute=lambda f: f.shape.volume, power=3),
    "surface_area": Descriptor(
        long_name="surface area (in 2D perimeter; of an open surface one side)",
        formula="A",
        compute=lambda f: f.shape.surface_area,
        power=2,
    ),
    "equivalent_diameter": Descriptor(
        long_name="diameter of the sphere of equal volume (in 2D and for open surfaces, of the disk of equal area)",
        formula="(6 V / pi)^(1/3); in 2D (4 V / pi)^(1/2)",
        compute=lambda f: f.shape.diameter,
        power=1,
    ),
    "longest_length": Descriptor(
        long_name="longest edge of the smallest box", formula="L", compute=lambda f: float(f.lengths[0]), power=1
    ),
    "intermediate_length": Descriptor(
        long_name="intermediate edge of the smallest box (in 2D the shorter one)",
        formula="I",
        compute=lambda f: float(f.lengths[1]),
        power=1,
    ),
    "shortest_length": Descriptor(
        long_name="shortest edge of the smallest box", formula="S", compute=lambda f: float(f.lengths[2]), power=1
    ),
    "elongation": Descriptor(
        long_name="elongation ratio",
        formula="I / L",
        compute=lambda f: float(f.lengths[1] / f.lengths[0]),
        source="Zingg 1935, doi:10.3929/ethz-a-000103455",
    ),
    "flatness": Descriptor(
        long_name="flatness ratio",
        formula="S / I",
        compute=lambda f: float(f.lengths[2] / f.lengths[1]),
        source="Zingg 1935, doi:10.3929/ethz-a-000103455",
    ),
    "sphericity": Descriptor(
        long_name="sphericity",
        formula="pi^(1/3) (6 V)^(2/3) / A; in 2D (4 pi V)^(1/2) / A",
        compute=sphericity,
        source="Wadell 1932, doi:10.1086/623964",
    ),
    "convexity": Descriptor(long_name="convexity", formula="V over the volume of the convex hull", compute=convexity),
    "roundness": Descriptor(
        long_name="roundness",
        formula="mean radius of curvature of corners, weighted by angle, over the radius of the inscribed sphere",
        compute=lambda f: roundness(f.shape),
        source="Wadell 1932, doi:10.1086/623964",
    ),
    "krumbein_sphericity": Descriptor(
        long_name="intercept sphericity",
        formula="(I S / L^2)^(1/3)",
        compute=lambda f: float((f.lengths[1] * f.lengths[2] / f.lengths[0] ** 2) ** (1 / 3)),
        source="Krumbein 1941, doi:10.1306/D42690F3-2B26-11D7-8648000102C1865D",
    ),
    "corey_shape_factor": Descriptor(
        long_name="shape factor of settling",
        formula="S / (L I)^(1/2)",
        compute=lambda f: float(f.lengths[2] / math.sqrt(f.lengths[0] * f.lengths[1])),
        source="Corey 1949",
    ),
}
