"""A closed triangle mesh as the true geometry of a grain, and the convex hull of points as such a mesh."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran._base.tree import normals_of
from voxgran.shapes.triangles import Moments, Triangles


@dataclass(frozen=True, eq=False)
class Mesh(Moments, Triangles):
    """A closed surface of triangles, counterclockwise seen from outside."""

    @cached_property
    def _moments(self) -> tuple[float, Floats, Floats]:
        """Volume, centroid and inertia from the tetrahedra between a central point and each face.

        The integrals of 1, x and x x^T over a tetrahedron are closed forms of its corners (Tonon 2005,
        doi:10.3844/jmssp.2005.8.11); the central point preserves digits if the mesh is far from the origin.
        """
        middle = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        corners = self.triangles - middle
        a, b, c = np.moveaxis(corners, 1, 0)
        sixth = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
        volume = float(sixth.sum())
        if volume == 0.0:
            return 0.0, middle, np.zeros((3, 3))
        total = a + b + c
        first = (sixth[:, None] * total).sum(axis=0) / 4
        second = np.einsum("f,fki,fkj->ij", sixth, corners, corners)
        second = (second + np.einsum("f,fi,fj->ij", sixth, total, total)) / 20
        offset = first / volume
        second = second - volume * np.outer(offset, offset)
        return volume, middle + offset, np.trace(second) * np.eye(3) - second


def hull_of(points: Floats) -> Mesh:
    """Return the convex hull of (n, 3) points, which are all corners, its triangles counterclockwise from outside."""
    hull = load("scipy.spatial").ConvexHull(points)
    faces = hull.simplices.astype(np.int64)
    inward = np.einsum("fi,fi->f", normals_of(points[faces]), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(points, faces)
