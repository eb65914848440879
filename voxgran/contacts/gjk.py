"""Distance of two convex solids from their support functions.

Gilbert, Johnson & Keerthi 1988 (doi:10.1109/56.2083): the distance of two solids is that of the origin from their
Minkowski difference, which is approximated by simplices of support points. The search ends when an upper and a lower
bound of the distance agree or when rounding stops the progress.

Near contact the simplices degenerate and digits are lost. The second solid is then displaced along the normal n by a
step t, which adds t m.n to the separation along any normal m. The distance minus t equals the separation up to the
square of the error of n, also for slightly overlapping solids, and the nearest points give a better normal (a proximal
point step, Rockafellar 1976, doi:10.1137/0314056).

A solid is a row of numbers: its kind, three dimensions and a rotation matrix; a triangle is its nine coordinates. A
support function is also available for a solid *eroded* by a length r: the set of its points at a depth of at least r.
The erosion of a box, cylinder or cone is a smaller one; that of an ellipsoid has the support points s(n) - r n for r up
to its smallest radius of curvature.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.kernels import kernel

#: kinds of rows; a sphere is a point with a margin
POINT, ELLIPSOID, BOX, CYLINDER, CONE, TRIANGLE = 0, 1, 2, 3, 4, 5
#: numbers in a row
ROW = 13
#: relative difference of the bounds at which the search ends
CLOSE = 1e-15
MOST_STEPS = 500
#: distance, in limits of erosion, below which the separation is computed by proximal steps
NEAR = 0.05
MOST_MOVES = 25
#: change of the normal at which the proximal steps have converged
STEADY = 1e-6
RESTARTS = 20
#: rounding error of a determinant, relative to the product of the lengths
ROUNDING = 1e-14


@kernel
def support(row: Floats, erosion: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the support point, along (x, y, z), of an eroded solid centered at the origin."""
    kind = int(row[0])
    if kind == 0:
        return 0.0, 0.0, 0.0
    if kind == 5:
        best, most = 0, -np.inf
        for c in range(3):
            reach = row[4 + 3 * c] * x + row[5 + 3 * c] * y + row[6 + 3 * c] * z
            if reach > most:
                best, most = c, reach
        return row[4 + 3 * best], row[5 + 3 * best], row[6 + 3 * best]
    u = row[4] * x + row[7] * y + row[10] * z
    v = row[5] * x + row[8] * y + row[11] * z
    w = row[6] * x + row[9] * y + row[12] * z
    p, q, r = _support_upright(kind, row, erosion, u, v, w)
    return (
        row[4] * p + row[5] * q + row[6] * r,
        row[7] * p + row[8] * q + row[9] * r,
        row[10] * p + row[11] * q + row[12] * r,
    )


@kernel
def _support_upright(kind, row, erosion, u, v, w):  # type: ignore[no-untyped-def]
    """Return the support point of a solid in its body frame."""
    a, b, c = row[1], row[2], row[3]
    if kind == 1:
        length = math.sqrt((a * u) ** 2 + (b * v) ** 2 + (c * w) ** 2)
        size = math.sqrt(u * u + v * v + w * w)
        if length == 0.0:
            return 0.0, 0.0, 0.0
        inward = erosion / size
        return u * (a * a / length - inward), v * (b * b / length - inward), w * (c * c / length - inward)
    if kind == 2:
        a, b, c = 0.5 * a - erosion, 0.5 * b - erosion, 0.5 * c - erosion
        return a if u >= 0.0 else -a, b if v >= 0.0 else -b, c if w >= 0.0 else -c
    flat = math.sqrt(u * u + v * v)
    if kind == 3:
        ring = (a - erosion) / flat if flat > 0.0 else 0.0
        tall = 0.5 * b - erosion
        return u * ring, v * ring, tall if w >= 0.0 else -tall
    # the cone keeps its angle: its base rises by the erosion and its apex sinks by more
    apex = 0.75 * b - erosion * math.sqrt(a * a + b * b) / a
    base = erosion - 0.25 * b
    radius = a * (apex - base) / b
    if w * b >= flat * a:
        return 0.0, 0.0, apex
    ring = radius / flat if flat > 0.0 else 0.0
    return u * ring, v * ring, base


