"""Where down is: an axis or any vector, as methods are told it, and the axis along which it is strongest."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import InputError
from voxgran.containers.model import Container
from voxgran.packing.problem import Problem


def gravity_vector(problem: Problem) -> Floats:
    """Return the direction of gravity, of length 1; zero where there is none.

    Raises
    ------
    InputError
        If it has a part along a periodic axis or out of the plane, or its length is 0.
    """
    asked = problem.parameters.gravity
    if asked is None or isinstance(asked, str):
        return axis_of(asked, problem.container).astype(np.float64)
    vector = np.array(asked, dtype=np.float64)
    length = float(np.linalg.norm(vector))
    held = np.array(problem.container.periodic) | (np.arange(3) >= problem.dimension)
    if not np.isfinite(length) or length == 0.0 or vector[held].any():
        raise InputError(
            f"gravity is {vector.tolist()}: it must be finite, not 0, and have no part along a periodic axis or out of "
            "the plane; turn it, or say 'none'"
        )
    return vector / length


def gravity_text(problem: Problem) -> str | list[float]:
    """Return where down is, as it is recorded."""
    asked = problem.parameters.gravity
    if asked is None:
        return _usual_direction(problem.container)
    return asked if isinstance(asked, str) else list(asked)


def main_axis(gravity: Floats) -> Integers:
    """Return the lattice vector along which gravity is strongest; zero where there is none."""
    down = np.zeros(3, dtype=np.int64)
    if gravity.any():
        axis = int(np.argmax(np.abs(gravity)))
        down[axis] = 1 if gravity[axis] > 0 else -1
    return down


def axis_of(asked: str | None, container: Container) -> Integers:
    """Return a direction such as ``"-z"`` as a lattice vector; ``"none"`` is zero, None the usual one.

    Raises
    ------
    InputError
        If it points along a periodic axis, or out of the plane of a 2D container.
    """
    vector = np.zeros(3, dtype=np.int64)
    direction = _usual_direction(container) if asked is None else asked
    if direction != "none":
        axis = "xyz".index(direction[1])
        if axis >= container.dimension or container.periodic[axis]:
            told = repr(direction) if asked else f"not set and thus {direction!r}"
            raise InputError(
                f"gravity is {told}: it must point along a walled axis of the container; choose another axis, or 'none'"
            )
        vector[axis] = -1 if direction[0] == "-" else 1
    return vector


def _usual_direction(container: Container) -> str:
    """Return where down is when nothing is said."""
    return "-z" if container.dimension == 3 else "-y"
