"""Net of the faces between the voxels of different labels, and the triangles of each label in it.

A corner of voxels is a point of the net where voxels of different labels meet, and a face between two labels is a
quadrangle of four points, which both labels share: the net of Gibson 1998 (Constrained elastic surface nets,
doi:10.1007/BFb0056277) before it is smoothed. Beyond the border of the image lies a label of its own, along periodic
axes the other side of the image.

A label may meet itself along an edge or in a corner. There its triangles get several vertices at the same point, one
for each fan of triangles that go around it, so that the surface of each label is a closed manifold. Voxels of a label
that lie in different tiles (:mod:`voxgran.lattice.label_pieces`) are apart, with faces between them.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.lattice.label_pieces import Tiles

#: what lies beyond a border of the image that does not repeat
BEYOND = -1


class Net(NamedTuple):
    """Points and quadrangles between the labels of an image.

    Half edge 2 a + 1 of a point leads to the next corner of voxels along axis a, and 2 a to the one before.
    """

    at: NDArray[np.int32]  # (n, 3) the corner of voxels that each point is; 1 to m along a periodic axis of m voxels
    near: NDArray[np.int32]  # (n, 6) the next point along each half edge between labels, else -1
    triple: NDArray[np.uint8]  # (n,) bits of the half edges where at least three labels meet
    special: NDArray[np.int32]  # (n,) row in `blocks` where a label needs several vertices or has tiles, else -1
    blocks: NDArray[np.int32]  # (b, 8) labels, or numbers of tiles, of the eight voxels around these points
    quad: NDArray[np.int32]  # (q, 4) points of each quadrangle
    axis: NDArray[np.uint8]  # (q,) axis that it is normal to
    side: NDArray[np.int32]  # (q, 2) labels below and above it


class Split(NamedTuple):
    """Sides of quadrangles by label, of which the triangles of a label are made when they are asked for."""

    sides: NDArray[np.uint32]  # (m,) 2 q + 0 for the lower or 1 for the upper side of quadrangle q
    first: Integers  # (labels + 2,) label k has the rows first[k] to first[k + 1] of them
    joined: Integers  # (b, 2) half edges, as bits, at which voxels of a label are joined, of each block
    # (1 + points + 8 b, 2) the number of calls; the last call in which a point or fan had a vertex, and which
    stamp: NDArray[np.int32]


def net_of(labels: NDArray[np.int32], tiles: Tiles) -> Net:
    """Return the net of an (nx, ny, nz) image of labels above 0, or numbers of tiles, 0 for void."""
    crowded = np.array([_is_crowded(mask) for mask in range(256)])
    quads = _count_quads(labels, tiles.wraps, tiles.across)
    # at least three faces meet in each point; what is not written takes no memory
    net = Net(*_empty(4 * quads // 3, quads))
    points, blocks = _fill_net(labels, tiles.wraps, tiles.across, tiles.label, tiles.labels, crowded, net)
    if len(tiles.label) > tiles.labels + 1:
        net.side[...] = np.where(net.side > 0, tiles.label[net.side], net.side)
    kept = {name: getattr(net, name)[:points] for name in ("at", "near", "triple", "special")}
    return net._replace(**kept, blocks=blocks)


def split_of(net: Net, labels: int) -> Split:
    """Return the sides of quadrangles of labels 1 ... `labels`."""
    joined = _joined_edges(net.special, net.blocks, net.near)
    stamp = np.zeros((1 + len(net.at) + 8 * len(net.blocks), 2), dtype=np.int32)
    sides, first = _sort_sides(net.side, labels)
    return Split(sides, first, joined, stamp)


def triangles_of(
    net: Net, split: Split, label: int, crossed: Booleans
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """Return the triangles (m, 3) of a label, counterclockwise, the points of the net of its vertices, (v,), and the
    label or tile that each vertex belongs to, (v,).

    `crossed`, (q,): quadrangles that are cut from point 1 to 3.
    """
    made: tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]] = _triangles(net, *split, label, crossed)
    return made


def _empty(points: int, quads: int) -> Iterator[NDArray[Any]]:
    """Return arrays for the parts of a net, without blocks."""
    yield np.empty((points, 3), dtype=np.int32)
    yield np.empty((points, 6), dtype=np.int32)
    yield np.empty(points, dtype=np.uint8)
    yield np.empty(points, dtype=np.int32)
    yield np.empty((0, 8), dtype=np.int32)
    yield np.empty((quads, 4), dtype=np.int32)
    yield np.empty(quads, dtype=np.uint8)
    yield np.empty((quads, 2), dtype=np.int32)


@inlined_kernel
def _voxel(axis, side, s, t):  # type: ignore[no-untyped-def]
    """Return the number 4 x + 2 y + z of a voxel around a corner: its sides along an axis and along the next two."""
    return side * (4 >> axis) + s * (4 >> (axis + 1) % 3) + t * (4 >> (axis + 2) % 3)


@inlined_kernel
def _ring(half, q):  # type: ignore[no-untyped-def]
    """Return voxel q of the four in a row around a half edge."""
    return _voxel(half >> 1, half & 1, (0, 1, 1, 0)[q], (0, 0, 1, 1)[q])


@inlined_kernel
def _mask_of(blocks, row, label):  # type: ignore[no-untyped-def]
    """Return which of eight voxels have a label, as bits."""
    mask = 0
    for e in range(8):
        mask |= (blocks[row, e] == label) << e
    return mask


@bare_kernel
def _diagonal(mask, half):  # type: ignore[no-untyped-def]
    """Return -1, unless just two voxels that share nothing but this half edge have the label: which two, 0 or 1."""
    taken = 0
    for q in range(4):
        taken |= (mask >> _ring(half, q) & 1) << q
    return 0 if taken == 5 else (1 if taken == 10 else -1)


@bare_kernel
def _fan_of(mask, joined, row, wanted):  # type: ignore[no-untyped-def]
    """Return the number of the fan that a face at a corner belongs to; faces are 4 axis + 2 s + t.

    `mask`: which voxels have the label.  `joined`, (b, 2): half edges, as bits, at which the one or the other two of
    voxels that meet diagonally are joined instead of kept apart.  With `wanted` = -1 the number of fans is returned.

    Around each half edge the two end faces of a row of voxels of the label follow each other; where two voxels meet
    diagonally, the two faces of each voxel do, or those of each gap where they are joined. Each face thus has one
    follower at each of its two half edges, so that all faces form closed cycles: the fans of a manifold.
    """
    # the least face of each cycle so far, as twelve numbers of four bits
    least = 0
    for face in range(12):
        least |= face << 4 * face
    for half in range(6):
        a, side = half >> 1, half & 1
        x, y = 4 * ((a + 1) % 3) + side, 4 * ((a + 2) % 3) + 2 * side
        d = _diagonal(mask, half)
        turn = joined[row, d] >> half & 1 if d >= 0 else 0
        for q in range(4):
            here = mask >> _ring(half, q) & 1
            if here == turn or here == mask >> _ring(half, (q + 3) % 4) & 1:
                continue
            # a row of voxels starts, or a gap where voxels are joined
            w = 0
            while mask >> _ring(half, (q + w + 1) % 4) & 1 == here:
                w += 1
            # face q of the four lies between voxels q and q + 1
            one, two = (q + 3) % 4, (q + w) % 4
            f = least >> 4 * (x, y + 1, x + 2, y)[one] & 15
            g = least >> 4 * (x, y + 1, x + 2, y)[two] & 15
            for face in range(12):
                if least >> 4 * face & 15 == max(f, g):
                    least += (min(f, g) - max(f, g)) << 4 * face
    count = 0
    for face in range(12):
        a, s, t = face >> 2, face >> 1 & 1, face & 1
        if mask >> _voxel(a, 0, s, t) & 1 != mask >> _voxel(a, 1, s, t) & 1 and least >> 4 * face & 15 == face:
            if wanted >= 0 and least >> 4 * wanted & 15 == face:
                return count
            count += 1
    return count


@kernel
def _is_crowded(mask):  # type: ignore[no-untyped-def]
    """Return whether voxels of one label around a corner need several vertices there."""
    for half in range(6):
        if _diagonal(mask, half) >= 0:
            return True
    return _fan_of(mask, np.zeros((1, 2), dtype=np.int64), 0, -1) > 1


@bare_kernel
def _beyond(wraps, across, axis, number):  # type: ignore[no-untyped-def]
    """Return what lies beyond the end of an axis, of which the first voxel has a number."""
    if not wraps[axis]:
        return BEYOND
    return across[axis, number] if number > 0 else number


@bare_kernel
def _fill_plane(labels, wraps, across, i, plane):  # type: ignore[no-untyped-def]
    """Write plane i - 1 of the image with a layer of what lies around it; before the first voxel of a periodic axis,
    where nothing is asked for, with what lies beyond others.
    """
    nx, ny, nz = labels.shape
    if i == 0 or (i == nx + 1 and not wraps[0]):
        plane[:, :] = BEYOND
        return
    image = labels[(i - 1) % nx]
    for j in range(1, ny + 1):
        for k in range(nz):
            plane[j, k + 1] = image[j - 1, k] if i <= nx else _beyond(wraps, across, 0, image[j - 1, k])
        plane[j, 0] = BEYOND
        plane[j, nz + 1] = _beyond(wraps, across, 2, plane[j, 1])
    for k in range(nz + 2):
        plane[0, k] = BEYOND
        plane[ny + 1, k] = _beyond(wraps, across, 1, plane[1, k])


@kernel
def _count_quads(labels, wraps, across):  # type: ignore[no-untyped-def]
    """Return the number of faces between voxels of different labels, of which one at least is no void."""
    nx, ny, nz = labels.shape
    planes = np.empty((2, ny + 2, nz + 2), dtype=np.int32)
    count = 0
    # a face along a periodic axis lies at the first or at the last corner, and counts once
    _fill_plane(labels, wraps, across, int(wraps[0]), planes[int(wraps[0]) & 1])
    for i in range(int(wraps[0]), nx + 1):
        below, above = planes[i & 1], planes[i + 1 & 1]
        _fill_plane(labels, wraps, across, i + 1, above)
        for j in range(int(wraps[1]), ny + 1):
            for k in range(int(wraps[2]), nz + 1):
                here = below[j, k]
                for other in (above[j, k], below[j + 1, k], below[j, k + 1]):
                    count += here != other and (here > 0 or other > 0)
    return count


@bare_kernel
def _number_plane(below, above, wraps, net, even, ids, n):  # type: ignore[no-untyped-def]
    """Write numbers of the points in a plane of corners between two planes of voxels; return how many there are.

    The parts of the net of these points are made ready. `even`, (nz + 2,), is written: whether the four voxels around
    a line along z are of one label, at each height.
    """
    ny, nz = ids.shape
    for j in range(int(wraps[1]), ny):
        for k in range(nz + 1):
            label = below[j, k]
            even[k] = (below[j + 1, k] == label) & (above[j, k] == label) & (above[j + 1, k] == label)
        for k in range(int(wraps[2]), nz):
            ids[j, k] = -1
            if even[k] and even[k + 1] and below[j, k] == below[j, k + 1]:
                continue
            some = False
            for s in range(2):
                for t in range(2):
                    some |= below[j + s, k + t] > 0 or above[j + s, k + t] > 0
            if some:
                ids[j, k], net.special[n], net.triple[n] = n, -1, 0
                for half in range(6):
                    net.near[n, half] = -1
                n += 1
    # the first corners along a periodic axis are the last ones
    for k in range(nz if wraps[1] else 0):
        ids[0, k] = ids[ny - 1, k]
    for j in range(ny if wraps[2] else 0):
        ids[j, 0] = ids[j, nz - 1]
    return n


@kernel
def _fill_net(labels, wraps, across, owner, most, crowded, net):  # type: ignore[no-untyped-def]
    """Write the net plane by plane; return the number of points, and the blocks. Numbers above `most` are tiles, whose
    labels are `owner`.
    """
    nx, ny, nz = labels.shape
    planes = np.empty((2, ny + 2, nz + 2), dtype=np.int32)
    ids = np.full((3, ny + 1, nz + 1), -1, dtype=np.int32)
    block, blocks = np.empty((1, 8), dtype=np.int32), np.empty((64, 8), dtype=np.int32)
    even = np.empty(nz + 2, dtype=np.bool_)
    n = q = b = 0
    if wraps[0]:
        # the last plane of corners is also the first one
        _fill_plane(labels, wraps, across, nx, planes[0])
        _fill_plane(labels, wraps, across, nx + 1, planes[1])
        n = _number_plane(planes[0], planes[1], wraps, net, even, ids[2], n)
    start = int(wraps[0])
    _fill_plane(labels, wraps, across, start, planes[start & 1])
    for i in range(start, nx + 1):
        below, above = planes[i & 1], planes[i + 1 & 1]
        _fill_plane(labels, wraps, across, i + 1, above)
        before, here = ids[i + 1 & 1], ids[i & 1]
        if i == start and wraps[0]:
            before[:, :] = ids[2]
        if i == nx and wraps[0]:
            here[:, :] = ids[2]
        else:
            n = _number_plane(below, above, wraps, net, even, here, n)
        for j in range(int(wraps[1]), ny + 1):
            for k in range(int(wraps[2]), nz + 1):
                v = here[j, k]
                if v < 0:
                    continue
                for e in range(4):
                    block[0, e] = below[j + (e >> 1), k + (e & 1)]
                    block[0, e + 4] = above[j + (e >> 1), k + (e & 1)]
                net.at[v, 0], net.at[v, 1], net.at[v, 2] = i, j, k
                if _needs_fans(block, crowded, most):
                    if b == len(blocks):
                        blocks = np.concatenate((blocks, np.empty_like(blocks)))
                    net.special[v] = b
                    blocks[b] = block[0]
                    b += 1
                for axis in range(3):
                    # the face of which this is the highest corner
                    low, high = block[0, 0], block[0, 4 >> axis]
                    if low == high or (low <= 0 and high <= 0):
                        continue
                    one, two = (axis + 1) % 3, (axis + 2) % 3
                    for p in range(4):
                        s, t = (1, 0, 0, 1)[p], (1, 1, 0, 0)[p]
                        x = (one == 0) * s + (two == 0) * t
                        y = (one == 1) * s + (two == 1) * t
                        z = (one == 2) * s + (two == 2) * t
                        net.quad[q, p] = before[j - y, k - z] if x else here[j - y, k - z]
                    net.axis[q], net.side[q, 0], net.side[q, 1] = axis, low, high
                    q += 1
                for e in range(8 if len(owner) > most + 1 else 0):
                    if block[0, e] > most:
                        block[0, e] = owner[block[0, e]]
                _link(block, net, v, before[j, k], here[j - 1, k], here[j, k - 1])
    return n, blocks[:b].copy()


@bare_kernel
def _needs_fans(block, crowded, most):  # type: ignore[no-untyped-def]
    """Return whether one of the labels around a corner needs several vertices there, or has tiles."""
    seen = 0
    for e in range(8):
        if seen >> e & 1:
            continue
        label, mask = block[0, e], _mask_of(block, 0, block[0, e])
        if label > most or (label > 0 and crowded[mask]):
            return True
        seen |= mask
    return False


@bare_kernel
def _link(block, net, v, x, y, z):  # type: ignore[no-untyped-def]
    """Link a point with those before it along the axes, where the edge between them bounds different labels: a label
    that is cut between tiles is smoothed as if it were not.
    """
    for axis in range(3):
        w = (x, y, z)[axis]
        a, b = block[0, _ring(2 * axis, 0)], block[0, _ring(2 * axis, 1)]
        c, d = block[0, _ring(2 * axis, 2)], block[0, _ring(2 * axis, 3)]
        if (a == b and b == c and c == d) or max(max(a, b), max(c, d)) <= 0:
            continue
        net.near[v, 2 * axis], net.near[w, 2 * axis + 1] = w, v
        if 1 + (b != a) + (c != a and c != b) + (d != a and d != b and d != c) > 2:
            net.triple[v] |= 1 << 2 * axis
            net.triple[w] |= 2 << 2 * axis


@kernel
def _joined_edges(special, blocks, near):  # type: ignore[no-untyped-def]
    """Return the half edges, as bits, at which two voxels of a label that meet diagonally are joined, (b, 2).

    An edge whose two fans are one at both of its ends would be used twice by the same pair of vertices. Joining the
    voxels there parts these fans at both ends, since all faces point outward.
    """
    joined = np.zeros((len(blocks), 2), dtype=np.int64)
    for v in range(len(special)):
        if special[v] < 0:
            continue
        for half in (1, 3, 5):
            w = near[v, half]
            if w < 0 or special[w] < 0:
                continue
            a, s, r = half >> 1, special[v], special[w]
            for g in range(2):
                label = blocks[s, _ring(half, g)]
                # beyond the end of an axis a label may be another tile
                mask, other = _mask_of(blocks, s, label), _mask_of(blocks, r, blocks[r, _ring(half - 1, g)])
                if label <= 0 or _diagonal(mask, half) != g:
                    continue
                x = 4 * ((a + 1) % 3)
                here = _fan_of(mask, joined, s, x + 1) == _fan_of(mask, joined, s, x + 3)
                there = _fan_of(other, joined, r, x) == _fan_of(other, joined, r, x + 2)
                if here and there:
                    joined[s, g] |= 1 << half
                    joined[r, g] |= 1 << (half - 1)
    return joined


@kernel
def _sort_sides(side, labels):  # type: ignore[no-untyped-def]
    """Return the sides of quadrangles by label, by a counting sort, and the first one of each label."""
    first = np.zeros(labels + 2, dtype=np.int64)
    for q in range(len(side)):
        for s in range(2):
            if side[q, s] > 0:
                first[side[q, s] + 1] += 1
    for label in range(labels + 1):
        first[label + 1] += first[label]
    place, sides = first.copy(), np.empty(first[-1], dtype=np.uint32)
    for q in range(len(side)):
        for s in range(2):
            if side[q, s] > 0:
                sides[place[side[q, s]]] = 2 * q + s
                place[side[q, s]] += 1
    return sides, first


@kernel
def _triangles(net, sides, first, joined, stamp, label, crossed):  # type: ignore[no-untyped-def]
    """Return what `triangles_of` does: a vertex for each point of a label, or for each fan around it."""
    points, rows = len(net.at), first[label + 1] - first[label]
    # each call has a number of its own
    stamp[0, 0] = call = stamp[0, 0] + 1
    triangles = np.empty((2 * rows, 3), dtype=np.int32)
    # a label has at most half a vertex more than faces, and each fan has three or more of them
    point = np.empty(4 * rows // 3 + 1, dtype=np.int32)
    number = np.empty(4 * rows // 3 + 1, dtype=np.int32)
    own = np.zeros(4, dtype=np.int32)
    n = 0
    for t in range(rows):
        side = sides[first[label] + t]
        q, s = side >> 1, side & 1
        for p in range(4):
            v = net.quad[q, p]
            key, b, tile = v, net.special[v], label
            if b >= 0:
                # the face lies above its lower corners
                one, two = (1, 0, 0, 1)[p], (1, 1, 0, 0)[p]
                tile = net.blocks[b, _voxel(net.axis[q], s, one, two)]
                mask = _mask_of(net.blocks, b, tile)
                fan = _fan_of(mask, joined, b, 4 * net.axis[q] + 2 * one + two)
                key = points + 8 * b + _nth(mask, fan)
            if stamp[key + 1, 0] != call:
                stamp[key + 1, 0], stamp[key + 1, 1], point[n], number[n] = call, n, v, tile
                n += 1
            own[p] = stamp[key + 1, 1]
        c = int(crossed[q])
        i, j, k, m = own[c], own[c + 1], own[(c + 2) % 4], own[(c + 3) % 4]
        if s:
            j, m = m, j
        triangles[2 * t, 0], triangles[2 * t, 1], triangles[2 * t, 2] = i, j, k
        triangles[2 * t + 1, 0], triangles[2 * t + 1, 1], triangles[2 * t + 1, 2] = i, k, m
    return triangles, point[:n].copy(), number[:n].copy()


@bare_kernel
def _nth(mask, n):  # type: ignore[no-untyped-def]
    """Return the place of bit n of those that are set, of which there are not fewer than fans."""
    place = 0
    while n > 0 or not mask >> place & 1:
        n -= mask >> place & 1
        place += 1
    return place
