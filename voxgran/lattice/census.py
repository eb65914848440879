"""Census of a label image: counts, bounding boxes and centers of all labels in one pass, slab by slab."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran.lattice.image import lazy_of, of_blocks

#: number of voxels in memory at a time
SLAB = 2**24
#: largest label up to which tables have an entry for each label
LARGEST = 2**22


@dataclass(frozen=True, slots=True)
class Census:
    """Properties of the labels of an image, except 0."""

    label: Integers  # (n,) labels in the image, increasing; not necessarily consecutive
    count: Integers  # (n,) voxels of each
    lower: Integers  # (n, 3) bounding box of each, from `lower` up to but not including `upper`
    upper: Integers
    middle: Floats  # (n, 3) mean of the voxel centers, in voxels
    at_border: Booleans  # (n,) whether each touches the border of the image

    def numbered(self, image: NDArray[Any]) -> NDArray[np.int32]:
        """Return the (nx, ny, nz) image with the labels numbered 1 ... n in a copy, slab by slab."""
        n, most = len(self.label), int(self.label[-1])
        if most == n:
            return np.array(image, dtype=np.int32, order="C")
        numbers = np.empty(image.shape, dtype=np.int32)
        table = np.zeros(1 + min(most, LARGEST), dtype=np.int32)
        if most <= LARGEST:
            table[self.label] = np.arange(1, n + 1)
        for k, plane in enumerate(image):
            values = np.asarray(plane).astype(np.int64)
            numbers[k] = (
                table[values] if most <= LARGEST else np.where(values, np.searchsorted(self.label, values) + 1, 0)
            )
        return numbers


def census(image: NDArray[Any]) -> Census:
    """Return the census of an (nx, ny, nz) image of labels, 0 for void; it may be a memory map larger than the memory,
    or a dask array.

    Raises
    ------
    InputError
        If the image does not have three axes, is empty, or contains a value that is not a whole number of at least 0.
    """
    if image.ndim != 3:
        raise InputError(
            f"the image has the shape {image.shape}: labels need three axes; stack slices, or choose a channel"
        )
    if not image.size:
        raise InputError(f"the image has the shape {image.shape}: it holds no voxel; check the file")
    if image.dtype.kind not in "buif":
        raise InputError(f"the image holds {image.dtype}: labels are whole numbers of at least 0; convert it")
    thick = max(1, SLAB // (image.shape[1] * image.shape[2]))
    if lazy_of(image) is not None:
        parts = of_blocks(image, _count_slab)
    else:
        starts = [np.array([start, 0, 0]) for start in range(0, image.shape[0], thick)]
        parts = [_count_slab(np.asarray(image[start[0] : start[0] + thick]), start) for start in starts]
    found, index = np.unique(np.concatenate([part.label for part in parts]), return_inverse=True)
    n = len(found)
    count, total = np.zeros(n, dtype=np.int64), np.zeros((n, 3))
    lower, upper = np.full((n, 3), np.iinfo(np.int64).max), np.zeros((n, 3), dtype=np.int64)
    every = np.concatenate([part.count for part in parts])
    np.add.at(count, index, every)
    np.add.at(total, index, np.concatenate([part.middle for part in parts]))
    np.minimum.at(lower, index, np.concatenate([part.lower for part in parts]))
    np.maximum.at(upper, index, np.concatenate([part.upper for part in parts]))
    border = (lower == 0).any(axis=1) | (upper == np.array(image.shape)).any(axis=1)
    return Census(found, count, lower, upper, total / np.maximum(count, 1)[:, None] + 0.5, border)


def _count_slab(slab: NDArray[Any], start: Integers) -> Census:
    """Count the labels of a part of an image that begins at some voxel; instead of the middle it has the sum of the
    indices of the voxels, whole numbers, so that the parts make no difference.
    """
    if slab.dtype.kind == "f":
        # inf less inf is no number either
        with np.errstate(invalid="ignore"):
            bad = slab - np.floor(slab) != 0
        if bad.any():
            at = np.unravel_index(bad.argmax(), slab.shape)
            place = tuple((np.array(at) + start).tolist())
            raise InputError(
                f"the image is {slab[at]:g} at voxel {place}: labels are whole numbers, and these are grey values; "
                "segment it first"
            )
        slab = slab.astype(np.int64)
    if slab.dtype.kind == "i" and slab.min() < 0:
        raise InputError(f"the image holds the label {slab.min()}: labels are at least 0, 0 being void; renumber them")
    if slab.dtype == np.uint64:
        # together with whole numbers of 64 bits these become floating-point numbers, in which large labels are alike
        if slab.max() >= 2**63:
            raise InputError(f"the image holds the label {slab.max()}: labels are below 2**63; renumber them")
        slab = slab.astype(np.int64)
    label = np.arange(int(slab.max()) + 1) if slab.max() <= LARGEST else np.append(0, np.unique(slab[slab > 0]))
    if slab.max() > LARGEST:
        slab = np.searchsorted(label, slab)
    count, lower, upper, total = _tally(np.ascontiguousarray(slab, dtype=np.int32), len(label))
    there = np.flatnonzero(count)
    count = count[there]
    total = total[there] + count[:, None] * start
    none = np.zeros(len(there), dtype=np.bool_)
    return Census(label[there].astype(np.int64), count, lower[there] + start, upper[there] + start, total, none)


@kernel
def _tally(image, n):  # type: ignore[no-untyped-def]
    """Return the number of voxels of each label below n but 0, their bounding boxes and the sums of their indices."""
    count, total = np.zeros(n, dtype=np.int64), np.zeros((n, 3), dtype=np.int64)
    lower, upper = np.full((n, 3), 2**62, dtype=np.int64), np.zeros((n, 3), dtype=np.int64)
    nx, ny, nz = image.shape
    for i in range(nx):
        for j in range(ny):
            k = 0
            while k < nz:
                label, low = image[i, j, k], k
                while k < nz and image[i, j, k] == label:
                    k += 1
                if label > 0:
                    many = k - low
                    count[label] += many
                    total[label, 0] += i * many
                    total[label, 1] += j * many
                    total[label, 2] += (low + k - 1) * many // 2
                    for axis, first, end in ((0, i, i + 1), (1, j, j + 1), (2, low, k)):
                        lower[label, axis] = min(lower[label, axis], first)
                        upper[label, axis] = max(upper[label, axis], end)
    return count, lower, upper, total
