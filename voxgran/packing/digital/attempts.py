"""The walk of grains over a lattice: the kernels of digital packing.

Attempt number a draws block a of the random stream and nothing else, so that chunks of attempts do not matter.

Translations without feeding, sleeping or guided moves have a fast path. The kernels that it calls are inlined: passing
arrays from one to the next takes as long as testing a small grain.
"""

import numpy as np

from voxgran._base.arrays import Integers, Words
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran._base.seeds import below, philox_block, unit_float
from voxgran.packing.digital.bit_columns import Bed, grain_words, turned_box, write_turned
from voxgran.packing.digital.no_fit_tables import PairTables, enlist, look_up, relist
from voxgran.packing.digital.periodic_images import (
    copies,
    find_near,
    image_of,
    look_along_step,
    look_anywhere,
    looked_at,
    shifted,
    stamp_images,
    stamp_step,
)
from voxgran.packing.digital.proposals import (
    MoveRules,
    Schedule,
    cycle_start,
    guided_direction,
    pick_direction,
    pick_grain,
)
from voxgran.packing.digital.sleeping import note_rest, sleeps
from voxgran.packing.digital.stamping import look_along_low, stamp_low_move, sum_blocked
from voxgran.packing.digital.state import PAIRS, ROWS, SLEPT
from voxgran.packing.walking.entering import next_slot
from voxgran.packing.walking.state import FEEDS, MOVED, MOVES, PLACED, REFUSED, TURNED, TURNS
from voxgran.packing.walking.vibration import FED_AT, FEED, PATIENCE, ROTATION


def put(bed: Bed, pairs: PairTables, g: int) -> None:
    """Write the bits of a grain that has entered, and stamp it; or note its cell where pairs have tables."""
    if len(pairs.at):
        enlist(bed.field, pairs, g, bed.grains.site[g])
    else:
        _put(bed, g)


@bare_kernel
def _put(bed, g):  # type: ignore[no-untyped-def]
    """Write the bits of a grain that has entered, and stamp it."""
    field, members, grains = bed
    m = grains.member[g]
    grains.at[g] = _load(members, grains, g, m, grains.turn[g])
    low, size = turned_box(members.low[m], members.size[m], members.turns[grains.turn[g]])
    stamp_images(field, grains.bits, grains.at[g], size, shifted(field, grains.site[g], low))


@kernel
def enter_near(bed: Bed, g: int, member: int, turn: int, site: Integers, ways: Integers) -> int:
    """Let a grain enter at a lattice site, within the walls, or by the first of the ways from there that is free.

    Return which one it took, -1 where there is no place.
    """
    field, members, grains = bed
    low, size = turned_box(members.low[member], members.size[member], members.turns[turn])
    grains.at[g] = _load(members, grains, g, member, turn)
    found = find_near(field, grains.bits, grains.at[g], low, size, site, ways)
    if found >= 0:
        corner = shifted(field, site, low)
        stamp_images(field, grains.bits, grains.at[g], size, corner)
        _place(grains, g, member, turn, corner, low)
    return found


@bare_kernel
def make_attempts(
    bed: Bed, pairs: PairTables, rules: MoveRules, schedule: Schedule, queue: Integers, tally: Integers, key: Words,
    first: int, last: int,
) -> int:  # fmt: skip
    """Make attempts `first` ... `last` - 1; return the number of the next one.

    It ends early when the queue is empty, the container is full, or a member of the bank is needed that has not been
    voxelized: then `schedule.wanted` tells which, and that attempt is to be made again. The first entries of the queue
    wait, the others have entered. tally: counters in the order of `COUNTERS`. `pairs`, `schedule.hint` and
    `schedule.slept` are empty where they are not used.
    """
    members = bed.members
    feeding = rules.vibration[FED_AT] < 0
    # nothing but moves and turns, on a canvas
    plain = not feeding and len(pairs.at) == 0 and len(schedule.hint) == 0 and len(schedule.slept) == 0
    attempt = first - 1
    while attempt + 1 < last:
        attempt += 1
        if plain:
            attempt = make_moves(bed, rules, schedule.order, queue, tally, key, attempt, last)
            if attempt == last:
                return last
        r0, r1, r2, r3 = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
        # bits that the choice of a direction does not use
        enters = np.float64(r2 & np.uint64(0xFFFFFFFF)) < rules.shares[FEED] * 4294967296.0
        if feeding and (rules.at_once or tally[PLACED] == 0 or enters):
            if _is_missing(members, schedule, _fed_member(members, rules, queue, tally, key, attempt, r0)):
                return attempt
            if _feed(bed, pairs, rules, queue, tally, key, attempt, r0):
                return attempt + 1
            continue
        g = pick_grain(queue, tally[PLACED], rules.newest, schedule.order, attempt, r0)
        if len(schedule.slept) > 0 and sleeps(bed, schedule, g, cycle_start(rules, attempt)):
            tally[SLEPT] += 1
            continue
        if unit_float(r3) < rules.shares[ROTATION]:
            if _is_missing(members, schedule, members.kind[g] * members.bases + below(r1, members.bases)):
                return attempt
            tally[TURNS] += 1
            pose = (below(r1, members.bases), below(r2, len(members.turns)))
            tally[TURNED] += _turn(bed, pairs, tally, g, pose)
        else:
            d = pick_direction(unit_float(r1), r2, rules.classes, rules.shares, rules.vibration, attempt)
            if len(schedule.hint) > 0:
                d = guided_direction(schedule.hint[g], rules, d, r0, r3)
            step = (rules.directions[d, 0], rules.directions[d, 1], rules.directions[d, 2])
            tally[MOVES] += 1
            moved = _move(bed, pairs, tally, g, step)
            tally[MOVED] += moved
            if len(schedule.hint) > 0:
                _note_contact(bed, g, step, moved, schedule.hint[g])
        if len(schedule.slept) > 0:
            note_rest(bed, rules, schedule, g, attempt)
    return last