@kernel
def core_distance(one: Floats, other: Floats, erosion: float, offset: Floats, found: Floats) -> float:
    """Return the distance of `one`, eroded, from `other`, whose center lies at `offset`; write the nearest points.

    The distance is 0 if the solids intersect; margins are ignored.
    """
    simplex, mine, theirs = np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3))
    weights, v = np.zeros(4), np.zeros(3)
    count, now, best, scale, restarts = 0, np.inf, np.inf, 0.0, 0
    for i in range(3):
        v[i] = -offset[i]
    if v[0] == 0.0 and v[1] == 0.0 and v[2] == 0.0:
        v[0] = 1.0
    for _ in range(MOST_STEPS):
        ax, ay, az = support(one, erosion, -v[0], -v[1], -v[2])
        bx, by, bz = support(other, 0.0, v[0], v[1], v[2])
        bx, by, bz = bx + offset[0], by + offset[1], bz + offset[2]
        wx, wy, wz = ax - bx, ay - by, az - bz
        if now < np.inf and now - (v[0] * wx + v[1] * wy + v[2] * wz) <= CLOSE * now:
            break
        scale = max(scale, wx * wx + wy * wy + wz * wz)
        mine[count, 0], mine[count, 1], mine[count, 2] = ax, ay, az
        theirs[count, 0], theirs[count, 1], theirs[count, 2] = bx, by, bz
        simplex[count, 0], simplex[count, 1], simplex[count, 2] = wx, wy, wz
        kept = _reduce(simplex, count + 1, weights)
        if kept < 0:
            return 0.0
        x, y, z = 0.0, 0.0, 0.0
        for k in range(count + 1):
            x, y, z = x + weights[k] * simplex[k, 0], y + weights[k] * simplex[k, 1], z + weights[k] * simplex[k, 2]
        square = x * x + y * y + z * z
        if square >= now:
            if restarts >= RESTARTS:
                break
            restarts += 1
            count, now = 0, np.inf
            continue
        now, v[0], v[1], v[2] = square, x, y, z
        if now < best:
            best = now
            _write_points(mine, theirs, weights, count + 1, found)
        if best <= 1e-30 * scale:
            return 0.0
        count = _compress(simplex, mine, theirs, weights, count + 1)
    return math.sqrt(best)


@kernel
def separation(one: Floats, other: Floats, erosion: float, offset: Floats, found: Floats) -> float:
    """Return the distance of `one`, eroded, from `other`, whose center lies at `offset`.

    The distance of slightly overlapping solids is minus the translation that separates them, that of deeper overlaps
    0. The nearest points and the normal from one to the other are written to the nine numbers of `found`; the normal
    is 0 if it is undefined.
    """
    distance = core_distance(one, other, erosion, offset, found)
    for i in range(3):
        found[6 + i] = (found[3 + i] - found[i]) / distance if distance > 0.0 else 0.0
    limit, other_limit = erosion_limit(one), erosion_limit(other)
    scale = limit if other_limit == 0.0 else (other_limit if limit == 0.0 else min(limit, other_limit))
    if scale == 0.0 or distance > NEAR * scale:
        return distance
    normal, trial, moved = np.zeros(3), np.zeros(6), np.zeros(3)
    start = distance
    if distance > 1e-3 * scale:
        trial[:] = found[:6]
    elif limit > 0.0:
        # the nearest points of more eroded solids give the direction
        start = core_distance(one, other, 0.5 * (erosion + limit), offset, trial)
    else:
        trial[:3] = offset
        start = core_distance(other, one, 0.5 * other_limit, -offset, trial)
        for i in range(3):
            trial[i], trial[3 + i] = trial[3 + i] + offset[i], trial[i] + offset[i]
    if start == 0.0:
        return distance
    for i in range(3):
        normal[i] = (trial[3 + i] - trial[i]) / start
    gap = _part(one, other, erosion, offset, NEAR * scale, normal, trial, moved, found)
    if not math.isnan(gap):
        return gap
    # corners and edges: the normal does not converge, but the simplices are exact
    core_distance(one, other, erosion, offset, found)
    if distance > 1e-10 * scale:
        for i in range(3):
            found[6 + i] = (found[3 + i] - found[i]) / distance
    return distance


