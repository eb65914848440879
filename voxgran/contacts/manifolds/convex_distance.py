"""Gap, normal and nearest point of two convex parts from their support functions, also where they touch or overlap.

The gap along a direction n is the distance of the two support planes, f(n). It never exceeds the true gap, which is the
largest f over all n; for parts that overlap, the largest f near n is minus the shortest translation that separates them
there. Parts that are apart are compared by the algorithm of Gilbert, Johnson and Keerthi (1988, doi:10.1109/56.2083),
which starts along a known direction. Of parts that touch or overlap, one is first displaced along n by a length h: then
it is apart from the other, and the normal m of the displaced parts has f(m) >= f(n) + h (1 - m.n). The step is repeated
until n is constant (a proximal point method: Rockafellar 1976, doi:10.1137/0314056).

Two ellipsoids have smooth support functions, of which Newton's method on the unit sphere finds the largest f.
"""

import math
from typing import Any, TypeAlias

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.contacts.manifolds.convex_bodies import ConvexBodies, ConvexWork
from voxgran.geometry.gjk import Accuracy, Simplex, search_distance
from voxgran.geometry.support import support
from voxgran.geometry.vectors import Vector, along, cross, dot, sub, times, vector_at

#: the kinds of `convex_bodies`, as numbers of `geometry.support`: the kernels below compare with 0, 1 and 2
#: number of corners from which on the farthest is found by walking along edges
WALK = 48
MOST_STEPS = 64
#: difference of the bounds at which the search ends, in inner radii, and relative to the distance
CLOSE, ROUNDING = 1e-11, 1e-14
#: searches that start again from the best point, where rounding stops them
RESTARTS = 4
#: gap, in inner radii of the thinner part, above which no displacement is needed, and the displacement
DIRECT, DISPLACED = 1e-5, 0.05
MOST_ROUNDS = 40
#: improvement of the gap, in inner radii, at which the rounds end
STEADY = 1e-10
#: a part of a grain: kind, grain, first corner, end of corners, first corner in the tables, radius
Part: TypeAlias = tuple[int, int, int, int, int, float]
#: corners and rows of grains; neighbors of corners in the tables
Tables: TypeAlias = tuple[Floats, Floats, Integers, Integers]


@inlined_kernel
def tables_of(bodies: ConvexBodies, work: Any) -> Tables:
    """Return the corners and rows of grains, and the neighbors of corners."""
    return work.corner, work.row, bodies.link_first, bodies.link


@inlined_kernel
def _farthest_corner(tables, base, lo, hi, at, x, y, z):  # type: ignore[no-untyped-def]
    """Return which corner lo ... hi - 1 is farthest along a direction; many are walked through from corner `at`."""
    corner, _, first, link = tables
    if hi - lo < WALK:
        at, most = lo, corner[lo, 0] * x + corner[lo, 1] * y + corner[lo, 2] * z
        for q in range(lo + 1, hi):
            height = corner[q, 0] * x + corner[q, 1] * y + corner[q, 2] * z
            if height > most:
                most, at = height, q
        return at
    most = corner[at, 0] * x + corner[at, 1] * y + corner[at, 2] * z
    rising = True
    while rising:
        rising = False
        row = base + at - lo
        for k in range(first[row], first[row + 1]):
            q = lo + link[k]
            height = corner[q, 0] * x + corner[q, 1] * y + corner[q, 2] * z
            if height > most:
                most, at, rising = height, q, True
    return at


@bare_kernel
def core_support(solid: tuple[Tables, Part], at: int, x: float, y: float, z: float) -> tuple[float, float, float, int]:
    """Return the support point of the core of a part along a direction, and which of its corners that is.

    at: a corner of it.
    """
    tables, (kind, i, lo, hi, base, _) = solid
    if kind != 0 and kind != 2:
        px, py, pz = support(tables[1][i], 0.0, x, y, z)
        return px, py, pz, at
    q = _farthest_corner(tables, base, lo, hi, lo + at, x, y, z)
    return tables[0][q, 0], tables[0][q, 1], tables[0][q, 2], q - lo


@bare_kernel
def gap_along(tables: Tables, one: Part, two: Part, offset: Vector, normal: Vector) -> tuple[float, float]:
    """Return the gap of two parts along a unit vector, and the height of the first one's support point."""
    x, y, z = normal
    px, py, pz, _ = core_support((tables, one), 0, x, y, z)
    high = px * x + py * y + pz * z + one[5]
    px, py, pz, _ = core_support((tables, two), 0, -x, -y, -z)
    low = (offset[0] + px) * x + (offset[1] + py) * y + (offset[2] + pz) * z - two[5]
    return low - high, high


