"""Surfaces of the labels of an image in blocks: group by group, in windows around the labels of each.

A window holds the labels that lie in one cell of a coarse lattice, and what is around them. Where a label touches one
of a later group, the points between them stay as the earlier group has left them, so that both have the same triangles
and each label the volume of its voxels. How far other points move differs from the surfaces of the whole image at once
only by what the pressures of labels beyond the window would change.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran.lattice.blocks import window
from voxgran.lattice.census import Census
from voxgran.lattice.label_seams import Seams
from voxgran.lattice.label_surfaces import label_surfaces

#: edge in voxels of the cells by which labels are grouped
GROUP = 256
#: voxels around the labels of a group
MARGIN = 16


def block_surfaces(
    values: Any, found: Census, some: Integers, *, smoothing: float, spacing: Floats, several: list[int]
) -> Iterator[tuple[int, list[tuple[Floats, NDArray[np.int32]]]]]:
    """Yield some rows of a census of a dask array of labels, each with the surface as `LabelSurfaces.of` returns it.

    `smoothing` and `spacing` are those of `label_surfaces`.  Labels, by row, of which the largest of several pieces is
    left are appended to `several`.

    Raises
    ------
    TooLargeError
        If a label spans more voxels than fit in memory.
    """
    shape = np.array(values.shape, dtype=np.int64)
    cells = (found.lower[some] + found.upper[some]) // (2 * GROUP)
    _, group = np.unique(cells, axis=0, return_inverse=True)
    later = np.zeros(len(found.label) + 1, dtype=np.bool_)
    later[some + 1] = True
    seams = Seams(shape + 1, np.zeros(3, dtype=np.int64), later)
    for number in range(int(group.max(initial=-1)) + 1):
        own = some[group.ravel() == number]
        lower = np.maximum(found.lower[own].min(axis=0) - MARGIN, 0)
        upper = np.minimum(found.upper[own].max(axis=0) + MARGIN, shape)
        name = f"the group of {len(own)} labels with label {found.label[own[0]]}"
        part = found.numbered(window(values, lower, upper, name))
        # rows + 1 of the labels in the window, in which they are numbered in the same order
        there = np.zeros(len(later), dtype=np.bool_)
        for plane in part:
            there[plane.ravel()] = True
        there[0] = True
        rows, numbers = np.flatnonzero(there), (np.cumsum(there) - 1).astype(np.int32)
        for plane in part:
            plane[...] = numbers[plane]
        inside = ((found.lower >= lower) & (found.upper <= upper)).all(axis=1)
        seams.corner, seams.whole = lower, np.concatenate([[False], inside])[rows]
        made = label_surfaces(
            part, len(rows) - 1, wraps=np.zeros(3, dtype=np.bool_), smoothing=smoothing, spacing=spacing, seams=seams
        )
        del part
        later[own + 1] = False
        done = np.isin(rows, own + 1)
        remaining = found.lower[np.flatnonzero(later) - 1, 0]
        first = int(remaining.min(initial=shape[0]))
        seams.keep(made.net, made.moved, made.crossed, done, later[rows], first)
        several += [int(rows[label]) - 1 for label in made.several if done[label]]
        for label in np.flatnonzero(done):
            yield int(rows[label]) - 1, made.of(int(label))
