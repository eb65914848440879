"""Conforming refinement of triangulations, with new vertices on the true surface."""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.geometry.triangles import normals_of
from voxgran.shapes.describing.body import Geometry
from voxgran.shapes.primitive import Primitive, from_axis
from voxgran.shapes.spheres import Spheres


def edges_of(faces: Integers) -> tuple[Integers, Integers]:
    """Return the edges of triangles, each once: ends (e, 2), the smaller number first, and index (m, 3).

    The index is the edge between the corners 0 and 1, 1 and 2, 2 and 0 of each triangle.
    """
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1), axis=-1).reshape(-1, 2)
    base = int(faces.max(initial=0)) + 1
    key, index = np.unique(ends[:, 0] * base + ends[:, 1], return_inverse=True)
    return np.column_stack([key // base, key % base]), index.reshape(-1, 3).astype(np.int64)


def cut_edges(vertices: Floats, faces: Integers, index: Integers, new: Integers) -> Integers:
    """Return the triangles (k, 3), with the same orientation, after some edges have been bisected by new vertices.

    The vertices include the new ones; `index` are the edges of each triangle, as in :func:`edges_of`; `new` is the
    vertex on each edge, -1 if there is none.
    """
    on = new[index]
    cuts = (on >= 0).sum(axis=1)
    parts = [faces[cuts == 0]]
    a, b, c, p, _, _ = _from_corner(faces, on, (cuts == 1), on >= 0)
    parts += [np.column_stack([a, p, c]), np.column_stack([p, b, c])]
    # the edge that is not cut comes last
    a, b, c, p, q, _ = _from_corner(faces, on, (cuts == 2), np.roll(on, 1, axis=1) < 0)
    parts.append(np.column_stack([p, b, q]))
    across = linear.norm(vertices[a] - vertices[q], axis=1) <= linear.norm(vertices[p] - vertices[c], axis=1)
    parts.append(np.column_stack([a, p, np.where(across, q, c)]))
    parts.append(np.column_stack([np.where(across, a, p), q, c]))
    a, b, c, p, q, r = _from_corner(faces, on, (cuts == 3), on >= 0)
    parts += [np.column_stack(corners) for corners in ((a, p, r), (p, b, q), (r, q, c), (p, q, r))]
    return np.concatenate(parts)


def _from_corner(faces: Integers, on: Integers, chosen: Booleans, first: Booleans) -> Integers:
    """Return corners and new vertices (6, k) of chosen triangles, permuted so that the first marked edge leads."""
    rows = np.flatnonzero(chosen)
    turned = (first[rows].argmax(axis=1)[:, None] + np.arange(3)) % 3
    return np.concatenate([faces[rows[:, None], turned], on[rows[:, None], turned]], axis=1).T


def onto_surface(geometry: Geometry, points: Floats) -> Floats:
    """Project (n, 3) points on triangles of the tessellation of a solid onto its true surface.

    The points lie on spheres, ellipsoids, spherocylinders, unions of spheres and the sides of cylinders and cones
    afterwards; points on flat faces are unchanged.
    """
    if isinstance(geometry, Spheres):
        return _onto_spheres(points, geometry.centers, geometry.radii)
    if not isinstance(geometry, Primitive) or geometry.kind == "box":
        return points
    p, d = linear.matmul(points, geometry.matrix), geometry.dimensions
    if geometry.kind in ("sphere", "ellipsoid"):
        p = p / linear.norm(p / np.array(d * 3 if geometry.kind == "sphere" else d), axis=1, keepdims=True)
    elif geometry.kind == "spherocylinder":
        way = from_axis(p, d[1])
        p += way * (d[0] / linear.norm(way, axis=1, keepdims=True) - 1)
    else:
        foot = -d[1] / (2 if geometry.kind == "cylinder" else 4)
        top = d[1] / 2 if geometry.kind == "cylinder" else 0.75 * d[1]
        wanted = np.full(len(p), d[0]) if geometry.kind == "cylinder" else d[0] * (0.75 - p[:, 2] / d[1])
        side = (p[:, 2] > foot + 1e-12 * d[1]) & (p[:, 2] < top - 1e-12 * d[1])
        flat = np.hypot(p[:, 0], p[:, 1])
        p[:, :2] *= np.where(side, wanted / np.where(side, flat, 1.0), 1.0)[:, None]
    return np.asarray(linear.matmul(p, geometry.matrix.T))


def _onto_spheres(points: Floats, centers: Floats, radii: Floats) -> Floats:
    """Project each point onto the surface of the sphere that contains it most deeply."""
    deepest, moved = np.full(len(points), -np.inf), points.copy()
    for center, radius in zip(centers, radii, strict=True):
        way = points - center
        length = linear.norm(way, axis=1)
        better = (radius - length > deepest) & (length > 0)
        deepest[better] = (radius - length)[better]
        moved[better] = (center + way * (radius / np.where(length > 0, length, 1.0))[:, None])[better]
    return moved


def vertex_normals(vertices: Floats, faces: Integers) -> Floats:
    """Return outward unit normals (n, 3) at the vertices: the area-weighted mean of the adjacent triangles."""
    total = np.zeros_like(vertices)
    np.add.at(total, faces, normals_of(vertices[faces])[:, None])
    return total / np.maximum(linear.norm(total, axis=1, keepdims=True), 1e-300)