@bare_kernel
def _is_missing(members, schedule, member):  # type: ignore[no-untyped-def]
    """Return whether a member has not been voxelized, and note that it is wanted."""
    if members.start[member, 0] >= 0:
        return False
    schedule.wanted[0] = member
    return True


@bare_kernel
def _fed_member(members, rules, queue, tally, key, attempt, word):  # type: ignore[no-untyped-def]
    """Return as which member the next grain enters."""
    g = queue[next_slot(rules.in_turn, len(queue) - tally[PLACED], word)]
    r0, _, _, _ = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(1))
    return members.kind[g] * members.bases + below(r0, members.bases)


@bare_kernel
def _load(members, grains, g, member, turn):  # type: ignore[no-untyped-def]
    """Return where the bits of a grain as that member in that turn begin, written to its own ones where it has some."""
    if len(members.at):
        return members.at[member * len(members.turns) + turn]
    at = grains.own[g]
    write_turned(members.words, members.start[member], members.size[member], members.turns[turn], grains.bits, at)
    return at


@bare_kernel
def _note_contact(bed, g, step, moved, hint):  # type: ignore[no-untyped-def]
    """Note the normal of the contact that refused a move: from the middle of the blocked voxels to the centroid."""
    field, members, grains = bed
    hint[0], hint[1], hint[2] = 0, 0, 0
    if moved:
        return
    m, t = grains.member[g], grains.turn[g]
    low, size = turned_box(members.low[m], members.size[m], members.turns[t])
    old = shifted(field, grains.site[g], low)
    new = shifted(field, old, step)
    many, x, y, z = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for ix in range(copies(field, 0, new[0], size[0])):
        for iy in range(copies(field, 1, new[1], size[1])):
            for iz in range(copies(field, 2, new[2], size[2])):
                found = sum_blocked(field, grains.bits, grains.at[g], size, image_of(field, new, ix, iy, iz), step)
                many, x, y, z = many + found[0], x + found[1], y + found[2], z + found[3]
    if many:
        # twice the centroid less twice the mean of the centers, times their number
        hint[0] = -2 * low[0] * many - 2 * x - many
        hint[1] = -2 * low[1] * many - 2 * y - many
        hint[2] = -2 * low[2] * many - 2 * z - many if field.shape[2] > 1 else 0


@bare_kernel
def _place(grains, g, member, turn, corner, low):  # type: ignore[no-untyped-def]
    """Note where a grain is."""
    grains.member[g] = member
    grains.turn[g] = turn
    for axis in range(3):
        grains.site[g, axis] = corner[axis] - low[axis]


@inlined_kernel
def _move(bed, pairs, tally, g, step):  # type: ignore[no-untyped-def]
    """Move a grain by one voxel where nothing is in the way; return whether it moved."""
    field, members, grains = bed
    m, t = grains.member[g], grains.turn[g]
    low, size = turned_box(members.low[m], members.size[m], members.turns[t])
    old = shifted(field, grains.site[g], low)
    new = shifted(field, old, step)
    at = grains.at[g]
    if len(pairs.at) > 0:
        return _move_in_cells(bed, pairs, tally, g, (m, t), (low, size, new))
    found = look_along_step(field, grains.bits, at, size, new, step)
    tally[ROWS] += looked_at(found)
    if found < 0:
        return 0
    stamp_step(field, grains.bits, at, size, old, new, step)
    _place(grains, g, m, t, new, low)
    return 1


@inlined_kernel
def _move_in_cells(bed, pairs, tally, g, pose, box):  # type: ignore[no-untyped-def]
    """Put a grain into a pose and place where the tables of pairs leave room; return whether they do."""
    field, members, grains = bed
    low, size, corner = box
    site = (corner[0] - low[0], corner[1] - low[1], corner[2] - low[2])
    where = (grains.site, grains.member, grains.turn)
    found = look_up(field, pairs, members.turns, where, g, pose, (site, corner, size))
    tally[PAIRS] += looked_at(found)
    if found < 0:
        return 0
    if grains.member[g] < 0:
        _place(grains, g, pose[0], pose[1], corner, low)
        enlist(field, pairs, g, grains.site[g])
        return 1
    before = (grains.site[g, 0], grains.site[g, 1], grains.site[g, 2])
    _place(grains, g, pose[0], pose[1], corner, low)
    relist(field, pairs, g, before, grains.site[g])
    return 1


