"""Occupancy of a lattice as bit columns: one bit a voxel, 64 voxels of a column along z in one word.

Three things live here: the bank, which holds the voxels of each grain packed along each of its three axes, so that any
of the 24 rotations of the lattice is a copy of whole columns; the canvas, which is the packed occupancy of the
container; and the kernels that test, stamp and turn grains word by word.

Canvas words lie as ``canvas[x, word of z, y]`` and grain words as ``bits[x, word of z, y]`` with a ring of empty
columns, so that the inner loops run along y over neighbouring words. On a periodic axis the canvas goes on beyond both
ends by the largest grain, and a grain that reaches over the end is stamped there and at its image: no test wraps.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Integers
from voxgran._base.kernels import kernel

Words: TypeAlias = NDArray[np.uint64]
Triple: TypeAlias = tuple[int, int, int]
Four: TypeAlias = tuple[int, int, int, int]


#: voxels of the canvas that are unpacked at a time
UNPACKED = 2**23


class Field(NamedTuple):
    """A canvas as kernels take it: flat words, steps from column to column, and the container's axes."""

    words: Words
    stride_x: int
    stride_w: int
    shape: Integers
    margin: Integers
    periodic: Integers


@dataclass(frozen=True, slots=True)
class Bank:
    """Voxels of members (a member is a grain in one base orientation), packed along each axis.

    Attributes
    ----------
    words : (w,) ndarray of uint64
        All packed columns.
    start : (m, 3) ndarray of int
        Where the columns of a member along each axis begin.
    low : (m, 3) ndarray of int
        Lowest voxel of the member along each axis, counted from the corner at its centroid.
    size : (m, 3) ndarray of int
        Extents in voxels.
    voxels : (m,) ndarray of int
        Number of voxels.
    """

    words: Words
    start: Integers
    low: Integers
    size: Integers
    voxels: Integers

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        return self.words.nbytes + self.start.nbytes + self.low.nbytes + self.size.nbytes


def make_bank(count: int, mask_of: Callable[[int], Booleans]) -> Bank:
    """Pack the masks of all members.

    Parameters
    ----------
    count : int
        Number of members.
    mask_of : callable
        Member index to its mask, centered: the corner at its middle is the centroid.
    """
    chunks: list[Words] = []
    start, low, size = (np.zeros((count, 3), dtype=np.int64) for _ in range(3))
    voxels = np.zeros(count, dtype=np.int64)
    offset = 0
    for member in range(count):
        mask = mask_of(member)
        filled = [np.flatnonzero(mask.any(axis=tuple(k for k in range(3) if k != axis))) for axis in range(3)]
        first = np.array([line[0] for line in filled])
        size[member] = np.array([line[-1] for line in filled]) + 1 - first
        middle = np.array(mask.shape) // 2
        low[member] = first - middle
        voxels[member] = np.count_nonzero(mask)
        box = mask[tuple(slice(a, a + n) for a, n in zip(first, size[member], strict=True))]
        for axis in range(3):
            words = pack_columns(box.transpose((axis + 1) % 3, (axis + 2) % 3, axis))
            start[member, axis] = offset
            chunks.append(words.reshape(-1))
            offset += words.size
    return Bank(np.concatenate(chunks) if chunks else np.zeros(0, np.uint64), start, low, size, voxels)


