"""Contacts of pairs with a non-convex mesh from points of one surface in the grid of distances of the other, both ways.

It is fast and gives a depth and a direction out of any overlap, but interpolation rounds features smaller than a cell,
and an edge that crosses an edge between their points is missed: gaps are too large by 0.002 diameters (median) and 0.01
(95 %). :mod:`voxgran.contacts.manifolds.triangle_contacts` is exact where surfaces are apart.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.contacts.manifolds.blocks import Blocks, pairs_of_kind
from voxgran.contacts.manifolds.distance_grids import SurfaceBodies
from voxgran.contacts.manifolds.rows import SURFACE, ContactRows, Grains, Search, begin_pair
from voxgran.contacts.manifolds.surface_memory import (
    POINTS,
    SurfaceWork,
    copy_numbers,
    is_kept,
    motion_since,
    spacing_of,
    write_pose,
    write_spread,
)
from voxgran.geometry.vectors import Vector, add, along, rotate, times, vector_at

#: contact points of a pair, at most
MOST = 6
#: distance beyond the margin within which points are listed
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
    """Return the slope of the distance at (x, y, z), in cells; beyond the grid its direction, and the distance from the
    point of the surface that is nearest to the place of the grid that is nearest, 0 within it.
    """
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
    away = 0.0
    if fx != 0.0 or fy != 0.0 or fz != 0.0:
        # interpolation makes slopes beside edges and corners less than 1
        inner = max(p + u * (s - p), 0.0) / max(math.sqrt(gx * gx + gy * gy + gz * gz), FLAT)
        gx, gy, gz = inner * gx + fx, inner * gy + fy, inner * gz + fz
        away = math.sqrt(gx * gx + gy * gy + gz * gz)
        gx, gy, gz = gx / away, gy / away, gz / away
    return gx, gy, gz, away


@inlined_kernel
def grid_bound(bodies: SurfaceBodies, body: int, x: float, y: float, z: float) -> float:
    """Return a lower bound of the distance of a point, in cells, from a body with a grid or of spheres.

    A distance changes by no more than the way between two places, so that the error of the interpolation at a place
    whose shares of the cell are (u, v, w) is at most the root of the sum of u (1 - u), in cells.
    """
    frame, corner = bodies.frame[body], bodies.corner
    if frame[0] == 0.0:
        low = 1e300
        for s in range(bodies.first[body, 3], bodies.first[body + 1, 3]):
            square = (corner[s, 0, 0] - x) ** 2 + (corner[s, 0, 1] - y) ** 2 + (corner[s, 0, 2] - z) ** 2
            low = min(low, math.sqrt(square) - bodies.skin[s, 0])
        return low
    nx, ny, nz, cell = int(frame[0]), int(frame[1]), int(frame[2]), frame[6]
    cx, cy, cz = min(max(x, 0.0), nx - 1.001), min(max(y, 0.0), ny - 1.001), min(max(z, 0.0), nz - 1.001)
    u, v, w = cx - int(cx), cy - int(cy), cz - int(cz)
    error = math.sqrt(u * (1.0 - u) + v * (1.0 - v) + w * (1.0 - w)) + 1e-4
    return abs(_grid_distance(bodies.grid, bodies.first[body, 2], nx, ny, nz, cell, x, y, z)) - error * cell


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


@inlined_kernel
def to_cells(turn: Floats, x: float, y: float, z: float) -> Vector:
    """Return a point of the other grain in the cells of a grid, by the map of `write_turn`."""
    return (
        turn[0] * x + turn[1] * y + turn[2] * z + turn[9],
        turn[3] * x + turn[4] * y + turn[5] * z + turn[10],
        turn[6] * x + turn[7] * y + turn[8] * z + turn[11],
    )


@bare_kernel
def _list_points(work, way, body, guest, reach):  # type: ignore[no-untyped-def]
    """List the points of a guest within reach of the grid of a body; return their number and a bound of the others.

    way: 0 where the body is that of grain i, 1 where it is that of j.  Their distances are written to `found_apart`.
    """
    bodies, turn, listed, some = work.bodies, work.turn[way], work.listed[way], work.listed[1 - way]
    mine, theirs, cluster, rows = work.now[12 + way], work.now[13 - way], bodies.cluster, bodies.cluster_rows
    grid, at, frame, point = bodies.grid, bodies.first[body, 2], bodies.frame[body], bodies.point
    nx, ny, nz, cell = int(frame[0]), int(frame[1]), int(frame[2]), frame[6]
    # whatever is looked at is written, and counts if it is near, so that no branch waits for a distance
    q, last, heads, low = bodies.first[guest, 1], bodies.first[guest + 1, 1], 0, 1e9
    while q < last:
        x, y, z = to_cells(turn, cluster[q, 0], cluster[q, 1], cluster[q, 2])
        distance = _grid_distance(grid, at, nx, ny, nz, cell, x, y, z) * mine - cluster[q, 3] * theirs
        some[heads] = q
        heads += 1 if distance <= reach else 0
        low = min(low, distance if distance > reach else 1e9)
        q = rows[q, 2]
    end = heads
    for n in range(heads):
        for q in range(some[n] + 1, rows[some[n], 2]):
            x, y, z = to_cells(turn, cluster[q, 0], cluster[q, 1], cluster[q, 2])
            distance = _grid_distance(grid, at, nx, ny, nz, cell, x, y, z) * mine - cluster[q, 3] * theirs
            some[end] = q
            end += 1 if distance <= reach else 0
            low = min(low, distance if distance > reach else 1e9)
    count = 0
    for n in range(heads, end):
        for s in range(rows[some[n], 0], rows[some[n], 1]):
            x, y, z = to_cells(turn, point[s, 0], point[s, 1], point[s, 2])
            distance = _grid_distance(grid, at, nx, ny, nz, cell, x, y, z) * mine - point[s, 3] * theirs
            listed[count], work.found_apart[count] = s, distance
            count += 1 if distance <= reach else 0
            low = min(low, distance if distance > reach else 1e9)
    return count, low


@bare_kernel
def _look(work, way, body, count, near, known, k):  # type: ignore[no-untyped-def]
    """Write the listed points that are within `near`, in the frame of the body with the grid.

    known: whether their distances are in `found_apart`.  A candidate is point (3), outward normal (3) of the grid and
    gap.  Returns the number and the least gap.
    """
    bodies, turn, listed = work.bodies, work.turn[way], work.listed[way]
    mine, theirs, point, low = work.now[12 + way], work.now[13 - way], bodies.point, 1e9
    grid, at, frame = bodies.grid, bodies.first[body, 2], bodies.frame[body]
    nx, ny, nz, cell = int(frame[0]), int(frame[1]), int(frame[2]), frame[6]
    if not known:
        for n in range(count):
            s = listed[n]
            x, y, z = to_cells(turn, point[s, 0], point[s, 1], point[s, 2])
            distance = _grid_distance(grid, at, nx, ny, nz, cell, x, y, z) * mine - point[s, 3] * theirs
            work.found_apart[n] = distance
    kept = 0
    for n in range(count):
        distance = work.found_apart[n]
        low = min(low, distance)
        listed[kept], work.found_apart[kept] = listed[n], distance
        kept += 1 if distance < near else 0
    for n in range(kept):
        s = listed[n]
        x, y, z = to_cells(turn, point[s, 0], point[s, 1], point[s, 2])
        gx, gy, gz, away = _grid_slope(grid, at, nx, ny, nz, cell, x, y, z)
        length = math.sqrt(gx * gx + gy * gy + gz * gz)
        # beyond the grid the distance that was found is a lower bound, by up to its fringe below the true one
        gap = away * mine - point[s, 3] * theirs if away > 0.0 else work.found_apart[n]
        if length < FLAT or gap >= near:
            continue
        row = work.candidate[k]
        row[0], row[1], row[2] = x, y, z
        row[3], row[4], row[5], row[6] = gx / length, gy / length, gz / length, gap
        row[7] = point[s, 3] * theirs
        k += 1
    return k, low


@bare_kernel
def _place(grains, i, frame, way, offset, candidate, first, last):  # type: ignore[no-untyped-def]
    """Turn candidates into the frame of the bed: place on the surface of i, from its centroid, and normal from i.

    i: the grain with the grid.
    """
    turn, scale, cell = grains.matrix[i], grains.scale[i], frame[6]
    for k in range(first, last):
        row = candidate[k]
        gap, skin, normal = row[6], row[7], vector_at(row, 3)
        # along the normal of the grid the surface with the skin lies before the point
        place = times(along(vector_at(frame, 3), cell, vector_at(row, 0)), scale)
        place = along(place, -skin, normal)
        if way == 0:
            place = along(place, -gap, normal)
        place, normal = rotate(turn, place), rotate(turn, normal)
        if way == 1:
            place, normal = add(place, offset), times(normal, -1.0)
        row[0], row[1], row[2] = place
        row[3], row[4], row[5] = normal


@bare_kernel
def field_candidates(
    grains: Grains, work: SurfaceWork, p: int, i: int, j: int, offset: Vector, near: float
) -> tuple[int, float]:
    """Write the candidates of a pair whose pose is in `work.now`; return their number and a bound of the gap."""
    bodies, pose, key, old = work.bodies, work.now, work.key[p, 0], work.pose[p, 0]
    kept = is_kept(key, i, j)
    clear = 1e9
    if kept:
        clear = old[14] - motion_since(pose, old, grains.radius[i], grains.radius[j])
        kept = clear >= near
    if not kept:
        clear = 1e9
    slack = min(SLACK, 0.1 * min(grains.radius[i], grains.radius[j]))
    k, low, many = 0, 1e9, 0
    for way in range(2):
        one, other = (i, j) if way == 0 else (j, i)
        body, frame, listed = grains.shape[one], bodies.frame[grains.shape[one]], work.listed[way]
        if frame[0] == 0.0:
            if not kept:
                key[2 + way] = 0
            continue
        write_turn(frame, way, pose, work.turn[way])
        if kept:
            count = key[2 + way]
            for q in range(count):
                listed[q] = work.leaf[p, many + q]
        else:
            count, apart = _list_points(work, way, body, grains.shape[other], near + slack)
            clear = min(clear, apart)
            key[2 + way] = count
            for q in range(min(count, POINTS - many)):
                work.leaf[p, many + q] = listed[q]
        many += count
        start = k
        k, least = _look(work, way, body, count, near, not kept, k)
        low = min(low, least)
        _place(grains, one, frame, way, offset, work.candidate, start, k)
    if not kept:
        key[0], key[1] = i if many <= POINTS else -1, j
        copy_numbers(old, pose, 14)
        old[14] = clear
    return k, min(low, clear)


def find_surface_contacts(search: Search, work: Blocks[SurfaceWork], rows: ContactRows, m: int) -> int:
    """Write the contacts of the pairs with a non-convex mesh from row m on; return the new number of rows.

    work: `SurfaceWork` for at least as many pairs. Of the pairs those whose larger kind is SURFACE are looked at.

    Returns -1 if the rows are full; what was known of pairs is then to be restored.
    """
    return work.find(_find, search, rows, m, chosen=pairs_of_kind(search.grains, search.pairs, SURFACE))


@kernel
def _find(search, work, rows, m, begin, end):  # type: ignore[no-untyped-def]
    """Write the contacts of the pairs from `begin` to `end` - 1; return the next row, or -1."""
    grains, pairs = search.grains, search.pairs
    for p in range(begin, end):
        near, pair = begin_pair(search, p, m, SURFACE, search.margin + pairs.room[p])
        if not near:
            continue
        write_pose(grains, pair.i, pair.j, pair.offset, work.now)
        k, low = field_candidates(grains, work, p, pair.i, pair.j, pair.offset, pair.reach)
        pairs.bound[p] = low
        m = write_spread(
            rows, m, pair, work.candidate, k, MOST, spacing_of(grains.radius[pair.i], grains.radius[pair.j])
        )
        if m < 0:
            return -1
        pairs.count[p] = m - pairs.first[p]
    return m
