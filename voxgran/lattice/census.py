"""Census of a label image: counts, bounding boxes and centers of all labels in one pass, slab by slab."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.errors import InputError
from voxgran.lattice.blocks import lazy_of, of_blocks

#: number of voxels in memory at a time
SLAB = 2**24


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
        numbers = np.empty(image.shape, dtype=np.int32)
        for k, plane in enumerate(image):
            values = np.asarray(plane)
            numbers[k] = np.where(values, np.searchsorted(self.label, values) + 1, 0)
        return numbers


def census(image: NDArray[Any], name: str = "the image") -> Census:
    """Return the census of an (nx, ny, nz) image of labels, 0 for void; it may be a memory map larger than the memory,
    or a dask array.

    Raises
    ------
    InputError
        If the image does not have three axes, is empty, or contains a value that is not a whole number of at least 0.
    """
    if image.ndim != 3:
        raise InputError(
            f"{name} has the shape {image.shape}: labels need three axes; stack slices, or choose a channel"
        )
    if not image.size:
        raise InputError(f"{name} has the shape {image.shape}: it holds no voxel; check the file")
    if image.dtype.kind not in "buif":
        raise InputError(f"{name} holds {image.dtype}: labels are whole numbers of at least 0; convert it")
    thick = max(1, SLAB // (image.shape[1] * image.shape[2]))
    if lazy_of(image) is not None:
        parts = of_blocks(image, _count_slab, name)
    else:
        starts = [np.array([start, 0, 0]) for start in range(0, image.shape[0], thick)]
        parts = [_count_slab(np.asarray(image[start[0] : start[0] + thick]), start, name) for start in starts]
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


def _count_slab(slab: NDArray[Any], start: Integers, name: str) -> Census:
    """Count the labels of a part of an image that begins at some voxel; instead of the middle it has the sum of the
    indices of the voxels, whole numbers, so that the parts make no difference.
    """
    if slab.dtype.kind == "f":
        if not np.isfinite(slab).all() or (slab != np.floor(slab)).any():
            raise InputError(f"{name} holds numbers with fractions or NaN: these are grey values; segment it first")
        slab = slab.astype(np.int64)
    if slab.dtype.kind == "i" and slab.min() < 0:
        raise InputError(f"{name} holds the label {slab.min()}: labels are at least 0, 0 being void; renumber them")
    place = np.flatnonzero(slab)
    found, index, count = np.unique(slab.ravel()[place], return_inverse=True, return_counts=True)
    index, n = index.reshape(-1), len(found)
    lower, upper, middle = np.zeros((n, 3), np.int64), np.zeros((n, 3), np.int64), np.zeros((n, 3))
    for axis, along in enumerate(np.unravel_index(place, slab.shape)):
        low, high = np.full(n, np.iinfo(np.int64).max), np.full(n, -1)
        np.minimum.at(low, index, along)
        np.maximum.at(high, index, along)
        lower[:, axis], upper[:, axis] = low + start[axis], high + 1 + start[axis]
        middle[:, axis] = np.bincount(index, weights=along, minlength=n) + count * start[axis]
    return Census(found.astype(np.int64), count, lower, upper, middle, np.zeros(n, dtype=np.bool_))