def pack_columns(mask: Booleans) -> Words:
    """Return (u, v, words) bit columns along the last axis of a (u, v, n) mask; bit b of word w is voxel 64 w + b."""
    words = -(-mask.shape[2] // 64)
    padded = np.zeros((*mask.shape[:2], words * 64), dtype=np.uint8)
    padded[:, :, : mask.shape[2]] = mask
    packed = np.packbits(padded, axis=2, bitorder="little")
    return np.ascontiguousarray(packed).view("<u8").astype(np.uint64, copy=False)


def unpack_columns(words: Words, height: int) -> Booleans:
    """Return the (u, v, height) mask of (u, v, words) bit columns."""
    flat = np.ascontiguousarray(words).astype("<u8", copy=False).view(np.uint8)
    return np.unpackbits(flat, axis=2, count=height, bitorder="little").astype(bool)


@dataclass(frozen=True, slots=True)
class Canvas:
    """Where the packed occupancy lies: sizes and margins.

    Attributes
    ----------
    shape : (3,) ndarray of int
        Voxels of the container along x, y, z.
    margin : (3,) ndarray of int
        Voxels before the first and at least as many after the last: 1 at walls, the largest grain where periodic.
    periodic : (3,) ndarray of int
        1 where the axis is periodic.
    """

    shape: Integers
    margin: Integers
    periodic: Integers

    @property
    def word_shape(self) -> tuple[int, int, int]:
        """Shape of the word array: x, words along z, y; one word beyond the last is always there."""
        full = self.shape + 2 * self.margin
        return int(full[0]), int(-(-full[2] // 64) + 1), int(full[1])

    def words(self, free: Booleans | None) -> Words:
        """Return the canvas of an empty container, flat.

        Parameters
        ----------
        free : ndarray of bool or None
            Voxels that grains may take; None for all.
        """
        nx, nw, ny = self.word_shape
        words = np.empty((nx, nw, ny), dtype=np.uint64)
        inner = [slice(m, m + n) for m, n in zip(self.margin.tolist(), self.shape.tolist(), strict=True)]
        reach = [slice(None) if wraps else part for wraps, part in zip(self.periodic, inner, strict=True)]
        open_x = np.zeros(nx, dtype=np.bool_)
        open_x[reach[0]] = True
        # some columns at a time: unpacked, the whole canvas would take eight times as much
        step = max(1, UNPACKED // (ny * nw * 64))
        for begin in range(0, nx, step):
            blocked = np.ones((min(step, nx - begin), ny, nw * 64), dtype=np.bool_)
            blocked[open_x[begin : begin + step], reach[1], reach[2]] = False
            if free is not None:
                low, high = (min(max(x, inner[0].start), inner[0].stop) for x in (begin, begin + step))
                place = slice(low - begin, high - begin)
                blocked[place, inner[1], inner[2]] |= ~free[low - inner[0].start : high - inner[0].start]
            words[begin : begin + step] = pack_columns(blocked).transpose(0, 2, 1)
        return words.reshape(-1)

    def occupied(self, words: Words) -> Booleans:
        """Return the (nx, ny, nz) mask of what is taken inside the container."""
        nx, nw, ny = self.word_shape
        mask = unpack_columns(words.reshape(nx, nw, ny).transpose(0, 2, 1), nw * 64)
        return mask[tuple(slice(m, m + n) for m, n in zip(self.margin, self.shape, strict=True))]


@kernel
def turned_box(low: Integers, size: Integers, turn: Integers) -> tuple[Triple, Triple]:
    """Return lowest voxel and extents of a member after a signed permutation of the axes.

    turn[i] is the body axis that lattice axis i shows, plus 3 where it is reversed.
    """
    s = (size[turn[0] % 3], size[turn[1] % 3], size[turn[2] % 3])
    x, y, z = low[turn[0] % 3], low[turn[1] % 3], low[turn[2] % 3]
    return (
        -x - s[0] if turn[0] > 2 else x,
        -y - s[1] if turn[1] > 2 else y,
        -z - s[2] if turn[2] > 2 else z,
    ), s


@kernel
def write_turned(words: Words, start: Integers, size: Integers, turn: Integers, bits: Words, at: int) -> None:
    """Write the columns of a turned member into ``bits[at:]``, with a ring of empty columns."""
    p0, p1, p2 = turn[0] % 3, turn[1] % 3, turn[2] % 3
    wide, deep, tall = size[p0], size[p1], size[p2]
    count = (tall + 63) // 64
    row = deep + 2
    bits[at : at + (wide + 2) * count * row] = np.uint64(0)
    straight = p0 == (p2 + 1) % 3
    across = size[(p2 + 2) % 3]
    shift = np.uint64(count * 64 - tall)
    for i in range(wide):
        a = wide - 1 - i if turn[0] > 2 else i
        for j in range(deep):
            b = deep - 1 - j if turn[1] > 2 else j
            column = start[p2] + ((a * across + b) if straight else (b * across + a)) * count
            target = at + (i + 1) * count * row + j + 1
            for k in range(count):
                value = words[column + k]
                if turn[2] > 2:
                    value = _reversed_word(words[column + count - 1 - k]) >> shift
                    if k + 1 < count:
                        above = _reversed_word(words[column + count - 2 - k])
                        value |= (above << np.uint64(1)) << (np.uint64(63) - shift)
                bits[target + k * row] = value


@kernel
def _reversed_word(word):  # type: ignore[no-untyped-def]
    """Return the word with its 64 bits in reverse order: swap neighbours, pairs, nibbles, bytes, ..."""
    mask = np.uint64(0xFFFFFFFFFFFFFFFF)
    for k in range(5, -1, -1):
        step = np.uint64(1 << k)
        mask ^= mask << step
        word = ((word >> step) & mask) | ((word << step) & ~mask)
    return word


@kernel
def is_blocked(field: Field, bits: Words, at: int, size: Triple, corner: Triple) -> bool:
    """Tell whether any voxel of a grain with its lowest voxel at a canvas voxel is taken.

    Unsigned indices let the compiler drop the handling of negative ones and use vector instructions.
    """
    wide, deep, tall = size
    x, y, z = corner
    count = (tall + 63) // 64
    shift = np.uint64(z & 63)
    back = np.uint64(63) - shift
    canvas = field.words
    for i in range(wide):
        for k in range(count + 1):
            if k == count and (z & 63) + tall <= count * 64:
                break
            cell = np.uint64((x + i) * field.stride_x + ((z >> 6) + k) * field.stride_w + y)
            here, under = _rows(at, i + 1, k, count, deep + 2, 1)
            found = np.uint64(0)
            for j in range(np.uint64(deep)):
                word = (bits[here + j] << shift) | ((bits[under + j] >> np.uint64(1)) >> back)
                found |= word & canvas[cell + j]
            if found != np.uint64(0):
                return True
    return False


@kernel
def is_move_blocked(field: Field, bits: Words, at: int, size: Triple, corner: Triple, step: Triple) -> bool:
    """Tell whether a grain that comes to `corner` by one step would cover a taken voxel anew."""
    wide, deep, tall = size
    x, y, z = corner
    dx, dy, dz = step
    count = (tall + 63) // 64
    if count == 1:
        return _is_low_move_blocked(field, bits, at, size, corner, step)
    shift, old_shift = np.uint64(z & 63), np.uint64((z - dz) & 63)
    back, old_back = np.uint64(63) - shift, np.uint64(63) - old_shift
    lag = (z >> 6) - ((z - dz) >> 6)
    canvas = field.words
    for i in range(wide):
        for k in range(count + 1):
            if k == count and (z & 63) + tall <= count * 64:
                break
            cell = np.uint64((x + i) * field.stride_x + ((z >> 6) + k) * field.stride_w + y)
            here, under = _rows(at, i + 1, k, count, deep + 2, 1)
            # the column that covered this place before the step, in the word that covers it now
            old_here, old_under = _rows(at, i + 1 + dx, k + lag, count, deep + 2, 1 + dy)
            found = np.uint64(0)
            for j in range(np.uint64(deep)):
                word = (bits[here + j] << shift) | ((bits[under + j] >> np.uint64(1)) >> back)
                own = (bits[old_here + j] << old_shift) | ((bits[old_under + j] >> np.uint64(1)) >> old_back)
                found |= word & ~own & canvas[cell + j]
            if found != np.uint64(0):
                return True
    return False


@kernel
def _is_low_move_blocked(field, bits, at, size, corner, step):  # type: ignore[no-untyped-def]
    """Tell what :func:`is_move_blocked` tells, of a grain whose columns are one word tall."""
    wide, deep, tall = size
    x, y, z = corner
    dx, dy, dz = step
    canvas = field.words
    shift, old_shift = np.uint64(z & 63), np.uint64((z - dz) & 63)
    back, old_back = np.uint64(63) - shift, np.uint64(63) - old_shift
    lag, one = (z >> 6) - ((z - dz) >> 6), np.uint64(1)
    spills = (z & 63) + tall > 64
    row, long = np.uint64(deep + 2), np.uint64(deep)
    here, old = np.uint64(at + deep + 3), np.uint64(at + (1 + dx) * (deep + 2) + 1 + dy)
    cell, next_x = np.uint64(x * field.stride_x + (z >> 6) * field.stride_w + y), np.uint64(field.stride_x)
    over = np.uint64(field.stride_w)
    for _ in range(wide):
        found = np.uint64(0)
        if lag == 0:
            for j in range(long):
                found |= (bits[here + j] << shift) & ~(bits[old + j] << old_shift) & canvas[cell + j]
        elif lag == 1:
            for j in range(long):
                found |= (bits[here + j] << shift) & ~((bits[old + j] >> one) >> old_back) & canvas[cell + j]
        else:
            for j in range(long):
                found |= (bits[here + j] << shift) & canvas[cell + j]
        if spills:
            above = cell + over
            if lag == 0:
                for j in range(long):
                    word = (bits[here + j] >> one) >> back
                    found |= word & ~((bits[old + j] >> one) >> old_back) & canvas[above + j]
            elif lag == 1:
                for j in range(long):
                    found |= ((bits[here + j] >> one) >> back) & canvas[above + j]
            else:
                for j in range(long):
                    word = (bits[here + j] >> one) >> back
                    found |= word & ~(bits[old + j] << old_shift) & canvas[above + j]
        if found != np.uint64(0):
            return True
        here, old, cell = here + row, old + row, cell + next_x
    return False


@kernel
def _stamp_low(field, bits, at, size, corner):  # type: ignore[no-untyped-def]
    """Flip the voxels of a grain whose columns are one word tall."""
    wide, deep, tall = size
    x, y, z = corner
    canvas = field.words
    shift, one = np.uint64(z & 63), np.uint64(1)
    back, spills = np.uint64(63) - shift, (z & 63) + tall > 64
    row, long = np.uint64(deep + 2), np.uint64(deep)
    here = np.uint64(at + deep + 3)
    cell, next_x = np.uint64(x * field.stride_x + (z >> 6) * field.stride_w + y), np.uint64(field.stride_x)
    over = np.uint64(field.stride_w)
    for _ in range(wide):
        for j in range(long):
            canvas[cell + j] ^= bits[here + j] << shift
        if spills:
            above = cell + over
            for j in range(long):
                canvas[above + j] ^= (bits[here + j] >> one) >> back
        here, cell = here + row, cell + next_x


@kernel
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


@kernel
def _has_voxel(bits, at, count, deep, i, j, k):  # type: ignore[no-untyped-def]
    """Tell whether a grain has a voxel at a place in its box."""
    word = bits[at + ((i + 1) * count + (k >> 6)) * (deep + 2) + j + 1]
    return (word >> np.uint64(k & 63)) & np.uint64(1) != np.uint64(0)


@kernel
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


@kernel
def stamp(field: Field, bits: Words, at: int, size: Triple, corner: Triple) -> None:
    """Flip the voxels of a grain: put it where it is not, take it away where it is."""
    wide, deep, tall = size
    x, y, z = corner
    count = (tall + 63) // 64
    if count == 1:
        _stamp_low(field, bits, at, size, corner)
        return
    shift = np.uint64(z & 63)
    back = np.uint64(63) - shift
    canvas = field.words
    for i in range(wide):
        for k in range(count + 1):
            if k == count and (z & 63) + tall <= count * 64:
                break
            cell = np.uint64((x + i) * field.stride_x + ((z >> 6) + k) * field.stride_w + y)
            here, under = _rows(at, i + 1, k, count, deep + 2, 1)
            for j in range(np.uint64(deep)):
                canvas[cell + j] ^= (bits[here + j] << shift) | ((bits[under + j] >> np.uint64(1)) >> back)


@kernel
def _rows(at, i, k, count, row, first):  # type: ignore[no-untyped-def]
    """Return where words k and k - 1 of a row of columns begin; a missing word is the row of zeros at 0."""
    begin = at + (i * count + k) * row + first
    here = np.uint64(begin) if 0 <= k < count else np.uint64(0)
    under = np.uint64(begin - row) if 0 < k <= count else np.uint64(0)
    return here, under
