"""What follows the walk of grains: true shapes that still overlap are parted, are shaken, and settle.

Each sweep counts as one attempt per grain, so that a run may stop between any two and go on with the same bits. A lid
that has come down is one more wall. Grains that have to be parted may push it back; while they settle it stays above
them and comes down with them.
"""

from dataclasses import dataclass, replace

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.seeds import stream
from voxgran._base.stopping import Stopped
from voxgran.contacts.assembly import Assembly, Lid
from voxgran.contacts.walls import beyond_lid
from voxgran.packing.gravity import main_axis
from voxgran.packing.method import State
from voxgran.settling.settle import CALM, follow, part_once
from voxgran.settling.trial_motion import falling, shaken

#: sweeps at the most in which overlapping grains are parted
PART_SWEEPS = 100
#: how a walk may end, by number
ENDS = ("settled", "full", "steps")
#: smallest step of settling, in median diameters: at rest
SMALLEST = 1e-3
#: step of shaking, in median diameters, and sweeps for which a grain is pulled in one direction
SHAKE_STEP, SHAKE_SWEEPS = 0.05, 3
#: what the state counts from the end of the walk on
COUNTERS = {
    "ended": -1,
    "walked": 0,
    "parting_sweeps": 0,
    "left_overlapping": 0,
    "settling_at": -1,
    "settling_sweeps": 0,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finishing:
    """What is asked for after the walk.

    Attributes
    ----------
    parts : bool
        Whether grains may overlap, or be too near, and have to be parted.
    distance : float
        That surfaces have to keep, in median diameters, where grains are parted and do not settle.
    settling, shaking : int
        Most sweeps of settling, and sweeps of shaking before it.
    acceleration : float
        Strength of the shaking at its start, in gravities.
    friction : float
        Coefficient of friction.
    step : float
        First step of the fall, in median diameters.
    gravity : (3,) ndarray of float
        Direction of the fall; zero where there is none.
    seed : int
        Of the run.
    """

    parts: bool
    distance: float
    settling: int
    shaking: int
    acceleration: float
    friction: float
    step: float
    gravity: Floats
    seed: int

    @property
    def sweeps(self) -> int:
        """The most sweeps that it takes."""
        return (PART_SWEEPS if self.parts else 0) + (self.shaking + self.settling if self.settling else 0)


def end_walk(state: State, finishing: Finishing, assembly: Assembly, *, placed: Integers, reason: str) -> None:
    """End the walk, and go on with the true shapes where that is asked for or needed.

    Parameters
    ----------
    state : State
        Of the method; holds the poses of the placed grains alone from now on.
    finishing : Finishing
        What is asked for.
    assembly : Assembly
        The grains that have entered, in the normalized frame.
    placed : (n,) ndarray of int
        Which grains of the problem they are.
    reason : str
        Why the walk ended, one of `ENDS`.
    """
    if not finishing.sweeps:
        state.stop_reason = reason
        return
    state.counters.update(ended=ENDS.index(reason), walked=state.done)
    state.arrays["grains"] = placed
    _keep(state, assembly)
    state.total = state.done + finishing.sweeps * max(len(placed), 1)
    if not finishing.parts:
        _end_parting(state, finishing, assembly)


def finish_some(state: State, finishing: Finishing, assembly: Assembly, *, last: int, entered: bool) -> None:
    """Make the next sweep if it is due: one for as many attempts as there are grains.

    Parameters
    ----------
    state : State
        Of the method.
    finishing : Finishing
        What is asked for.
    assembly : Assembly
        The grains where the state has them.
    last : int
        The attempt before which to stop.
    entered : bool
        Whether all grains of the problem have entered.

    Raises
    ------
    Stopped
        If the run was asked to stop; the sweep is then not made.
    """
    counters, grains = state.counters, max(assembly.count, 1)
    settles = counters["settling_at"] >= 0
    begin, sweep = ("settling_at", "settling_sweeps") if settles else ("walked", "parting_sweeps")
    due = counters[begin] + (counters[sweep] + 1) * grains
    if last < due:
        state.done = last
        return
    before, state.done = state.done, due
    try:
        if settles:
            _settle(state, finishing, under_lid(state, finishing, assembly), entered=entered)
        else:
            _part(state, finishing, assembly)
    except Stopped:
        # a sweep changes the state at its end only
        state.done = before
        raise


def finishing_report(state: State, assembly: Assembly, gravity: Floats) -> dict[str, dict[str, float]]:
    """Return what came of parting and settling, for the provenance.

    Parameters
    ----------
    state : State
        Of the method.
    assembly : Assembly
        The grains where the state has them.
    gravity : (3,) ndarray of float
        Direction of the fall.

    Returns
    -------
    dict
        `parting`: sweeps, and pairs too near and grains beyond walls that are left. `settling`: sweeps, mean sinking in
        median diameters, and how much denser the bed is.
    """
    counters = state.counters
    report: dict[str, dict[str, float]] = {}
    if counters["parting_sweeps"]:
        report["parting"] = {"sweeps": counters["parting_sweeps"], "overlapping": counters["left_overlapping"]}
    if counters["settling_at"] >= 0:
        before, after = float(state.arrays["settling"][1]), _height(assembly, gravity)
        report["settling"] = {
            "sweeps": counters["settling_sweeps"],
            "mean_sinking": before - after,
            "density_gain": before / after - 1.0 if after > 0 else 0.0,
        }
    return report


def under_lid(state: State, finishing: Finishing, assembly: Assembly) -> Assembly:
    """Return the grains with the lid over them, if one has come down.

    Parameters
    ----------
    state : State
        Of the method; its array `lid` begins with the way of the lid in median diameters, 0 where there is none.
    finishing : Finishing
        What is asked for.
    assembly : Assembly
        The grains.
    """
    lowered = float(state.arrays["lid"][0]) if "lid" in state.arrays else 0.0
    if lowered <= 0.0:
        return assembly
    up = -main_axis(finishing.gravity)
    axis = int(np.argmax(np.abs(up)))
    lower, upper = assembly.container.bounds
    level = upper[axis] - lowered if up[axis] > 0 else -(lower[axis] + lowered)
    return replace(assembly, lid=Lid(up.astype(np.float64), float(level)))


def _part(state: State, finishing: Finishing, assembly: Assembly) -> None:
    """Make a sweep of parting."""
    sweep = state.counters["parting_sweeps"]
    after, state.counters["left_overlapping"] = part_once(
        assembly, finishing.gravity, sweep, distance=finishing.distance
    )  # fmt: skip
    _keep(state, after)
    state.counters["parting_sweeps"] += 1
    if not state.counters["left_overlapping"] or state.counters["parting_sweeps"] == PART_SWEEPS:
        _rest_lid(state, finishing, after)
        _end_parting(state, finishing, after)


def _end_parting(state: State, finishing: Finishing, assembly: Assembly) -> None:
    """Stop, or let the true shapes settle; grains that could not be parted stay as they are."""
    if not finishing.settling or state.counters["left_overlapping"]:
        state.stop_reason = ENDS[state.counters["ended"]]
        return
    state.arrays["settling"] = np.array([finishing.step, _height(assembly, finishing.gravity), finishing.step])
    state.counters.update(settling_at=state.done, settling_sweeps=0)


def _settle(state: State, finishing: Finishing, assembly: Assembly, *, entered: bool) -> None:
    """Make a sweep of shaking or settling."""
    sweep = state.counters["settling_sweeps"]
    after, rests = (_shake if sweep < finishing.shaking else _fall)(state, finishing, assembly)
    _keep(state, after)
    _rest_lid(state, finishing, after)
    state.counters["settling_sweeps"] += 1
    if rests or sweep + 1 >= finishing.shaking + finishing.settling:
        reason = "settled" if rests else "steps"
        state.stop_reason = reason if entered else "full"


def _shake(state: State, finishing: Finishing, assembly: Assembly) -> tuple[Assembly, bool]:
    """Return the grains after a sweep in which each is pulled and turned its own way; they do not rest yet."""
    sweep = state.counters["settling_sweeps"]
    strength = finishing.acceleration * (1.0 - sweep / finishing.shaking)
    draws = stream(finishing.seed, "shaking", sweep // SHAKE_SWEEPS)
    wish = shaken(assembly, SHAKE_STEP * finishing.gravity, strength, draws)
    return follow(assembly, wish, finishing.friction)[0], False


def _fall(state: State, finishing: Finishing, assembly: Assembly) -> tuple[Assembly, bool]:
    """Return the grains after a sweep of settling, and whether they have come to rest."""
    step, _, first = state.arrays["settling"].tolist()
    after, back = follow(assembly, falling(assembly, step * finishing.gravity), finishing.friction)
    sunk = float(((after.position - assembly.position) @ finishing.gravity).mean())
    if sunk < CALM * step:
        state.arrays["settling"][0] = step / 2
    elif not back:
        state.arrays["settling"][0] = min(first, 1.5 * step)
    return after, bool(state.arrays["settling"][0] < SMALLEST)


def _keep(state: State, assembly: Assembly) -> None:
    """Note in the state where the grains are."""
    state.arrays["position"], state.arrays["orientation"] = assembly.position.copy(), assembly.orientation.copy()


def _rest_lid(state: State, finishing: Finishing, assembly: Assembly) -> None:
    """Let the lid, if one has come down, lie on the highest grain."""
    lidded = under_lid(state, finishing, assembly)
    if lidded.lid is not None and lidded.count:
        state.arrays["lid"][0] = max(0.0, float(state.arrays["lid"][0] - beyond_lid(lidded).max()))


def _height(assembly: Assembly, gravity: Floats) -> float:
    """Return the mean height of the centroids over the lowest corner of the container, along gravity."""
    if not assembly.count:
        return 0.0
    lower, upper = assembly.container.bounds
    floor = np.where(gravity > 0, upper, lower)
    return float(((assembly.position - floor) @ -gravity).mean())
