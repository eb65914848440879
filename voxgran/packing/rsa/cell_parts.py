"""Parts of open cells: which of them stay open, and how they take the place of the cells.

The index of a cell along the axes is kept as words of 16 bits, the three lowest ones first.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.containers.kernel_container import KernelContainer, is_barred
from voxgran.geometry.level_grid import LevelGrid
from voxgran.packing.rsa.overlaps import Grains, gather, is_within
from voxgran.packing.rsa.true_overlaps import is_taken, list_near

#: the lowest 16 bits of a number
LOW = 0xFFFF


def parts_in_place(
    cell: NDArray[Any], begin: int, kept: NDArray[np.uint8], many: int, parts: Integers, width: int
) -> NDArray[Any]:
    """Return the cells with some replaced by their remaining parts, without a second large array."""
    if width > cell.shape[1] or not cell.flags.owndata:
        cell = np.pad(cell, ((0, 0), (0, width - cell.shape[1])))
    end, rest = begin + len(kept), len(cell) - begin - len(kept)
    still = int(_drop_closed(cell[begin:end], kept))
    # no other array refers to the memory
    cell.resize((max(len(cell), begin + many + rest), width), refcheck=False)
    cell[begin + many : begin + many + rest] = cell[end : end + rest]
    _write_parts(cell[begin : begin + many], still, parts, kept)
    cell.resize((begin + many + rest, width), refcheck=False)
    return cell


@bare_kernel
def cell_index(cell: NDArray[np.uint16], k: int) -> tuple[np.int64, np.int64, np.int64]:
    """Return the indices of a cell along the axes."""
    i, j, n = np.int64(0), np.int64(0), np.int64(0)
    for word in range(cell.shape[1] - 3, -1, -3):
        i = (i << 16) + np.int64(cell[k, word])
        j = (j << 16) + np.int64(cell[k, word + 1])
        n = (n << 16) + np.int64(cell[k, word + 2])
    return i, j, n


@bare_kernel
def look_at_parts(
    grains: Grains,
    cells: LevelGrid,
    walls: KernelContainer,
    cell: NDArray[np.uint16],
    half: Floats,
    low: Floats,
    edge: Floats,
    parts: Integers,
    near: Floats,
    kept: NDArray[np.uint8],
) -> int:
    """Write which parts of each cell stay open, as bits, and return their number."""
    total = 0
    ex, ey, ez = 0.5 * edge[0], 0.5 * edge[1], 0.5 * edge[2]
    px, py, pz = ex / parts[0], ey / parts[1], ez / parts[2]
    for m in range(len(cell)):
        i, j, n = cell_index(cell, m)
        x, y, z = low[0] + (i + 0.5) * edge[0], low[1] + (j + 0.5) * edge[1], low[2] + (n + 0.5) * edge[2]
        many = gather(grains, cells, walls, x, y, z, half[0], half[1], half[2], ex, ey, ez, near)
        bits = 0
        for part in range(8 if many >= 0 else 0):
            i, j, n = part >> 2, (part >> 1) & 1, part & 1
            if i >= parts[0] or j >= parts[1] or n >= parts[2]:
                continue
            # the middle of a part, from the middle of the cell
            qx, qy, qz = (2 * i + 1) * px - ex, (2 * j + 1) * py - ey, (2 * n + 1) * pz - ez
            if _is_blocked(grains.boxes, near, many, qx, qy, qz, px, py, pz):
                continue
            if is_barred(walls, x + qx, y + qy, z + qz, px, py, pz, half[0]):
                continue
            bits |= 1 << part
            total += 1
        kept[m] = bits
    return total


@bare_kernel
def look_at_true(
    grains: Grains,
    cells: LevelGrid,
    walls: KernelContainer,
    cell: NDArray[np.uint16],
    half: Floats,
    low: Floats,
    edge: Floats,
    parts: Integers,
    kept: NDArray[np.uint8],
    shapes: TrueShapes,
    rows: object,
) -> int:
    """Write which parts of each cell stay open for true shapes, as bits, and return their number.

    A part is closed if a grain meets the sphere inside the new one wherever in the part its center is.
    """
    total = 0
    ex, ey, ez = 0.5 * edge[0], 0.5 * edge[1], 0.5 * edge[2]
    px, py, pz = ex / parts[0], ey / parts[1], ez / parts[2]
    radius = half[0] - math.sqrt(px * px + py * py + pz * pz)
    # from the middle of a cell to that of a part
    way = math.sqrt((ex - px) ** 2 + (ey - py) ** 2 + (ez - pz) ** 2)
    for m in range(len(cell)):
        i, j, n = cell_index(cell, m)
        x, y, z = low[0] + (i + 0.5) * edge[0], low[1] + (j + 0.5) * edge[1], low[2] + (n + 0.5) * edge[2]
        many = list_near(grains, cells, walls, shapes, x, y, z, radius + way, radius - way) if radius > 0.0 else 0
        bits = 0
        for part in range(8 if many >= 0 else 0):
            i, j, n = part >> 2, (part >> 1) & 1, part & 1
            if i >= parts[0] or j >= parts[1] or n >= parts[2]:
                continue
            qx, qy, qz = (2 * i + 1) * px - ex, (2 * j + 1) * py - ey, (2 * n + 1) * pz - ez
            if is_barred(walls, x + qx, y + qy, z + qz, px, py, pz, half[0]):
                continue
            if is_taken(grains, shapes, many, qx, qy, qz, radius, rows):
                continue
            bits |= 1 << part
            total += 1
        kept[m] = bits
    return total


@bare_kernel
def _is_blocked(boxes, near, many, x, y, z, ex, ey, ez):  # type: ignore[no-untyped-def]
    """Return whether a single near grain excludes all of a part."""
    k = 0
    while k < many and not is_within(boxes, near, k, x, y, z, ex, ey, ez):
        k += 1
    return k < many


@bare_kernel
def _drop_closed(cell, kept):  # type: ignore[no-untyped-def]
    """Move the cells with an open part to the front, and return their number."""
    many = 0
    for m in range(len(cell)):
        if kept[m]:
            for word in range(cell.shape[1]):
                cell[many, word] = cell[m, word]
            kept[many] = kept[m]
            many += 1
    return many


@bare_kernel
def _write_parts(cell, many, parts, kept):  # type: ignore[no-untyped-def]
    """Write the open parts of the first `many` cells over all cells, from the last to the first.

    Each cell has at least one, so that none is overwritten before it is read.
    """
    row = len(cell)
    for m in range(many - 1, -1, -1):
        i, j, n = cell_index(cell, m)
        for part in range(7, -1, -1):
            if kept[m] & (1 << part):
                row -= 1
                x, y, z = i * parts[0] + (part >> 2), j * parts[1] + ((part >> 1) & 1), n * parts[2] + (part & 1)
                for word in range(0, cell.shape[1], 3):
                    cell[row, word], cell[row, word + 1], cell[row, word + 2] = x & LOW, y & LOW, z & LOW
                    x, y, z = x >> 16, y >> 16, z >> 16
