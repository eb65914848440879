"""A convex polyhedron given by the planes of its faces."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

from voxgran._base.arrays import as_points, check_coordinates
from voxgran._base.calls import explained_methods
from voxgran._base.errors import InputError
from voxgran.containers.equipment import Equipment, Space, space_within
from voxgran.containers.kinds.walls import direction
from voxgran.containers.model import ContainerKind
from voxgran.geometry.walls import plane


@explained_methods
@dataclass(frozen=True)
class Planes(Equipment):
    """What lies behind all of several planes.

    Parameters
    ----------
    normals : (n, 3) sequence of float
        Normals that point out of the container, of any length.
    points : (n, 3) sequence of float
        A point of each plane, in the unit of lengths.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If the numbers of normals and points differ, a normal is 0, nothing lies behind all planes, or what does is not
        bounded.

    Examples
    --------
    >>> import voxgran as vg
    >>> corner = vg.Planes([(-1, 0, 0), (0, -1, 0), (0, 0, -1), (1, 1, 1)], [(0, 0, 0)] * 3 + [(3, 0, 0)])
    >>> round(corner.volume, 9)
    4.5
    """

    normals: Any
    points: Any
    kind: ClassVar[str] = "planes"
    _lengths: ClassVar[tuple[str, ...]] = ("points",)

    def __post_init__(self) -> None:
        """Check the planes."""
        normals, points = as_points(self.normals, "normals"), as_points(self.points, "points")
        if len(normals) != len(points):
            raise InputError(
                f"there are {len(normals)} normals and {len(points)} points: give one point for each plane"
            )
        check_coordinates(points, "points")
        self._set("normals", tuple(tuple(row) for row in normals.tolist()))
        self._set("points", tuple(tuple(row) for row in points.tolist()))
        _ = self.space

    @cached_property
    def space(self) -> Space:
        """The space within the walls."""
        pairs = zip(self.points, self.normals, strict=True)
        walls = [plane(point, direction(normal, f"normal {k}")) for k, (point, normal) in enumerate(pairs)]
        return space_within(walls, "planes")


registration = ContainerKind(container=Planes)
