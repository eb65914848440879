"""True shapes as tables of convex parts, in bounding spheres, for the tests of overlap of random sequential addition.

A convex solid is one part and a union of spheres has one for each sphere. A mesh that is not convex has one for each
triangle, and its convex hull, by which most pairs are found to be apart. An outline in the plane is a prism upon it, of
which the upper and lower ends are far from all contacts, and a disk is a sphere. The parts of a shape are the leaves of
a tree of bounding spheres. A closed container that is a mesh is one more shape.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.contacts.inside import inner_distance
from voxgran.contacts.manifolds.convex_bodies import ConvexBodies, convex_bodies
from voxgran.containers.model import Container, boundary_of, periods_of
from voxgran.containers.plane import prism_of
from voxgran.geometry.gjk import Simplex, new_simplex
from voxgran.geometry.periods import face_distances
from voxgran.geometry.support import BOX, POINT, ROW
from voxgran.geometry.tree import STACK, TriangleTree, grow_tree
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

#: pairs of boxes that wait in a search through two trees
WAITING = 256
#: share of an inner radius that is left out for rounding
ROUNDING = 1e-12
#: a sphere of radius 1, the shape after those of the grains
UNIT_SPHERE = Shape(Spheres(np.zeros((1, 3)), np.ones(1)), "sphere")


class PairWork(NamedTuple):
    """Arrays that the kernels work with.

    corner: (k, 3) corners of all shapes, then room for those of one part.  row: (s + 1, 13) rows of all shapes, then
    one of one part.  simplex: of the distance of two parts.  quaternion: (4,), turn: (3, 3) rotation of the new grain.
    other: (3, 3) that of another grain, and relative: (3, 3) from the frame of the other to that of the new one.
    stack: pairs of boxes; boxes: boxes.  place: (m, 4) vectors to near grains, with squared distances in sums of the
    radii, and grain: (m,) their numbers.
    """

    corner: Floats
    row: Floats
    simplex: Simplex
    quaternion: Floats
    turn: Floats
    other: Floats
    relative: Floats
    stack: Integers
    boxes: Integers
    place: Floats
    grain: Integers


class TrueShapes(NamedTuple):
    """Shapes and grains as the kernels take them; lengths of shapes are at equivalent diameter 1.

    After the s shapes of the grains come a sphere of radius 1 and, where the container is a mesh, its walls.

    shape: (n,) shape of each grain.  scale: (n,) its diameter.  inner: (n,) radius of a sphere about the centroid
    inside it, 0 without.  orientation: (n, 4), written when a grain is placed.
    turns: (s,) whether a shape is not a sphere; the caller clears it where grains have their orientations already.
    bounding: (s,) bounding radii.  hull: (s,) the part that contains the whole shape, -1 without.  closed: (s,) whether
    triangles enclose the shape.  box: (s, 3) half edges of boxes along the axes of the shape, 0 for others.
    first: (s + 1, 3) first part, first box and first triangle of each shape.
    part: (p, 4) kind, first corner, end of corners, first corner in the tables.  margin: (p,) distance of the surface
    from the core.  part_sphere: (p, 4) bounding spheres.  sphere: (k, 4) and rows: (k, 2) bounding spheres and parts of
    the boxes of the trees.
    low, high, start, triangle, pseudo: boxes and triangles of closed meshes as those of `TriangleTree`.
    outer: (c, 3) one corner of each component of the walls of a container that is a mesh, the last shape.
    """

    shape: Integers
    scale: Floats
    inner: Floats
    orientation: Floats
    turns: Integers
    bounding: Floats
    hull: Integers
    closed: Integers
    box: Floats
    first: Integers
    part: Integers
    margin: Floats
    part_sphere: Floats
    sphere: Floats
    rows: Integers
    low: Floats
    high: Floats
    start: Integers
    triangle: Floats
    pseudo: Floats
    outer: Floats
    bodies: ConvexBodies
    work: PairWork


class _Body(NamedTuple):
    """Parts of one shape and its trees; indices count from the first of the shape."""

    hull: int
    part: Integers
    margin: Floats
    part_sphere: Floats
    sphere: Floats
    rows: Integers
    tree: TriangleTree | None
    corner: Floats  # of triangles, beyond those of the tables of convex shapes


def true_shapes(
    shapes: Sequence[Shape], container: Container, shape_id: Integers, diameter: Floats, inner: Floats
) -> TrueShapes:
    """Return the tables of shapes of equivalent diameter 1, and of the walls where they are a mesh.

    The orientations are those of no grain; the caller replaces them.
    """
    solids, wall = [*(_solid_of(shape) for shape in shapes), UNIT_SPHERE], boundary_of(container).solid
    if wall is not None:
        solids.append(wall)
    bodies = convex_bodies(solids, hulls=True, faces=False)
    made: list[_Body] = []
    corners = len(bodies.corner)
    widest = 2 * float(diameter.max(initial=0.0)) * max(shape.bounding_radius for shape in shapes)
    images = [math.ceil(2 * widest / length) + 1 for length in face_distances(periods_of(container))]
    near = len(shape_id) * math.prod(images) + 1
    for k, solid in enumerate(solids):
        body = _body_of(solid, bodies, k, corners, walls=k > len(shapes))
        corners += len(body.corner)
        made.append(body)
    counts = [(len(body.part), len(body.sphere), 0 if body.tree is None else len(body.tree.corners)) for body in made]
    first = np.concatenate([np.zeros((1, 3), dtype=np.int64), np.cumsum(counts, axis=0, dtype=np.int64)])
    trees = [body.tree if body.tree is not None else _no_tree(len(body.sphere)) for body in made]
    return TrueShapes(
        *(shape_id.astype(np.int64), diameter, inner, np.zeros((0, 4))),
        turns=np.array([not shape.is_sphere for shape in shapes], dtype=np.int64),
        bounding=np.array([shape.bounding_radius for shape in shapes]),
        hull=np.array([body.hull + at if body.hull >= 0 else -1 for body, at in zip(made, first[:, 0], strict=False)]),
        closed=np.array([body.tree is not None for body in made], dtype=np.int64),
        box=np.array([_half_edges(solid) for solid in solids]),
        first=first,
        part=np.concatenate([body.part for body in made]),
        margin=np.concatenate([body.margin for body in made]),
        part_sphere=np.concatenate([body.part_sphere for body in made]),
        sphere=np.concatenate([body.sphere for body in made]),
        rows=np.concatenate([body.rows + at for body, at in zip(made, first[:, 0], strict=False)]),
        low=np.concatenate([tree.low for tree in trees]),
        high=np.concatenate([tree.high for tree in trees]),
        start=np.concatenate([tree.start for tree in trees]),
        triangle=np.concatenate([tree.corners for tree in trees]),
        pseudo=np.concatenate([tree.normals for tree in trees]),
        outer=np.zeros((0, 3)) if wall is None else _components(wall),
        bodies=bodies,
        work=_work(np.concatenate([bodies.corner, *(body.corner for body in made)]), bodies, near),
    )


def inner_radius(shape: Shape) -> float:
    """Return the radius of a sphere about the centroid inside a shape, a little less for rounding; 0 without."""
    depth = float(inner_distance(shape.geometry)(np.zeros((1, 3)))[0])
    return max(depth, 0.0) * (1.0 if shape.is_sphere else 1.0 - ROUNDING)


def part_count(shape: Shape) -> int:
    """Return the number of convex parts of a shape."""
    solid = _solid_of(shape)
    if isinstance(solid.geometry, Spheres):
        return len(solid.geometry.radii)
    return len(solid.faces) if isinstance(solid.geometry, Mesh) and not _fills_hull(solid) else 1


def _solid_of(shape: Shape) -> Shape:
    """Return a shape, or the prism upon an outline that is not a disk."""
    geometry = shape.geometry
    if isinstance(geometry, Outline) and geometry.kind == "polygon":
        return Shape(prism_of([geometry.vertices], geometry.bounding_radius), shape.name)
    if isinstance(geometry, Outline):
        return Shape(Spheres(np.array([[*geometry.center, 0.0]]), np.array([geometry.radius])), shape.name)
    return shape


def _half_edges(solid: Shape) -> Floats:
    """Return half the edges of a box along the axes of its frame; 0 for other shapes."""
    geometry = solid.geometry
    if isinstance(geometry, Primitive) and geometry.kind == "box" and geometry.rotation == (1.0, 0.0, 0.0, 0.0):
        return np.array(geometry.dimensions) / 2
    return np.zeros(3)


def _body_of(solid: Shape, bodies: ConvexBodies, k: int, corners: int, *, walls: bool) -> _Body:
    """Return the parts of solid k of the tables; those of a mesh are triangles, whose first corner is `corners`."""
    geometry, lo, hi = solid.geometry, int(bodies.first[k]), int(bodies.first[k + 1])
    kind, none = int(bodies.kind[k]), np.zeros((0, 3))
    mesh = isinstance(geometry, Mesh) and (walls or not _fills_hull(solid))
    if not mesh and kind != POINT:
        around = np.array([[0.0, 0.0, 0.0, solid.bounding_radius]])
        part = np.array([[kind, lo, hi, lo]], dtype=np.int64)
        # corners of a spherocylinder have radii
        margin = bodies.radius[lo : lo + 1] if hi > lo else np.zeros(1)
        return _Body(0, part, margin, around, around, np.array([[0, 1]]), None, none)
    if not mesh:
        centers, radii = bodies.corner[lo:hi], bodies.radius[lo:hi]
        tree = grow_tree(centers, np.repeat(np.arange(hi - lo)[:, None], 3, axis=1))
        own = lo + tree.face
        part = np.column_stack([np.full(hi - lo, POINT), own, own + 1, own]).astype(np.int64)
        spheres = np.column_stack([bodies.corner[own], bodies.radius[own]])
        around = _spheres_around(tree, spheres[:, 3])
        return _Body(0 if len(radii) == 1 else -1, part, bodies.radius[own], spheres, around, tree.start, None, none)
    assert isinstance(geometry, Mesh)
    tree = geometry.tree
    many = len(tree.corners)
    at = corners + 3 * np.arange(many)
    part = np.column_stack([np.full(many, BOX), at, at + 3, np.full(many, lo)])
    middle = tree.corners.mean(axis=1)
    spheres = np.column_stack([middle, linear.norm(tree.corners - middle[:, None], axis=2).max(axis=1)])
    sphere, hull = _spheres_around(tree, np.zeros(many)), -1
    if not walls:
        # the hull is the part after the triangles, which is in no box
        hull, part = many, np.vstack([part, [[BOX, lo, hi, lo]]])
        spheres = np.vstack([spheres, [[0.0, 0.0, 0.0, solid.bounding_radius]]])
    return _Body(hull, part, np.zeros(len(part)), spheres, sphere, tree.start, tree, tree.corners.reshape(-1, 3))


def _fills_hull(solid: Shape) -> bool:
    """Return whether a mesh is the same as its convex hull but for rounding."""
    used = solid.vertices[np.unique(solid.faces)]
    hull = load("scipy.spatial").ConvexHull(used)
    return bool(hull.volume - solid.volume <= ROUNDING * hull.volume)


def _spheres_around(tree: TriangleTree, margins: Floats) -> Floats:
    """Return the bounding spheres of the contents of the boxes of a tree, (k, 4)."""
    center = (tree.low + tree.high) / 2
    found = np.zeros((len(center), 4))
    for k, (begin, end) in enumerate(tree.start.tolist()):
        far = linear.norm(tree.corners[begin:end] - center[k], axis=2).max(axis=1) + margins[begin:end]
        found[k, :3], found[k, 3] = center[k], far.max(initial=0.0)
    return found


def _no_tree(boxes: int) -> TriangleTree:
    """Return a tree without triangles, with as many boxes as that of a shape."""
    none = np.zeros((boxes, 3))
    triangles = np.zeros((0, 3, 3)), np.zeros((0, 7, 3))
    return TriangleTree(*triangles, none, none, np.zeros((boxes, 2), dtype=np.int64), np.zeros(0, dtype=np.int64))


def _components(wall: Shape) -> Floats:
    """Return one corner of each component of a closed mesh, (c, 3)."""
    faces, n = wall.faces, len(wall.vertices)
    ends = faces[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = load("scipy.sparse").coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n))
    label: NDArray[np.int32] = load("scipy.sparse.csgraph").connected_components(graph, directed=False)[1]
    used = np.unique(faces)
    return np.asarray(wall.vertices[used[np.unique(label[used], return_index=True)[1]]])


def _work(corners: Floats, bodies: ConvexBodies, near: int) -> PairWork:
    """Return the arrays that the kernels work with, for all these corners, room for one part, and so many grains."""
    room = max(3, int(np.diff(bodies.first).max(initial=0)))
    return PairWork(
        corner=np.concatenate([corners, np.zeros((room, 3))]),
        row=np.concatenate([bodies.row, np.zeros((1, ROW))]),
        simplex=new_simplex(),
        quaternion=np.zeros(4),
        turn=np.zeros((3, 3)),
        other=np.zeros((3, 3)),
        relative=np.zeros((3, 3)),
        stack=np.zeros((WAITING, 2), dtype=np.int64),
        boxes=np.zeros(STACK, dtype=np.int64),
        # untouched zeros take no memory
        place=np.zeros((near, 4)),
        grain=np.zeros(near, dtype=np.int64),
    )
