"""Deferred grains: in a class of several sizes a grain may fail while cells are still open for smaller ones.

Deferred grains are tried again after all others, the smallest first, with cells of their own: initially those of their
class, which contain all their positions, cut for their size. The next grain, which is not smaller, continues with the
remaining cells. Throws are uniform over these cells, so that a grain is placed uniformly over its positions. When no
cell is open, neither the grain nor a larger one fits: saturation is then proven for all sizes.
"""

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran.containers.kernel_container import KernelContainer
from voxgran.packing.rsa.available_boxes import NARROW
from voxgran.packing.rsa.available_cells import PATIENCE, Classes, Open
from voxgran.packing.rsa.overlaps import Grains


def left_out(grains: Grains, queue: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the grains of a queue that are not placed, each no smaller along any axis than those before it.

    The result is empty if there is no such order: a box may be longer and narrower than another.
    """
    waiting = np.sort(queue[grains.entered[queue] == 0])
    waiting = waiting[np.lexsort(grains.half[waiting].T)]
    ordered = bool((np.diff(grains.half[waiting], axis=0) >= 0).all())
    return waiting if ordered else waiting[:0]


def aim(grains: Grains, walls: KernelContainer, classes: Classes, late: NDArray[np.int32], turn: int) -> None:
    """Make the last class that of deferred grain `late[turn]`, in the lattice of the class of the first of them."""
    kind, half = classes.kind[late[0]], grains.half[late[turn]]
    for array in (classes.low, classes.span, classes.base, classes.parts):
        array[-1] = array[kind]
    classes.half[-1] = half
    if grains.boxes:
        way = np.where(walls.walled == 1, walls.lengths - 2 * half, classes.span[kind])
        classes.parts[-1] = np.where(way > 0, 2, 1)


def open_late(
    grains: Grains, walls: KernelContainer, classes: Classes, known: Open, late: NDArray[np.int32], turn: int
) -> Open:
    """Return the open cells with those of deferred grain `late[turn]`, which has the last class.

    Those of the first one are to be cut at once: after so many failed throws its class has too many.
    """
    last = len(classes.base) - 1
    kind = last if turn else int(classes.kind[late[0]])
    own = known.cell[known.bounds[kind] : known.bounds[kind + 1]]
    if grains.boxes:
        own = _between_walls(own, walls, grains.half[late[turn]])
    cell = np.concatenate([known.cell[: known.bounds[last]], own])
    bounds, misses, depth = known.bounds.copy(), known.misses.copy(), known.depth.copy()
    bounds[-1], misses[-1], depth[-1] = len(cell), misses[-1] if turn else PATIENCE * len(own), depth[kind]
    return Open(cell, bounds, misses, depth)


def _between_walls(cell: Floats, walls: KernelContainer, half: Floats) -> Floats:
    """Return the cells of boxes without what flat walls exclude; cells of spheres lose it when they are cut."""
    walled = walls.walled == 1
    low = np.where(walled, np.maximum(cell[:, :3], walls.lower + half), cell[:, :3])
    high = cell[:, :3] + cell[:, 3:]
    high = np.where(walled, np.minimum(high, walls.lower + walls.lengths - half), high)
    # a grain as long as the container has a single position along that axis
    least = np.where(walled & (walls.lengths - 2 * half > NARROW * walls.slack), NARROW, -NARROW) * walls.slack
    return np.hstack([low, np.maximum(high - low, 0.0)])[(high - low >= least).all(axis=1)]
