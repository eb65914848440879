"""Which voxels a surface touches, exactly: triangles against closed cubes.

A triangle and a cube are apart when one of 13 axes separates them: the three axes of the cube, the normal of the
triangle and the nine products of their edges (Akenine-Möller 2001, Fast 3D triangle-box overlap testing,
doi:10.1080/10867651.2001.10487535). Comparisons are closed and widened by 1e-9 of a voxel, and by the round-off of the
normal where a triangle is a sliver, so that round-off never loses a touched voxel.
"""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import kernel
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask

#: centers nearer to the surface than this, in voxels, are counted
BAND = 1e-6


def touched_voxels(vertices: Floats, faces: Integers, grid: Grid) -> PackedMask:
    """Return the voxels of a lattice whose closed cube meets a surface of triangles, in the unit of lengths."""
    bits = PackedMask.empty(grid.shape)
    # a copy, since numba compiles for arrays that cannot be written anew
    _mark_touched((vertices - np.array(grid.origin)) / grid.voxel_size, faces.copy(), bits.words, np.array(grid.shape))
    return bits


def near_centers(vertices: Floats, faces: Integers, grid: Grid, band: float) -> tuple[Integers, Floats]:
    """Return indices (k, 3) of voxels with centers within a band around a surface, and their distances (k,), in voxels.

    The surface is in the unit of lengths, the half width of the band in voxels.
    """
    inner = (vertices - np.array(grid.origin)) / grid.voxel_size - 0.5
    found = np.zeros((_note_near(inner, faces, band, grid.shape, np.zeros((0, 3), np.int64), np.zeros(0)), 3), np.int64)
    distance = np.zeros(len(found))
    _note_near(inner, faces, band, grid.shape, found, distance)
    # a center may be near to several triangles: the nearest counts
    order = np.lexsort((distance, *found.T[::-1]))
    found, distance = found[order], distance[order]
    first = np.ones(len(found), dtype=np.bool_)
    first[1:] = (found[1:] != found[:-1]).any(axis=1)
    return found[first], distance[first]


@kernel
def _is_apart(p0, p1, q0, q1, r0, r1, u, v):  # type: ignore[no-untyped-def]
    """Return whether the axis (u, v) in a coordinate plane separates three points from the square of half edge 1/2."""
    p, q, r = p0 * u + p1 * v, q0 * u + q1 * v, r0 * u + r1 * v
    reach = (0.5 + 1e-9) * (abs(u) + abs(v))
    return min(p, q, r) > reach or max(p, q, r) < -reach


