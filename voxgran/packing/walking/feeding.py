"""How grains enter while others walk, by rain, in layers or all at once, when feeding ends, and the cycles after it.

Digital and control-point packing feed alike. Grains that are refused too often in a row do not yet tell that the
container is full: those below the entry may still be sinking. So nothing enters for some sweeps, and only where those
hardly sink meanwhile has feeding ended. While grains are fed none of them moves upward, so this does not go on forever.
"""

from collections.abc import Callable

import numpy as np

from voxgran._base.arrays import Floats, Integers, as_count
from voxgran._base.errors import InputError
from voxgran.containers.model import boundary_of
from voxgran.packing.gravity import gravity_vector, main_axis
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
#: sweeps in which grains are watched sinking after too many refusals
SINK_SWEEPS = 40
#: mean sinking in median diameters of a grain below the entry in these sweeps, below which the container is full
SINK_DEPTH = 0.001
#: share of attempts that let a grain enter, at which a container counts as full after the usual number of refusals
USUAL_RATE = 0.05


def entry_of(problem: Problem, gravity: Floats) -> Integers:
    """Return the lattice vector against which grains enter, zero where they enter anywhere.

    Boxes and cylinders that stand have a flat top. That of any other container may have no room for a grain: there
    they enter anywhere.
    """
    walls, down = boundary_of(problem.container), main_axis(gravity)
    stands = walls.is_flat or (walls.round_axes == 2 and down[2] != 0)
    return down if stands and problem.parameters.feed != "at_once" else np.zeros(3, dtype=np.int64)


def feed_share(problem: Problem, state: State) -> float:
    """Return the share of attempts that let a grain enter."""
    settings = problem.parameters
    if settings.feed == "at_once":
        return 1.0
    if state.counters["layer_ends"] >= 0:
        # those that have entered sink
        return 0.0
    return 1.0 if settings.feed == "layers" else float(settings.rate)


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


def look_at_queue(problem: Problem, state: State, due: int, places: Callable[[], Floats]) -> None:
    """End feeding when all have entered, or when nothing enters any more; let grains sink between layers.

    They also sink where too many were refused, and feeding goes on after that if those below the entry have sunk.

    due: at which attempt they have sunk.  places: gives the centroids of the grains that have entered.
    """
    counters = state.counters
    layer = problem.parameters.feed == "layers" and counters["placed"] > counters["layer_placed"]
    if counters["placed"] == problem.count:
        _end_feeding(problem, state)
    elif counters["layer_ends"] >= 0:
        if state.done < due:
            return
        if layer or _have_sunk(problem, state, places()):
            counters.update(layer_ends=-1, layer_placed=counters["placed"], feeds_refused_in_a_row=0)
        else:
            _end_feeding(problem, state)
    elif counters["feeds_refused_in_a_row"] >= patience(problem):
        if layer or _may_sink(problem, state):
            sweeps = problem.parameters.layer_sweeps if layer else SINK_SWEEPS
            counters["layer_ends"] = state.done + sweeps * counters["placed"]
            state.arrays["brim"][:] = _brim(problem, places())
        else:
            _end_feeding(problem, state)


def _end_feeding(problem: Problem, state: State) -> None:
    """Note when feeding ended, and how long the bed may take."""
    placed = state.counters["placed"]
    state.counters.update(fed_at=state.done, layer_ends=-1)
    state.total = state.done + most_attempts(problem, placed)
    if placed == 0:
        state.stop_reason = "full"


def _may_sink(problem: Problem, state: State) -> bool:
    """Return whether grains that sink could make room for others."""
    falls = bool(gravity_vector(problem).any())
    return falls and state.counters["placed"] > 0 and problem.parameters.feed != "at_once"


def _have_sunk(problem: Problem, state: State, places: Floats) -> bool:
    """Return whether the grains that were below the entry have sunk while nothing entered."""
    before, many = state.arrays["brim"]
    return bool(before - _brim(problem, places)[0] > SINK_DEPTH * many)


def _brim(problem: Problem, places: Floats) -> tuple[float, int]:
    """Return the sum of the heights of grains that may be in the way of one that enters, and their number.

    Heights begin so far below the entry that none of those below is in the way; where grains enter anywhere, all count.
    """
    gravity = gravity_vector(problem)
    height, entry = -(places @ main_axis(gravity)), entry_of(problem, gravity)
    if entry.any():
        radius = np.array([shape.bounding_radius for shape in problem.shapes])[problem.shape_id] * problem.diameter
        top = float(np.max(-(np.array(problem.container.bounds) @ entry)))
        height = np.maximum(height - (top - 4.0 * float(radius.max())), 0.0)
        return float(height.sum()), int(np.count_nonzero(height))
    return float(height.sum()), len(height)
