"""Whether a run has ended, and what it has proven."""

from typing import Any

import numpy as np

from voxgran._base.arrays import Integers
from voxgran._base.errors import PackingWarning, warn
from voxgran.packing.method import State
from voxgran.packing.problem import Problem
from voxgran.packing.rsa.available_cells import UNPROVEN
from voxgran.packing.rsa.candidates import IN_ROW, TURN
from voxgran.packing.rsa.precompute import Precomputed, has_true_shapes


def goes_on(state: State, made: Precomputed, tally: Integers) -> bool:
    """Return whether true shapes are tried in one more round, after each had its turn; count those given up if not.

    Rounds end when as many throws in a row have failed as all grains of the queue have in one round.
    """
    assert made.classes is not None
    if tally[TURN] < len(made.queue):
        return False
    left = made.queue[state.arrays["entered"][made.queue] == 0]
    some = np.diff(state.arrays["bounds"])[made.classes.kind[left]] > 0
    if some.any() and tally[IN_ROW] < made.rules.tries * len(made.queue):
        return True
    tally[UNPROVEN] = int(some.sum())
    return False


def treated_as(problem: Problem) -> str:
    """Return the geometry by which grains are compared."""
    if problem.parameters.aligned:
        return "boxes"
    return "true shapes" if has_true_shapes(problem) else "spheres"


def warn_if_not_proven(problem: Problem, state: State) -> None:
    """Warn that a run that was to prove saturation has ended without."""
    if problem.parameters.until == "saturated" and state.stop_reason == "steps":
        row = state.counters["refused_in_row"]
        last = f", the last {row} in a row" if row else ""
        warn(
            f"saturation is not proven: {state.counters['refused']} tries failed{last}; more tries come nearer to it",
            PackingWarning,
        )


def proof_of(problem: Problem, state: State) -> dict[str, Any]:
    """Return the provenance of the saturation proof, or of the tries where there is none."""
    counters = state.counters
    told = {
        "of": treated_as(problem),
        "proven": state.stop_reason == "saturated",
        "failed_tries": counters["refused"],
        "failed_in_row": counters["refused_in_row"],
    }
    if "cell" not in state.arrays:
        return told
    # the last class is that of deferred grains
    many = np.diff(state.arrays["bounds"])[:-1]
    return {
        **told,
        "not_proven": counters["unproven"],
        "classes": len(many),
        "classes_closed": int(np.count_nonzero(many == 0)),
        "open_cells": int(many.sum()),
        "cuts": int(state.arrays["depth"].max(initial=0)),
    }
