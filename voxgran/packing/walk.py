"""The walk of grains over a lattice: the kernels of digital packing.

Attempt number a draws block a of the random stream and nothing else, so that chunks of attempts do not matter.
"""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.seeds import below, philox_block, unit_float
from voxgran.packing.bits import Field, Triple, Words, is_blocked, is_move_blocked, stamp, turned_box, write_turned


class Members(NamedTuple):
    """The bank as kernels take it; `turns` are signed permutations of the axes."""

    words: Words
    start: Integers
    low: Integers
    size: Integers
    turns: Integers
    bases: int


class Grains(NamedTuple):
    """Where the grains are: lattice site of the centroid, member of the bank (-1: waiting), turn; their bits from `at`
    on.
    """

    site: Integers
    member: Integers
    turn: Integers
    bits: Words
    at: Integers
    scratch: Words


class Rules(NamedTuple):
    """Directions sorted downward, level, upward; where these classes begin; the shares and the schedule.

    shares: downward, upward at the start, turns, feeding.  schedule: attempt at which feeding ended (-1: not yet),
    attempts of all cycles, number of cycles, refusals in a row after which the container is full.
    """

    directions: Integers
    classes: Integers
    gravity: Integers
    anywhere: bool
    shares: Floats
    schedule: Integers


@kernel
def put(field: Field, members: Members, grains: Grains, g: int) -> None:
    """Write the bits of a grain that has entered, and stamp it."""
    m = grains.member[g]
    write_turned(
        members.words, members.start[m], members.size[m], members.turns[grains.turn[g]], grains.bits, grains.at[g]
    )
    low, size = turned_box(members.low[m], members.size[m], members.turns[grains.turn[g]])
    stamp_images(field, grains.bits, grains.at[g], size, _corner(field, grains.site[g], low))


@kernel
def enter_raised(
    field: Field, members: Members, grains: Grains, g: int, member: int, turn: int, site: Integers, up: Integers
) -> int:
    """Let a grain enter at a lattice site, within the walls, or at the first free site upward.

    Return by how many voxels it was raised, -1 where there is no place.
    """
    low, size = turned_box(members.low[member], members.size[member], members.turns[turn])
    first = np.zeros(3, dtype=np.int64)
    most = 0
    for axis in range(3):
        first[axis] = site[axis] + low[axis]
        if field.periodic[axis] == 0:
            first[axis] = max(0, min(first[axis], field.shape[axis] - size[axis]))
        if up[axis] != 0:
            most = field.shape[axis]
    write_turned(
        members.words, members.start[member], members.size[member], members.turns[turn], grains.bits, grains.at[g]
    )
    for k in range(most + 1):
        corner = (
            wrapped(first[0] + k * up[0], field.shape[0], field.periodic[0]),
            wrapped(first[1] + k * up[1], field.shape[1], field.periodic[1]),
            wrapped(first[2] + k * up[2], field.shape[2], field.periodic[2]),
        )
        if not is_blocked_anywhere(field, grains.bits, grains.at[g], size, corner):
            stamp_images(field, grains.bits, grains.at[g], size, corner)
            _place(grains, g, member, turn, corner, low)
            return k
    return -1


@kernel
def make_attempts(
    field: Field,
    members: Members,
    grains: Grains,
    rules: Rules,
    queue: Integers,
    tally: Integers,
    key: Words,
    first: int,
    last: int,
) -> int:
    """Make attempts `first` ... `last` - 1; return the number of the next one.

    It ends early when the queue is empty or the container is full. The first entries of the queue wait, the others
    have entered. tally: placed, moves accepted, tried, turns accepted, tried, feeds tried, refused in a row.
    """
    feeding = rules.schedule[0] < 0
    for attempt in range(first, last):
        r0, r1, r2, r3 = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
        if feeding and (rules.anywhere or tally[0] == 0 or unit_float(r1) < rules.shares[3]):
            if _feed(field, members, grains, rules, queue, tally, key, attempt, r0):
                return attempt + 1
            continue
        g = queue[len(queue) - 1 - below(r0, tally[0])]
        if unit_float(r3) < rules.shares[2]:
            tally[4] += 1
            tally[3] += _turn(field, members, grains, g, below(r1, members.bases), below(r2, len(members.turns)))
        else:
            d = _direction(unit_float(r1), r2, rules.classes, rules.shares[0], _upward_share(rules, attempt))
            step = (rules.directions[d, 0], rules.directions[d, 1], rules.directions[d, 2])
            tally[2] += 1
            tally[1] += _move(field, members, grains, g, step)
    return last


