"""The walk of grains through space: the kernels of control-point packing.

Attempt number a draws blocks (a, 0), (a, 1) and (a, 2) of the random stream and nothing else, so that chunks of
attempts do not matter. The centers of the grains lie in linked cells, which follow each move; what an attempt finds
there does not depend on the order in the lists.
"""

from typing import TypeAlias

import numpy as np

from voxgran._base.arrays import Floats, Integers, Words
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran._base.seeds import below, philox_block, unit_float
from voxgran.packing.control_point.neighbours import list_in_cells, meets_any, meets_own_image
from voxgran.packing.control_point.records import Bed, Bodies, Cells, Memory, Rules, Scratch, Walls
from voxgran.packing.control_point.relative_poses import write_matrix
from voxgran.packing.control_point.separating_planes import write_span
from voxgran.packing.control_point.verlet_lists import strayed
from voxgran.packing.control_point.walls import CLEAR, is_outside

#: factors on the step of a grain after a move and after a refusal: a quarter of the attempts then succeed
GROWTH, DECAY = 1.1, 0.97


World: TypeAlias = tuple[Bodies, Cells, Walls, Rules, Memory, Scratch]


@bare_kernel
def link_all(bed: Bed, cells: Cells) -> None:
    """Put the grains that have entered into empty cells."""
    for g in range(len(bed.placed)):
        if bed.placed[g] == 1:
            _link(cells, g, _cell(cells, bed.position[g]))


@bare_kernel
def span_all(bed: Bed, bodies: Bodies, scratch: Scratch) -> None:
    """Write how far the grains that have entered reach along the axes."""
    for g in range(len(bed.span)):
        if bed.placed[g] == 1:
            write_matrix(bed.orientation[g], scratch.turn)
            write_span(bodies.reaches.values, bed.shape[g], bed.diameter[g], scratch.turn, bed.span[g])


@bare_kernel
def list_all(bed: Bed, cells: Cells, walls: Walls, scratch: Scratch) -> None:
    """Make the lists of near grains, or note that they have no room."""
    lists = cells.lists
    for g in range(len(lists.near)):
        if bed.placed[g] == 0:
            continue
        for axis in range(3):
            lists.anchor[g, axis] = bed.position[g, axis]
        reach = cells.reach + bed.extent[g, 0] + 2.0 * lists.slip
        count = list_in_cells(
            *(bed.position, cells.head, cells.after, cells.lower, cells.width, cells.count, walls.lower, walls.upper),
            *(walls.periodic, bed.position[g], g, reach, scratch.pending),
        )
        for k in range(count):
            if k == lists.near.shape[1]:
                lists.state[0] = 2
                return
            lists.near[g, k] = scratch.pending[k, 0]
        lists.many[g] = count
    lists.state[0] = 0


@bare_kernel
def make_attempts(
    bed: Bed,
    bodies: Bodies,
    cells: Cells,
    walls: Walls,
    rules: Rules,
    memory: Memory,
    scratch: Scratch,
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
        if not feeding and cells.lists.state[0] == 1:
            list_all(bed, cells, walls, scratch)
        words = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
        more = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(1))
        enters = feeding and (tally[0] == 0 or unit_float(more[0]) < rules.shares[2])
        turned = not enters and unit_float(more[2]) < rules.shares[1]
        waiting = len(queue) - tally[0]
        # one test of contact for both kinds of attempts: it is by far the largest part of the compiled code
        if enters:
            slot = below(words[0], waiting)
            g, moved = queue[slot], np.inf
            turns = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(2))
            fits = _propose_entry(bed, bodies, walls, rules, scratch, g, words, turns)
            tally[5] += 1
        else:
            slot, fits, g = 0, True, queue[len(queue) - 1 - below(words[0], tally[0])]
            moved = 2.0 * bed.step[g]
            _propose_place(bed, rules, scratch, g, words, unit_float(more[1]) < _upward_share(rules, attempt))
            tally[2] += 1
            if turned:
                turns = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(2))
                _propose_turn(bed, rules, scratch, g, turns)
                tally[4] += 1
            else:
                _keep_orientation(bed, scratch, g)
        if not fits or _is_refused(bed, bodies, cells, walls, rules, memory, scratch, g, moved):
            if enters:
                tally[6] += 1
                if tally[6] >= rules.schedule[3]:
                    return attempt + 1
            else:
                bed.step[g] = max(bed.step[g] * DECAY, rules.shortest * bed.diameter[g])
            continue
        _place(bed, cells, walls, scratch, g)
        if not enters:
            bed.step[g] = min(bed.step[g] * GROWTH, longest_step(bed, rules, g))
            tally[1], tally[3] = tally[1] + 1, tally[3] + turned
            continue
        bed.step[g] = longest_step(bed, rules, g)
        _note_entry(queue, tally, slot, waiting)
        if waiting == 1:
            return attempt + 1
    return last


