"""The choices of an attempt of digital packing: whose turn it is, and which way."""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran._base.seeds import below


class Rules(NamedTuple):
    """Directions sorted downward, level, upward; where these classes begin; the shares and the schedule.

    gravity: where down is.  entry: the same where grains enter at the far side, else 0.  at_once: whether all attempts
    let a grain enter while any waits.
    shares: downward, upward at the start, turns, feeding, guided, what a cycle keeps of the upward share of the one
    before (below 0: it dies away evenly).  schedule: attempt at which feeding ended (-1: not yet), attempts of all
    cycles, number of cycles, refusals in a row after which the container is full.
    """

    directions: Integers
    classes: Integers
    gravity: Integers
    entry: Integers
    at_once: bool
    shares: Floats
    schedule: Integers


class Turn(NamedTuple):
    """Whose turn it is, and what is kept for it.

    order: grains along a curve through space, empty where any grain may come.  hint: of each grain the normal of the
    contact that refused its last move, empty where moves are not guided.  calm: attempts of each grain since it came
    lower than ever before, empty where no grain sleeps.  depth: how low that was.  slept: attempt at which it fell
    asleep, -1 awake.  stirred: last attempt at which something sank in a cell.  cells: cells along each axis, and the
    edge of one in voxels.  wanted: the member of the bank that an attempt needs and that is not there, else -1.
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
def pick_grain(queue: Integers, placed: int, order: Integers, attempt: int, word: int) -> int:
    """Pick a grain: any that has entered, or one of 64 that lie near each other, 512 attempts for each window."""
    if len(order) == 0:
        return queue[len(queue) - 1 - below(word, placed)]
    first = (attempt // 512) % ((len(order) + 63) // 64) * 64
    return order[first + below(word, min(64, len(order) - first))]


@bare_kernel
def cycle_start(rules: Rules, attempt: int) -> int:
    """Return the attempt at which the present cycle of vibration began."""
    begin, attempts, cycles = rules.schedule[0], rules.schedule[1], rules.schedule[2]
    if begin < 0 or attempt - begin >= attempts:
        return begin + attempts if begin >= 0 else 0
    return begin + (attempt - begin) * cycles // attempts * attempts // cycles


@bare_kernel
def guided_direction(hint: Integers, rules: Rules, d: int, pick: int, share: int) -> int:
    """Return a direction away from the contact that refused the last move, for the share that is guided."""
    if hint[0] == 0 and hint[1] == 0 and hint[2] == 0:
        return d
    # bits that the pick and the choice of a turn do not use
    if np.float64(share & np.uint64(0x7FF)) / 2048.0 >= rules.shares[4]:
        return d
    many = 0
    for k in range(len(rules.directions)):
        step = rules.directions[k]
        many += step[0] * hint[0] + step[1] * hint[1] + step[2] * hint[2] > 0
    rank = below(pick << np.uint64(32), many)
    for k in range(len(rules.directions)):
        step = rules.directions[k]
        if step[0] * hint[0] + step[1] * hint[1] + step[2] * hint[2] > 0:
            if rank == 0:
                return k
            rank -= 1
    return d


@bare_kernel
def upward_share(shares: Floats, schedule: Integers, attempt: int) -> float:
    """Return the share of upward moves: it dies away within each cycle and from cycle to cycle."""
    begin, attempts, cycles = schedule[0], schedule[1], schedule[2]
    if begin < 0 or attempt - begin >= attempts:
        return 0.0
    along = (attempt - begin) / attempts * cycles
    cycle = np.floor(along)
    kept = 1.0 - cycle / cycles if shares[5] < 0.0 else shares[5] ** cycle
    return shares[1] * kept * (1.0 - (along - cycle))


@inlined_kernel
def pick_direction(share: float, word: int, classes: Integers, shares: Floats, schedule: Integers, attempt: int) -> int:
    """Pick a direction: its class by the shares, then one of the class; all alike where there is no gravity."""
    if classes[1] == 0:
        return below(word, classes[3])
    if share < shares[0]:
        return below(word, classes[1])
    if share < shares[0] + upward_share(shares, schedule, attempt):
        return classes[2] + below(word, classes[3] - classes[2])
    return classes[1] + below(word, classes[2] - classes[1])
