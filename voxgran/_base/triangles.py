"""Normals, areas and the enclosed volume of triangles in space."""

import numpy as np

from voxgran._base.arrays import Floats, Integers


def normals_of(triangles: Floats) -> Floats:
    """Return the normals of (m, 3, 3) triangles, (m, 3), each as long as twice the area."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.asarray(np.cross(b - a, c - a))


def areas_of(triangles: Floats) -> Floats:
    """Return the areas of (m, 3, 3) triangles, (m,)."""
    return np.asarray(np.linalg.norm(normals_of(triangles), axis=1) / 2)


def enclosed_volume(vertices: Floats, faces: Integers) -> float:
    """Return the volume that closed triangles enclose; it is most accurate where the origin lies among them."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    return float(np.einsum("fi,fi->", a, np.cross(b, c)) / 6)
