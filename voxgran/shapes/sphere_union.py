"""Exact volume, moments and surface of a union of spheres.

The surface of the union consists of the spheres without their caps inside the other spheres.
By the divergence theorem volume, centroid and second moments are sums of the integrals of 1, n, n n and n n n over
these spherical regions, where n is the normal. By the divergence theorem on the sphere all of them except the area are
integrals over the boundary of the region: arcs of the circles in which two spheres meet, ending where three meet.
The area is the integral of ``(1 - z) d phi`` over the same arcs, z along a direction whose opposite is far from all
circles of that sphere, plus 4 pi if that opposite point belongs to the region. No quadrature over an area and no
counting of faces, edges and corners is needed, so that the result is continuous if four spheres meet in a point.

Each corner is computed once for the three spheres that meet there, in the same order of operations for all of them, and
each arc is joined to its corners by short segments: the boundaries are therefore closed, also for spheres that nearly
coincide.

References
----------
Cazals, Kanhere & Loriot 2011, Computing the volume of a union of spheres: a certified algorithm,
ACM Transactions on Mathematical Software 38(1), 3, doi:10.1145/2049662.2049665
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.geometry.sphere_pairs import near_pairs
from voxgran.geometry.vectors import Vector, along, cross, dot, row_of, sub

#: largest gap of a boundary, in radii; above it the radii are perturbed by NUDGE and the computation is repeated
CLOSED = 1e-10
NUDGE = 1e-13
#: protrusion of a sphere from another one, in radii of that one, up to which it counts as inside
HIDDEN = 2e-13


def union_moments(centers: Floats, radii: Floats) -> tuple[float, Floats, Floats, float]:
    """Return volume, first (3,) and second (3, 3) moments about the origin, and surface area of a union of spheres.

    The origin should lie among the centers.
    """
    keep = ~contained(centers, radii)
    c, r = np.ascontiguousarray(centers[keep]), radii[keep]
    sums = _closed_sums(c, r)
    zeroth, first, second, third = _patch_moments(c, sums)
    flux = linear.einsum("ni,ni->n", c, first) + r * zeroth
    inner = linear.einsum("nij,nj->ni", second, c)
    volume = float((r**2 * flux).sum() / 3)
    moment = (r**2)[:, None] * (c * flux[:, None] + r[:, None] * inner + (r**2)[:, None] * first)
    cross = linear.einsum("ni,nj->nij", c, inner + r[:, None] * first) * r[:, None, None]
    products = linear.einsum("ni,nj,n->nij", c, c, flux) + cross + np.swapaxes(cross, 1, 2)
    products += (r**2)[:, None, None] * (third + r[:, None, None] * second)
    products *= (r**2)[:, None, None] / 5
    return volume, moment.sum(axis=0) / 4, products.sum(axis=0), float((r**2 * zeroth).sum())


def exposed_areas(centers: Floats, radii: Floats) -> Floats:
    """Return the area (n,) of each sphere that lies in no other one; of equal spheres at one place the first has it."""
    areas, keep = np.zeros(len(radii)), ~contained(centers, radii)
    areas[keep] = radii[keep] ** 2 * _closed_sums(np.ascontiguousarray(centers[keep]), radii[keep])[:, 0]
    return areas


def contained(centers: Floats, radii: Floats) -> Booleans:
    """Return the mask of the spheres inside another one; of equal spheres all but the first count as inside."""
    order = np.lexsort((np.arange(len(radii)), -radii))
    result = np.zeros(len(radii), dtype=np.bool_)
    i, j = _touching(centers, radii)
    rank = np.empty(len(radii), dtype=np.int64)
    rank[order] = np.arange(len(radii))
    large, small = np.where(rank[i] < rank[j], i, j), np.where(rank[i] < rank[j], j, i)
    distance = linear.norm(centers[large] - centers[small], axis=1)
    result[small[distance <= radii[large] - radii[small] + HIDDEN * radii[large]]] = True
    return result


def _touching(centers: Floats, radii: Floats) -> tuple[Integers, Integers]:
    """Return the pairs i < j of spheres that touch or overlap."""
    i, j, _ = near_pairs(centers, radii, 0.0)
    return i, j


def _closed_sums(centers: Floats, radii: Floats) -> Floats:
    """Return the boundary integrals (n, 16) of the exposed region of each sphere, none of which is inside another."""
    # the tests of four spheres that meet in one point may contradict each other; a change of the radii by a few bits,
    # different for each, resolves this
    spread = np.modf((np.arange(len(radii)) + 1) * 0.6180339887498949)[0]
    for attempt in range(4):
        sums, gap = _patch_sums(centers, radii * (1.0 + attempt * NUDGE * 10.0**attempt * spread))
        if gap <= CLOSED:
            break
    return sums


def _patch_sums(centers: Floats, radii: Floats) -> tuple[Floats, float]:
    """Return the boundary integrals (n, 16) of the exposed region of each sphere, and the largest gap."""
    i, j = _touching(centers, radii)
    distance = linear.norm(centers[j] - centers[i], axis=1)
    crossing = (distance < radii[i] + radii[j]) & (distance > np.abs(radii[i] - radii[j]))
    i, j = i[crossing], j[crossing]
    both, other = np.concatenate([i, j]), np.concatenate([j, i])
    order = np.lexsort((other, both))
    neighbours = np.ascontiguousarray(other[order])
    start = np.searchsorted(both[order], np.arange(len(radii) + 1)).astype(np.int64)
    sums = np.zeros((len(radii), 19))
    poles = np.zeros((len(radii), 3))
    _choose_poles(centers, radii, start, neighbours, _directions(), poles, sums)
    most = int(np.diff(start).max(initial=0)) + 1
    buffers = np.zeros((most, 2)), np.zeros((most, 6)), np.zeros(most, dtype=np.int64)
    rule = np.array(linear.gauss_legendre(12))
    union = Union(centers, radii, start, neighbours, poles, *buffers, rule)
    _integrate(union, i, j, sums)
    excess = np.abs(sums[:, 0] - 2 * math.pi) - 2 * math.pi
    gap = max(linear.norm(sums[:, 16:], axis=1).max(initial=0.0), excess.max(initial=0.0))
    return sums[:, :16], float(gap)


def _patch_moments(centers: Floats, sums: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the integrals of 1, n, n n and n n (n . center) over the regions from their boundary integrals."""
    identity = np.eye(3)
    index = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
    zeroth, first = sums[:, 0], sums[:, 1:4] / 2
    second = (zeroth[:, None, None] * identity - sums[:, 4:10][:, index]) / 3
    mixed = linear.einsum("ni,nj->nij", centers, first)
    third = (mixed + np.swapaxes(mixed, 1, 2) - sums[:, 10:16][:, index]) / 4
    return zeroth, first, second, third


