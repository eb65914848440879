"""A hollow sphere with a wall."""

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
from voxgran.geometry.walls import Round
from voxgran.shapes.tessellate import sphere


@dataclass(frozen=True, init=False)
class Sphere(Parametric):
    """The interior of a sphere.

    Parameters
    ----------
    radius : float
        Radius, in the unit of lengths.
    origin : (3,) sequence of float
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
    >>> packing = vg.pack(vg.shapes.sphere(), vg.Sphere(radius=3), "rsa", count=20)
    >>> packing.container.kind, packing.count
    ('sphere', 20)
    """

    radius: float
    origin: tuple[float, float, float]
    kind: ClassVar[str] = "sphere"
    _lengths: ClassVar[tuple[str, ...]] = ("origin", "radius")

    @explained(hint="Sphere(radius=2)")
    def __init__(self, radius: float, *, origin: "ArrayLike" = (0.0, 0.0, 0.0)) -> None:
        self._check_lengths(radius=radius, origin=origin)

    @property
    def volume(self) -> float:
        """Volume."""
        return 4 / 3 * math.pi * self.radius * self.radius * self.radius  # a power may round in another way

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3)."""
        center = np.array(self.origin)
        return np.array([center - self.radius, center + self.radius])

    @property
    def boundary(self) -> Boundary:
        """The wall in closed form."""
        return Boundary((Round(self.origin, self.radius, axes=3),))

    def signed_distance(self, points: "ArrayLike") -> Floats:
        """Return the distance of (n, 3) points from the wall, negative inside.

        Raises
        ------
        InputError
            If the points are not an (n, 3) array of finite numbers.

        Examples
        --------
        >>> import voxgran as vg
        >>> vg.Sphere(radius=2).signed_distance([(0, 0, 0), (3, 0, 0)]).tolist()
        [-2.0, 1.0]
        """
        away: Floats = linear.norm(as_points(points) - np.array(self.origin), axis=1)
        return away - self.radius

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the boundary.

        Examples
        --------
        >>> import numpy as np
        >>> import voxgran as vg
        >>> vertices, faces = vg.Sphere(radius=2).mesh()
        >>> round(float(np.linalg.norm(vertices, axis=1).max()), 6)
        2.0
        """
        vertices, faces, _ = sphere()
        return vertices * self.radius + np.array(self.origin), faces


registration = ContainerKind(container=Sphere)
