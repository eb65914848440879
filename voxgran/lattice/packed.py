"""A solid on a lattice as bits: one bit per voxel, 64 voxels along z in a word.

1024 x 1024 x 1024 voxels need 128 MiB. Counts, centers and faces are computed from the bits block by block, so that a
measure needs only some megabytes in addition, for any size of the lattice.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers

Words = NDArray[np.uint64]

#: number of words processed at once, which bounds the additional memory of a measure
BLOCK = 2**20
#: bits whose index in the word has the binary digit 1, 2, 4, ... set; their counts give the sum of the indices
_DIGITS = (
    0xAAAAAAAAAAAAAAAA,
    0xCCCCCCCCCCCCCCCC,
    0xF0F0F0F0F0F0F0F0,
    0xFF00FF00FF00FF00,
    0xFFFF0000FFFF0000,
    0xFFFFFFFF00000000,
)


@dataclass(frozen=True, eq=False, slots=True)
class PackedMask:
    """Mask of the occupied voxels of a lattice, with one bit each."""

    words: Words  # (nx, ny, ceil(nz / 64)); bit b of word q is voxel z = 64 q + b; bits beyond nz are 0
    shape: tuple[int, int, int]  # number of voxels along x, y, z

    @classmethod
    def empty(cls, shape: tuple[int, int, int]) -> "PackedMask":
        """Return a lattice without occupied voxels."""
        return cls(np.zeros((shape[0], shape[1], -(-shape[2] // 64)), dtype=np.uint64), shape)

    @classmethod
    def from_mask(cls, mask: Booleans) -> "PackedMask":
        """Pack an (nx, ny, nz) mask."""
        nx, ny, nz = mask.shape
        packed = cls.empty((nx, ny, nz))
        packed.words.view(np.uint8)[:, :, : -(-nz // 8)] = np.packbits(mask, axis=2, bitorder="little")
        return packed

    def unpacked(self, out: Booleans | None = None) -> Booleans:
        """Return the (nx, ny, nz) mask, written to `out` if that is given."""
        if out is None and self.words.size <= BLOCK:
            octets = self.words.view(np.uint8)
            return np.unpackbits(octets, axis=2, count=self.shape[2], bitorder="little").view(np.bool_)
        mask = np.empty(self.shape, dtype=np.bool_) if out is None else out
        for begin, words in self._blocks():
            octets = np.ascontiguousarray(words).view(np.uint8)
            inner = np.unpackbits(octets, axis=2, count=self.shape[2], bitorder="little")
            mask[begin : begin + len(words)] = inner.view(np.bool_)
        return mask

    def count(self) -> int:
        """Return the number of occupied voxels."""
        return sum(int(np.bitwise_count(words).sum(dtype=np.int64)) for _, words in self._blocks())

    def centroid(self) -> Floats:
        """Return the mean center (3,) of the occupied voxels, in voxels from the corner; NaN if there are none."""
        total, moment = 0, np.zeros(3)
        digits = [np.uint64(digit) for digit in _DIGITS]
        for begin, words in self._blocks():
            counts = np.bitwise_count(words).astype(np.int64)
            total += int(counts.sum())
            moment[0] += float(linear.matmul(counts.sum(axis=(1, 2)), np.arange(begin, begin + len(words))))
            moment[1] += float(linear.matmul(counts.sum(axis=(0, 2)), np.arange(words.shape[1])))
            moment[2] += float(linear.matmul(counts.sum(axis=(0, 1)), 64 * np.arange(words.shape[2])))
            for power, digit in enumerate(digits):
                moment[2] += float(2**power * np.bitwise_count(words & digit).sum(dtype=np.int64))
        return moment / total + 0.5 if total else np.full(3, np.nan)

    def bounds(self) -> tuple[Integers, Integers]:
        """Return the bounding box of the occupied voxels: first indices, last indices plus 1, (3,) each; 0 if empty."""
        nx, ny, nz = self.shape
        planes, rows = np.zeros(nx, dtype=np.bool_), np.zeros(ny, dtype=np.bool_)
        levels = np.zeros(self.words.shape[2], dtype=np.uint64)
        for begin, words in self._blocks():
            planes[begin : begin + len(words)] = words.any(axis=(1, 2))
            rows |= words.any(axis=(0, 2))
            levels |= np.bitwise_or.reduce(words, axis=(0, 1))
        heights = np.unpackbits(levels.view(np.uint8), count=nz, bitorder="little").astype(np.bool_)
        ends = [np.flatnonzero(along) for along in (planes, rows, heights)]
        if not len(ends[0]):
            return np.zeros(3, dtype=np.int64), np.zeros(3, dtype=np.int64)
        return np.array([end[0] for end in ends]), np.array([end[-1] + 1 for end in ends])

    def face_count(self) -> int:
        """Return the number of faces between an occupied and a free voxel; the exterior of the lattice is free."""
        faces, before = 0, np.zeros(self.words.shape[1:], dtype=np.uint64)
        for _, words in self._blocks():
            faces += _ones(words ^ np.concatenate([before[None], words[:-1]]))
            faces += _ones(words[:, 1:] ^ words[:, :-1]) + _ones(words[:, 0]) + _ones(words[:, -1])
            above = words << np.uint64(1)
            above[:, :, 1:] |= words[:, :, :-1] >> np.uint64(63)
            # the bit shifted out of the last word is a face at the upper end
            faces += _ones(words ^ above) + _ones(words[:, :, -1] >> np.uint64(63))
            before = words[-1]
        return faces + _ones(before)

    def _blocks(self) -> Iterator[tuple[int, Words]]:
        """Yield the words some planes at a time, with the index of the first plane."""
        thick = max(1, BLOCK // max(1, self.words[0].size))
        for begin in range(0, len(self.words), thick):
            yield begin, self.words[begin : begin + thick]


def _ones(words: Words) -> int:
    """Return the number of bits that are set."""
    return int(np.bitwise_count(words).sum(dtype=np.int64))
