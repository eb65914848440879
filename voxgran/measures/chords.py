"""Chords of the pore space: the parts of straight lines along an axis between grains or walls, in closed form."""

import math
from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.measures.crossings import Lines, grain_intervals, outside_intervals
from voxgran.measures.region import Regions, gravity_of
from voxgran.packing.model import Packing

#: length, in spacings of the lines, up to which a gap between solids is closed: that of round-off
CLOSED = 1e-9
#: parts of the rows of lines whose means are compared; every sixth multiple of the golden section is spread well, too
PARTS = 6


@dataclass(frozen=True, eq=False)
class Chords:
    """Chords of the pore space along an axis."""

    lengths: Floats  # (m,) of the chords between two grains or walls, in the unit of lengths
    mean: float  # twice the length of all lines in the pores over the number of their ends at grains and walls
    error: float  # standard error of the mean, from six interleaved lattices of lines


def chords_along(packing: Packing, axis: int, spacing: float) -> Chords:
    """Return the chords of a packing along an axis, on lines of a spacing.

    Walls end chords as grains do. The free surface of a bed ends none: lines that it cuts count with their length and
    their other end. Lines without an end count with their length; without any end the mean is infinite.

    Raises
    ------
    InputError
        If a grain is an open surface.
    """
    container, d = packing.container, packing.dimension
    around = bool(container.periodic[axis])
    lower, upper, walls = container.bounds[0].copy(), container.bounds[1].copy(), np.ones(2, dtype=np.bool_)
    gravity = gravity_of(packing)
    if gravity is not None and packing.count:
        down, sign = gravity
        side, bound = (1, upper) if sign < 0 else (0, lower)
        height = float(Regions(packing).limits[side, down])
        if lower[down] < height < upper[down]:
            bound[down] = height
            walls[side] = down != axis
            around = around and down != axis
    lines = Lines.through(axis, lower, upper, spacing, dimension=d)
    line, low, high = (
        np.concatenate(two)
        for two in zip(grain_intervals(packing, lines), outside_intervals(container, lines), strict=True)
    )
    order = np.argsort(line, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(line, minlength=lines.count))])
    lengths, ends = np.zeros(lines.count), np.zeros(lines.count, dtype=np.int64)
    found = np.empty(len(line) + lines.count)
    extent = lines.high - lines.low
    count = _gaps(low[order], high[order], bounds, extent, walls, around, CLOSED * spacing, lengths, ends, found)
    return Chords(found[:count], *_mean_of(lengths, ends, lines.counts))


def _mean_of(lengths: Floats, ends: Integers, counts: tuple[int, int]) -> tuple[float, float]:
    """Return the mean chord and its standard error, NaN where a part of the rows meets no end."""
    total = int(ends.sum())
    mean = 2.0 * float(lengths.sum()) / total if total else math.inf
    # rows are shared out in turn
    part = np.arange(len(ends)) // counts[1] % PARTS
    ends_of = np.bincount(part, ends, minlength=PARTS)
    if not total:
        return mean, 0.0
    if not ends_of.all():
        return mean, math.nan
    means = 2.0 * np.bincount(part, lengths, minlength=PARTS) / ends_of
    return mean, float(means.std(ddof=1)) / math.sqrt(PARTS)


@kernel
def _gaps(low, high, bounds, extent, walls, around, least, lengths, ends, found):  # type: ignore[no-untyped-def]
    """Write length and number of ends of the gaps of each line, and the chords; return the number of chords.

    Intervals `bounds[k]` to `bounds[k + 1]` are those of line k, which runs from 0 to `extent`. Gaps shorter than
    `least` count as closed. A periodic line joins its last gap to its first one.
    """
    count = 0
    for k in range(len(bounds) - 1):
        begin, end = bounds[k], bounds[k + 1]
        for a in range(begin + 1, end):
            start, stop, b = low[a], high[a], a - 1
            while b >= begin and low[b] > start:
                low[b + 1], high[b + 1] = low[b], high[b]
                b -= 1
            low[b + 1], high[b + 1] = start, stop
        reach, head, at_start = 0.0, 0.0, True
        for a in range(begin, end + 1):
            stop = extent if a == end else min(low[a], extent)
            gap, at_end = stop - reach, stop == extent
            if gap > least:
                lengths[k] += gap
                if around and at_start and not at_end:
                    head = gap
                elif around and at_start:
                    # no grain ends the line
                    pass
                else:
                    meets = (walls[0] or not at_start) + (walls[1] or not at_end)
                    chord = gap
                    if around and at_end:
                        chord, head = gap + head, 0.0
                    ends[k] += meets
                    if meets == 2:
                        found[count] = chord
                        count += 1
            if at_end:
                break
            if high[a] > reach:
                reach = high[a]
                at_start = False
        if head > 0.0:
            # a grain lies at the end of the line
            ends[k] += 2
            found[count] = head
            count += 1
    return count
