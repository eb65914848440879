"""Common bases of geometries: moments, and triangles of closed and open surfaces."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers, read_only
from voxgran.geometry.tree import TriangleTree, grow_tree
from voxgran.geometry.triangles import areas_of


class Moments:
    """Common base of solids that compute volume, centroid and inertia together, as `_moments`; in 2D of the area."""

    _moments: Any

    @property
    def volume(self) -> float:
        """Volume; of closed triangles by the divergence theorem, negative if the faces point inward."""
        return self._moments[0]

    @property
    def centroid(self) -> Floats:
        """Centroid, (3,)."""
        return self._moments[1]

    @property
    def inertia(self) -> Floats:
        """Inertia tensor about the centroid at unit density, (3, 3)."""
        return self._moments[2]


def corner_type(count: int) -> Any:
    """Return the type of the numbers of some vertices."""
    return np.min_scalar_type(max(count - 1, 0))


class LatticePoints(NamedTuple):
    """Points on a lattice, as surfaces of labels have them: half the bytes of coordinates, from which these follow."""

    steps: NDArray[np.int32]  # (n, 3) whole steps from the first corner
    step: Floats  # (3,) edges of a cell of the lattice
    first: Floats  # (3,) its first corner

    @property
    def nbytes(self) -> int:
        """Bytes that they take."""
        return sum(array.nbytes for array in self)

    @property
    def coordinates(self) -> Floats:
        """The points, (n, 3)."""
        return read_only(np.asarray(self.steps * self.step + self.first, dtype=np.float64))


@dataclass(frozen=True, eq=False, init=False)
class Triangles:
    """Triangles (m, 3) of vertices (n, 3) in space, in the unit of lengths."""

    #: the vertices, or their places on a lattice
    points: Floats | LatticePoints
    #: (m, 3) vertices of the triangles, in as few bytes as their numbers take
    corners: NDArray[np.unsignedinteger[Any]]

    dimension = 3

    def __init__(self, vertices: Floats | LatticePoints, faces: NDArray[Any]) -> None:
        count = len(vertices.steps if isinstance(vertices, LatticePoints) else vertices)
        for array in vertices if isinstance(vertices, LatticePoints) else (vertices,):
            read_only(array)
        object.__setattr__(self, "points", vertices)
        object.__setattr__(self, "corners", read_only(faces.astype(corner_type(count), copy=False)))

    @property
    def vertices(self) -> Floats:
        """Vertices, (n, 3)."""
        return self.points.coordinates if isinstance(self.points, LatticePoints) else self.points

    @property
    def faces(self) -> Integers:
        """Vertices of the triangles, (m, 3)."""
        return read_only(self.corners.astype(np.int64))

    @property
    def triangles(self) -> Floats:
        """Corner points of the triangles, (m, 3, 3)."""
        return read_only(self.vertices[self.corners])

    @cached_property
    def tree(self) -> TriangleTree:
        """Box tree of the triangles, for nearest points; its signs are valid for closed surfaces only."""
        return grow_tree(self.vertices, self.faces)

    @property
    def bounding_radius(self) -> float:
        """Largest distance of a vertex from the origin of the frame."""
        return float(np.sqrt((self.vertices**2).sum(axis=1).max()))

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper corner."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    @cached_property
    def areas(self) -> Floats:
        """Areas of the triangles, (m,)."""
        return areas_of(self.triangles)

    @property
    def surface_area(self) -> float:
        """Sum of the areas of the triangles; for an open surface that of one side."""
        return float(self.areas.sum())

    def content(self) -> bytes:
        """Return the bytes from which the key of the shape is computed."""
        return type(self).__name__.lower().encode() + self.vertices.tobytes() + self.faces.tobytes()

    def moved(self, offset: Floats) -> Self:
        """Return the triangles shifted by a (3,) offset."""
        if isinstance(self.points, LatticePoints):
            return type(self)(self.points._replace(first=self.points.first + offset), self.corners)
        return type(self)(self.points + offset, self.corners)

    def rotated(self, matrix: Floats) -> Self:
        """Return the triangles rotated about the origin by a (3, 3) rotation matrix."""
        return type(self)(self.vertices @ matrix.T, self.corners)

    def scaled(self, factor: float) -> Self:
        """Return the triangles scaled about the origin."""
        if isinstance(self.points, LatticePoints):
            steps, step, first = self.points
            return type(self)(LatticePoints(steps, step * factor, first * factor), self.corners)
        return type(self)(self.vertices * factor, self.corners)

    def tessellation(self) -> tuple[Floats, Integers, float]:
        """Return vertices, faces and their largest distance from the true surface: 0."""
        return self.vertices, self.faces, 0.0
