"""The advancing front: spheres are placed one by one so that each touches three others.

The front is a heap of faces, or a list if its order is random: each face is three spheres or walls, and a side of them
that is given by their order. Attempt number a draws blocks (a, 0), (a, 1), ... of the random stream and nothing else,
so that the result does not depend on chunks of attempts.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran._base.seeds import below, philox_block, unit_float
from voxgran.containers.kernel_container import KernelContainer
from voxgran.geometry.level_grid import LevelGrid, image_shift, is_free, turns_at
from voxgran.packing.advancing_front.container import is_inside, pulled_in
from voxgran.packing.advancing_front.mesh_pockets import place_in
from voxgran.packing.advancing_front.sphere_cells import BITS, HERE, IMAGES, link, unlink
from voxgran.packing.advancing_front.tangent_spheres import PLANE, center_of

#: order of the faces of the front
RANDOM, NEAREST, LOWEST = 0, 1, 2
#: entries of the tally: faces of the front, placed spheres, those of them whose pockets are in the front, closed faces,
#: seeds of the front, failed seeds in a row
SIZE, PLACED, RANKED, CLOSED, BEGUN, MISSED = 0, 1, 2, 3, 4, 5
#: after them: what is missing for the next step, and the spheres of the last seed, with their images
MISSING, LAST = 6, 7
#: tries for each further sphere of a seed
TRIES = 16


class Spheres(NamedTuple):
    """The spheres.

    spheres: x, y, z, r of each placed sphere; the last row is the wall of a spherical container, with negative radius.
    order: the grain of each sphere, then the grains that are not placed.  radius: of the grains.
    """

    spheres: Floats
    order: Integers
    radius: Floats


class Front(NamedTuple):
    """Faces: the keys by which they are ranked, and the three spheres or walls that a sphere touches there."""

    key: Floats
    touched: Integers


class FrontRules(NamedTuple):
    """Rules by which the front advances.

    dense: whether all pockets belong to the front.  order: RANDOM, NEAREST or LOWEST.  window: number of grains tried
    at a face.  goal: point from which NEAREST is measured.  patience: failed seeds in a row after which the
    container is full.  first: position of the first sphere, empty if there is a start.  pocket: radius of the sphere by
    which pockets are found.
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
    """Add a face."""
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
    """Remove a face: the first of a heap, or any if all keys are equal; the last face moves down from there."""
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
def rank(walls: KernelContainer, rules: FrontRules, x: float, y: float, z: float) -> float:
    """Return the key of a position; the lowest comes first."""
    if rules.order == RANDOM:
        return 0.0
    if rules.order == LOWEST:
        return z if walls.dimension == 3 else y
    dx, dy, dz = x - rules.goal[0], y - rules.goal[1], z - rules.goal[2]
    return dx * dx + dy * dy + dz * dz


@bare_kernel
def _push_face(front, packed, walls, rules, tally, a, b, c):  # type: ignore[no-untyped-def]
    """Add a face with the key of the mean of its centers."""
    if rules.order == RANDOM:
        push(front, tally, 0.0, a, b, c)
        return
    x, y, z = center_of(packed.spheres, walls.periods, a)
    px, py, pz = center_of(packed.spheres, walls.periods, b)
    x, y, z, many = x + px, y + py, z + pz, 2
    if c >= 0:
        px, py, pz = center_of(packed.spheres, walls.periods, c)
        x, y, z, many = x + px, y + py, z + pz, 3
    push(front, tally, rank(walls, rules, x / many, y / many, z / many), a, b, c)


@bare_kernel
def _write_sphere(packed, cells, sphere, x, y, z, r):  # type: ignore[no-untyped-def]
    """Write a sphere, wrapped into the periodic box; return the image by which its neighbours are shifted."""
    spheres, (i, j, k) = packed.spheres, turns_at(cells, x, y, z)
    sx, sy, sz = image_shift(cells, i, j, k)
    spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2], spheres[sphere, 3] = x - sx, y - sy, z - sz, r
    return i + 3 * j + 9 * k


@bare_kernel
def _bring(order, placed, slot):  # type: ignore[no-untyped-def]
    """Make one of the grains that are not placed the next one; the others keep their order."""
    grain = order[placed + slot]
    for k in range(placed + slot, placed, -1):
        order[k] = order[k - 1]
    order[placed] = grain


@bare_kernel
def _find_grain(packed, cells, walls, rules, tally, a, b, c):  # type: ignore[no-untyped-def]
    """Return which of the next grains fits at a face (-1: none), and its center."""
    placed = tally[PLACED]
    before = -1.0
    for slot in range(min(rules.window, len(packed.order) - placed)):
        r = packed.radius[packed.order[placed + slot]]
        if r == before:
            continue
        before = r
        found, x, y, z = place_in(packed.spheres, walls, a, b, c, r)
        if not found or not is_inside(walls, x, y, z, r):
            continue
        if is_free(cells, packed.spheres, x, y, z, r, walls.slack):
            return slot, x, y, z, r
    return -1, 0.0, 0.0, 0.0, 0.0


