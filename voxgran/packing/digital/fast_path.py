"""Fast path of the walk on a canvas: translations only, without feeding, rotations, sleeping or guided moves.

The kernels that it calls are inlined: passing arrays from one to the next takes as long as testing a small grain.
"""

import numpy as np

from voxgran._base.arrays import Integers, Words
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran._base.seeds import philox_block, unit_float
from voxgran.packing.digital.bit_columns import Bed, turned_box
from voxgran.packing.digital.periodic_images import image_of, look_along_step, looked_at, shifted, stamp_step
from voxgran.packing.digital.proposals import MoveRules, pick_direction, pick_grain
from voxgran.packing.digital.stamping import look_along_low, stamp_low_move
from voxgran.packing.digital.state import ROWS
from voxgran.packing.walking.state import MOVED, MOVES, PLACED
from voxgran.packing.walking.vibration import ROTATION


@bare_kernel
def make_moves(
    bed: Bed, rules: MoveRules, order: Integers, queue: Integers, tally: Integers, key: Words, first: int, last: int
) -> int:
    """Make attempts `first` ... `last` - 1 as long as they are moves; return the number of the next one.

    The parameters are those of :func:`voxgran.packing.digital.attempts.make_attempts`.
    """
    field, members, grains = bed
    placed, rows = tally[PLACED], 0
    for attempt in range(first, last):
        r0, r1, r2, r3 = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
        if unit_float(r3) < rules.shares[ROTATION]:
            tally[ROWS] += rows
            return attempt
        g = pick_grain(queue, placed, placed, order, attempt, r0)
        d = pick_direction(unit_float(r1), r2, rules.classes, rules.shares, rules.vibration, attempt)
        step, m = (rules.directions[d, 0], rules.directions[d, 1], rules.directions[d, 2]), grains.member[g]
        low, size = turned_box(members.low[m], members.size[m], members.turns[grains.turn[g]])
        old = shifted(field, grains.site[g], low)
        new = shifted(field, old, step)
        tally[MOVES] += 1
        if size[2] <= 64 and _stays_whole(field, old, size):
            image = image_of(field, new, 0, 0, 0)
            found = look_along_low(field, grains.bits, grains.at[g], size, image, step)
            rows += looked_at(found)
            if found < 0:
                continue
            stamp_low_move(field, grains.bits, grains.at[g], size, image, step)
        else:
            found = look_along_step(field, grains.bits, grains.at[g], size, new, step)
            rows += looked_at(found)
            if found < 0:
                continue
            stamp_step(field, grains.bits, grains.at[g], size, old, new, step)
        for axis in range(3):
            grains.site[g, axis] = new[axis] - low[axis]
        tally[MOVED] += 1
    tally[ROWS] += rows
    return last


@inlined_kernel
def _stays_whole(field, corner, size):  # type: ignore[no-untyped-def]
    """Return whether no step takes a grain over the end of a periodic axis, where it would have an image."""
    whole = True
    for axis in range(3):
        whole = whole and (
            not field.periodic[axis] or (corner[axis] > 0 and corner[axis] + size[axis] < field.shape[axis])
        )
    return whole