def _directions() -> Floats:
    """Return 48 directions distributed over the sphere."""
    k = np.arange(48)
    z, turn = 1 - (2 * k + 1) / 48, k * (math.pi * (3 - math.sqrt(5))) + 0.123
    flat = np.sqrt(1 - z * z)
    return np.column_stack([flat * libm.cos(turn), flat * libm.sin(turn), z])


class Union(NamedTuple):
    """Spheres, with work space for the parts of a circle that others cover.

    centers, radii: (n, 3) and (n,).  start, neighbours: those that cross sphere i are ``neighbours[start[i] : start[i +
    1]]``.  poles: (n, 3) directions far from all circles.  spans: (m, 2) begin and length of each part.  ends: (m, 6)
    its corners.  order: (m,) the parts by their begin.  rule: (2, k) nodes and weights of a quadrature.
    """

    centers: Floats
    radii: Floats
    start: Integers
    neighbours: Integers
    poles: Floats
    spans: Floats
    ends: Floats
    order: Integers
    rule: Floats


class Circle(NamedTuple):
    """Circle common to spheres i and j: its middle, radius, and a frame (axis, and two directions across)."""

    i: int
    j: int
    mid: Vector
    rho: float
    frame: tuple[Vector, Vector, Vector]


@kernel
def _circle(centers, radii, i, j):  # type: ignore[no-untyped-def]
    """Return the circle common to spheres i and j: distance from center i, radius, axis, distance of the centers."""
    dx, dy, dz = centers[j, 0] - centers[i, 0], centers[j, 1] - centers[i, 1], centers[j, 2] - centers[i, 2]
    d = math.sqrt(dx * dx + dy * dy + dz * dz)
    x = 0.5 * (d + (radii[i] - radii[j]) / d * (radii[i] + radii[j]))
    rho = math.sqrt(max((radii[i] - x) * (radii[i] + x), 0.0))
    return x, rho, (dx / d, dy / d, dz / d), d