@bare_kernel
def _note_entry(queue, tally, slot, waiting):  # type: ignore[no-untyped-def]
    """Move a grain that has entered from the waiting ones to the others."""
    queue[slot], queue[waiting - 1] = queue[waiting - 1], queue[slot]
    tally[0] += 1
    tally[6] = 0


@bare_kernel
def _keep_orientation(bed, scratch, g):  # type: ignore[no-untyped-def]
    """Try the orientation that a grain has."""
    for k in range(4):
        scratch.quaternion[k] = bed.orientation[g, k]


@bare_kernel
def longest_step(bed: Bed, rules: Rules, g: int) -> float:
    """Return the longest step of a grain: no point of it then moves farther than its volume over its surface.

    A grain that lies outside of another before a move and inside of it after the move has moved by at least twice the
    radius of a sphere within it, and thus farther.
    """
    return min(rules.longest * bed.diameter[g], 0.5 * bed.extent[g, 2])


@bare_kernel
def _upward_share(rules, attempt):  # type: ignore[no-untyped-def]
    """Return the share of upward moves that are kept: it dies away within each cycle and from cycle to cycle."""
    begin, attempts, cycles = rules.schedule[0], rules.schedule[1], rules.schedule[2]
    if begin < 0 or attempt - begin >= attempts:
        return 0.0
    along = (attempt - begin) / attempts * cycles
    cycle = np.floor(along)
    kept = 1.0 - cycle / cycles if rules.shares[3] < 0.0 else rules.shares[3] ** cycle
    return rules.shares[0] * kept * (1.0 - (along - cycle))


@bare_kernel
def _propose_place(bed, rules, scratch, g, words, upward):  # type: ignore[no-untyped-def]
    """Move a center by a random unit vector, tilted downward unless it may go up, times a random part of the step."""
    c = 2.0 * unit_float(words[1]) - 1.0 if rules.dimension == 3 else 0.0
    s = np.sqrt(1.0 - c * c)
    angle = 2.0 * np.pi * unit_float(words[2])
    x, y, z = s * np.cos(angle), s * np.sin(angle), c
    along = x * rules.gravity[0] + y * rules.gravity[1] + z * rules.gravity[2]
    if not upward:
        # mirror what points upward, then tilt; both do nothing where gravity is zero
        add = rules.tilt + (-2.0 * along if along < 0.0 else 0.0)
        x, y, z = x + add * rules.gravity[0], y + add * rules.gravity[1], z + add * rules.gravity[2]
    length = bed.step[g] * (1.0 - unit_float(words[3])) / np.sqrt(x * x + y * y + z * z)
    scratch.place[0] = bed.position[g, 0] + length * x
    scratch.place[1] = bed.position[g, 1] + length * y
    scratch.place[2] = bed.position[g, 2] + length * z


