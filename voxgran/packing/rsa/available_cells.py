"""Available space for grains of a size, as open cells that are subdivided until none is left.

A cell holds positions of the center of a grain. Throws are uniform over the open cells of the size, so that accepted
ones are uniform over all available positions: the distribution of random sequential addition, without most throws that
cannot succeed. After some misses all cells are halved along each axis, and a part is closed if one single grain, or a
wall, excludes all of it. When no cell is open, neither grains of this size nor larger ones fit.

Cells of boxes along the axes are boxes of any size, from which the excluded regions are cut away exactly
(:mod:`voxgran.packing.rsa.available_boxes`): the gap of two faces may be too narrow for cells that are halved.

Each size class has cells of its own, for the smallest of its sizes. In a class of several sizes a larger grain may fail
while cells are open: after some failed throws it is deferred (:mod:`voxgran.packing.rsa.deferred_grains`).

References
----------
Zhang & Torquato 2013, Precise algorithm to generate random sequential addition of hard hyperspheres at saturation,
Physical Review E 88, 053312, doi:10.1103/PhysRevE.88.053312
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import WHOLE, Floats, Integers, Words
from voxgran._base.kernels import bare_kernel
from voxgran._base.seeds import below, philox_block, unit_float
from voxgran.containers.kernel_container import KernelContainer, is_barred, is_between, is_held
from voxgran.packing.level_grid import LevelGrid
from voxgran.packing.rsa.available_boxes import NEAR, open_boxes, slices
from voxgran.packing.rsa.candidates import PLACED, REFUSED, TRIED, TURN
from voxgran.packing.rsa.overlaps import Grains, enter, extents, find_overlap, gather, is_within

#: misses, per open cell, after which cells are halved
PATIENCE = 1
#: largest number of initial cells of a class, per grain
FIRST_CELLS = 4
#: largest number of cells along an axis: smaller ones come near the rounding error of a position
FINEST = 2**45
#: the lowest 16 bits of a number
LOW = 0xFFFF
#: entries of the tally: grains that were given up without proof, and deferred grains
UNPROVEN, PUT_OFF = 5, 6
#: misses of boxes that the last cut left unchanged: no cut changes them before another grain is placed
EXACT = -(2**62)


class Classes(NamedTuple):
    """Size classes.

    kind: class of each grain.  half: smallest half extents of each class.  low, span: range of its centers.  base:
    initial cells along the axes.  parts: number of parts into which a cell is cut along the axes.  tries: failed throws
    after which a grain is deferred; 0 if all grains of the class are equal.

    The last class has no grains of its own: it is that of deferred grains.
    """

    kind: NDArray[np.int32]
    half: Floats
    low: Floats
    span: Floats
    base: Integers
    parts: Integers
    tries: Integers


class Open(NamedTuple):
    """The open cells of all classes, one class after the other.

    cell: index of each along the axes, in cells of its class, as words of 16 bits: the three lowest ones and, for large
    numbers, three higher ones; of boxes lower corner and edges.  bounds: first cell of each class, and the end.
    misses: failed throws since the cells of a class were last cut; negative for boxes that a cut would not change.
    depth: number of cuts.
    """

    cell: NDArray[Any]
    bounds: Integers
    misses: Integers
    depth: Integers


def make_classes(
    half: Floats, kind: NDArray[np.int32], queue: NDArray[np.int32], walls: KernelContainer, dimension: int, tries: int
) -> Classes:
    """Return the size classes of the grains of a queue, and the layout of their initial cells.

    `half`, (n, 1 or 3), are half the extents of all grains and `kind`, (n,), their classes. In a class of several sizes
    a grain is deferred after `tries` failed throws.
    """
    grains = np.bincount(kind[queue])
    many = len(grains)
    least, largest = np.full((many, 3), np.inf), np.zeros((many, 3))
    np.minimum.at(least, kind[queue], half[queue])
    np.maximum.at(largest, kind[queue], half[queue])
    walled = walls.walled == 1
    low = np.where(walled, walls.lower + least, walls.lower)
    span = np.where(walled, np.maximum(walls.lengths - 2 * least, 0.0), walls.lengths)
    flat = np.arange(3) >= dimension
    span[:, flat] = 0.0
    base = np.ones((many, 3), dtype=np.int64)
    for k in range(many):
        wanted = np.maximum(span[k, :dimension] / (2 * least[k, :dimension]), 1.0)
        most = FIRST_CELLS * max(int(grains[k]), 16)
        wanted *= min(1.0, (most / np.prod(wanted)) ** (1 / dimension))
        base[k, :dimension] = np.maximum(np.ceil(wanted - WHOLE), 1)
    limits = np.where((least < largest).any(axis=1), tries, 0).astype(np.int64)
    parts = np.where(span > 0, 2, 1).astype(np.int64)
    one = np.ones((1, 3), dtype=np.int64)
    least, low, span = (np.vstack([array, one]) for array in (least, low, span))
    return Classes(kind, least, low, span, np.vstack([base, one]), np.vstack([parts, one]), np.append(limits, 0))


def first_cells(classes: Classes, boxes: bool) -> Open:
    """Return the initial cells of all classes; those of `boxes` have any size."""
    many = len(classes.base) - 1
    nothing = np.zeros(len(classes.base), dtype=np.int64)
    width = _width(classes, nothing)
    cells: list[NDArray[Any]] = [np.zeros((0, 6)) if boxes else np.zeros((0, width), dtype=np.uint16)]
    for base, low, span in zip(classes.base[:many], classes.low, classes.span, strict=False):
        place = np.indices(tuple(base.tolist()), dtype=np.uint32).reshape(3, -1).T
        edge = np.broadcast_to(span / base, place.shape)
        if boxes:
            cells.append(np.column_stack([low + place * edge, edge]))
        else:
            cells.append(np.hstack([(place >> 16 * k & LOW).astype(np.uint16) for k in range(width // 3)]))
    bounds = np.cumsum([*(len(cell) for cell in cells), 0]).astype(np.int64)
    return Open(np.concatenate(cells), bounds, nothing, nothing.copy())


def cut_cells(
    grains: Grains, cells: LevelGrid, walls: KernelContainer, classes: Classes, known: Open, kind: int
) -> Open:
    """Return the open cells with those of class `kind` cut and the excluded parts closed; `known` is overwritten."""
    begin, end = int(known.bounds[kind]), int(known.bounds[kind + 1])
    misses, depth = known.misses.copy(), known.depth.copy()
    misses[kind], depth[kind] = 0, depth[kind] + 1
    if grains.boxes:
        before = known.cell[begin:end]
        after = open_boxes(grains, cells, walls, before, classes.half[kind])
        # if anything is cut away, some edge is shorter
        misses[kind] = EXACT if np.array_equal(after[:, 3:], before[:, 3:]) else 0
        many, cell = len(after), np.concatenate([known.cell[:begin], after, known.cell[end:]])
    else:
        kept = np.zeros(end - begin, dtype=np.uint8)
        shape = (classes.half[kind], classes.low[kind], all_edges(classes, known)[kind], classes.parts[kind])
        near, many = np.zeros((NEAR, 6)), 0
        for part in slices(end - begin):
            many += int(_look_at_parts(grains, cells, walls, known.cell[begin:end][part], *shape, near, kept[part]))
        width = max(_width(classes, depth), known.cell.shape[1])
        cell = _parts_in_place(known.cell, begin, kept, many, classes.parts[kind], width)
    bounds = known.bounds.copy()
    bounds[kind + 1 :] += many - (end - begin)
    return Open(cell, bounds, misses, depth)


def _parts_in_place(
    cell: NDArray[Any], begin: int, kept: NDArray[np.uint8], many: int, parts: Integers, width: int
) -> NDArray[Any]:
    """Return the cells with some replaced by their remaining parts, without a second large array."""
    if width > cell.shape[1] or not cell.flags.owndata:
        cell = np.pad(cell, ((0, 0), (0, width - cell.shape[1])))
    end, rest = begin + len(kept), len(cell) - begin - len(kept)
    still = int(_drop_closed(cell[begin:end], kept))
    # no other array refers to the memory
    cell.resize((max(len(cell), begin + many + rest), width), refcheck=False)
    cell[begin + many : begin + many + rest] = cell[end : end + rest]
    _write_parts(cell[begin : begin + many], still, parts, kept)
    cell.resize((begin + many + rest, width), refcheck=False)
    return cell


def _width(classes: Classes, depth: Integers) -> int:
    """Return the number of 16-bit words of the index of a cell: 3, 6 or 9."""
    last = int((classes.base * classes.parts ** depth[:, None]).max(initial=1)) - 1
    return 3 * max(1, math.ceil(last.bit_length() / 16))


def all_edges(classes: Classes, known: Open) -> Floats:
    """Return the edges of the open cells of each class, (k, 3); (0, 3) for boxes, which have their own."""
    if known.cell.dtype != np.uint16:
        return np.zeros((0, 3))
    return np.asarray(classes.span / (classes.base * classes.parts.astype(np.float64) ** known.depth[:, None]))


def volumes_up_to(classes: Classes, known: Open) -> Floats:
    """Return the cumulative volumes of the open boxes of each class; (0,) for cells of a lattice."""
    if known.cell.dtype == np.uint16:
        return np.zeros(0)
    kind = np.repeat(np.arange(len(classes.base)), np.diff(known.bounds))
    volume = np.where(classes.parts[kind] == 2, known.cell[:, 3:], 1.0).prod(axis=1)
    return np.concatenate([np.zeros(0), *(np.cumsum(part) for part in np.split(volume, known.bounds[1:-1]))])


def deepest_cut(classes: Classes, boxes: bool) -> Integers:
    """Return how often the cells of each class can be cut; boxes without limit."""
    if boxes:
        return np.full(len(classes.base), FINEST)
    return np.floor(np.log2(FINEST / classes.base.max(axis=1))).astype(np.int64)


@bare_kernel
def throw_into_cells(
    grains: Grains,
    cells: LevelGrid,
    walls: KernelContainer,
    classes: Classes,
    known: Open,
    edge: Floats,
    volume: Floats,
    last_cut: Integers,
    late: int,
    queue: NDArray[np.int32],
    tally: Integers,
    key: Words,
    first: int,
    last: int,
) -> tuple[int, int]:
    """Make attempts `first` to `last` - 1, one throw each.

    Parameters
    ----------
    edge : (k, 3) ndarray of float
        Edges of the cells of each class; empty for boxes.
    volume : (m,) ndarray of float
        Cumulative volumes of the open boxes of each class; empty for cells of a lattice.
    last_cut : (k,) ndarray of int
        How often the cells of each class can be cut.
    late : int
        Class of all grains, if these are deferred; -1 if each has its own.
    queue : (m,) ndarray of int
        Grains in their order.
    tally : ndarray of int
        Turn, tries of the grain, placed, moved, rejected, given up without proof, deferred.

    Returns
    -------
    attempt, kind : int
        Number of the next attempt, and the class whose cells must be cut before it; -1 for none.
    """
    attempt = first
    while attempt < last and tally[TURN] < len(queue):
        g = queue[tally[TURN]]
        kind = classes.kind[g] if late < 0 else late
        begin, many = known.bounds[kind], known.bounds[kind + 1] - known.bounds[kind]
        worn = known.misses[kind] >= PATIENCE * many and many > 0
        if worn and known.depth[kind] < last_cut[kind]:
            return attempt, kind
        tired = many > 0 and classes.tries[kind] > 0 and tally[TRIED] >= classes.tries[kind]
        if many == 0 or worn or tired:
            tally[UNPROVEN] += worn
            tally[PUT_OFF] += tired and not worn
            tally[TURN] += 1
            tally[TRIED] = 0
            continue
        if _throw(grains, cells, walls, classes.low, known.cell, volume, begin, many, edge, key, attempt, kind, g):
            tally[PLACED] += 1
            tally[TURN] += 1
            tally[TRIED] = 0
            for k in range(len(known.misses) if grains.boxes else 0):
                known.misses[k] = max(known.misses[k], 0)
        else:
            tally[REFUSED] += 1
            tally[TRIED] += 1
            known.misses[kind] += 1
        attempt += 1
    return attempt, -1


@bare_kernel
def _throw(grains, cells, walls, low, cell, volume, begin, many, edge, key, attempt, kind, g):  # type: ignore[no-untyped-def]
    """Try a grain at a random position in a random open cell; return whether it was placed."""
    pick, a, b, c = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
    if grains.boxes:
        k = begin + _at_volume(volume, begin, many, unit_float(pick))
        x = cell[k, 0] + unit_float(a) * cell[k, 3]
        y = cell[k, 1] + unit_float(b) * cell[k, 4]
        z = cell[k, 2] + unit_float(c) * cell[k, 5]
    else:
        k = begin + below(pick, many)
        i, j, n = _numbers(cell, k)
        x = low[kind, 0] + (i + unit_float(a)) * edge[kind, 0]
        y = low[kind, 1] + (j + unit_float(b)) * edge[kind, 1]
        z = low[kind, 2] + (n + unit_float(c)) * edge[kind, 2]
    hx, hy, hz = extents(grains.half, g)
    if not is_between(walls, x, y, z, hx, hy, hz):
        return False
    if find_overlap(grains, cells, walls, x, y, z, hx, hy, hz, 0.0, False)[0] >= 0:
        return False
    if not is_held(walls, x, y, z, hx, hy, hz):
        return False
    enter(grains, cells, walls, g, x, y, z)
    return True


@bare_kernel
def _numbers(cell, k):  # type: ignore[no-untyped-def]
    """Return the indices of a cell along the axes."""
    i, j, n = np.int64(0), np.int64(0), np.int64(0)
    for word in range(cell.shape[1] - 3, -1, -3):
        i = (i << 16) + np.int64(cell[k, word])
        j = (j << 16) + np.int64(cell[k, word + 1])
        n = (n << 16) + np.int64(cell[k, word + 2])
    return i, j, n


@bare_kernel
def _at_volume(volume, begin, many, share):  # type: ignore[no-untyped-def]
    """Return the open box of a class at a fraction of their cumulative volume."""
    wanted = share * volume[begin + many - 1]
    first, last = 0, many - 1
    while first < last:
        middle = (first + last) // 2
        if volume[begin + middle] > wanted:
            last = middle
        else:
            first = middle + 1
    return first


@bare_kernel
def _look_at_parts(grains, cells, walls, cell, half, low, edge, parts, near, kept):  # type: ignore[no-untyped-def]
    """Write which parts of each cell stay open, as bits, and return their number."""
    total = 0
    ex, ey, ez = 0.5 * edge[0], 0.5 * edge[1], 0.5 * edge[2]
    px, py, pz = ex / parts[0], ey / parts[1], ez / parts[2]
    for m in range(len(cell)):
        i, j, n = _numbers(cell, m)
        x, y, z = low[0] + (i + 0.5) * edge[0], low[1] + (j + 0.5) * edge[1], low[2] + (n + 0.5) * edge[2]
        many = gather(grains, cells, walls, x, y, z, half[0], half[1], half[2], ex, ey, ez, near)
        bits = 0
        for part in range(8 if many >= 0 else 0):
            i, j, n = part >> 2, (part >> 1) & 1, part & 1
            if i >= parts[0] or j >= parts[1] or n >= parts[2]:
                continue
            # the middle of a part, from the middle of the cell
            qx, qy, qz = (2 * i + 1) * px - ex, (2 * j + 1) * py - ey, (2 * n + 1) * pz - ez
            if _is_blocked(grains.boxes, near, many, qx, qy, qz, px, py, pz):
                continue
            if is_barred(walls, x + qx, y + qy, z + qz, px, py, pz, half[0]):
                continue
            bits |= 1 << part
            total += 1
        kept[m] = bits
    return total


@bare_kernel
def _is_blocked(boxes, near, many, x, y, z, ex, ey, ez):  # type: ignore[no-untyped-def]
    """Return whether a single near grain excludes all of a part."""
    k = 0
    while k < many and not is_within(boxes, near, k, x, y, z, ex, ey, ez):
        k += 1
    return k < many


@bare_kernel
def _drop_closed(cell, kept):  # type: ignore[no-untyped-def]
    """Move the cells with an open part to the front, and return their number."""
    many = 0
    for m in range(len(cell)):
        if kept[m]:
            for word in range(cell.shape[1]):
                cell[many, word] = cell[m, word]
            kept[many] = kept[m]
            many += 1
    return many


@bare_kernel
def _write_parts(cell, many, parts, kept):  # type: ignore[no-untyped-def]
    """Write the open parts of the first `many` cells over all cells, from the last to the first.

    Each cell has at least one, so that none is overwritten before it is read.
    """
    row = len(cell)
    for m in range(many - 1, -1, -1):
        i, j, n = _numbers(cell, m)
        for part in range(7, -1, -1):
            if kept[m] & (1 << part):
                row -= 1
                x, y, z = i * parts[0] + (part >> 2), j * parts[1] + ((part >> 1) & 1), n * parts[2] + (part & 1)
                for word in range(0, cell.shape[1], 3):
                    cell[row, word], cell[row, word + 1], cell[row, word + 2] = x & LOW, y & LOW, z & LOW
                    x, y, z = x >> 16, y >> 16, z >> 16
