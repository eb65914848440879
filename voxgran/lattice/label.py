"""Connected components by SciPy: of images, joined across periodic faces and those of blocks, and of graphs."""

from collections.abc import Sequence
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Booleans, Integers
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load
from voxgran._base.scalars import whole_number_of
from voxgran.lattice.distance import as_mask, lazy_mask
from voxgran.lattice.image import kept, lazy_of, of_blocks

#: number of coordinates in which neighbouring voxels may differ
_RANKS = {6: 1, 18: 2, 26: 3}


@explained(hint="connected_components(mask, connectivity=26)")
def connected_components(
    mask: "ArrayLike", *, connectivity: int = 6, periodic: Periodic = False
) -> tuple[NDArray[np.int32], int]:
    """Return numbers for the connected bodies of taken voxels.

    Parameters
    ----------
    mask : (nx, ny, nz) array_like of bool, or Image
        Mask of the occupied voxels; a dask array is numbered block by block, with the same result.
    connectivity : {6, 18, 26}
        Number of neighbours that a voxel is connected to.
    periodic : str, bool or sequence
        Periodic axes, such as ``"xy"``, as in :class:`voxgran.Box`.

    Returns
    -------
    labels : (nx, ny, nz) ndarray of int32
        1 ... count, in the order of the lattice; 0 where nothing is taken. For a dask array a dask array, whose blocks
        are kept in a temporary folder.
    count : int
        Number of bodies.

    Raises
    ------
    InputError
        If the connectivity is none of the three, the image has not three axes, or `periodic` names no axes.
    MissingLibraryError
        If the image is a dask array and zarr is not installed.

    Notes
    -----
    Memory beside the mask: 4 bytes per voxel for the labels; 8 bytes per voxel for a periodic image. For a dask array
    that of a few blocks on each thread, and about 50 bytes for each part of a body within a block.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> mask = np.zeros((1, 1, 5), dtype=bool)
    >>> mask[0, 0, [0, 1, 4]] = True
    >>> labels, count = vg.connected_components(mask)
    >>> labels[0, 0].tolist(), count
    ([1, 1, 0, 0, 2], 2)
    >>> vg.connected_components(mask, periodic="z")[1]
    1
    """
    number = whole_number_of(connectivity)
    if number not in _RANKS:
        raise InputError(f"connectivity is {shown(connectivity)}: it must be one of 6, 18, 26; change it")
    rank = _RANKS[number]
    axes = as_periodic(periodic)
    if (lazy := lazy_of(mask)) is not None:
        return _of_blocks(lazy_mask(lazy), rank, axes)
    labels, count = _numbered(as_mask(mask), rank)
    if not count or not any(axes):
        return labels, count
    pairs = np.concatenate([_across(labels, labels, axis, rank, axes) for axis in range(3) if axes[axis]], axis=1)
    # node 0, what is not taken, has no edges, so that the bodies are numbered from 1
    part = components(count + 1, *pairs).astype(np.int32)
    return part[labels], int(part.max())


def _numbered(taken: Booleans, rank: int) -> tuple[NDArray[np.int32], int]:
    """Return numbers of bodies, in the order of the lattice, and how many there are."""
    ndimage, labels = load("scipy.ndimage"), np.empty(taken.shape, dtype=np.int32)
    return labels, int(ndimage.label(taken, ndimage.generate_binary_structure(3, rank), output=labels))