@bare_kernel
def _propose_turn(bed, rules, scratch, g, words):  # type: ignore[no-untyped-def]
    """Turn a grain about a random axis, in 2D about z, by an angle that moves no point of it farther than the step."""
    reach = bed.step[g] / bed.extent[g, 0]
    half = 0.5 * reach * (2.0 * unit_float(words[0]) - 1.0)
    c = 2.0 * unit_float(words[1]) - 1.0 if rules.dimension == 3 else 1.0
    s = np.sqrt(1.0 - c * c)
    angle = 2.0 * np.pi * unit_float(words[2])
    w, f = np.cos(half), np.sin(half)
    x, y, z = f * s * np.cos(angle), f * s * np.sin(angle), f * c
    a, b, d, e = bed.orientation[g, 0], bed.orientation[g, 1], bed.orientation[g, 2], bed.orientation[g, 3]
    q = scratch.quaternion
    q[0] = w * a - x * b - y * d - z * e
    q[1] = w * b + x * a + y * e - z * d
    q[2] = w * d - x * e + y * a + z * b
    q[3] = w * e + x * d - y * b + z * a
    length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for k in range(4):
        q[k] /= length


@inlined_kernel
def _is_refused(bed, bodies, cells, walls, rules, memory, scratch, g, moved):  # type: ignore[no-untyped-def]
    """Return whether a grain, in the pose that is tried, meets a wall or a grain; `moved` bounds how far its points
    came.
    """
    write_matrix(scratch.quaternion, scratch.turn)
    if len(bed.span) > 0:
        write_span(bodies.reaches.values, bed.shape[g], bed.diameter[g], scratch.turn, scratch.span)
    if is_outside(bed, bodies, walls, walls.mesh, scratch, g, moved):
        return True
    if meets_own_image(bed, bodies, cells, walls, rules, memory, scratch, g, moved):
        return True
    return meets_any(bed, bodies, cells, walls, rules, memory, scratch, g, moved)


@bare_kernel
def _cell(cells, place):  # type: ignore[no-untyped-def]
    """Return the cell of a center."""
    index = np.int64(0)
    for axis in range(3):
        k = np.int64(np.floor((place[axis] - cells.lower[axis]) / cells.width[axis]))
        index = index * cells.count[axis] + min(max(k, 0), cells.count[axis] - 1)
    return index


@bare_kernel
def _link(cells, g, cell):  # type: ignore[no-untyped-def]
    """Put a grain at the head of a cell."""
    cells.after[g] = cells.head[cell]
    cells.head[cell] = g


@bare_kernel
def _unlink(cells, g, cell):  # type: ignore[no-untyped-def]
    """Take a grain out of its cell."""
    if cells.head[cell] == g:
        cells.head[cell] = cells.after[g]
        return
    j = cells.head[cell]
    while cells.after[j] != g:
        j = cells.after[j]
    cells.after[j] = cells.after[g]


@bare_kernel
def _place(bed, cells, walls, scratch, g):  # type: ignore[no-untyped-def]
    """Take over the pose that was tried, wrapped into the container."""
    place = scratch.place
    for axis in range(3):
        if walls.periodic[axis] == 1:
            length = walls.upper[axis] - walls.lower[axis]
            place[axis] -= np.floor((place[axis] - walls.lower[axis]) / length) * length
    new = _cell(cells, place)
    if bed.placed[g] == 1:
        old = _cell(cells, bed.position[g])
        if old != new:
            _unlink(cells, g, old)
            _link(cells, g, new)
    else:
        _link(cells, g, new)
    lists = cells.lists
    if len(lists.near) > 0 and lists.state[0] == 0:
        # grains that enter are in no list yet
        if bed.placed[g] == 0:
            lists.state[0] = 1
        way = strayed(lists.anchor, g, place, walls.lower, walls.upper, walls.periodic)
        if way > lists.slip * lists.slip:
            lists.state[0] = 1
    bed.placed[g] = 1
    for k in range(3):
        bed.position[g, k] = place[k]
    for k in range(4):
        bed.orientation[g, k] = scratch.quaternion[k]
    if len(bed.span) > 0:
        for k in range(6):
            bed.span[g, k] = scratch.span[k]


