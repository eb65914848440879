"""An upright cylinder with walls."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_points
from voxgran._base.calls import explained
from voxgran.containers.equipment import Parametric
from voxgran.containers.model import Boundary, ContainerKind
from voxgran.geometry.walls import Round, planes_across
from voxgran.shapes.tessellate import revolved


@dataclass(frozen=True, init=False)
class Cylinder(Parametric):
    """A cylinder whose axis is along z.

    Parameters
    ----------
    radius : float
        Radius, in the unit of lengths.
    height : float
        Height, in the unit of lengths.
    origin : (3,) sequence of float
        Center of the base.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If radius or height is not between 1e-60 and 1e60, or the center is out of this range.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(vg.Cylinder(radius=2, height=5).volume, 3)
    62.832
    """

    radius: float
    height: float
    origin: tuple[float, float, float]
    kind: ClassVar[str] = "cylinder"
    _lengths: ClassVar[tuple[str, ...]] = ("origin", "radius", "height")

    @explained(hint="Cylinder(radius=2, height=6)")
    def __init__(self, radius: float, height: float, *, origin: "ArrayLike" = (0.0, 0.0, 0.0)) -> None:
        self._check_lengths(radius=radius, height=height, origin=origin)

    @property
    def volume(self) -> float:
        """Volume."""
        return math.pi * self.radius * self.radius * self.height  # a power may round in another way in another unit

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3)."""
        reach = np.array([self.radius, self.radius, 0.0])
        base = np.array(self.origin)
        return np.array([base - reach, base + reach + np.array([0.0, 0.0, self.height])])

    @property
    def boundary(self) -> Boundary:
        """The walls in closed form."""
        return Boundary((*planes_across(self.bounds, "z"), Round(self.origin, self.radius)))

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the nearest wall, negative inside.

        Raises
        ------
        InputError
            If the points are not an (n, 3) array of finite numbers.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Cylinder(radius=2, height=5).signed_distance([(0, 0, 2.5), (3, 0, 2.5)]).tolist()
        [-2.0, 1.0]
        """
        p = as_points(points) - np.array(self.origin)
        beyond = np.stack([np.hypot(p[:, 0], p[:, 1]) - self.radius, np.maximum(-p[:, 2], p[:, 2] - self.height)])
        outside = linear.norm(np.maximum(beyond, 0.0), axis=0)
        return np.where(outside > 0, outside, beyond.max(axis=0))

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the boundary.

        Examples
        --------
        >>> import voxgran as vg
        >>> vertices, faces = vg.Cylinder(radius=2, height=5).mesh()
        >>> float(vertices[:, 2].max())
        5.0
        """
        vertices, faces, _ = revolved([(0.0, self.radius), (self.height, self.radius)])
        return vertices + np.array(self.origin), faces


registration = ContainerKind(container=Cylinder)
