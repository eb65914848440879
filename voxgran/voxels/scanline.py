"""Columns of a lattice through triangles: inside by parity, or by winding number where parts overlap.

A plane of columns cuts each triangle in a segment, and each column that the segment spans meets the triangle at one
height. The ends of the segment lie on edges of the triangle and are computed from left to right, whichever triangle
asks; so both triangles of an edge get the same bits, and half-open ranges give every column an even number of
crossings: a closed surface cannot leak. A crossing toggles one bit of a word of 64 voxels, and six shifts carry the
parity through the word. Columns lie along z. A center that lies on the surface counts as if it lay an infinitesimal
step further along x, y and z; so solids that touch share no voxel and leave none out. Corner points are rounded to a
1e-10 of a voxel, so that this holds where their coordinates differ by round-off.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.compiling.threads import in_blocks
from voxgran._base.errors import DirtyMeshError
from voxgran._base.kernels import kernel
from voxgran.lattice.grid import Grid
from voxgran.lattice.packed import PackedMask

#: corner points are rounded to so many parts of a voxel, so that faces on voxel centers are there despite round-off
FINEST = 2.0**33
#: voxels whose winding numbers are in memory at a time
SLAB = 2**22
#: voxels of which a thread takes no fewer
LEAST_VOXELS = 2**22


def scanline_inside(vertices: Floats, faces: Integers, grid: Grid) -> PackedMask:
    """Return the voxels of a lattice whose center lies inside a closed surface.

    Raises
    ------
    DirtyMeshError
        If a column of centers crosses the surface an odd number of times: it has a hole.
    """
    bits, odd = centers_inside((vertices - np.array(grid.origin)) / grid.voxel_size, faces, grid.shape)
    if odd:
        raise DirtyMeshError(
            f"the surface leaves {odd} columns of voxels open: a solid must be closed; mend it with "
            "voxgran.repair, or take voxgran.voxelize_mesh, which settles small holes"
        )
    return bits


def centers_inside(vertices: Floats, faces: Integers, counts: tuple[int, int, int]) -> tuple[PackedMask, int]:
    """Return the voxels whose center is inside a closed surface, by parity, and the number of open columns.

    Vertices are in voxels from the corner of a lattice of `counts` voxels, and triangles have any orientation. Open
    columns cross the surface an odd number of times from below the lattice to its top.
    """
    bits = PackedMask.empty(counts)
    above = np.zeros(counts[:2], dtype=np.bool_)
    least = max(1, LEAST_VOXELS // max(counts[1] * counts[2], 1))
    in_blocks(_toggle, counts[0], _settled(vertices), faces.copy(), bits.words, counts[2], above, least=least)
    odd = np.zeros(counts[0], dtype=np.int64)
    in_blocks(_carry, counts[0], bits.words, counts[2], above, odd, least=least)
    return bits, int(odd.sum())


def winding_slabs(
    vertices: Floats, faces: Integers, counts: tuple[int, int, int]
) -> Iterator[tuple[int, NDArray[np.int32], NDArray[np.int32]]]:
    """Yield the winding numbers of oriented triangles about voxel centers, slab by slab; arguments as
    :func:`centers_inside`.

    Yielded are the first plane of the slab; the (thick, ny, nz) crossings below each center, those into the solid minus
    those out of it; and the (thick, ny) crossings of each column as a whole, not 0 where the surface is open.
    """
    inner = _settled(vertices)
    spans = inner[:, 0][faces]
    low, high = spans.min(axis=1, initial=np.inf), spans.max(axis=1, initial=-np.inf)
    thick = max(1, SLAB // (counts[1] * counts[2]))
    for begin in range(0, counts[0], thick):
        planes = min(thick, counts[0] - begin)
        near = faces[(high > begin) & (low <= begin + planes)]
        numbers = np.zeros((planes, *counts[1:]), dtype=np.int32)
        total = np.zeros((planes, counts[1]), dtype=np.int32)
        _wind(inner - np.array([float(begin), 0.0, 0.0]), near, numbers, total)
        np.cumsum(numbers, axis=2, out=numbers)
        yield begin, numbers, total


def _settled(vertices: Floats) -> Floats:
    """Return corner points with voxel centers at whole numbers, rounded; the same points stay the same."""
    inner = vertices * FINEST
    np.rint(inner, out=inner)
    inner /= FINEST
    inner -= 0.5
    return inner


@kernel
def _first_last(low, high, count):  # type: ignore[no-untyped-def]
    """Return the first and last whole number at or above `low` and below `high`, of 0 ... count - 1."""
    return int(min(max(np.ceil(low), 0.0), count)), int(max(min(np.ceil(high) - 1.0, count - 1.0), -1.0))


@kernel
def _ordered(vertices, a, b, c):  # type: ignore[no-untyped-def]
    """Return the corners of a triangle by rising x, and whether the order runs against that of the face."""
    turned = False
    if vertices[a, 0] > vertices[b, 0]:
        a, b, turned = b, a, not turned
    if vertices[b, 0] > vertices[c, 0]:
        b, c, turned = c, b, not turned
    if vertices[a, 0] > vertices[b, 0]:
        a, b, turned = b, a, not turned
    return a, b, c, turned


@kernel
def _sides(vertices, a, b, c):  # type: ignore[no-untyped-def]
    """Return each side of a triangle, whose corners are given by rising x, as start x, y, z and 1 / length, dy, dz."""
    ax, ay, az = vertices[a, 0], vertices[a, 1], vertices[a, 2]
    bx, by, bz = vertices[b, 0], vertices[b, 1], vertices[b, 2]
    cx, cy, cz = vertices[c, 0], vertices[c, 1], vertices[c, 2]
    long = ax, ay, az, 1.0 / (cx - ax), cy - ay, cz - az
    first = ax, ay, az, 1.0 / (bx - ax), by - ay, bz - az
    return long, first, (bx, by, bz, 1.0 / (cx - bx), cy - by, cz - bz)


@kernel
def _on_side(side, x):  # type: ignore[no-untyped-def]
    """Return y and z where a side, which runs from left to right, passes x."""
    t = (x - side[0]) * side[3]
    return side[1] + t * side[4], side[2] + t * side[5]


@kernel
def _segment(long, first, second, x):  # type: ignore[no-untyped-def]
    """Return the ends (y, z) of the cut at x by rising y, and whether the middle corner lies on the upper side."""
    y_1, z_1 = _on_side(long, x)
    y_2, z_2 = _on_side(second if second[0] <= x else first, x)
    if y_1 <= y_2:
        return y_1, z_1, y_2, z_2, True
    return y_2, z_2, y_1, z_1, False


@kernel
def _toggle(vertices, faces, words, nz, above, from_plane, to_plane):  # type: ignore[no-untyped-def]
    """Toggle a bit where a column of some planes crosses a triangle; centers at whole numbers."""
    ny = words.shape[1]
    for f in range(len(faces)):
        a, b, c, _ = _ordered(vertices, faces[f, 0], faces[f, 1], faces[f, 2])
        begin, end = _first_last(vertices[a, 0], vertices[c, 0], to_plane)
        begin = max(begin, from_plane)
        ya, yb, yc = vertices[a, 1], vertices[b, 1], vertices[c, 1]
        lowest, highest = _first_last(min(ya, yb, yc), max(ya, yb, yc), ny)
        if begin > end or lowest > highest:
            continue
        long, first, second = _sides(vertices, a, b, c)
        for i in range(begin, end + 1):
            y_1, z_1, y_2, z_2, _ = _segment(long, first, second, float(i))
            lowest, highest = _first_last(y_1, y_2, ny)
            if lowest > highest:
                continue
            slope = (z_2 - z_1) / (y_2 - y_1)
            floor, ceiling = max(min(z_1, z_2), 0.0), max(z_1, z_2)
            for j in range(lowest, highest + 1):
                z = np.ceil(max(min(z_1 + (j - y_1) * slope, ceiling), floor))
                if z < nz:
                    k = np.uint64(np.int64(z))
                    words[i, j, k >> np.uint64(6)] ^= np.uint64(1) << (k & np.uint64(63))
                else:
                    above[i, j] ^= True


@kernel
def _carry(words, nz, above, odd, from_plane, to_plane):  # type: ignore[no-untyped-def]
    """Carry the parity up each column of some planes; count the columns of each plane that end inside."""
    _, ny, many = words.shape
    full = np.uint64(0xFFFFFFFFFFFFFFFF)
    last = full if nz % 64 == 0 else (np.uint64(1) << np.uint64(nz % 64)) - np.uint64(1)
    for i in range(from_plane, to_plane):
        for j in range(ny):
            inside = np.uint64(0)
            for q in range(many):
                word = words[i, j, q]
                if word != 0:
                    word ^= word << np.uint64(1)
                    word ^= word << np.uint64(2)
                    word ^= word << np.uint64(4)
                    word ^= word << np.uint64(8)
                    word ^= word << np.uint64(16)
                    word ^= word << np.uint64(32)
                word ^= inside
                words[i, j, q] = word
                inside = full if word >> np.uint64(63) else np.uint64(0)
            words[i, j, many - 1] &= last
            odd[i] += (inside != 0) != above[i, j]


@kernel
def _wind(vertices, faces, numbers, total):  # type: ignore[no-untyped-def]
    """Add up the crossings of columns, +1 into the solid; centers at whole numbers."""
    nx, ny, nz = numbers.shape
    for f in range(len(faces)):
        a, b, c, turned = _ordered(vertices, faces[f, 0], faces[f, 1], faces[f, 2])
        begin, end = _first_last(vertices[a, 0], vertices[c, 0], nx)
        if begin > end:
            continue
        long, first, second = _sides(vertices, a, b, c)
        for i in range(begin, end + 1):
            y_1, z_1, y_2, z_2, upper = _segment(long, first, second, float(i))
            lowest, highest = _first_last(y_1, y_2, ny)
            slope = (z_2 - z_1) / (y_2 - y_1)
            floor, ceiling = max(min(z_1, z_2), 0.0), max(z_1, z_2)
            step = 1 if upper != turned else -1
            for j in range(lowest, highest + 1):
                z = np.ceil(max(min(z_1 + (j - y_1) * slope, ceiling), floor))
                total[i, j] += step
                if z < nz:
                    numbers[i, j, int(z)] += step
