"""Cycles of vibration: the fraction of upward moves at each attempt."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.packing.problem import Problem
from voxgran.packing.walking.feeding import patience
from voxgran.packing.walking.state import WalkState

#: entries of a schedule: attempt at which feeding ended (-1: not yet), attempts of all cycles, number of cycles, and
#: refusals in a row at which feeding is examined
FED_AT, ATTEMPTS, CYCLES, PATIENCE = range(4)
#: entries of the fractions of a walk: upward moves at first, ratio of those of a cycle to those of the previous one
#: (below 0: they fall linearly to 0), rotations, and attempts that insert a grain
UPWARD, RATIO, ROTATION, FEED = range(4)


@bare_kernel
def upward_share(shares: Floats, schedule: Integers, attempt: int) -> float:
    """Return the fraction of upward moves at an attempt, which falls linearly to 0 within each cycle."""
    begin, attempts, cycles, ratio = schedule[FED_AT], schedule[ATTEMPTS], schedule[CYCLES], shares[RATIO]
    if begin < 0 or attempt - begin >= attempts:
        return 0.0
    along = (attempt - begin) / attempts * cycles
    cycle = np.floor(along)
    kept = 1.0 - cycle / cycles if ratio < 0.0 else ratio**cycle
    return shares[UPWARD] * kept * (1.0 - (along - cycle))


def vibration_schedule(problem: Problem, state: WalkState) -> Integers:
    """Return the schedule of a walk at its present stage, (4,)."""
    ended = -1 if state.feeding_ended_at is None else state.feeding_ended_at
    length = max(problem.parameters.sweeps, 1) * state.sweep
    return np.array([ended, length, problem.parameters.number_of_cycles, patience(problem)], dtype=np.int64)