@bare_kernel
def _turn(bed, pairs, tally, g, pose):  # type: ignore[no-untyped-def]
    """Turn a grain about its centroid to another orientation of its bank where it fits; return whether it turned."""
    field, members, grains = bed
    m, at = grains.member[g], grains.at[g]
    new_m, turn = members.kind[g] * members.bases + pose[0], pose[1]
    low, size = turned_box(members.low[m], members.size[m], members.turns[grains.turn[g]])
    old = shifted(field, grains.site[g], low)
    new_low, new_size = turned_box(members.low[new_m], members.size[new_m], members.turns[turn])
    new = shifted(field, grains.site[g], new_low)
    if len(pairs.at) > 0:
        return _move_in_cells(bed, pairs, tally, g, (new_m, turn), (new_low, new_size, new))
    stamp_images(field, grains.bits, at, size, old)
    if len(members.at):
        new_at = members.at[new_m * len(members.turns) + turn]
        found = look_anywhere(field, grains.bits, new_at, new_size, new)
        tally[ROWS] += looked_at(found)
        if found < 0:
            stamp_images(field, grains.bits, at, size, old)
            return 0
        grains.at[g] = new_at
    else:
        zeros = grains.own[0]
        start, extent = members.start[new_m], members.size[new_m]
        write_turned(members.words, start, extent, members.turns[turn], grains.scratch, zeros)
        found = look_anywhere(field, grains.scratch, zeros, new_size, new)
        tally[ROWS] += looked_at(found)
        if found < 0:
            stamp_images(field, grains.bits, at, size, old)
            return 0
        words = grain_words(new_size)
        for k in range(words):
            grains.bits[at + k] = grains.scratch[zeros + k]
    stamp_images(field, grains.bits, grains.at[g], new_size, new)
    _place(grains, g, new_m, turn, new, new_low)
    return 1


@bare_kernel
def _feed(bed, pairs, rules, queue, tally, key, attempt, word):  # type: ignore[no-untyped-def]
    """Let a waiting grain enter in a random orientation, at the top or anywhere; return whether feeding has ended."""
    field, members = bed.field, bed.members
    waiting = len(queue) - tally[PLACED]
    slot = next_slot(rules.in_turn, waiting, word)
    g = queue[slot]
    r0, r1, r2, r3 = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(1))
    m = members.kind[g] * members.bases + below(r0, members.bases)
    turn = below(r0 << np.uint64(32), len(members.turns))
    low, size = turned_box(members.low[m], members.size[m], members.turns[turn])
    corner = (
        _entry(field, rules, 0, size[0], r1),
        _entry(field, rules, 1, size[1], r2),
        _entry(field, rules, 2, size[2], r3),
    )
    tally[FEEDS] += 1
    if not _enter(bed, pairs, tally, g, (m, turn), (low, size, corner)):
        tally[REFUSED] += 1
        return tally[REFUSED] >= rules.vibration[PATIENCE]
    queue[slot], queue[waiting - 1] = queue[waiting - 1], queue[slot]
    tally[PLACED] += 1
    tally[REFUSED] = 0
    if rules.falls:
        down = (rules.gravity[0], rules.gravity[1], rules.gravity[2])
        while _move(bed, pairs, tally, g, down):
            pass
    return waiting == 1


@bare_kernel
def _enter(bed, pairs, tally, g, pose, box):  # type: ignore[no-untyped-def]
    """Let a grain enter where it finds room; return whether it does."""
    field, members, grains = bed
    low, size, corner = box
    if len(pairs.at) > 0:
        return _move_in_cells(bed, pairs, tally, g, pose, box) == 1
    grains.at[g] = _load(members, grains, g, pose[0], pose[1])
    found = look_anywhere(field, grains.bits, grains.at[g], size, corner)
    tally[ROWS] += looked_at(found)
    if found < 0:
        return False
    stamp_images(field, grains.bits, grains.at[g], size, corner)
    _place(grains, g, pose[0], pose[1], corner, low)
    return True


@bare_kernel
def _entry(field, rules, axis, extent, word):  # type: ignore[no-untyped-def]
    """Return the lowest voxel of a grain that enters, along one axis; -1 where there is no room."""
    n = field.shape[axis]
    room = n if field.periodic[axis] else n - extent + 1
    if room <= 0:
        return -1
    # along the axis where gravity is strongest, at the far side
    if rules.entry[axis] != 0:
        return n - extent if rules.entry[axis] < 0 else 0
    return np.int64(below(word, room))


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
