"""Grains that were put off: in a class of several sizes they found no place although cells were open for smaller ones.

When all others have had their turn they come again, the smallest first, with cells of their own: at first those of the
class, in which all their places lie, cut for their size. For the next one, which is no smaller, they go on from there.
Throws go into these cells, so that a grain enters at any of its places alike. When no cell is open the grain has no
place, nor has a larger one: then none of all grains that were left out fits, whatever the number of sizes.
"""

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran.containers.kernel_container import KernelContainer
from voxgran.packing.rsa.available_boxes import NARROW
from voxgran.packing.rsa.available_cells import PATIENCE, Classes, Open
from voxgran.packing.rsa.level_grid import Bed


def left_out(bed: Bed, queue: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the grains of a queue that are not in, each no smaller along any axis than those before it.

    None where they cannot be sorted so: a box may be longer and narrower than another.

    Parameters
    ----------
    bed : Bed
        The grains.
    queue : (m,) ndarray of int
        Grains that were to enter.
    """
    waiting = np.sort(queue[bed.entered[queue] == 0])
    waiting = waiting[np.lexsort(bed.half[waiting].T)]
    ordered = bool((np.diff(bed.half[waiting], axis=0) >= 0).all())
    return waiting if ordered else waiting[:0]


def aim(bed: Bed, room: KernelContainer, classes: Classes, late: NDArray[np.int32], turn: int) -> None:
    """Make the last class that of a grain which was put off, in the lattice of the class of the first of them.

    Parameters
    ----------
    bed, room
        Grains and container.
    classes : Classes
        The classes, of which the last is changed.
    late : (m,) ndarray of int
        Grains that were put off.
    turn : int
        Whose turn it is.
    """
    kind, half = classes.kind[late[0]], bed.half[late[turn]]
    for array in (classes.low, classes.span, classes.base, classes.parts):
        array[-1] = array[kind]
    classes.half[-1] = half
    if bed.boxes:
        way = np.where(room.walled == 1, room.lengths - 2 * half, classes.span[kind])
        classes.parts[-1] = np.where(way > 0, 2, 1)


def open_late(
    bed: Bed, room: KernelContainer, classes: Classes, known: Open, late: NDArray[np.int32], turn: int
) -> Open:
    """Return the open cells with those for a grain that was put off.

    For the first one they are to be cut at once: after so many throws in vain the cells of its class are too many.

    Parameters
    ----------
    bed, room
        Grains and container.
    classes : Classes
        The classes, of which the last is that of the grain.
    known : Open
        The open cells so far.
    late : (m,) ndarray of int
        Grains that were put off.
    turn : int
        Whose turn it is.
    """
    last = len(classes.base) - 1
    kind = last if turn else int(classes.kind[late[0]])
    own = known.cell[known.bounds[kind] : known.bounds[kind + 1]]
    if bed.boxes:
        own = _between_walls(own, room, bed.half[late[turn]])
    cell = np.concatenate([known.cell[: known.bounds[last]], own])
    bounds, misses, depth = known.bounds.copy(), known.misses.copy(), known.depth.copy()
    bounds[-1], misses[-1], depth[-1] = len(cell), misses[-1] if turn else PATIENCE * len(own), depth[kind]
    return Open(cell, bounds, misses, depth)


def _between_walls(cell: Floats, room: KernelContainer, half: Floats) -> Floats:
    """Return what flat walls leave of the cells of boxes; with those of spheres it is left out when they are cut."""
    walled = room.walled == 1
    low = np.where(walled, np.maximum(cell[:, :3], room.lower + half), cell[:, :3])
    high = cell[:, :3] + cell[:, 3:]
    high = np.where(walled, np.minimum(high, room.lower + room.lengths - half), high)
    # a grain as long as the container has a single place along that axis
    least = np.where(walled & (room.lengths - 2 * half > NARROW * room.slack), NARROW, -NARROW) * room.slack
    return np.hstack([low, np.maximum(high - low, 0.0)])[(high - low >= least).all(axis=1)]