@bare_kernel
def _propose_entry(bed, bodies, walls, rules, scratch, g, words, turns):  # type: ignore[no-untyped-def]
    """Put a waiting grain in a random orientation at the top or anywhere; return whether it is between the walls."""
    _random_turn(rules, scratch.quaternion, turns)
    write_matrix(scratch.quaternion, scratch.turn)
    fits = _enter_axis(bed, bodies, walls, rules, scratch, g, 0, unit_float(words[1]))
    fits = _enter_axis(bed, bodies, walls, rules, scratch, g, 1, unit_float(words[2])) and fits
    return _enter_axis(bed, bodies, walls, rules, scratch, g, 2, unit_float(words[3])) and fits


@bare_kernel
def _random_turn(rules, q, words):  # type: ignore[no-untyped-def]
    """Write a uniform random rotation (Shoemake), in 2D about z."""
    u = unit_float(words[0])
    a, b = 2.0 * np.pi * unit_float(words[1]), 2.0 * np.pi * unit_float(words[2])
    if rules.dimension == 2:
        q[0], q[1], q[2], q[3] = np.cos(0.5 * a), 0.0, 0.0, np.sin(0.5 * a)
    else:
        inner, outer = np.sqrt(u), np.sqrt(1.0 - u)
        q[0], q[1], q[2], q[3] = inner * np.cos(b), outer * np.sin(a), outer * np.cos(a), inner * np.sin(b)


@kernel
def enter_raised(bed: Bed, world: World, g: int, position: Floats, up: Floats, fine: float) -> bool:
    """Let a grain enter in the turn that is tried, at a place within the walls or the first free one upward."""
    bodies, cells, walls, rules, memory, scratch = world
    write_matrix(scratch.quaternion, scratch.turn)
    first, steps = np.zeros(3), 0
    for axis in range(3):
        low, high = _room(bed, bodies, walls, scratch, g, axis)
        if low > high:
            return False
        first[axis] = max(low, min(position[axis], high)) if walls.walled[axis] == 1 else position[axis]
        if up[axis] != 0.0:
            steps = int((walls.upper[axis] - walls.lower[axis]) / fine)
    for k in range(steps + 1):
        scratch.place[:] = first + k * fine * up
        if not _is_refused(bed, bodies, cells, walls, rules, memory, scratch, g, np.inf):
            _place(bed, cells, walls, scratch, g)
            bed.step[g] = longest_step(bed, rules, g)
            return True
    return False


@bare_kernel
def _enter_axis(bed, bodies, walls, rules, scratch, g, axis, share):  # type: ignore[no-untyped-def]
    """Write where a grain enters along one axis; return whether there is room."""
    low, high = _room(bed, bodies, walls, scratch, g, axis)
    if rules.entry[axis] != 0:
        scratch.place[axis] = high if rules.entry[axis] < 0 else low
    else:
        scratch.place[axis] = low + share * (high - low)
    return low <= high


@bare_kernel
def _room(bed, bodies, walls, scratch, g, axis):  # type: ignore[no-untyped-def]
    """Return the least and the largest coordinate of a grain, in the turn that is tried, between two walls."""
    s, size = bed.shape[g], bed.diameter[g]
    low, high = 0.0, 0.0
    if walls.walled[axis] == 1:
        for k in range(bodies.hull_start[s], bodies.hull_start[s + 1]):
            p, turn = bodies.hull[k], scratch.turn
            x = size * (turn[axis, 0] * p[0] + turn[axis, 1] * p[1] + turn[axis, 2] * p[2])
            low, high = min(low, x), max(high, x)
        room = bodies.margin[s] * size + CLEAR
        low, high = low - room, high + room
    low, high = walls.lower[axis] - low, walls.upper[axis] - high
    if 0.0 < low - high < 3.0 * CLEAR:
        # as wide as the container
        low = high = 0.5 * (low + high)
    return low, high
