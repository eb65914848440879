"""Plan of a study: its cells, what they will cost, and which are done, before anything is computed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from voxgran._base.errors import VoxgranError
from voxgran.packing.beds.expected import FEWEST
from voxgran.scene.plan import make_plan
from voxgran.study.cells import Cell

#: rows of cells that are printed
SHOWN = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class CellPlan:
    """What one cell of a study will cost with each of its seeds.

    Attributes
    ----------
    values : dict
        What its values are called, by axis.
    grains, memory, attempts : int
        Grains that are asked for, bytes at the peak, and attempts at the most.
    done, failed, left : int
        Number of seeds with results, with a failure, and that are to be computed.
    depth : float or None
        Expected depth of the bed, in median diameters; None where grains form none.
    has_bulk : bool
        Whether its bulk is expected to hold enough grains for a solid fraction; true where there is no bed.
    refusal : str
        Why it cannot be computed, in a sentence; empty where it can.
    slow : str
        Why it takes long, in a sentence; empty where it does not.
    """

    values: dict[str, Any]
    grains: int = 0
    memory: int = 0
    attempts: int = 0
    done: int = 0
    failed: int = 0
    left: int = 0
    depth: float | None = None
    has_bulk: bool = True
    refusal: str = ""
    slow: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyPlan:
    """What a study would compute.

    Attributes
    ----------
    cells : tuple of CellPlan
        One for each combination of the values of all axes.
    seeds : tuple of int
        Seeds of each cell.
    dimensions : dict of str to int
        Number of places by dimension.
    """

    cells: tuple[CellPlan, ...]
    seeds: tuple[int, ...]
    dimensions: dict[str, int]

    def total(self, name: str) -> int:
        """Return the sum of a number over the cells: ``"done"``, ``"failed"`` or ``"left"``."""
        return sum(getattr(cell, name) for cell in self.cells)

    def __str__(self) -> str:
        """Return the plan as a person reads it."""
        sides = " x ".join(f"{name} {count}" for name, count in self.dimensions.items())
        refused = [cell for cell in self.cells if cell.refusal]
        cells, seeds = _counted(len(self.cells), "cell"), _counted(len(self.seeds), "seed")
        done, failed, left = (self.total(name) for name in ("done", "failed", "left"))
        lines = [
            f"cells           {cells} with {seeds} each{f': {sides}' if sides else ''}",
            f"runs            {done} done, {failed} failed, {left} to compute",
            f"memory          {max(c.memory for c in self.cells) / 2**20:.0f} MiB for the largest cell, estimated",
            f"attempts        {sum(c.attempts * c.left for c in self.cells):,} at the most in what is left",
        ]
        lines += [f"note            {note}" for note in [note_of_beds(self.cells)] if note]
        lines += [f"cannot be done  {told_values(cell.values)}: {cell.refusal}" for cell in refused]
        slow = [cell for cell in self.cells if cell.slow and cell.left]
        lines += [f"takes long      {told_values(cell.values)}: {cell.slow}" for cell in slow]
        lines += _table([_row(cell) for cell in self.cells[:SHOWN]])
        if len(self.cells) > SHOWN:
            lines.append(f"... and {len(self.cells) - SHOWN} cells more")
        return "\n".join(lines)

    def to_mapping(self) -> dict[str, Any]:
        """Return the plan as JSON-able values."""
        names = ("grains", "attempts", "done", "failed", "left", "depth", "has_bulk", "refusal", "slow")
        cells = [
            {"values": cell.values, "memory_bytes": cell.memory} | {name: getattr(cell, name) for name in names}
            for cell in self.cells
        ]
        return {"dimensions": self.dimensions, "seeds": list(self.seeds), "cells": cells}


def cell_plan(cell: Cell, *, done: int, failed: int, left: int) -> CellPlan:
    """Return what a cell will cost; a cell that cannot be computed says why.

    Parameters
    ----------
    cell : Cell
        The cell.
    done, failed, left : int
        Number of its seeds with results, with a failure, and that are to be computed.
    """
    counts: dict[str, Any] = {"values": cell.values, "done": done, "failed": failed, "left": left}
    try:
        made = make_plan(cell.scene)
    except VoxgranError as error:
        return CellPlan(**counts | {"left": 0}, refusal=" ".join(str(error).split()))
    return CellPlan(
        **counts,
        grains=made.grains,
        memory=made.memory,
        attempts=made.attempts,
        depth=made.depth,
        slow=made.slow,
        has_bulk=made.bulk_grains is None or made.bulk_grains >= FEWEST,
    )


def note_of_beds(cells: Sequence[CellPlan]) -> str:
    """Return in how many cells the bed is expected to have no bulk, in a sentence; empty where it has one in all."""
    shallow = [cell for cell in cells if not cell.has_bulk]
    if not shallow:
        return ""
    return (
        f"in {len(shallow)} of {_counted(len(cells), 'cell')} the bed is expected to have fewer than {FEWEST} grains "
        f"in its bulk, such as {told_values(shallow[0].values)} (about {shallow[0].depth:.1f} median diameters deep): "
        "there is no bulk solid fraction; give more grains, and a container more than three diameters across"
    )


def _row(cell: CellPlan) -> dict[str, str]:
    """Return a row of the table."""
    numbers = {
        "grains": f"{cell.grains}",
        "MiB": f"{cell.memory / 2**20:.0f}",
        "attempts": f"{cell.attempts:,}",
        "depth": "" if cell.depth is None else f"{cell.depth:.1f}",
        "done": f"{cell.done}",
        "failed": f"{cell.failed}",
        "left": f"{cell.left}",
    }
    return {name: str(value) for name, value in cell.values.items()} | numbers


def _table(rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Return rows as the lines of a table."""
    heads = list(dict.fromkeys(name for row in rows for name in row if name not in _row(CellPlan(values={}))))
    heads += list(_row(CellPlan(values={})))
    lines = [heads, *([row.get(head, "") for head in heads] for row in rows)]
    wide = [max(len(line[k]) for line in lines) for k in range(len(heads))]
    return ["  ".join(text.rjust(width) for text, width in zip(line, wide, strict=True)) for line in lines]


def told_values(values: Mapping[str, Any]) -> str:
    """Return the values of a cell in words."""
    return ", ".join(f"{name} {value}" for name, value in values.items()) or "the base"


def _counted(number: int, noun: str) -> str:
    """Return a number with its noun."""
    return f"{number} {noun}{'s' if number != 1 else ''}"
