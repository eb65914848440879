"""Convex hulls of points as closed meshes."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran._base.tree import normals_of
from voxgran.shapes.mesh import Mesh


def hull_of(points: Floats) -> Mesh:
    """Return the convex hull of (n, 3) points, which are all corners, its triangles counterclockwise from outside."""
    hull = load("scipy.spatial").ConvexHull(points)
    faces = hull.simplices.astype(np.int64)
    inward = np.einsum("fi,fi->f", normals_of(points[faces]), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(points, faces)
