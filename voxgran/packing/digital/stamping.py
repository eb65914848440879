"""Grains on the canvas, word by word: testing places and moves, stamping, and whole layers.

Each loop goes through rows of columns along y, eight at a time. A column of a grain that lies at another height on the
canvas than in its own words takes its bits from two of them; a word that is not there is read from the zeros with which
the bits begin.
"""

from typing import TypeAlias

import numpy as np

from voxgran._base.arrays import Words
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.packing.digital.bit_columns import Field, Triple, row_length
from voxgran.packing.digital.simd import flip_lanes, flip_low_lanes, meets_lanes, meets_low_lanes

Four: TypeAlias = tuple[int, int, int, int]


@bare_kernel
def look(field: Field, bits: Words, at: int, size: Triple, corner: Triple) -> int:
    """Look whether a grain with its lowest voxel at a canvas voxel would cover a taken one.

    Return the rows of columns that were looked at; where a voxel is taken, the complement ``~rows``, which is below 0.
    """
    wide, deep, tall = size
    x, y, z = corner
    count, row = (tall + 63) // 64, row_length(deep)
    shift, none, canvas = np.uint64(z & 63), np.uint64(0), field.words
    words = ((z & 63) + tall + 63) // 64
    for k in range(words):
        cell = np.uint64(x * field.stride_x + ((z >> 6) + k) * field.stride_w + y)
        here, next_here = _rows(at, 1, k, count, row)
        under, next_under = _rows(at, 1, k - 1, count, row)
        for i in range(wide):
            for j in range(np.uint64(0), np.uint64(deep), np.uint64(8)):
                if meets_lanes(bits, here + j, under + j, none, none, canvas, cell + j, shift, none):
                    return ~(k * wide + i + 1)
            here, under, cell = here + next_here, under + next_under, cell + np.uint64(field.stride_x)
    return words * wide


@bare_kernel
def look_along(field: Field, bits: Words, at: int, size: Triple, corner: Triple, step: Triple) -> int:
    """Look whether a grain that comes to `corner` by one step would cover a taken voxel anew; as :func:`look`."""
    wide, deep, tall = size
    x, y, z = corner
    dx, dy, dz = step
    count, row = (tall + 63) // 64, row_length(deep)
    shift, old_shift, canvas = np.uint64(z & 63), np.uint64((z - dz) & 63), field.words
    lag = (z >> 6) - ((z - dz) >> 6)
    # from the side to which it moves
    first = wide - 1 if dx > 0 else 0
    next_cell = np.uint64(-field.stride_x if dx > 0 else field.stride_x)
    words = ((z & 63) + tall + 63) // 64
    for k in range(words):
        cell = np.uint64((x + first) * field.stride_x + ((z >> 6) + k) * field.stride_w + y)
        here, next_here = _rows(at, first + 1, k, count, row)
        under, next_under = _rows(at, first + 1, k - 1, count, row)
        # the column that covered this place before the step, in the word that covers it now
        old, next_old = _rows(at + dy, first + 1 + dx, k + lag, count, row)
        old_under, next_old_under = _rows(at + dy, first + 1 + dx, k + lag - 1, count, row)
        if dx > 0:
            next_here, next_under, next_old, next_old_under = -next_here, -next_under, -next_old, -next_old_under
        for i in range(wide):
            for j in range(np.uint64(0), np.uint64(deep), np.uint64(8)):
                if meets_lanes(bits, here + j, under + j, old + j, old_under + j, canvas, cell + j, shift, old_shift):
                    return ~(k * wide + i + 1)
            here, under = here + next_here, under + next_under
            old, old_under = old + next_old, old_under + next_old_under
            cell += next_cell
    return words * wide