@kernel
def _part(one, other, erosion, offset, step, normal, trial, moved, found):  # type: ignore[no-untyped-def]
    """Improve the normal by proximal steps; write its points and return the separation, NaN if not converged."""
    deep, gap, steady = max(-_gap_along(one, other, erosion, offset, normal), 0.0), 0.0, False
    for _ in range(MOST_MOVES):
        # the last step is short: it shows whether the normal has really converged
        way = step * (1e-3 if steady else 1.0) + 2.0 * deep
        for i in range(3):
            moved[i] = offset[i] + way * normal[i]
        length = core_distance(one, other, erosion, moved, trial)
        if length <= 0.0:
            break
        change = 0.0
        for i in range(3):
            change += ((trial[3 + i] - trial[i]) / length - normal[i]) ** 2
        if steady:
            return gap if change <= (4.0 * STEADY) ** 2 else np.nan
        gap, deep = length - way, max(way - length, 0.0)
        for i in range(3):
            found[i], found[3 + i] = trial[i], trial[3 + i] - way * normal[i]
            normal[i] = found[6 + i] = (trial[3 + i] - trial[i]) / length
        # the error of the separation is the square of that of the normal
        steady = change <= STEADY * STEADY
    return np.nan


@kernel
def _gap_along(one, other, erosion, offset, normal):  # type: ignore[no-untyped-def]
    """Return the gap of two solids along a unit normal."""
    x, y, z = normal[0], normal[1], normal[2]
    ax, ay, az = support(one, erosion, x, y, z)
    bx, by, bz = support(other, 0.0, -x, -y, -z)
    return (bx + offset[0] - ax) * x + (by + offset[1] - ay) * y + (bz + offset[2] - az) * z


@kernel
def erosion_limit(row: Floats) -> float:
    """Return the largest exact erosion of a solid: its inner radius, or its smallest radius of curvature."""
    a, b, c = row[1], row[2], row[3]
    if row[0] == 1.0:
        return min(a, b, c) ** 2 / max(a, b, c)
    if row[0] == 2.0:
        return 0.5 * min(a, b, c)
    if row[0] == 3.0:
        return min(a, 0.5 * b)
    if row[0] == 4.0:
        return a * b / (a + math.sqrt(a * a + b * b))
    return 0.0


@kernel
def _write_points(mine, theirs, weights, count, found):  # type: ignore[no-untyped-def]
    """Write the points of both solids that the weights define."""
    for i in range(3):
        found[i] = found[3 + i] = 0.0
        for k in range(count):
            found[i] += weights[k] * mine[k, i]
            found[3 + i] += weights[k] * theirs[k, i]


@kernel
def _compress(simplex, mine, theirs, weights, count):  # type: ignore[no-untyped-def]
    """Drop the corners without weight; return the number of remaining corners."""
    kept = 0
    for k in range(count):
        if weights[k] > 0.0:
            weights[kept] = weights[k]
            for i in range(3):
                simplex[kept, i], mine[kept, i], theirs[kept, i] = simplex[k, i], mine[k, i], theirs[k, i]
            kept += 1
    return kept


