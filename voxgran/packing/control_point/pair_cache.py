"""Cache of compared pairs of grains: tables in which later pairs replace earlier ones."""

from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel

#: columns of `PairCache.pairs`: number of the pair (-1: none), the control points that refused it last (-1: none), and
#: filled rows of `lists`; with signed distances one point, and whether it belongs to the second grain
PAIR, POINT, OTHER_POINT, COUNT = range(4)
#: columns of `PairCache.poses`: rotation matrix row by row, shift, slack, and a direction
TURN, SHIFT, SLACK, WAY = 0, 9, 12, 13


class PairCache(NamedTuple):
    """What is known of pairs of grains that were compared.

    In the relative pose of `poses`, all control points were farther apart than they must be by the slack, those in
    `lists` excepted; these are empty with signed distances. The direction is that towards the grain of lower number
    along which the two were farthest apart last (zero: none).
    """

    pairs: Integers
    poses: Floats
    lists: Integers


@bare_kernel
def row_of_pair(room: int, pair: int) -> int:
    """Return the entry of a pair in a table whose length is a power of two."""
    return (pair * 2654435761 >> 7) & (room - 1)


@bare_kernel
def claim_row(pairs: Integers, poses: Floats, pair: int) -> int:
    """Return the entry of a pair, cleared where another pair had it."""
    row = row_of_pair(len(pairs), pair)
    if pairs[row, PAIR] != pair:
        pairs[row, PAIR], pairs[row, POINT], pairs[row, COUNT], poses[row, SLACK] = pair, -1, 0, -1.0
        poses[row, WAY], poses[row, WAY + 1], poses[row, WAY + 2] = 0.0, 0.0, 0.0
    return row


@bare_kernel
def keep_pose(poses: Floats, row: int, relative: Floats, shift: Floats, slack: float) -> None:
    """Store a relative pose that was not refused, and its slack."""
    poses[row, SLACK] = slack
    for m in range(3):
        poses[row, SHIFT + m] = shift[m]
        for n in range(3):
            poses[row, TURN + 3 * m + n] = relative[m, n]


@inlined_kernel
def moved_since(poses: Floats, row: int, relative: Floats, shift: Floats, radius: float) -> float:
    """Return an upper bound of the displacement of points within a radius since a relative pose was stored."""
    way, spin = 0.0, 0.0
    for m in range(3):
        way += (shift[m] - poses[row, SHIFT + m]) ** 2
        for n in range(3):
            spin += (relative[m, n] - poses[row, TURN + 3 * m + n]) ** 2
    # two rotations differ by a matrix with two equal singular values and a zero
    return float(np.sqrt(way) + np.sqrt(0.5 * spin) * radius)
