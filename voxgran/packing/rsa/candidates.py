"""Random candidates, one after the other, after Chu 2011: dropped, moved away, or their radius kept for another place.

A candidate is a grain at a coordinate, and a coordinate is three numbers in 0 ... 1 that stand for a place in the
bounds where the grain does not reach beyond a flat wall. Coordinate number c is block (c, 0) of the random stream, or a
row of a table where coordinates are sorted or replayed.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers, Words
from voxgran._base.kernels import bare_kernel
from voxgran._base.seeds import philox_block, unit_float
from voxgran.containers.kernel_container import KernelContainer, is_between, is_held
from voxgran.packing.rsa.level_grid import Bed, Cells, enter, extents, find_overlap

#: what becomes of the radius of a refused candidate
DROP, NEXT, SCAN = 0, 1, 2
#: where the tally counts what
TURN, TRIED, PLACED, MOVED, REFUSED = 0, 1, 2, 3, 4


class Rules(NamedTuple):
    """How candidates are made.

    retain: one of DROP, NEXT, SCAN.  tries: coordinates for each grain where radii are dropped.  many: coordinates in
    all.  corrections: how often a candidate is moved away from a grain.  slack: overlap that does not count.  ends:
    whether the first grain that is dropped ends it.
    """

    retain: int
    tries: int
    many: int
    corrections: int
    slack: float
    ends: bool


class Coordinates(NamedTuple):
    """Coordinates in a table (of no rows: none), and what a scan knows: those used, and the next one of each class."""

    table: Floats
    used: NDArray[np.int8]
    pointer: Integers
    kind: NDArray[np.int32]


@bare_kernel
def add_candidates(
    bed: Bed,
    cells: Cells,
    room: KernelContainer,
    rules: Rules,
    coordinates: Coordinates,
    queue: NDArray[np.int32],
    tally: Integers,
    key: Words,
    first: int,
    last: int,
) -> int:
    """Make attempts `first` ... `last` - 1, a candidate each; return the number of the next one.

    It ends early when no grain or no coordinate is left, or with the first grain that is dropped, where the rules ask.
    """
    for attempt in range(first, last):
        c = _next_coordinate(rules, coordinates, queue, tally, attempt)
        if c < 0:
            return attempt
        g = queue[tally[TURN]]
        moves = _try_at(bed, cells, room, rules, coordinates.table, key, g, c)
        tally[TRIED] += 1
        if moves < 0:
            tally[REFUSED] += 1
            continue
        tally[TURN] += 1
        tally[TRIED] = 0
        tally[PLACED] += 1
        tally[MOVED] += moves > 0
        if rules.retain == SCAN:
            coordinates.used[c] = 1
    return last


@bare_kernel
def _next_coordinate(rules, coordinates, queue, tally, attempt):  # type: ignore[no-untyped-def]
    """Return the coordinate of an attempt, and pass over grains that have none left; -1 where none is left at all."""
    while tally[TURN] < len(queue):
        if rules.retain == NEXT:
            return attempt if attempt < rules.many else -1
        if rules.retain == DROP:
            if tally[TRIED] < rules.tries:
                return tally[TURN] * rules.tries + tally[TRIED]
            if rules.ends:
                return -1
        else:
            kind = coordinates.kind[queue[tally[TURN]]]
            c = coordinates.pointer[kind]
            while c < rules.many and coordinates.used[c] == 1:
                c += 1
            coordinates.pointer[kind] = min(c + 1, rules.many)
            if c < rules.many:
                return c
        tally[TURN] += 1
        tally[TRIED] = 0
    return -1


@bare_kernel
def _try_at(bed, cells, room, rules, table, key, g, c):  # type: ignore[no-untyped-def]
    """Put a grain at a coordinate, moved away from others if need be; return how often it moved, -1 if refused."""
    hx, hy, hz = extents(bed.half, g)
    u, v, w = coordinate(table, key, c)
    x, y, z = placed(room, 0, u, hx), placed(room, 1, v, hy), placed(room, 2, w, hz)
    for moves in range(rules.corrections + 1):
        if not is_between(room, x, y, z, hx, hy, hz):
            return -1
        again = moves < rules.corrections
        other, overlap, dx, dy, dz = find_overlap(bed, cells, room, x, y, z, hx, hy, hz, rules.slack, again)
        if other < 0:
            if not is_held(room, x, y, z, hx, hy, hz):
                return -1
            enter(bed, cells, room, g, x, y, z)
            return moves
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        if not again or distance == 0.0:
            return -1
        x += overlap * dx / distance
        y += overlap * dy / distance
        z += overlap * dz / distance
    return -1


@bare_kernel
def coordinate(table: Floats, key: Words, c: int) -> tuple[float, float, float]:
    """Return coordinate number c, from the table where there is one."""
    if len(table) > 0:
        return table[c, 0], table[c, 1], table[c, 2]
    a, b, d, _ = philox_block(key[0], key[1], np.uint64(c), np.uint64(0))
    return unit_float(a), unit_float(b), unit_float(d)


@bare_kernel
def placed(room: KernelContainer, axis: int, share: float, half: float) -> float:
    """Return the place at a share of the way that a grain of half extent `half` has along an axis."""
    if room.walled[axis] == 0:
        return room.lower[axis] + share * room.lengths[axis] * room.periodic[axis]
    # a grain as wide as the container stands in its middle
    way = room.lengths[axis] - 2.0 * half
    return room.lower[axis] + half + share * way


@bare_kernel
def fill_table(table: Floats, key: Words) -> None:
    """Write the coordinates of the random stream into a table."""
    for c in range(len(table)):
        a, b, d, _ = philox_block(key[0], key[1], np.uint64(c), np.uint64(0))
        table[c, 0], table[c, 1], table[c, 2] = unit_float(a), unit_float(b), unit_float(d)
