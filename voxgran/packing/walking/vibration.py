"""Cycles of vibration: the fraction of upward moves at each attempt."""

import numpy as np

from voxgran._base.arrays import Integers
from voxgran._base.kernels import bare_kernel
from voxgran.packing.problem import Problem
from voxgran.packing.walking.feeding import patience
from voxgran.packing.walking.state import WalkState


@bare_kernel
def upward_share(first: float, ratio: float, schedule: Integers, attempt: int) -> float:
    """Return the fraction of upward moves, which falls linearly to 0 within each cycle.

    At the beginning of a cycle it is that of the previous cycle times `ratio`, or falls linearly where that is below 0.
    schedule: attempt at which feeding ended (-1: not yet), attempts of all cycles, number of cycles.
    """
    begin, attempts, cycles = schedule[0], schedule[1], schedule[2]
    if begin < 0 or attempt - begin >= attempts:
        return 0.0
    along = (attempt - begin) / attempts * cycles
    cycle = np.floor(along)
    kept = 1.0 - cycle / cycles if ratio < 0.0 else ratio**cycle
    return first * kept * (1.0 - (along - cycle))


def vibration_schedule(problem: Problem, state: WalkState) -> Integers:
    """Return what :func:`upward_share` takes as `schedule`, and the refusals in a row at which feeding is examined."""
    ended = -1 if state.feeding_ended_at is None else state.feeding_ended_at
    length = max(problem.parameters.sweeps, 1) * state.sweep
    return np.array([ended, length, problem.parameters.number_of_cycles, patience(problem)], dtype=np.int64)
