"""What follows the walk of grains: true shapes that still overlap are parted, are shaken, and settle.

Each sweep counts as one attempt per grain, so that a run may stop between any two and go on with the same bits. A lid
that has come down is one more wall. Grains that have to be parted may push it back; while they settle it stays above
them and comes down with them.
"""

from dataclasses import dataclass, replace

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.seeds import stream
from voxgran._base.stopping import Stopped
from voxgran.contacts.assembly import Assembly, Lid
from voxgran.contacts.walls import beyond_lid
from voxgran.packing.gravity import main_axis
from voxgran.packing.walking.parameters import Settling
from voxgran.packing.walking.state import WalkState
from voxgran.settling.settle import CALM, follow, part_once
from voxgran.settling.trial_motion import free_fall, shaken_fall

#: sweeps at the most in which overlapping grains are parted
PART_SWEEPS = 100
#: how a walk may end, by number
ENDS = ("settled", "full", "steps")
#: smallest step of settling, in median diameters: at rest
SMALLEST = 1e-3
#: step of shaking, in median diameters, and sweeps for which a grain is pulled in one direction
SHAKE_STEP, SHAKE_SWEEPS = 0.05, 3


@dataclass(frozen=True, slots=True)
class Finishing:
    """What follows the walk; lengths in median diameters."""

    settings: Settling
    gravity: Floats  # (3,): unit vector, zero where there is no gravity
    seed: int
    parts: bool  # whether grains may overlap, or be too near, and have to be parted
    step: float  # first step of settling
    distance: float = 0.0  # that surfaces have to keep where grains are parted and do not settle

    @property
    def sweeps(self) -> int:
        """The most sweeps that it takes."""
        settings = self.settings
        return PART_SWEEPS * self.parts + (settings.shaking + settings.settling if settings.settling else 0)


def end_walk(state: WalkState, finishing: Finishing, assembly: Assembly, reason: str) -> None:
    """End the walk for a reason, one of `ENDS`, and go on with the true shapes where that is asked for or needed.

    From then on the state has the poses of the grains that have entered, those of the assembly, only.
    """
    if not finishing.sweeps:
        state.stop_reason = reason
        return
    state.walk_end, state.walked = ENDS.index(reason), state.done
    _keep(state, assembly)
    state.total = state.done + finishing.sweeps * state.sweep
    if not finishing.parts:
        _end_parting(state, finishing, assembly)


def finish_some(state: WalkState, finishing: Finishing, assembly: Assembly, last: int) -> None:
    """Make the next sweep if it is due before attempt `last`: a sweep counts as many attempts as there are grains.

    Raises
    ------
    Stopped
        If the run was asked to stop; the sweep is then not made.
    """
    settles = state.settling_at >= 0
    begin, sweep = (state.settling_at, state.settling_sweeps) if settles else (state.walked, state.parting_sweeps)
    due = begin + (sweep + 1) * state.sweep
    if last < due:
        state.done = last
        return
    before, state.done = state.done, due
    try:
        if settles:
            _settle(state, finishing, under_lid(state, finishing, assembly))
        else:
            _part(state, finishing, assembly)
    except Stopped:
        # a sweep changes the state at its end only
        state.done = before
        raise


def finishing_report(state: WalkState, assembly: Assembly, gravity: Floats) -> dict[str, dict[str, float]]:
    """Return the record of parting and settling for the provenance.

    `parting`: sweeps, and the number of pairs too near and of grains beyond walls that are left. `settling`: sweeps,
    mean sinking in median diameters, and the relative gain in density.
    """
    report: dict[str, dict[str, float]] = {}
    if state.parting_sweeps:
        report["parting"] = {"sweeps": state.parting_sweeps, "overlapping": state.left_overlapping}
    if state.settling_at >= 0:
        before, after = float(state.settling[1]), _height(assembly, gravity)
        report["settling"] = {
            "sweeps": state.settling_sweeps,
            "mean_sinking": before - after,
            "density_gain": before / after - 1.0 if after > 0 else 0.0,
        }
    return report


