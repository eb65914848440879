"""Feeding of the walking methods: as rain, in layers or everywhere, and the criterion by which it ends.

Many refusals in a row do not prove that the container is full: grains below the entry may still be sinking. Feeding is
then interrupted for some sweeps, and ends if those grains hardly sink meanwhile. During feeding no grain moves upward,
so feeding ends after a finite number of attempts.
"""

import math
from collections.abc import Callable

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran.containers.gravity import gravity_vector, main_axis
from voxgran.containers.model import boundary_of
from voxgran.packing.problem import Problem
from voxgran.packing.walking.state import WalkState

#: sweeps between two examinations of whether the bed still sinks
SETTLE_SWEEPS = 200
#: largest number of examinations after the last cycle
SETTLE_LOOKS = 40
#: refusals in a row after which a layer is full
LAYER_REFUSALS = 300
#: sweeps for which feeding is interrupted after too many refusals
SINK_SWEEPS = 40
#: mean sinking in median diameters of a grain below the entry in these sweeps, below which the container is full
SINK_DEPTH = 0.001
#: fraction of attempts that insert a grain, up to which the usual number of refusals counts as full
USUAL_RATE = 0.05
#: part of the container from which on grains are refused until it is full, and how often feeding then waits for the bed
#: to sink, in proportion to the grains (measured: within a factor of 2 for 200 to 3000 of them)
NEARLY_FULL, WAITS = 0.3, 1 / 1500


def entry_of(problem: Problem, gravity: Floats) -> Integers:
    """Return the lattice vector against which grains enter, zero where they enter anywhere.

    Boxes and cylinders that stand have a flat top. That of any other container may have no room for a grain: there
    they enter anywhere.
    """
    down = main_axis(gravity)
    stands = boundary_of(problem.container).has_flat_ends(int(np.abs(down).argmax()))
    return down if stands and problem.parameters.feed != "at_once" else np.zeros(3, dtype=np.int64)


def feed_share(problem: Problem, state: WalkState) -> float:
    """Return the fraction of the attempts that insert a grain."""
    settings = problem.parameters
    if settings.feed == "at_once":
        return 1.0
    if state.layer_ends is not None:
        # the grains that have entered sink
        return 0.0
    return 1.0 if settings.feed == "layers" else float(settings.rate)


def patience(problem: Problem) -> int:
    """Return the number of refusals in a row after which the container, or a layer, counts as full."""
    if problem.parameters.feed == "layers":
        return LAYER_REFUSALS
    # at a high rate grains are refused often while those before them sink
    return int(max(2000, 20 * problem.count) * max(1.0, problem.parameters.rate / USUAL_RATE))


def most_attempts(problem: Problem, grains: int) -> int:
    """Return the largest number of attempts of a walk of so many grains after feeding.

    A walk that is too short for an examination of the bed ends with its sweeps, unless a lid has to come down.
    """
    sweeps: int = problem.parameters.sweeps
    examined = sweeps >= SETTLE_SWEEPS or problem.parameters.lid
    return grains * (sweeps + (SETTLE_LOOKS * SETTLE_SWEEPS if examined else 0))


def usual_seconds(problem: Problem, moved: float, refused: float) -> float:
    """Return the expected CPU time of a walk, without examinations of the bed, by those of two attempts.

    moved, refused: seconds of an attempt while grains find room at their first tries, and in a container that they
    fill, where feeding waits again and again for grains that sink.
    """
    settings, n = problem.parameters, problem.count
    rate = float(settings.rate) if settings.feed == "rain" else 1.0
    seconds = n * moved * (settings.sweeps + 1 / rate)
    # a count that is given has usually room
    full = problem.asked_count is None and float(problem.volumes.sum()) > NEARLY_FULL * problem.container.volume
    if full and n > problem.started:
        seconds += refused * WAITS * n * patience(problem) / rate
    return seconds


def planned_attempts(problem: Problem) -> int:
    """Return the number of attempts of a walk with its feeding, if all grains find room at their first tries.

    Of the attempts while grains rain a share `rate` inserts one, at random: six standard deviations are added.
    """
    settings, n = problem.parameters, problem.count
    rate = float(settings.rate) if settings.feed == "rain" else 1.0
    return most_attempts(problem, n) + math.ceil((n + 6.0 * math.sqrt(n) + 20.0) / rate)


def examine_feeding(problem: Problem, state: WalkState, due: int, positions: Callable[[], Floats]) -> None:
    """End feeding when all grains have entered or none enters any more; interrupt it while a layer sinks.

    After too many refusals feeding is interrupted as well, and resumed if the grains below the entry have sunk. `due`
    is the attempt at which the interruption ends; `positions` returns the centroids of the grains that have entered.
    """
    layer = problem.parameters.feed == "layers" and state.placed > state.layer_placed
    if state.placed == problem.count:
        _end_feeding(problem, state)
    elif state.layer_ends is not None:
        if state.done < due:
            return
        if layer or _have_sunk(problem, state, positions()):
            state.layer_ends, state.layer_placed, state.feeds_refused_in_a_row = None, state.placed, 0
        else:
            _end_feeding(problem, state)
    elif state.feeds_refused_in_a_row >= patience(problem):
        if layer or _may_sink(problem, state):
            sweeps = problem.parameters.layer_sweeps if layer else SINK_SWEEPS
            state.layer_ends = state.done + sweeps * state.placed
            state.surface_height, state.surface_grains = _surface_height(problem, positions())
        else:
            _end_feeding(problem, state)


def _end_feeding(problem: Problem, state: WalkState) -> None:
    """Record when feeding ended, and the largest number of attempts of the walk."""
    state.feeding_ended_at, state.layer_ends = state.done, None
    state.total = state.done + most_attempts(problem, state.placed)
    if state.placed == 0:
        state.stop_reason = "full"


def _may_sink(problem: Problem, state: WalkState) -> bool:
    """Return whether sinking grains could make room for others."""
    falls = bool(gravity_vector(problem).any())
    return falls and state.placed > 0 and problem.parameters.feed != "at_once"


def _have_sunk(problem: Problem, state: WalkState, positions: Floats) -> bool:
    """Return whether the grains below the entry have sunk while feeding was interrupted."""
    sunk = state.surface_height - _surface_height(problem, positions)[0]
    return bool(sunk > SINK_DEPTH * state.surface_grains)


def _surface_height(problem: Problem, positions: Floats) -> tuple[float, int]:
    """Return the sum of the heights of grains that could obstruct one that enters, and their number.

    Heights are measured from so far below the entry that no grain below that level can obstruct it; where grains enter
    anywhere, all grains count.
    """
    gravity = gravity_vector(problem)
    height, entry = -linear.matmul(positions, main_axis(gravity)), entry_of(problem, gravity)
    if entry.any():
        radius = problem.bounding_radii
        top = float(np.max(-linear.matmul(np.array(problem.container.bounds), entry)))
        height = np.maximum(height - (top - 4.0 * float(radius.max())), 0.0)
        return float(height.sum()), int(np.count_nonzero(height))
    return float(height.sum()), len(height)