@kernel
def _choose_poles(centers, radii, start, neighbours, directions, poles, sums):  # type: ignore[no-untyped-def]
    """Choose for each sphere the direction farthest from all circles; its area starts at 4 pi if exposed there."""
    for i in range(len(radii)):
        best = -1.0
        for k in range(len(directions)):
            p = row_of(directions, k)
            margin = 2.0
            bare = True
            for q in range(start[i], start[i + 1]):
                x, _, u, _ = _circle(centers, radii, i, neighbours[q])
                excess = dot(p, u) - x / radii[i]
                margin = min(margin, abs(excess))
                bare = bare and excess <= 0.0
            if margin > best:
                best = margin
                poles[i, 0], poles[i, 1], poles[i, 2] = p
                sums[i, 0] = 4.0 * math.pi if bare else 0.0


@kernel
def _side(centers, i, j):  # type: ignore[no-untyped-def]
    """Return the squared distance of two centers."""
    w = sub(row_of(centers, j), row_of(centers, i))
    return dot(w, w)


@kernel
def _order(centers, radii, i, j, k):  # type: ignore[no-untyped-def]
    """Order three spheres as (e, f, m), and return whether their centers are collinear.

    If they are, m is the middle one; otherwise e and f are the pair whose spheres meet at the flattest angle. The
    result is independent of the order of the arguments.
    """
    a, c = min(i, j, k), max(i, j, k)
    b = i + j + k - a - c
    ab, ac, bc = _side(centers, a, b), _side(centers, a, c), _side(centers, b, c)
    longest = max(ab, ac, bc)
    one = sub(row_of(centers, b), row_of(centers, a))
    two = sub(row_of(centers, c), row_of(centers, a))
    normal = cross(one, two)
    straight = dot(normal, normal) <= (1e-14 * longest) ** 2
    if straight:
        ab, ac, bc = -ab, -ac, -bc
    else:
        # squared sine of the angle at which the spheres meet, up to a common factor
        ab = ab * _circle(centers, radii, a, b)[1] ** 2 * radii[c] ** 2
        ac = ac * _circle(centers, radii, a, c)[1] ** 2 * radii[b] ** 2
        bc = bc * _circle(centers, radii, b, c)[1] ** 2 * radii[a] ** 2
    if ab <= ac and ab <= bc:
        return a, b, c, straight
    if ac <= bc:
        return a, c, b, straight
    return b, c, a, straight


@kernel
def _covered(centers, radii, circle, k, span, ends):  # type: ignore[no-untyped-def]
    """Write the part of a circle inside sphere k; return 0 for none, 1 for a part, 2 for all of it."""
    i, j, mid, rho, frame = circle
    e, f, m, straight = _order(centers, radii, i, j, k)
    x, base_rho, axis, _ = _circle(centers, radii, e, f)
    base = along(row_of(centers, e), x, axis)
    w = sub(row_of(centers, m), base)
    excess = base_rho**2 + (dot(w, w) - radii[m] ** 2)
    if straight:
        # either the middle sphere is exposed, or the outer two meet outside of it; not on one common circle
        shows = excess < -1e-13 * radii[m] ** 2
        return 2 if shows == (k == m) else 0
    v = sub(row_of(centers, k), mid)
    own = rho**2 + (dot(v, v) - radii[k] ** 2)
    flat = along(w, -dot(w, axis), axis)
    g = math.sqrt(dot(flat, flat))
    reach = 2.0 * base_rho * g
    if abs(excess) >= reach:
        return 2 if own < 0.0 else 0
    cosine = excess / reach
    sine = math.sqrt((reach - excess) / reach * ((reach + excess) / reach))
    one = (flat[0] / g, flat[1] / g, flat[2] / g)
    two = cross(axis, one)
    near = along(base, base_rho * cosine, one)
    plus, minus = along(near, base_rho * sine, two), along(near, -base_rho * sine, two)
    even = k == m or (i == m and j == e) or (j == m and i == f)
    enter, leave = (minus, plus) if even else (plus, minus)
    p, q = sub(enter, mid), sub(leave, mid)
    begin = math.atan2(dot(p, frame[2]), dot(p, frame[1])) % (2.0 * math.pi)
    length = (math.atan2(dot(q, frame[2]), dot(q, frame[1])) - begin) % (2.0 * math.pi)
    if length < 1e-6 and own < 0.0:
        return 2
    if length > 2.0 * math.pi - 1e-6 and own > 0.0:
        return 0
    span[0], span[1] = begin, length
    ends[0], ends[1], ends[2] = enter
    ends[3], ends[4], ends[5] = leave
    return 1


