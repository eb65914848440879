"""A rectangle with walls or periodic sides, for packings in two dimensions."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_floats, as_length, as_place, as_positive, as_vector
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran.containers.box import box_distance
from voxgran.containers.model import Boundary


@dataclass(frozen=True, init=False)
class Rectangle:
    """A rectangle along the axes in the plane z = 0.

    Parameters
    ----------
    lengths : (2,) sequence of float
        Sides, in the unit of lengths.
    periodic : str, bool or sequence
        Periodic axes: names such as ``"x"`` or ``["x", "y"]``, two flags, or True for both.
    origin : (2,) sequence of float
        Lower corner.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If a length is not between 1e-60 and 1e60, the corner is out of this range, or `periodic` is invalid.
    """

    lengths: tuple[float, float]
    periodic: tuple[bool, bool, bool]
    origin: tuple[float, float]
    kind: ClassVar[str] = "rectangle"
    dimension: ClassVar[int] = 2

    @explained(hint='Rectangle((4, 6)) or Rectangle((4, 6), periodic="x")')
    def __init__(
        self,
        lengths: ArrayLike,
        periodic: Periodic = False,
        *,
        origin: ArrayLike = (0.0, 0.0),
    ) -> None:
        sides = as_vector(lengths, "lengths", length=2)
        x, y = (as_length(float(value), "length of the rectangle") for value in sides)
        a, b = (float(value) for value in as_place(origin, "origin", length=2))
        object.__setattr__(self, "lengths", (x, y))
        object.__setattr__(self, "periodic", as_periodic(periodic, 2))
        object.__setattr__(self, "origin", (a, b))

    @property
    def volume(self) -> float:
        """Area."""
        return self.lengths[0] * self.lengths[1]

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3), z = 0."""
        low = np.array([*self.origin, 0.0])
        return np.array([low, low + np.array([*self.lengths, 0.0])])

    @property
    def boundary(self) -> Boundary:
        """The walls in closed form."""
        return Boundary(flat=(not self.periodic[0], not self.periodic[1], False))

    def signed_distance(self, points: ArrayLike) -> Floats:
        """Return the distance of (n, 2 or 3) points from the nearest wall, negative inside; z does not count.

        Raises
        ------
        InputError
            If the points are not finite numbers in two or three columns.
        """
        columns = 2 if np.ndim(points) == 2 and np.shape(points)[1] == 2 else 3
        flat = as_floats(points, "points", shape=(None, columns))[:, :2]
        return box_distance(flat, self.bounds[:, :2], [k for k in range(2) if not self.periodic[k]])

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the area."""
        (x, y, _), (u, v, _) = self.bounds
        vertices = np.array([[x, y, 0.0], [u, y, 0.0], [u, v, 0.0], [x, v, 0.0]])
        return vertices, np.array([[0, 1, 2], [0, 2, 3]])

    def scaled(self, factor: float) -> "Rectangle":
        """Return the rectangle with lengths and corner multiplied.

        Raises
        ------
        InputError
            If the factor is not above 0, or a length is not between 1e-60 and 1e60 any longer.
        """
        times = as_positive(factor, "factor")
        lengths, origin = ([value * times for value in vector] for vector in (self.lengths, self.origin))
        return Rectangle(lengths, self.periodic[:2], origin=origin)

    def with_periodic(self, periodic: Periodic) -> "Rectangle":
        """Return the rectangle with other periodic axes.

        Raises
        ------
        InputError
            If `periodic` names no axes.
        """
        return Rectangle(self.lengths, periodic, origin=self.origin)

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values."""
        flags = list(self.periodic[:2])
        return {"kind": self.kind, "lengths": list(self.lengths), "periodic": flags, "origin": list(self.origin)}