@kernel
def _upward_share(rules, attempt):  # type: ignore[no-untyped-def]
    """Return the share of upward moves: it dies away within each cycle and from cycle to cycle."""
    begin, attempts, cycles = rules.schedule[0], rules.schedule[1], rules.schedule[2]
    if begin < 0 or attempt - begin >= attempts:
        return 0.0
    along = (attempt - begin) / attempts * cycles
    cycle = np.floor(along)
    return rules.shares[1] * (1.0 - cycle / cycles) * (1.0 - (along - cycle))


@kernel
def _direction(share, word, classes, down, up):  # type: ignore[no-untyped-def]
    """Pick a direction: its class by the shares, then one of the class; all alike where there is no gravity."""
    if classes[1] == 0:
        return below(word, classes[3])
    if share < down:
        return below(word, classes[1])
    if share < down + up:
        return classes[2] + below(word, classes[3] - classes[2])
    return classes[1] + below(word, classes[2] - classes[1])


@kernel
def wrapped(x: int, n: int, periodic: int) -> int:
    """Return a voxel index wrapped into [0, n) where the axis is periodic."""
    return x - (x // n) * n if periodic else x


@kernel
def _corner(field, site, low):  # type: ignore[no-untyped-def]
    """Return the lowest voxel of a grain, wrapped into the container."""
    return (
        wrapped(site[0] + low[0], field.shape[0], field.periodic[0]),
        wrapped(site[1] + low[1], field.shape[1], field.periodic[1]),
        wrapped(site[2] + low[2], field.shape[2], field.periodic[2]),
    )


@kernel
def _copies(field, axis, x, extent):  # type: ignore[no-untyped-def]
    """Return 2 where a grain reaches over the end of a periodic axis, else 1."""
    return 2 if field.periodic[axis] and x + extent > field.shape[axis] else 1


@kernel
def _image(field, corner, ix, iy, iz):  # type: ignore[no-untyped-def]
    """Return the canvas voxel of an image of a corner."""
    return (
        corner[0] + field.margin[0] - ix * field.shape[0],
        corner[1] + field.margin[1] - iy * field.shape[1],
        corner[2] + field.margin[2] - iz * field.shape[2],
    )


@kernel
def stamp_images(field: Field, bits: Words, at: int, size: Triple, corner: Triple) -> None:
    """Flip a grain at its place and at its periodic images."""
    for ix in range(_copies(field, 0, corner[0], size[0])):
        for iy in range(_copies(field, 1, corner[1], size[1])):
            for iz in range(_copies(field, 2, corner[2], size[2])):
                stamp(field, bits, at, size, _image(field, corner, ix, iy, iz))


@kernel
def _is_outside(field, size, corner):  # type: ignore[no-untyped-def]
    """Tell whether a grain reaches through a wall, or on a periodic axis meets its own image."""
    for axis in range(3):
        if field.periodic[axis]:
            if size[axis] >= field.shape[axis]:
                return True
        elif corner[axis] < 0 or corner[axis] + size[axis] > field.shape[axis]:
            return True
    return False


@kernel
def is_blocked_anywhere(field: Field, bits: Words, at: int, size: Triple, corner: Triple) -> bool:
    """Tell whether a grain that is not on the canvas would meet anything at a place or its images."""
    if _is_outside(field, size, corner):
        return True
    for ix in range(_copies(field, 0, corner[0], size[0])):
        for iy in range(_copies(field, 1, corner[1], size[1])):
            for iz in range(_copies(field, 2, corner[2], size[2])):
                if is_blocked(field, bits, at, size, _image(field, corner, ix, iy, iz)):
                    return True
    return False


@kernel
def _is_step_blocked(field, bits, at, size, corner, step):  # type: ignore[no-untyped-def]
    """Tell whether a grain on the canvas that steps to a corner would newly cover a taken voxel."""
    for ix in range(_copies(field, 0, corner[0], size[0])):
        for iy in range(_copies(field, 1, corner[1], size[1])):
            for iz in range(_copies(field, 2, corner[2], size[2])):
                if is_move_blocked(field, bits, at, size, _image(field, corner, ix, iy, iz), step):
                    return True
    return False


@kernel
def _place(grains, g, member, turn, corner, low):  # type: ignore[no-untyped-def]
    """Note where a grain is."""
    grains.member[g] = member
    grains.turn[g] = turn
    for axis in range(3):
        grains.site[g, axis] = corner[axis] - low[axis]


@kernel
def _move(field, members, grains, g, step):  # type: ignore[no-untyped-def]
    """Move a grain by one voxel where nothing is in the way; tell whether it moved."""
    m, t = grains.member[g], grains.turn[g]
    low, size = turned_box(members.low[m], members.size[m], members.turns[t])
    old = _corner(field, grains.site[g], low)
    new = (
        wrapped(old[0] + step[0], field.shape[0], field.periodic[0]),
        wrapped(old[1] + step[1], field.shape[1], field.periodic[1]),
        wrapped(old[2] + step[2], field.shape[2], field.periodic[2]),
    )
    at = grains.at[g]
    if _is_step_blocked(field, grains.bits, at, size, new, step):
        return 0
    stamp_images(field, grains.bits, at, size, old)
    stamp_images(field, grains.bits, at, size, new)
    _place(grains, g, m, t, new, low)
    return 1


@kernel
def _turn(field, members, grains, g, base, turn):  # type: ignore[no-untyped-def]
    """Turn a grain about its centroid to another orientation of its bank where it fits; tell whether it turned."""
    m, at, zeros = grains.member[g], grains.at[g], grains.at[0]
    new_m = g * members.bases + base
    low, size = turned_box(members.low[m], members.size[m], members.turns[grains.turn[g]])
    old = _corner(field, grains.site[g], low)
    new_low, new_size = turned_box(members.low[new_m], members.size[new_m], members.turns[turn])
    new = _corner(field, grains.site[g], new_low)
    write_turned(members.words, members.start[new_m], members.size[new_m], members.turns[turn], grains.scratch, zeros)
    stamp_images(field, grains.bits, at, size, old)
    if is_blocked_anywhere(field, grains.scratch, zeros, new_size, new):
        stamp_images(field, grains.bits, at, size, old)
        return 0
    words = (new_size[0] + 2) * (new_size[1] + 2) * ((new_size[2] + 63) // 64)
    grains.bits[at : at + words] = grains.scratch[zeros : zeros + words]
    stamp_images(field, grains.bits, at, new_size, new)
    _place(grains, g, new_m, turn, new, new_low)
    return 1


@kernel
def _feed(field, members, grains, rules, queue, tally, key, attempt, word):  # type: ignore[no-untyped-def]
    """Let a waiting grain enter in a random orientation, at the top or anywhere; tell whether feeding has ended."""
    waiting = len(queue) - tally[0]
    slot = below(word, waiting)
    g = queue[slot]
    r0, r1, r2, r3 = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(1))
    m = g * members.bases + below(r0, members.bases)
    turn = below(r0 << np.uint64(32), len(members.turns))
    low, size = turned_box(members.low[m], members.size[m], members.turns[turn])
    corner = (
        _entry(field, rules, 0, size[0], r1),
        _entry(field, rules, 1, size[1], r2),
        _entry(field, rules, 2, size[2], r3),
    )
    write_turned(members.words, members.start[m], members.size[m], members.turns[turn], grains.bits, grains.at[g])
    tally[5] += 1
    if is_blocked_anywhere(field, grains.bits, grains.at[g], size, corner):
        tally[6] += 1
        return tally[6] >= rules.schedule[3]
    stamp_images(field, grains.bits, grains.at[g], size, corner)
    _place(grains, g, m, turn, corner, low)
    queue[slot], queue[waiting - 1] = queue[waiting - 1], queue[slot]
    tally[0] += 1
    tally[6] = 0
    return waiting == 1


@kernel
def _entry(field, rules, axis, extent, word):  # type: ignore[no-untyped-def]
    """Return the lowest voxel of a grain that enters, along one axis; -1 where there is no room."""
    n = field.shape[axis]
    room = n if field.periodic[axis] else n - extent + 1
    if room <= 0:
        return -1
    if rules.gravity[axis] != 0 and not rules.anywhere:
        return n - extent if rules.gravity[axis] < 0 else 0
    return np.int64(below(word, room))
