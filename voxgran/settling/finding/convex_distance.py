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
from typing import TypeAlias

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.contacts.gjk import support
from voxgran.settling.finding.convex_bodies import ConvexBodies, ConvexWork

#: the kinds of `convex_bodies`, as numbers of `contacts.gjk`: the kernels below compare with 0, 1 and 2
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


@inlined_kernel
def farthest_corner(
    corner: Floats, links: tuple[Integers, Integers], base: int, lo: int, hi: int, at: int, x: float, y: float,
    z: float,
) -> int:  # fmt: skip
    """Return which corner lo ... hi - 1 is farthest along a direction; many are walked through from corner `at`."""
    if hi - lo < WALK:
        at, most = lo, corner[lo, 0] * x + corner[lo, 1] * y + corner[lo, 2] * z
        for q in range(lo + 1, hi):
            height = corner[q, 0] * x + corner[q, 1] * y + corner[q, 2] * z
            if height > most:
                most, at = height, q
        return at
    first, link = links
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
def core_support(
    corner: Floats, links: tuple[Integers, Integers], row: Floats, part: Part, at: int, x: float, y: float, z: float,
    ellipsoids: object, rounds: object,
) -> tuple[float, float, float, int]:  # fmt: skip
    """Return the support point of the core of a part along a direction, and which corner it is.

    A part is (kind, grain, first corner, end of corners, first corner in the tables, radius); `at` is a corner of it.
    ellipsoids, rounds: None where there are no ellipsoids, or cylinders and cones.
    """
    kind, i, lo, hi, base, _ = part
    if (ellipsoids is not None or rounds is not None) and kind != 0 and kind != 2:
        px, py, pz = support(row[i], 0.0, x, y, z)
        return px, py, pz, at
    at = farthest_corner(corner, links, base, lo, hi, at, x, y, z)
    return corner[at, 0], corner[at, 1], corner[at, 2], at


@bare_kernel
def gap_along(
    bodies: ConvexBodies, work: ConvexWork, one: Part, two: Part, offset: Floats, x: float, y: float, z: float,
    ellipsoids: object, rounds: object,
) -> tuple[float, float]:  # fmt: skip
    """Return the gap of two parts along a unit vector, and the height of the first one's support point."""
    links = (bodies.link_first, bodies.link)
    px, py, pz, _ = core_support(work.corner, links, work.row, one, one[2], x, y, z, ellipsoids, rounds)
    high = px * x + py * y + pz * z + one[5]
    px, py, pz, _ = core_support(work.corner, links, work.row, two, two[2], -x, -y, -z, ellipsoids, rounds)
    low = (offset[0] + px) * x + (offset[1] + py) * y + (offset[2] + pz) * z - two[5]
    return low - high, high


@bare_kernel
def distance_along(
    bodies: ConvexBodies, work: ConvexWork, one: Part, two: Part, ox: float, oy: float, oz: float, dx: float,
    dy: float, dz: float, limit: float, close: float, ellipsoids: object, rounds: object,
) -> float:  # fmt: skip
    """Return the distance of the cores of two parts, of which the second lies at o; the first search goes along d.

    The vector of the distance and the nearest point on the first part are written to `near`. A lower bound above a
    limit is returned as soon as it is known, with its direction; -1 if the parts intersect.
    """
    corner, simplex, mine, near = work.corner, work.simplex, work.mine, work.near
    links = (bodies.link_first, bodies.link)
    ia, ib, count, best, now, restarts = one[2], two[2], 0, 1e300, 1e300, 0
    vx, vy, vz = dx, dy, dz
    for _ in range(MOST_STEPS):
        ax, ay, az, ia = core_support(corner, links, work.row, one, ia, vx, vy, vz, ellipsoids, rounds)
        bx, by, bz, ib = core_support(corner, links, work.row, two, ib, -vx, -vy, -vz, ellipsoids, rounds)
        wx, wy, wz = bx + ox - ax, by + oy - ay, bz + oz - az
        along, square = vx * wx + vy * wy + vz * wz, vx * vx + vy * vy + vz * vz
        if along > 0.0 and along * along > limit * limit * square:
            near[0], near[1], near[2] = vx, vy, vz
            return along / math.sqrt(square)
        if now < 1e300 and now - along <= close * math.sqrt(now) + ROUNDING * now:
            break
        stalled = False
        for q in range(count):
            stalled |= simplex[q, 0] == wx and simplex[q, 1] == wy and simplex[q, 2] == wz
        if not stalled:
            simplex[count, 0], simplex[count, 1], simplex[count, 2] = wx, wy, wz
            mine[count, 0], mine[count, 1], mine[count, 2] = ax, ay, az
            count = _reduce(simplex, mine, work.weight, work.kept, count + 1)
            if count == 0:
                return -1.0
            vx, vy, vz, square = _write_nearest(simplex, mine, work.weight, count, best, near)
            stalled = square >= now
            now = square
        if stalled:
            # the corners are so near each other that rounding decides: others are taken
            if restarts == RESTARTS:
                break
            restarts += 1
            count, now = 0, 1e300
            vx, vy, vz = near[0], near[1], near[2]
        best = min(best, now)
    return math.sqrt(best)


