"""A box with walls or periodic faces."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, Integers, as_points, as_positive, as_vector
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran.shapes.tessellate import unit_box


@dataclass(frozen=True, init=False)
class Box:
    """A box along the axes.

    Parameters
    ----------
    lengths : (3,) sequence of float
        Edges, in the unit of lengths.
    periodic : (3,) sequence of bool, or of axis names
        Which axes are periodic: flags, or names such as ``["x", "y"]``.
    origin : (3,) sequence of float
        Lower corner.

    Raises
    ------
    CallError
        If the arguments are others than these.
    InputError
        If a length is not above 0 or `periodic` is neither three flags nor axis names.
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
        periodic: Sequence[bool] | Sequence[str] = (False, False, False),
        *,
        origin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        x, y, z = (as_positive(float(value), "length of the box") for value in as_vector(lengths, "lengths"))
        a, b, c = (float(value) for value in as_vector(origin, "origin"))
        object.__setattr__(self, "lengths", (x, y, z))
        object.__setattr__(self, "periodic", periodic_flags(periodic, 3))
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
        """Return the box with lengths and corner multiplied."""
        return Box(np.array(self.lengths) * factor, self.periodic, origin=np.array(self.origin) * factor)

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values."""
        return {
            "kind": self.kind,
            "lengths": list(self.lengths),
            "periodic": list(self.periodic),
            "origin": list(self.origin),
        }


def periodic_flags(periodic: Any, dimension: int) -> tuple[bool, bool, bool]:
    """Return three flags from flags or axis names; axes beyond the dimension are not periodic.

    Raises
    ------
    InputError
        If it is neither `dimension` flags nor names of axes.
    """
    names = "xyz"[:dimension]
    listed = isinstance(periodic, Iterable) and not isinstance(periodic, Mapping)
    # what is no list counts as one wrong entry
    given = list(periodic) if listed else [periodic]
    if all(isinstance(item, str) and item in names and len(item) == 1 for item in given):
        flags = [axis in given for axis in names]
    elif len(given) == dimension and all(isinstance(item, bool | np.bool_) for item in given):
        flags = [bool(item) for item in given]
    else:
        raise InputError(
            f"periodic is {periodic!r}: it must be {dimension} times true or false, or names of axes out of "
            f"{', '.join(names)}; change it"
        )
    flags += [False] * (3 - dimension)
    return flags[0], flags[1], flags[2]


def box_distance(points: Floats, bounds: Floats, walled: Sequence[int]) -> Floats:
    """Return the signed distance of points from the walls of a box along the given axes; -inf without walls."""
    if not walled:
        return np.full(len(points), -np.inf)
    axes = list(walled)
    beyond = np.maximum(bounds[0, axes] - points[:, axes], points[:, axes] - bounds[1, axes])
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    return np.where(outside > 0, outside, beyond.max(axis=1))
