"""Pair tables: at which differences of places two grains would share a voxel, one bit a difference.

Where few shapes stand in few orientations, or grains are large, a move is tested against each neighbour by one bit of a
table (the no-fit region of the pair) instead of against the columns of the occupancy: its cost does not depend on the
number of voxels, and no occupancy is kept. The answers are the same, and so is the walk.

A table is made for two members and one rotation of the lattice between them; turned together, the two need no other.
"""

from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Integers, Words
from voxgran._base.kernels import bare_kernel
from voxgran.packing.digital.bit_columns import Field, VoxelBank, turned_box, turned_mask
from voxgran.packing.digital.feasible_places import overlap_table
from voxgran.packing.digital.periodic_images import is_outside, wrapped


class PairTables(NamedTuple):
    """Tables as kernels take them; `at` is empty where none are used.

    words: bit columns ``[x, word of z, y]`` of one table after the other.  at, low, size: where the table of members m,
    m' and the rotation r between them begins, its lowest difference and extents, at (m * members + m') * turns + r.
    between: rotation r that leads from turn t to turn t'.  back: the turn that undoes a turn.  members: how many.
    head, after: grains of each cell as a linked list, from the highest number down, -1 at its end.  cells: along each
    axis, and the edge of one.
    """

    words: Words
    at: Integers
    low: Integers
    size: Integers
    between: Integers
    back: Integers
    members: int
    head: Integers
    after: Integers
    cells: Integers


def no_tables() -> PairTables:
    """Return tables that are not used."""
    nothing, flat = np.zeros(0, dtype=np.int64), np.zeros((0, 3), dtype=np.int64)
    return PairTables(
        np.zeros(0, np.uint64), nothing, flat, flat, np.zeros((0, 0), np.int64), nothing, 0, nothing, nothing, nothing
    )


