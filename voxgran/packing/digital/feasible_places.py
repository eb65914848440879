"""Maps of all feasible places: where the centroid of an oriented grain may lie, exactly, one bit a place.

Two oriented grains overlap when the difference of their places is a difference of their voxels; a table of these
differences, in bits, is the dilation of one by the mirror image of the other. The map of a grain starts as the dilation
of what the container takes, and each grain that is placed adds its table: the map is never made anew.

Maps lie as ``map[x, word of z, y]``, tables as ``table[x, word of z, y]`` from their lowest difference on.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Integers, Words
from voxgran._base.kernels import kernel
from voxgran._base.stopping import stop_if_asked
from voxgran.packing.digital.bit_columns import column_words, mask_of_words

#: words that are joined between two looks whether to stop, and runs at the least: columns are grown anew for these
JOINED_WORDS, FEWEST_RUNS = 2**26, 16


class Room(NamedTuple):
    """Places along each axis, words of a column, and 1 where the axis is periodic."""

    places: Integers
    words: int
    periodic: Integers


@dataclass(frozen=True, slots=True)
class Table:
    """Differences of places at which two oriented grains overlap."""

    words: Words  # (x, w, y): bit columns
    low: Integers  # (3,): lowest difference
    size: Integers  # (3,): extents

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        return int(self.words.nbytes)


def runs_of(mask: Booleans) -> Integers:
    """Return the runs of a mask along z: x, y, first z and length, (r, 4)."""
    # an empty voxel above each column ends its last run
    padded = np.zeros((*mask.shape[:2], mask.shape[2] + 1), dtype=bool)
    padded[:, :, :-1] = mask
    # one more in front begins a run in the first voxel
    flat = np.append(np.False_, padded)
    edges = np.flatnonzero(flat[1:] != flat[:-1])
    start, end = edges[::2], edges[1::2]
    return np.column_stack([*np.unravel_index(start, padded.shape), end - start]).astype(np.int64)


def overlap_table(here: Booleans, here_low: Integers, there: Booleans, there_low: Integers) -> Table:
    """Return at which places of `there`, counted from the place of `here`, the two overlap.

    Voxels are cut to their boxes, and lowest voxels counted from the corner at the centroid.
    """
    size = np.array(here.shape) + np.array(there.shape) - 1
    words = np.zeros((size[0], -(-size[2] // 64), size[1]), dtype=np.uint64)
    columns, runs = np.ascontiguousarray(column_words(here)), runs_of(there)
    step = max(FEWEST_RUNS, JOINED_WORDS // max(columns.size, 1))
    for first in range(0, len(runs), step):
        stop_if_asked()
        dilate(columns, runs[first : first + step], np.array(there.shape), words)
    return Table(words, here_low - (there_low + np.array(there.shape) - 1), size.astype(np.int64))


def blocked_map(room: Room, taken: Booleans | None, low: Integers, mask: Booleans, shape: Integers) -> Words:
    """Return the map of an oriented grain in an empty container: 1 where it would meet a wall or what is taken.

    `taken` are the voxels of the lattice of some shape that grains may not take, None for none; `low` is the lowest
    voxel of the grain, counted from the corner at its centroid, and `mask` its voxels.
    """
    full, lines = np.uint64(0xFFFFFFFFFFFFFFFF), []
    for axis in range(3):
        line = np.arange(room.places[axis]) + low[axis]
        if room.periodic[axis]:
            lines.append(np.full(len(line), mask.shape[axis] >= shape[axis]))
        else:
            lines.append((line < 0) | (line + mask.shape[axis] > shape[axis]))
    column = np.pad(lines[2], (0, room.words * 64 - len(lines[2])), constant_values=True)
    words = np.empty((len(lines[0]), room.words, len(lines[1])), dtype=np.uint64)
    words[...] = column_words(column[None, None])[0]
    words[lines[0]] = full
    words[:, :, lines[1]] = full
    if taken is not None and taken.any():
        table = overlap_table(taken, np.zeros(3, dtype=np.int64), mask, low)
        add_table(words, room, table, np.zeros(3, dtype=np.int64))
    return words


def add_table(words: Words, room: Room, table: Table, place: Integers) -> None:
    """Block the places at which a grain would meet one that lies at a place, and its periodic images."""
    steps = [(-1, 0, 1) if turn else (0,) for turn in room.periodic]
    for ix in steps[0]:
        for iy in steps[1]:
            for iz in steps[2]:
                corner = place + table.low + np.array([ix, iy, iz]) * room.places
                if (corner < room.places).all() and (corner + table.size > 0).all():
                    join(words, room.places, table.words, corner)


@kernel
def dilate(columns: Words, runs: Integers, size: Integers, table: Words) -> None:
    """Add the differences of voxels in columns and voxels in runs to a table; size: extents of all runs."""
    wide, _, deep = columns.shape
    longest = np.int64(1)
    for r in range(len(runs)):
        longest = max(longest, runs[r, 3])
    levels = 1
    while 1 << levels <= longest:
        levels += 1
    # level l: columns dilated upward by 2^l voxels
    grown = np.zeros((levels, wide, table.shape[1], deep), np.uint64)
    for i in range(wide):
        # rows are joined to zeros, since numba takes 3 s to compile an assignment of slices
        _or_rows(columns[i], 0, grown[0, i], 0)
        for level in range(1, levels):
            _or_rows(grown[level - 1, i], 0, grown[level, i], 0)
            _or_rows(grown[level - 1, i], 1 << (level - 1), grown[level, i], 0)
    for r in range(len(runs)):
        x, y, z, length = runs[r, 0], runs[r, 1], runs[r, 2], runs[r, 3]
        level = 0
        while 2 << level <= length:
            level += 1
        lowest = size[2] - z - length
        for i in range(wide):
            target = table[i + size[0] - 1 - x]
            _or_rows(grown[level, i], lowest, target, size[1] - 1 - y)
            if length > 1 << level:
                _or_rows(grown[level, i], lowest + length - (1 << level), target, size[1] - 1 - y)


@kernel
def _or_rows(rows, shift, target, first):  # type: ignore[no-untyped-def]
    """Join rows of columns, shifted upward by some voxels, to those of a target from a column on."""
    skip, bits = shift >> 6, np.uint64(shift & 63)
    back = np.uint64(63) - bits
    for k in range(min(len(rows), len(target) - skip)):
        for j in range(rows.shape[1]):
            target[k + skip, first + j] |= rows[k, j] << bits
    if bits:
        for k in range(min(len(rows), len(target) - skip - 1)):
            for j in range(rows.shape[1]):
                target[k + skip + 1, first + j] |= (rows[k, j] >> np.uint64(1)) >> back


@kernel
def join(words: Words, places: Integers, table: Words, corner: Integers) -> None:
    """Join a table to a map from a corner on, which may lie outside."""
    first_x, last_x = max(0, -corner[0]), min(table.shape[0], places[0] - corner[0])
    first_y, last_y = max(0, -corner[1]), min(table.shape[2], places[1] - corner[1])
    begin = corner[1] + first_y
    lowest = corner[2] >> 6
    bits = np.uint64(corner[2] & 63)
    back = np.uint64(63) - bits
    for i in range(first_x, last_x):
        for k in range(table.shape[1]):
            for part in range(2):
                w = lowest + k + part
                if w < 0 or w >= words.shape[1]:
                    continue
                row, source = words[corner[0] + i, w], table[i, k]
                if part == 0:
                    for j in range(last_y - first_y):
                        row[begin + j] |= source[first_y + j] << bits
                else:
                    for j in range(last_y - first_y):
                        row[begin + j] |= (source[first_y + j] >> np.uint64(1)) >> back


def blocked_sides(words: Words, level: int, axis: int, room: Room) -> NDArray[np.int8]:
    """Return the number of blocked sides of the places with a coordinate, a plane, -1 for places that are blocked.

    Sides along the coordinate do not count: what lies above is hardly ever blocked, and what lies below always.
    """
    if axis == 2:
        blocked = words[:, level >> 6] >> np.uint64(level & 63) & np.uint64(1) != 0
    else:
        part = words[level : level + 1] if axis == 0 else words[:, :, level : level + 1]
        blocked = mask_of_words(part, int(room.places[2])).squeeze(axis)
    if blocked.all():
        return np.full(blocked.shape, -1, dtype=np.int8)
    across = [k for k in range(3) if k != axis]
    around = np.ones((blocked.shape[0] + 2, blocked.shape[1] + 2), dtype=np.int8)
    around[1:-1, 1:-1] = blocked
    if room.periodic[across[0]]:
        around[[0, -1], 1:-1] = blocked[[-1, 0]]
    if room.periodic[across[1]]:
        around[1:-1, [0, -1]] = blocked[:, [-1, 0]]
    sides = around[:-2, 1:-1] + around[2:, 1:-1] + around[1:-1, :-2] + around[1:-1, 2:]
    sides[blocked] = -1
    return sides


def places_with(sides: NDArray[np.int8], best: int, level: int, axis: int) -> Integers:
    """Return the places (k, 3) of a plane of :func:`blocked_sides` with so many."""
    found = np.argwhere(sides == best)
    if axis == 0:
        # word by word
        found = found[np.lexsort((found[:, 1], found[:, 0], found[:, 1] >> 6))]
    places = np.full((len(found), 3), level)
    places[:, [k for k in range(3) if k != axis]] = found
    return places


def free_among(words: Words, sites: Integers, places: Integers) -> Integers:
    """Return the free places (k, 3) of a list of flat ones."""
    i, j, k = np.unravel_index(sites, places)
    free = words[i, k >> 6, j] >> (k & 63).astype(np.uint64) & np.uint64(1) == 0
    return np.column_stack([i, j, k])[free]


@kernel
def count_contacts(
    words: Words, periodic: Integers, places: Integers, histogram: Integers, first: int, last: int
) -> None:
    """Count the free places of a slab along x by how many of their six neighbours are blocked."""
    for i in range(first, last):
        for w in range(words.shape[1]):
            for j in range(words.shape[2]):
                free = ~words[i, w, j]
                if free:
                    ones, twos, fours = _neighbours(words, periodic, places, i, w, j)
                    for contacts in range(7):
                        histogram[contacts] += _ones(free & _is_sum(ones, twos, fours, contacts))


@kernel
def nth_of_contacts(
    words: Words, periodic: Integers, places: Integers, contacts: int, rank: int, place: Integers, first: int, last: int
) -> int:
    """Find the free place of a rank among those of a slab with so many blocked neighbours.

    Return the rank that is left where it lies beyond the slab, else -1.
    """
    for i in range(first, last):
        for w in range(words.shape[1]):
            for j in range(words.shape[2]):
                free = ~words[i, w, j]
                if free == 0:
                    continue
                ones, twos, fours = _neighbours(words, periodic, places, i, w, j)
                free &= _is_sum(ones, twos, fours, contacts)
                many = _ones(free)
                if rank >= many:
                    rank -= many
                    continue
                place[0], place[1], place[2] = i, j, 64 * w + _nth_bit(free, rank)
                return -1
    return rank


@kernel
def _neighbours(words, periodic, places, i, w, j):  # type: ignore[no-untyped-def]
    """Return the binary digits of how many of the six neighbours of each place in a word are blocked."""
    full = np.uint64(0xFFFFFFFFFFFFFFFF)
    nx, many, ny = words.shape
    nz = places[2]
    ones, twos, fours = np.uint64(0), np.uint64(0), np.uint64(0)
    for side in range(6):
        if side == 0:
            word = words[i - 1, w, j] if i > 0 else (words[nx - 1, w, j] if periodic[0] else full)
        elif side == 1:
            word = words[i + 1, w, j] if i + 1 < nx else (words[0, w, j] if periodic[0] else full)
        elif side == 2:
            word = words[i, w, j - 1] if j > 0 else (words[i, w, ny - 1] if periodic[1] else full)
        elif side == 3:
            word = words[i, w, j + 1] if j + 1 < ny else (words[i, w, 0] if periodic[1] else full)
        elif side == 4:
            below = np.uint64(1)
            if w > 0:
                below = words[i, w - 1, j] >> np.uint64(63)
            elif periodic[2]:
                below = words[i, (nz - 1) >> 6, j] >> np.uint64((nz - 1) & 63) & np.uint64(1)
            word = words[i, w, j] << np.uint64(1) | below
        else:
            above = words[i, w + 1, j] & np.uint64(1) if w + 1 < many else np.uint64(1)
            word = words[i, w, j] >> np.uint64(1) | above << np.uint64(63)
            if periodic[2] and w == (nz - 1) >> 6:
                last = np.uint64(1) << np.uint64((nz - 1) & 63)
                word = word & ~last | (last if words[i, 0, j] & np.uint64(1) else np.uint64(0))
        carry = ones & word
        ones ^= word
        fours ^= twos & carry
        twos ^= carry
    return ones, twos, fours


@kernel
def _is_sum(ones, twos, fours, total):  # type: ignore[no-untyped-def]
    """Return the places of a word at which the digits make a number."""
    a = ones if total & 1 else ~ones
    b = twos if total & 2 else ~twos
    return a & b & (fours if total & 4 else ~fours)


@kernel
def _ones(word):  # type: ignore[no-untyped-def]
    """Count the bits of a word that are set."""
    word = word - ((word >> np.uint64(1)) & np.uint64(0x5555555555555555))
    word = (word & np.uint64(0x3333333333333333)) + ((word >> np.uint64(2)) & np.uint64(0x3333333333333333))
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))


@kernel
def _nth_bit(word, rank):  # type: ignore[no-untyped-def]
    """Return which bit is the one of a rank among those set."""
    for b in range(64):
        if word >> np.uint64(b) & np.uint64(1):
            if rank == 0:
                return b
            rank -= 1
    return -1


def wall_shells(distance: NDArray[np.float64]) -> tuple[Integers, Integers]:
    """Return places, flat, by rising distance in whole voxels, and where each distance begins."""
    key = np.floor(np.maximum(distance.ravel(), 0.0)).astype(np.int64)
    order = np.argsort(key, kind="stable")
    return order.astype(np.int64), np.searchsorted(key[order], np.arange(int(key.max(initial=0)) + 2)).astype(np.int64)
