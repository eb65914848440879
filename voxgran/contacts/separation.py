"""Distance of two convex solids, or how far they are to be moved apart, to the last digits.

Near contact the simplices of :mod:`voxgran.geometry.gjk` degenerate and digits are lost. The second solid is then
displaced along the normal n by a step t, which adds t m.n to the separation along any normal m. The distance minus t
equals the separation up to the square of the error of n, also for slightly overlapping solids, and the nearest points
give a better normal (a proximal point step, Rockafellar 1976, doi:10.1137/0314056).

The solids are the rows of :mod:`voxgran.geometry.support`.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.geometry.gjk import Accuracy, Simplex, search_distance
from voxgran.geometry.support import erosion_limit, support
from voxgran.geometry.vectors import along, dot, row_of, sub

#: accuracy of the distance
EXACT = Accuracy(0.0, 1e-15, 500, 20)
#: squared distance, relative to that of the support points, up to which solids intersect
ZERO = 1e-30
#: distance, in limits of erosion, below which the separation is computed by proximal steps
NEAR = 0.05
MOST_MOVES = 25
#: change of the normal at which the proximal steps have converged
STEADY = 1e-6


@bare_kernel
def _core_distance(one, other, erosion, offset, simplex):  # type: ignore[no-untyped-def]
    """Return the distance of `one`, eroded, from `other`, whose center lies at `offset`; 0 if the solids intersect."""
    start = offset if offset != (0.0, 0.0, 0.0) else (-1.0, 0.0, 0.0)
    distance = search_distance(
        _support_eroded, (one, erosion), (other, 0.0), offset, start, 1e150, EXACT, True, simplex, 0
    )
    size = 0.0
    for k in range(4):
        corner = row_of(simplex.corner, k)
        size = max(size, dot(corner, corner))
    # what rounding leaves of the distance of solids that intersect gives no direction
    return distance if distance > 0.0 and distance * distance > ZERO * size else 0.0


@bare_kernel
def _support_eroded(solid, at, x, y, z):  # type: ignore[no-untyped-def]
    """Return the support point of a row and its erosion, as the search asks for it."""
    px, py, pz = support(solid[0], solid[1], x, y, z)
    return px, py, pz, at


@kernel
def separation(one: Floats, other: Floats, erosion: float, offset: Floats, found: Floats) -> float:
    """Return the distance of `one`, eroded, from `other`, whose center lies at `offset`.

    The distance of slightly overlapping solids is minus the translation that separates them, that of deeper overlaps
    0. The nearest points and the normal from one to the other are written to the nine numbers of `found`; the normal
    is 0 if it is undefined. Margins are ignored.
    """
    simplex = Simplex(np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4), np.zeros(6), np.zeros((4, 2), dtype=np.int64))
    place = (offset[0], offset[1], offset[2])
    distance = start = _core_distance(one, other, erosion, place, simplex)
    _write_points(simplex.near, 0.0, (0.0, 0.0, 0.0), distance, found)
    limit, other_limit = erosion_limit(one), erosion_limit(other)
    scale = limit if other_limit == 0.0 else (other_limit if limit == 0.0 else min(limit, other_limit))
    if scale == 0.0 or distance > NEAR * scale:
        return distance
    sign = 1.0
    if distance <= 1e-3 * scale:
        # the nearest points of more eroded solids give the direction
        if limit > 0.0:
            start = _core_distance(one, other, 0.5 * (erosion + limit), place, simplex)
        else:
            sign = -1.0
            start = _core_distance(other, one, 0.5 * other_limit, (-place[0], -place[1], -place[2]), simplex)
    if start == 0.0:
        return distance
    gap = _part(one, other, erosion, place, NEAR * scale, _unit(simplex.near, sign * start), simplex, found)
    if not math.isnan(gap):
        return gap
    # corners and edges: the normal does not converge, but the simplices are exact
    _core_distance(one, other, erosion, place, simplex)
    _write_points(simplex.near, 0.0, (0.0, 0.0, 0.0), distance if distance > 1e-10 * scale else 0.0, found)
    return distance


@bare_kernel
def _part(one, other, erosion, offset, step, normal, simplex, found):  # type: ignore[no-untyped-def]
    """Improve the normal by proximal steps; write its points and return the separation, NaN if not converged."""
    deep, gap, steady = max(-_gap_along(one, other, erosion, offset, normal), 0.0), 0.0, False
    for _ in range(MOST_MOVES):
        # the last step is short: it shows whether the normal has really converged
        way = step * (1e-3 if steady else 1.0) + 2.0 * deep
        length = _core_distance(one, other, erosion, along(offset, way, normal), simplex)
        if length <= 0.0:
            break
        better = _unit(simplex.near, length)
        step_of_normal = sub(better, normal)
        change = dot(step_of_normal, step_of_normal)
        if steady:
            return gap if change <= (4.0 * STEADY) ** 2 else np.nan
        gap, deep = length - way, max(way - length, 0.0)
        _write_points(simplex.near, way, normal, length, found)
        # the error of the separation is the square of that of the normal
        normal, steady = better, change <= STEADY * STEADY
    return np.nan


@bare_kernel
def _gap_along(one, other, erosion, offset, normal):  # type: ignore[no-untyped-def]
    """Return the gap of two solids along a unit normal."""
    x, y, z = normal
    ax, ay, az = support(one, erosion, x, y, z)
    bx, by, bz = support(other, 0.0, -x, -y, -z)
    return (bx + offset[0] - ax) * x + (by + offset[1] - ay) * y + (bz + offset[2] - az) * z


@bare_kernel
def _unit(near, length):  # type: ignore[no-untyped-def]
    """Return the vector of a distance, divided by a length."""
    return near[0] / length, near[1] / length, near[2] / length


@bare_kernel
def _write_points(near, way, normal, length, found):  # type: ignore[no-untyped-def]
    """Write the nearest points, the second one moved back along a normal, and their direction; 0 without a length."""
    for i in range(3):
        found[i], found[3 + i] = near[3 + i], near[3 + i] + near[i] - way * normal[i]
        found[6 + i] = near[i] / length if length > 0.0 else 0.0