@kernel
def _reduce(simplex, count, weights):  # type: ignore[no-untyped-def]
    """Write the weights of the point of a simplex nearest to the origin; return -1 if it contains the origin."""
    for k in range(4):
        weights[k] = 0.0
    if count == 1:
        weights[0] = 1.0
    elif count == 2:
        _weigh_segment(simplex, 0, 1, weights, np.inf)
    elif count == 3:
        _weigh_triangle(simplex, 0, 1, 2, weights, np.inf)
    else:
        return _weigh_tetrahedron(simplex, weights)
    return count


@kernel
def _take(simplex, a, b, c, wa, wb, wc, weights, best):  # type: ignore[no-untyped-def]
    """Write weights if their point is nearer to the origin than the best one; return the smaller squared distance."""
    square = 0.0
    for i in range(3):
        square += (wa * simplex[a, i] + wb * simplex[b, i] + wc * simplex[c, i]) ** 2
    if square < best:
        for k in range(4):
            weights[k] = 0.0
        weights[c] = wc
        weights[b] = wb if b != c else wb + wc
        weights[a] = wa
        return square
    return best


@kernel
def _weigh_segment(simplex, a, b, weights, best):  # type: ignore[no-untyped-def]
    """Try the nearest point of an edge."""
    along, length = 0.0, 0.0
    for i in range(3):
        step = simplex[b, i] - simplex[a, i]
        along -= simplex[a, i] * step
        length += step * step
    t = 0.0 if along <= 0.0 or length == 0.0 else min(along / length, 1.0)
    return _take(simplex, a, b, b, 1.0 - t, t, 0.0, weights, best)


@kernel
def _weigh_triangle(simplex, a, b, c, weights, best):  # type: ignore[no-untyped-def]
    """Try the nearest points of the interior and the edges of a triangle."""
    ax, ay, az = simplex[a, 0], simplex[a, 1], simplex[a, 2]
    ux, uy, uz = simplex[b, 0] - ax, simplex[b, 1] - ay, simplex[b, 2] - az
    vx, vy, vz = simplex[c, 0] - ax, simplex[c, 1] - ay, simplex[c, 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    if square > 0.0:
        wb = -((ay * vz - az * vy) * nx + (az * vx - ax * vz) * ny + (ax * vy - ay * vx) * nz) / square
        wc = -((uy * az - uz * ay) * nx + (uz * ax - ux * az) * ny + (ux * ay - uy * ax) * nz) / square
        if wb >= 0.0 and wc >= 0.0 and wb + wc <= 1.0:
            best = _take(simplex, a, b, c, 1.0 - wb - wc, wb, wc, weights, best)
    best = _weigh_segment(simplex, a, b, weights, best)
    best = _weigh_segment(simplex, b, c, weights, best)
    return _weigh_segment(simplex, c, a, weights, best)


@kernel
def _weigh_tetrahedron(simplex, weights):  # type: ignore[no-untyped-def]
    """Try the faces beyond which the origin lies; return -1 if there is none."""
    best, outside = np.inf, False
    for d in range(4):
        a, b, c = (d + 1) % 4, (d + 2) % 4, (d + 3) % 4
        ax, ay, az = simplex[a, 0], simplex[a, 1], simplex[a, 2]
        ux, uy, uz = simplex[b, 0] - ax, simplex[b, 1] - ay, simplex[b, 2] - az
        vx, vy, vz = simplex[c, 0] - ax, simplex[c, 1] - ay, simplex[c, 2] - az
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        wx, wy, wz = simplex[d, 0] - ax, simplex[d, 1] - ay, simplex[d, 2] - az
        origin, inner = -(nx * ax + ny * ay + nz * az), nx * wx + ny * wy + nz * wz
        # a face whose side is uncertain due to rounding is tried too
        noise = ROUNDING * math.sqrt((ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz))
        flat = abs(inner) <= noise * math.sqrt(wx * wx + wy * wy + wz * wz)
        near = abs(origin) <= noise * math.sqrt(ax * ax + ay * ay + az * az)
        if flat or near or (origin > 0.0) != (inner > 0.0):
            outside = True
            best = _weigh_triangle(simplex, a, b, c, weights, best)
    return 4 if outside else -1
