"""What a checkpoint may hold of a bed, and of how far work on it is."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.checkpoint import MOST, Declared, Held
from voxgran.settling.bed import Bed

#: how far grains may be from the container, in its lengths, most rows of contacts for a grain, iterations of a step,
#: and number of the last stage
LONGEST_WAY, ROOM, MOST_ITERATIONS, LAST_STAGE = 1e3, 10_000, 100_000, 9
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
    "stage": Held(0, LAST_STAGE), **dict.fromkeys(("exact", "proven", "yields"), Held(0, 1)),
    **dict.fromkeys(("step", "rounds"), COUNTS), "missed": Held(high=math.inf),
}  # fmt: skip


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
