"""What comes between the attempts of control-point packing: where grains enter, and the lid that comes down on them."""

import numpy as np

from voxgran.packing.control_point.precompute import Setting, bed_of, put_lid
from voxgran.packing.control_point.walls import room_of_lid
from voxgran.packing.gravity import gravity_vector, main_axis
from voxgran.packing.method import State
from voxgran.packing.problem import Problem
from voxgran.packing.walking.feeding import SETTLE_SWEEPS

#: farthest that the lid comes down after a sweep, in median diameters: a voxel of digital packing
LID_STEP = 1 / 32


def next_event(problem: Problem, state: State) -> int:
    """Return the attempt at which something other than an attempt is due: a layer, the lid, or a look at the bed."""
    counters = state.counters
    if counters["fed_at"] < 0:
        return counters["layer_ends"] if counters["layer_ends"] >= 0 else np.iinfo(np.int64).max
    every = (1 if problem.parameters.lid else SETTLE_SWEEPS) * max(counters["placed"], 1)
    return counters["fed_at"] + ((state.done - counters["fed_at"]) // every + 1) * every


def lower_lid(problem: Problem, state: State, setting: Setting) -> None:
    """Let the lid come down by a small step, no farther than to the next grain."""
    down, lid = main_axis(gravity_vector(problem)), state.arrays["lid"]
    bed = bed_of(problem, state, setting)
    room = float(room_of_lid(bed, setting.bodies, setting.walls, setting.scratch, down))
    lid[0] += min(LID_STEP, room)
    put_lid(problem, setting.walls, float(lid[0]))


def lid_rests(state: State) -> bool:
    """Return whether the lid has hardly come down since the last look, and note where it is."""
    lowered, before = state.arrays["lid"].tolist()
    state.arrays["lid"][1] = lowered
    return bool(lowered - before <= LID_STEP)
