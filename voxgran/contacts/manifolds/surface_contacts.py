"""Contacts of pairs with a non-convex mesh from points of one surface in the grid of distances of the other, both ways.

It is fast and gives a depth and a direction out of any overlap, but interpolation rounds features smaller than a cell,
and an edge that crosses an edge between their points is missed: gaps are too large by 0.002 diameters (median) and 0.01
(95 %). :mod:`voxgran.contacts.manifolds.triangle_contacts` is exact where surfaces are apart.
"""

import math

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.contacts.manifolds.blocks import Blocks, pairs_of_kind
from voxgran.contacts.manifolds.distance_grids import SurfaceBodies
from voxgran.contacts.manifolds.rows import SURFACE, ContactRows, Grains, PairList
from voxgran.contacts.manifolds.surface_memory import (
    LEAVES,
    SurfaceWork,
    copy_numbers,
    is_kept,
    motion_since,
    spacing_of,
    write_pose,
    write_spread,
)

#: contact points of a pair, at most
MOST = 6
#: distance beyond the margin within which clusters are listed
SLACK = 0.02
#: slope of a grid below which it gives no direction
FLAT = 0.1


@inlined_kernel
def _grid_distance(grid, at, nx, ny, nz, cell, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance at (x, y, z), in cells; beyond the grid a lower bound of it."""
    cx, cy, cz = min(max(x, 0.0), nx - 1.001), min(max(y, 0.0), ny - 1.001), min(max(z, 0.0), nz - 1.001)
    i, j, k = int(cx), int(cy), int(cz)
    u, v, w = cx - i, cy - j, cz - k
    q = at + (i * ny + j) * nz + k
    r = q + ny * nz
    a, b = grid[q] + w * (grid[q + 1] - grid[q]), grid[q + nz] + w * (grid[q + nz + 1] - grid[q + nz])
    c, d = grid[r] + w * (grid[r + 1] - grid[r]), grid[r + nz] + w * (grid[r + nz + 1] - grid[r + nz])
    a, c = a + v * (b - a), c + v * (d - c)
    distance = a + u * (c - a)
    far = (x - cx) ** 2 + (y - cy) ** 2 + (z - cz) ** 2
    if far > 0.0:
        # all of the surface lies beyond the place of the grid that is nearest
        distance = math.sqrt(max(distance, 0.0) ** 2 + far * cell * cell)
    return distance


@bare_kernel
def _grid_slope(grid, at, nx, ny, nz, cell, x, y, z):  # type: ignore[no-untyped-def]
    """Return the slope of the distance at (x, y, z), in cells."""
    cx, cy, cz = min(max(x, 0.0), nx - 1.001), min(max(y, 0.0), ny - 1.001), min(max(z, 0.0), nz - 1.001)
    i, j, k = int(cx), int(cy), int(cz)
    u, v, w = cx - i, cy - j, cz - k
    q = at + (i * ny + j) * nz + k
    r = q + ny * nz
    a00, a01, a10, a11 = grid[q], grid[q + 1], grid[q + nz], grid[q + nz + 1]
    b00, b01, b10, b11 = grid[r], grid[r + 1], grid[r + nz], grid[r + nz + 1]
    p0, p1, q0, q1 = a00 + w * (a01 - a00), a10 + w * (a11 - a10), b00 + w * (b01 - b00), b10 + w * (b11 - b10)
    p, s = p0 + v * (p1 - p0), q0 + v * (q1 - q0)
    e0, e1 = (a01 - a00) + v * ((a11 - a10) - (a01 - a00)), (b01 - b00) + v * ((b11 - b10) - (b01 - b00))
    gx, gy, gz = (s - p) / cell, ((p1 - p0) + u * ((q1 - q0) - (p1 - p0))) / cell, (e0 + u * (e1 - e0)) / cell
    fx, fy, fz = (x - cx) * cell, (y - cy) * cell, (z - cz) * cell
    far = math.sqrt(fx * fx + fy * fy + fz * fz)
    if far > 0.0:
        inner = max(p + u * (s - p), 0.0)
        gx, gy, gz = inner * gx + fx, inner * gy + fy, inner * gz + fz
        length = math.sqrt(gx * gx + gy * gy + gz * gz)
        gx, gy, gz = gx / length, gy / length, gz / length
    return gx, gy, gz


@bare_kernel
def grid_bound(
    grid: NDArray[np.float32], at: int, frame: Floats, corner: Floats, skin: Floats, first: int, last: int, x: float,
    y: float, z: float,
) -> float:  # fmt: skip
    """Return a lower bound of the distance of a point, in cells, from a body with a grid or of spheres first to last.

    A distance changes by no more than the way between two places, so that the error of the interpolation at a place
    whose shares of the cell are (u, v, w) is at most the root of the sum of u (1 - u), in cells.
    """
    if frame[0] == 0.0:
        low = 1e300
        for s in range(first, last):
            square = (corner[s, 0, 0] - x) ** 2 + (corner[s, 0, 1] - y) ** 2 + (corner[s, 0, 2] - z) ** 2
            low = min(low, math.sqrt(square) - skin[s, 0])
        return low
    nx, ny, nz, cell = int(frame[0]), int(frame[1]), int(frame[2]), frame[6]
    cx, cy, cz = min(max(x, 0.0), nx - 1.001), min(max(y, 0.0), ny - 1.001), min(max(z, 0.0), nz - 1.001)
    u, v, w = cx - int(cx), cy - int(cy), cz - int(cz)
    error = math.sqrt(u * (1.0 - u) + v * (1.0 - v) + w * (1.0 - w)) + 1e-4
    return abs(_grid_distance(grid, at, nx, ny, nz, cell, x, y, z)) - error * cell


@bare_kernel
def write_turn(frame: Floats, way: int, pose: Floats, turn: Floats) -> None:
    """Write the map of points of the other grain to the cells of the grid of a body: way 0 of j to i, 1 of i to j."""
    cell = frame[6]
    mine, theirs = pose[12 + way], pose[13 - way]
    f = 1.0 / (mine * cell)
    for r in range(3):
        x = pose[r]
        if way == 1:
            x = -(pose[3 + r] * pose[0] + pose[6 + r] * pose[1] + pose[9 + r] * pose[2])
        turn[9 + r] = x * f - frame[3 + r] / cell
        for c in range(3):
            turn[3 * r + c] = (pose[3 + 3 * r + c] if way == 0 else pose[3 + 3 * c + r]) * theirs * f


@bare_kernel
def _list_clusters(  # type: ignore[no-untyped-def]
    turn, mine, theirs, grid, at, frame, cluster, rows, first, last, reach, listed,
):  # fmt: skip
    """List the clusters within reach of the grid of a body; return their number and a bound of the others."""
    nx, ny, nz, cell = int(frame[0]), int(frame[1]), int(frame[2]), frame[6]
    q, count, low = first, 0, 1e9
    while q < last:
        px, py, pz = cluster[q, 0], cluster[q, 1], cluster[q, 2]
        x = turn[0] * px + turn[1] * py + turn[2] * pz + turn[9]
        y = turn[3] * px + turn[4] * py + turn[5] * pz + turn[10]
        z = turn[6] * px + turn[7] * py + turn[8] * pz + turn[11]
        distance = _grid_distance(grid, at, nx, ny, nz, cell, x, y, z) * mine - cluster[q, 3] * theirs
        if distance > reach:
            low = min(low, distance)
            q = rows[q, 2]
            continue
        if rows[q, 0] >= 0:
            listed[count] = q
            count += 1
        q += 1
    return count, low


@bare_kernel
def _look(  # type: ignore[no-untyped-def]
    turn, mine, theirs, grid, at, frame, cluster, rows, listed, count, point, near, candidate, k,
):  # fmt: skip
    """Write the points of listed clusters that are within `near`, in the frame of the body with the grid.

    A candidate is point (3), outward normal (3) of the grid and gap.  Returns the number and the least gap.
    """
    nx, ny, nz, cell = int(frame[0]), int(frame[1]), int(frame[2]), frame[6]
    low = 1e9
    for n in range(count):
        q = listed[n]
        px, py, pz = cluster[q, 0], cluster[q, 1], cluster[q, 2]
        x = turn[0] * px + turn[1] * py + turn[2] * pz + turn[9]
        y = turn[3] * px + turn[4] * py + turn[5] * pz + turn[10]
        z = turn[6] * px + turn[7] * py + turn[8] * pz + turn[11]
        distance = _grid_distance(grid, at, nx, ny, nz, cell, x, y, z) * mine - cluster[q, 3] * theirs
        if distance > near:
            low = min(low, distance)
            continue
        for s in range(rows[q, 0], rows[q, 1]):
            px, py, pz = point[s, 0], point[s, 1], point[s, 2]
            x = turn[0] * px + turn[1] * py + turn[2] * pz + turn[9]
            y = turn[3] * px + turn[4] * py + turn[5] * pz + turn[10]
            z = turn[6] * px + turn[7] * py + turn[8] * pz + turn[11]
            distance = _grid_distance(grid, at, nx, ny, nz, cell, x, y, z) * mine - point[s, 3] * theirs
            low = min(low, distance)
            if distance < near:
                gx, gy, gz = _grid_slope(grid, at, nx, ny, nz, cell, x, y, z)
                length = math.sqrt(gx * gx + gy * gy + gz * gz)
                if length < FLAT:
                    continue
                row = candidate[k]
                row[0], row[1], row[2] = x, y, z
                row[3], row[4], row[5], row[6] = gx / length, gy / length, gz / length, distance
                row[7] = point[s, 3] * theirs
                k += 1
    return k, low


@bare_kernel
def _place(turn, scale, frame, way, offset, candidate, first, last):  # type: ignore[no-untyped-def]
    """Turn candidates into the frame of the bed: place on the surface of i, from its centroid, and normal from i."""
    ox, oy, oz, cell = frame[3], frame[4], frame[5], frame[6]
    for k in range(first, last):
        row = candidate[k]
        gap, skin = row[6], row[7]
        # along the normal of the grid the surface with the skin lies before the point
        x = scale * (row[0] * cell + ox) - skin * row[3]
        y = scale * (row[1] * cell + oy) - skin * row[4]
        z = scale * (row[2] * cell + oz) - skin * row[5]
        u, v, w = row[3], row[4], row[5]
        if way == 0:
            x, y, z = x - gap * u, y - gap * v, z - gap * w
        for r in range(3):
            row[r] = turn[r, 0] * x + turn[r, 1] * y + turn[r, 2] * z
            row[3 + r] = turn[r, 0] * u + turn[r, 1] * v + turn[r, 2] * w
            if way == 1:
                row[r] += offset[r]
                row[3 + r] = -row[3 + r]


@bare_kernel
def field_candidates(
    grains: Grains, bodies: SurfaceBodies, work: SurfaceWork, p: int, i: int, j: int, offset: Floats, near: float,
) -> tuple[int, float]:  # fmt: skip
    """Write the candidates of a pair whose pose is in `work.now`; return their number and a bound of the gap."""
    pose, key, old = work.now, work.key[p, 0], work.pose[p, 0]
    kept = is_kept(key, i, j)
    clear = 1e9
    if kept:
        clear = old[14] - motion_since(pose, old, grains.radius[i], grains.radius[j])
        kept = clear >= near
    if not kept:
        clear = 1e9
    slack = min(SLACK, 0.1 * min(grains.radius[i], grains.radius[j]))
    k, low, fits = 0, 1e9, True
    for way in range(2):
        one, other = (i, j) if way == 0 else (j, i)
        body, guest = grains.shape[one], grains.shape[other]
        frame = bodies.frame[body]
        if frame[0] == 0.0:
            if not kept:
                key[2 + way] = 0
            continue
        turn = work.turn[way]
        write_turn(frame, way, pose, turn)
        mine, theirs = grains.scale[one], grains.scale[other]
        at, listed = bodies.first[body, 2], work.listed[way]
        if kept:
            count = key[2 + way]
            for q in range(count):
                listed[q] = work.leaf[p, way * LEAVES + q]
        else:
            count, apart = _list_clusters(
                turn, mine, theirs, bodies.grid, at, frame, bodies.cluster, bodies.cluster_rows,
                bodies.first[guest, 1], bodies.first[guest + 1, 1], near + slack, listed,
            )  # fmt: skip
            clear = min(clear, apart)
            fits = fits and count <= LEAVES
            key[2 + way] = count
            for q in range(min(count, LEAVES)):
                work.leaf[p, way * LEAVES + q] = listed[q]
        start = k
        k, least = _look(
            turn, mine, theirs, bodies.grid, at, frame, bodies.cluster, bodies.cluster_rows, listed, count,
            bodies.point, near, work.candidate, k,
        )  # fmt: skip
        low = min(low, least)
        _place(grains.matrix[one], mine, frame, way, offset, work.candidate, start, k)
    if not kept:
        key[0], key[1] = i if fits else -1, j
        copy_numbers(old, pose, 14)
        old[14] = clear
    return k, min(low, clear)


def find_surface_contacts(
    grains: Grains, bodies: SurfaceBodies, work: Blocks[SurfaceWork], pairs: PairList, size: int,
    rows: ContactRows, m: int, margin: float, rest: float,
) -> int:  # fmt: skip
    """Write the contacts of the pairs with a non-convex mesh from row m on; return the new number of rows.

    grains: `Grains`.  bodies: `SurfaceBodies` of their shapes.  work: `SurfaceWork` for at least `size` pairs.
    pairs: `PairList`, of which the first `size` are looked at where the larger kind is SURFACE.  rows: `ContactRows`.
    margin: gap up to which contacts are written.  rest: what is subtracted, with the room of the pair, from the gaps.

    Returns -1 if the rows are full; what was known of pairs is then to be restored.
    """

    def find(own: SurfaceWork, part: ContactRows, start: int, first: int, last: int) -> int:
        return int(_find(grains, bodies, own, pairs, part, start, margin, rest, first, last))

    chosen = pairs_of_kind(grains, pairs, size, SURFACE)
    return work.find(find, pairs=pairs, chosen=chosen, rows=rows, m=m)


@kernel
def _find(grains, bodies, work, pairs, rows, m, margin, rest, begin, end):  # type: ignore[no-untyped-def]
    """Write the contacts of the pairs from `begin` to `end` - 1; return the next row, or -1."""
    offset = work.now[16:19]
    for p in range(begin, end):
        i, j = pairs.i[p], pairs.j[p]
        if max(grains.kind[i], grains.kind[j]) != SURFACE:
            continue
        first, count = pairs.first[p], pairs.count[p]
        pairs.first[p], pairs.count[p] = m, 0
        near = margin + pairs.room[p]
        way = grains.way[i] + grains.way[j]
        if pairs.bound[p] - (way - pairs.way[p]) > near:
            continue
        square = 0.0
        for r in range(3):
            offset[r] = grains.position[j, r] + pairs.shift[p, r] - grains.position[i, r]
            square += offset[r] * offset[r]
        pairs.way[p] = way
        reach = grains.radius[i] + grains.radius[j]
        if square > (reach + near) ** 2:
            pairs.bound[p] = math.sqrt(square) - reach
            continue
        write_pose(grains.matrix, grains.scale, i, j, offset, work.now)
        k, low = field_candidates(grains, bodies, work, p, i, j, offset, near)
        pairs.bound[p] = low
        if k == 0:
            continue
        spacing = spacing_of(grains.radius[i], grains.radius[j])
        after = write_spread(
            rows, m, i, j, offset, work.candidate, k, MOST, near, rest + pairs.room[p], spacing, first, count
        )
        if after < 0:
            return -1
        if after > m:
            for r in range(3):
                pairs.normal[p, r] = rows.row[m, r]
        pairs.count[p] = after - m
        m = after
    return m
