"""What packings miss of what is asked for: grains, solid fraction and gradation, and what helps."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.config import parameters_of
from voxgran._base.errors import PackingWarning, numbered, warn
from voxgran.packing.method import PackingMethod
from voxgran.packing.model import Packing
from voxgran.packing.problem import DECIMALS, Problem, too_coarse
from voxgran.packing.start import free_volume
from voxgran.shapes.sizes import SizeDistribution, size_distance

#: what helps where a count or a solid fraction is missed, where there is no room, and why the method ended
FEWER = "make the container larger, the grains fewer, or give the method more attempts"
LESS = "ask for less, give the method more attempts, make the container larger or choose a method that packs denser"
LARGEST_FIRST = "give order='largest', by which more grains of a gradation find room"
STOPPED = "the method stopped ({})"
MADE = "the method makes the sizes; ask for less, or change its parameters"
EMPTY = "no grain is packed: none finds room; change the limits of the sizes, or the container"
JAMMED = "these grains jam there; ask for less, for a wider gradation or for a periodic container"


@dataclass(frozen=True, slots=True)
class Task:
    """The checked arguments of `pack` and the drawn grains, before anything is computed."""

    method: PackingMethod
    problem: Problem
    removed: dict[str, float]
    asked: dict[str, Any]
    sizes: SizeDistribution | None


def ended_by_solid_fraction(task: Task) -> bool:
    """Return whether the solid fraction, and not the count, decided how many grains were drawn."""
    count, solid_fraction = task.asked["count"], task.asked["solid_fraction"]
    drawn = task.problem.count - task.problem.started + task.removed["count"]
    return solid_fraction is not None and (count is None or drawn < count)


def _of_further(task: Task) -> bool:
    """Return whether the solid fraction is that of the grains after those of a start: always but where these are scaled
    to it, since there are no others.
    """
    return task.method.sizing != "scaled" or task.problem.count > task.problem.started


def misses(task: Task, packing: Packing) -> dict[str, float]:
    """Return by how much the packing misses what was asked: grains, solid fraction, and gradation by number.

    The count and the solid fraction are those of the grains after those of a start, as far as there are any. They are
    met together, by whichever comes first. Where the grains grew at the end, all
    of this is said of the packing before: its sizes and its solid fraction were asked for.
    """
    growth, started = packing.provenance.get("growth"), task.problem.started
    count, solid_fraction = task.asked["count"], task.asked["solid_fraction"]
    drawn = task.problem.count - started
    wanted = drawn if count is None else max(drawn, count - int(task.removed["count"]))
    if count is None and (solid_fraction is None or task.method.sizing != "drawn"):
        # as many as have room, or as the method makes
        wanted = packing.count - started
    missed: dict[str, float] = {"count": wanted - (packing.count - started)}
    if solid_fraction is not None:
        reached = packing.solid_fraction if growth is None else growth["solid_fraction_before"]
        if _of_further(task):
            # sizes after a growth are others than those of the start
            begun = (packing.volumes if growth is None else task.problem.volumes)[task.problem.fixed : started].sum()
            reached -= float(begun / (free_volume(packing) if growth is None else task.problem.apart.container.volume))
        missed["solid_fraction"] = max(0.0, float(solid_fraction) - reached)
        # differences of rounding are none
        if missed["solid_fraction"] <= 1e-12:
            missed["solid_fraction"] = 0.0
        both = task.method.sizing == "scaled"
        if not both and ((count is not None and missed["count"] <= 0) or not missed["solid_fraction"]):
            missed.update(count=0, solid_fraction=0.0)
    missed["gradation"] = 0.0
    if packing.count - started < drawn and growth is not None:
        missed["gradation"] = growth["gradation_missed_before"]
    elif packing.count - started < drawn and task.method.sizing != "made":
        # grains of the start come first, and nobody asked for their sizes
        asked_for, placed = task.problem.diameter[started:], packing.diameters[started:]
        missed["gradation"] = size_distance(asked_for * task.problem.unit_length, placed)
    return {**missed, **{f"cannot_fit_{k}": v for k, v in task.removed.items()}}


def warn_of_misses(task: Task, packing: Packing) -> None:
    """Warn where neither the count nor the solid fraction that was asked for is reached."""
    missed, asked, reason = packing.provenance["missed"], task.asked, packing.stop_reason
    parts = []
    if not packing.count and task.problem.count and not task.problem.target and reason != "interrupted":
        warn(EMPTY, PackingWarning)
    if asked["count"] is not None and missed["count"] > 0:
        placed = packing.count - task.problem.started
        rows = _lost_rows(task, packing)
        parts.append(f"{placed} of {asked['count']} grains were placed{rows} before {STOPPED.format(reason)}")
    if asked["solid_fraction"] is not None and missed["solid_fraction"] > 0:
        reached = asked["solid_fraction"] - missed["solid_fraction"]
        of = " of the grains after those of the start" if task.problem.start is not None and _of_further(task) else ""
        parts.append(f"the solid fraction{of} is {reached:.4g} instead of {asked['solid_fraction']:.4g}")
        if len(parts) == 1:
            parts[0] += f" where {STOPPED.format(reason)}"
    if parts and reason != "interrupted":
        remedy = (
            {"scaled": JAMMED, "made": MADE}.get(task.method.sizing, task.method.no_room)
            if reason in ("saturated", "full")
            else FEWER
            if missed["count"] and asked["count"]
            else LESS
        )
        text = f"{' and '.join(parts)}: {too_coarse(task.problem) or _with_order(remedy, task, packing)}"
        warn(text, PackingWarning)


def _lost_rows(task: Task, packing: Packing) -> str:
    """Return the rows of a list of which not all grains are placed; empty without a list."""
    many, started = task.asked.get("rows"), task.problem.started
    if many is None or task.problem.grain_id is None or packing.grain_id is None:
        return ""
    found = [np.bincount(rows[started:], minlength=many) for rows in (task.problem.grain_id, packing.grain_id)]
    return f", without {numbered('row', np.flatnonzero(found[1] < found[0]))} of the list (from 0 on),"


def _with_order(remedy: str, task: Task, packing: Packing) -> str:
    """Return a remedy with that of the order before it, unless sizes are equal or the largest grains came first."""
    settings, order = task.problem.parameters, packing.provenance["parameters"].get("order")
    known = any("'largest'" in item.type_text for item in parameters_of(type(settings)) if item.name == "order")
    helps = known and order != "largest" and bool(np.ptp(np.round(task.problem.diameter, DECIMALS)) > 0.0)
    reason, semicolon, rest = remedy.rpartition("; ")
    return f"{reason}{semicolon}{LARGEST_FIRST}, or {rest}" if helps else remedy
