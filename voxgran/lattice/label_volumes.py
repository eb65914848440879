"""What each label of a net has gained in volume since its points were moved, and where triangles cross.

The volume between a triangle and the face of a voxel from which its corners were moved is a closed form of the moves:
no origin is chosen, and the volumes of the voxels are exact. A point moves along the sum of the gradients of the
volumes, each times the pressure of its label, the less the more area is around it.

Points are gone through chunk by chunk with the quadrangles around them, so that what is kept for a moment stays small.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.geometry.crossing import is_crossing
from voxgran.geometry.vectors import add, corner_of, cross, dot, sub
from voxgran.lattice.label_net import Net

#: farthest that a point moves along an axis, in voxels, and the steps in a voxel in which it does
BOX, PARTS = 0.5, 2**20
#: overlap from which on two triangles count as crossing, in voxels
DEPTH = 1e-9
#: points of a chunk, and quadrangles that are left out together where they are far from one
CHUNK, BLOCK = 2**16, 2**11
#: labels that meet in a point, and faces, at most
MOST_LABELS, MOST_FACES = 8, 12


class Findings(NamedTuple):
    """What :func:`examine` finds."""

    change: Floats  # (labels + 1,) volume of each label less that of its voxels
    diagonal: Floats  # (labels + 1,) change of the volume of each label by a pressure of its own
    pairs: Integers  # (k,) (labels + 1) times a label plus a higher one, which share points
    shared: Floats  # (k,) change of the volume of one by a pressure in the other
    ease: NDArray[np.float32]  # (points,) how far a point moves along a force: the inverse of the area around it
    wrong: Booleans  # (points,) which belong to triangles that cross others


class _Chunk(NamedTuple):
    """Labels around each point of a chunk, and what is known of them."""

    label: NDArray[np.int32]  # (CHUNK, 8) labels around each point
    many: NDArray[np.uint8]  # (CHUNK,) how many
    gradient: Floats  # (CHUNK, 8, 3) of the volume of each by the point
    area: Floats  # (CHUNK,) area around each point, once for each label
    listed: NDArray[np.int32]  # (CHUNK,) row of a point in lists of what may cross, -1 where nothing does
    normals: Floats  # (m, 2, 3) normals of the triangles of the quadrangles, as long as twice their areas


def examine(
    net: Net, crossed: Booleans, moved: NDArray[np.float32], held: Booleans, *, spacing: Floats, labels: int
) -> Findings:
    """Return volumes, pressures and crossings of a net whose points are moved, in voxels with edges `spacing`.

    `crossed`, (q,): quadrangles that are cut from point 1 to 3.  `held`, (points, 3): what cannot move.
    """
    low, high = _block_ends(net.quad)
    first = np.arange(0, len(net.at), CHUNK)[:, None]
    most = int(((high >= first) & (low < first + CHUNK)).sum(axis=1).max(initial=0)) * BLOCK
    chunk = _Chunk(
        np.empty((CHUNK, MOST_LABELS), dtype=np.int32),
        np.empty(CHUNK, dtype=np.uint8),
        np.empty((CHUNK, MOST_LABELS, 3)),
        np.empty(CHUNK),
        np.empty(CHUNK, dtype=np.int32),
        np.empty((most, 2, 3)),
    )
    return Findings(*_examine(net, crossed, moved, held, spacing, labels, low, high, chunk))


def push(
    net: Net,
    crossed: Booleans,
    moved: NDArray[np.float32],
    held: Booleans,
    *,
    spacing: Floats,
    pressure: Floats,
    ease: NDArray[np.float32],
) -> None:
    """Move the points by the pressures of the labels, (labels + 1,), in whole steps within their boxes.

    The other arguments are those of :func:`examine`, and what it finds.
    """
    _push(net, crossed, moved, held, spacing, pressure, ease)


@kernel
def _push(net, crossed, moved, held, spacing, pressure, ease):  # type: ignore[no-untyped-def]
    """Move the points as `push` does."""
    force = np.zeros(moved.shape, dtype=np.float32)
    for q in range(len(net.quad)):
        low, high = net.side[q, 0], net.side[q, 1]
        excess = (pressure[low] if low > 0 else 0.0) - (pressure[high] if high > 0 else 0.0)
        if excess == 0.0:
            continue
        one, two, _ = _facets(net, crossed, moved, spacing, q)
        for p in range(4):
            g, v = _at_corner(one, two, p, int(crossed[q])), net.quad[q, p]
            for a in range(3):
                force[v, a] += excess * g[a] / 6
    for v in range(len(moved)):
        for a in range(3):
            if not held[v, a] and abs(moved[v, a]) < BOX:
                to = moved[v, a] + force[v, a] * ease[v] / spacing[a]
                moved[v, a] = min(max(math.floor(to * PARTS + 0.5) / PARTS, -BOX), BOX)


@kernel
def _block_ends(quad):  # type: ignore[no-untyped-def]
    """Return the lowest and the highest point of each block of quadrangles."""
    blocks = (len(quad) + BLOCK - 1) // BLOCK
    low, high = np.empty(blocks, dtype=np.int64), np.empty(blocks, dtype=np.int64)
    for b in range(blocks):
        least, most = quad[b * BLOCK, 0], quad[b * BLOCK, 0]
        for q in range(b * BLOCK, min((b + 1) * BLOCK, len(quad))):
            for p in range(4):
                least, most = min(least, quad[q, p]), max(most, quad[q, p])
        low[b], high[b] = least, most
    return low, high


@bare_kernel
def _facets(net, crossed, moved, spacing, q):  # type: ignore[no-untyped-def]
    """Return twice the area vectors of the triangles of a quadrangle, and the volume between it and its face of voxels.

    The volume is the integral of the mean move times the area vector, a polynomial of the share of the moves.
    """
    one, two, c = (net.axis[q] + 1) % 3, (net.axis[q] + 2) % 3, int(crossed[q])
    s, t = spacing[one], spacing[two]
    # cut from point 1 to 3, the quadrangle begins with a step along the other axis, and ends with one back
    a, b, e, f = (0.0, t, -s, t) if c else (s, 0.0, s, t)
    g, h = (-s, 0.0) if c else (0.0, t)
    o, u = _move(net, moved, spacing, q, c), _move(net, moved, spacing, q, c + 1)
    v, w = _move(net, moved, spacing, q, (c + 2) % 4), _move(net, moved, spacing, q, (c + 3) % 4)
    d, m, n = sub(u, o), sub(v, o), sub(w, o)
    along = add(m, _in_plane(one, two, e, f))
    first = cross(add(d, _in_plane(one, two, a, b)), along)
    second = cross(along, add(n, _in_plane(one, two, g, h)))
    total = add(o, v)
    x, y = add(total, u), add(total, w)
    flat = s * t * (x[net.axis[q]] + y[net.axis[q]])
    volume = (dot(x, first) + dot(y, second) + flat) / 12 - (dot(x, cross(d, m)) + dot(y, cross(m, n))) / 36
    return first, second, volume


@inlined_kernel
def _move(net, moved, spacing, q, p):  # type: ignore[no-untyped-def]
    """Return how far point p of a quadrangle is moved."""
    v = net.quad[q, p]
    return moved[v, 0] * spacing[0], moved[v, 1] * spacing[1], moved[v, 2] * spacing[2]


@inlined_kernel
def _in_plane(one, two, s, t):  # type: ignore[no-untyped-def]
    """Return the vector of a length along each of two axes."""
    return (
        (s if one == 0 else 0.0) + (t if two == 0 else 0.0),
        (s if one == 1 else 0.0) + (t if two == 1 else 0.0),
        (s if one == 2 else 0.0) + (t if two == 2 else 0.0),
    )


@inlined_kernel
def _at_corner(one, two, p, c):  # type: ignore[no-untyped-def]
    """Return the sum of the normals of the triangles at corner p of a quadrangle."""
    if p == c + 1:
        return one
    if p == (c + 3) % 4:
        return two
    return add(one, two)


@kernel
def _examine(net, crossed, moved, held, spacing, labels, low, high, chunk):  # type: ignore[no-untyped-def]
    """Return the parts of `Findings`, chunk by chunk."""
    change, diagonal = np.zeros(labels + 1), np.zeros(labels + 1)
    keys, values = np.full(1024, -1, dtype=np.int64), np.zeros(1024)
    ease, wrong = np.empty(len(moved), dtype=np.float32), np.zeros(len(moved), dtype=np.bool_)
    used = 0
    size = len(chunk.many)
    for first in range(0, len(moved), size):
        stop = min(first + size, len(moved))
        _gather(net, crossed, moved, spacing, low, high, first, stop, chunk, change)
        many = _list_suspects(net, low, high, first, stop, chunk)
        if many:
            _mark_crossings(net, crossed, moved, low, high, first, stop, chunk.listed, many, wrong)
        for v in range(first, stop):
            m = v - first
            ease[v] = 1.0 / chunk.area[m]
            if 2 * (used + MOST_LABELS**2) > len(keys):
                keys, values = _widened(keys, values)
            used += _couple(chunk, m, ease[v], moved, held, v, diagonal, keys, values)
    change[0], there = 0.0, np.flatnonzero(keys >= 0)
    return change, diagonal, keys[there], values[there], ease, wrong


@bare_kernel
def _slot(chunk, m, label):  # type: ignore[no-untyped-def]
    """Return the place of a label among those around a point of the chunk, which is made if need be."""
    for k in range(chunk.many[m]):
        if chunk.label[m, k] == label:
            return k
    k = int(chunk.many[m])
    chunk.label[m, k] = label
    for a in range(3):
        chunk.gradient[m, k, a] = 0.0
    chunk.many[m] = k + 1
    return k


@kernel
def _gather(net, crossed, moved, spacing, low, high, first, stop, chunk, change):  # type: ignore[no-untyped-def]
    """Write normals, gradients and areas of a chunk; add the volumes of its quadrangles to those of the labels."""
    n, size = 0, stop - first
    for m in range(size):
        chunk.many[m], chunk.area[m], chunk.listed[m] = 0, 1e-30, -1
    for b in range(len(low)):
        if high[b] < first or low[b] >= stop:
            continue
        for q in range(b * BLOCK, min((b + 1) * BLOCK, len(net.quad))):
            n += 1
            if not _is_near(net.quad, q, first, stop):
                continue
            one, two, volume = _facets(net, crossed, moved, spacing, q)
            for a in range(3):
                chunk.normals[n - 1, 0, a], chunk.normals[n - 1, 1, a] = one[a], two[a]
            below, above, c = net.side[q, 0], net.side[q, 1], int(crossed[q])
            if below == above:
                # a face in which a label is cut is no surface
                continue
            # each quadrangle belongs to the chunk of one of its points
            if first <= net.quad[q, 2] < stop:
                change[max(below, 0)] += volume
                change[max(above, 0)] -= volume
            sides = ((below > 0) + (above > 0)) / 6
            areas = sides * math.sqrt(dot(one, one)), sides * math.sqrt(dot(two, two))
            for p in range(4):
                m = net.quad[q, p] - first
                if m < 0 or m >= size:
                    continue
                g = _at_corner(one, two, p, c)
                chunk.area[m] += (0.0 if p == (c + 3) % 4 else areas[0]) + (0.0 if p == c + 1 else areas[1])
                k, w = _slot(chunk, m, below), _slot(chunk, m, above)
                for a in range(3):
                    chunk.gradient[m, k, a] += g[a] / 6
                    chunk.gradient[m, w, a] -= g[a] / 6


@inlined_kernel
def _is_near(quad, q, first, stop):  # type: ignore[no-untyped-def]
    """Return whether a point of a quadrangle belongs to a chunk."""
    near = False
    for p in range(4):
        near |= (quad[q, p] >= first) & (quad[q, p] < stop)
    return near


@kernel
def _list_suspects(net, low, high, first, stop, chunk):  # type: ignore[no-untyped-def]
    """Give the points of a chunk at which triangles may cross a number each; return how many there are.

    Nothing crosses where at most three labels meet, of which any two triangles bound a common one, and all triangles,
    seen from each label, face to the side of their mean normal: that of the gradient.
    """
    many, n = 0, 0
    for m in range(stop - first):
        if chunk.many[m] > 3 or net.special[first + m] >= 0:
            chunk.listed[m] = many
            many += 1
    for b in range(len(low)):
        if high[b] < first or low[b] >= stop:
            continue
        for q in range(b * BLOCK, min((b + 1) * BLOCK, len(net.quad))):
            one, two = corner_of(chunk.normals, n, 0), corner_of(chunk.normals, n, 1)
            n += 1
            for p in range(4):
                m = net.quad[q, p] - first
                if m < 0 or m >= stop - first or chunk.listed[m] >= 0:
                    continue
                # seen from the other one of two labels, all normals are reversed
                for s in range(2 if chunk.many[m] > 2 else 1):
                    mean = corner_of(chunk.gradient, m, _slot(chunk, m, net.side[q, s]))
                    sign = 1.0 - 2.0 * s
                    if sign * dot(one, mean) <= 0.0 or sign * dot(two, mean) <= 0.0:
                        chunk.listed[m] = many
                        many += 1
                        break
    return many


@kernel
def _mark_crossings(net, crossed, moved, low, high, first, stop, listed, many, wrong):  # type: ignore[no-untyped-def]
    """Mark the points of quadrangles around suspects of a chunk whose triangles cross.

    A quadrangle lies within the boxes of its points. Those of two quadrangles overlap in common points only, so that
    triangles that cross have a point in common.
    """
    around, faces = np.empty((many, MOST_FACES), dtype=np.int64), np.zeros(many, dtype=np.int64)
    triangles = np.empty((MOST_FACES, 2, 3, 3))
    for b in range(len(low)):
        if high[b] < first or low[b] >= stop:
            continue
        for q in range(b * BLOCK, min((b + 1) * BLOCK, len(net.quad))):
            for p in range(4):
                m = net.quad[q, p] - first
                if m >= 0 and m < stop - first and listed[m] >= 0:
                    row = listed[m]
                    around[row, faces[row]] = 4 * q + p
                    faces[row] += 1
    for row in range(many):
        here = around[row, : faces[row]]
        for m in range(len(here)):
            _place(net, crossed, moved, here[m], triangles[m])
        for m in range(len(here)):
            for n in range(m):
                q, r = here[m] >> 2, here[n] >> 2
                for s in range(4):
                    one, two = s >> 1, s & 1
                    if _common(net.quad, q, crossed[q], one, r, crossed[r], two) > 1:
                        continue
                    if is_crossing(triangles[m, one], triangles[n, two], DEPTH):
                        for p in range(4):
                            wrong[net.quad[q, p]] = wrong[net.quad[r, p]] = True


@bare_kernel
def _corner(crossed, s, c):  # type: ignore[no-untyped-def]
    """Return which point of a quadrangle is corner c of its triangle s."""
    return (crossed + c + s * (c > 0)) % 4


@bare_kernel
def _place(net, crossed, moved, here, triangles):  # type: ignore[no-untyped-def]
    """Write the two triangles of a quadrangle, seen from one of its points: `here` is 4 q + p for point p."""
    q, p = here >> 2, here & 3
    one, two = (net.axis[q] + 1) % 3, (net.axis[q] + 2) % 3
    for s in range(2):
        for c in range(3):
            d = _corner(crossed[q], s, c)
            for a in range(3):
                triangles[s, c, a] = moved[net.quad[q, d], a]
            triangles[s, c, one] += (0, 1, 1, 0)[d] - (0, 1, 1, 0)[p]
            triangles[s, c, two] += (0, 0, 1, 1)[d] - (0, 0, 1, 1)[p]


@bare_kernel
def _common(quad, q, crossed, s, r, other, t):  # type: ignore[no-untyped-def]
    """Return how many points triangle s of quadrangle q and triangle t of quadrangle r share."""
    count = 0
    for c in range(3):
        for d in range(3):
            count += quad[q, _corner(crossed, s, c)] == quad[r, _corner(other, t, d)]
    return count


@bare_kernel
def _couple(chunk, m, ease, moved, held, v, diagonal, keys, values):  # type: ignore[no-untyped-def]
    """Add what a point contributes to how pressures change volumes; return the number of pairs that are new."""
    new, free = 0, (0.0, 0.0, 0.0)
    x = ease if not held[v, 0] and abs(moved[v, 0]) < BOX else 0.0
    y = ease if not held[v, 1] and abs(moved[v, 1]) < BOX else 0.0
    z = ease if not held[v, 2] and abs(moved[v, 2]) < BOX else 0.0
    free = (x, y, z)
    for k in range(chunk.many[m]):
        one = chunk.label[m, k]
        if one <= 0:
            continue
        g = corner_of(chunk.gradient, m, k)
        way = (g[0] * free[0], g[1] * free[1], g[2] * free[2])
        diagonal[one] += dot(way, g)
        for w in range(k):
            two = chunk.label[m, w]
            if two <= 0:
                continue
            place, is_new = _place_of(keys, len(diagonal) * min(one, two) + max(one, two))
            new += is_new
            values[place] += dot(way, corner_of(chunk.gradient, m, w))
    return new


@bare_kernel
def _place_of(keys, key):  # type: ignore[no-untyped-def]
    """Return the place of a key in a table of hashes, as many as a power of two, and whether it is new."""
    place = (key * 2654435761 >> 15) & (len(keys) - 1)
    while keys[place] != key:
        if keys[place] < 0:
            keys[place] = key
            return place, True
        place = place + 1 & (len(keys) - 1)
    return place, False


@kernel
def _widened(keys, values):  # type: ignore[no-untyped-def]
    """Return a table of twice the length with the same entries."""
    wide, sums = np.full(2 * len(keys), -1, dtype=np.int64), np.zeros(2 * len(keys))
    for k in range(len(keys)):
        if keys[k] >= 0:
            sums[_place_of(wide, keys[k])[0]] = values[k]
    return wide, sums
