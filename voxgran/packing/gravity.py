"""Where down is, as methods are told it, and the axis along which it is strongest."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.packing.down import axis_of, direction_of, usual_axis
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
    return direction_of(np.array(asked, dtype=np.float64), problem.container)


def gravity_text(problem: Problem) -> str | list[float]:
    """Return where down is, as it is recorded."""
    asked = problem.parameters.gravity
    if asked is None:
        return usual_axis(problem.container)
    return asked if isinstance(asked, str) else list(asked)
