"""Angle of repose: the slope of the flank of a heap.

The plane across gravity is divided into square cells, in two dimensions intervals, of 1.25 median diameters. The
highest grain of each is a point of the surface, by its horizontal distance from the vertical through the centroid
of all grains and the level of its top. The mean of the tops in rings as wide as a cell tells where the surface crosses
20 % and 80 % of the height between its lowest and its highest ring; a straight line is fitted to all points between
both. Points are chosen by their distance and not by their level, which would make the slope smaller. In two dimensions
both flanks are fitted, and the angle is their mean.
"""

import math
from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import PackingWarning, warn
from voxgran.measures.model import Groups, Measure, dataset, length_unit, variable
from voxgran.packing.beds.expected import top_of
from voxgran.packing.model import Packing

#: edge of a cell, in median diameters
CELL = 1.25
#: shares of the height between which the line is fitted
LOW, HIGH = 0.2, 0.8
#: height below which a surface is flat and fitted as a whole, in median diameters, and points of a line, at least
FLAT, FEWEST = 2.0, 3


@dataclass(frozen=True)
class Repose:
    """Slope of the surface of a heap."""

    angle: float  # degrees; NaN without gravity or a flank
    error: float  # its standard error, as if the points of the surface were independent of each other
    height: float  # of the surface, from its lowest ring outside the highest one, in the unit of lengths


def repose(packing: Packing) -> Repose:
    """Return the angle of repose of a heap, with its standard error.

    A surface that is lower than two median diameters is flat, and fitted as a whole; its angle is near 0, and below 0
    where it is lower in the middle.

    Warns
    -----
    PackingWarning
        If fewer than three points of the surface lie on a flank; the angle is NaN then.
    """
    if packing.gravity is None or not packing.count:
        return Repose(math.nan, math.nan, math.nan)
    up, edge = -np.array(packing.gravity), CELL * float(np.median(packing.diameters))
    level = np.array([top_of(packing, grain, up) for grain in range(packing.count)])
    # two directions across gravity, in two dimensions one
    basis = linear.across(up[: packing.dimension])
    offset = packing.position - np.average(packing.position, axis=0, weights=packing.volumes)
    place = linear.matmul(offset[:, : packing.dimension], basis.T)
    order = np.argsort(-level, kind="stable")
    highest = order[np.unique(np.floor(place[order] / edge), axis=0, return_index=True)[1]]
    place, level = place[highest], level[highest]
    away = linear.norm(place, axis=1)
    sides = [place[:, 0] < 0.0, place[:, 0] >= 0.0] if packing.dimension == 2 else [away >= 0.0]
    slope, error, height = np.array([_line(away[side], level[side], edge) for side in sides]).T
    if not np.isfinite(slope).all():
        warn(
            f"the surface has no flank with at least {FEWEST} points, {CELL:g} median diameters apart, and no angle of "
            "repose: pour more grains, or into a wider container",
            PackingWarning,
        )
    angle = np.degrees(libm.arctan(slope))
    error = np.degrees(error / (1.0 + slope**2))
    return Repose(float(angle.mean()), float(linear.norm(error) / len(sides)), float(height.mean()))


def _line(away: Floats, level: Floats, edge: float) -> tuple[float, float, float]:
    """Return how much the level of points falls over their distance from the axis, its standard error, and the height
    of the surface; NaN with too few points.
    """
    ring = np.unique(np.floor(away / edge), return_inverse=True)[1]
    many = np.bincount(ring)
    distance, mean = np.bincount(ring, away) / many, np.bincount(ring, level) / many
    top = int(np.argmax(mean)) if len(mean) else 0
    distance, mean = distance[top:], mean[top:]
    height = float(np.ptp(mean)) if len(mean) else math.nan
    if height >= FLAT * edge / CELL:
        ends = [_crossing(distance, mean, float(mean.min()) + share * height) for share in (HIGH, LOW)]
        kept = (away >= ends[0]) & (away <= ends[1])
        away, level = away[kept], level[kept]
    if len(away) < FEWEST:
        return math.nan, math.nan, height
    offset = away - away.mean()
    spread = float(linear.matmul(offset, offset))
    slope = -float(linear.matmul(offset, level)) / spread
    rest = level - level.mean() + slope * offset
    return slope, math.sqrt(float(linear.matmul(rest, rest)) / (len(away) - 2) / spread), height


def _crossing(distance: Floats, mean: Floats, level: float) -> float:
    """Return the distance at which a profile first falls to a level that is below its beginning."""
    k = int(np.argmax(mean <= level))
    share = (mean[k - 1] - level) / (mean[k - 1] - mean[k])
    return float(distance[k - 1] + share * (distance[k] - distance[k - 1]))


def _compute(packing: Packing) -> Groups:
    """Return the angle of repose, its standard error, and the height of the heap."""
    found = repose(packing)
    return {
        "/": dataset(
            {
                "angle_of_repose": variable((), found.angle, "degree", "mean slope of the flanks of a heap"),
                "angle_of_repose_error": variable((), found.error, "degree", "standard error of the angle of repose"),
                "heap_height": variable(
                    (), found.height, length_unit(packing), "height of the surface above the foot of the heap"
                ),
            }
        )
    }


def _applies(packing: Packing) -> bool:
    """Return whether there is a surface."""
    return packing.gravity is not None and packing.count > 0


registration = Measure(
    summary="angle of repose: the slope of the flank of a heap, with its standard error",
    groups=("/",),
    compute=_compute,
    applies=_applies,
    usual=False,
)