def under_lid(state: WalkState, finishing: Finishing, assembly: Assembly) -> Assembly:
    """Return the grains with the lid over them, if it has been lowered."""
    if state.lid_lowered <= 0.0:
        return assembly
    up = -main_axis(finishing.gravity)
    axis = int(np.argmax(np.abs(up)))
    lower, upper = assembly.container.bounds
    level = upper[axis] - state.lid_lowered if up[axis] > 0 else -(lower[axis] + state.lid_lowered)
    return replace(assembly, lid=Lid(up.astype(np.float64), float(level)))


def _part(state: WalkState, finishing: Finishing, assembly: Assembly) -> None:
    """Make a sweep of parting."""
    sweep = state.parting_sweeps
    after, state.left_overlapping = part_once(assembly, finishing.gravity, sweep, distance=finishing.distance)
    _keep(state, after)
    state.parting_sweeps += 1
    if not state.left_overlapping or state.parting_sweeps == PART_SWEEPS:
        _rest_lid(state, finishing, after)
        _end_parting(state, finishing, after)


def _end_parting(state: WalkState, finishing: Finishing, assembly: Assembly) -> None:
    """Stop, or let the true shapes settle; grains that could not be parted stay as they are."""
    if not finishing.settings.settling or state.left_overlapping:
        state.stop_reason = ENDS[state.walk_end or 0]
        return
    state.settling = np.array([finishing.step, _height(assembly, finishing.gravity), finishing.step])
    state.settling_at, state.settling_sweeps = state.done, 0


def _settle(state: WalkState, finishing: Finishing, assembly: Assembly) -> None:
    """Make a sweep of shaking or settling."""
    sweep = state.settling_sweeps
    after, rests = (_shake if sweep < finishing.settings.shaking else _fall)(state, finishing, assembly)
    _keep(state, after)
    _rest_lid(state, finishing, after)
    state.settling_sweeps += 1
    if rests or sweep + 1 >= finishing.settings.shaking + finishing.settings.settling:
        reason = "settled" if rests else "steps"
        state.stop_reason = reason if state.has_all else "full"


def _shake(state: WalkState, finishing: Finishing, assembly: Assembly) -> tuple[Assembly, bool]:
    """Return the grains after a sweep in which each is pulled and turned its own way; they do not rest yet."""
    sweep = state.settling_sweeps
    strength = finishing.settings.acceleration * (1.0 - sweep / finishing.settings.shaking)
    draws = stream(finishing.seed, "shaking", sweep // SHAKE_SWEEPS)
    motion = shaken_fall(assembly, SHAKE_STEP * finishing.gravity, strength, draws)
    return follow(assembly, motion, finishing.settings.friction)[0], False


def _fall(state: WalkState, finishing: Finishing, assembly: Assembly) -> tuple[Assembly, bool]:
    """Return the grains after a sweep of settling, and whether they have come to rest."""
    step, _, first = state.settling.tolist()
    after, back = follow(assembly, free_fall(assembly, step * finishing.gravity), finishing.settings.friction)
    sunk = float(((after.position - assembly.position) @ finishing.gravity).mean())
    if sunk < CALM * step:
        state.settling[0] = step / 2
    elif not back:
        state.settling[0] = min(first, 1.5 * step)
    return after, bool(state.settling[0] < SMALLEST)


def _keep(state: WalkState, assembly: Assembly) -> None:
    """Note in the state where the grains are."""
    state.position, state.orientation = assembly.position.copy(), assembly.orientation.copy()


def _rest_lid(state: WalkState, finishing: Finishing, assembly: Assembly) -> None:
    """Let the lid, if one has come down, lie on the highest grain."""
    lidded = under_lid(state, finishing, assembly)
    if lidded.lid is not None and lidded.count:
        state.lid_lowered = max(0.0, float(state.lid_lowered - beyond_lid(lidded).max()))


def _height(assembly: Assembly, gravity: Floats) -> float:
    """Return the mean height of the centroids over the lowest corner of the container, along gravity."""
    if not assembly.count:
        return 0.0
    lower, upper = assembly.container.bounds
    floor = np.where(gravity > 0, upper, lower)
    return float(((assembly.position - floor) @ -gravity).mean())
