"""Proposals of an attempt of digital packing: the grain that is selected, and the direction of its move."""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran._base.seeds import below
from voxgran.packing.walking.entering import pick_moving
from voxgran.packing.walking.vibration import ATTEMPTS, CYCLES, FED_AT, upward_share

#: further entries of the fractions: moves that go downward, and guided ones
DOWNWARD, GUIDED = 4, 5


class MoveRules(NamedTuple):
    """Directions sorted into downward, level, upward; where these classes begin; fractions and schedule of vibration.

    gravity: lattice vector along which gravity is strongest.  entry: the same where grains enter at the top, else 0.
    at_once: whether every attempt of feeding inserts a grain.  in_turn, falls: whether grains enter in turn, and
    whether they fall when they do.  newest: how many of the newest grains move.
    shares: by the names of :mod:`voxgran.packing.walking.vibration`, DOWNWARD and GUIDED.  vibration: its schedule.
    """

    directions: Integers
    classes: Integers
    gravity: Integers
    entry: Integers
    at_once: bool
    in_turn: bool
    falls: bool
    newest: int
    shares: Floats
    vibration: Integers


class Schedule(NamedTuple):
    """Order in which grains are moved: arrays of :class:`voxgran.packing.digital.precompute.DigitalState`.

    wanted: member of the bank that an attempt needs and that has not been voxelized, else -1.
    """

    order: Integers
    hint: Integers
    calm: Integers
    depth: Integers
    slept: Integers
    stirred: Integers
    cells: Integers
    wanted: Integers


@inlined_kernel
def pick_grain(queue: Integers, placed: int, newest: int, order: Integers, attempt: int, word: int) -> int:
    """Return one of the newest grains that have entered, or of 64 neighbors, with 512 attempts for each such window."""
    if len(order) == 0:
        return pick_moving(queue, placed, newest, word)
    first = (attempt // 512) % ((len(order) + 63) // 64) * 64
    return order[first + below(word, min(64, len(order) - first))]


@bare_kernel
def cycle_start(rules: MoveRules, attempt: int) -> int:
    """Return the attempt at which the present cycle of vibration began."""
    begin, attempts, cycles = rules.vibration[FED_AT], rules.vibration[ATTEMPTS], rules.vibration[CYCLES]
    if begin < 0 or attempt - begin >= attempts:
        return begin + attempts if begin >= 0 else 0
    return begin + (attempt - begin) * cycles // attempts * attempts // cycles


@bare_kernel
def guided_direction(hint: Integers, rules: MoveRules, d: int, pick: int, share: int) -> int:
    """Return a direction away from the contact that refused the last move, for the fraction that is guided."""
    if hint[0] == 0 and hint[1] == 0 and hint[2] == 0:
        return d
    # bits that the pick and the choice of a turn do not use
    if np.float64(share & np.uint64(0x7FF)) / 2048.0 >= rules.shares[GUIDED]:
        return d
    many = 0
    for k in range(len(rules.directions)):
        many += _leads_away(rules.directions[k], hint)
    rank = below(pick << np.uint64(32), many)
    for k in range(len(rules.directions)):
        if _leads_away(rules.directions[k], hint):
            if rank == 0:
                return k
            rank -= 1
    return d


@bare_kernel
def _leads_away(step, hint):  # type: ignore[no-untyped-def]
    """Return whether a step leads to the side of a contact to which its normal points."""
    return step[0] * hint[0] + step[1] * hint[1] + step[2] * hint[2] > 0


@inlined_kernel
def pick_direction(
    share: float, word: int, classes: Integers, shares: Floats, vibration: Integers, attempt: int
) -> int:
    """Return a direction: first its class by the fractions, then one of the class; any one without gravity."""
    if classes[1] == 0:
        return below(word, classes[3])
    if share < shares[DOWNWARD]:
        return below(word, classes[1])
    if share < shares[DOWNWARD] + upward_share(shares, vibration, attempt):
        return classes[2] + below(word, classes[3] - classes[2])
    return classes[1] + below(word, classes[2] - classes[1])