def _of_blocks(mask: Any, rank: int, periodic: tuple[bool, bool, bool]) -> tuple[Any, int]:
    """Return the same for a dask array: bodies of blocks are joined across the faces of the blocks."""
    # blocks of the sizes in which they are kept
    mask = mask.rechunk(mask.chunksize)
    parts = kept(mask.map_blocks(lambda block: _numbered(block, rank)[0], dtype=np.int32))
    places = of_blocks(parts, _first_places, mask.shape)
    before = np.concatenate([[0], np.cumsum([len(place) for place in places])])
    base, count = before[:-1].reshape(parts.numblocks), int(before[-1])
    kind = np.int32 if count < np.iinfo(np.int32).max else np.int64
    nodes = parts.map_blocks(
        lambda block, block_id: np.where(block, block + base[block_id], 0).astype(kind), dtype=kind
    )
    pairs = [np.zeros((2, 0), dtype=np.int64)]
    for axis, sizes in enumerate(parts.chunks):
        ends = list(accumulate(sizes))
        for end in ends if periodic[axis] else ends[:-1]:
            behind, ahead = (
                np.asarray(nodes[(slice(None),) * axis + (slice(k, k + 1),)]) for k in (end - 1, end % ends[-1])
            )
            pairs.append(_across(behind, ahead, axis, rank, periodic))
    joined = components(count + 1, *np.concatenate(pairs, axis=1))
    # bodies are numbered by their first voxels
    first = np.full(int(joined.max()) + 1, np.iinfo(np.int64).max)
    np.minimum.at(first, joined, np.concatenate([[-1], *places]))
    number = np.empty(len(first), dtype=np.int32)
    number[np.argsort(first, kind="stable")] = np.arange(len(first))
    table = number[joined]
    return nodes.map_blocks(lambda block: table[block], dtype=np.int32), len(first) - 1


def _first_places(block: NDArray[np.int32], start: Integers, shape: tuple[int, int, int]) -> Integers:
    """Return the place in the lattice of the first voxel of each body in a block, which are numbered in this order."""
    highest = np.maximum.accumulate(block.ravel())
    at = np.unravel_index(np.flatnonzero(np.diff(highest, prepend=0)), block.shape)
    return np.ravel_multi_index([along + low for along, low in zip(at, start, strict=True)], shape).astype(np.int64)


def _across(
    behind: NDArray[Any], ahead: NDArray[Any], axis: int, rank: int, periodic: tuple[bool, bool, bool]
) -> Integers:
    """Return the pairs of labels, as (2, n), that are neighbours across a face normal to an axis: of those in the last
    plane of one image and in the first plane of another one.
    """
    last, first = np.moveaxis(behind, axis, 0)[-1], np.moveaxis(ahead, axis, 0)[0]
    # one more voxel on each side of the first face, for neighbours that differ in other coordinates too
    for k, around in enumerate(np.delete(periodic, axis)):
        first = np.pad(first, [(int(k == j),) * 2 for j in range(2)], mode="wrap" if around else "constant")
    pairs = []
    for i, j in np.ndindex(3, 3):
        if abs(i - 1) + abs(j - 1) < rank:
            other = first[i : i + last.shape[0], j : j + last.shape[1]]
            both = (last > 0) & (other > 0) & (last != other)
            pairs.append(np.stack([last[both], other[both]]))
    return np.unique(np.concatenate(pairs, axis=1), axis=1)


def components(count: int, one: Integers, two: Integers) -> Integers:
    """Return the connected component (count,) of each node of a graph with undirected edges from `one` to `two`, (n,).

    Components are numbered from 0 in the order of their first nodes.
    """
    links = load("scipy.sparse").coo_array((np.ones(len(one), dtype=bool), (one, two)), shape=(count, count))
    part: Integers = load("scipy.sparse.csgraph").connected_components(links, directed=False)[1].astype(np.int64)
    return part


def percolating(mask: Booleans, axis: int, *, periodic: Sequence[bool] = (False,) * 3, region: Booleans) -> Booleans:
    """Return the part of a mask in bodies, connected through faces, that join both sides of a region across an axis."""
    labels, count = connected_components(mask, connectivity=6, periodic=periodic)
    others = tuple(k for k in range(3) if k != axis)
    layers = np.flatnonzero(region.any(axis=others))
    through = np.zeros(count + 1, dtype=bool)
    if len(layers):
        low, high = (labels.take(layers[end], axis=axis) for end in (0, -1))
        through[np.intersect1d(low, high)] = True
        through[0] = False
    return through[labels]
