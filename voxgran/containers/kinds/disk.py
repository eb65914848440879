"""A disk with a wall, for packings in two dimensions."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers
from voxgran._base.calls import explained
from voxgran.containers.equipment import Parametric
from voxgran.containers.model import Boundary, ContainerKind
from voxgran.containers.plane import points_in_plane
from voxgran.geometry.walls import Round
from voxgran.shapes.outline import Outline


@dataclass(frozen=True, init=False)
class Disk(Parametric):
    """The interior of a circle in the plane z = 0.

    Parameters
    ----------
    radius : float
        Radius, in the unit of lengths.
    origin : (2,) sequence of float
        Center.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If the radius is not between 1e-60 and 1e60, or the center is out of this range.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.Disk(radius=2).volume, 3)  # its area
    12.566
    """

    radius: float
    origin: tuple[float, float]
    kind: ClassVar[str] = "disk"
    _lengths: ClassVar[tuple[str, ...]] = ("origin", "radius")
    dimension: ClassVar[int] = 2

    @explained(hint="Disk(radius=2)")
    def __init__(self, radius: float, *, origin: "ArrayLike" = (0.0, 0.0)) -> None:
        self._check_lengths(radius=radius, origin=origin)

    @property
    def volume(self) -> float:
        """Area."""
        return math.pi * self.radius * self.radius  # a power may round in another way in another unit

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3)."""
        center, reach = np.array([*self.origin, 0.0]), np.array([self.radius, self.radius, 0.0])
        return np.array([center - reach, center + reach])

    @property
    def boundary(self) -> Boundary:
        """The wall in closed form."""
        return Boundary((Round((*self.origin, 0.0), self.radius),))

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 2 or 3) points from the wall, negative inside; z does not count.

        Raises
        ------
        InputError
            If the points are not finite numbers in two or three columns.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Disk(radius=2).signed_distance([(0, 0, 0), (3, 0, 0)]).tolist()
        [-2.0, 1.0]
        """
        away = points_in_plane(points)[:, :2] - np.array(self.origin)
        return np.asarray(np.hypot(away[:, 0], away[:, 1]) - self.radius)

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the area.

        Examples
        --------
        >>> import numpy as np
        >>> import voxgran as vg
        >>> vertices, faces = vg.Disk(radius=2).mesh()
        >>> round(float(np.linalg.norm(vertices, axis=1).max()), 6)
        2.0
        """
        return Outline("disk", self.radius, center=self.origin).tessellation()[:2]


registration = ContainerKind(container=Disk)