@inlined_kernel
def _write_nearest(simplex, mine, weight, count, best, near):  # type: ignore[no-untyped-def]
    """Return the nearest point of the simplex to the origin and its square; write it if it is nearer than before."""
    x, y, z = 0.0, 0.0, 0.0
    for t in range(count):
        x += weight[t] * simplex[t, 0]
        y += weight[t] * simplex[t, 1]
        z += weight[t] * simplex[t, 2]
    square = x * x + y * y + z * z
    if square >= best:
        return x, y, z, square
    near[0], near[1], near[2] = x, y, z
    for c in range(3):
        near[3 + c] = 0.0
        for t in range(count):
            near[3 + c] += weight[t] * mine[t, c]
    return x, y, z, square


@bare_kernel
def _reduce(simplex, mine, weight, kept, count):  # type: ignore[no-untyped-def]
    """Keep the corners of a simplex whose hull holds the point nearest to the origin, with their weights.

    Return how many these are, 0 if the origin lies in a tetrahedron.
    """
    if count == 1:
        weight[0], kept[0] = 1.0, 0
        many = 1
    elif count == 2:
        many = _weigh_edge(simplex, 0, 1, weight, kept)
    elif count == 3:
        many = _weigh_face(simplex, 0, 1, 2, weight, kept)
    else:
        many = _weigh_tetrahedron(simplex, weight, kept)
    # the corners keep their order
    for t in range(1, many):
        u = t
        while u > 0 and kept[u - 1] > kept[u]:
            kept[u - 1], kept[u] = kept[u], kept[u - 1]
            weight[u - 1], weight[u] = weight[u], weight[u - 1]
            u -= 1
    for t in range(many):
        for c in range(3):
            simplex[t, c] = simplex[kept[t], c]
            mine[t, c] = mine[kept[t], c]
    return many


@bare_kernel
def _weigh_edge(w, a, b, weight, kept):  # type: ignore[no-untyped-def]
    """Write weights and corners of the point of an edge nearest to the origin; return the number of corners."""
    ux, uy, uz = w[b, 0] - w[a, 0], w[b, 1] - w[a, 1], w[b, 2] - w[a, 2]
    square = ux * ux + uy * uy + uz * uz
    t = -(ux * w[a, 0] + uy * w[a, 1] + uz * w[a, 2])
    if t <= 0.0 or square == 0.0:
        weight[0], kept[0] = 1.0, a
        return 1
    if t >= square:
        weight[0], kept[0] = 1.0, b
        return 1
    t /= square
    weight[0], weight[1], kept[0], kept[1] = 1.0 - t, t, a, b
    return 2


@bare_kernel
def _weigh_face(w, a, b, c, weight, kept):  # type: ignore[no-untyped-def]
    """Write weights and corners of the point of a triangle nearest to the origin; return the number of corners.

    The regions are those of Ericson 2005 (Real-Time Collision Detection, section 5.1.5).
    """
    ux, uy, uz = w[b, 0] - w[a, 0], w[b, 1] - w[a, 1], w[b, 2] - w[a, 2]
    vx, vy, vz = w[c, 0] - w[a, 0], w[c, 1] - w[a, 1], w[c, 2] - w[a, 2]
    ua = -(ux * w[a, 0] + uy * w[a, 1] + uz * w[a, 2])
    va = -(vx * w[a, 0] + vy * w[a, 1] + vz * w[a, 2])
    if ua <= 0.0 and va <= 0.0:
        weight[0], kept[0] = 1.0, a
        return 1
    ub = -(ux * w[b, 0] + uy * w[b, 1] + uz * w[b, 2])
    vb = -(vx * w[b, 0] + vy * w[b, 1] + vz * w[b, 2])
    if ub >= 0.0 and vb <= ub:
        weight[0], kept[0] = 1.0, b
        return 1
    share_c = ua * vb - ub * va
    if share_c <= 0.0 and ua >= 0.0 and ub <= 0.0:
        return _weigh_edge(w, a, b, weight, kept)
    uc = -(ux * w[c, 0] + uy * w[c, 1] + uz * w[c, 2])
    vc = -(vx * w[c, 0] + vy * w[c, 1] + vz * w[c, 2])
    if vc >= 0.0 and uc <= vc:
        weight[0], kept[0] = 1.0, c
        return 1
    share_b = uc * va - ua * vc
    if share_b <= 0.0 and va >= 0.0 and vc <= 0.0:
        return _weigh_edge(w, a, c, weight, kept)
    share_a = ub * vc - uc * vb
    if share_a <= 0.0 and vb - ub >= 0.0 and uc - vc >= 0.0:
        return _weigh_edge(w, b, c, weight, kept)
    total = share_a + share_b + share_c
    if total == 0.0:
        return _weigh_edge(w, a, b, weight, kept)
    weight[0], weight[1], weight[2] = share_a / total, share_b / total, share_c / total
    kept[0], kept[1], kept[2] = a, b, c
    return 3


