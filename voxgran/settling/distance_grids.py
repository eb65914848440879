"""Tables of shapes for the contacts of surfaces: points on surfaces, grids of signed distance, and triangles.

Lengths are in the unit of each shape. The points lie at corners and along sharp edges and are held by two levels of
bounding spheres; a grid holds the signed distance at lattice points in single precision, between which it is
interpolated. Unions of spheres have their centers as points, with the radii as skins, and no grid: they are tested one
way, against the grids of others. Ellipsoids, cylinders and cones are represented by their tessellation, whose error is
added as a skin, so that exact tests never overestimate their gaps.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran._base.stopping import stop_if_asked
from voxgran._base.tree import TriangleTree, grow_tree, normals_of
from voxgran.shapes.mesh import Mesh
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import Spheres

#: cells of a grid along the longest side of a shape, and cells beyond it on each side
CELLS, FRINGE = 36, 2
#: spacing of the points, and edges of the cubes whose points share a bounding sphere, in equivalent diameters
SPACING, FINE, COARSE = 0.07, 0.21, 0.42
#: cosine between faces below which their common edge is sharp
SHARP = 0.94


class SurfaceBodies(NamedTuple):
    """Tables of s shapes, one after the other; rows of shape k are `first[k]` to `first[k + 1]` - 1.

    point: (p, 4) points and skins.  cluster: (c, 4) bounding spheres.  cluster_rows: (c, 3): first point, the one
    after the last, and the next cluster where this one is skipped; a cluster without points holds those up to it.
    grid: (g,) signed distances, the last axis fastest.  grid_shape: (s, 3), 0 without a grid.  grid_origin: (s, 3).
    grid_cell: (s,) edge of a cell.
    corner: (t, 3, 3) triangles in the order of their trees; a sphere is a triangle of three equal corners.
    skin: (t,) distance of the surface from the triangle.  pseudo: (t, 7, 3) pseudo-normals as `TriangleTree.normals`.
    fan: (f, 3) unit vectors along the edges that leave a corner.  fan_rows: (t, 3, 2) those of each corner of a
    triangle.  low, high: (k, 3) boxes of the trees, which include the skins.  box_rows: (k, 2) triangles in a box.
    solid: (s,) 1 where triangles enclose the shape, 0 for spheres.  exact: (s,) 1 where triangles or spheres are the
    true surface.
    """

    point: Floats
    point_first: Integers
    cluster: Floats
    cluster_rows: Integers
    cluster_first: Integers
    grid: NDArray[np.float32]
    grid_first: Integers
    grid_shape: Integers
    grid_origin: Floats
    grid_cell: Floats
    corner: Floats
    skin: Floats
    pseudo: Floats
    fan: Floats
    fan_rows: Integers
    corner_first: Integers
    low: Floats
    high: Floats
    box_rows: Integers
    box_first: Integers
    solid: Integers
    exact: Integers


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
    parts = []
    for shape in shapes:
        stop_if_asked()
        if shape.dimension != 3 or shape.is_open:
            kind = "an open surface" if shape.is_open else "flat"
            raise InputError(f"shape {shape.name!r} is {kind}: grids of distance need a solid; give it thickness")
        points, skins = _points_of(shape, spacing * shape.diameter)
        clusters = _clusters(points, skins, shape.diameter)
        parts.append((*clusters, *_grid_of(shape, cells), *_triangles_of(shape)))
    return _joined(parts)


def _joined(parts: list[tuple[NDArray[np.generic], ...]]) -> SurfaceBodies:
    """Return the tables of all shapes, the indices in them shifted."""
    table = [list(column) for column in zip(*parts, strict=True)]
    point, cluster, rows, grid, shape, origin, cell, corner, skin, pseudo, fan, fan_rows, low, high, box, *marks = table

    def first(column: list[NDArray[np.generic]]) -> Integers:
        return np.concatenate([[0], np.cumsum([len(part) for part in column])]).astype(np.int64)

    def shifted(column: list[NDArray[np.generic]], by: Integers) -> list[NDArray[np.generic]]:
        return [part + shift for part, shift in zip(column, by, strict=False)]

    shift = np.column_stack([first(point), first(point), first(cluster)])
    return SurfaceBodies(
        *(np.concatenate(point), first(point), np.concatenate(cluster), np.concatenate(shifted(rows, shift))),
        *(first(cluster), np.concatenate(grid), first(grid), np.array(shape), np.array(origin), np.array(cell)),
        *(np.concatenate(corner), np.concatenate(skin), np.concatenate(pseudo), np.concatenate(fan)),
        *(np.concatenate(shifted(fan_rows, first(fan))), first(corner), np.concatenate(low), np.concatenate(high)),
        *(np.concatenate(shifted(box, first(corner))), first(low)),
        *(np.array(mark) for mark in marks),
    )


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
    """Return corners and points along sharp edges of a closed mesh, (p, 3), thinned to a spacing.

    Of the points in a cube of 0.8 times the spacing the outermost is kept.
    """
    normal = normals_of(vertices[faces])
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    face = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, face = ends[order], face[order]
    twin = np.flatnonzero((ends[1:] == ends[:-1]).all(axis=1))
    sharp = twin[(normal[face[twin]] * normal[face[twin + 1]]).sum(axis=1) < SHARP]
    parts = [vertices]
    for a, b in ends[sharp]:
        inner = int(np.linalg.norm(vertices[a] - vertices[b]) / spacing)
        if inner:
            share = (np.arange(1, inner + 1) / (inner + 1))[:, None]
            parts.append(vertices[a] * (1 - share) + vertices[b] * share)
    points = np.concatenate(parts)
    cube = np.floor(points / (0.8 * spacing)).astype(np.int64)
    order = np.lexsort((-np.linalg.norm(points, axis=1), *cube.T))
    cube = cube[order]
    new = np.concatenate([[True], (cube[1:] != cube[:-1]).any(axis=1)])
    return np.asarray(points[order[new]])


def _clusters(points: Floats, skins: Floats, diameter: float) -> tuple[Floats, Floats, Integers]:
    """Return points with their skins, sorted into clusters, and the clusters and their rows."""
    kept, spheres, rows = [], [], []
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
    return [*center.tolist(), float((np.linalg.norm(points - center, axis=1) + skins).max())]


def _grid_of(shape: Shape, cells: int) -> tuple[NDArray[np.float32], Integers, Floats, float]:
    """Return values, shape, origin and cell of the grid of a shape; of spheres and their unions none."""
    if isinstance(shape.geometry, Spheres) or shape.is_sphere:
        return np.zeros(0, dtype=np.float32), np.zeros(3, dtype=np.int64), np.zeros(3), 1.0
    low, high = shape.bounds
    cell = float((high - low).max()) / cells
    origin = low - FRINGE * cell
    counts = np.ceil((high - low) / cell).astype(np.int64) + 2 * FRINGE + 1
    axes = [origin[axis] + cell * np.arange(counts[axis]) for axis in range(3)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    geometry = shape.geometry
    # the tree of a mesh has the sign too
    known = geometry.tree.signed_distance if isinstance(geometry, Mesh) else shape.signed_distance
    return known(places).astype(np.float32), counts, origin, cell


def _triangles_of(shape: Shape) -> tuple[Floats, Floats, Floats, Floats, Integers, Floats, Floats, Integers, int, int]:
    """Return corners, skins, pseudo-normals, fans, their rows, boxes and their rows, and the two marks of a shape."""
    geometry = shape.geometry
    if isinstance(geometry, Spheres) or shape.is_sphere:
        tree, skin = _tree_of_spheres(*_points_of(shape, 1.0))
        fans = np.zeros((0, 3)), np.zeros((len(skin), 3, 2), dtype=np.int64)
        return tree.corners, skin, tree.normals, *fans, tree.low, tree.high, tree.start, 0, 1
    true = isinstance(geometry, Mesh) or (isinstance(geometry, Primitive) and geometry.kind == "box")
    tree = geometry.tree if isinstance(geometry, Mesh) else grow_tree(shape.vertices, shape.faces)
    error = 0.0 if true else shape.tessellation_error
    fans = _fans(shape.vertices, shape.faces, tree.face)
    boxes = tree.low - error, tree.high + error
    return tree.corners, np.full(len(tree.face), error), tree.normals, *fans, *boxes, tree.start, 1, int(true)


def _tree_of_spheres(centers: Floats, radii: Floats) -> tuple[TriangleTree, Floats]:
    """Return a tree of spheres, as triangles of three equal corners, and their radii in its order."""
    faces = np.repeat(np.arange(len(centers))[:, None], 3, axis=1)
    tree = grow_tree(centers, faces)
    skin = radii[tree.face]
    low = np.array([(tree.corners[a:b, 0] - skin[a:b, None]).min(axis=0) for a, b in tree.start])
    high = np.array([(tree.corners[a:b, 0] + skin[a:b, None]).max(axis=0) for a, b in tree.start])
    return TriangleTree(tree.corners, tree.normals, low, high, tree.start, tree.face), skin


def _fans(vertices: Floats, faces: Integers, order: Integers) -> tuple[Floats, Integers]:
    """Return the unit vectors along the edges that leave each vertex, and their rows for each corner of a triangle."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)
    along = vertices[ends[:, 1]] - vertices[ends[:, 0]]
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    edge = np.searchsorted(ends[:, 0], np.arange(len(vertices) + 1))
    return along, np.stack([edge[faces[order]], edge[faces[order] + 1]], axis=-1)
