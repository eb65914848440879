"""Signed distance of points to the surface of a grain, positive inside, and containers of which grains take a part."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.search import Inner
from voxgran.containers.model import periods_of
from voxgran.geometry.rotation import stretch_of
from voxgran.geometry.sphere_pairs import spheres_near
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive, from_axis
from voxgran.shapes.spheres import Spheres

#: largest number of Newton steps to the nearest point of an ellipsoid; far fewer reach the last digits
NEWTON_STEPS = 64


def inner_distance(geometry: Geometry) -> Inner:
    """Return the function from (n, 3) points in the body frame to the (n,) signed distances to the surface of a solid.

    Outside of boxes, cylinders, cones and unions of spheres, and deep in unions, the value is only a bound; its sign is
    always correct, and the value is exact inside convex grains.
    """
    if isinstance(geometry, Mesh):
        return lambda points: -geometry.tree.signed_distance(points)
    if isinstance(geometry, Spheres):
        return lambda points: _in_spheres(points, geometry.centers, geometry.radii)
    if isinstance(geometry, Outline):
        return lambda points: -geometry.signed_distance(points)
    assert isinstance(geometry, Primitive)
    return lambda points: _in_primitive(geometry, points)


def placed(inner: Inner, *, matrix: Floats, offset: Floats) -> Inner:
    """Return the same function for a grain rotated and scaled by a matrix and translated."""
    factor = stretch_of(matrix)
    back = matrix / factor**2
    return lambda points: factor * inner(linear.matmul(points - offset, back))


@dataclass(frozen=True, eq=False)
class Occupied:
    """A container without the solids that stand in it, known by its signed distance; all else is that of the container.

    Attributes
    ----------
    container : Container
        The container.
    standing : Assembly
        The solids, which do not overlap, within the container.
    reach : float
        Distance from a solid up to which it is looked at.
    """

    container: Any
    standing: Assembly
    reach: float

    def __getattr__(self, name: str) -> Any:
        if name == "boundary" or name.startswith("__"):
            # walls in closed form are not all of its walls
            raise AttributeError(name)
        return getattr(self.container, name)

    @cached_property
    def volume(self) -> float:
        """Volume of the container less that of the solids."""
        return float(self.container.volume - self.standing.volumes.sum())

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest wall or solid, negative where there is room.

        Outside of solids, and within them, it may be nearer to 0 than the distance is.
        """
        return np.maximum(self.container.signed_distance(points), self.depth(points))

    def depth(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest solid within reach, negative outside, else infinite.

        Outside, and deep within, it may be nearer to 0 than the distance is.
        """
        places = np.asarray(points, dtype=np.float64)
        found = np.full(len(places), -np.inf)
        near = load("scipy.spatial").cKDTree(places)
        for place, radius, depth in self.solids():
            mine = np.array(near.query_ball_point(place, radius + self.reach), dtype=np.int64)
            found[mine] = np.maximum(found[mine], depth(places[mine]))
        return found

    def solids(self) -> Iterator[tuple[Floats, float, Inner]]:
        """Yield centroid, bounding radius and signed distance of each solid, and of its periodic images."""
        solids = self.standing
        for grain, shift in self._images:
            place, radius = solids.position[grain] + shift, float(solids.bounding_radii[grain])
            inner = inner_distance(solids.shapes[solids.shape_id[grain]].geometry)
            yield place, radius, placed(inner, matrix=solids.matrices[grain] * solids.scale[grain], offset=place)

    @cached_property
    def _images(self) -> list[tuple[int, Floats]]:
        """The solids and their periodic images that come near the container: numbers, and translations (3,)."""
        (lower, upper), solids, periods = self.container.bounds, self.standing, periods_of(self.container)
        # what is in the bounds may also be given by its place in the tilted cell
        half = (upper - lower) / 2 + np.abs(np.tril(periods, -1)).sum(axis=0)
        middle, radii = (np.array(lower) + upper) / 2, solids.bounding_radii + self.reach
        far = np.array([linear.norm(half)])
        _, grain, image = spheres_near(middle[None], far, solids.position, radii, lower=lower, periods=periods)
        shift = linear.matmul(image, periods)
        away = np.abs(solids.position[grain] + shift - middle) - half <= radii[grain, None]
        near = (away | (periods.diagonal() == 0.0)).all(axis=1)
        return list(zip(grain[near].tolist(), shift[near], strict=True))

    def filled(self, grains: Assembly) -> Assembly:
        """Return grains of the same shapes and, as fixed ones after them, the solids, within the container."""
        solids, n = self.standing, grains.count
        shape_id, scale, position, orientation = (
            np.concatenate([getattr(grains, name), getattr(solids, name)])
            for name in ("shape_id", "scale", "position", "orientation")
        )
        fixed = np.arange(n + solids.count) >= n
        return Assembly(
            grains.shapes, shape_id, scale, position, orientation, self.container, grains.density, fixed=fixed
        )  # fmt: skip

    def scaled(self, factor: float) -> "Occupied":
        """Return the same with all lengths multiplied."""
        solids = self.standing
        grown = replace(
            solids,
            scale=solids.scale * factor,
            position=solids.position * factor,
            container=solids.container.scaled(factor),
        )
        return Occupied(self.container.scaled(factor), grown, self.reach * factor)


def _in_spheres(points: Floats, centers: Floats, radii: Floats) -> Floats:
    """Return the depth in the sphere that contains each point most deeply."""
    best = np.full(len(points), -np.inf)
    for center, radius in zip(centers, radii, strict=True):
        best = np.maximum(best, radius - linear.norm(points - center, axis=1))
    return best


def _in_primitive(primitive: Primitive, points: Floats) -> Floats:
    """Return the distance to the nearest face of a regular solid."""
    p, d = linear.matmul(points, primitive.matrix), primitive.dimensions
    if primitive.kind == "sphere":
        return np.asarray(d[0] - linear.norm(p, axis=1))
    if primitive.kind == "spherocylinder":
        return np.asarray(d[0] - linear.norm(from_axis(p, d[1]), axis=1))
    if primitive.kind == "ellipsoid":
        return _in_ellipsoid(np.abs(p), np.array(d))
    if primitive.kind == "box":
        return np.asarray((np.array(d) / 2 - np.abs(p)).min(axis=1))
    flat = np.hypot(p[:, 0], p[:, 1])
    if primitive.kind == "cylinder":
        return np.minimum(d[0] - flat, d[1] / 2 - np.abs(p[:, 2]))
    side = (d[0] * (0.75 * d[1] - p[:, 2]) - d[1] * flat) / np.hypot(d[0], d[1])
    return np.minimum(side, p[:, 2] + d[1] / 4)


def _in_ellipsoid(p: Floats, axes: Floats) -> Floats:
    """Return the distance to the surface of an ellipsoid for points of the first octant, negative outside.

    With the shortest half axis as unit the nearest point is ``a^2 p / (a^2 - 1 + s)``, where the vector
    ``v = a p / (a^2 - 1 + s)`` has norm 1 (Eberly 2013, Distance from a point to an ellipse, an ellipsoid, or a
    hyperellipsoid). Newton's method for ``1 / |v| = 1``, which is nearly linear in s, rises to the root from below
    (Moré & Sorensen 1983, doi:10.1137/0904038).
    """
    smallest = float(axes.min())
    unit, square = p / smallest, (axes / smallest) ** 2
    inside = ((p / axes) ** 2).sum(axis=1) < 1.0
    weighted, shift = unit * np.sqrt(square), square - 1.0
    # where one component alone has norm 1 the root is not below
    s = np.maximum((weighted - shift).max(axis=1), 0.0)
    for _ in range(NEWTON_STEPS):
        bottom = np.maximum(shift + s[:, None], 1e-300)
        parts = (weighted / bottom) ** 2
        norm, slope = np.sqrt(parts.sum(axis=1)), (parts / bottom).sum(axis=1)
        above = norm > 1.0
        step = np.divide(norm**2 * (norm - 1.0), slope, out=np.zeros_like(s), where=above)
        if not (s + step > s).any():
            break
        s += step
    nearest = square * unit / np.maximum(shift + s[:, None], 1e-300)
    # a point of the middle planes: the missing coordinate on the surface is along the shortest axis
    missing = np.maximum(1.0 - (nearest**2 / square).sum(axis=1), 0.0)
    shortest = int(axes.argmin())
    lifted = np.sqrt(nearest[:, shortest] ** 2 + missing)
    nearest[:, shortest] = np.where(inside, lifted, nearest[:, shortest])
    distance = linear.norm(nearest - unit, axis=1) * smallest
    return np.where(inside, distance, -distance)
