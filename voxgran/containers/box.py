"""A box with walls or periodic faces."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_length, as_place, as_points, as_positive, as_vector
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran.containers.model import Boundary
from voxgran.shapes.tessellate import unit_box


@dataclass(frozen=True, init=False)
class Box:
    """A box along the axes.

    Parameters
    ----------
    lengths : (3,) sequence of float
        Edges, in the unit of lengths.
    periodic : str, bool or sequence
        Periodic axes: names such as ``"xy"`` or ``["x", "y"]``, three flags, or True for all of them.
    origin : (3,) sequence of float
        Lower corner.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If a length is not between 1e-60 and 1e60, the corner is out of this range, or `periodic` is invalid.
    """

    lengths: tuple[float, float, float]
    periodic: tuple[bool, bool, bool]
    origin: tuple[float, float, float]
    kind: ClassVar[str] = "box"
    dimension: ClassVar[int] = 3

    @explained(hint='Box((4, 4, 6)) or Box((4, 4, 6), periodic="xy")')
    def __init__(
        self,
        lengths: ArrayLike,
        periodic: Periodic = False,
        *,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        x, y, z = (as_length(float(value), "length of the box") for value in as_vector(lengths, "lengths"))
        a, b, c = (float(value) for value in as_place(origin, "origin"))
        object.__setattr__(self, "lengths", (x, y, z))
        object.__setattr__(self, "periodic", as_periodic(periodic))
        object.__setattr__(self, "origin", (a, b, c))

    @property
    def volume(self) -> float:
        """Volume."""
        return self.lengths[0] * self.lengths[1] * self.lengths[2]

    @property
    def bounds(self) -> Floats:
        """Lower and upper corner, (2, 3)."""
        low = np.array(self.origin)
        return np.array([low, low + np.array(self.lengths)])

    @property
    def boundary(self) -> Boundary:
        """The walls in closed form."""
        x, y, z = self.periodic
        return Boundary(flat=(not x, not y, not z))

    def signed_distance(self, points: ArrayLike) -> Floats:
        """Return the distance of (n, 3) points from the nearest wall, negative inside.

        Raises
        ------
        InputError
            If the points are not an (n, 3) array of finite numbers.
        """
        return box_distance(as_points(points), self.bounds, [k for k in range(3) if not self.periodic[k]])

    def mesh(self) -> tuple[Floats, Integers]:
        """Return vertices and triangles of the boundary."""
        vertices, faces, _ = unit_box()
        return (vertices + 0.5) * np.array(self.lengths) + np.array(self.origin), faces

    def scaled(self, factor: float) -> "Box":
        """Return the box with lengths and corner multiplied.

        Raises
        ------
        InputError
            If the factor is not above 0, or a length is not between 1e-60 and 1e60 any longer.
        """
        times = as_positive(factor, "factor")
        lengths, origin = ([value * times for value in vector] for vector in (self.lengths, self.origin))
        return Box(lengths, self.periodic, origin=origin)

    def with_periodic(self, periodic: Periodic) -> "Box":
        """Return the box with other periodic axes.

        Raises
        ------
        InputError
            If `periodic` names no axes.
        """
        return Box(self.lengths, periodic, origin=self.origin)

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values."""
        return {
            "kind": self.kind,
            "lengths": list(self.lengths),
            "periodic": list(self.periodic),
            "origin": list(self.origin),
        }


def box_distance(points: Floats, bounds: Floats, walled: Sequence[int]) -> Floats:
    """Return the signed distance of points from the walls of a box along the given axes; -inf without walls."""
    if not walled:
        return np.full(len(points), -np.inf)
    axes = list(walled)
    beyond = np.maximum(bounds[0, axes] - points[:, axes], points[:, axes] - bounds[1, axes])
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.where(outside > 0, outside, beyond.max(axis=1))
