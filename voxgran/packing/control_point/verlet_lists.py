"""Verlet lists: the grains near each grain, in place of a search of cells at each attempt.

A list has all grains that come near while neither has moved by a slip since the lists were made. When a grain has, all
lists are made again: steps are short, so that is seldom. There are none where grains enter, where periodic images of
one grain may both be near, and where lists would take much memory or more than a row.
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.packing.control_point.records import CloseLists, Walls

#: grains that are listed for a grain at the most, and grains for which there are lists
ROOM, MOST_GRAINS = 64, 2**15
#: longest way of a grain until lists are made again, in largest bounding radii
SLIP = 0.4


def make_lists(count: int, lengths: Floats, reach: float, radius: float) -> CloseLists:
    """Return lists of some grains that have to be made, or none.

    `lengths` are those of the periodic axes, `reach` is the largest distance of centers at which grains are compared,
    `radius` the largest bounding radius.
    """
    slip = SLIP * radius
    # no grain is then near in two images
    rows = count if count <= MOST_GRAINS and (lengths > 2.0 * reach + 4.0 * slip).all() else 0
    near = np.zeros((rows, ROOM), dtype=np.int32)
    return CloseLists(np.zeros((rows, 3)), near, np.zeros(rows, dtype=np.int64), np.ones(1, dtype=np.int64), slip)


@inlined_kernel
def strayed(anchor: Floats, walls: Walls, g: int, place: Floats) -> float:
    """Return the square of the way from an anchor to a place, the shortest one around the container."""
    square = 0.0
    for axis in range(3):
        way, length = place[axis] - anchor[g, axis], walls.upper[axis] - walls.lower[axis]
        if walls.periodic[axis] == 1:
            way -= length * np.floor(way / length + 0.5)
        square += way * way
    return square


@bare_kernel
def list_close(lists: CloseLists, walls: Walls, position: Floats, place: Floats, g: int, pending: Integers) -> int:
    """List the grains near grain g with their nearest image, and return how many there are."""
    for k in range(lists.many[g]):
        j = np.int64(lists.near[g, k])
        pending[k, 0] = j
        for axis in range(3):
            away = (place[axis] - position[j, axis]) / (walls.upper[axis] - walls.lower[axis])
            pending[k, 1 + axis] = np.int64(np.floor(away + 0.5)) if walls.periodic[axis] == 1 else 0
    return lists.many[g]