def table_bytes(size: Integers, turns: int) -> int:
    """Return about how many bytes the tables of members of given extents (m, 3) take in so many turns."""
    wide = size.max(axis=1, initial=1)
    both = wide[:, None] + wide[None, :]
    return int(turns * (both.astype(np.float64) ** 2 * (both // 64 + 1) * 8).sum())


def make_tables(bank: VoxelBank, rotations: Integers, turns: Integers, shape: Integers, count: int) -> PairTables:
    """Return the tables of all members in all turns between them, and empty cells.

    `rotations` (r, 3, 3) are a group, and `turns` the same as signed permutations of the axes; `shape` are the voxels
    of the container, `count` is the number of grains.
    """
    members, many = len(bank.size), len(turns)
    masks = [bank.mask(member) for member in range(members)]
    chunks, at, low, size = [], [], [], []
    begin = 0
    for one in range(members):
        for other in range(members):
            for turn in range(many):
                there = turned_mask(masks[other], turns[turn])
                there_low = np.array(turned_box.plain(bank.low[other], bank.size[other], turns[turn])[0])
                table = overlap_table(masks[one], bank.low[one], there, there_low)
                chunks.append(table.words.reshape(-1))
                at.append(begin)
                low.append(table.low)
                size.append(table.size)
                begin += table.words.size
    keys = {matrix.tobytes(): k for k, matrix in enumerate(rotations)}
    between = [[keys[linear.matmul(a.T, b).tobytes()] for b in rotations] for a in rotations]
    back = [keys[np.ascontiguousarray(a.T).tobytes()] for a in rotations]
    edge = reach_of(np.array(low), np.array(size))
    cells = np.append(np.maximum(shape // edge, 1), edge).astype(np.int64)
    return PairTables(
        np.concatenate(chunks),
        np.array(at, dtype=np.int64),
        np.array(low, dtype=np.int64),
        np.array(size, dtype=np.int64),
        np.array(between, dtype=np.int64),
        np.array(back, dtype=np.int64),
        members,
        np.full(int(np.prod(cells[:3])), -1, dtype=np.int64),
        np.full(count, -1, dtype=np.int64),
        cells,
    )


def reach_of(low: Integers, size: Integers) -> int:
    """Return the least difference along any axis at which no two grains overlap, from their tables."""
    return int(max(np.abs(low).max(initial=0), np.abs(low + size - 1).max(initial=0))) + 1


@bare_kernel
def _look_up_others(
    field: Field, pairs: PairTables, turns: Integers, where: tuple[Integers, Integers, Integers], grain: int,
    pose: tuple[int, int], site: tuple[int, int, int],
) -> int:  # fmt: skip
    """Return what :func:`look_up` returns.

    where: sites, members and turns of all grains.
    """
    sites, member, turn = where
    cells = pairs.cells
    reach = cells[3]
    pairs_read = 0
    undo = turns[pairs.back[pose[1]]]
    x, y, z = _cell_of(field, cells, 0, site[0]), _cell_of(field, cells, 1, site[1]), _cell_of(field, cells, 2, site[2])
    last_y, last_z = _last(field, cells, 1, y), _last(field, cells, 2, z)
    for i in range(_first(field, cells, 0, x), _last(field, cells, 0, x) + 1):
        plane = wrapped(i, cells[0], True) * cells[1]
        for j in range(_first(field, cells, 1, y), last_y + 1):
            line = (plane + wrapped(j, cells[1], True)) * cells[2]
            for k in range(_first(field, cells, 2, z), last_z + 1):
                other = pairs.head[line + wrapped(k, cells[2], True)]
                while other >= 0:
                    dx = _nearest(field, 0, sites[other, 0] - site[0])
                    dy = _nearest(field, 1, sites[other, 1] - site[1])
                    dz = _nearest(field, 2, sites[other, 2] - site[2])
                    if abs(dx) < reach and abs(dy) < reach and abs(dz) < reach and other != grain:
                        pairs_read += 1
                        if _overlap(pairs, undo, pose, (member[other], turn[other]), (dx, dy, dz)):
                            return ~pairs_read
                    other = pairs.after[other]
    return pairs_read


@bare_kernel
def _nearest(field, axis, apart):  # type: ignore[no-untyped-def]
    """Return the difference to the nearest periodic image along an axis."""
    if field.periodic[axis] == 0:
        return apart
    inside = wrapped(apart, field.shape[axis], 1)
    return inside - field.shape[axis] if 2 * inside > field.shape[axis] else inside


@bare_kernel
def _first(field, cells, axis, cell):  # type: ignore[no-untyped-def]
    """Return the first cell along an axis in which neighbours may lie; beyond an end where the axis is periodic."""
    if cells[axis] < 3:
        return 0
    return cell - 1 if field.periodic[axis] else max(cell - 1, 0)


@bare_kernel
def _last(field, cells, axis, cell):  # type: ignore[no-untyped-def]
    """Return the last cell along an axis in which neighbours may lie."""
    if cells[axis] < 3:
        return cells[axis] - 1
    return cell + 1 if field.periodic[axis] else min(cell + 1, cells[axis] - 1)


@bare_kernel
def _cell_of(field, cells, axis, site):  # type: ignore[no-untyped-def]
    """Return the cell of a site along an axis; the last one is wider."""
    inside = wrapped(site, field.shape[axis], field.periodic[axis])
    return max(0, min(inside // cells[3], cells[axis] - 1))


@bare_kernel
def _overlap(pairs, undo, pose, other, apart):  # type: ignore[no-untyped-def]
    """Return whether two grains so far apart share a voxel; undo: what turns the difference as the first sees it."""
    table = (pose[0] * pairs.members + other[0]) * len(pairs.back) + pairs.between[pose[1], other[1]]
    wide, deep, tall = pairs.size[table, 0], pairs.size[table, 1], pairs.size[table, 2]
    u = _component(apart, undo[0]) - pairs.low[table, 0]
    v = _component(apart, undo[1]) - pairs.low[table, 1]
    w = _component(apart, undo[2]) - pairs.low[table, 2]
    if u < 0 or u >= wide or v < 0 or v >= deep or w < 0 or w >= tall:
        return False
    word = pairs.words[pairs.at[table] + (u * ((tall + 63) // 64) + (w >> 6)) * deep + v]
    return (word >> np.uint64(w & 63)) & np.uint64(1) != np.uint64(0)


@bare_kernel
def _component(d, way):  # type: ignore[no-untyped-def]
    """Return the part of a difference along a signed axis."""
    axis = way % 3
    value = d[0] if axis == 0 else (d[1] if axis == 1 else d[2])
    return -value if way > 2 else value


@bare_kernel
def enlist(field: Field, pairs: PairTables, grain: int, site: Integers) -> None:
    """Put a grain into its cell, in order of numbers: how many pairs are read then does not depend on the past."""
    cell = _number(field, pairs.cells, site[0], site[1], site[2])
    at = pairs.head[cell]
    if at < grain:
        pairs.after[grain] = at
        pairs.head[cell] = grain
        return
    while pairs.after[at] > grain:
        at = pairs.after[at]
    pairs.after[grain] = pairs.after[at]
    pairs.after[at] = grain


@bare_kernel
def relist(field: Field, pairs: PairTables, grain: int, old: Integers, site: Integers) -> None:
    """Move a grain from the cell of its old site to that of its new one."""
    before = _number(field, pairs.cells, old[0], old[1], old[2])
    if before == _number(field, pairs.cells, site[0], site[1], site[2]):
        return
    at = pairs.head[before]
    if at == grain:
        pairs.head[before] = pairs.after[grain]
    else:
        while pairs.after[at] != grain:
            at = pairs.after[at]
        pairs.after[at] = pairs.after[grain]
    enlist(field, pairs, grain, site)


@bare_kernel
def _number(field, cells, x, y, z):  # type: ignore[no-untyped-def]
    """Return the number of the cell of a site."""
    return (_cell_of(field, cells, 0, x) * cells[1] + _cell_of(field, cells, 1, y)) * cells[2] + _cell_of(
        field, cells, 2, z
    )


@bare_kernel
def look_up(
    field: Field, pairs: PairTables, turns: Integers, where: tuple[Integers, Integers, Integers], grain: int,
    pose: tuple[int, int], box: tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]],
) -> int:  # fmt: skip
    """Look whether a grain as a member in a turn would reach through a wall or share a voxel with another.

    box: its site, its lowest voxel and its extents.  Return how many pairs were looked up; where something is in the
    way, the complement, which is below 0.
    """
    site, corner, size = box
    if is_outside(field, size, corner):
        return ~0
    return _look_up_others(field, pairs, turns, where, grain, pose, site)
