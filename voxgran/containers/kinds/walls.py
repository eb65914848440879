"""A container put together from walls: what lies within planes, cylinders, cones and spheres."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import as_length, as_number, as_place, as_positive, as_vector
from voxgran._base.calls import explained_methods
from voxgran._base.errors import InputError, UnknownNameError, check_known, shown, unknown
from voxgran.containers.equipment import Equipment, Space, multiplied, space_within
from voxgran.containers.model import ContainerKind
from voxgran.geometry.walls import Round, cone, plane

#: keys of each kind of wall beside its point, and which of them may be left out
KEYS = {
    "plane": {"normal": True},
    "cylinder": {"radius": True, "axis": False},
    "cone": {"radius": True, "angle": True, "axis": False},
    "sphere": {"radius": True},
}


@explained_methods
@dataclass(frozen=True, eq=False)
class Walls(Equipment):
    """What lies within all of several walls, which is convex.

    Parameters
    ----------
    wall : sequence of mapping
        Walls, each with a ``kind`` and a ``point``, by default the origin, in the unit of lengths: ``"plane"`` through
        the point with a ``normal`` that points out of the container; ``"cylinder"`` of a ``radius`` about an ``axis``
        through the point; ``"cone"`` that has the ``radius`` at the point and widens along the axis at an ``angle`` in
        degrees, above 0 and at most 179, from a plane across the axis; ``"sphere"`` of a ``radius`` about the point. An
        axis is ``"x"``, ``"y"``, ``"z"`` or a vector, by default ``"z"``.

    Attributes
    ----------
    volume_error : float
        Relative error of the volume: 0 where all walls are planes, else twice the largest difference between sums
        over the lengths of 320 by 320 lines and of fewer.

    Raises
    ------
    CallError
        If there are other arguments than these.
    UnknownNameError
        If the kind or a key of a wall is unknown.
    InputError
        If a key is missing, a number is out of range, nothing lies within all walls, or what does is not bounded.

    Examples
    --------
    >>> import voxgran as vg
    >>> wall = [{"kind": "sphere", "radius": 2.0}, {"kind": "plane", "normal": [0, 0, 1]}]
    >>> bowl = vg.Walls(wall)
    >>> round(bowl.volume, 3), bowl.bounds[1].round(9).tolist(), bowl.volume_error < 1e-4
    (16.755, [2.0, 2.0, 0.0], True)
    """

    wall: Any
    kind: ClassVar[str] = "walls"
    _lengths: ClassVar[tuple[str, ...]] = ("wall",)

    def __post_init__(self) -> None:
        """Check the walls."""
        if not isinstance(self.wall, list | tuple) or not self.wall:
            raise InputError(
                f"wall is {shown(self.wall)}: it must be a list of one wall or more; give mappings with the key kind"
            )
        self._set("wall", tuple(_checked(wall, f"wall {k}") for k, wall in enumerate(self.wall)))
        _ = self.space

    @cached_property
    def space(self) -> Space:
        """The space within the walls."""
        return space_within([_wall_of(wall) for wall in self.wall], "container of walls")

    @property
    def volume_error(self) -> float:
        """Relative error of the volume."""
        return self.space.error

    def scaled(self, factor: float) -> "Walls":
        """Return the container with all lengths multiplied.

        Raises
        ------
        InputError
            If the factor is not above 0, or a length is not between 1e-60 and 1e60 any longer.

        Examples
        --------
        >>> import voxgran as vg
        >>> sphere = vg.Walls([{"kind": "sphere", "radius": 2.0}])
        >>> sphere.scaled(2.0).bounds[1].tolist()
        [4.0, 4.0, 4.0]
        """
        times = as_positive(factor, "factor")
        lengths = ("point", "radius")
        return Walls(
            [
                {key: multiplied(value, times) if key in lengths else value for key, value in wall.items()}
                for wall in self.wall
            ]
        )


def direction(value: "ArrayLike", name: str) -> tuple[float, float, float]:
    """Return the unit vector of an axis, given by its name or as a vector.

    Raises
    ------
    InputError
        If it is neither, or a vector of length 0.
    """
    if isinstance(value, str) and value.lstrip("+-") in ("x", "y", "z"):
        value = np.eye(3)["xyz".index(value[-1])] * (-1 if value[0] == "-" else 1)
    vector = as_vector(value, name)
    length = float(linear.norm(vector))
    if not length > 0:
        raise InputError(f"{name} is {shown(value)}: it must have a length; give another vector")
    x, y, z = (vector / length).tolist()
    return x, y, z


def _checked(wall: Any, where: str) -> dict[str, Any]:
    """Return the mapping of a wall with plain numbers, all keys given."""
    if not isinstance(wall, Mapping):
        raise InputError(f"{where} is {shown(wall)}: it must be a mapping with the key kind; give one")
    kind: Any = wall.get("kind")
    check_known(f"{where} kind", kind, KEYS)
    for key in wall:
        if key not in ("kind", "point", *KEYS[kind]):
            raise UnknownNameError(unknown(f"{where} key", key, ["point", *KEYS[kind]]))
    made = {"kind": kind, "point": as_place(wall.get("point", (0.0, 0.0, 0.0)), f"point of {where}").tolist()}
    for key, required in KEYS[kind].items():
        if required and key not in wall:
            raise InputError(f"{where} has no {key}: a {kind} needs it; add it")
        value, name = wall.get(key, "z"), f"{key} of {where}"
        if key == "radius":
            made[key] = as_length(value, name)
        elif key == "angle":
            made[key] = as_number(value, name, above=0.0, at_most=179.0)
        else:
            direction(value, name)
            made[key] = value if isinstance(value, str) else as_vector(value, name).tolist()
    return made


def _wall_of(wall: Mapping[str, Any]) -> Round:
    """Return the wall of a checked mapping."""
    point, radius = tuple(wall["point"]), wall.get("radius", 0.0)
    if wall["kind"] == "plane":
        return plane(point, direction(wall["normal"], "normal"))
    if wall["kind"] == "sphere":
        return Round(point, radius, axes=3)
    made = Round(point, radius) if wall["kind"] == "cylinder" else cone(point, radius, math.radians(wall["angle"]))
    return made._replace(axis=direction(wall["axis"], "axis"))


registration = ContainerKind(container=Walls)
