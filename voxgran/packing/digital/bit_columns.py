"""Occupancy of a lattice as bit columns: one bit a voxel, 64 voxels of a column along z in one word.

Two things live here: the bank, which holds the voxels of each grain packed along each of its three axes, so that any
of the 24 rotations of the lattice is a copy of whole columns; and the canvas, which is the packed occupancy of the
container. :mod:`voxgran.packing.digital.stamping` tests and stamps grains word by word.

Canvas words lie as ``canvas[x, word of z, y]`` and grain words as ``bits[x, word of z, y]`` with a ring of empty
columns, and rows are filled up with empty ones, so that eight neighbouring words along y are treated at once. On a
periodic axis the canvas goes on beyond both ends by the largest grain, and a grain that reaches over the end is stamped
there and at its image: no test wraps.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np

from voxgran._base.arrays import Booleans, Integers, Words
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.packing.digital.simd import LANES

Triple: TypeAlias = tuple[int, int, int]

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


@dataclass(slots=True)
class Bank:
    """Voxels of members (a member is a grain in one base orientation), packed along each axis.

    Attributes
    ----------
    words : (w,) ndarray of uint64
        Packed columns; there may be room for more.
    start : (m, 3) ndarray of int
        Where the columns of a member along each axis begin; -1 for members that have not been needed.
    low : (m, 3) ndarray of int
        Lowest voxel of the member along each axis, counted from the corner at its centroid.
    size : (m, 3) ndarray of int
        Extents in voxels.
    voxels : (m,) ndarray of int
        Number of voxels.
    filled : int
        Words that are taken.
    """

    words: Words
    start: Integers
    low: Integers
    size: Integers
    voxels: Integers
    filled: int = 0

    def add(self, member: int, mask: Booleans) -> None:
        """Pack the voxels of a member: a centered mask, whose corner at its middle is the centroid."""
        filled = [np.flatnonzero(mask.any(axis=tuple(k for k in range(3) if k != axis))) for axis in range(3)]
        first = np.array([line[0] for line in filled])
        self.size[member] = np.array([line[-1] for line in filled]) + 1 - first
        self.low[member] = first - np.array(mask.shape) // 2
        self.voxels[member] = np.count_nonzero(mask)
        box = mask[tuple(slice(a, a + n) for a, n in zip(first, self.size[member], strict=True))]
        for axis in range(3):
            columns = pack_columns(box.transpose((axis + 1) % 3, (axis + 2) % 3, axis)).reshape(-1)
            end = self.filled + len(columns)
            if end > len(self.words):
                grown = np.zeros(max(end, 2 * len(self.words)), dtype=np.uint64)
                grown[: self.filled] = self.words[: self.filled]
                self.words = grown
            self.words[self.filled : end] = columns
            self.start[member, axis] = self.filled
            self.filled = end

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        return self.words.nbytes + self.start.nbytes + self.low.nbytes + self.size.nbytes


def empty_bank(count: int) -> Bank:
    """Return a bank for members that are voxelized when they are needed."""
    start, low, size = (np.full((count, 3), value, dtype=np.int64) for value in (-1, 0, 0))
    return Bank(np.zeros(0, np.uint64), start, low, size, np.zeros(count, dtype=np.int64))


def make_bank(count: int, mask_of: Callable[[int], Booleans]) -> Bank:
    """Pack the masks of all members.

    Parameters
    ----------
    count : int
        Number of members.
    mask_of : callable
        Member index to its mask, centered: the corner at its middle is the centroid.
    """
    bank = empty_bank(count)
    for member in range(count):
        bank.add(member, mask_of(member))
    bank.words = bank.words[: bank.filled].copy()
    return bank


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
        """Shape of the word array: x, words along z, y."""
        full = self.shape + 2 * self.margin
        return int(full[0]), int(-(-full[2] // 64)), int(full[1])

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
        # a row is read eight words at a time, beyond its end
        return np.concatenate([words.reshape(-1), np.zeros(LANES, dtype=np.uint64)])

    def occupied(self, words: Words) -> Booleans:
        """Return the (nx, ny, nz) mask of what is taken inside the container."""
        nx, nw, ny = self.word_shape
        mask = unpack_columns(words[: nx * nw * ny].reshape(nx, nw, ny).transpose(0, 2, 1), nw * 64)
        return mask[tuple(slice(m, m + n) for m, n in zip(self.margin, self.shape, strict=True))]


def aligned_words(count: int) -> Words:
    """Return zeros that begin where a line of the cache does, so that no eight words of a row lie across two."""
    words = np.zeros(count + LANES, dtype=np.uint64)
    begin = -words.ctypes.data % 64 // 8
    return words[begin : begin + count]


@inlined_kernel
def row_length(deep: int) -> int:
    """Return the words of a row of columns: at least an empty one after the last, and a multiple of eight.

    The last of a row is also the empty one before the first of the next.
    """
    return 8 * ((deep + 8) // 8)


@bare_kernel
def grain_words(size: Triple) -> int:
    """Return the words of a grain in its box, ring included."""
    return (size[0] + 2) * ((size[2] + 63) // 64) * row_length(size[1])


@inlined_kernel
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


@bare_kernel
def write_turned(words: Words, start: Integers, size: Integers, turn: Integers, bits: Words, at: int) -> None:
    """Write the columns of a turned member into ``bits[at:]``, with a ring of empty columns."""
    p0, p1, p2 = turn[0] % 3, turn[1] % 3, turn[2] % 3
    wide, deep, tall = size[p0], size[p1], size[p2]
    count = (tall + 63) // 64
    row = row_length(deep)
    for k in range(at, at + (wide + 2) * count * row):
        bits[k] = np.uint64(0)
    straight = p0 == (p2 + 1) % 3
    across = size[(p2 + 2) % 3]
    shift = np.uint64(count * 64 - tall)
    for i in range(wide):
        a = wide - 1 - i if turn[0] > 2 else i
        for j in range(deep):
            b = deep - 1 - j if turn[1] > 2 else j
            column = start[p2] + ((a * across + b) if straight else (b * across + a)) * count
            target = at + (i + 1) * count * row + j
            for k in range(count):
                value = words[column + k]
                if turn[2] > 2:
                    value = _reversed_word(words[column + count - 1 - k]) >> shift
                    if k + 1 < count:
                        above = _reversed_word(words[column + count - 2 - k])
                        value |= (above << np.uint64(1)) << (np.uint64(63) - shift)
                bits[target + k * row] = value


@bare_kernel
def _reversed_word(word):  # type: ignore[no-untyped-def]
    """Return the word with its 64 bits in reverse order: swap neighbours, pairs, nibbles, bytes, ..."""
    mask = np.uint64(0xFFFFFFFFFFFFFFFF)
    for k in range(5, -1, -1):
        step = np.uint64(1 << k)
        mask ^= mask << step
        word = ((word >> step) & mask) | ((word << step) & ~mask)
    return word
