"""Tables of shapes by which contacts with walls are found.

Against flat, cylindrical and spherical walls the extreme points of a grain decide: centers of spheres with their radii,
corners of the convex hull, and of smooth solids rims, apices and support points; a spherocylinder has the two spheres
at its ends. In a closed mesh the walls may also protrude into faces of grains: its edges that are reentrant, seen from
inside, are kept in a tree, with the surface of each shape in another.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.contacts.parts import is_disk
from voxgran.containers.model import UNKNOWN, Container, boundary_of
from voxgran.containers.plane import prism_of
from voxgran.geometry.tree import STACK, TriangleTree, grow_tree
from voxgran.geometry.triangles import normals_of
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.mesh import Mesh, Surface
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres
from voxgran.shapes.tessellate import sphere

#: kinds of bodies: points with margins only, and smooth solids, whose support points count too
POINTS, ELLIPSOID, CYLINDER, CONE, SPHEROCYLINDER = 0, 1, 2, 3, 4
SMOOTH = {"ellipsoid": ELLIPSOID, "cylinder": CYLINDER, "cone": CONE, "spherocylinder": SPHEROCYLINDER}
#: points on each rim that turn with the grain, on which it stands; how far the rim reaches beyond them, in its radii
RIM_POINTS = 12
SAGITTA = 1.0 - math.cos(math.pi / RIM_POINTS)
#: least distance of the contacts that are kept where there are many, in diameters of the shape
SPREAD = 0.1
#: subdivisions of the sphere that stands for an ellipsoid in a closed mesh (162 corners)
SUBDIVISIONS = 2
#: rise of a face beyond the plane of its neighbour, in lengths of the edge, above which their edge is reentrant
REENTRANT = 1e-6
#: candidates of one grain at a wall, beyond four for each of its points
MORE_CANDIDATES = 1024


class Lid(NamedTuple):
    """A flat wall with a (3,) normal away from the grains, at a level along it; none where the level is infinite."""

    normal: Floats
    level: float


class MeshSide(NamedTuple):
    """What is needed where the container is a closed mesh; empty otherwise.

    edge, edge_low, edge_high, edge_start: tree of the reentrant edges (e, 3, 3), as triangles whose last two corners
    are equal, of a polygon all three, in the coordinates of the container.
    triangle, node: (s + 1,) first triangles and boxes of each shape.
    corners, normals, low, high, start: trees of the surfaces of the shapes, one after the other.
    closed: (s,) whether the surface encloses a solid.
    stack: (2, 64) boxes that wait, for the edges and for searches.  seen: (4, 6) wall points and normals.
    free: (16, 4) centers and radii of spheres without a wall.
    """

    edge: Floats
    edge_low: Floats
    edge_high: Floats
    edge_start: Integers
    triangle: Integers
    node: Integers
    corners: Floats
    normals: Floats
    low: Floats
    high: Floats
    start: Integers
    closed: Integers
    stack: Integers
    seen: Floats
    free: Floats


class WallBodies(NamedTuple):
    """Shapes as contacts with walls need them, and work space.

    kind: (s,) POINTS, or that of a smooth solid.  start: (s + 1,) first point of each shape.
    point: (p, 3) points relative to the centroids.  margin: (p,) distance of the surface from them.
    size, turn: (s, 3) dimensions and (s, 3, 3) rotation of smooth solids in their body frames.
    spread: (s,) least distance of contacts where there are many.
    frame: (3, 3), found: (k, 8) work space: axes of a smooth solid, and candidates (arm, normal, gap, distance).
    """

    kind: Integers
    start: Integers
    point: Floats
    margin: Floats
    size: Floats
    turn: Floats
    spread: Floats
    frame: Floats
    found: Floats
    mesh: MeshSide


def wall_bodies(shapes: tuple[Shape, ...], container: Container) -> WallBodies:
    """Return the tables of shapes for contacts with the walls of a container and with a lid.

    Parameters
    ----------
    shapes : tuple of Shape
        Shapes of the grains; s of them.
    container : Container
        Container of the grains.

    Returns
    -------
    WallBodies
        Tables in the unit of lengths of the shapes.

    Raises
    ------
    InputError
        If the walls of the container are not known in closed form.
    """
    walls = boundary_of(container)
    if walls is UNKNOWN:
        raise InputError(
            f"container is of kind {container.kind!r}, known by its signed distance only: contacts need its walls in "
            "closed form; use a Box, Cylinder, Sphere or ClosedMesh, in 2D a Rectangle, Disk or Polygon"
        )
    in_mesh = walls.solid is not None
    count = len(shapes)
    kind, size, turn = np.zeros(count, dtype=np.int64), np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    points, margins = [np.zeros((0, 3))], [np.zeros(0)]
    for k, shape in enumerate(shapes):
        geometry = shape.geometry
        if isinstance(geometry, Primitive) and geometry.kind in SMOOTH:
            kind[k], turn[k] = SMOOTH[geometry.kind], geometry.matrix
            size[k, : len(geometry.dimensions)] = geometry.dimensions
        point, margin = _points_of(geometry, in_mesh=in_mesh)
        points.append(point)
        margins.append(margin)
    counts = [len(point) for point in points]
    most = 4 * max(counts) + MORE_CANDIDATES
    return WallBodies(
        *(kind, np.cumsum(counts).astype(np.int64), np.concatenate(points), np.concatenate(margins), size, turn),
        *(np.array([SPREAD * shape.diameter for shape in shapes]), np.zeros((3, 3)), np.zeros((most, 8))),
        _mesh_side(shapes, walls.solid, flat=container.dimension == 2),
    )


def _points_of(geometry: Geometry, *, in_mesh: bool) -> tuple[Floats, Floats]:
    """Return the points (p, 3) of a shape that may touch walls, and their margins (p,)."""
    if isinstance(geometry, Spheres):
        return geometry.centers.copy(), geometry.radii.copy()
    if isinstance(geometry, Primitive) and geometry.kind == "sphere":
        return np.zeros((1, 3)), np.array([geometry.dimensions[0]])
    if isinstance(geometry, Primitive) and geometry.kind == "spherocylinder":
        radius, length = geometry.dimensions
        return np.outer([-length / 2, length / 2], geometry.matrix[:, 2]), np.full(2, radius)
    if isinstance(geometry, Outline):
        if is_disk(geometry):
            return np.array([[*geometry.center, 0.0]]), np.array([geometry.radius])
        points: Floats = np.column_stack([geometry.vertices, np.zeros(len(geometry.vertices))])
    elif isinstance(geometry, Primitive):
        points = _of_primitive(geometry, in_mesh=in_mesh)
    else:
        points = geometry.vertices if in_mesh else _hull_corners(geometry.vertices)
    return points.copy(), np.zeros(len(points))


def _of_primitive(solid: Primitive, *, in_mesh: bool) -> Floats:
    """Return corners, rim points and apex of a primitive other than a sphere."""
    d = solid.dimensions
    if solid.kind == "box":
        return solid.tessellation()[0]
    if solid.kind == "ellipsoid":
        # along the normals of the walls at these points, outside of it, are the support points in a closed mesh
        vertices, _, error = sphere(SUBDIVISIONS)
        points = vertices / (1 - error) * np.array(d) if in_mesh else np.zeros((0, 3))
        return np.asarray(linear.matmul(points, solid.matrix.T))
    angle = 2 * math.pi * np.arange(RIM_POINTS) / RIM_POINTS
    rim = np.column_stack([d[0] * libm.cos(angle), d[0] * libm.sin(angle), np.zeros(RIM_POINTS)])
    if solid.kind == "cylinder":
        middle = np.array([0.0, 0.0, d[1] / 2])
        points = np.concatenate([rim - middle, rim + middle])
    else:
        points = np.concatenate([rim - [0.0, 0.0, d[1] / 4], [[0.0, 0.0, 0.75 * d[1]]]])
    return np.asarray(linear.matmul(points, solid.matrix.T))


def _hull_corners(vertices: Floats) -> Floats:
    """Return the corners of the convex hull of (n, 3) points; all points where they lie in a plane."""
    spatial = load("scipy.spatial")
    try:
        return np.asarray(vertices[np.sort(spatial.ConvexHull(vertices).vertices)])
    except spatial.QhullError:
        return vertices


def _mesh_side(shapes: tuple[Shape, ...], solid: Shape | None, *, flat: bool) -> MeshSide:
    """Return the reentrant edges of a closed mesh and the surfaces of the shapes; empty where there are none.

    If it is `flat`, the walls of a polygon, they are its reentrant corners, as edges without length.
    """
    edges = np.zeros((0, 3, 3))
    if solid is not None:
        assert isinstance(solid.geometry, Mesh)
        edges = reentrant_edges(solid.geometry) + np.array(solid.offset)
        if flat:
            upright = (edges[:, 0, :2] == edges[:, 1, :2]).all(axis=1)
            edges = np.where(np.arange(3) < 2, edges[upright, :1], 0.0).repeat(3, axis=1)
    trees: list[TriangleTree | None] = [_surface_of(shape.geometry) if len(edges) else None for shape in shapes]
    kept = [tree for tree in trees if tree is not None]
    triangle = np.cumsum([0, *(0 if tree is None else len(tree.corners) for tree in trees)]).astype(np.int64)
    node = np.cumsum([0, *(0 if tree is None else len(tree.low) for tree in trees)]).astype(np.int64)
    closed = np.array([not isinstance(shape.geometry, Surface) for shape in shapes], dtype=np.int64)
    box, span = np.zeros((0, 3)), np.zeros((0, 2), dtype=np.int64)
    edge_tree = (edges, box, box.copy(), span)
    if len(edges):
        tree = grow_tree(edges.reshape(-1, 3), np.arange(3 * len(edges)).reshape(-1, 3))
        edge_tree = (tree.corners.copy(), tree.low.copy(), tree.high.copy(), tree.start.copy())
    return MeshSide(
        *edge_tree,
        *(triangle, node),
        np.concatenate([np.zeros((0, 3, 3)), *(tree.corners for tree in kept)]),
        np.concatenate([np.zeros((0, 7, 3)), *(tree.normals for tree in kept)]),
        *(np.concatenate([box, *(tree.low for tree in kept)]), np.concatenate([box, *(tree.high for tree in kept)])),
        np.concatenate([span, *(tree.start for tree in kept)]),
        closed,
        np.zeros((2, STACK), dtype=np.int64),
        np.zeros((4, 6)),
        np.zeros((16, 4)),
    )


def _surface_of(geometry: Geometry) -> TriangleTree | None:
    """Return the tree of the surface of a mesh, a box or the prism upon a polygon; None of others.

    Their distances have closed forms.
    """
    if isinstance(geometry, Mesh | Surface):
        return geometry.tree
    if isinstance(geometry, Primitive) and geometry.kind == "box":
        return grow_tree(*geometry.tessellation()[:2])
    if isinstance(geometry, Outline) and not is_disk(geometry):
        # so high that points within are nearer to the sides than to the ends
        return prism_of([geometry.vertices], 2 * geometry.bounding_radius).tree
    return None


def reentrant_edges(mesh: Mesh) -> Floats:
    """Return the edges (e, 3, 3) of a closed mesh that protrude into it, each as its two ends and the second again."""
    faces, triangles = mesh.faces, mesh.triangles
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    key = ends.min(axis=1) * (int(faces.max(initial=0)) + 1) + ends.max(axis=1)
    order = np.argsort(key, kind="stable")
    first = order[np.flatnonzero(np.diff(key[order], prepend=-1))]
    count = np.bincount(np.unique(key, return_inverse=True)[1])
    second = order[np.flatnonzero(np.diff(key[order], prepend=-1)) + np.minimum(count - 1, 1)]
    normal = normals_of(triangles)
    normal /= np.maximum(linear.norm(normal, axis=1, keepdims=True), 1e-300)
    one, other = first // 3, second // 3
    start, stop = mesh.vertices[ends[first, 0]], mesh.vertices[ends[first, 1]]
    apex = triangles[other, (second % 3 + 2) % 3]
    rise = linear.einsum("ei,ei->e", apex - start, normal[one])
    chosen = (rise > REENTRANT * linear.norm(stop - start, axis=1)) | (count != 2)
    return np.asarray(np.stack([start, stop, stop], axis=1)[chosen])
