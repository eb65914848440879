"""The walk of grains through space: the kernels of control-point packing.

Attempt number a draws blocks (a, 0), (a, 1) and (a, 2) of the random stream and nothing else, so that chunks of
attempts do not matter. The centers of the grains lie in linked cells, which follow each move; what an attempt finds
there does not depend on the order in the lists.
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers, Words
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran._base.seeds import philox_block, unit_float
from voxgran.geometry.rotation import write_matrix
from voxgran.packing.control_point.neighbours import list_in_cells, meets_any, meets_own_image
from voxgran.packing.control_point.records import (
    HALF_THICKNESS,
    RADIUS,
    Bodies,
    Cells,
    CloseLists,
    GrainPoses,
    Scratch,
    WalkRules,
    Walls,
    World,
)
from voxgran.packing.control_point.separating_planes import write_span
from voxgran.packing.control_point.verlet_lists import strayed
from voxgran.packing.control_point.walls import CLEAR, is_outside
from voxgran.packing.walking.entering import next_slot, pick_moving
from voxgran.packing.walking.state import FEEDS, MOVED, MOVES, PLACED, REFUSED, TURNED, TURNS
from voxgran.packing.walking.vibration import FED_AT, FEED, PATIENCE, ROTATION, upward_share

#: factors on the step of a grain after a move and after a refusal: a quarter of the attempts then succeed
GROWTH, DECAY = 1.1, 0.97


@bare_kernel
def link_all(grains: GrainPoses, cells: Cells) -> None:
    """Put the grains that have entered into empty cells."""
    for g in range(len(grains.placed)):
        if grains.placed[g] == 1:
            _link(cells, g, _cell(cells, grains.position[g]))


@bare_kernel
def span_all(grains: GrainPoses, bodies: Bodies, scratch: Scratch) -> None:
    """Write how far the grains that have entered reach along the axes."""
    for g in range(len(grains.span)):
        if grains.placed[g] == 1:
            write_matrix(grains.orientation[g], scratch.turn)
            write_span(bodies.reaches.values, grains.shape[g], grains.diameter[g], scratch.turn, grains.span[g])


@bare_kernel
def list_all(grains: GrainPoses, cells: Cells, lists: CloseLists, walls: Walls, scratch: Scratch) -> None:
    """Make the lists of near grains, or note that they have no room."""
    for g in range(len(lists.near)):
        if grains.placed[g] == 0:
            continue
        for axis in range(3):
            lists.anchor[g, axis] = grains.position[g, axis]
        reach = cells.reach + grains.extent[g, RADIUS] + 2.0 * lists.slip
        count = list_in_cells(cells, walls, grains.position, grains.position[g], g, reach, scratch.pending)
        for k in range(count):
            if k == lists.near.shape[1]:
                lists.state[0] = 2
                return
            lists.near[g, k] = scratch.pending[k, 0]
        lists.many[g] = count
    lists.state[0] = 0


@bare_kernel
def make_attempts(world: World, queue: Integers, tally: Integers, key: Words, first: int, last: int) -> int:
    """Make attempts `first` ... `last` - 1; return the number of the next one.

    It ends early when the queue is empty or the container is full. The first entries of the queue wait, the others
    have entered. tally: counters in the order of `TALLY`.
    """
    grains, scratch, rules = world.pairs.grains, world.pairs.scratch, world.rules
    feeding = rules.vibration[FED_AT] < 0
    for attempt in range(first, last):
        if not feeding and world.lists.state[0] == 1:
            list_all(grains, world.cells, world.lists, world.walls, scratch)
        words = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
        more = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(1))
        enters = feeding and (tally[PLACED] == 0 or unit_float(more[0]) < rules.shares[FEED])
        turned = not enters and unit_float(more[2]) < rules.shares[ROTATION]
        waiting = len(queue) - tally[PLACED]
        # one test of contact for both kinds of attempts: it is by far the largest part of the compiled code
        if enters:
            slot = next_slot(rules.in_turn, waiting, words[0])
            g, moved = queue[slot], np.inf
            turns = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(2))
            fits = _propose_entry(grains, world.pairs.bodies, world.walls, rules, scratch, g, words, turns)
            tally[FEEDS] += 1
        else:
            slot, fits, g = 0, True, pick_moving(queue, tally[PLACED], rules.newest, words[0])
            moved = 2.0 * grains.step[g]
            shaken = unit_float(more[1]) < upward_share(rules.shares, rules.vibration, attempt)
            lean = _lean(grains, rules, g, shaken)
            _propose_place(grains, rules, scratch, g, words, lean)
            tally[MOVES] += 1
            if turned:
                turns = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(2))
                _propose_turn(grains, rules, scratch, g, turns)
                tally[TURNS] += 1
            else:
                for k in range(4):
                    scratch.quaternion[k] = grains.orientation[g, k]
        taken = False
        while fits and not _is_refused(world, g, moved):
            _place(grains, world.cells, world.lists, world.walls, scratch, g)
            taken, fits = True, enters and rules.falls
            if fits:
                moved = longest_step(grains, rules, g)
                for axis in range(3):
                    scratch.place[axis] = grains.position[g, axis] + moved * rules.gravity[axis]
        if not taken:
            if enters:
                tally[REFUSED] += 1
                if tally[REFUSED] >= rules.vibration[PATIENCE]:
                    return attempt + 1
            else:
                grains.step[g] = max(grains.step[g] * DECAY, rules.shortest * grains.diameter[g])
                if rules.lifts > 0 and lean > 0.0 and shaken:
                    grains.lifted[g] = rules.lifts
            continue
        if not enters:
            grains.step[g] = min(grains.step[g] * GROWTH, longest_step(grains, rules, g))
            tally[MOVED], tally[TURNED] = tally[MOVED] + 1, tally[TURNED] + turned
            continue
        grains.step[g] = longest_step(grains, rules, g)
        _note_entry(queue, tally, slot, waiting)
        if waiting == 1:
            return attempt + 1
    return last


@bare_kernel
def _note_entry(queue, tally, slot, waiting):  # type: ignore[no-untyped-def]
    """Move a grain that has entered from the waiting ones to the others."""
    queue[slot], queue[waiting - 1] = queue[waiting - 1], queue[slot]
    tally[PLACED] += 1
    tally[REFUSED] = 0


@bare_kernel
def longest_step(grains: GrainPoses, rules: WalkRules, g: int) -> float:
    """Return the longest step of a grain: no point of it then moves farther than its volume over its surface.

    A grain that lies outside of another before a move and inside of it after the move has moved by at least twice the
    radius of a sphere within it, and thus farther.
    """
    return min(rules.longest * grains.diameter[g], 0.5 * grains.extent[g, HALF_THICKNESS])


@bare_kernel
def _lean(grains, rules, g, shaken):  # type: ignore[no-untyped-def]
    """Return 1 if the step of a grain leans down, -1 if it leans up after a collision, and 0 if it leans nowhere."""
    if rules.lifts == 0:
        return 0.0 if shaken else 1.0
    if grains.lifted[g] == 0:
        return 1.0
    grains.lifted[g] -= 1
    return -1.0


@bare_kernel
def _propose_place(grains, rules, scratch, g, words, lean):  # type: ignore[no-untyped-def]
    """Move a center by a random unit vector that leans along gravity or against it, times a random part of the step."""
    c = 2.0 * unit_float(words[1]) - 1.0 if rules.dimension == 3 else 0.0
    s = np.sqrt(1.0 - c * c)
    angle = 2.0 * np.pi * unit_float(words[2])
    x, y, z = s * np.cos(angle), s * np.sin(angle), c
    along = x * rules.gravity[0] + y * rules.gravity[1] + z * rules.gravity[2]
    if lean != 0.0:
        # mirror what points to the other side, then tilt; both do nothing where gravity is zero
        add = lean * rules.tilt + (-2.0 * along if lean * along < 0.0 else 0.0)
        x, y, z = x + add * rules.gravity[0], y + add * rules.gravity[1], z + add * rules.gravity[2]
    length = grains.step[g] * (1.0 - unit_float(words[3])) / np.sqrt(x * x + y * y + z * z)
    scratch.place[0] = grains.position[g, 0] + length * x
    scratch.place[1] = grains.position[g, 1] + length * y
    scratch.place[2] = grains.position[g, 2] + length * z


@bare_kernel
def _propose_turn(grains, rules, scratch, g, words):  # type: ignore[no-untyped-def]
    """Turn a grain about a random axis, in 2D about z, by an angle that moves no point of it farther than the step."""
    reach = grains.step[g] / grains.extent[g, RADIUS]
    half = 0.5 * reach * (2.0 * unit_float(words[0]) - 1.0)
    c = 2.0 * unit_float(words[1]) - 1.0 if rules.dimension == 3 else 1.0
    s = np.sqrt(1.0 - c * c)
    angle = 2.0 * np.pi * unit_float(words[2])
    w, f = np.cos(half), np.sin(half)
    x, y, z = f * s * np.cos(angle), f * s * np.sin(angle), f * c
    a, b, d, e = grains.orientation[g, 0], grains.orientation[g, 1], grains.orientation[g, 2], grains.orientation[g, 3]
    q = scratch.quaternion
    q[0] = w * a - x * b - y * d - z * e
    q[1] = w * b + x * a + y * e - z * d
    q[2] = w * d - x * e + y * a + z * b
    q[3] = w * e + x * d - y * b + z * a
    length = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for k in range(4):
        q[k] /= length


@inlined_kernel
def _is_refused(world, g, moved):  # type: ignore[no-untyped-def]
    """Return whether a grain, in the pose that is tried, meets a wall or a grain; `moved` bounds how far its points
    came.
    """
    pairs, walls, grains, scratch = world.pairs, world.walls, world.pairs.grains, world.pairs.scratch
    bodies = pairs.bodies
    write_matrix(scratch.quaternion, scratch.turn)
    if len(grains.span) > 0:
        write_span(bodies.reaches.values, grains.shape[g], grains.diameter[g], scratch.turn, scratch.span)
    if is_outside(pairs, walls, g, moved) or meets_own_image(world, g, moved):
        return True
    return meets_any(world, g, moved)


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
def _place(grains, cells, lists, walls, scratch, g):  # type: ignore[no-untyped-def]
    """Take over the pose that was tried, wrapped into the container."""
    place = scratch.place
    for axis in range(3):
        if walls.periodic[axis] == 1:
            length = walls.upper[axis] - walls.lower[axis]
            place[axis] -= np.floor((place[axis] - walls.lower[axis]) / length) * length
    new = _cell(cells, place)
    if grains.placed[g] == 1:
        old = _cell(cells, grains.position[g])
        if old != new:
            _unlink(cells, g, old)
            _link(cells, g, new)
    else:
        _link(cells, g, new)
    if len(lists.near) > 0 and lists.state[0] == 0:
        # grains that enter are in no list yet
        if grains.placed[g] == 0:
            lists.state[0] = 1
        if strayed(lists.anchor, walls, g, place) > lists.slip * lists.slip:
            lists.state[0] = 1
    grains.placed[g] = 1
    for k in range(3):
        grains.position[g, k] = place[k]
    for k in range(4):
        grains.orientation[g, k] = scratch.quaternion[k]
    if len(grains.span) > 0:
        for k in range(6):
            grains.span[g, k] = scratch.span[k]


@bare_kernel
def _propose_entry(grains, bodies, walls, rules, scratch, g, words, turns):  # type: ignore[no-untyped-def]
    """Put a waiting grain, in its orientation or a random one, at the top or anywhere; return whether it is between
    the walls.
    """
    if rules.oriented:
        for k in range(4):
            scratch.quaternion[k] = grains.orientation[g, k]
    else:
        _random_turn(rules, scratch.quaternion, turns)
    write_matrix(scratch.quaternion, scratch.turn)
    fits = _enter_axis(grains, bodies, walls, rules, scratch, g, 0, unit_float(words[1]))
    fits = _enter_axis(grains, bodies, walls, rules, scratch, g, 1, unit_float(words[2])) and fits
    return _enter_axis(grains, bodies, walls, rules, scratch, g, 2, unit_float(words[3])) and fits


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
def enter_raised(world: World, g: int, position: Floats, up: Floats, fine: float) -> bool:
    """Let a grain enter in the turn that is tried, at a place within the walls or the first free one upward."""
    grains, walls, scratch = world.pairs.grains, world.walls, world.pairs.scratch
    write_matrix(scratch.quaternion, scratch.turn)
    first, steps = np.zeros(3), 0
    for axis in range(3):
        low, high = _room(grains, world.pairs.bodies, walls, scratch, g, axis)
        if low > high:
            return False
        first[axis] = max(low, min(position[axis], high)) if walls.walled[axis] == 1 else position[axis]
        if up[axis] != 0.0:
            steps = int((walls.upper[axis] - walls.lower[axis]) / fine)
    for k in range(steps + 1):
        scratch.place[:] = first + k * fine * up
        if not _is_refused(world, g, np.inf):
            _place(grains, world.cells, world.lists, walls, scratch, g)
            grains.step[g] = longest_step(grains, world.rules, g)
            return True
    return False


@bare_kernel
def _enter_axis(grains, bodies, walls, rules, scratch, g, axis, share):  # type: ignore[no-untyped-def]
    """Write where a grain enters along one axis; return whether there is room."""
    low, high = _room(grains, bodies, walls, scratch, g, axis)
    if rules.entry[axis] != 0:
        scratch.place[axis] = high if rules.entry[axis] < 0 else low
    else:
        scratch.place[axis] = low + share * (high - low)
    return low <= high


@bare_kernel
def _room(grains, bodies, walls, scratch, g, axis):  # type: ignore[no-untyped-def]
    """Return the least and the largest coordinate of a grain, in the turn that is tried, between two walls."""
    s, size = grains.shape[g], grains.diameter[g]
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
