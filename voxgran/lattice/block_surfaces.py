"""Surfaces of the labels of an image in blocks: group by group, in windows around the labels of each.

A window holds the labels that lie in one cell of a coarse lattice, and what is around them. Where a label touches one
of a later group, the points between them stay as the earlier group has left them, so that both have the same triangles
and each label the volume of its voxels. How far other points move differs from the surfaces of the whole image at once
only by what the pressures of labels beyond the window would change.
"""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.lattice.blocks import window
from voxgran.lattice.census import Census
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
    values: Any, found: Census, some: Integers, *, smoothing: float, spacing: Floats, several: list[int]
) -> Iterator[tuple[int, tuple[Floats, NDArray[np.int32]]]]:
    """Yield some rows of a census of a dask array of labels, each with the surface as `LabelSurfaces.of` returns it.

    `smoothing` and `spacing` are those of `label_surfaces`.  Labels, by row, of which the largest of several pieces is
    left are appended to `several`.

    Raises
    ------
    TooLargeError
        If a label spans more voxels than fit in memory.
    """
    shape = np.array(values.shape, dtype=np.int64)
    cells = (found.lower[some] + found.upper[some]) // (2 * _edges(found, some, shape))
    _, group = np.unique(cells, axis=0, return_inverse=True)
    later = np.zeros(len(found.label) + 1, dtype=np.bool_)
    later[some + 1] = True
    none = np.zeros(0, dtype=np.bool_)
    seams = Seams(shape + 1, np.zeros(3, dtype=np.int64), whole=none, own=none)
    how: dict[str, Any] = {"smoothing": smoothing, "spacing": spacing, "seams": seams}
    for number in range(int(group.max(initial=-1)) + 1):
        # what a group takes ends before the next one is read
        yield from _group(values, found, some[group.ravel() == number], later, several, how)


def _edges(found: Census, some: Integers, shape: Integers) -> Integers:
    """Return edges in voxels of cells, (3,), for which windows take the memory that they may, if grains lie evenly."""
    points = FACES * float((found.count[some] ** (2 / 3)).sum()) / float(shape.prod())
    window = (BUDGET / max(READ, SMOOTHED * points)) ** (1 / 3)
    edge = max(window - 2 * MARGIN - float((found.upper[some] - found.lower[some]).mean()), LEAST)
    return np.asarray(np.ceil(shape / np.ceil(shape / edge)), dtype=np.int64)


def _group(
    values: Any, found: Census, own: Integers, later: Booleans, several: list[int], how: dict[str, Any]
) -> Iterator[tuple[int, tuple[Floats, NDArray[np.int32]]]]:
    """Yield the surfaces of the rows of a group, as `block_surfaces`; in `later`, by row + 1, they become False."""
    shape, seams = np.array(values.shape, dtype=np.int64), how["seams"]
    lower = np.maximum(found.lower[own].min(axis=0) - MARGIN, 0)
    upper = np.minimum(found.upper[own].max(axis=0) + MARGIN, shape)
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
    inside = ((found.lower >= lower) & (found.upper <= upper)).all(axis=1)
    seams.corner, seams.own = lower, np.isin(rows, own + 1)
    seams.whole = np.concatenate([[False], inside])[rows]
    made = label_surfaces(part.pop(), len(rows) - 1, wraps=np.zeros(3, dtype=np.bool_), **how)
    later[own + 1] = False
    remaining = found.lower[np.flatnonzero(later) - 1, 0]
    seams.keep(made.net, made.moved, made.crossed, later[rows], int(remaining.min(initial=shape[0])))
    several += [int(rows[label]) - 1 for label in made.several if seams.own[label]]
    for label in np.flatnonzero(seams.own):
        yield int(rows[label]) - 1, made.of(int(label))