@kernel
def _add_forms(row, n, dn, center):  # type: ignore[no-untyped-def]
    """Add the boundary forms of all moments at n for the step dn."""
    turn = cross(n, dn)
    row[1] += turn[0]
    row[2] += turn[1]
    row[3] += turn[2]
    out = (-turn[0], -turn[1], -turn[2])  # points out of the region
    row[4] += n[0] * out[0]
    row[5] += n[1] * out[1]
    row[6] += n[2] * out[2]
    row[7] += 0.5 * (n[0] * out[1] + n[1] * out[0])
    row[8] += 0.5 * (n[0] * out[2] + n[2] * out[0])
    row[9] += 0.5 * (n[1] * out[2] + n[2] * out[1])
    flow = dot(out, center)
    row[10] += n[0] * n[0] * flow
    row[11] += n[1] * n[1] * flow
    row[12] += n[2] * n[2] * flow
    row[13] += n[0] * n[1] * flow
    row[14] += n[0] * n[2] * flow
    row[15] += n[1] * n[2] * flow


@kernel
def _add_arc(row, center, pole, sign, frame, cosine, sine, begin, end, rule):  # type: ignore[no-untyped-def]
    """Add the arc of a circle from angle `begin` to `end`, in the direction of the sign."""
    u, e1, e2 = frame
    one, two = -dot(pole, e1), -dot(pole, e2)
    turn, tilt = math.atan2(two, one), math.atan2(math.sqrt(one * one + two * two), -dot(pole, u))
    half = math.atan2(sine, cosine)
    ratio = math.cos(0.5 * (half + tilt)) / math.cos(0.5 * (half - tilt))
    a, b = 0.5 * (begin - turn), 0.5 * (end - turn)
    swept = math.atan2(
        ratio * math.sin(min(0.5 * (end - begin), math.pi)),
        math.cos(a) * math.cos(b) + ratio * ratio * math.sin(a) * math.sin(b),
    )
    row[0] += sign * (2.0 * swept - cosine * (end - begin))
    pieces = math.ceil((end - begin) / (0.5 * math.pi))
    width = (end - begin) / max(pieces, 1)
    for piece in range(pieces):
        for k in range(rule.shape[1]):
            t = begin + width * (piece + 0.5 + 0.5 * rule[0, k])
            c, s, h = math.cos(t), math.sin(t), sign * 0.5 * width * rule[1, k] * sine
            radial = along((c * e1[0], c * e1[1], c * e1[2]), s, e2)
            ahead = along((-s * e1[0], -s * e1[1], -s * e1[2]), c, e2)
            n = along((cosine * u[0], cosine * u[1], cosine * u[2]), sine, radial)
            _add_forms(row, n, (h * ahead[0], h * ahead[1], h * ahead[2]), center)


@kernel
def _add_step(row, center, radius, pole, sign, here, there, rule):  # type: ignore[no-untyped-def]
    """Add the short segment that joins an arc and its corner."""
    step = sub(there, here)
    few = 1 if dot(step, step) < 1e-14 * radius * radius else rule.shape[1]
    for k in range(few):
        share, weight = (0.5, 1.0) if few == 1 else (0.5 + 0.5 * rule[0, k], 0.5 * rule[1, k])
        n = along(along(here, share, step), -1.0, center)
        length = math.sqrt(dot(n, n))
        n = (n[0] / length, n[1] / length, n[2] / length)
        dn = along(step, -dot(step, n), n)
        h = sign * weight / length
        dn = (h * dn[0], h * dn[1], h * dn[2])
        row[0] -= dot(cross(pole, n), dn) / (1.0 - dot(pole, n))
        _add_forms(row, n, dn, center)


