"""A front that advances: spheres that touch three others, one after another.

The front is a heap, or where its order is random a list, of places: each is three spheres or walls and a side of them,
given by their order. Attempt number a draws blocks (a, 0), (a, 1), ... of the random stream and nothing else, so that
chunks of attempts do not matter.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran._base.seeds import below, philox_block, unit_float
from voxgran.containers.kernel_container import KernelContainer
from voxgran.packing.advancing_front.container import is_inside, pulled_in
from voxgran.packing.advancing_front.level_grid import BITS, HERE, IMAGES, SphereCells, is_free, link, unlink
from voxgran.packing.advancing_front.mesh_pockets import place_in
from voxgran.packing.advancing_front.tangent_spheres import PLANE, center_of

#: which place of the front is next
RANDOM, NEAREST, LOWEST = 0, 1, 2
#: what is counted: places of the front, spheres, those of them whose places are in the front, places that no sphere
#: took, beginnings, beginnings in a row without room
SIZE, PLACED, RANKED, CLOSED, BEGUN, MISSED = 0, 1, 2, 3, 4, 5
#: behind them: what is missing for the next step, and the spheres of the last beginning, with their images
MISSING, LAST = 6, 7
#: tries to find room for each further sphere of a beginning
TRIES = 16


class Bed(NamedTuple):
    """The spheres.

    spheres: x, y, z, r of each that is placed; the last row is the wall of a sphere, as a sphere of negative radius.
    order: which grain each is, then those that wait.  radius: of the grains.
    """

    spheres: Floats
    order: Integers
    radius: Floats


class Front(NamedTuple):
    """Places: what they are ranked by, and the three that a sphere touches there."""

    key: Floats
    touched: Integers


class Rules(NamedTuple):
    """How the front advances.

    dense: whether all pockets belong to the front.  order: RANDOM, NEAREST or LOWEST.  window: waiting grains that are
    tried at a place.  goal: what is near.  patience: beginnings in a row without room after which the container is
    full.  first: where the first sphere comes, empty where a start is there.  pocket: radius of the sphere that pockets
    are looked for with.
    """

    dense: bool
    order: int
    window: int
    goal: Floats
    patience: int
    first: Floats
    pocket: float


@bare_kernel
def push(front: Front, tally: Integers, key: float, a: int, b: int, c: int) -> None:
    """Add a place."""
    at = tally[SIZE]
    tally[SIZE] += 1
    while at > 0 and front.key[(at - 1) // 2] > key:
        above = (at - 1) // 2
        front.key[at] = front.key[above]
        for k in range(3):
            front.touched[at, k] = front.touched[above, k]
        at = above
    front.key[at], front.touched[at, 0], front.touched[at, 1], front.touched[at, 2] = key, a, b, c


@bare_kernel
def _drop(front, tally, at):  # type: ignore[no-untyped-def]
    """Take out a place: any where all keys are equal, the first one of a heap; the last one moves down from there."""
    tally[SIZE] -= 1
    last = tally[SIZE]
    key = front.key[last]
    while True:
        below_it = 2 * at + 1
        if below_it + 1 < last and front.key[below_it + 1] < front.key[below_it]:
            below_it += 1
        if below_it >= last or front.key[below_it] >= key:
            break
        front.key[at] = front.key[below_it]
        for k in range(3):
            front.touched[at, k] = front.touched[below_it, k]
        at = below_it
    front.key[at] = key
    for k in range(3):
        front.touched[at, k] = front.touched[last, k]


@bare_kernel
def rank(room: KernelContainer, rules: Rules, x: float, y: float, z: float) -> float:
    """Return what a place is ranked by, lowest first."""
    if rules.order == RANDOM:
        return 0.0
    if rules.order == LOWEST:
        return z if room.dimension == 3 else y
    dx, dy, dz = x - rules.goal[0], y - rules.goal[1], z - rules.goal[2]
    return dx * dx + dy * dy + dz * dz


@bare_kernel
def _push_face(front, bed, room, rules, tally, a, b, c):  # type: ignore[no-untyped-def]
    """Add a face of the front, ranked by the middle of its spheres."""
    if rules.order == RANDOM:
        push(front, tally, 0.0, a, b, c)
        return
    x, y, z = center_of(bed.spheres, room.lengths, a)
    px, py, pz = center_of(bed.spheres, room.lengths, b)
    x, y, z, many = x + px, y + py, z + pz, 2
    if c >= 0:
        px, py, pz = center_of(bed.spheres, room.lengths, c)
        x, y, z, many = x + px, y + py, z + pz, 3
    push(front, tally, rank(room, rules, x / many, y / many, z / many), a, b, c)


@bare_kernel
def _write_sphere(bed, room, sphere, x, y, z, r):  # type: ignore[no-untyped-def]
    """Write a sphere, brought into the periodic box; return by which image the others must be shifted with it."""
    bed.spheres[sphere, 0], bed.spheres[sphere, 1], bed.spheres[sphere, 2], bed.spheres[sphere, 3] = x, y, z, r
    image, weight = 0, 1
    for axis in range(3):
        if room.periodic[axis]:
            turn = math.floor(bed.spheres[sphere, axis] / room.lengths[axis])
            bed.spheres[sphere, axis] -= turn * room.lengths[axis]
            image += turn * weight
        weight *= 3
    return image


@bare_kernel
def _bring(order, placed, slot):  # type: ignore[no-untyped-def]
    """Let one of the waiting grains be the next, the others after it in their order."""
    grain = order[placed + slot]
    for k in range(placed + slot, placed, -1):
        order[k] = order[k - 1]
    order[placed] = grain


@bare_kernel
def _find_grain(bed, cells, room, rules, tally, a, b, c):  # type: ignore[no-untyped-def]
    """Return which of the first waiting grains fits at a place (-1: none), and its center."""
    placed = tally[PLACED]
    before = -1.0
    for slot in range(min(rules.window, len(bed.order) - placed)):
        r = bed.radius[bed.order[placed + slot]]
        if r == before:
            continue
        before = r
        found, x, y, z = place_in(bed.spheres, room, a, b, c, r)
        if not found or not is_inside(room, x, y, z, r):
            continue
        if is_free(cells, bed.spheres, x, y, z, r, room.slack):
            return slot, x, y, z, r
    return -1, 0.0, 0.0, 0.0, 0.0


@bare_kernel
def _visit(bed, front, cells, room, rules, tally, at):  # type: ignore[no-untyped-def]
    """Put a sphere on a face if one fits: three new faces take its place; else the face is closed."""
    a, b, c = front.touched[at, 0], front.touched[at, 1], front.touched[at, 2]
    _drop(front, tally, at)
    slot, x, y, z, r = _find_grain(bed, cells, room, rules, tally, a, b, c)
    if slot < 0:
        tally[CLOSED] += 1
        return
    sphere = tally[PLACED]
    _bring(bed.order, sphere, slot)
    image = _write_sphere(bed, room, sphere, x, y, z, r)
    link(cells, bed.spheres, sphere)
    tally[PLACED] += 1
    if rules.dense:
        return
    tally[RANKED] += 1
    new = sphere * IMAGES + HERE
    a, b = a - image, b - image
    if c < 0:
        _push_face(front, bed, room, rules, tally, a, new, c)
        _push_face(front, bed, room, rules, tally, new, b, c)
        return
    c -= image
    _push_face(front, bed, room, rules, tally, a, b, new)
    _push_face(front, bed, room, rules, tally, b, c, new)
    _push_face(front, bed, room, rules, tally, c, a, new)


@bare_kernel
def _begin(bed, cells, room, rules, tally, key, attempt):  # type: ignore[no-untyped-def]
    """Put as many spheres as a face has somewhere, each touching the others; return how many were placed.

    Fewer are left there where none was placed before, or no more wait; and in dense packing, once many beginnings in a
    row have failed, since in a tube or a slab no three can touch each other.
    """
    placed, wanted = tally[PLACED], min(room.dimension, len(bed.order) - tally[PLACED])
    slot = tally[MISSED] % max(min(rules.window, len(bed.order) - placed - wanted + 1), 1)
    words = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
    x, y, z = (
        unit_float(words[0]) * room.lengths[0],
        unit_float(words[1]) * room.lengths[1],
        unit_float(words[2]) * room.lengths[2],
    )
    tally[BEGUN] += 1
    if len(rules.first) and tally[BEGUN] == 1:
        x, y, z = rules.first[0], rules.first[1], rules.first[2]
        if rules.order == LOWEST:
            low = bed.radius[bed.order[placed + slot]]
            y, z = (y, low) if room.dimension == 3 else (low, z)
    alone = rules.dense and 2 * tally[MISSED] >= rules.patience
    if alone:
        x, y, z = pulled_in(room, x, y, z, bed.radius[bed.order[placed + slot]])
    many = 0
    while many < wanted:
        r = bed.radius[bed.order[placed + slot + many]]
        found = False
        for k in range(TRIES if many > 0 else 1):
            if many > 0:
                x, y, z = _beside(bed.spheres, room, tally, many, r, key, attempt, many * TRIES + k)
            found = is_inside(room, x, y, z, r) and is_free(cells, bed.spheres, x, y, z, r, room.slack)
            if found:
                break
        if not found:
            break
        image = _write_sphere(bed, room, placed + many, x, y, z, r)
        tally[LAST + many] = (placed + many) * IMAGES + HERE + image
        link(cells, bed.spheres, placed + many)
        many += 1
    if many < wanted and placed > 0 and not alone:
        for k in range(many - 1, -1, -1):
            unlink(cells, bed.spheres, placed + k)
        many = 0
    for k in range(many):
        _bring(bed.order, placed + k, slot)
    tally[PLACED] += many
    tally[MISSED] = 0 if many > 0 else tally[MISSED] + 1
    if not rules.dense:
        tally[RANKED] += many
    return many


@bare_kernel
def _beside(spheres, room, tally, many, r, key, attempt, draw):  # type: ignore[no-untyped-def]
    """Return where a sphere touches the one or two of a beginning, turned at random."""
    words = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(draw))
    up = 2.0 * unit_float(words[0]) - 1.0 if room.dimension == 3 else 0.0
    turn, flat = 2.0 * math.pi * unit_float(words[1]), math.sqrt(1.0 - up * up)
    dx, dy, dz = flat * math.cos(turn), flat * math.sin(turn), up
    x, y, z = center_of(spheres, room.lengths, tally[LAST])
    a = spheres[tally[LAST] >> BITS, 3] + r
    if many == 1:
        return x + a * dx, y + a * dy, z + a * dz
    ux, uy, uz = center_of(spheres, room.lengths, tally[LAST + 1])
    ux, uy, uz = ux - x, uy - y, uz - z
    c, b = math.sqrt(ux * ux + uy * uy + uz * uz), spheres[tally[LAST + 1] >> BITS, 3] + r
    ux, uy, uz = ux / c, uy / c, uz / c
    along = (a * a - b * b + c * c) / (2.0 * c)
    off = math.sqrt(max(a * a - along * along, 0.0))
    vx, vy, vz = uy * dz - uz * dy, uz * dx - ux * dz, ux * dy - uy * dx
    v = max(math.sqrt(vx * vx + vy * vy + vz * vz), 1e-3)
    return x + along * ux + off * vx / v, y + along * uy + off * vy / v, z + along * uz + off * vz / v


@bare_kernel
def _next_place(front, rules, tally, key, attempt):  # type: ignore[no-untyped-def]
    """Return which place of the front is next."""
    if rules.order != RANDOM:
        return 0
    words = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
    return int(below(words[0], tally[SIZE]))


@bare_kernel
def attempt_once(
    bed: Bed,
    front: Front,
    cells: SphereCells,
    room: KernelContainer,
    rules: Rules,
    tally: Integers,
    key: Integers,
    attempt: int,
) -> None:
    """Visit the next place of the front, or where there is none begin somewhere."""
    if tally[SIZE] > 0:
        _visit(bed, front, cells, room, rules, tally, _next_place(front, rules, tally, key, attempt))
    elif _begin(bed, cells, room, rules, tally, key, attempt) == room.dimension and not rules.dense:
        a, b, c = tally[LAST], tally[LAST + 1], tally[LAST + 2] if room.dimension == 3 else PLANE
        _push_face(front, bed, room, rules, tally, a, b, c)
        _push_face(front, bed, room, rules, tally, b, a, c)
