"""The walk: feeding and vibration, written once for all methods that move grains at random.

A method supplies a :class:`Walker`, which knows how grains are represented and runs the kernel that moves them; the
functions of this module decide when feeding ends, when the lid is lowered, and when the bed has settled.
"""

import math
from collections.abc import Mapping
from typing import Any, Protocol, TypeVar

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import Held
from voxgran.containers.gravity import gravity_text, gravity_vector
from voxgran.geometry.rotation import normalized
from voxgran.packing.model import Packing
from voxgran.packing.problem import Problem
from voxgran.packing.start import Start
from voxgran.packing.walking.entering import entry_order
from voxgran.packing.walking.feeding import SETTLE_SWEEPS, examine_feeding, most_attempts
from voxgran.packing.walking.state import WalkState

S = TypeVar("S", bound=WalkState)
S_contra = TypeVar("S_contra", bound=WalkState, contravariant=True)


class Walker(Protocol[S_contra]):
    """What a method has to know so that its grains can walk; poses are in the normalized frame."""

    def enter_start(self, problem: Problem, state: S_contra, start: Start) -> None:
        """Insert the grains of the start."""

    def make_attempts(self, problem: Problem, state: S_contra, last: int) -> None:
        """Run the kernel up to attempt `last`, or until no grain is waiting or too many were refused.

        What follows from the problem and the state is made where it is missing.
        """

    def between_sweeps(self, problem: Problem, state: S_contra) -> None:
        """Do what is due between two sweeps: called once when feeding has ended, then every `event_sweeps` sweeps."""

    def event_sweeps(self, problem: Problem) -> int:
        """Return the number of sweeps after which something is due besides the examination of the bed."""

    def poses(self, problem: Problem, state: S_contra) -> tuple[Floats, Floats]:
        """Return centroids and orientations of the grains that have entered."""

    def has_settled(self, problem: Problem, state: S_contra) -> bool:
        """Return whether the bed has hardly sunk since the last call, and record its height."""


def begin(walker: Walker[S], problem: Problem, state: S) -> S:
    """Return the first state, in which all grains are waiting but those of the start.

    Raises
    ------
    InputError
        If gravity points along a periodic axis, or a grain of the start finds no place.
    """
    gravity_vector(problem)
    count, start = problem.count, problem.start
    state.waiting, state.total = entry_order(problem, 0), most_attempts(problem, count)
    if count == 0:
        state.stop_reason = "count"
    counts = dict.fromkeys((name for name in state.counters if name not in state.declared), Held(0))
    grains = dict.fromkeys(("placed", "layer_placed", "surface_grains"), Held(0, count))
    own = {"waiting": Held(0, count - 1), "height": Held(high=math.inf)}
    state.declared = {**counts, **state.declared, **grains, **own}
    state.rule = _fits
    if start is not None and start.count:
        walker.enter_start(problem, state, start)
        state.waiting, state.placed = entry_order(problem, start.count), start.count
        if start.count == count:
            _examine_feeding(walker, problem, state, -1)
    return state


def _fits(arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
    """Return whether what a checkpoint holds goes together: the grains that have entered are the last of the queue."""
    waiting, placed = arrays["waiting"], counters["placed"]
    entered = arrays["entered"] > 0 if "entered" in arrays else arrays["member"] >= 0
    order = arrays.get("order", waiting[:0])
    return bool(
        len(np.unique(waiting)) == len(waiting) and entered.sum() == placed <= len(waiting)
        and entered[waiting[len(waiting) - placed :]].all() and len(np.unique(order)) == len(order)
        and entered[order].all()
    )  # fmt: skip


def advance(walker: Walker[S], problem: Problem, state: S, attempts: int) -> S:
    """Make up to `attempts` attempts: first of feeding, then of vibration."""
    if state.stop_reason:
        return state
    last = state.done + attempts
    if attempts == 0:
        walker.make_attempts(problem, state, last)
    while state.done < last and not state.stop_reason:
        due = _next_event(walker, problem, state)
        walker.make_attempts(problem, state, min(last, due))
        if state.feeding_ended_at is None:
            _examine_feeding(walker, problem, state, due)
        elif state.done == due:
            walker.between_sweeps(problem, state)
            examined = (state.done - state.feeding_ended_at) % (SETTLE_SWEEPS * state.sweep) == 0
            if examined or state.done >= state.total:
                _examine_bed(walker, problem, state)
    return state


def finished(
    walker: Walker[S], problem: Problem, state: S, *, contact_gap: float, voxel_size: float | None = None
) -> Packing:
    """Return the packing of the grains that have entered; gap of contacts and voxels in median diameters."""
    position, orientation = walker.poses(problem, state)
    provenance: dict[str, Any] = {
        "parameters": {"gravity": gravity_text(problem)},
        "lid_lowered": state.lid_lowered * problem.unit_length,
    }
    return problem.packing(
        state.grains,
        position=position,
        # steps off a lattice leave quaternions of either sign
        orientation=orientation if voxel_size else normalized(orientation),
        provenance=provenance,
        voxel_size=voxel_size,
        stop_reason=state.stop_reason,
        gravity=gravity_vector(problem),
        contact_gap=contact_gap,
    )


def _next_event(walker: Walker[S], problem: Problem, state: S) -> int:
    """Return the attempt before which only the kernel has to run."""
    if state.feeding_ended_at is None:
        return int(np.iinfo(np.int64).max) if state.layer_ends is None else state.layer_ends
    since, sweep = state.done - state.feeding_ended_at, state.sweep
    intervals = (walker.event_sweeps(problem) * sweep, SETTLE_SWEEPS * sweep)
    due: int = state.feeding_ended_at + min((since // every + 1) * every for every in intervals)
    return max(state.done, min(due, state.total))


def _examine_feeding(walker: Walker[S], problem: Problem, state: S, due: int) -> None:
    """End or interrupt feeding where it is time."""
    examine_feeding(problem, state, due, lambda: walker.poses(problem, state)[0])
    if state.feeding_ended_at is not None:
        walker.between_sweeps(problem, state)


def _examine_bed(walker: Walker[S], problem: Problem, state: S) -> None:
    """End the walk when the bed no longer sinks after the last cycle, or when the attempts are used up."""
    settled = walker.has_settled(problem, state) or not gravity_vector(problem).any()
    vibrated = state.done - (state.feeding_ended_at or 0) >= problem.parameters.sweeps * state.placed
    if (settled and vibrated) or state.done >= state.total:
        # that nothing sinks any more proves no rest
        reason = "count" if settled and vibrated else "steps"
        state.stop_reason = reason if state.has_all else "full"
