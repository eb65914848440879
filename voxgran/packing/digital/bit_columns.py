"""Occupancy of a lattice as bit columns: one bit a voxel, 64 voxels of a column along z in one word.

Two things live here: the bank, which holds the voxels of each grain packed along each of its three axes, so that any
of the 24 rotations of the lattice is a copy of whole columns; and the canvas, which is the packed occupancy of the
container. :mod:`voxgran.packing.digital.stamping` tests and stamps grains word by word. (Methods that search the whole
lattice need boolean masks and each orientation once: :mod:`voxgran.packing.digital.oriented_voxels`.)

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
from voxgran.lattice.packed import PackedMask
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


class BankRecord(NamedTuple):
    """A :class:`VoxelBank` as kernels take it; `turns` are signed permutations of the axes.

    kind: of each grain; its members are `bases` from kind * bases on.  at: where each member in each turn begins in the
    bits that all grains share; empty where each grain has bits of its own.
    """

    words: Words
    start: Integers
    low: Integers
    size: Integers
    turns: Integers
    bases: int
    kind: Integers
    at: Integers


class Grains(NamedTuple):
    """Positions of the grains: lattice site of the centroid, member of the bank (-1: waiting), turn.

    at: where the bits of each begin now.  own: where its own bits begin, where it has some.
    """

    site: Integers
    member: Integers
    turn: Integers
    bits: Words
    at: Integers
    own: Integers
    scratch: Words


class Bed(NamedTuple):
    """A canvas, the bank, and the grains on the canvas."""

    field: Field
    members: BankRecord
    grains: Grains


@dataclass(slots=True)
class VoxelBank:
    """Voxels of members (a member is a grain in one base orientation), packed along each axis."""

    words: Words  # packed columns; there may be room for more
    start: Integers  # (m, 3): first word of a member along each axis; -1 where it has not been needed
    low: Integers  # (m, 3): lowest voxel, counted from the corner at the centroid
    size: Integers  # (m, 3): extents in voxels
    voxels: Integers  # (m,): number of voxels
    filled: int = 0  # words that are taken

    @classmethod
    def empty(cls, count: int) -> "VoxelBank":
        """Return a bank for members that are voxelized when they are needed."""
        start, low, size = (np.full((count, 3), value, dtype=np.int64) for value in (-1, 0, 0))
        return cls(np.zeros(0, np.uint64), start, low, size, np.zeros(count, dtype=np.int64))

    @classmethod
    def from_masks(cls, count: int, mask_of: Callable[[int], Booleans]) -> "VoxelBank":
        """Return a bank of all members; `mask_of` takes the number of one and returns what :meth:`add` takes."""
        bank = cls.empty(count)
        for member in range(count):
            bank.add(member, mask_of(member))
        bank.words = bank.words[: bank.filled].copy()
        return bank

    def add(self, member: int, mask: Booleans) -> None:
        """Pack the voxels of a member: a centered mask, whose corner at its middle is the centroid."""
        box, self.low[member] = cut_to_box(mask)
        self.size[member], self.voxels[member] = box.shape, np.count_nonzero(box)
        for axis in range(3):
            along = box.transpose((axis + 1) % 3, (axis + 2) % 3, axis)
            columns = PackedMask.from_mask(along).words.reshape(-1)
            end = self.filled + len(columns)
            if end > len(self.words):
                grown = np.zeros(max(end, 2 * len(self.words)), dtype=np.uint64)
                grown[: self.filled] = self.words[: self.filled]
                self.words = grown
            self.words[self.filled : end] = columns
            self.start[member, axis] = self.filled
            self.filled = end

    def mask(self, member: int) -> Booleans:
        """Return the voxels of a member, cut to their box."""
        wide, deep, tall = (int(n) for n in self.size[member])
        begin, many = int(self.start[member, 2]), -(-tall // 64)
        words = self.words[begin : begin + wide * deep * many].reshape(wide, deep, many)
        return PackedMask(words, (wide, deep, tall)).unpacked()


def cut_to_box(mask: Booleans) -> tuple[Booleans, Integers]:
    """Return the box of the voxels of a centered mask, and its lowest voxel, counted from the corner at the middle."""
    filled = [np.flatnonzero(mask.any(axis=tuple(k for k in range(3) if k != axis))) for axis in range(3)]
    if not len(filled[0]):
        return np.zeros((0, 0, 0), dtype=np.bool_), np.zeros(3, dtype=np.int64)
    box = mask[tuple(slice(line[0], line[-1] + 1) for line in filled)]
    return np.ascontiguousarray(box), np.array([line[0] for line in filled]) - np.array(mask.shape) // 2


def signed_axes(rotations: Integers) -> Integers:
    """Return rotations of the lattice, (r, 3, 3), as signed permutations of the axes, (r, 3); see `turned_box`."""
    return np.abs(rotations).argmax(axis=2) + 3 * (rotations.sum(axis=2) < 0)


def turned_mask(mask: Booleans, turn: Integers) -> Booleans:
    """Return a mask after a signed permutation of the axes."""
    return np.ascontiguousarray(np.flip(mask.transpose(turn % 3), tuple(np.flatnonzero(turn > 2).tolist())))


@dataclass(frozen=True, slots=True)
class Canvas:
    """Layout of the packed occupancy."""

    shape: Integers  # (3,): voxels of the container along x, y, z
    margin: Integers  # (3,): voxels before the first and after the last: 1 at walls, the largest grain where periodic
    periodic: Integers  # (3,): 1 where the axis is periodic

    @classmethod
    def for_grains(cls, shape: Integers, periodic: tuple[bool, ...], extents: Integers) -> "Canvas":
        """Return the canvas of a container for grains of some extents in voxels."""
        wraps = np.array(periodic, dtype=np.int64)
        return cls(shape, np.where(wraps, int(extents.max(initial=1)) + 1, 1).astype(np.int64), wraps)

    @property
    def word_shape(self) -> Triple:
        """Shape of the word array: x, words along z, y."""
        full = self.shape + 2 * self.margin
        return int(full[0]), int(-(-full[2] // 64)), int(full[1])

    def field(self, words: Words) -> Field:
        """Return the canvas with some words as kernels take it."""
        _, many, deep = self.word_shape
        return Field(words, many * deep, deep, self.shape, self.margin, self.periodic)

    def words(self, free: Booleans | None) -> Words:
        """Return the canvas of an empty container, flat; `free` are the voxels that grains may take, None for all."""
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
            words[begin : begin + step] = column_words(blocked)
        # a row is read eight words at a time, beyond its end
        return np.concatenate([words.reshape(-1), np.zeros(LANES, dtype=np.uint64)])

    def occupied(self, words: Words) -> Booleans:
        """Return the (nx, ny, nz) mask of what is taken inside the container."""
        nx, nw, ny = self.word_shape
        mask = mask_of_words(words[: nx * nw * ny].reshape(nx, nw, ny), nw * 64)
        return mask[tuple(slice(m, m + n) for m, n in zip(self.margin, self.shape, strict=True))]


def column_words(mask: Booleans) -> Words:
    """Return the words ``[x, word of z, y]`` of an (nx, ny, nz) mask."""
    return PackedMask.from_mask(mask).words.transpose(0, 2, 1)


def mask_of_words(words: Words, height: int) -> Booleans:
    """Return the (nx, ny, height) mask of words ``[x, word of z, y]``."""
    nx, _, ny = words.shape
    return PackedMask(np.ascontiguousarray(words.transpose(0, 2, 1)), (nx, ny, height)).unpacked()


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
    x = -x - s[0] if turn[0] > 2 else x
    y = -y - s[1] if turn[1] > 2 else y
    z = -z - s[2] if turn[2] > 2 else z
    return (x, y, z), s


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
