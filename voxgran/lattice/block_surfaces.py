"""Surfaces of the labels of an image in blocks: group by group, in windows around the labels of each.

A window holds the labels that lie in one cell of a coarse lattice, and what is around them. Where a label touches one
of a later group, the points between them stay as the earlier group has left them, so that both have the same triangles
and each label the volume of its voxels. How far other points move differs from the surfaces of the whole image at once
only by what the pressures of labels beyond the window would change. Along a periodic axis a window goes on across the
face of the image, or, where it would meet itself, takes the whole axis.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.lattice.census import Census
from voxgran.lattice.image import of_blocks, window
from voxgran.lattice.label_seams import Seams
from voxgran.lattice.label_surfaces import label_surfaces

#: bytes that a window may take, and least edge in voxels of the cells by which labels are grouped
BUDGET, LEAST = 2**30, 64
#: bytes of a voxel while it is read, and of a point of the net when it is smoothed
READ, SMOOTHED = 16, 160
#: faces of the voxels of a sphere of one voxel, as its surface is 2/3 of theirs
FACES = 1.5 * (36 * math.pi) ** (1 / 3)
#: voxels around the labels of a group
MARGIN = 16


def block_surfaces(
    values: Any,
    found: Census,
    some: Integers,
    *,
    wraps: Booleans,
    smoothing: float,
    spacing: Floats,
    several: list[int],
) -> Iterator[tuple[int, tuple[Floats, NDArray[np.int32]]]]:
    """Yield some rows of a census of a dask array of labels, each with the surface as `LabelSurfaces.of` returns it.

    `wraps`, `smoothing` and `spacing` are those of `label_surfaces`.  Labels, by row, of which the largest of several
    pieces is left are appended to `several`.

    Raises
    ------
    TooLargeError
        If a label spans more voxels than fit in memory.
    """
    shape = np.array(values.shape, dtype=np.int64)
    # along an axis of one voxel each label meets itself, and is cut there as at a border
    wraps = wraps & (shape > 1)
    found = _laid_out(values, found, wraps)
    cells = (found.lower[some] + found.upper[some]) // (2 * _edges(found, some, shape))
    _, group = np.unique(cells, axis=0, return_inverse=True)
    later = np.zeros(len(found.label) + 1, dtype=np.bool_)
    later[some + 1] = True
    none = np.zeros(0, dtype=np.bool_)
    seams = Seams(shape + ~wraps, np.zeros(3, dtype=np.int64), whole=none, own=none, due=none)
    how: dict[str, Any] = {"smoothing": smoothing, "spacing": spacing, "seams": seams}
    for number in range(int(group.max(initial=-1)) + 1):
        # what a group takes ends before the next one is read
        yield from _group(values, found, some[group.ravel() == number], wraps, later, several, how)


def _laid_out(values: Any, found: Census, wraps: Booleans) -> Census:
    """Return a census in which boxes of labels that go on across periodic faces end beyond the end of the image."""
    lower, upper = found.lower.copy(), found.upper.copy()
    for axis in np.flatnonzero(wraps).tolist():
        n = values.shape[axis]
        some = np.flatnonzero((lower[:, axis] == 0) & (upper[:, axis] == n))
        full = np.zeros((len(some), n), dtype=np.bool_)
        for rows, planes in of_blocks(values, _planes, found.label[some], axis) if len(some) else []:
            full[rows, planes] = True
        ends = full.argmin(axis=1)
        after = full & (np.arange(n) > ends[:, None])
        lower[some, axis] = after.argmax(axis=1)
        upper[some, axis] = n + ends
        whole = some[full.all(axis=1)]
        lower[whole, axis], upper[whole, axis] = 0, n
        # as in memory, where the first corner along a periodic axis is the last one
        begins = np.flatnonzero((lower[:, axis] == 0) & (upper[:, axis] < n))
        lower[begins, axis], upper[begins, axis] = n, upper[begins, axis] + n
    return replace(found, lower=lower, upper=upper)


def _planes(block: NDArray[Any], start: Integers, some: Integers, axis: int) -> tuple[Integers, Integers]:
    """Return the rows of some rising labels and the planes normal to an axis, in pairs, of their voxels in a block."""
    pairs = [(np.unique(plane), start[axis] + k) for k, plane in enumerate(np.moveaxis(block, axis, 0))]
    labels = np.concatenate([there for there, _ in pairs])
    planes = np.repeat([k for _, k in pairs], [len(there) for there, _ in pairs])
    known = np.isin(labels, some)
    return np.searchsorted(some, labels[known]), planes[known]


def _edges(found: Census, some: Integers, shape: Integers) -> Integers:
    """Return edges in voxels of cells, (3,), for which windows take the memory that they may, if grains lie evenly."""
    points = FACES * float(libm.power(found.count[some], 2 / 3).sum()) / float(shape.prod())
    window = (BUDGET / max(READ, SMOOTHED * points)) ** (1 / 3)
    edge = max(window - 2 * MARGIN - float((found.upper[some] - found.lower[some]).mean()), LEAST)
    return np.asarray(np.ceil(shape / np.ceil(shape / edge)), dtype=np.int64)


def _group(
    values: Any, found: Census, own: Integers, wraps: Booleans, later: Booleans, several: list[int], how: dict[str, Any]
) -> Iterator[tuple[int, tuple[Floats, NDArray[np.int32]]]]:
    """Yield the surfaces of the rows of a group, as `block_surfaces`; in `later`, by row + 1, they become False."""
    shape, seams = np.array(values.shape, dtype=np.int64), how["seams"]
    lower, upper = found.lower[own].min(axis=0) - MARGIN, found.upper[own].max(axis=0) + MARGIN
    around = wraps & (upper - lower >= shape)
    lower = np.where(around, 0, np.where(wraps, lower, np.maximum(lower, 0)))
    upper = np.where(around, shape, np.where(wraps, upper, np.minimum(upper, shape)))
    name = f"the group of {len(own)} labels with label {found.label[own[0]]}"
    # the list gives the window away, so that it ends when it is not needed any more
    part = [found.numbered(window(values, lower, upper, name))]
    # rows + 1 of the labels in the window, in which they are numbered in the same order
    there = np.zeros(len(later), dtype=np.bool_)
    for plane in part[0]:
        there[plane.ravel()] = True
    there[0] = True
    rows, numbers = np.flatnonzero(there), (np.cumsum(there) - 1).astype(np.int32)
    for plane in part[0]:
        plane[...] = numbers[plane]
    first = np.where(wraps, (found.lower - lower) % shape, found.lower - lower)
    inside = (around | ((first >= 0) & (first + found.upper - found.lower <= upper - lower))).all(axis=1)
    seams.corner, seams.own = lower, np.isin(rows, own + 1)
    seams.whole = np.concatenate([[False], inside])[rows]
    seams.due = seams.whole & later[rows]
    made = label_surfaces(part.pop(), len(rows) - 1, wraps=around, **how)
    later[own + 1] = False
    # the first and the last planes of a periodic axis are beside each other
    remaining = 0 if wraps[0] else int(found.lower[np.flatnonzero(later) - 1, 0].min(initial=shape[0]))
    seams.keep(made.net, made.moved, made.crossed, later[rows], remaining)
    several += [int(rows[label]) - 1 for label in made.several if seams.own[label]]
    for label in np.flatnonzero(seams.own):
        yield int(rows[label]) - 1, made.of(int(label))