@bare_kernel
def distance_along(
    tables: Tables, one: Part, two: Part, offset: Vector, start: Vector, limit: float, close: float,
    simplex: Simplex,
) -> float:  # fmt: skip
    """Return the distance of the cores of two parts, as :func:`voxgran.geometry.gjk.search_distance` does."""
    accuracy, smooth = Accuracy(close, ROUNDING, MOST_STEPS, RESTARTS), _is_smooth(one) or _is_smooth(two)
    return search_distance(
        core_support, (tables, one), (tables, two), offset, start, limit, accuracy, smooth, simplex, 0
    )


@inlined_kernel
def _is_smooth(part):  # type: ignore[no-untyped-def]
    """Return whether the core of a part has round sides: of long ones, rounding hides points near each other."""
    return part[0] != 0 and part[0] != 2


@bare_kernel
def part_gap(
    work: ConvexWork, one: Part, two: Part, offset: Vector, start: Vector, thick: float, limit: float,
    corners: Integers,
) -> tuple[float, Vector]:  # fmt: skip
    """Return the signed gap of two parts and the direction of it, which is first looked for along `start`.

    The nearest point on the core of the first part is written to `near` of the simplex, 3 to 5. A gap above the limit
    is a lower bound. The search for the distance of two hulls begins with the `corners` (6,) between which the nearest
    points lay when the pair was last looked at, and writes the new ones.
    """
    normal, radii = start, one[5] + two[5]
    tables, near = tables_of(work.bodies, work), work.simplex.near
    gap, high = gap_along(tables, one, two, offset, normal)
    near[3], near[4], near[5] = times(normal, high - one[5])
    if gap > limit:
        return gap, normal
    exact, smooth = True, _is_smooth(one) or _is_smooth(two)
    for _ in range(MOST_ROUNDS):
        core = gap + radii
        direct = exact and core > DIRECT * thick
        h = 0.0 if direct else DISPLACED * thick - min(core, 0.0)
        place, keep, far = along(offset, h, normal), vector_at(near, 3), limit + h + radii
        known = _recall(tables[0], one, two, place, corners, work.simplex)
        accuracy = Accuracy(CLOSE * thick, ROUNDING, MOST_STEPS, RESTARTS)
        distance = search_distance(
            core_support, (tables, one), (tables, two), place, normal, far, accuracy, smooth, work.simplex, known
        )
        _remember(work.simplex.which, one, two, corners)
        length = math.sqrt(near[0] ** 2 + near[1] ** 2 + near[2] ** 2)
        if distance <= 0.0 or length == 0.0:
            near[3], near[4], near[5] = keep
            if not direct:
                break
            # rounding takes parts that nearly touch for such that intersect
            exact = False
            continue
        trial = near[0] / length, near[1] / length, near[2] / length
        better, _ = gap_along(tables, one, two, offset, trial)
        if better < gap:
            if not direct:
                # along the old normal, the nearest points are as good
                break
            trial, better = normal, gap
        won = better - gap
        normal, gap = trial, better
        if gap > limit:
            break
        if direct:
            # where rounding kept the two bounds apart, the parts are displaced once more
            if distance - gap - radii <= STEADY * thick:
                break
            exact = False
        elif won <= STEADY * thick:
            break
    return gap, normal


@inlined_kernel
def _recall(corner, one, two, place, corners, simplex):  # type: ignore[no-untyped-def]
    """Let a simplex have the corners of two hulls that are remembered; return how many."""
    known = 0
    while known < 3 and corners[2 * known] >= 0:
        mine, other = corners[2 * known], corners[2 * known + 1]
        simplex.which[known, 0], simplex.which[known, 1] = mine, other
        for c in range(3):
            simplex.mine[known, c] = corner[one[2] + mine, c]
            simplex.corner[known, c] = corner[two[2] + other, c] + place[c] - simplex.mine[known, c]
        known += 1
    return known


@inlined_kernel
def _remember(which, one, two, corners):  # type: ignore[no-untyped-def]
    """Write the corners of a simplex, if they are those of two hulls."""
    for k in range(6):
        corners[k] = -1
    if one[0] != 2 or two[0] != 2 or (which[0, 0] >= 0 and which[1, 0] >= 0 and which[2, 0] >= 0 and which[3, 0] >= 0):
        return
    k = 0
    while k < 3 and which[k, 0] >= 0:
        corners[2 * k], corners[2 * k + 1] = which[k, 0], which[k, 1]
        k += 1


