"""How long the runs of a study will take, estimated from the seconds of finished runs.

A run is expected to take the mean time of the finished runs of its cell. A cell without a finished run is estimated
from the runs of its kind, whose scenes differ in numbers alone: a fixed time, plus times in proportion to the attempts
and to the grains that are planned. Their factors are fitted by least squares of the relative errors, with none below 0.
While all finished runs of a kind have about the same numbers of attempts and grains, the estimate is a range, from a
time that is all fixed to one that is all in proportion.
"""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from voxgran._base.lazy import load

#: method and whatever else of a scene is no number
Kind = tuple[str, str]
#: ratio of the sizes of finished runs from which on the parts of their seconds are known, and of the bounds of a time
#: from which on only the lower one is told
SPREAD = 1.5
#: kinds of a method that are finished from which on others of it are expected to take as long
FEW = 3
#: seconds of a run at the least
SHORTEST = 1e-6
#: seconds that are not known
UNKNOWN = (0.0, math.inf)
#: seconds after which it is said that the time that is left stands still, and of a change of it
STILL, CHANGE = 120.0, 1.0


def kind_of(mapping: Mapping[str, Any]) -> Kind:
    """Return the kind of the runs of a scene, given as nested values."""
    method = str(mapping.get("packing", {}).get("method", "twin"))
    return method, json.dumps(_without_numbers(mapping), sort_keys=True, default=str)


def _without_numbers(value: Any) -> Any:
    """Return nested values with 0 in place of each number, and lists without them."""
    if isinstance(value, Mapping):
        return {str(key): _without_numbers(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [item for item in map(_without_numbers, value) if item not in (0, [])]
    return 0 if isinstance(value, int | float) and not isinstance(value, bool) else value


@dataclass(frozen=True, slots=True)
class _Fit:
    """Seconds of the runs of a kind: a fixed part, and those for each attempt and grain; if they are not known apart,
    what each of them would be alone.
    """

    parts: tuple[float, float, float]
    apart: bool

    def bounds(self, sizes: tuple[float, float]) -> tuple[float, float]:
        """Return the least and the most seconds of a run with so many attempts and grains."""
        found = [part * size for part, size in zip(self.parts, (1.0, *sizes), strict=True)]
        return (math.fsum(found),) * 2 if self.apart else (min(found), max(found))


@dataclass(slots=True)
class _Cell:
    """What is known of the runs of a cell."""

    kind: Kind
    sizes: tuple[float, float] = (1.0, 1.0)  # attempts and grains, as planned
    left: int = 0
    timed: int = 0
    seconds: float = 0.0  # of the timed ones, in all


@dataclass(slots=True)
class Durations:
    """Finished runs and those that are left, by the keys of their cells."""

    cells: dict[str, _Cell] = field(default_factory=dict)
    _fits: dict[Kind, _Fit | None] = field(default_factory=dict)
    _told: tuple[float, float] = (math.inf, 0.0)  # time that was left when it last changed, and when that was

    def add(self, cell: str, mapping: Mapping[str, Any]) -> None:
        """Add a cell with the mapping of its scene."""
        self.cells.setdefault(cell, _Cell(kind_of(mapping)))

    def expect(self, cell: str, attempts: int, grains: int) -> None:
        """Note a run that is left."""
        self._sized(cell, attempts, grains).left += 1

    def note(self, cell: str, attempts: int, grains: int, seconds: float) -> None:
        """Note the seconds of a finished run."""
        known = self._sized(cell, attempts, grains)
        known.timed, known.seconds = known.timed + 1, known.seconds + max(seconds, SHORTEST)
        for kind in (known.kind, (known.kind[0], "")):
            self._fits.pop(kind, None)

    def expected(self, cell: str) -> tuple[float, float]:
        """Return the least and the most seconds that a run of a cell is expected to take.

        Where no run of its kind is finished, the other kinds of its method are used, if at least half of those have
        finished runs.
        """
        known = self.cells[cell]
        if known.timed:
            return (known.seconds / known.timed,) * 2
        fit = self._fit(known.kind) or self._fit((known.kind[0], ""))
        return UNKNOWN if fit is None else fit.bounds(known.sizes)

    def is_timed(self, kind: Kind) -> bool:
        """Return whether a run of a kind is finished."""
        return self._fit(kind) is not None

    def remaining(self, under_way: Sequence[tuple[str, float]], before: float) -> tuple[float, float, bool]:
        """Return the least and the most seconds until all runs are finished, and whether one that is computed now has
        been expected to end long ago.

        Parameters
        ----------
        under_way : sequence of tuple
            Cells of the runs that are computed now, and how many seconds each has been computed.
        before : float
            Seconds that the others have been computed, in all, to checkpoints from which they go on.
        """
        waiting = Counter({key: cell.left for key, cell in self.cells.items() if cell.left})
        waiting.subtract(cell for cell, _ in under_way)
        expected = {key: self.expected(key) for key in waiting}
        found = []
        for which in (0, 1):
            begun = [max(expected[cell][which] - seconds, 0.0) for cell, seconds in under_way]
            ahead = [expected[key][which] for key, runs in waiting.items() if runs > 0]
            whole = math.fsum([*begun, *(expected[key][which] * runs for key, runs in waiting.items() if runs > 0)])
            whole = max(whole - before, math.fsum(begun))
            found.append(max([whole / max(1, len(begun)), *begun, *ahead]))
        late = max((seconds - expected[cell][1] for cell, seconds in under_way), default=0.0)
        return found[0], found[1], late > max(1.0, found[1])

    def stands_still(self, left: float, now: float) -> bool:
        """Take note of the seconds that are left at a time, and return whether they have not changed for long."""
        if abs(left - self._told[0]) >= CHANGE:
            self._told = left, now
        return now - self._told[1] > STILL

    def _sized(self, cell: str, attempts: int, grains: int) -> _Cell:
        """Return what is known of a cell, with the sizes of its runs noted."""
        self.cells[cell].sizes = max(1.0, attempts), max(1.0, grains)
        return self.cells[cell]

    def _fit(self, kind: Kind) -> _Fit | None:
        """Return the fit of a kind, or of all kinds of a method if enough of them have finished runs."""
        if kind not in self._fits:
            alike = [one for one in self.cells.values() if (one.kind if kind[1] else (one.kind[0], "")) == kind]
            timed = [one for one in alike if one.timed]
            kinds, known = len({one.kind for one in alike}), len({one.kind for one in timed})
            enough = known >= (1 if kind[1] else max(FEW, kinds / 2))
            self._fits[kind] = _fitted(timed) if enough else None
        return self._fits[kind]


def _fitted(cells: Sequence[_Cell]) -> _Fit:
    """Return the fit of cells with finished runs."""
    timed = np.array([cell.timed for cell in cells], dtype=float)
    seconds = np.array([cell.seconds for cell in cells]) / timed
    sizes = np.column_stack((np.ones(len(cells)), [cell.sizes for cell in cells]))
    largest = sizes.max(axis=0)
    if not np.any(largest > SPREAD * sizes.min(axis=0)):
        alone = float(np.average(seconds, weights=timed)) / np.average(sizes, axis=0, weights=timed)
        return _Fit(tuple(alone.tolist()), apart=False)
    weights = np.sqrt(timed)
    found = load("scipy.optimize").nnls(sizes / largest * (weights / seconds)[:, None], weights)[0]
    return _Fit(tuple((found / largest).tolist()), apart=True)


def told_duration(seconds: float) -> str:
    """Return a duration as text."""
    if seconds < 300:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
