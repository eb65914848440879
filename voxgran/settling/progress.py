"""How far work on a bed is: it may stop between any two steps, or within one, and goes on with the same bits."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import Declared
from voxgran.settling.bed import Bed
from voxgran.settling.held import bed_fits, declared_of

#: stages: growth to full size, an examination of grains that may rest already, fall, shaking, the fall after it,
#: quasi-static steps, rounds in which surfaces are parted, and the end; before the fall, grains that arrive fast; and
#: between quasi-static steps examinations
GROWTH, START, FALL, SHAKING, AGAIN, STILL, CLOSING, ENDED, RAIN, LOOK = range(10)
#: what they are called
STAGES = ("growth", "examination", "fall", "shaking", "fall", "quasi-static", "parting", "end", "rain", "examination")


@dataclass(slots=True)
class Progress:
    """How far the settling of a bed is."""

    stage: int  # of the stages of settling
    step: int = 0  # steps in all
    stage_step: int = 0  # steps of the stage
    still_steps: int = 0  # quasi-static steps by the present preset
    exact: int = 0  # whether contacts of meshes that are not convex are those of their triangles
    roomed: int = 0  # whether it is known by how much the gaps by grids are wrong
    length: float = 0.0  # of the next quasi-static step
    substep: float = 0.0  # duration to which the impulses of the rows belong; 0 where they are forces or none
    trials: int = 0  # times that overlapping grains were parted
    unchanged: int = 0  # examinations of soft contacts in a row after which no more grains rest
    falls: int = 0  # falls of a bed that had not come to rest
    iterations: int = 0  # of a quasi-static step
    owed: float = 1.0  # grains that should have arrived by now
    waited: float = 0.0  # time since the last one has arrived
    moved: float = 1.0  # share of the grains that moved in the last quasi-static step
    moving: float = 1.0  # share of the grains that do not rest, when last examined
    smallest: float = 0.0  # gap, when last examined
    proven: int = 0  # whether the bed is known to rest
    heights: Floats = field(default_factory=lambda: np.zeros(0))  # of the last unit of time of the fall
    velocity: Floats = field(default_factory=lambda: np.zeros((0, 6)))  # of grains that sink on soft contacts
    residual: Floats = field(default_factory=lambda: np.zeros(0))  # when last examined, in the order of the bed
    first: float = -math.inf  # smallest gap at the beginning, where the grains were examined then
    best: float = 1.0  # least share of the grains that did not rest in an examined bed without overlap
    best_position: Floats = field(default_factory=lambda: np.zeros((0, 3)))  # of that bed
    best_orientation: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    best_lid: float = math.inf


class Resumable:
    """Work of which all that a step depends on is in a bed and in a dataclass of its progress.

    Fields of the progress that are whole numbers are counters, all others are arrays or floats. One of them is
    ``exact``: whether contacts of meshes that are not convex come from their triangles.
    """

    HELD: ClassVar[Declared]
    bed: Bed
    progress: Any

    @property
    def arrays(self) -> dict[str, Any]:
        """All arrays and floats that the next step depends on."""
        return {
            **self.bed.arrays,
            **{name: np.asarray(getattr(self.progress, name)) for name in self._names(whole=False)},
        }

    @property
    def counters(self) -> dict[str, int]:
        """All counters that the next step depends on."""
        return {name: getattr(self.progress, name) for name in self._names(whole=True)}

    @property
    def declared(self) -> Declared:
        """What a checkpoint may hold."""
        return {**declared_of(self.bed), **self.HELD}

    def rule(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> bool:
        """Return whether what a checkpoint holds goes together: what is known of the grains is of all, or of none."""
        del counters
        rows = {len(arrays[name]) for name, held in self.HELD.items() if held.rows == name}
        return bed_fits(self.bed, arrays) and rows <= {0, len(arrays["order"])}

    def restore(self, arrays: Mapping[str, Any], counters: Mapping[str, Any]) -> None:
        """Take over arrays and counters."""
        own = self._names(whole=False)
        for name in own:
            value = np.array(arrays[name])
            setattr(self.progress, name, value if value.ndim else float(value))
        for name in self._names(whole=True):
            setattr(self.progress, name, int(counters[name]))
        self.bed.finders.exact = bool(self.progress.exact)
        self.bed.restore({name: array for name, array in arrays.items() if name not in own})

    def kept(self) -> tuple[dict[str, Any], dict[str, int]]:
        """Return copies of all arrays and counters."""
        return {name: np.array(array) for name, array in self.arrays.items()}, self.counters

    def _names(self, *, whole: bool) -> tuple[str, ...]:
        """Return the names of the counters, or of the other fields."""
        return tuple(item.name for item in fields(self.progress) if (item.type is int) == whole)
