"""Candidates of random sequential addition by the schemes of Chu 2011.

A candidate is a grain at a coordinate. A coordinate is three numbers in [0, 1], which are mapped to the positions at
which the grain does not reach beyond a flat wall. Coordinate number c is block (c, 0) of the random stream, or row c of
a table where coordinates are sorted or replicated.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers, Words
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran._base.seeds import philox_block, unit_float
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.containers.kernel_container import KernelContainer, is_between, is_held
from voxgran.geometry.vectors import Vector, dot, row_of
from voxgran.packing.rsa.overlaps import Bed, enter, extents, find_overlap
from voxgran.packing.rsa.true_overlaps import place_true

#: where the radius of a rejected candidate is tried next: nowhere, at the next coordinate, at all unused coordinates
DROP, NEXT, SCAN = 0, 1, 2
#: entries of the tally
TURN, TRIED, PLACED, MOVED, REFUSED = 0, 1, 2, 3, 4
#: and the candidates or throws that were rejected since the last grain was placed
IN_ROW = 8


class CandidateRules(NamedTuple):
    """Rules by which candidates are made.

    retain: DROP, NEXT or SCAN.  tries: coordinates of each grain with DROP.  many: number of all coordinates.
    corrections: largest number of moves of a candidate.  slack: overlap that is ignored.  ends: whether the first grain
    that is dropped ends the loop.
    """

    retain: int
    tries: int
    many: int
    corrections: int
    slack: float
    ends: bool


class Coordinates(NamedTuple):
    """Table of coordinates, which may be empty; for SCAN the used ones, and the next one of each size class."""

    table: Floats
    used: NDArray[np.int8]
    pointer: Integers
    kind: NDArray[np.int32]


@bare_kernel
def add_candidates(
    bed: Bed, rules: CandidateRules, coordinates: Coordinates, queue: NDArray[np.int32], tally: Integers, key: Words,
    first: int, last: int, shapes: TrueShapes | None,
) -> int:  # fmt: skip
    """Make attempts `first` to `last` - 1, one candidate each; return the number of the next attempt.

    The loop ends early when no grain or no coordinate is left, and with the first grain that is dropped if `ends`.
    shapes: None for spheres and aligned boxes.
    """
    for attempt in range(first, last):
        c = _next_coordinate(rules, coordinates, queue, tally, attempt)
        if c < 0:
            return attempt
        g = queue[tally[TURN]]
        if shapes is None:
            moves = _try_at(bed, rules, coordinates.table, key, g, c)
        else:
            inner = shapes.inner[g]
            place = placed(bed.walls, coordinate(coordinates.table, key, c), (inner, inner, inner))
            moves = place_true(bed, shapes, g, place, key, c) - 1
        tally[TRIED] += 1
        if moves < 0:
            tally[REFUSED] += 1
            tally[IN_ROW] += 1
            continue
        tally[IN_ROW] = 0
        tally[TURN] += 1
        tally[TRIED] = 0
        tally[PLACED] += 1
        tally[MOVED] += moves > 0
        if rules.retain == SCAN:
            coordinates.used[c] = 1
    return last


@bare_kernel
def _next_coordinate(rules, coordinates, queue, tally, attempt):  # type: ignore[no-untyped-def]
    """Return the coordinate of an attempt, skipping grains without any left; -1 if there is none."""
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


@inlined_kernel
def _try_at(bed, rules, table, key, g, c):  # type: ignore[no-untyped-def]
    """Place a grain at a coordinate; return the number of its moves, -1 if it is rejected."""
    half = extents(bed.grains.half, g)
    place = placed(bed.walls, coordinate(table, key, c), half)
    for moves in range(rules.corrections + 1):
        if not is_between(bed.walls, *place, *half):
            return -1
        again = moves < rules.corrections
        other, overlap, way = find_overlap(bed, place, half, rules.slack, again)
        if other < 0:
            if not is_held(bed.walls, *place, *half):
                return -1
            enter(bed, g, place)
            return moves
        distance = math.sqrt(dot(way, way))
        if not again or distance == 0.0:
            return -1
        place = (
            place[0] + overlap * way[0] / distance,
            place[1] + overlap * way[1] / distance,
            place[2] + overlap * way[2] / distance,
        )
    return -1


@bare_kernel
def coordinate(table: Floats, key: Words, c: int) -> Vector:
    """Return coordinate number c, from the table if there is one."""
    if len(table) > 0:
        return row_of(table, c)
    a, b, d, _ = philox_block(key[0], key[1], np.uint64(c), np.uint64(0))
    return unit_float(a), unit_float(b), unit_float(d)


@bare_kernel
def placed(walls: KernelContainer, shares: Vector, half: Vector) -> Vector:
    """Return the position at fractions of the range of a grain of half extents `half` along the axes."""
    return (
        _placed_along(walls, 0, shares[0], half[0]),
        _placed_along(walls, 1, shares[1], half[1]),
        _placed_along(walls, 2, shares[2], half[2]),
    )


@bare_kernel
def _placed_along(walls, axis, share, half):  # type: ignore[no-untyped-def]
    """Return the position at a fraction of the range of a grain along an axis."""
    if walls.walled[axis] == 0:
        return walls.lower[axis] + share * walls.lengths[axis] * walls.periodic[axis]
    # a grain as wide as the container is in its middle
    way = walls.lengths[axis] - 2.0 * half
    return walls.lower[axis] + half + share * way


@bare_kernel
def fill_table(table: Floats, key: Words) -> None:
    """Write the coordinates of the random stream into a table."""
    for c in range(len(table)):
        a, b, d, _ = philox_block(key[0], key[1], np.uint64(c), np.uint64(0))
        table[c, 0], table[c, 1], table[c, 2] = unit_float(a), unit_float(b), unit_float(d)
