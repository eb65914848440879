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

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.shapes.generating.hulls import hull_of_corners
from voxgran.shapes.learning.warp import frame_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.repairing.simplify import decimated, simplify

#: root mean square distances, in voxels, up to which a surface of labels is that of a smooth or of a convex solid with
#: the steps of an image: these give 0.14 to 0.2, and edges and the seams between neighbours, which are rounded, more
SMOOTH, CONVEX = 0.25, 0.32
#: how many of the grains must be, by their weights, and how many times as far others are that stay as they are
MOST, OTHER = 0.9, 2.0
#: least share of its convex hull that a convex solid fills, as labels of needles of two voxels do
FILLED = 0.5
#: distance, in voxels, that fewer triangles may add to that of a convex polyhedron, and numbers of them that are tried
ADDED, TRIANGLES = 0.15, (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
#: numbers of triangles, and the ratio of their distances from which a convex solid is curved: with flat faces the steps
#: keep both alike
FEW, MANY, CURVED = 48, 192, 1.6
#: relative error of the volume of a hull, and most steps to it
ACCURACY, MOST_STEPS = 1e-9, 20


def without_steps(shapes: Sequence[Shape], weights: Floats, voxel: float, faces: int) -> tuple[Shape, ...] | None:
    """Return the solids, of the same volumes, that grains of an image are but for its steps; None of others.

    Single grains that are quite another, as two that were not parted, stay meshes of at most `faces` triangles. Convex
    polyhedra have the fewest, at most `faces`, that explain the voxels about as well as more of them: these follow the
    steps, and make corners and edges round. Those of curved solids have `faces`.
    """
    kinds: tuple[tuple[Callable[[Shape], tuple[Shape, float]], float], ...] = (
        (partial(_smooth, kind="sphere"), SMOOTH),
        (partial(_smooth, kind="ellipsoid"), SMOOTH),
        (partial(_convex, faces=faces, added=ADDED * voxel), CONVEX),
    )
    for made, limit in kinds:
        found: list[tuple[Shape, float]] = []
        far = 0.0
        for shape, weight in zip(shapes, weights.tolist(), strict=True):
            found.append(made(shape))
            far += 0.0 if found[-1][1] <= limit * voxel else weight
            if far > (1.0 - MOST + 1e-12) * weights.sum():
                break
        else:
            return tuple(
                solid if distance <= OTHER * limit * voxel else simplify(shape, faces=faces).shape
                for shape, (solid, distance) in zip(shapes, found, strict=True)
            )
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
    """Return the convex polyhedron of fewest triangles that are about as near to a mesh as `faces` are, of a curved one
    that of `faces`, and the root mean square of the distances of vertices from the planes of the latter.
    """
    hull = _sunk_hull(shape)
    if hull is None:
        return shape, np.inf
    # each collapse of the whole hull costs more than all that follow
    hull = _reduced(shape, hull, max(faces, MANY))[0]
    made, least = _reduced(shape, hull, faces)
    if _reduced(shape, hull, FEW)[1] <= CURVED * _reduced(shape, hull, MANY)[1]:
        rows = [many for many in TRIANGLES if many < faces]
        limit = np.hypot(least, added)
        best = bisect_left(rows, True, key=lambda many: _reduced(shape, hull, many)[1] <= limit)
        made = _reduced(shape, hull, rows[best])[0] if best < len(rows) else made
    return Shape.of(made, name=shape.name, unit=shape.unit), least


def _reduced(shape: Shape, hull: Mesh, faces: int) -> tuple[Mesh, float]:
    """Return a hull with fewer triangles, at the volume of the mesh it was made of, and the root mean square of the
    distances of vertices from its planes; the hull itself, infinitely far, where no solid is found.
    """
    size = float(np.ptp(hull.vertices))
    try:
        solid = hull_of_corners(size * decimated(hull.vertices / size, hull.faces, faces)[0])
    except load("scipy.spatial").QhullError:
        solid = hull
    if len(solid.faces) > faces:
        return hull, np.inf
    solid = Mesh(solid.vertices * np.cbrt(shape.volume / solid.volume), solid.faces)
    planes = load("scipy.spatial").ConvexHull(solid.vertices).equations
    depth = (shape.vertices @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    return solid, float(np.sqrt((depth**2).mean()))


def _sunk_hull(shape: Shape) -> Mesh | None:
    """Return the convex hull of a mesh whose planes are moved inwards, all by the same way, until it has its volume;
    None of a mesh that fills less than `FILLED` of its hull, which is no convex one, however thin it is.

    The highest of the steps of each side lie on the hull. Planes move by less than `1 - FILLED` of the volume over the
    area, and the centroid is deeper: its depth is at least a quarter of the width, which is at least twice the radius
    of the largest sphere inside, and that is at least the volume over the area.
    """
    spatial = load("scipy.spatial")
    hull, corners = spatial.ConvexHull(shape.vertices), shape.vertices
    if shape.volume < FILLED * hull.volume:
        return None
    planes = hull.equations.copy()
    for _ in range(MOST_STEPS):
        excess = hull.volume - shape.volume
        if abs(excess) <= ACCURACY * shape.volume:
            break
        planes[:, 3] += excess / hull.area
        corners = spatial.HalfspaceIntersection(planes, _centroid(corners, hull.simplices)).intersections
        hull = spatial.ConvexHull(corners)
    return hull_of_corners(corners[hull.vertices])


def _centroid(corners: Floats, triangles: Integers) -> Floats:
    """Return the centroid of a convex solid whose triangles are turned in any way."""
    middle = corners[triangles].mean(axis=(0, 1))
    cones = corners[triangles] - middle
    volumes = np.abs(np.linalg.det(cones))
    return np.asarray(middle + volumes @ cones.sum(axis=1) / 4.0 / volumes.sum())
