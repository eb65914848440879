"""Shapes as the fit into cells takes them: how far each reaches in a direction, its support function.

What lies within planes is the convex hull of a shape. Shapes of points and spheres are their corners, or the centers of
their spheres with radii; ellipsoids, cylinders and cones have a support function in closed form.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.convex_bodies import convex_bodies
from voxgran.geometry.rotation import rotation_matrices
from voxgran.geometry.support import support
from voxgran.shapes.model import Shape


class Bodies(NamedTuple):
    """Shapes of unit diameter.

    start: (s + 1,) first point of each.  point: (p, 3) of all.  margin: (p,) radius of the sphere at each point.
    row: (s, 13) of the shapes in closed form (:mod:`voxgran.geometry.support`); of kind POINT for all others.
    round: (s,) 1 for spheres and disks, which need no rotation.
    """

    start: Integers
    point: Floats
    margin: Floats
    row: Floats
    round: Integers


class Poses(NamedTuple):
    """Grains as they lie about their seeds.

    shape_id: (n,) shape of each.  arm: (n, 3) centroids from the seeds.  turn: (n, 9) rotation matrices.  size: (n,)
    diameters.  bound: (n,) largest distance of a point from the seed.  farthest: (4,) work space, and the largest
    bound.
    """

    shape_id: Integers
    arm: Floats
    turn: Floats
    size: Floats
    bound: Floats
    farthest: Floats


def poses_of(shapes: Sequence[Shape], shape_id: Integers, arm: Floats, turn: Floats, size: Floats) -> Poses:
    """Return grains with centroids `arm` (n, 3) from their seeds, quaternions `turn` (n, 4) and diameters, (n,)."""
    radius = np.array([shape.bounding_radius for shape in shapes])
    bound = linear.norm(arm, axis=1) + size * radius[shape_id]
    farthest = np.array([0.0, 0.0, 0.0, bound.max(initial=0.0)])
    matrices = np.ascontiguousarray(rotation_matrices(turn).reshape(-1, 9))
    return Poses(np.asarray(shape_id, dtype=np.int64), arm.copy(), matrices, size.copy(), bound, farthest)


def bodies_of(shapes: Sequence[Shape]) -> Bodies:
    """Return shapes as kernels take them."""
    tables = convex_bodies(shapes, hulls=True, faces=False)
    spheres = np.array([shape.is_sphere for shape in shapes], dtype=np.int64)
    return Bodies(tables.first, tables.corner, tables.radius, tables.row, spheres)


@bare_kernel
def middle_of_gap(bodies: Bodies, poses: Poses, i: int, j: int, x: float, y: float, z: float, away: float) -> float:
    """Return the distance from seed i, along the unit vector to seed j, of the middle of the gap of their grains."""
    turn, arm, size = poses.turn, poses.arm, poses.size
    upper = x * arm[i, 0] + y * arm[i, 1] + z * arm[i, 2]
    lower = away + x * arm[j, 0] + y * arm[j, 1] + z * arm[j, 2]
    upper += size[i] * reach_along(bodies, poses.shape_id[i], turn[i], x, y, z, poses.farthest)
    lower -= size[j] * reach_along(bodies, poses.shape_id[j], turn[j], -x, -y, -z, poses.farthest)
    return 0.5 * (upper + lower)


@bare_kernel
def reach_along(bodies: Bodies, s: int, turn: Floats, x: float, y: float, z: float, farthest: Floats) -> float:
    """Return how far shape s, rotated by the matrix `turn` (9,), reaches along a unit vector; write the point there.

    The point (3,) is the center of a sphere where the shape has such, in the rotated frame.
    """
    u = turn[0] * x + turn[3] * y + turn[6] * z
    v = turn[1] * x + turn[4] * y + turn[7] * z
    w = turn[2] * x + turn[5] * y + turn[8] * z
    best, px, py, pz = -math.inf, 0.0, 0.0, 0.0
    if bodies.row[s, 0] != 0.0:
        px, py, pz = support(bodies.row[s], 0.0, u, v, w)
        best = u * px + v * py + w * pz
    for k in range(bodies.start[s], bodies.start[s + 1]):
        reach = u * bodies.point[k, 0] + v * bodies.point[k, 1] + w * bodies.point[k, 2] + bodies.margin[k]
        if reach > best:
            best, px, py, pz = reach, bodies.point[k, 0], bodies.point[k, 1], bodies.point[k, 2]
    farthest[0] = turn[0] * px + turn[1] * py + turn[2] * pz
    farthest[1] = turn[3] * px + turn[4] * py + turn[5] * pz
    farthest[2] = turn[6] * px + turn[7] * py + turn[8] * pz
    return best


@bare_kernel
def farthest_from_axis(
    bodies: Bodies, s: int, turn: Floats, size: float, x: float, y: float, z: float, axes: int, way: Floats
) -> float:
    """Return how far shape s, of a size and with its centroid at (x, y, z), reaches from the origin, and write the way.

    With 2 axes distances are those from the line along z. For ellipsoids, cylinders and cones the distance is a maximum
    of an ascent from several directions.
    """
    tall, best = 1.0 if axes == 3 else 0.0, -1.0
    for k in range(bodies.start[s], bodies.start[s + 1]):
        a, b, c = bodies.point[k, 0], bodies.point[k, 1], bodies.point[k, 2]
        px = x + size * (turn[0] * a + turn[1] * b + turn[2] * c)
        py = y + size * (turn[3] * a + turn[4] * b + turn[5] * c)
        pz = (z + size * (turn[6] * a + turn[7] * b + turn[8] * c)) * tall
        away = math.sqrt(px * px + py * py + pz * pz)
        if away + size * bodies.margin[k] > best:
            best = away + size * bodies.margin[k]
            away = max(away, 1e-300)
            way[0], way[1], way[2] = px / away, py / away, pz / away
    if bodies.row[s, 0] == 0.0:
        return best
    for k in range(7):
        # the way from the origin to the centroid, and both senses of the axes of the shape
        sense, c = (1.0 if k % 2 else -1.0), (k - 1) // 2
        first = (x, y, z * tall) if k == 0 else (sense * turn[c], sense * turn[3 + c], sense * turn[6 + c] * tall)
        best = _ascend(bodies, s, turn, size, (x, y, z), tall, first, best, way)
    return best


@bare_kernel
def _ascend(bodies, s, turn, size, center, tall, first, best, way):  # type: ignore[no-untyped-def]
    """Go from the point farthest along a direction to that along the way to it, until nothing changes."""
    (x, y, z), (ux, uy, uz), last = center, first, -1.0
    for _ in range(200):
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        if length < 1e-12:
            return best
        reach_along(bodies, s, turn, ux / length, uy / length, uz / length, way[3:])
        ux, uy, uz = x + size * way[3], y + size * way[4], (z + size * way[5]) * tall
        away = math.sqrt(ux * ux + uy * uy + uz * uz)
        if away <= last * (1.0 + 1e-15):
            break
        last = away
    if last > best:
        best = last
        way[0], way[1], way[2] = ux / last, uy / last, uz / last
    return best