@bare_kernel
def _weigh_tetrahedron(w, weight, kept):  # type: ignore[no-untyped-def]
    """Write weights and corners of the nearest point among the faces beyond which the origin lies; 0 if none is."""
    best, many = 1e300, 0
    wa = wb = wc = 0.0
    ka = kb = kc = 0
    for d in range(4):
        a, b, c = (d + 1) % 4, (d + 2) % 4, (d + 3) % 4
        ux, uy, uz = w[b, 0] - w[a, 0], w[b, 1] - w[a, 1], w[b, 2] - w[a, 2]
        vx, vy, vz = w[c, 0] - w[a, 0], w[c, 1] - w[a, 1], w[c, 2] - w[a, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        inner = nx * (w[d, 0] - w[a, 0]) + ny * (w[d, 1] - w[a, 1]) + nz * (w[d, 2] - w[a, 2])
        if inner * -(nx * w[a, 0] + ny * w[a, 1] + nz * w[a, 2]) > 0.0:
            continue
        some = _weigh_face(w, a, b, c, weight, kept)
        x, y, z = 0.0, 0.0, 0.0
        for t in range(some):
            x += weight[t] * w[kept[t], 0]
            y += weight[t] * w[kept[t], 1]
            z += weight[t] * w[kept[t], 2]
        square = x * x + y * y + z * z
        if square < best:
            best, many = square, some
            wa, wb, wc, ka, kb, kc = weight[0], weight[1], weight[2], kept[0], kept[1], kept[2]
    weight[0], weight[1], weight[2], kept[0], kept[1], kept[2] = wa, wb, wc, ka, kb, kc
    return many


@bare_kernel
def part_gap(
    bodies: ConvexBodies, work: ConvexWork, one: Part, two: Part, offset: Floats, normal: tuple[float, float, float],
    thick: float, limit: float, ellipsoids: object, rounds: object,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Return the signed gap of two parts and the direction of it, which is first looked for along `normal`.

    The nearest point on the core of the first part is written to `work.near`, 3 to 5. A gap above the limit is a lower
    bound. Returns gap, nx, ny, nz.
    """
    nx, ny, nz = normal
    radii = one[5] + two[5]
    near = work.near
    gap, high = gap_along(bodies, work, one, two, offset, nx, ny, nz, ellipsoids, rounds)
    near[3], near[4], near[5] = nx * (high - one[5]), ny * (high - one[5]), nz * (high - one[5])
    if gap > limit:
        return gap, nx, ny, nz
    exact = True
    for _ in range(MOST_ROUNDS):
        core = gap + radii
        direct = exact and core > DIRECT * thick
        h = 0.0 if direct else DISPLACED * thick - min(core, 0.0)
        ox, oy, oz = offset[0] + h * nx, offset[1] + h * ny, offset[2] + h * nz
        keep = near[3], near[4], near[5]
        distance = distance_along(
            bodies, work, one, two, ox, oy, oz, nx, ny, nz, limit + h + radii, CLOSE * thick, ellipsoids, rounds
        )
        length = math.sqrt(near[0] ** 2 + near[1] ** 2 + near[2] ** 2)
        if distance <= 0.0 or length == 0.0:
            near[3], near[4], near[5] = keep
            if not direct:
                break
            # rounding takes parts that nearly touch for such that intersect
            exact = False
            continue
        mx, my, mz = near[0] / length, near[1] / length, near[2] / length
        better, _ = gap_along(bodies, work, one, two, offset, mx, my, mz, ellipsoids, rounds)
        if better < gap:
            if not direct:
                # along the old normal, the nearest points are as good
                break
            mx, my, mz, better = nx, ny, nz, gap
        won = better - gap
        nx, ny, nz, gap = mx, my, mz, better
        if gap > limit:
            break
        if direct:
            # where rounding kept the two bounds apart, the parts are displaced once more
            if distance - gap - radii <= STEADY * thick:
                break
            exact = False
        elif won <= STEADY * thick:
            break
    return gap, nx, ny, nz


@bare_kernel
def ellipsoid_gap(
    form_one: Floats, radius_one: float, form_two: Floats, radius_two: float, offset: Floats,
    normal: tuple[float, float, float], limit: float, near: Floats,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Return the signed gap of two ellipsoids or spheres and its direction; the nearest point goes to `near`, 3 to 5.

    A form holds xx, yy, zz, xy, xz, yz of the matrix whose quadratic form is the square of the support function, zeros
    for a sphere, which has a radius. Newton's method starts along `normal`, and each step raises the gap. A gap above
    the limit is a lower bound. Returns gap, nx, ny, nz.
    """
    nx, ny, nz = normal
    radii = radius_one + radius_two
    step = 1.0
    f, ax, ay, az, la, bx, by, bz, lb = _supports(form_one, form_two, offset, nx, ny, nz)
    for _ in range(60):
        if f - radii > limit:
            break
        # the change of f on the unit sphere, in a basis t, u across n
        if abs(nx) < 0.6:
            tx, ty, tz = 0.0, -nz, ny
        else:
            tx, ty, tz = nz, 0.0, -nx
        s = 1.0 / math.sqrt(tx * tx + ty * ty + tz * tz)
        tx, ty, tz = tx * s, ty * s, tz * s
        ux, uy, uz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
        vx, vy, vz = offset[0] - ax - bx, offset[1] - ay - by, offset[2] - az - bz
        gt, gu = vx * tx + vy * ty + vz * tz, vx * ux + vy * uy + vz * uz
        tt, tu, uu = _curve(form_one, ax, ay, az, la, tx, ty, tz, ux, uy, uz)
        t2, m2, u2 = _curve(form_two, bx, by, bz, lb, tx, ty, tz, ux, uy, uz)
        tt, tu, uu = tt + t2, tu + m2, uu + u2
        # smallest radius of curvature of the two together: the matrix stays positive definite
        least = 0.5 * (tt + uu) - math.sqrt((0.5 * (tt - uu)) ** 2 + tu * tu)
        add = max(f, -0.9 * least)
        tt, uu = tt + add, uu + add
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
            mx, my, mz = nx + step * (p * tx + q * ux), ny + step * (p * ty + q * uy), nz + step * (p * tz + q * uz)
            s = 1.0 / math.sqrt(mx * mx + my * my + mz * mz)
            mx, my, mz = mx * s, my * s, mz * s
            g, cx, cy, cz, lc, dx, dy, dz, ld = _supports(form_one, form_two, offset, mx, my, mz)
            if g > f:
                rising = True
                break
            if step * size < 1e-8:
                # rounding: f is the largest
                break
            step *= 0.5
        if not rising:
            break
        f, nx, ny, nz = g, mx, my, mz
        ax, ay, az, la, bx, by, bz, lb = cx, cy, cz, lc, dx, dy, dz, ld
        if size < 1e-6:
            # the error of f is of the fourth order now
            break
    near[3], near[4], near[5] = ax, ay, az
    return f - radii, nx, ny, nz


@inlined_kernel
def _supports(form_one, form_two, offset, x, y, z):  # type: ignore[no-untyped-def]
    """Return the gap along n, and for each form its support point along n and the height of that."""
    ax, ay, az, la = _support_of_form(form_one, x, y, z)
    bx, by, bz, lb = _support_of_form(form_two, x, y, z)
    return offset[0] * x + offset[1] * y + offset[2] * z - la - lb, ax, ay, az, la, bx, by, bz, lb


@inlined_kernel
def _support_of_form(form, x, y, z):  # type: ignore[no-untyped-def]
    """Return the support point along a unit vector, and its height."""
    px = form[0] * x + form[3] * y + form[4] * z
    py = form[3] * x + form[1] * y + form[5] * z
    pz = form[4] * x + form[5] * y + form[2] * z
    square = px * x + py * y + pz * z
    if square <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    height = math.sqrt(square)
    s = 1.0 / height
    return px * s, py * s, pz * s, height


@inlined_kernel
def _curve(form, px, py, pz, height, tx, ty, tz, ux, uy, uz):  # type: ignore[no-untyped-def]
    """Return the second derivatives of a support function across n: tt, tu, uu."""
    if height <= 0.0:
        return 0.0, 0.0, 0.0
    s = 1.0 / height
    fx = form[0] * tx + form[3] * ty + form[4] * tz
    fy = form[3] * tx + form[1] * ty + form[5] * tz
    fz = form[4] * tx + form[5] * ty + form[2] * tz
    gx = form[0] * ux + form[3] * uy + form[4] * uz
    gy = form[3] * ux + form[1] * uy + form[5] * uz
    gz = form[4] * ux + form[5] * uy + form[2] * uz
    pt, pu = px * tx + py * ty + pz * tz, px * ux + py * uy + pz * uz
    return (
        (fx * tx + fy * ty + fz * tz - pt * pt) * s,
        (fx * ux + fy * uy + fz * uz - pt * pu) * s,
        (gx * ux + gy * uy + gz * uz - pu * pu) * s,
    )
