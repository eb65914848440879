"""Parts of open cells: which of them stay open, and how they take the place of the cells.

The index of a cell along the axes is kept as words of 16 bits, the three lowest ones first.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.contacts.overlap.true_shapes import TrueShapes
from voxgran.containers.kernel_container import is_barred
from voxgran.geometry.vectors import along, dot
from voxgran.packing.rsa.overlaps import Bed, gather, is_within
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


class CellClass(NamedTuple):
    """Cells of a size class: half extents of its least grains, lower corner, edges, and parts along the axes."""

    half: Floats
    low: Floats
    edge: Floats
    parts: Integers


@inlined_kernel
def _halves(kind):  # type: ignore[no-untyped-def]
    """Return half the edges of a cell and of a part of it."""
    edge = (0.5 * kind.edge[0], 0.5 * kind.edge[1], 0.5 * kind.edge[2])
    return edge, (edge[0] / kind.parts[0], edge[1] / kind.parts[1], edge[2] / kind.parts[2])


@inlined_kernel
def _middle_of(kind, cell, m):  # type: ignore[no-untyped-def]
    """Return the middle of a cell."""
    i, j, n = cell_index(cell, m)
    return (
        kind.low[0] + (i + 0.5) * kind.edge[0],
        kind.low[1] + (j + 0.5) * kind.edge[1],
        kind.low[2] + (n + 0.5) * kind.edge[2],
    )


@inlined_kernel
def _part_of(kind, number, edge, part):  # type: ignore[no-untyped-def]
    """Return whether a cell has a part of some number, and its middle from that of the cell."""
    i, j, n = number >> 2, (number >> 1) & 1, number & 1
    x, y, z = (2 * i + 1) * part[0] - edge[0], (2 * j + 1) * part[1] - edge[1], (2 * n + 1) * part[2] - edge[2]
    return i < kind.parts[0] and j < kind.parts[1] and n < kind.parts[2], (x, y, z)


@bare_kernel
def look_at_parts(bed: Bed, cell: NDArray[np.uint16], kind: CellClass, near: Floats, kept: NDArray[np.uint8]) -> int:
    """Write which parts of each cell stay open, as bits, and return their number."""
    total, (edge, part), half = 0, _halves(kind), (kind.half[0], kind.half[1], kind.half[2])
    for m in range(len(cell)):
        middle, bits = _middle_of(kind, cell, m), 0
        many = gather(bed, middle, half, edge, near)
        for number in range(8 if many >= 0 else 0):
            there, offset = _part_of(kind, number, edge, part)
            if not there or _is_blocked(bed.grains.boxes, near, many, offset, part):
                continue
            if is_barred(bed.walls, *along(middle, 1.0, offset), *part, half[0]):
                continue
            bits |= 1 << number
            total += 1
        kept[m] = bits
    return total


@bare_kernel
def look_at_true(
    bed: Bed, cell: NDArray[np.uint16], kind: CellClass, kept: NDArray[np.uint8], shapes: TrueShapes
) -> int:
    """Write which parts of each cell stay open for true shapes, as bits, and return their number.

    A part is closed if a grain meets the sphere inside the new one wherever in the part its center is.
    """
    total, (edge, part) = 0, _halves(kind)
    radius = kind.half[0] - math.sqrt(dot(part, part))
    # from the middle of a cell to that of a part
    way = math.sqrt((edge[0] - part[0]) ** 2 + (edge[1] - part[1]) ** 2 + (edge[2] - part[2]) ** 2)
    for m in range(len(cell)):
        middle, bits = _middle_of(kind, cell, m), 0
        many = list_near(bed, shapes, middle, radius + way, radius - way) if radius > 0.0 else 0
        for number in range(8 if many >= 0 else 0):
            there, offset = _part_of(kind, number, edge, part)
            if not there or is_barred(bed.walls, *along(middle, 1.0, offset), *part, kind.half[0]):
                continue
            if is_taken(bed.grains, shapes, many, offset, radius):
                continue
            bits |= 1 << number
            total += 1
        kept[m] = bits
    return total


@bare_kernel
def _is_blocked(boxes, near, many, middle, edge):  # type: ignore[no-untyped-def]
    """Return whether a single near grain excludes all of a part."""
    k = 0
    while k < many and not is_within(boxes, near, k, middle, edge):
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
