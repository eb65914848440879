"""Available space of boxes along the axes, exactly.

The region that a box excludes for the center of another one is a box. The available space in a cell is therefore the
cell without some boxes, which again is a union of boxes: nothing is approximated, however narrow the gap of two faces.
"""

from collections.abc import Iterator

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran._base.stopping import stop_if_asked
from voxgran.packing.rsa.overlaps import Bed, gather

#: largest number of grains tested near a cell; further ones only keep it open longer
NEAR = 256
#: largest number of boxes into which a cell is divided at a time; beyond it some boxes stay too large for a while
PIECES = 4096
#: space narrower than this, in rounding errors of a position, is ignored
NARROW = 16.0
#: cells that are processed between two tests whether to stop
AT_ONCE = 2**15


def open_boxes(bed: Bed, before: Floats, half: Floats) -> Floats:
    """Return the available parts of boxes for the centers of grains of half extents `half`, (3,).

    Boxes before, (k, 6), and after, (m, 6), are lower corners and edges.

    Raises
    ------
    Stopped
        If the run was asked to stop.
    """
    near, pieces = np.zeros((NEAR, 6)), np.zeros((PIECES, 6))
    after = [np.zeros((0, 6))]
    for part in slices(len(before)):
        few, room_for, many = before[part], 0, 2 * len(before[part]) + PIECES
        while many > room_for:
            room_for, left = many, np.zeros((many, 6))
            many = int(_cut_away(bed, few, half, NARROW * bed.walls.slack, near, pieces, left))
        after.append(left[:many].copy())
    return np.concatenate(after)


def slices(many: int) -> Iterator[slice]:
    """Yield slices of `many` cells that are processed between two tests whether to stop.

    Raises
    ------
    Stopped
        If the run was asked to stop.
    """
    for first in range(0, many, AT_ONCE):
        stop_if_asked()
        yield slice(first, first + AT_ONCE)


@bare_kernel
def _cut_away(bed, before, half, least, near, pieces, after):  # type: ignore[no-untyped-def]
    """Write the available parts of each box, as many as `after` holds, and return their number."""
    total = 0
    for m in range(len(before)):
        ex, ey, ez = 0.5 * before[m, 3], 0.5 * before[m, 4], 0.5 * before[m, 5]
        x, y, z = before[m, 0] + ex, before[m, 1] + ey, before[m, 2] + ez
        many = gather(bed, (x, y, z), (half[0], half[1], half[2]), (ex, ey, ez), near)
        if many < 0:
            continue
        pieces[0, 0], pieces[0, 1], pieces[0, 2] = -ex, -ey, -ez
        pieces[0, 3], pieces[0, 4], pieces[0, 5] = ex, ey, ez
        count = 1
        for k in range(many):
            count = _cut_one(pieces, count, near, k, least)
        for j in range(count):
            if total < len(after):
                after[total, 0], after[total, 1], after[total, 2] = x + pieces[j, 0], y + pieces[j, 1], z + pieces[j, 2]
                for axis in range(3):
                    after[total, 3 + axis] = pieces[j, 3 + axis] - pieces[j, axis]
            total += 1
    return total


@bare_kernel
def _cut_one(pieces, count, near, k, least):  # type: ignore[no-untyped-def]
    """Remove what a grain excludes from the pieces of a cell (low and high corners); return their number."""
    j, old, new = 0, count, count
    while j < old:
        if not _meets(pieces, j, near, k) or new + 6 > len(pieces):
            j += 1
            continue
        for axis in range(3):
            low, high = near[k, axis] - near[k, 3 + axis], near[k, axis] + near[k, 3 + axis]
            if low - pieces[j, axis] > least:
                _copy(pieces, j, new)
                pieces[new, 3 + axis] = low
                new += 1
            if pieces[j, 3 + axis] - high > least:
                _copy(pieces, j, new)
                pieces[new, axis] = high
                new += 1
            pieces[j, axis], pieces[j, 3 + axis] = max(low, pieces[j, axis]), min(high, pieces[j, 3 + axis])
        # the rest is excluded: the last piece not yet processed replaces it, and the last new piece replaces that one
        old, new = old - 1, new - 1
        _copy(pieces, old, j)
        _copy(pieces, new, old)
    return new


@bare_kernel
def _meets(pieces, j, near, k):  # type: ignore[no-untyped-def]
    """Return whether a grain excludes a part of a piece."""
    for axis in range(3):
        low, high = near[k, axis] - near[k, 3 + axis], near[k, axis] + near[k, 3 + axis]
        if high <= pieces[j, axis] or low >= pieces[j, 3 + axis]:
            return False
    return True


@bare_kernel
def _copy(pieces, source, target):  # type: ignore[no-untyped-def]
    """Copy a piece to another row."""
    for axis in range(6):
        pieces[target, axis] = pieces[source, axis]