@bare_kernel
def ellipsoid_gap(
    form_one: Floats, radius_one: float, form_two: Floats, radius_two: float, offset: Vector, start: Vector,
    limit: float, near: Floats,
) -> tuple[float, Vector]:  # fmt: skip
    """Return the signed gap of two ellipsoids or spheres and its direction; the nearest point goes to `near`, 3 to 5.

    A form holds xx, yy, zz, xy, xz, yz of the matrix whose quadratic form is the square of the support function, zeros
    for a sphere, which has a radius. Newton's method begins along `start`, and each step raises the gap. A gap above
    the limit is a lower bound.
    """
    n, radii, step = start, radius_one + radius_two, 1.0
    f, a, high_a, b, high_b = _supports(form_one, form_two, offset, n)
    for _ in range(60):
        if f - radii > limit:
            break
        # the change of f on the unit sphere, in a basis t, u across n
        t = (0.0, -n[2], n[1]) if abs(n[0]) < 0.6 else (n[2], 0.0, -n[0])
        t = times(t, 1.0 / math.sqrt(dot(t, t)))
        u, v = cross(n, t), sub(sub(offset, a), b)
        gt, gu = dot(v, t), dot(v, u)
        tt, tu, uu = _curve(form_one, a, high_a, t, u)
        t2, m2, u2 = _curve(form_two, b, high_b, t, u)
        tt, tu, uu = tt + t2, tu + m2, uu + u2
        # smallest radius of curvature of the two together: the matrix stays positive definite
        least = 0.5 * (tt + uu) - math.sqrt((0.5 * (tt - uu)) ** 2 + tu * tu)
        more = max(f, -0.9 * least)
        tt, uu = tt + more, uu + more
        det = tt * uu - tu * tu
        if det <= 0.0:
            break
        p, q = (uu * gt - tu * gu) / det, (tt * gu - tu * gt) / det
        size = math.sqrt(p * p + q * q)
        if size < 1e-9:
            break
        step = min(1.0, 0.7 / size)
        rising = False
        for _ in range(30):
            m = along(n, step, along(times(t, p), q, u))
            m = times(m, 1.0 / math.sqrt(dot(m, m)))
            g, c, high_c, d, high_d = _supports(form_one, form_two, offset, m)
            if g > f:
                rising = True
                break
            if step * size < 1e-8:
                # rounding: f is the largest
                break
            step *= 0.5
        if not rising:
            break
        f, n, a, high_a, b, high_b = g, m, c, high_c, d, high_d
        if size < 1e-6:
            # the error of f is of the fourth order now
            break
    near[3], near[4], near[5] = a
    return f - radii, n


@inlined_kernel
def _supports(form_one, form_two, offset, n):  # type: ignore[no-untyped-def]
    """Return the gap along n, and for each form its support point along n and the height of that."""
    a, high_a = _support_of_form(form_one, n)
    b, high_b = _support_of_form(form_two, n)
    return dot(offset, n) - high_a - high_b, a, high_a, b, high_b


@inlined_kernel
def _times_form(form, v):  # type: ignore[no-untyped-def]
    """Return the product of the matrix of a form with a vector."""
    return (
        form[0] * v[0] + form[3] * v[1] + form[4] * v[2],
        form[3] * v[0] + form[1] * v[1] + form[5] * v[2],
        form[4] * v[0] + form[5] * v[1] + form[2] * v[2],
    )


@inlined_kernel
def _support_of_form(form, n):  # type: ignore[no-untyped-def]
    """Return the support point along a unit vector, and its height."""
    p = _times_form(form, n)
    square = dot(p, n)
    if square <= 0.0:
        return (0.0, 0.0, 0.0), 0.0
    height = math.sqrt(square)
    return times(p, 1.0 / height), height


@inlined_kernel
def _curve(form, point, height, t, u):  # type: ignore[no-untyped-def]
    """Return the second derivatives of a support function across n: tt, tu, uu."""
    if height <= 0.0:
        return 0.0, 0.0, 0.0
    s, f, g = 1.0 / height, _times_form(form, t), _times_form(form, u)
    pt, pu = dot(point, t), dot(point, u)
    return (dot(f, t) - pt * pt) * s, (dot(f, u) - pt * pu) * s, (dot(g, u) - pu * pu) * s
