"""Grains of an image without its steps: spheres, ellipsoids or convex polyhedra where these explain the voxels.

An image gives grains steps, which no smoothing of surfaces takes away whole. Packed with them the grains need less
friction to become as dense, and then have more contacts; convex grains are no longer convex, and cost many times as
much.
"""

from bisect import bisect_left
from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.shapes.generating.hulls import hull_of_corners
from voxgran.shapes.learning.warp import frame_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.repairing.simplify import decimated

#: root mean square distances, in voxels, up to which a surface of labels is that of a smooth or of a convex solid with
#: the steps of an image: these give 0.14 to 0.2, and edges and the seams between neighbours, which are rounded, more
SMOOTH, CONVEX = 0.25, 0.35
#: how many of the grains must be, by their weights
MOST = 0.9
#: distance, in voxels, that fewer triangles may add to that of a convex polyhedron, and numbers of them that are tried
ADDED, TRIANGLES = 0.15, (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
#: relative error of the volume of a hull, and most steps to it
ACCURACY, MOST_STEPS = 1e-9, 20


def without_steps(shapes: Sequence[Shape], weights: Floats, voxel: float, faces: int) -> tuple[Shape, ...] | None:
    """Return the solids, of the same volumes, that grains of an image are but for its steps; None of others.

    Convex polyhedra have the fewest triangles, at most `faces`, that explain the voxels about as well as more of them:
    these follow the steps, and make corners and edges round.
    """
    kinds: tuple[tuple[Callable[[Shape], tuple[Shape, float]], float], ...] = (
        (partial(_smooth, kind="sphere"), SMOOTH),
        (partial(_smooth, kind="ellipsoid"), SMOOTH),
        (partial(_convex, faces=faces, added=ADDED * voxel), CONVEX),
    )
    for made, limit in kinds:
        found, far = [], 0.0
        for shape, weight in zip(shapes, weights.tolist(), strict=True):
            solid, distance = made(shape)
            found.append(solid)
            far += weight if distance > limit * voxel else 0.0
            if far > (1.0 - MOST) * weights.sum():
                break
        else:
            return tuple(found)
    return None


def _smooth(shape: Shape, kind: Literal["sphere", "ellipsoid"]) -> tuple[Shape, float]:
    """Return the sphere, or the ellipsoid of the second moments, of a mesh with its volume, and the root mean square of
    the distances of vertices from it, to first order.
    """
    radius, centre, moments, axes = frame_of(Mesh(shape.vertices, shape.faces))
    half = np.full(3, radius) if kind == "sphere" else radius * moments / np.cbrt(moments.prod())
    place = (shape.vertices - centre) @ axes / half
    length = np.linalg.norm(place, axis=1)
    distance = (length - 1.0) * length / np.linalg.norm(place / half, axis=1)
    sizes = (radius,) if kind == "sphere" else tuple(half.tolist())
    made = Shape.of(Primitive(kind, sizes), name=shape.name, unit=shape.unit)
    return made, float(np.sqrt((distance**2).mean()))


def _convex(shape: Shape, faces: int, added: float) -> tuple[Shape, float]:
    """Return the convex polyhedron of fewest triangles that are about as near to a mesh as `faces` are, and the root
    mean square of the distances of vertices from the planes of the latter.
    """
    hull = _sunk_hull(shape)
    made, least = _reduced(shape, hull, faces)
    rows = [many for many in TRIANGLES if many < faces]
    limit = np.hypot(least, added)
    best = bisect_left(rows, True, key=lambda many: _reduced(shape, hull, many)[1] <= limit)
    made = _reduced(shape, hull, rows[best])[0] if best < len(rows) else made
    return Shape.of(made, name=shape.name, unit=shape.unit), least


def _reduced(shape: Shape, hull: Mesh, faces: int) -> tuple[Mesh, float]:
    """Return a hull with fewer triangles, at the volume of the mesh it was made of, and the root mean square of the
    distances of vertices from its planes.
    """
    size = float(np.ptp(hull.vertices))
    solid = hull_of_corners(size * decimated(hull.vertices / size, hull.faces, faces)[0])
    solid = Mesh(solid.vertices * np.cbrt(shape.volume / solid.volume), solid.faces)
    planes = load("scipy.spatial").ConvexHull(solid.vertices).equations
    depth = (shape.vertices @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    return solid, float(np.sqrt((depth**2).mean()))


def _sunk_hull(shape: Shape) -> Mesh:
    """Return the convex hull of a mesh whose planes are moved inwards, all by the same way, until it has its volume.

    The highest of the steps of each side lie on the hull.
    """
    spatial = load("scipy.spatial")
    hull = spatial.ConvexHull(shape.vertices)
    planes, corners, inside = hull.equations.copy(), shape.vertices, shape.vertices[hull.vertices].mean(axis=0)
    for _ in range(MOST_STEPS):
        excess = hull.volume - shape.volume
        if abs(excess) <= ACCURACY * shape.volume:
            break
        planes[:, 3] += excess / hull.area
        corners = spatial.HalfspaceIntersection(planes, inside).intersections
        hull = spatial.ConvexHull(corners)
    return hull_of_corners(corners[hull.vertices])
