"""Points on a triangle mesh: random ones, and ones that keep apart (blue noise).

Many random points are tried one after another and stand if no other is nearer than a radius, which is lowered until the
asked number stand (McCool & Fiume 1992, Hierarchical Poisson disk sampling distributions). Open3D eliminates points
from five times as many instead (Yuksel 2015, doi:10.1111/cgf.12538). That takes longer and leaves larger holes
(`python -m benchmarks sampling`), and elimination from points that keep apart already makes their holes larger, too.
"""

import math

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran._base.seeds import philox_block, philox_key, unit_float
from voxgran.geometry.triangles import areas_of

#: random points that are tried for each one that is asked for
TRIED = 24
#: first radius in units of the distance in a hexagonal arrangement (about 0.7 is reached), and factor of the next ones
FIRST, LOWER = 0.9, 0.98
#: edge of the tiles within which points are tried in random order, in the same unit, and number of lists of tiles
TILE, TILES = 16, 4096


def random_points(vertices: Floats, faces: Integers, count: int, *, seed: int) -> Floats:
    """Return random points (count, 3) on a mesh, each in a share of its own of the area, in the order of the faces."""
    corners, points = np.ascontiguousarray(vertices[faces]), np.empty((count, 3))
    _scatter(corners, np.cumsum(areas_of(corners)), *philox_key(seed, "surface points"), points)
    return points


def spread_points(vertices: Floats, faces: Integers, count: int, *, seed: int) -> Floats:
    """Return points (count, 3), at least one, on a mesh that keep apart."""
    points = random_points(vertices, faces, TRIED * count, seed=seed)
    apart = math.sqrt(float(areas_of(vertices[faces]).sum()) * 2 / (math.sqrt(3) * count))
    order = _mixed(points, TILE * apart, *philox_key(seed, "order of surface points"))
    chosen, before = _chosen(points, order, FIRST * apart, count)
    while before == 0 and count > 1:
        # the first radius was too small, as along a needle
        apart *= 2
        chosen, before = _chosen(points, order, FIRST * apart, count)
    # those of the last radius come tile after tile: as many as are needed, evenly from all tiles
    last = before + np.arange(count - before) * (len(chosen) - before) // (count - before)
    return points[np.concatenate([chosen[:before], chosen[last]])]


@kernel
def _scatter(corners, total, key_0, key_1, points):  # type: ignore[no-untyped-def]
    """Write random points on triangles (m, 3, 3), of which `total` (m,) are the sums of the areas."""
    face = 0
    for p in range(len(points)):
        one, two, three, _ = philox_block(key_0, key_1, np.uint64(p), np.uint64(0))
        reached = (p + unit_float(one)) / len(points) * total[-1]
        while face < len(total) - 1 and total[face] <= reached:
            face += 1
        root, share = math.sqrt(unit_float(two)), unit_float(three)
        a, b, c = 1.0 - root, root * (1.0 - share), root * share
        for k in range(3):
            points[p, k] = a * corners[face, 0, k] + b * corners[face, 1, k] + c * corners[face, 2, k]


@kernel
def _mixed(points, edge, key_0, key_1):  # type: ignore[no-untyped-def]
    """Return an order of points, tile after tile, since memory that was just used is fast; random within a tile."""
    tile, start = np.empty(len(points), dtype=np.int64), np.zeros(TILES + 1, dtype=np.int64)
    for p in range(len(points)):
        x, y, z = points[p, 0] / edge, points[p, 1] / edge, points[p, 2] / edge
        tile[p] = _hashed(math.floor(x), math.floor(y), math.floor(z)) & (TILES - 1)
        start[tile[p] + 1] += 1
    start = np.cumsum(start)
    end, order = start.copy(), np.empty(len(points), dtype=np.int64)
    for p in range(len(points)):
        first, size = start[tile[p]], end[tile[p]] - start[tile[p]]
        word = philox_block(key_0, key_1, np.uint64(p), np.uint64(0))[0]
        other = first + np.int64(unit_float(word) * (size + 1))
        order[first + size] = order[other]
        order[other] = p
        end[tile[p]] += 1
    return order


@kernel
def _chosen(points, order, radius, count):  # type: ignore[no-untyped-def]
    """Return the numbers of at least `count` points that keep apart, and how many stand before the last radius.

    The cells are as wide as the first sphere, so that a sphere reaches into 8 of them. Each has a list of the points
    that stand in it; cells of equal hash share one.
    """
    total, edge = len(points), 2.0 * radius
    lists = 64
    while lists < 8 * count:
        lists *= 2
    head, after = np.full(lists, -1, dtype=np.int64), np.empty(total, dtype=np.int64)
    chosen, place = np.empty(total, dtype=np.int64), np.empty((total, 3))
    # squared distance of a point that is known to be near
    known = np.full(total, np.inf)
    number = 0
    while True:
        before, square = number, radius * radius
        for m in range(total):
            if known[m] < square:
                continue
            x, y, z = points[order[m], 0], points[order[m], 1], points[order[m], 2]
            i, j, k = math.floor(x / edge), math.floor(y / edge), math.floor(z / edge)
            di = 1 if x / edge - i > 0.5 else -1
            dj = 1 if y / edge - j > 0.5 else -1
            dk = 1 if z / edge - k > 0.5 else -1
            least = np.inf
            for cell in range(8):
                near = _list_of(i + di * (cell & 1), j + dj * (cell >> 1 & 1), k + dk * (cell >> 2), lists)
                q = head[near]
                while q >= 0:
                    least = min(least, (place[q, 0] - x) ** 2 + (place[q, 1] - y) ** 2 + (place[q, 2] - z) ** 2)
                    q = after[q]
                if least < square:
                    break
            known[m] = least
            if least < square:
                continue
            known[m] = -1.0
            own = _list_of(i, j, k, lists)
            chosen[number], place[number, 0], place[number, 1], place[number, 2] = order[m], x, y, z
            after[number], head[own] = head[own], number
            number += 1
        if number >= count:
            return chosen[:number], before
        radius *= LOWER


@kernel
def _list_of(i, j, k, lists):  # type: ignore[no-untyped-def]
    """Return the list of a cell; lists of the cells of a block of 4 x 4 x 4 lie together."""
    inner = (i & 3) << 4 | (j & 3) << 2 | (k & 3)
    return (_hashed(i >> 2, j >> 2, k >> 2) << 6 | inner) & (lists - 1)


@kernel
def _hashed(i, j, k):  # type: ignore[no-untyped-def]
    """Return a hash of whole numbers, of 32 bits."""
    word = np.uint64(i) * np.uint64(0x9E3779B97F4A7C15)
    word = (word ^ (word >> np.uint64(32)) ^ np.uint64(j)) * np.uint64(0xC2B2AE3D27D4EB4F)
    word = (word ^ (word >> np.uint64(32)) ^ np.uint64(k)) * np.uint64(0x165667B19E3779F9)
    return np.int64(word >> np.uint64(32))