@bare_kernel
def _visit(packed, front, cells, walls, rules, tally, at):  # type: ignore[no-untyped-def]
    """Place a sphere on a face if one fits, and replace the face by three new ones; else close the face."""
    a, b, c = front.touched[at, 0], front.touched[at, 1], front.touched[at, 2]
    _drop(front, tally, at)
    slot, x, y, z, r = _find_grain(packed, cells, walls, rules, tally, a, b, c)
    if slot < 0:
        tally[CLOSED] += 1
        return
    sphere = tally[PLACED]
    _bring(packed.order, sphere, slot)
    image = _write_sphere(packed, cells, sphere, x, y, z, r)
    link(cells, packed.spheres, sphere)
    tally[PLACED] += 1
    if rules.dense:
        return
    tally[RANKED] += 1
    new = sphere * IMAGES + HERE
    a, b = a - image, b - image
    if c < 0:
        _push_face(front, packed, walls, rules, tally, a, new, c)
        _push_face(front, packed, walls, rules, tally, new, b, c)
        return
    c -= image
    _push_face(front, packed, walls, rules, tally, a, b, new)
    _push_face(front, packed, walls, rules, tally, b, c, new)
    _push_face(front, packed, walls, rules, tally, c, a, new)


@bare_kernel
def _begin(packed, cells, walls, rules, tally, key, attempt):  # type: ignore[no-untyped-def]
    """Place a seed, as many mutually touching spheres as a face has, at a random position; return their number.

    Fewer are kept if no sphere was placed before or no more grains are left; in dense packing also after many failed
    seeds in a row, since in a tube or a slab no three spheres may touch each other.
    """
    placed, wanted = tally[PLACED], min(walls.dimension, len(packed.order) - tally[PLACED])
    slot = tally[MISSED] % max(min(rules.window, len(packed.order) - placed - wanted + 1), 1)
    words = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
    x, y, z = (
        unit_float(words[0]) * walls.lengths[0],
        unit_float(words[1]) * walls.lengths[1],
        unit_float(words[2]) * walls.lengths[2],
    )
    tally[BEGUN] += 1
    if len(rules.first) and tally[BEGUN] == 1:
        x, y, z = rules.first[0], rules.first[1], rules.first[2]
        if rules.order == LOWEST:
            low = packed.radius[packed.order[placed + slot]]
            y, z = (y, low) if walls.dimension == 3 else (low, z)
    alone = rules.dense and 2 * tally[MISSED] >= rules.patience
    if alone:
        x, y, z = pulled_in(walls, x, y, z, packed.radius[packed.order[placed + slot]])
    many = 0
    while many < wanted:
        r = packed.radius[packed.order[placed + slot + many]]
        found = False
        for k in range(TRIES if many > 0 else 1):
            if many > 0:
                x, y, z = _beside(packed.spheres, walls, tally, many, r, key, attempt, many * TRIES + k)
            found = is_inside(walls, x, y, z, r) and is_free(cells, packed.spheres, x, y, z, r, walls.slack)
            if found:
                break
        if not found:
            break
        image = _write_sphere(packed, cells, placed + many, x, y, z, r)
        tally[LAST + many] = (placed + many) * IMAGES + HERE + image
        link(cells, packed.spheres, placed + many)
        many += 1
    if many < wanted and placed > 0 and not alone:
        for k in range(many - 1, -1, -1):
            unlink(cells, packed.spheres, placed + k)
        many = 0
    for k in range(many):
        _bring(packed.order, placed + k, slot)
    tally[PLACED] += many
    tally[MISSED] = 0 if many > 0 else tally[MISSED] + 1
    if not rules.dense:
        tally[RANKED] += many
    return many


@bare_kernel
def _beside(spheres, walls, tally, many, r, key, attempt, draw):  # type: ignore[no-untyped-def]
    """Return a random position at which a sphere touches the one or two of a seed."""
    words = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(draw))
    up = 2.0 * unit_float(words[0]) - 1.0 if walls.dimension == 3 else 0.0
    turn, flat = 2.0 * math.pi * unit_float(words[1]), math.sqrt(1.0 - up * up)
    dx, dy, dz = flat * math.cos(turn), flat * math.sin(turn), up
    x, y, z = center_of(spheres, walls.periods, tally[LAST])
    a = spheres[tally[LAST] >> BITS, 3] + r
    if many == 1:
        return x + a * dx, y + a * dy, z + a * dz
    ux, uy, uz = center_of(spheres, walls.periods, tally[LAST + 1])
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
    """Return the index of the next face of the front."""
    if rules.order != RANDOM:
        return 0
    words = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
    return int(below(words[0], tally[SIZE]))


@bare_kernel
def attempt_once(
    packed: Spheres,
    front: Front,
    cells: LevelGrid,
    walls: KernelContainer,
    rules: FrontRules,
    tally: Integers,
    key: Integers,
    attempt: int,
) -> None:
    """Visit the next face of the front; if there is none, place a seed."""
    if tally[SIZE] > 0:
        _visit(packed, front, cells, walls, rules, tally, _next_place(front, rules, tally, key, attempt))
    elif _begin(packed, cells, walls, rules, tally, key, attempt) == walls.dimension and not rules.dense:
        a, b, c = tally[LAST], tally[LAST + 1], tally[LAST + 2] if walls.dimension == 3 else PLANE
        _push_face(front, packed, walls, rules, tally, a, b, c)
        _push_face(front, packed, walls, rules, tally, b, a, c)
