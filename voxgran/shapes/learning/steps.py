"""Grains of an image without its steps: spheres, ellipsoids or convex polyhedra where these explain the voxels.

An image gives grains steps, which no smoothing of surfaces takes away whole. Packed with them the grains need less
friction to become as dense, and then have more contacts; convex grains are no longer convex, and cost many times as
much.
"""

from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.scalars import cube_root
from voxgran.lattice.label_volumes import PARTS
from voxgran.shapes.generating.hulls import hull_of_corners
from voxgran.shapes.learning.warp import frame_of
from voxgran.shapes.mesh import LatticePoints, Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.repairing.simplify import decimated

SPHERE, ELLIPSOID, CONVEX, LABELS = "sphere", "ellipsoid", "convex", "labels"
#: root mean square distances, in voxels, up to which a surface of labels is that of a smooth or of a convex solid with
#: the steps of an image: these give 0.14 to 0.2, and edges and the seams between neighbours, which are rounded, more
KINDS = {SPHERE: 0.25, ELLIPSOID: 0.25, CONVEX: 0.32}
#: how many of the grains must be, by their weights, and how many times as far others are that stay as they are
MOST, OTHER = 0.9, 2.0
#: voxels from which on the surface of a label tells what it is
FEW = 27
#: least share of its convex hull that a convex solid fills, as labels of needles of two voxels do
FILLED = 0.5
#: distance, in voxels, that fewer triangles may add to that of a convex polyhedron, and numbers of them that are tried
ADDED, TRIANGLES = 0.15, (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
#: numbers of triangles, and the ratio of their distances from which a convex solid is curved: with flat faces the steps
#: keep both alike
FLAT, MANY, CURVED = 48, 192, 1.6
#: relative error of the volume of a hull, and most steps to it
ACCURACY, MOST_STEPS = 1e-9, 20


def voxel_of(shape: Shape) -> Floats | None:
    """Return the edges (3,) of the voxels of the image whose label a shape is; None of others, and of turned ones."""
    points = shape.geometry.points if isinstance(shape.geometry, Mesh) else None
    return points.step * PARTS if isinstance(points, LatticePoints) else None


def without_steps(
    shapes: Sequence[Shape], weights: Floats, faces: int, kinds: Sequence[str] = tuple(KINDS)
) -> tuple[str | None, tuple[Shape, ...]]:
    """Return which of the kinds grains of an image are but for its steps, and the solids of that kind with the same
    volumes; ``LABELS`` of others and None of what is no label, with the grains as they are.

    Single grains that are quite another, as two that were not parted, stay as they are. A single kind is not chosen but
    asked for, of the grains of another sample. Convex polyhedra have the fewest triangles, at most `faces`, that
    explain the voxels about as well as more of them: these follow the steps, and make corners and edges round. Those of
    curved solids have `faces`.
    """
    edges = [voxel for voxel in map(voxel_of, shapes) if voxel is not None]
    if len(edges) < len(shapes):
        return None, tuple(shapes)
    # labels of a few voxels are of any kind
    known = weights * [shape.volume >= FEW * voxel.prod() for shape, voxel in zip(shapes, edges, strict=True)]
    votes = known if known.any() else weights
    most = (1.0 - MOST + 1e-12) * votes.sum() if len(kinds) > 1 else np.inf
    for kind in (one for one in kinds if one in KINDS):
        found: list[tuple[Shape, float]] = []
        far = 0.0
        for shape, voxel, vote in zip(shapes, edges, votes.tolist(), strict=True):
            found.append(_convex(shape, voxel, faces) if kind == CONVEX else _smooth(shape, voxel, kind))
            far += 0.0 if found[-1][1] <= KINDS[kind] else vote
            if far > most:
                break
        else:
            return kind, tuple(
                solid if distance <= OTHER * KINDS[kind] else shape
                for shape, (solid, distance) in zip(shapes, found, strict=True)
            )
    return LABELS, tuple(shapes)


def _smooth(shape: Shape, voxel: Floats, kind: str) -> tuple[Shape, float]:
    """Return the sphere, or the ellipsoid of the second moments, of a mesh with its volume, and the root mean square of
    the distances of vertices from it in voxels, to first order.
    """
    radius, centre, moments, axes = frame_of(Mesh(shape.vertices, shape.faces))
    half = np.full(3, radius) if kind == SPHERE else radius * moments / cube_root(moments.prod())
    place = linear.matmul(shape.vertices - centre, axes) / half
    length = linear.norm(place, axis=1)
    # the gradient by places in the lattice: where voxels are not cubes, their edges stretch it
    distance = (length - 1.0) * length / linear.norm(linear.matmul(place / half, axes.T) * voxel, axis=1)
    made = Primitive("sphere", (radius,)) if kind == SPHERE else Primitive("ellipsoid", tuple(half.tolist()))
    return Shape.of(made, name=shape.name, unit=shape.unit), float(np.sqrt((distance**2).mean()))


def _convex(shape: Shape, voxel: Floats, faces: int) -> tuple[Shape, float]:
    """Return the convex polyhedron of fewest triangles that are about as near to a mesh as `faces` are, of a curved one
    that of `faces`, and the root mean square of the distances of vertices from the planes of the latter, in voxels.

    It is found in the lattice of the image, in which steps are as high along all axes, and convex solids are convex.
    """
    label = Mesh(shape.vertices / voxel, shape.faces)
    hull = _sunk_hull(label)
    if hull is None:
        return shape, np.inf
    # each collapse of the whole hull costs more than all that follow
    hull = _reduced(label, hull, max(faces, MANY))[0]
    made, least = _reduced(label, hull, faces)
    if _reduced(label, hull, FLAT)[1] <= CURVED * _reduced(label, hull, MANY)[1]:
        rows = [many for many in TRIANGLES if many < faces]
        limit = np.hypot(least, ADDED)
        best = bisect_left(rows, True, key=lambda many: _reduced(label, hull, many)[1] <= limit)
        made = _reduced(label, hull, rows[best])[0] if best < len(rows) else made
    return Shape.of(Mesh(made.vertices * voxel, made.faces), name=shape.name, unit=shape.unit), least


def _reduced(label: Mesh, hull: Mesh, faces: int) -> tuple[Mesh, float]:
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
    solid = Mesh(solid.vertices * cube_root(label.volume / solid.volume), solid.faces)
    planes = load("scipy.spatial").ConvexHull(solid.vertices).equations
    depth = (linear.matmul(label.vertices, planes[:, :3].T) + planes[:, 3]).max(axis=1)
    return solid, float(np.sqrt((depth**2).mean()))


def _sunk_hull(label: Mesh) -> Mesh | None:
    """Return the convex hull of a mesh whose planes are moved inwards, all by the same way, until it has its volume;
    None of a mesh that fills less than `FILLED` of its hull, which is no convex one, however thin it is.

    The highest of the steps of each side lie on the hull. Planes move by less than `1 - FILLED` of the volume over the
    area, and the centroid is deeper: its depth is at least a quarter of the width, which is at least twice the radius
    of the largest sphere inside, and that is at least the volume over the area.
    """
    spatial = load("scipy.spatial")
    hull, corners = spatial.ConvexHull(label.vertices), label.vertices
    if label.volume < FILLED * hull.volume:
        return None
    planes = hull.equations.copy()
    for _ in range(MOST_STEPS):
        excess = hull.volume - label.volume
        if abs(excess) <= ACCURACY * label.volume:
            break
        planes[:, 3] += excess / hull.area
        corners = spatial.HalfspaceIntersection(planes, _centroid(corners, hull.simplices)).intersections
        hull = spatial.ConvexHull(corners)
    return hull_of_corners(corners[hull.vertices])


def _centroid(corners: Floats, triangles: Integers) -> Floats:
    """Return the centroid of a convex solid whose triangles are turned in any way."""
    middle = corners[triangles].mean(axis=(0, 1))
    cones = corners[triangles] - middle
    volumes = np.abs(linear.determinant(cones))
    return np.asarray(middle + linear.matmul(volumes, cones.sum(axis=1)) / 4.0 / volumes.sum())
