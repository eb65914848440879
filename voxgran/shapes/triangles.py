"""Common base of closed and open surfaces of triangles."""

from dataclasses import dataclass
from functools import cached_property

from voxgran._base.arrays import Floats, Integers, read_only
from voxgran._base.tree import TriangleTree, areas_of, grow_tree


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles in space.

    Attributes
    ----------
    vertices : (n, 3) ndarray of float
        Corner points, in the unit of lengths.
    faces : (m, 3) ndarray of int
        Vertex indices of the triangles.
    """

    vertices: Floats
    faces: Integers

    dimension = 3

    def __post_init__(self) -> None:
        read_only(self.vertices)
        read_only(self.faces)

    @cached_property
    def triangles(self) -> Floats:
        """Corner points of the triangles, (m, 3, 3)."""
        return read_only(self.vertices[self.faces])

    @cached_property
    def tree(self) -> TriangleTree:
        """Box tree of the triangles, for nearest points; its signs are valid for closed surfaces only."""
        return grow_tree(self.vertices, self.faces)

    @cached_property
    def areas(self) -> Floats:
        """Areas of the triangles, (m,)."""
        return areas_of(self.triangles)

    @property
    def surface_area(self) -> float:
        """Sum of the areas of the triangles; for an open surface that of one side."""
        return float(self.areas.sum())
