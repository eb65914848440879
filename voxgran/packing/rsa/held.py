"""What a checkpoint of random sequential addition may hold."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from voxgran._base.checkpoint import MOST, Declared, Held
from voxgran.packing.problem import Problem
from voxgran.packing.rsa.available_cells import EXACT, deepest_cut
from voxgran.packing.rsa.candidates import SCAN
from voxgran.packing.rsa.cell_parts import LOW
from voxgran.packing.rsa.precompute import Precomputed, coordinate_count, precompute

#: shapes of the arrays of open cells, and of those of candidates, which come first
NUMBERS, SIGNS, GRAINS = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int8), np.zeros(0, dtype=np.int32)
#: arrays of the open cells, and of the candidates
CELLS, CANDIDATES = ("cell", "bounds", "misses", "depth", "late"), ("used", "pointer")


def held_of(problem: Problem, made: Precomputed) -> Declared:
    """Return what arrays and counters of a checkpoint may hold."""
    n, bounds = problem.count, np.array(problem.container.bounds)
    many = coordinate_count(problem) if problem.parameters.retaining == SCAN else 0
    cell = np.zeros((0, 6)) if made.boxes else np.zeros((0, 0), dtype=np.uint16)
    return {
        "position": Held(bounds[0], bounds[1], where="entered"), "entered": Held(0, 1),
        "orientation": Held(-1.0 - 1e-9, 1.0 + 1e-9),
        "used": Held(0, 1, "used", SIGNS), "pointer": Held(0, many, "pointer", NUMBERS),
        "cell": Held(rows="cell", like=cell), "bounds": Held(0, MOST, "bounds", NUMBERS),
        "misses": Held(EXACT, MOST, "misses", NUMBERS), "depth": Held(0, MOST, "depth", NUMBERS),
        "late": Held(0, n, "late", GRAINS), "search_from": Held(-1, n),
        **dict.fromkeys(("turn", "placed"), Held(0, n)),
        **dict.fromkeys(("tried", "moved", "refused", "unproven", "put_off", "refused_in_row"), Held(0)),
    }  # fmt: skip


def fits(problem: Problem, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
    """Return whether what a checkpoint holds goes together: open cells are those of its size classes, or there are none
    and candidates instead.
    """
    turn, start, n = counters["turn"], counters["search_from"], problem.count
    made = precompute(problem, start)
    placed = int(arrays["entered"].sum())
    again = made.queue[turn:] if made.shapes is None or made.classes is None else made.queue[:0]
    if (
        arrays["entered"][again].any()
        or placed != counters["placed"]
        or turn > len(made.queue)
        or counters["tried"] > MOST // (n + 1)
    ):
        return False
    if made.classes is None:
        many = len(made.kind) and int(made.kind.max(initial=-1)) + 1
        used = made.rules.many if problem.parameters.retaining == SCAN else 0
        given = not any(name in arrays for name in CELLS) and all(name in arrays for name in CANDIDATES)
        return given and len(arrays["used"]) == used and len(arrays["pointer"]) == many
    return all(name in arrays for name in CELLS) and _are_cells(made, arrays, counters)


def _are_cells(made: Precomputed, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
    """Return whether the open cells of all classes lie in their lattices, and deferred grains are of the queue."""
    classes, late = made.classes, arrays["late"]
    assert classes is not None
    cell, bounds, depth, many = arrays["cell"], arrays["bounds"], arrays["depth"], len(classes.base)
    sizes = [len(arrays[name]) for name in ("bounds", "misses", "depth")]
    if sizes != [many + 1, many, many] or bounds[0] or bounds[-1] != len(cell) or (np.diff(bounds) < 0).any():
        return False
    waiting = late[counters["late"] :]
    if counters["late"] > len(late) or not np.isin(late, made.queue).all() or arrays["entered"][waiting].any():
        return False
    if (depth > deepest_cut(classes, False)).any() or (not made.boxes and cell.shape[1:] not in ((3,), (6,), (9,))):
        return False
    if made.boxes:
        return bool((cell[:, 3:] >= 0.0).all())
    base, parts, kind = classes.base.copy(), classes.parts.copy(), np.repeat(np.arange(many), np.diff(bounds))
    if len(late):
        base[-1], parts[-1] = base[classes.kind[late[0]]], parts[classes.kind[late[0]]]
    place = np.zeros((len(cell), 3))
    for word in range(cell.shape[1] - 3, -1, -3):
        place = place * (LOW + 1.0) + cell[:, word : word + 3]
    return bool((place < (base * parts.astype(np.float64) ** depth[:, None])[kind]).all())
