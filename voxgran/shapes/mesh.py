"""A closed triangle mesh as the true geometry of a grain, and the convex hull of points as such a mesh."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.geometry.triangles import normals_of
from voxgran.shapes.triangles import Triangles


@dataclass(frozen=True, eq=False, init=False)
class Mesh(Triangles):
    """A closed surface of triangles, counterclockwise seen from outside."""

    def _tetrahedra(self) -> tuple[Floats, list[Floats], Floats]:
        """Return a central point, the three corners of each face seen from it, and the volumes between the two.

        The central point preserves digits if the mesh is far from the origin.
        """
        middle = (self.vertices.min(axis=0) + self.vertices.max(axis=0)) / 2
        points = self.vertices - middle
        a, b, c = corners = [points[self.corners[:, k]] for k in range(3)]
        return middle, corners, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6

    @cached_property
    def _volume_and_centroid(self) -> tuple[float, Floats]:
        """Both together, without the inertia, which takes longer."""
        middle, (a, b, c), sixth = self._tetrahedra()
        volume = float(sixth.sum())
        if volume == 0.0:
            return 0.0, middle
        return volume, middle + (sixth[:, None] * (a + b + c)).sum(axis=0) / 4 / volume

    @property
    def volume(self) -> float:
        """Volume by the divergence theorem, negative if the faces point inward."""
        return self._volume_and_centroid[0]

    @property
    def centroid(self) -> Floats:
        """Centroid, (3,)."""
        return self._volume_and_centroid[1]

    @cached_property
    def inertia(self) -> Floats:
        """Inertia tensor about the centroid at unit density, (3, 3).

        The integrals of 1, x and x x^T over a tetrahedron are closed forms of its corners (Tonon 2005,
        doi:10.3844/jmssp.2005.8.11).
        """
        _, (a, b, c), sixth = self._tetrahedra()
        if self.volume == 0.0:
            return np.zeros((3, 3))
        total, corners = a + b + c, np.stack([a, b, c], axis=1)
        second = np.einsum("f,fki,fkj->ij", sixth, corners, corners)
        second = (second + np.einsum("f,fi,fj->ij", sixth, total, total)) / 20
        offset = (sixth[:, None] * total).sum(axis=0) / 4 / self.volume
        second = second - self.volume * np.outer(offset, offset)
        return np.asarray(np.trace(second) * np.eye(3) - second)


def hull_of(points: Floats) -> Mesh:
    """Return the convex hull of (n, 3) points, which are all corners, its triangles counterclockwise from outside."""
    hull = load("scipy.spatial").ConvexHull(points)
    faces = hull.simplices.astype(np.int64)
    inward = np.einsum("fi,fi->f", normals_of(points[faces]), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    return Mesh(points, faces)
