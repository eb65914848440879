"""Connected components by SciPy: of images, joined across periodic faces, and of graphs."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Integers
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load
from voxgran._base.scalars import whole_number_of
from voxgran.lattice.distance import as_mask

#: number of coordinates in which neighbouring voxels may differ
_RANKS = {6: 1, 18: 2, 26: 3}


@explained(hint="connected_components(mask, connectivity=26)")
def connected_components(
    mask: "ArrayLike", *, connectivity: int = 6, periodic: Periodic = False
) -> tuple[NDArray[np.int32], int]:
    """Return numbers for the connected bodies of taken voxels.

    Parameters
    ----------
    mask : (nx, ny, nz) array_like of bool
        Mask of the occupied voxels.
    connectivity : {6, 18, 26}
        Number of neighbours that a voxel is connected to.
    periodic : str, bool or sequence
        Periodic axes, such as ``"xy"``, as in :class:`voxgran.Box`.

    Returns
    -------
    labels : (nx, ny, nz) ndarray of int32
        1 ... count, in the order of the lattice; 0 where nothing is taken.
    count : int
        Number of bodies.

    Raises
    ------
    InputError
        If the connectivity is none of the three, the image has not three axes, or `periodic` names no axes.

    Notes
    -----
    Memory beside the mask: 4 bytes per voxel for the labels; 8 bytes per voxel for a periodic image.

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
    ndimage = load("scipy.ndimage")
    taken = as_mask(mask)
    labels = np.empty(taken.shape, dtype=np.int32)
    count = int(ndimage.label(taken, ndimage.generate_binary_structure(3, rank), output=labels))
    if not count or not any(axes):
        return labels, count
    pairs = np.concatenate([_across(labels, axis, rank, axes) for axis in range(3) if axes[axis]], axis=1)
    # node 0, what is not taken, has no edges, so that the bodies are numbered from 1
    part = components(count + 1, *pairs).astype(np.int32)
    return part[labels], int(part.max())


def _across(labels: NDArray[np.int32], axis: int, rank: int, periodic: tuple[bool, bool, bool]) -> Integers:
    """Return the pairs of labels that are neighbours across the faces normal to a periodic axis, as (2, n)."""
    planes = np.moveaxis(labels, axis, 0)
    first, last = planes[0], planes[-1]
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
