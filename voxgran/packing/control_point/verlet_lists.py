"""Lists of the grains near each grain, in place of a look into cells at each attempt.

A list has all grains that come near while neither has moved by a slip since the lists were made. When a grain has, all
lists are made again: steps are short, so that is seldom. There are none where grains enter, where periodic images of
one grain may both be near, and where lists would take much memory or more than a row.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel

#: grains that are listed for a grain at the most, and grains for which there are lists
ROOM, MOST_GRAINS = 64, 2**15
#: longest way of a grain until lists are made again, in largest bounding radii
SLIP = 0.4


class CloseLists(NamedTuple):
    """Which grains are near each other.

    Attributes
    ----------
    anchor : (n, 3) ndarray of float
        Where the grains were when the lists were made.
    near : (n, ROOM) ndarray of int32
        Other grains near each one; without rows where there are no lists.
    many : (n,) ndarray of int
        How many there are.
    state : (1,) ndarray of int
        0: the lists hold; 1: they have to be made; 2: there was a row too short for them.
    slip : float
        How far a grain may move from its anchor.
    """

    anchor: Floats
    near: NDArray[np.int32]
    many: Integers
    state: Integers
    slip: float


def make_lists(count: int, lengths: Floats, reach: float, radius: float) -> CloseLists:
    """Return lists that have to be made, or none.

    Parameters
    ----------
    count : int
        Grains.
    lengths : (k,) ndarray of float
        Of the periodic axes.
    reach : float
        Largest distance of centers at which grains are compared.
    radius : float
        Largest bounding radius.
    """
    slip = SLIP * radius
    # no grain is then near in two images
    rows = count if count <= MOST_GRAINS and (lengths > 2.0 * reach + 4.0 * slip).all() else 0
    near = np.zeros((rows, ROOM), dtype=np.int32)
    return CloseLists(np.zeros((rows, 3)), near, np.zeros(rows, dtype=np.int64), np.ones(1, dtype=np.int64), slip)


@inlined_kernel
def strayed(anchor: Floats, g: int, place: Floats, lower: Floats, upper: Floats, periodic: Integers) -> float:
    """Return the square of the way from an anchor to a place, the shortest one around the container."""
    square = 0.0
    for axis in range(3):
        way, length = place[axis] - anchor[g, axis], upper[axis] - lower[axis]
        if periodic[axis] == 1:
            way -= length * np.floor(way / length + 0.5)
        square += way * way
    return square


@bare_kernel
def list_close(
    near: NDArray[np.int32],
    many: Integers,
    position: Floats,
    lower: Floats,
    upper: Floats,
    periodic: Integers,
    place: Floats,
    g: int,
    pending: Integers,
) -> int:
    """List the grains near grain g with their nearest image, and return how many there are."""
    lx, ly, lz = upper[0] - lower[0], upper[1] - lower[1], upper[2] - lower[2]
    for k in range(many[g]):
        j = np.int64(near[g, k])
        pending[k, 0], pending[k, 1], pending[k, 2], pending[k, 3] = j, 0, 0, 0
        if periodic[0] == 1:
            pending[k, 1] = np.int64(np.floor((place[0] - position[j, 0]) / lx + 0.5))
        if periodic[1] == 1:
            pending[k, 2] = np.int64(np.floor((place[1] - position[j, 1]) / ly + 0.5))
        if periodic[2] == 1:
            pending[k, 3] = np.int64(np.floor((place[2] - position[j, 2]) / lz + 0.5))
    return many[g]
