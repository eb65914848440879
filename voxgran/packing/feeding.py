"""How grains enter while others walk, by rain, in layers or all at once, when feeding ends, and the cycles after it.

Digital and control-point packing feed alike.
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers, as_count
from voxgran._base.errors import InputError
from voxgran.containers.closed_mesh import ClosedMesh
from voxgran.containers.cylinder import Cylinder
from voxgran.containers.sphere import Sphere
from voxgran.packing.gravity import main_axis
from voxgran.packing.method import State
from voxgran.packing.problem import Problem

#: sweeps between two looks at whether the bed still sinks
SETTLE_SWEEPS = 200
#: looks at the most after the last cycle
SETTLE_LOOKS = 40
#: attempts per grain that are asked for at the most: those of all grains are still numbers of 64 bits
MOST_SWEEPS = 10**9
#: refusals in a row after which a layer is full
LAYER_REFUSALS = 300
#: share of attempts that let a grain enter, at which a container counts as full after the usual number of refusals
USUAL_RATE = 0.05


def entry_of(problem: Problem, gravity: Floats) -> Integers:
    """Return the lattice vector against which grains enter, zero where they enter anywhere.

    The top of a mesh, a sphere or a cylinder that lies may have no room for any grain: there they enter anywhere.
    """
    container, down = problem.container, main_axis(gravity)
    lies = isinstance(container, Cylinder) and down[2] == 0
    if problem.parameters.feed == "at_once" or isinstance(container, ClosedMesh | Sphere) or lies:
        return np.zeros(3, dtype=np.int64)
    return down


def feed_share(problem: Problem, state: State) -> float:
    """Return the share of attempts that let a grain enter."""
    settings = problem.parameters
    if settings.feed == "layers":
        # a layer enters at once, then sinks
        return 1.0 if state.counters["layer_ends"] < 0 else 0.0
    return 1.0 if settings.feed == "at_once" else float(settings.rate)


def patience(problem: Problem) -> int:
    """Return after how many refusals in a row the container, or a layer, counts as full."""
    if problem.parameters.feed == "layers":
        return LAYER_REFUSALS
    # grains that enter often are refused often, while those before them sink
    return int(max(2000, 20 * problem.count) * max(1.0, problem.parameters.rate / USUAL_RATE))


def most_attempts(problem: Problem, grains: int) -> int:
    """Return after how many attempts the bed of so many grains is given up."""
    sweeps: int = problem.parameters.sweeps
    return grains * (sweeps + SETTLE_LOOKS * SETTLE_SWEEPS)


def check_cycles(cycles: int | None, period: int | None) -> None:
    """Check the cycles of vibration, given by their number or by their period.

    Raises
    ------
    InputError
        If one is below 1 or above a billion, or both are given.
    """
    for name, value in (("cycles", cycles), ("period", period)):
        if value is not None:
            as_count(value, name, at_least=1, at_most=MOST_SWEEPS)
    if cycles is not None and period is not None:
        raise InputError(f"cycles is {cycles} and period {period}: each makes the number of cycles; leave one out")


def cycles_of(problem: Problem, usual: int) -> int:
    """Return the number of cycles of vibration, the usual one where neither it nor a period is given."""
    settings = problem.parameters
    if settings.period is not None:
        return max(1, round(settings.sweeps / settings.period))
    return usual if settings.cycles is None else int(settings.cycles)


def look_at_queue(problem: Problem, state: State, due: int) -> None:
    """End feeding when all have entered, or when nothing enters any more; begin and end layers."""
    counters = state.counters
    full = counters["feeds_refused_in_a_row"] >= patience(problem)
    if problem.parameters.feed == "layers" and counters["placed"] < problem.count:
        if counters["layer_ends"] >= 0 and state.done == due:
            counters.update(layer_ends=-1, layer_placed=counters["placed"], feeds_refused_in_a_row=0)
            return
        if full and counters["layer_ends"] < 0 and counters["placed"] > counters["layer_placed"]:
            counters["layer_ends"] = state.done + problem.parameters.layer_sweeps * counters["placed"]
            return
        full = full and counters["layer_ends"] < 0
    if counters["placed"] == problem.count or full:
        counters["fed_at"] = state.done
        state.total = state.done + most_attempts(problem, counters["placed"])
        if counters["placed"] == 0:
            state.stop_reason = "full"