@kernel
def _add_edge(row, union, s, circle, sign, cosine, begin, end, corners):  # type: ignore[no-untyped-def]
    """Add an arc to sphere s, with the segments from the corner where it begins and to that where it ends."""
    center, pole, radius, rule = row_of(union.centers, s), row_of(union.poles, s), union.radii[s], union.rule
    _, _, mid, rho, frame = circle
    _add_arc(row, center, pole, sign, frame, cosine, rho / radius, begin, end, rule)
    tail, head = corners
    first = along(along(mid, rho * math.cos(begin), frame[1]), rho * math.sin(begin), frame[2])
    last = along(along(mid, rho * math.cos(end), frame[1]), rho * math.sin(end), frame[2])
    _add_step(row, center, radius, pole, sign, tail, first, rule)
    _add_step(row, center, radius, pole, sign, last, head, rule)
    for axis in range(3):
        row[16 + axis] += sign * (head[axis] - tail[axis]) / radius


@kernel
def _frame(u):  # type: ignore[no-untyped-def]
    """Return two directions that form a right-handed frame with u."""
    if abs(u[0]) <= abs(u[1]) and abs(u[0]) <= abs(u[2]):
        side = (0.0, u[2], -u[1])
    elif abs(u[1]) <= abs(u[2]):
        side = (-u[2], 0.0, u[0])
    else:
        side = (u[1], -u[0], 0.0)
    length = math.sqrt(dot(side, side))
    one = (side[0] / length, side[1] / length, side[2] / length)
    return u, one, cross(u, one)


@kernel
def _cover_circle(union, circle):  # type: ignore[no-untyped-def]
    """Write the parts of a circle that other spheres cover; return their number, -1 if all of it is covered."""
    start, neighbours, count = union.start, union.neighbours, 0
    p, q = start[circle.i], start[circle.j]
    while p < start[circle.i + 1] and q < start[circle.j + 1]:
        if neighbours[p] < neighbours[q]:
            p += 1
        elif neighbours[q] < neighbours[p]:
            q += 1
        else:
            state = _covered(union.centers, union.radii, circle, neighbours[p], union.spans[count], union.ends[count])
            if state == 2:
                return -1
            count += state
            p += 1
            q += 1
    return count


@kernel
def _sort_spans(spans, count, order):  # type: ignore[no-untyped-def]
    """Sort the covered parts by their start."""
    for k in range(count):
        slot = k
        while slot > 0 and spans[order[slot - 1], 0] > spans[k, 0]:
            order[slot] = order[slot - 1]
            slot -= 1
        order[slot] = k


@kernel
def _integrate(union, first, second, sums):  # type: ignore[no-untyped-def]
    """Add the exposed arcs of all circles to the sums of their two spheres."""
    centers, radii, poles, rule = union.centers, union.radii, union.poles, union.rule
    spans, ends, order, whole = union.spans, union.ends, union.order, 2.0 * math.pi
    for pair in range(len(first)):
        i, j = first[pair], second[pair]
        x, rho, u, d = _circle(centers, radii, i, j)
        ci, cj = row_of(centers, i), row_of(centers, j)
        pi, pj = row_of(poles, i), row_of(poles, j)
        # the region of sphere i lies to the right of the circle seen along u, that of sphere j to the left
        cos_i, cos_j = x / radii[i], (x - d) / radii[j]
        frame = _frame(u)
        circle = Circle(i, j, along(ci, x, u), rho, frame)
        count = _cover_circle(union, circle)
        if count == 0:
            _add_arc(sums[i], ci, pi, -1.0, frame, cos_i, rho / radii[i], 0.0, whole, rule)
            _add_arc(sums[j], cj, pj, 1.0, frame, cos_j, rho / radii[j], 0.0, whole, rule)
        if count <= 0:
            continue
        _sort_spans(spans, count, order)
        reach, last = -whole, 0
        for k in range(count):
            if spans[k, 0] + spans[k, 1] - whole > reach:
                reach, last = spans[k, 0] + spans[k, 1] - whole, k
        for slot in range(count):
            k = order[slot]
            if spans[k, 0] > reach:
                tail = (ends[last, 3], ends[last, 4], ends[last, 5])
                head = (ends[k, 0], ends[k, 1], ends[k, 2])
                for side in range(2):
                    s, sign, cosine = (i, -1.0, cos_i) if side == 0 else (j, 1.0, cos_j)
                    _add_edge(sums[s], union, s, circle, sign, cosine, reach, spans[k, 0], (tail, head))
            if spans[k, 0] + spans[k, 1] > reach:
                reach, last = spans[k, 0] + spans[k, 1], k
