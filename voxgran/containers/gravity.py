"""The direction in which gravity acts: an axis such as ``"-z"`` or any vector."""

from typing import Any, Protocol, TypeAlias

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, as_vector
from voxgran._base.errors import InputError, shown
from voxgran.containers.model import Container

#: unit vector in which gravity acts
Down: TypeAlias = tuple[float, float, float]
#: the axes as texts; "none" is no direction
AXES = ("-x", "+x", "-y", "+y", "-z", "+z", "none")


class HasGravity(Protocol):
    """A problem whose parameters have a direction of gravity."""

    @property
    def container(self) -> Container:
        """What holds the grains."""

    @property
    def parameters(self) -> Any:
        """Parameters of the method."""


def as_down(asked: Any, container: Container) -> Down | None:
    """Return the unit vector in which gravity acts, or None.

    It is asked for as an axis such as ``"-z"``, a vector (3,), or None or ``"none"``; ``"down"`` is the usual axis
    where it has walls.

    Raises
    ------
    InputError
        If it is no direction, or has a part along a periodic axis or out of the plane.
    """
    if isinstance(asked, str) and asked == "down":
        asked = usual_axis(container)
        asked = None if container.periodic["xyz".index(asked[1])] else asked
    if asked is None:
        return None
    if isinstance(asked, str):
        x, y, z = (float(value) for value in axis_of(asked, container))
    else:
        x, y, z = direction_of(as_vector(asked, "gravity"), container).tolist()
    return (x, y, z) if x or y or z else None


def usual_axis(container: Container) -> str:
    """Return the default direction of gravity: ``"-z"``, in two dimensions ``"-y"``."""
    return "-z" if container.dimension == 3 else "-y"


def proposed_axis(container: Container) -> str:
    """Return the direction of gravity that messages propose: the usual one, or along another axis that has walls."""
    usual = usual_axis(container)
    axes = [usual, *(f"-{axis}" for axis in "xyz"[: container.dimension])]
    return next((axis for axis in axes if not container.periodic["xyz".index(axis[1])]), usual)


def axis_of(asked: str | None, container: Container) -> Integers:
    """Return a direction such as ``"-z"`` as a lattice vector; ``"none"`` is zero, None the usual one.

    Raises
    ------
    InputError
        If it is no axis, points along a periodic axis, or out of the plane of a 2D container.
    """
    vector = np.zeros(3, dtype=np.int64)
    direction = usual_axis(container) if asked is None else asked
    if direction not in AXES:
        raise InputError(f"gravity is {shown(direction)}: it must be a vector or one of {', '.join(AXES)}")
    if direction != "none":
        axis = "xyz".index(direction[1])
        if axis >= container.dimension or container.periodic[axis]:
            told = repr(direction) if asked else f"not set and thus {direction!r}"
            walls = f", or walls along {direction[1]}" if axis < container.dimension else ""
            raise InputError(
                f"gravity is {told}: it must point along a walled axis of the container; choose another axis{walls}, "
                "or 'none'"
            )
        vector[axis] = -1 if direction[0] == "-" else 1
    return vector


def direction_of(vector: Floats, container: Container) -> Floats:
    """Return a vector normalized to length 1; one of length 1 is unchanged.

    Raises
    ------
    InputError
        If its length is 0 or not finite, or it has a part along a periodic axis or out of the plane.
    """
    with np.errstate(over="ignore"):
        length = float(linear.norm(vector))
    held = np.array(container.periodic) | (np.arange(3) >= container.dimension)
    if not np.isfinite(length) or length == 0.0 or vector[held].any():
        raise InputError(
            f"gravity is {vector.tolist()}: it must be finite, not 0, and have no part along a periodic axis or out of "
            "the plane; turn it, or say 'none'"
        )
    # adding 0 removes the sign of a zero
    return (vector if abs(length - 1.0) <= 4e-16 else vector / length) + 0.0


def main_axis(gravity: Floats) -> Integers:
    """Return the lattice vector nearest to gravity; zero if there is none."""
    down = np.zeros(3, dtype=np.int64)
    if gravity.any():
        axis = int(np.argmax(np.abs(gravity)))
        down[axis] = 1 if gravity[axis] > 0 else -1
    return down


def upward(gravity: Integers, dimension: int) -> Integers:
    """Return the lattice vector against gravity, or along the last axis where there is no gravity."""
    last = np.zeros(3, dtype=np.int64)
    last[dimension - 1] = 1
    return -gravity if gravity.any() else last


def gravity_vector(problem: HasGravity) -> Floats:
    """Return the direction of gravity, of length 1; zero if there is none.

    Raises
    ------
    InputError
        If it has a part along a periodic axis or out of the plane, or its length is 0.
    """
    asked = problem.parameters.gravity
    if asked is None or isinstance(asked, str):
        return axis_of(asked, problem.container).astype(np.float64)
    return direction_of(np.array(asked, dtype=np.float64), problem.container)


def gravity_text(problem: HasGravity) -> str | list[float]:
    """Return the direction of gravity as provenance records it."""
    asked = problem.parameters.gravity
    if asked is None:
        return usual_axis(problem.container)
    return asked if isinstance(asked, str) else list(asked)
