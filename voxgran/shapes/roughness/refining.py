"""Meshes that are fine enough for the shortest wavelength, and normals that change gradually across edges."""

import math

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import TooLargeError
from voxgran._base.lazy import load
from voxgran.geometry.crossing import count_crossings
from voxgran.shapes.finer import cut_edges, edges_of, onto_surface
from voxgran.shapes.model import Shape
from voxgran.shapes.roughness.parameters import POINTS
from voxgran.shapes.spheres import Spheres

#: faces of a refined surface at the most
MOST_FACES = 400_000


def refined(shape: Shape, edge: float) -> tuple[Floats, Integers]:
    """Return the tessellation of a shape with edges of about a length at most, its vertices on the true surface.

    The triangles of solids are divided by manifold3d, each edge into equal pieces, and new edges may be up to twice as
    long as asked for; the edges of open surfaces are bisected until none is too long.

    Raises
    ------
    TooLargeError
        If it has more than 400,000 faces.
    """
    vertices, faces = shape.vertices, shape.faces
    _refuse_many(4 / math.sqrt(3) * shape.surface_area / edge**2, edge)
    if not shape.is_open:
        library = load("manifold3d")
        mesh = library.Mesh64(vertices.copy(), np.ascontiguousarray(faces, dtype=np.uint64))
        finer = library.Manifold(mesh).refine_to_length(edge).to_mesh64()
        flat = np.array(finer.vert_properties[:, :3], dtype=np.float64)
        points, triangles = onto_surface(shape.geometry, flat), np.array(finer.tri_verts, dtype=np.int64)
        _refuse_many(len(triangles), edge)
        # necks between spheres may be narrower than the triangles, so that points on the spheres would pass each other
        if isinstance(shape.geometry, Spheres) and count_crossings(points, triangles):
            return flat, triangles
        return points, triangles
    while True:
        _refuse_many(len(faces), edge)
        ends, index = edges_of(faces)
        long = np.linalg.norm(vertices[ends[:, 0]] - vertices[ends[:, 1]], axis=1) > edge
        if not long.any():
            return vertices, faces
        new = np.full(len(ends), -1)
        new[long] = len(vertices) + np.arange(int(long.sum()))
        vertices = np.concatenate([vertices, vertices[ends[long]].mean(axis=1)])
        faces = cut_edges(vertices, faces, index, new)


def _refuse_many(number: float, edge: float) -> None:
    """Raise where a surface has too many faces."""
    if number > MOST_FACES:
        least = POINTS * edge * math.sqrt(number / MOST_FACES)
        raise TooLargeError(
            f"shortest is {POINTS * edge:.4g}: a surface of {number:.3g} faces would be needed to resolve it, at most "
            f"{MOST_FACES} are made; give at least {least:.2g}"
        )


def diffused(normals: Floats, vertices: Floats, faces: Integers, width: float) -> Floats:
    """Return unit normals (n, 3) smoothed over a distance along the surface: one implicit step of diffusion."""
    sparse, n = load("scipy.sparse"), len(vertices)
    corners = vertices[faces]
    sides = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)
    doubled = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    # linear finite elements: products of the sides opposite to two corners
    stiffness = np.einsum("fik,fjk->fij", sides, sides) / (2 * np.maximum(doubled, 1e-300))[:, None, None]
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, 3).ravel()
    mass = np.bincount(faces.ravel(), np.repeat(doubled / 6, 3), n)
    matrix = sparse.coo_matrix((stiffness.ravel() * width**2 / 4, (rows, columns)), (n, n)) + sparse.diags(mass)
    found = load("scipy.sparse.linalg").spsolve(matrix.tocsc(), mass[:, None] * normals)
    return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300))
