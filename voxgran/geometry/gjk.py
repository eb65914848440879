"""Distance of two convex bodies from their support functions, by the algorithm of Gilbert, Johnson and Keerthi.

The distance of two bodies is that of the origin from their Minkowski difference, which is approximated by simplices of
support points (Gilbert, Johnson & Keerthi 1988, doi:10.1109/56.2083). The search ends when an upper and a lower bound
of the distance agree or when rounding stops the progress.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import Kernel, bare_kernel, inlined_kernel
from voxgran.geometry.vectors import Vector, cross, dot, row_of, sub

#: rounding error of a determinant, relative to the product of the lengths
NOISE = 1e-14


class Accuracy(NamedTuple):
    """When a search ends.

    close: difference of the bounds, and relative: the same relative to the distance.  steps: largest number of steps.
    restarts: how often the search starts again where rounding stops it.
    """

    close: float
    relative: float
    steps: int
    restarts: int


class Simplex(NamedTuple):
    """Arrays that a search works with.

    corner: (4, 3) points of the Minkowski difference.  mine: (4, 3) points of the first body.  weight: (4,) of the
    corners, -1 of those that are left out.  near: (6,) vector from the nearest point of the first body to that of the
    second, and the nearest point of the first body.  which: (4, 2) numbers of the corners of both bodies that the
    corners come from, -1 behind the last.
    """

    corner: Floats
    mine: Floats
    weight: Floats
    near: Floats
    which: Integers


def new_simplex() -> Simplex:
    """Return the arrays of a search."""
    return Simplex(np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4), np.zeros(6), np.zeros((4, 2), dtype=np.int64))


@inlined_kernel
def search_distance(
    support: Kernel, one: Any, two: Any, offset: Vector, start: Vector, limit: float,
    accuracy: Accuracy, closely: bool, simplex: Simplex, known: int,
) -> float:  # fmt: skip
    """Return the distance of two convex bodies, of which the second lies at an offset; the search begins along `start`.

    The vector of the distance and the nearest point on the first body are written to `near`. A lower bound above a
    limit is returned as soon as it is known, with its direction; -1 if the bodies intersect.

    support: function of a body, the number of a corner of it and a direction; it returns the point of the
    body that is farthest along the direction, and the number of a corner near it.
    closely: whether rounding may hide the nearest point of a simplex, as it does of long bodies with round sides.
    known: number of corners of the simplex, 0 to 3, with which the search begins.
    """
    corner, mine, near, which = simplex.corner, simplex.mine, simplex.near, simplex.which
    at, other, count, best, now, restarts = 0, 0, known, 1e300, 1e300, 0
    vx, vy, vz = start
    which[count, 0] = -1
    for step in range(accuracy.steps):
        stalled, more = False, step > 0 or known == 0
        if more:
            ax, ay, az, at = support(one, at, vx, vy, vz)
            bx, by, bz, other = support(two, other, -vx, -vy, -vz)
            wx, wy, wz = bx + offset[0] - ax, by + offset[1] - ay, bz + offset[2] - az
            along, square = vx * wx + vy * wy + vz * wz, vx * vx + vy * vy + vz * vz
            if along > 0.0 and along * along > limit * limit * square:
                near[0], near[1], near[2] = vx, vy, vz
                return along / math.sqrt(square)
            if now < 1e300 and now - along <= accuracy.close * math.sqrt(now) + accuracy.relative * now:
                break
            if not closely:
                for q in range(count):
                    stalled |= corner[q, 0] == wx and corner[q, 1] == wy and corner[q, 2] == wz
            if not stalled:
                corner[count, 0], corner[count, 1], corner[count, 2] = wx, wy, wz
                mine[count, 0], mine[count, 1], mine[count, 2] = ax, ay, az
                which[count, 0], which[count, 1] = at, other
                count += 1
        if not stalled:
            if not _weigh(corner, simplex.weight, count, closely):
                return -1.0
            px, py, pz, square = _nearest(corner, simplex.weight, 0)
            count = _compress(simplex, count)
            if square < best:
                near[0], near[1], near[2] = px, py, pz
                for c in range(3):
                    near[3 + c] = 0.0
                    for t in range(count):
                        near[3 + c] += simplex.weight[t] * mine[t, c]
            stalled = square >= now
            if not stalled:
                now, vx, vy, vz = square, px, py, pz
        if stalled:
            # the corners are so near each other that rounding decides: others are taken
            if restarts == accuracy.restarts:
                break
            restarts += 1
            count, now = 0, 1e300
            if not closely:
                vx, vy, vz = near[0], near[1], near[2]
        best = min(best, now)
    return math.sqrt(best)


@inlined_kernel
def _nearest(corner, weight, first):  # type: ignore[no-untyped-def]
    """Return the point that the weights define and its squared distance from the origin; the sum begins at `first`."""
    x, y, z = 0.0, 0.0, 0.0
    for t in range(first, first + 4):
        k = t & 3
        if weight[k] >= 0.0:
            x, y, z = x + weight[k] * corner[k, 0], y + weight[k] * corner[k, 1], z + weight[k] * corner[k, 2]
    return x, y, z, x * x + y * y + z * z


@bare_kernel
def _compress(simplex, count):  # type: ignore[no-untyped-def]
    """Drop the corners that are left out; return the number of the others, which keep their order."""
    kept = 0
    for k in range(count):
        if simplex.weight[k] >= 0.0:
            simplex.weight[kept] = simplex.weight[k]
            simplex.which[kept, 0], simplex.which[kept, 1] = simplex.which[k, 0], simplex.which[k, 1]
            for c in range(3):
                simplex.corner[kept, c], simplex.mine[kept, c] = simplex.corner[k, c], simplex.mine[k, c]
            kept += 1
    if kept < 4:
        simplex.which[kept, 0] = -1
    return kept


@bare_kernel
def _weigh(corner, weight, count, closely):  # type: ignore[no-untyped-def]
    """Write the weights of the point of a simplex nearest to the origin; return False if it contains the origin."""
    if count == 1:
        _write(weight, 0, 0, 0, 1.0, 1.0, 1.0)
    elif count == 2:
        _weigh_edge(corner, 0, 1, weight)
    elif count == 3:
        _weigh_face(corner, 0, 1, 2, weight, closely)
    else:
        return _weigh_tetrahedron(corner, weight, closely)
    return True


@inlined_kernel
def _write(weight, i, j, k, a, b, c):  # type: ignore[no-untyped-def]
    """Write the weights a, b, c of corners i, j, k, and leave out the others."""
    weight[0] = weight[1] = weight[2] = weight[3] = -1.0
    weight[k], weight[j], weight[i] = c, b, a


@bare_kernel
def _weigh_edge(corner, i, j, weight):  # type: ignore[no-untyped-def]
    """Write the weights of the point of an edge nearest to the origin."""
    a = row_of(corner, i)
    u = sub(row_of(corner, j), a)
    square, t = dot(u, u), -dot(u, a)
    if t <= 0.0 or square == 0.0:
        _write(weight, i, i, i, 1.0, 1.0, 1.0)
    elif t >= square:
        _write(weight, j, j, j, 1.0, 1.0, 1.0)
    else:
        _write(weight, i, j, j, 1.0 - t / square, t / square, t / square)


@bare_kernel
def _weigh_face(corner, i, j, k, weight, closely):  # type: ignore[no-untyped-def]
    """Write the weights of the point of a triangle nearest to the origin.

    The regions are those of Ericson 2005 (Real-Time Collision Detection, section 5.1.5).
    """
    a, b, c = row_of(corner, i), row_of(corner, j), row_of(corner, k)
    u, v = sub(b, a), sub(c, a)
    if closely:
        _weigh_closely(corner, i, j, k, weight)
        return
    ua, va, ub, vb, uc, vc = -dot(u, a), -dot(v, a), -dot(u, b), -dot(v, b), -dot(u, c), -dot(v, c)
    share_a, share_b, share_c = ub * vc - uc * vb, uc * va - ua * vc, ua * vb - ub * va
    total = share_a + share_b + share_c
    if ua <= 0.0 and va <= 0.0:
        _write(weight, i, i, i, 1.0, 1.0, 1.0)
    elif ub >= 0.0 and vb <= ub:
        _write(weight, j, j, j, 1.0, 1.0, 1.0)
    elif share_c <= 0.0 and ua >= 0.0 and ub <= 0.0:
        _weigh_edge(corner, i, j, weight)
    elif vc >= 0.0 and uc <= vc:
        _write(weight, k, k, k, 1.0, 1.0, 1.0)
    elif share_b <= 0.0 and va >= 0.0 and vc <= 0.0:
        _weigh_edge(corner, i, k, weight)
    elif share_a <= 0.0 and vb - ub >= 0.0 and uc - vc >= 0.0:
        _weigh_edge(corner, j, k, weight)
    elif total == 0.0:
        _weigh_edge(corner, i, j, weight)
    else:
        _write(weight, i, j, k, share_a / total, share_b / total, share_c / total)


@bare_kernel
def _weigh_closely(corner, i, j, k, weight):  # type: ignore[no-untyped-def]
    """Write the weights of the nearest of the points of a triangle and its edges, of which rounding may hide one."""
    a = row_of(corner, i)
    u, v = sub(row_of(corner, j), a), sub(row_of(corner, k), a)
    normal = cross(u, v)
    square, best = dot(normal, normal), 1e300
    kept = (0.0, 0.0, 0.0, 0.0)
    if square > 0.0:
        # cross products keep the digits that differences of products lose
        share_b, share_c = -dot(normal, cross(a, v)) / square, -dot(normal, cross(u, a)) / square
        if share_b >= 0.0 and share_c >= 0.0 and share_b + share_c <= 1.0:
            _write(weight, i, j, k, 1.0 - share_b - share_c, share_b, share_c)
            best = _nearest(corner, weight, i)[3]
            kept = (weight[0], weight[1], weight[2], weight[3])
    for p, q in ((i, j), (j, k), (k, i)):
        _weigh_edge(corner, p, q, weight)
        square = _nearest(corner, weight, i)[3]
        if square < best:
            best, kept = square, (weight[0], weight[1], weight[2], weight[3])
    weight[0], weight[1], weight[2], weight[3] = kept


@bare_kernel
def _weigh_tetrahedron(corner, weight, closely):  # type: ignore[no-untyped-def]
    """Write the weights of the nearest point of the faces beyond which the origin lies; return False if none is."""
    best, kept = 1e300, (-1.0, -1.0, -1.0, -1.0)
    for d in range(4):
        i, j, k = (d + 1) % 4, (d + 2) % 4, (d + 3) % 4
        a = row_of(corner, i)
        u, v, w = sub(row_of(corner, j), a), sub(row_of(corner, k), a), sub(row_of(corner, d), a)
        normal = cross(u, v)
        inner, origin = dot(normal, w), -dot(normal, a)
        if inner * origin > 0.0:
            # a face whose side is uncertain due to rounding is examined, too
            error = NOISE * math.sqrt(dot(u, u) * dot(v, v)) if closely else 0.0
            if abs(inner) > error * math.sqrt(dot(w, w)) and abs(origin) > error * math.sqrt(dot(a, a)):
                continue
        _weigh_face(corner, i, j, k, weight, closely)
        square = _nearest(corner, weight, i)[3]
        if square < best:
            best, kept = square, (weight[0], weight[1], weight[2], weight[3])
    weight[0], weight[1], weight[2], weight[3] = kept
    return best < 1e300
