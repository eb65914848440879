"""Convex hulls of points as closed meshes."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.shapes.mesh import Mesh


def hull_of(points: Floats) -> Mesh:
    """Return the convex hull of (n, 3) points, which are all corners, its triangles counterclockwise from outside."""
    hull = load("scipy.spatial").ConvexHull(points)
    faces = hull.simplices.astype(np.int64)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(points, faces)
