"""Available space for grains of a size, as open cells that are subdivided until none is left.

A cell holds positions of the center of a grain. Throws are uniform over the open cells of the size, so that accepted
ones are uniform over all available positions: the distribution of random sequential addition, without most throws that
cannot succeed. After some misses all cells are halved along each axis, and a part is closed if one single grain, or a
wall, excludes all of it. When no cell is open, neither grains of this size nor larger ones fit.

Cells of boxes along the axes are boxes of any size, from which the excluded regions are cut away exactly
(:mod:`voxgran.packing.rsa.available_boxes`): the gap of two faces may be too narrow for cells that are halved.

Cells of true shapes are closed where the sphere inside a new grain, wherever its center is in the cell, meets a grain
(:mod:`voxgran.packing.rsa.cell_parts`). Some are never closed, so that they are cut up to a number only.

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

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import WHOLE, Floats, Integers, Words
from voxgran._base.kernels import bare_kernel
from voxgran._base.seeds import below, philox_block, unit_float
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.containers.kernel_container import KernelContainer, is_between, is_held
from voxgran.packing.rsa.available_boxes import NEAR, open_boxes, slices
from voxgran.packing.rsa.candidates import IN_ROW, PLACED, REFUSED, TRIED, TURN
from voxgran.packing.rsa.cell_parts import LOW, CellClass, cell_index, look_at_parts, look_at_true, parts_in_place
from voxgran.packing.rsa.overlaps import Bed, enter, extents, find_overlap
from voxgran.packing.rsa.true_overlaps import place_true

#: misses, per open cell, after which cells are halved
PATIENCE = 1
#: largest number of initial cells of a class, per grain
FIRST_CELLS = 4
#: largest number of cells along an axis: smaller ones come near the rounding error of a position
FINEST = 2**45
#: entries of the tally: grains that were given up without proof, and deferred grains
UNPROVEN, PUT_OFF = 5, 6
#: largest number of open cells of a class of true shapes, per grain, and misses, per open cell, after which they are
#: cut, or looked at again if they would be more
OPEN_CELLS, PATIENCE_OF_TRUE = 512, 2
#: smallest share of the container that half a grain takes along an axis
THIN = 1e-9
#: misses of boxes that the last cut left unchanged: no cut changes them before another grain is placed
EXACT = -(2**62)


class Classes(NamedTuple):
    """Size classes.

    kind: class of each grain.  half: smallest half extents of each class.  low, span: range of its centers.  base:
    initial cells along the axes.  parts: number of parts into which a cell is cut along the axes.  tries: failed throws
    after which a grain is deferred; 0 if all grains of the class are equal.  most: largest number of open cells of true
    shapes; 0 for spheres and aligned boxes, of which all cells can be closed.

    The last class has no grains of its own: it is that of deferred grains.
    """

    kind: NDArray[np.int32]
    half: Floats
    low: Floats
    span: Floats
    base: Integers
    parts: Integers
    tries: Integers
    most: Integers


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
    half: Floats,
    kind: NDArray[np.int32],
    queue: NDArray[np.int32],
    walls: KernelContainer,
    dimension: int,
    tries: int,
    *,
    inner: bool = False,
) -> Classes:
    """Return the size classes of the grains of a queue, and the layout of their initial cells.

    `half`, (n, 1 or 3), are half the extents of all grains and `kind`, (n,), their classes. In a class of several sizes
    a grain is deferred after `tries` failed throws, and so is any grain if the half extents are only those of spheres
    inside, `inner`.
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
        thin = THIN * walls.lengths[:dimension]
        wanted = np.maximum(span[k, :dimension] / np.maximum(2 * least[k, :dimension], thin), 1.0)
        first = FIRST_CELLS * max(int(grains[k]), 16)
        wanted *= min(1.0, (first / np.prod(wanted)) ** (1 / dimension))
        base[k, :dimension] = np.maximum(np.ceil(wanted - WHOLE), 1)
    limits = np.where((least < largest).any(axis=1) | inner, tries, 0).astype(np.int64)
    most = np.append(np.full(many, OPEN_CELLS * max(len(half) // max(many, 1), 16) * inner), 0).astype(np.int64)
    parts = np.where(span > 0, 2, 1).astype(np.int64)
    one = np.ones((1, 3), dtype=np.int64)
    least, low, span = (np.vstack([array, one]) for array in (least, low, span))
    return Classes(kind, least, low, span, np.vstack([base, one]), np.vstack([parts, one]), np.append(limits, 0), most)


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


def cut_cells(bed: Bed, classes: Classes, open_cells: Open, kind: int, shapes: TrueShapes | None = None) -> Open:
    """Return the open cells with those of class `kind` cut and the excluded parts closed; `open_cells` is overwritten.

    Too many cells of true shapes are not cut, and only those that are excluded now are closed.
    """
    begin, end = int(open_cells.bounds[kind]), int(open_cells.bounds[kind + 1])
    misses, depth = open_cells.misses.copy(), open_cells.depth.copy()
    parts: Integers = classes.parts[kind]
    most = int(classes.most[kind])
    misses[kind] = 0
    if most and ((end - begin) * parts.prod() > most or depth[kind] >= _cuts_of_lattice(classes)[kind]):
        parts = np.ones(3, dtype=np.int64)
    else:
        depth[kind] += 1
    if bed.grains.boxes:
        before = open_cells.cell[begin:end]
        after = open_boxes(bed, before, classes.half[kind])
        # if anything is cut away, some edge is shorter
        misses[kind] = EXACT if np.array_equal(after[:, 3:], before[:, 3:]) else 0
        many, cell = len(after), np.concatenate([open_cells.cell[:begin], after, open_cells.cell[end:]])
    else:
        kept = np.zeros(end - begin, dtype=np.uint8)
        own = CellClass(classes.half[kind], classes.low[kind], all_edges(classes, open_cells)[kind], parts)
        near, many = np.zeros((NEAR, 6)), 0
        for part in slices(end - begin):
            some = open_cells.cell[begin:end][part]
            if shapes is None:
                many += int(look_at_parts(bed, some, own, near, kept[part]))
            else:
                many += int(look_at_true(bed, some, own, kept[part], shapes))
        width = max(_width(classes, depth), open_cells.cell.shape[1])
        cell = parts_in_place(open_cells.cell, begin, kept, many, parts, width)
    if most:
        # to look at true shapes takes longer than to throw them
        misses[kind] = (PATIENCE - PATIENCE_OF_TRUE) * many
    bounds = open_cells.bounds.copy()
    bounds[kind + 1 :] += many - (end - begin)
    return Open(cell, bounds, misses, depth)


def _width(classes: Classes, depth: Integers) -> int:
    """Return the number of 16-bit words of the index of a cell: 3, 6 or 9."""
    last = int((classes.base * classes.parts ** depth[:, None]).max(initial=1)) - 1
    return 3 * max(1, math.ceil(last.bit_length() / 16))


def all_edges(classes: Classes, open_cells: Open) -> Floats:
    """Return the edges of the open cells of each class, (k, 3); (0, 3) for boxes, which have their own."""
    if open_cells.cell.dtype != np.uint16:
        return np.zeros((0, 3))
    return np.asarray(classes.span / (classes.base * classes.parts.astype(np.float64) ** open_cells.depth[:, None]))


def volumes_up_to(classes: Classes, open_cells: Open) -> Floats:
    """Return the cumulative volumes of the open boxes of each class; (0,) for cells of a lattice."""
    if open_cells.cell.dtype == np.uint16:
        return np.zeros(0)
    kind = np.repeat(np.arange(len(classes.base)), np.diff(open_cells.bounds))
    volume = np.where(classes.parts[kind] == 2, open_cells.cell[:, 3:], 1.0).prod(axis=1)
    return np.concatenate([np.zeros(0), *(np.cumsum(part) for part in np.split(volume, open_cells.bounds[1:-1]))])


def deepest_cut(classes: Classes, boxes: bool) -> Integers:
    """Return how often the cells of each class can be cut or looked at; boxes and true shapes without limit."""
    if boxes:
        return np.full(len(classes.base), FINEST)
    return np.where(classes.most > 0, FINEST, _cuts_of_lattice(classes))


def _cuts_of_lattice(classes: Classes) -> Integers:
    """Return how often the cells of each class can be halved."""
    return np.floor(libm.log2(FINEST / classes.base.max(axis=1))).astype(np.int64)


class Throws(NamedTuple):
    """What is thrown, and where.

    queue: (m,), grains in their order.  late: class of all grains, if these are deferred; -1 if each has its own.
    classes, cells: the size classes, and their open cells.  edge: (k, 3), edges of the cells of each class; empty for
    boxes.  volume: cumulative volumes of the open boxes of each class; empty for cells of a lattice.  last_cut: (k,),
    how often the cells of each class can be cut.  key: that of the random stream.
    """

    queue: NDArray[np.int32]
    late: int
    classes: Classes
    cells: Open
    edge: Floats
    volume: Floats
    last_cut: Integers
    key: Words


@bare_kernel
def throw_into_cells(
    bed: Bed, throws: Throws, tally: Integers, first: int, last: int, shapes: TrueShapes | None
) -> tuple[int, int]:
    """Make attempts `first` to `last` - 1, one throw each.

    Parameters
    ----------
    bed, throws : Bed and Throws
        Where grains are, and what is thrown.
    first, last : int
        First attempt, and the one after the last.
    tally : ndarray of int
        Turn, tries of the grain, placed, moved, rejected, given up without proof, deferred, deferred grains that were
        tried again, rejected since the last was placed.
    shapes : TrueShapes or None
        None for spheres and aligned boxes.

    Returns
    -------
    attempt, kind : int
        Number of the next attempt, and the class whose cells must be cut before it; -1 for none.
    """
    grains, queue, late, classes, open_cells = bed.grains, throws.queue, throws.late, throws.classes, throws.cells
    attempt = first
    while attempt < last and tally[TURN] < len(queue):
        g = queue[tally[TURN]]
        kind = classes.kind[g] if late < 0 else late
        many = open_cells.bounds[kind + 1] - open_cells.bounds[kind]
        worn = open_cells.misses[kind] >= PATIENCE * many and many > 0
        if worn and open_cells.depth[kind] < throws.last_cut[kind]:
            return attempt, kind
        tired = many > 0 and classes.tries[kind] > 0 and tally[TRIED] >= classes.tries[kind]
        # true shapes are tried in several rounds
        entered = shapes is not None and grains.entered[g] == 1
        if many == 0 or worn or tired or entered:
            tally[UNPROVEN] += worn and not entered
            tally[PUT_OFF] += tired and not worn
            tally[TURN] += 1
            tally[TRIED] = 0
            continue
        place = _thrown(throws, grains.boxes, kind, attempt)
        # what is None is not compiled
        there = _place(bed, g, place) if shapes is None else place_true(bed, shapes, g, place, throws.key, attempt)
        if there:
            tally[PLACED] += 1
            tally[TURN] += 1
            tally[TRIED] = 0
            tally[IN_ROW] = 0
            for k in range(len(open_cells.misses) if grains.boxes else 0):
                open_cells.misses[k] = max(open_cells.misses[k], 0)
        else:
            tally[REFUSED] += 1
            tally[IN_ROW] += 1
            tally[TRIED] += 1
            open_cells.misses[kind] += 1
        attempt += 1
    return attempt, -1


@bare_kernel
def _thrown(throws, boxes, kind, attempt):  # type: ignore[no-untyped-def]
    """Return a random position in a random open cell of a class."""
    cell, low, edge, key = throws.cells.cell, throws.classes.low, throws.edge, throws.key
    begin, many = throws.cells.bounds[kind], throws.cells.bounds[kind + 1] - throws.cells.bounds[kind]
    pick, a, b, c = philox_block(key[0], key[1], np.uint64(attempt), np.uint64(0))
    if boxes:
        k = begin + _at_volume(throws.volume, begin, many, unit_float(pick))
        return (
            cell[k, 0] + unit_float(a) * cell[k, 3],
            cell[k, 1] + unit_float(b) * cell[k, 4],
            cell[k, 2] + unit_float(c) * cell[k, 5],
        )
    k = begin + below(pick, many)
    i, j, n = cell_index(cell, k)
    return (
        low[kind, 0] + (i + unit_float(a)) * edge[kind, 0],
        low[kind, 1] + (j + unit_float(b)) * edge[kind, 1],
        low[kind, 2] + (n + unit_float(c)) * edge[kind, 2],
    )


@bare_kernel
def _place(bed, g, place):  # type: ignore[no-untyped-def]
    """Place a sphere or an aligned box at a position if it overlaps nothing; return whether it did."""
    half = extents(bed.grains.half, g)
    if not is_between(bed.walls, *place, *half) or find_overlap(bed, place, half, 0.0, False)[0] >= 0:
        return False
    if not is_held(bed.walls, *place, *half):
        return False
    enter(bed, g, place)
    return True


@bare_kernel
def _at_volume(volume, begin, many, share):  # type: ignore[no-untyped-def]
    """Return the open box of a class at a fraction of their cumulative volume."""
    sought = share * volume[begin + many - 1]
    first, last = 0, many - 1
    while first < last:
        middle = (first + last) // 2
        if volume[begin + middle] > sought:
            last = middle
        else:
            first = middle + 1
    return first
