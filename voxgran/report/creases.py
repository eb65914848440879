"""Shading of surfaces: which edges are drawn sharp, and the normals of the rest.

An edge is sharp where its two triangles meet at a large angle and it belongs to a long line of such edges, as rims and
edges of solids do. Scans have single edges of large angles all over; sharp, they would look like spikes and tears.
"""

from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive

#: angle between the normals of neighbouring triangles above which their edge may be sharp, in degrees: of whole
#: surfaces, and of reduced ones, whose triangles meet at larger angles
SHARP, SHARP_REDUCED = 30.0, 60.0
#: shortest line of sharp edges, in mean edges of the bounding box of the surface
LONG = 1.5
#: number of triangles below which a surface is that of a polyhedron, with flat faces, and the angle within these
FACETED, FLAT = 150, 1.0


def creased(shape: Shape, vertices: Floats, faces: Integers) -> tuple[Floats, Integers]:
    """Return the drawn surface of a shape with vertices of their own on each side of sharp edges.

    Surfaces are shaded by the normals at their vertices, which are means over the triangles that share them.
    """
    smooth = isinstance(shape.geometry, Primitive) and shape.geometry.kind in ("ellipsoid", "spherocylinder")
    if shape.dimension == 2 or shape.is_sphere or smooth:
        return vertices, faces
    reduced = len(faces) < len(shape.faces)
    one, two, angle = _neighbours(vertices, faces)
    if len(faces) < FACETED and not reduced:
        sharp = angle > np.radians(FLAT)
    else:
        sharp = angle > np.radians(SHARP_REDUCED if reduced else SHARP)
        sharp[sharp] = _in_long_lines(vertices, faces, one[sharp])
    # a corner is one of the three of a triangle: those of neighbours at an edge that is not sharp are one vertex;
    # neighbours run along their edge in opposite directions, but where one of them is turned over
    smooth = ~sharp & (faces.ravel()[one] != faces.ravel()[two])
    one, two = one[smooth], two[smooth]
    after = np.roll(np.arange(faces.size).reshape(-1, 3), -1, axis=1).ravel()
    vertex = _groups((np.concatenate([one, after[one]]), np.concatenate([after[two], two])), faces.size)
    split = np.zeros((int(vertex.max(initial=-1)) + 1, 3))
    split[vertex] = vertices[faces.ravel()]
    return split, vertex.reshape(-1, 3)


def shaded(vertices: Floats, faces: Integers, normals: Floats | None = None) -> Any:
    """Return a surface for PyVista with the normals (n, 3) by which it is shaded, by default those at its vertices."""
    mesh = load("pyvista").PolyData.from_regular_faces(vertices, faces)
    mesh.point_data.active_normals = vertex_normals(vertices, faces) if normals is None else normals
    return mesh


def vertex_normals(vertices: Floats, faces: Integers) -> Floats:
    """Return the normals (n, 3) at vertices: means over the triangles around them, weighted by their areas and by their
    angles there, so that small and narrow triangles count little.
    """
    sides = [_units(vertices[faces[:, (k + 1) % 3]] - vertices[faces[:, k]]) for k in range(3)]
    normal, around = _normals(vertices, faces), np.zeros((3, len(vertices)))
    for k in range(3):
        angle = np.arccos(np.clip(-(sides[k] * sides[k - 1]).sum(axis=1), -1.0, 1.0))
        for axis in range(3):
            around[axis] += np.bincount(faces[:, k], weights=angle * normal[:, axis], minlength=len(vertices))
    return _units(around.T)


def surface_of(shape: Shape) -> Any:
    """Return the surface of a shape for PyVista, with normals."""
    return shaded(*creased(shape, shape.vertices, shape.faces))


def _normals(vertices: Floats, faces: Integers) -> Floats:
    """Return the normals of triangles (m, 3), as long as twice their areas."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _units(vectors: Floats) -> Floats:
    """Return vectors (n, 3) with length 1; those of length 0 remain."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300))


def _neighbours(vertices: Floats, faces: Integers) -> tuple[Integers, Integers, Floats]:
    """Return the edges at which two triangles meet, as the corner of each at which its edge begins, and the angle
    between their normals. Edges of one triangle, or of more than two, are left out.
    """
    begin, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    key = np.minimum(begin, end) * len(vertices) + np.maximum(begin, end)
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    first = first[count == 2]
    one, two = order[first], order[first + 1]
    normal = _units(_normals(vertices, faces))
    return one, two, np.arccos(np.clip((normal[one // 3] * normal[two // 3]).sum(axis=1), -1.0, 1.0))


def _in_long_lines(vertices: Floats, faces: Integers, edges: Integers) -> Any:
    """Return which edges, given by the corners at which they begin, hang together with others in a long line."""
    begin, end = faces.ravel()[edges], np.roll(faces, -1, axis=1).ravel()[edges]
    line = _groups((begin, end), len(vertices))[begin]
    length = np.bincount(line, weights=np.linalg.norm(vertices[end] - vertices[begin], axis=1))
    return length[line] >= LONG * np.ptp(vertices, axis=0).mean()


def _groups(pairs: tuple[Integers, Integers], count: int) -> Integers:
    """Return the number of the group of each of so many items, of which pairs are in one group."""
    sparse = load("scipy.sparse")
    graph = sparse.coo_array((np.ones(len(pairs[0]), np.int8), pairs), shape=(count, count))
    return np.asarray(load("scipy.sparse.csgraph").connected_components(graph, directed=False)[1], np.int64)