@kernel
def _meets_cube(a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return whether a triangle, whose box meets it, meets the unit cube about (x, y, z)."""
    ax, ay, az = a[0] - x, a[1] - y, a[2] - z
    bx, by, bz = b[0] - x, b[1] - y, b[2] - z
    cx, cy, cz = c[0] - x, c[1] - y, c[2] - z
    for e in range(3):
        if e == 0:
            ex, ey, ez = bx - ax, by - ay, bz - az
        elif e == 1:
            ex, ey, ez = cx - bx, cy - by, cz - bz
        else:
            ex, ey, ez = ax - cx, ay - cy, az - cz
        if _is_apart(ay, az, by, bz, cy, cz, -ez, ey):
            return False
        if _is_apart(ax, az, bx, bz, cx, cz, ez, -ex) or _is_apart(ax, ay, bx, by, cx, cy, -ey, ex):
            return False
    return True


@kernel
def scaled_normal(a: Floats, b: Floats, c: Floats) -> tuple[float, float, float, float]:
    """Return the components of the normal, twice the area long, and how far round-off may turn it out of place."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    long = max(abs(ux), abs(uy), abs(uz), abs(vx), abs(vy), abs(vz))
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx, 1e-15 * long * long * long


@kernel
def clip_levels(z: float, slope: float, reach: float, first: int, last: int) -> tuple[int, int]:
    """Return which whole numbers of a range lie within a reach of a height; slope: by how much the plane rises."""
    if (last - first) * abs(slope) <= 4.0 * reach:
        return first, last
    half = reach / abs(slope)
    low, high = np.floor(z - half), np.ceil(z + half)
    return int(max(float(first), min(low, float(last) + 1.0))), int(min(float(last), max(high, float(first) - 1.0)))


@kernel
def _mark_touched(vertices, faces, words, counts):  # type: ignore[no-untyped-def]
    """Mark the touched voxels; vertices in voxels from the corner of the grid."""
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        for k in range(3):
            low[k] = int(min(max(np.ceil(min(a[k], b[k], c[k]) - 1e-9) - 1.0, 0.0), counts[k]))
            high[k] = int(max(min(np.floor(max(a[k], b[k], c[k]) + 1e-9), counts[k] - 1.0), -1.0))
        nx, ny, nz, turned = scaled_normal(a, b, c)
        reach = (0.5 + 1e-9) * (abs(nx) + abs(ny) + abs(nz)) + turned
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                side = nx * (i + 0.5 - a[0]) + ny * (j + 0.5 - a[1])
                # of a large face only the cubes of this column near its plane
                first, last = clip_levels(a[2] - side / nz - 0.5, nz, reach, low[2], high[2])
                for k in range(first, last + 1):
                    q, bit = k >> 6, np.uint64(1) << np.uint64(k & 63)
                    if words[i, j, q] & bit or abs(side + nz * (k + 0.5 - a[2])) > reach:
                        continue
                    if _meets_cube(a, b, c, i + 0.5, j + 0.5, k + 0.5):
                        words[i, j, q] |= bit


@kernel
def _note_near(vertices, faces, band, counts, found, distance):  # type: ignore[no-untyped-def]
    """Count the voxel centers (at whole numbers) within the band of each triangle and note them while there is room."""
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    count = 0
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        for k in range(3):
            low[k] = int(min(max(np.ceil(min(a[k], b[k], c[k]) - band), 0.0), counts[k]))
            high[k] = int(max(min(np.floor(max(a[k], b[k], c[k]) + band), counts[k] - 1.0), -1.0))
        nx, ny, nz, turned = scaled_normal(a, b, c)
        size = np.sqrt(nx * nx + ny * ny + nz * nz)
        for i in range(low[0], high[0] + 1):
            for j in range(low[1], high[1] + 1):
                side = nx * (i - a[0]) + ny * (j - a[1])
                first, last = clip_levels(a[2] - side / nz, nz, band * size + turned, low[2], high[2])
                for k in range(first, last + 1):
                    plane = abs(side + nz * (k - a[2]))
                    if plane > band * size + turned:
                        continue
                    gap = distance_to_triangle(a, b, c, float(i), float(j), float(k))
                    if gap <= band:
                        if count < len(found):
                            found[count, 0], found[count, 1], found[count, 2] = i, j, k
                            distance[count] = gap
                        count += 1
    return count


@kernel
def distance_to_triangle(a: Floats, b: Floats, c: Floats, x: float, y: float, z: float) -> float:
    """Return the distance of a point from a triangle: from its plane where it lies above it, else from its edges."""
    nx, ny, nz, _ = scaled_normal(a, b, c)
    size = nx * nx + ny * ny + nz * nz
    above = size > 0.0
    best = np.inf
    for e in range(3):
        p, q = (a, b) if e == 0 else ((b, c) if e == 1 else (c, a))
        ex, ey, ez = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        tx, ty, tz = x - p[0], y - p[1], z - p[2]
        length = ex * ex + ey * ey + ez * ez
        t = min(1.0, max(0.0, (ex * tx + ey * ty + ez * tz) / length)) if length > 0.0 else 0.0
        gx, gy, gz = tx - t * ex, ty - t * ey, tz - t * ez
        best = min(best, gx * gx + gy * gy + gz * gz)
        turn = nx * (ey * tz - ez * ty) + ny * (ez * tx - ex * tz) + nz * (ex * ty - ey * tx)
        above = above and turn >= 0.0
    if above:
        return abs(nx * (x - a[0]) + ny * (y - a[1]) + nz * (z - a[2])) / np.sqrt(size)
    return np.sqrt(best)
