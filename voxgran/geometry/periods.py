"""Vectors by which a periodic container repeats: wrapping, distances between opposite faces, images.

They are the rows of a lower triangular (3, 3) matrix ``periods``, one for each axis, (lx, 0, 0), (xy, ly, 0) and
(xz, yz, lz), with zeros for axes that do not repeat. The coordinates along the edges of the cell, which wrap one by
one, follow from those along the axes by three slopes, which are 0 in an upright cell.
"""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers

#: no axis repeats
OPEN = np.zeros((3, 3))


def slopes_of(periods: Floats) -> Floats:
    """Return the slopes (3,) by which coordinates along the edges follow: x + s0 y + s1 z, y + s2 z, and z."""
    xy, xz, yz = periods[1, 0], periods[2, 0], periods[2, 1]
    _, ly, lz = np.where(periods.diagonal() > 0.0, periods.diagonal(), 1.0)
    return np.array([-xy / ly, xy / ly * yz / lz - xz / lz, -yz / lz]) + 0.0


def along_edges(points: Floats, periods: Floats) -> Floats:
    """Return the coordinates (n, 3) along the edges of the cell, each within the length of its axis."""
    slopes = slopes_of(periods)
    if not slopes.any():
        return points
    x, y, z = points.T
    return np.column_stack([x + slopes[0] * y + slopes[1] * z, y + slopes[2] * z, z])


def turns_of(points: Floats, lower: Floats, periods: Floats) -> Integers:
    """Return by how many periods (n, 3) points lie beyond the cell with a lower corner."""
    length = periods.diagonal()
    share = along_edges(points - lower, periods) / np.where(length > 0.0, length, np.inf)
    return np.floor(share).astype(np.int64)


def wrapped(points: Floats, lower: Floats, periods: Floats) -> Floats:
    """Return points (n, 3) brought into the cell with a lower corner."""
    for _ in range(2):
        # what lies below the cell by rounding is moved to its upper end, and from there to the lower one
        points = points - linear.matmul(turns_of(points, lower, periods), periods)
    return points


def face_distances(periods: Floats) -> Floats:
    """Return the distances (3,) between opposite faces of the cell; infinite along axes that do not repeat."""
    s, length = slopes_of(periods), periods.diagonal()
    return np.where(length > 0.0, length, np.inf) / np.sqrt([1 + s[0] ** 2 + s[1] ** 2, 1 + s[2] ** 2, 1.0])


def images_within(reach: "float | Floats", periods: Floats) -> Floats:
    """Return how many periodic images of a point, about, lie within a reach (one or several); 1 if none but its own."""
    return np.asarray(np.prod(2.0 * np.floor(np.divide.outer(reach, face_distances(periods))) + 1.0, axis=-1))


def nearest_turns(away: Floats, periods: Floats) -> Integers:
    """Return the numbers of periods (n, 3) whose sum is nearest to vectors (n, 3)."""
    turns = _step_by_step(away, periods, np.rint)
    if not slopes_of(periods).any():
        return turns
    rows = reduced_periods(periods)
    numbers = np.rint(linear.matmul(rows, linear.pseudoinverse(periods))).astype(np.int64)
    steps = linear.matmul(np.indices((3,) * len(rows)).reshape(len(rows), -1).T - 1, numbers)
    moved = np.arange(len(away))
    while len(moved):
        # what none of these steps brings nearer is nearest: they hold all vectors that bound a cell of Voronoi
        left = away[moved] - linear.matmul(turns[moved], periods)
        square = np.square(left[:, None] - linear.matmul(steps, periods)).sum(axis=2)
        best = square.argmin(axis=1)
        nearer = square[np.arange(len(moved)), best] < np.square(left).sum(axis=1)
        moved, best = moved[nearer], best[nearer]
        turns[moved] += steps[best]
    return turns


def upright_turns(points: Floats, lower: Floats, periods: Floats) -> Integers:
    """Return by how many periods (n, 3) points lie beyond the upright box with a lower corner, as large as the cell."""
    return _step_by_step(points - lower, periods, np.floor)


def _step_by_step(left: Floats, periods: Floats, rounded: np.ufunc) -> Integers:
    """Return numbers of periods (n, 3) that vectors (n, 3) are rounded to, along z first, which changes x and y."""
    turns = np.zeros(left.shape, dtype=np.int64)
    for axis in (2, 1, 0):
        turns[:, axis] = rounded(left[:, axis] / (periods[axis, axis] or np.inf))
        left = left - turns[:, axis, None] * periods[axis]
    return turns


def shortest_period(periods: Floats) -> float:
    """Return the length of the shortest sum of periods, which is that of the shortest one in an upright cell."""
    return float(linear.norm(reduced_periods(periods), axis=1).min(initial=np.inf))


def reduced_periods(periods: Floats) -> Floats:
    """Return the shortest vectors (k, 3) of which all sums of periods are sums: a Minkowski-reduced basis.

    References
    ----------
    Semaev 2001, doi:10.1007/3-540-44670-2_13.
    """
    rows = periods[periods.diagonal() > 0.0]
    while slopes_of(periods).any():
        rows, longest = rows[np.argsort(linear.norm(rows, axis=1), kind="stable")], linear.norm(rows, axis=1).max()
        for k in range(1, len(rows)):
            about = linear.matmul(linear.pseudoinverse(rows[:k].T), rows[k])
            steps = np.rint(about) + np.indices((3,) * k).reshape(k, -1).T - 1
            others = rows[k] - linear.matmul(steps, rows[:k])
            best = others[linear.norm(others, axis=1).argmin()]
            if linear.norm(best) < linear.norm(rows[k]) - 1e-12 * longest:
                rows[k] = best
                break
        else:
            break
    return np.asarray(rows)
