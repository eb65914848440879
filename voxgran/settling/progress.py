"""How far work on a bed is: it may stop between any two steps, or within one, and goes on with the same bits."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.checkpoint import MOST, Declared, Held
from voxgran.settling.bed import Bed

#: stages: growth to full size, an examination of grains that may rest already, fall, shaking, the fall after it,
#: quasi-static steps, rounds in which surfaces are parted, and the end; before the fall, grains that arrive fast; and
#: between quasi-static steps examinations
GROWTH, START, FALL, SHAKING, AGAIN, STILL, CLOSING, ENDED, RAIN, LOOK = range(10)
#: what they are called
STAGES = ("growth", "examination", "fall", "shaking", "fall", "quasi-static", "parting", "end", "rain", "examination")

#: how far grains may be from the container, in its lengths, most rows of contacts for a grain, iterations of a step,
#: and numbers of the last stages of settling and of compressing
LONGEST_WAY, ROOM, MOST_ITERATIONS, LAST_STAGE, LAST_PRESSING = 1e3, 10_000, 100_000, len(STAGES) - 1, 3
#: rounding of the length of a quaternion
ROUNDING = 1e-6
#: whole numbers that count steps, and are no indices
COUNTS = Held(0, MOST)


def of_grains(*names: str) -> Declared:
    """Return that arrays have a row for each grain, or none."""
    return {name: Held(rows=name) for name in names}


#: of settling
OF_SETTLING: Declared = {
    **of_grains("velocity", "residual", "best_position", "best_orientation"), "heights": Held(rows="steps"),
    "first": Held(low=-math.inf), "best_lid": Held(high=math.inf), "smallest": Held(-math.inf, math.inf),
    "stage": Held(0, LAST_STAGE), "iterations": Held(0, MOST_ITERATIONS),
    **dict.fromkeys(("exact", "roomed", "proven"), Held(0, 1)),
    **dict.fromkeys(("step", "stage_step", "still_steps", "trials", "unchanged", "falls"), COUNTS),
}  # fmt: skip
#: of compressions
OF_COMPRESSION: Declared = {
    **of_grains("residual", "bearing"), "path": Held(rows="steps"), "smallest": Held(-math.inf, math.inf),
    "stage": Held(0, LAST_PRESSING), **dict.fromkeys(("exact", "proven", "yields"), Held(0, 1)),
    **dict.fromkeys(("step", "rounds", "partings"), COUNTS), "missed": Held(high=math.inf),
}  # fmt: skip


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


def declared_of(bed: Bed) -> Declared:
    """Return what a checkpoint may hold of a bed; the rest is up to `bed_fits`."""
    last, rows = bed.assembly.count - 1, Held(0, MOST, "rows")
    return {
        **dict.fromkeys(("position", "scale", "radius", "way"), Held(rows="grains")),
        **dict.fromkeys(("wall_first", "wall_count"), Held(0, MOST // 2, "grains")),
        **dict.fromkeys(("pair_first", "pair_count"), Held(0, MOST // 2, "pairs")),
        **dict.fromkeys(("pair_i", "pair_j"), Held(0, last, "pairs")), "pair_shift": Held(rows="pairs"),
        **{f"pair_{name}": Held(rows="known") for name in ("bound", "way", "normal", "room")},
        "pair_corners": Held(-1, MOST, "known"), "order": Held(0, last, "grains"),
        "orientation": Held(rows="grains"), "bodies": Held(rows="bodies"), "listed_at": Held(rows="listed"),
        "row": Held(rows="rows"), "row_i": rows, "row_j": Held(-MOST, last + 1, "rows"),
        "row_room": Held(0, ROOM * (last + 9)), "lid_level": Held(high=math.inf), "carried": Held(any=True),
    }  # fmt: skip


def bed_fits(bed: Bed, arrays: Mapping[str, Any]) -> bool:
    """Return whether the arrays of a checkpoint, each as declared, go together: no index leads out of them."""
    order, m, i, j = arrays["order"], len(arrays["row"]), arrays["pair_i"], arrays["pair_j"]
    n, corners, most = len(order), arrays["pair_corners"], bed.finders.corners[bed.assembly.shape_id]
    far = LONGEST_WAY * (1.0 + np.abs(bed.assembly.container.bounds).max())
    length = linear.norm(arrays["orientation"], axis=1)
    ends = arrays["pair_first"] + arrays["pair_count"], arrays["wall_first"] + arrays["wall_count"]
    return bool(
        len(arrays["bodies"]) == n + 1 and len(np.unique(order)) == n and (abs(length - 1.0) < ROUNDING).all()
        and (abs(arrays["position"]) < far).all() and (arrays["scale"] > 0).all() and (arrays["radius"] > 0).all()
        and (i < j).all() and all(arrays[name].max(initial=-1) < n for name in ("pair_j", "row_i"))
        and arrays["row_j"].max(initial=-1) <= n and m <= arrays["row_room"] and len(arrays["listed_at"]) in (0, n)
        and all(end.max(initial=0) <= m for end in ends) and len(corners) == (0 if bed.spheres else len(i))
        and (not len(corners) or all((most[order[g]] > corners[:, k::2].T).all() for k, g in enumerate((i, j))))
    )  # fmt: skip