@inlined_kernel
def look_along_low(field: Field, bits: Words, at: int, size: Triple, corner: Triple, step: Triple) -> int:
    """Return what :func:`look_along` returns, of a grain whose columns are one word tall."""
    wide, deep, tall = size
    x, y, z = corner
    dx, dy, dz = step
    row, canvas = row_length(deep), field.words
    shift, old_shift = np.uint64(z & 63), np.uint64((z - dz) & 63)
    lag = (z >> 6) - ((z - dz) >> 6)
    # columns that are asked for sixteen at a time, and whether eight more follow
    even, odd = np.uint64((deep + 7) // 16 * 16), (deep + 7) // 8 % 2
    first = wide - 1 if dx > 0 else 0
    next_row = np.uint64(-row if dx > 0 else row)
    next_cell = np.uint64(-field.stride_x if dx > 0 else field.stride_x)
    words = ((z & 63) + tall + 63) // 64
    for k in range(words):
        cell = np.uint64((x + first) * field.stride_x + ((z >> 6) + k) * field.stride_w + y)
        here = np.uint64(at + (first + 1) * row)
        old = np.uint64(at + (first + 1 + dx) * row + dy)
        part, old_part = _part(shift, k), _part(old_shift, k + lag)
        for i in range(wide):
            for j in range(np.uint64(0), even, np.uint64(16)):
                if _meets_sixteen(bits, here + j, part, old + j, old_part, canvas, cell + j, shift, old_shift):
                    return ~(k * wide + i + 1)
            if odd and meets_low_lanes(
                bits, here + even, part, old + even, old_part, canvas, cell + even, shift, old_shift
            ):
                return ~(k * wide + i + 1)
            here, old, cell = here + next_row, old + next_row, cell + next_cell
    return words * wide


@inlined_kernel
def _meets_sixteen(bits, here, part, old, old_part, canvas, cell, shift, old_shift):  # type: ignore[no-untyped-def]
    """Return what `meets_low_lanes` returns, of sixteen columns: half as many branches that may be guessed wrongly."""
    next_here, next_old, next_cell = here + np.uint64(8), old + np.uint64(8), cell + np.uint64(8)
    return meets_low_lanes(bits, here, part, old, old_part, canvas, cell, shift, old_shift) | meets_low_lanes(
        bits, next_here, part, next_old, old_part, canvas, next_cell, shift, old_shift
    )


@bare_kernel
def stamp(field: Field, bits: Words, at: int, size: Triple, corner: Triple) -> None:
    """Flip the voxels of a grain: put it where it is not, take it away where it is."""
    wide, deep, tall = size
    x, y, z = corner
    count, row = (tall + 63) // 64, row_length(deep)
    shift, none, canvas = np.uint64(z & 63), np.uint64(0), field.words
    for k in range(((z & 63) + tall + 63) // 64):
        cell = np.uint64(x * field.stride_x + ((z >> 6) + k) * field.stride_w + y)
        here, next_here = _rows(at, 1, k, count, row)
        under, next_under = _rows(at, 1, k - 1, count, row)
        for _ in range(wide):
            for j in range(np.uint64(0), np.uint64(deep), np.uint64(8)):
                flip_lanes(bits, here + j, under + j, none, none, canvas, cell + j, shift, none)
            here, under, cell = here + next_here, under + next_under, cell + np.uint64(field.stride_x)


@bare_kernel
def stamp_move(field: Field, bits: Words, at: int, size: Triple, corner: Triple, step: Triple) -> None:
    """Flip the voxels that a grain covers anew by a step to `corner`, and those that it leaves."""
    wide, deep, tall = size
    x, y, z = corner
    dx, dy, dz = step
    count, row = (tall + 63) // 64, row_length(deep)
    shift, old_shift, canvas = np.uint64(z & 63), np.uint64((z - dz) & 63), field.words
    bottom, old_bottom = z >> 6, (z - dz) >> 6
    first, begin = min(0, -dx), min(0, -dy)
    for w in range(min(bottom, old_bottom), ((max(z, z - dz) + tall - 1) >> 6) + 1):
        cell = np.uint64((x + first) * field.stride_x + w * field.stride_w + y + begin)
        here, next_here = _rows(at + begin, first + 1, w - bottom, count, row)
        under, next_under = _rows(at + begin, first + 1, w - bottom - 1, count, row)
        old, next_old = _rows(at + begin + dy, first + 1 + dx, w - old_bottom, count, row)
        old_under, next_old_under = _rows(at + begin + dy, first + 1 + dx, w - old_bottom - 1, count, row)
        for _ in range(wide + abs(dx)):
            for j in range(np.uint64(0), np.uint64(deep + abs(dy)), np.uint64(8)):
                flip_lanes(bits, here + j, under + j, old + j, old_under + j, canvas, cell + j, shift, old_shift)
            here, under = here + next_here, under + next_under
            old, old_under = old + next_old, old_under + next_old_under
            cell += np.uint64(field.stride_x)


@inlined_kernel
def stamp_low_move(field: Field, bits: Words, at: int, size: Triple, corner: Triple, step: Triple) -> None:
    """Flip what :func:`stamp_move` flips, of a grain whose columns are one word tall."""
    wide, deep, tall = size
    x, y, z = corner
    dx, dy, dz = step
    row, canvas = row_length(deep), field.words
    shift, old_shift = np.uint64(z & 63), np.uint64((z - dz) & 63)
    bottom, old_bottom = z >> 6, (z - dz) >> 6
    first, begin = min(0, -dx), min(0, -dy)
    for w in range(min(bottom, old_bottom), ((max(z, z - dz) + tall - 1) >> 6) + 1):
        cell = np.uint64((x + first) * field.stride_x + w * field.stride_w + y + begin)
        here = np.uint64(at + (first + 1) * row + begin)
        old = np.uint64(at + (first + 1 + dx) * row + begin + dy)
        part, old_part = _part(shift, w - bottom), _part(old_shift, w - old_bottom)
        for _ in range(wide + abs(dx)):
            for j in range(np.uint64(0), np.uint64(deep + abs(dy)), np.uint64(8)):
                flip_low_lanes(bits, here + j, part, old + j, old_part, canvas, cell + j, shift, old_shift)
            here, old, cell = here + np.uint64(row), old + np.uint64(row), cell + np.uint64(field.stride_x)


@bare_kernel
def _rows(at, i, k, count, row):  # type: ignore[no-untyped-def]
    """Return where word k of a row of columns begins, and how far the same of the next row lies.

    A word that is not there is read from the zeros with which the bits begin.
    """
    if 0 <= k < count:
        return np.uint64(at + (i * count + k) * row), np.uint64(count * row)
    return np.uint64(8), np.uint64(0)


@inlined_kernel
def _part(shift, k):  # type: ignore[no-untyped-def]
    """Return which bits of a word that is turned by a shift belong to word k of a column."""
    every = np.uint64(0xFFFFFFFFFFFFFFFF)
    if k == 0:
        return every << shift
    return ~(every << shift) if k == 1 else np.uint64(0)


@bare_kernel
def sum_blocked(field: Field, bits: Words, at: int, size: Triple, corner: Triple, step: Triple) -> Four:
    """Return number and summed places of the voxels that a move would newly cover and that are taken.

    Places are counted from the lowest voxel of the grain.
    """
    wide, deep, tall = size
    x, y, z = corner
    dx, dy, dz = step
    count = (tall + 63) // 64
    many, sum_x, sum_y, sum_z = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for i in range(wide):
        for j in range(deep):
            for k in range(tall):
                if not _has_voxel(bits, at, count, deep, i, j, k):
                    continue
                u, v, w = i + dx, j + dy, k + dz
                if 0 <= u < wide and 0 <= v < deep and 0 <= w < tall and _has_voxel(bits, at, count, deep, u, v, w):
                    continue
                cell = (x + i) * field.stride_x + ((z + k) >> 6) * field.stride_w + y + j
                if (field.words[cell] >> np.uint64((z + k) & 63)) & np.uint64(1):
                    many, sum_x, sum_y, sum_z = many + 1, sum_x + i, sum_y + j, sum_z + k
    return int(many), int(sum_x), int(sum_y), int(sum_z)


@bare_kernel
def _has_voxel(bits, at, count, deep, i, j, k):  # type: ignore[no-untyped-def]
    """Return whether a grain has a voxel at a place in its box."""
    word = bits[at + ((i + 1) * count + (k >> 6)) * row_length(deep) + j]
    return (word >> np.uint64(k & 63)) & np.uint64(1) != np.uint64(0)


@bare_kernel
def count_layer(field: Field, axis: int, level: int) -> int:
    """Count the taken voxels of a layer of the container across an axis."""
    taken = 0
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            if (axis == 0 and i != level) or (axis == 1 and j != level):
                continue
            first = (i + field.margin[0]) * field.stride_x + j + field.margin[1]
            for k in range(level if axis == 2 else 0, level + 1 if axis == 2 else field.shape[2]):
                z = k + field.margin[2]
                taken += (field.words[first + (z >> 6) * field.stride_w] >> np.uint64(z & 63)) & np.uint64(1) != 0
    return taken


@kernel
def close_layer(field: Field, axis: int, level: int) -> None:
    """Take all voxels of a layer of the container across an axis, and of its periodic images."""
    low, high = np.zeros(3, np.int64), np.zeros(3, np.int64)
    for k in range(3):
        around = field.margin[k] if field.periodic[k] else 0
        low[k], high[k] = field.margin[k] - around, field.margin[k] + field.shape[k] + around
    low[axis], high[axis] = level + field.margin[axis], level + field.margin[axis] + 1
    for i in range(low[0], high[0]):
        for j in range(low[1], high[1]):
            for k in range(low[2], high[2]):
                field.words[i * field.stride_x + (k >> 6) * field.stride_w + j] |= np.uint64(1) << np.uint64(k & 63)
