"""Tables of shapes for the contacts of surfaces: points on surfaces, grids of signed distance, and triangles.

Lengths are in the unit of each shape. The points lie at corners and along sharp and long edges and are held by two
levels of bounding spheres; a grid holds the signed distance at lattice points in single precision, between which it is
interpolated. Unions of spheres have their centers as points, with the radii as skins, and no grid: they are tested one
way, against the grids of others. Ellipsoids, cylinders and cones are represented by their tessellation, whose error is
added as a skin, so that exact tests never overestimate their gaps.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran._base.stopping import stop_if_asked
from voxgran.geometry.tree import TriangleTree, grow_tree
from voxgran.geometry.triangles import normals_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

#: cells of a grid along the longest side of a shape, and cells beyond it on each side
CELLS, FRINGE = 36, 2
#: spacing of the points, and edges of the cubes whose points share a bounding sphere, in equivalent diameters
SPACING, FINE, COARSE = 0.07, 0.21, 0.42
#: spacing of points in faces, in spacings of the others
WIDE = 3.0
#: cosine between faces below which their common edge is sharp, and below which it is no edge within a plane
SHARP, BENT = 0.94, 0.9998


class SurfaceBodies(NamedTuple):
    """Tables of s shapes, one after the other.

    first: (s + 1, 5) first rows of each shape in: point, cluster, grid, corner and sphere.
    frame: (s, 9) numbers of cells of the grid (3), 0 without one, its origin (3) and the edge of a cell; then 1 where
    triangles enclose the shape, 0 for spheres; and 1 where triangles or spheres are the true surface.
    point: (p, 4) points and skins.  cluster: (c, 4) bounding spheres.  cluster_rows: (c, 3): first point, the one
    after the last, and the next cluster where this one is skipped; a cluster without points holds those up to it.
    grid: (g,) signed distances, the last axis fastest.
    corner: (t, 3, 3) triangles in the order of their trees; a sphere is a triangle of three equal corners.
    skin: (t, 5) distance of the surface from the triangle, and a bounding sphere of the triangle with its skin.
    pseudo: (t, 7, 3) pseudo-normals as `TriangleTree.normals`.  fan: (f, 3) unit vectors along the edges that leave a
    corner.  fan_rows: (t, 3, 2) the rows of `fan` of each corner of a triangle.
    low, high: (k, 3) boxes of the trees.  sphere: (k, 4) bounding spheres of their contents.  box_rows: (k, 2) their
    triangles.
    """

    first: Integers
    frame: Floats
    point: Floats
    cluster: Floats
    cluster_rows: Integers
    grid: NDArray[np.float32]
    corner: Floats
    skin: Floats
    pseudo: Floats
    fan: Floats
    fan_rows: Integers
    low: Floats
    high: Floats
    sphere: Floats
    box_rows: Integers


def surface_bodies(shapes: Sequence[Shape], *, cells: int = CELLS, spacing: float = SPACING) -> SurfaceBodies:
    """Return the tables of shapes.

    Parameters
    ----------
    shapes : sequence of Shape
        Solids in three dimensions: meshes, primitives and unions of spheres.
    cells : int
        Cells of a grid along the longest side of a shape.
    spacing : float
        Spacing of the points on a surface, in equivalent diameters.

    Returns
    -------
    SurfaceBodies

    Raises
    ------
    InputError
        If a shape is flat or an open surface.
    Stopped
        If a stop of the run was requested.
    """
    return _tables(tuple(shapes), cells, spacing)


@lru_cache(maxsize=1)
def _tables(shapes: tuple[Shape, ...], cells: int, spacing: float) -> SurfaceBodies:
    """Return the tables of shapes, which beds that are made again and again, as in a search, have in common."""
    parts: list[tuple[NDArray[Any], ...]] = []
    for shape in shapes:
        stop_if_asked()
        if shape.dimension != 3 or shape.is_open:
            kind = "an open surface" if shape.is_open else "flat"
            raise InputError(f"shape {shape.name!r} is {kind}: grids of distance need a solid; give it thickness")
        points, skins = _points_of(shape, spacing * shape.diameter)
        clusters = _clusters(points, skins, shape.diameter)
        grid, frame = _grid_of(shape, cells)
        parts.append((frame, *clusters, grid, *_triangles_of(shape)))
    return _joined(parts)


def _joined(parts: list[tuple[NDArray[Any], ...]]) -> SurfaceBodies:
    """Return the tables of all shapes, the indices in them shifted."""
    names = [name for name in SurfaceBodies._fields if name != "first"]
    table = dict(zip(names, (list(column) for column in zip(*parts, strict=True)), strict=True))

    def first(name: str) -> Integers:
        return np.concatenate([[0], np.cumsum([len(part) for part in table[name]])]).astype(np.int64)

    rows = {name: first(name) for name in ("point", "cluster", "grid", "corner", "sphere", "fan")}
    by = {
        "cluster_rows": np.column_stack([rows["point"], rows["point"], rows["cluster"]]),
        "fan_rows": rows["fan"],
        "box_rows": rows["corner"],
    }
    for name, shifts in by.items():
        table[name] = [part + shift for part, shift in zip(table[name], shifts, strict=False)]
    joined = (np.concatenate(table[name]) for name in names)
    starts = [rows[name] for name in ("point", "cluster", "grid", "corner", "sphere")]
    return SurfaceBodies(np.column_stack(starts), *joined)


def _points_of(shape: Shape, spacing: float) -> tuple[Floats, Floats]:
    """Return points that represent the surface of a shape, and their skins."""
    geometry = shape.geometry
    if isinstance(geometry, Spheres):
        return geometry.centers, geometry.radii
    if shape.is_sphere:
        return np.zeros((1, 3)), np.array([shape.bounding_radius])
    points = surface_points(shape.vertices, shape.faces, spacing)
    return points, np.zeros(len(points))


def surface_points(vertices: Floats, faces: Integers, spacing: float) -> Floats:
    """Return corners, points along sharp and long edges and, farther apart, points in wide faces of a closed mesh.

    The (p, 3) points are thinned to a spacing; those in faces, which lie far from the others, to one of `WIDE` times
    as much.
    """
    normal = normals_of(vertices[faces])
    normal = normal / np.maximum(linear.norm(normal, axis=1), 1e-300)[:, None]
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    face = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, face = ends[order], face[order]
    twin = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
    cosine = (normal[face[twin]] * normal[face[twin + 1]]).sum(axis=1)
    long = linear.norm(vertices[ends[twin, 0]] - vertices[ends[twin, 1]], axis=1) > spacing
    # long edges of round sides, such as those of a cone, may cross each other far from all corners
    parts = [vertices]
    for a, b in ends[twin[(cosine < SHARP) | (long & (cosine < BENT))]]:
        inner = int(linear.norm(vertices[a] - vertices[b]) / spacing)
        if inner:
            share = (np.arange(1, inner + 1) / (inner + 1))[:, None]
            parts.append(vertices[a] * (1 - share) + vertices[b] * share)
    points = _thinned(np.concatenate(parts), 0.8 * spacing)
    # without these, flat faces that lie on each other sink in until their edges push them sideways
    within = _points_in_faces(vertices[faces], WIDE * spacing)
    if len(within):
        apart = load("scipy.spatial").cKDTree(points).query(within)[0] > 0.5 * WIDE * spacing
        points = np.concatenate([points, within[apart]])
    return points


def _thinned(points: Floats, edge: float) -> Floats:
    """Return the outermost of the points in each cube of a given edge."""
    cube = np.floor(points / edge).astype(np.int64)
    order = np.lexsort((-linear.norm(points, axis=1), *cube.T))
    cube = cube[order]
    new = np.concatenate([[True], (cube[1:] != cube[:-1]).any(axis=1)])
    return np.asarray(points[order[new]])


def _points_in_faces(triangles: Floats, spacing: float) -> Floats:
    """Return points in triangles (m, 3, 3) that are longer than a spacing, thinned to it."""
    longest = linear.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
    parts = [np.zeros((0, 3))]
    for corners, length in zip(triangles[longest > spacing], longest[longest > spacing], strict=True):
        many = math.ceil(3 * length / spacing)
        i, j = (part.ravel() for part in np.meshgrid(np.arange(1, many), np.arange(1, many), indexing="ij"))
        i, j = i[i + j < many], j[i + j < many]
        parts.append(linear.matmul(np.column_stack([i, j, many - i - j]) / many, corners))
    points = np.concatenate(parts)
    return _thinned(points, 0.8 * spacing) if len(points) else points


def _clusters(points: Floats, skins: Floats, diameter: float) -> tuple[Floats, Floats, Integers]:
    """Return points with their skins, sorted into clusters, and the clusters and their rows."""
    kept: list[Integers] = []
    spheres: list[list[float]] = []
    rows: list[list[int]] = []
    count = 0
    for group in _cubes(points, np.arange(len(points)), COARSE * diameter):
        head = len(spheres)
        spheres.append(_sphere_around(points[group], skins[group]))
        rows.append([-1, -1, -1])
        for some in _cubes(points, group, FINE * diameter):
            spheres.append(_sphere_around(points[some], skins[some]))
            rows.append([count, count + len(some), len(spheres)])
            kept.append(some)
            count += len(some)
        rows[head][2] = len(spheres)
    order = np.concatenate(kept)
    return np.column_stack([points, skins])[order], np.array(spheres), np.array(rows, dtype=np.int64)


def _cubes(points: Floats, some: Integers, edge: float) -> list[Integers]:
    """Return some points in groups that share a cube."""
    cube = np.floor(points[some] / edge).astype(np.int64)
    _, group = np.unique(cube, axis=0, return_inverse=True)
    group = group.reshape(-1)
    return [some[group == k] for k in range(int(group.max()) + 1)]


def _sphere_around(points: Floats, skins: Floats) -> list[float]:
    """Return center and radius of a sphere around points with skins."""
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    return [*center.tolist(), float((linear.norm(points - center, axis=1) + skins).max())]


def _grid_of(shape: Shape, cells: int) -> tuple[NDArray[np.float32], Floats]:
    """Return the values of the grid of a shape and the row of its frame; spheres and their unions have no grid."""
    geometry = shape.geometry
    if isinstance(geometry, Spheres) or shape.is_sphere:
        return np.zeros(0, dtype=np.float32), np.array([[0, 0, 0, 0, 0, 0, 1.0, 0, 1]])
    low, high = shape.bounds
    cell = float((high - low).max()) / cells
    origin = low - FRINGE * cell
    counts = np.ceil((high - low) / cell).astype(np.int64) + 2 * FRINGE + 1
    axes = [origin[axis] + cell * np.arange(counts[axis]) for axis in range(3)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    # the tree of a mesh has the sign too
    known = geometry.tree.signed_distance if isinstance(geometry, Mesh) else shape.signed_distance
    frame = np.array([[*counts, *origin, cell, 1.0, float(_is_true(shape))]])
    return known(places).astype(np.float32), frame


def _is_true(shape: Shape) -> bool:
    """Return whether the triangles of a shape are its true surface."""
    geometry = shape.geometry
    return isinstance(geometry, Mesh) or (isinstance(geometry, Primitive) and geometry.kind == "box")


def _triangles_of(shape: Shape) -> tuple[NDArray[Any], ...]:
    """Return the columns from `corner` on."""
    geometry = shape.geometry
    if isinstance(geometry, Spheres) or shape.is_sphere:
        tree, skins = _tree_of_spheres(*_points_of(shape, 1.0))
        fan, fan_rows = np.zeros((0, 3)), np.zeros((len(skins), 3, 2), dtype=np.int64)
    else:
        tree = geometry.tree if isinstance(geometry, Mesh) else grow_tree(shape.vertices, shape.faces)
        skins = np.full(len(tree.face), 0.0 if _is_true(shape) else shape.tessellation_error)
        fan, fan_rows = _fans(shape.vertices, shape.faces, tree.face)
    of_boxes = _spheres_around(tree.corners, tree.low, tree.high, skins, tree.start)
    each = np.column_stack([np.arange(len(skins)), np.arange(1, len(skins) + 1)])
    spheres = _spheres_around(tree.corners, tree.corners.min(axis=1), tree.corners.max(axis=1), skins, each)
    skin = np.column_stack([skins, spheres])
    return tree.corners, skin, tree.normals, fan, fan_rows, tree.low, tree.high, of_boxes, tree.start


def _spheres_around(corners: Floats, low: Floats, high: Floats, skins: Floats, rows: Integers) -> Floats:
    """Return centers and radii of spheres around the triangles of boxes, and their skins; the rows are not sorted."""
    center = (low + high) / 2
    box = np.repeat(np.arange(len(rows)), rows[:, 1] - rows[:, 0])
    begin = np.concatenate([[0], np.cumsum(rows[:, 1] - rows[:, 0])])
    triangle = np.arange(begin[-1]) - begin[box] + rows[box, 0]
    far = linear.norm(corners[triangle] - center[box, None], axis=2).max(axis=1) + skins[triangle]
    return np.column_stack([center, np.maximum.reduceat(far, begin[:-1])])


def _tree_of_spheres(centers: Floats, radii: Floats) -> tuple[TriangleTree, Floats]:
    """Return a tree of spheres, as triangles of three equal corners, and their radii in its order."""
    faces = np.repeat(np.arange(len(centers))[:, None], 3, axis=1)
    tree = grow_tree(centers, faces)
    skin = radii[tree.face]
    return tree, skin


def _fans(vertices: Floats, faces: Integers, order: Integers) -> tuple[Floats, Integers]:
    """Return the unit vectors along the edges that leave each vertex, and their rows for each corner of a triangle."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    # numbers are sorted in a tenth of the time of rows
    ends = np.column_stack(
        divmod(np.unique(linear.matmul(np.concatenate([ends, ends[:, ::-1]]), [len(vertices), 1])), len(vertices))
    )
    along = vertices[ends[:, 1]] - vertices[ends[:, 0]]
    along = along / np.maximum(linear.norm(along, axis=1), 1e-300)[:, None]
    edge = np.searchsorted(ends[:, 0], np.arange(len(vertices) + 1))
    return along, np.stack([edge[faces[order]], edge[faces[order] + 1]], axis=-1)
