"""Connected bodies on a lattice: runs along z, joined where they are neighbours.

Runs of neighbouring columns are compared in one sweep and joined in a forest whose roots are the first runs of their
bodies (union by the lower index, Tarjan 1975, doi:10.1145/321879.321884); so the numbering is that of the lattice.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.errors import InputError, shown
from voxgran._base.kernels import kernel
from voxgran._base.scalars import whole_number_of
from voxgran.lattice.distance import as_mask

#: how many axes a step to a neighbour may change
_RANKS = {6: 1, 18: 2, 26: 3}


def connected_components(
    mask: ArrayLike, *, connectivity: int = 6, periodic: Periodic = False
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
    Memory beside the mask: 4 bytes per voxel for the labels and 12 bytes a run.

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
    around_x, around_y, around_z = as_periodic(periodic)
    taken = as_mask(mask)
    nx, ny, _ = taken.shape
    first = np.zeros(nx * ny + 1, dtype=np.int64)
    _count_runs(taken, first)
    np.cumsum(first, out=first)
    runs, root = np.empty((first[-1], 2), dtype=np.int32), np.arange(first[-1], dtype=np.int32)
    _note_runs(taken, first, runs)
    _join(runs, first, taken.shape, rank, around_x, around_y, around_z, root)
    labels = np.zeros(taken.shape, dtype=np.int32)
    return labels, int(_paint(runs, first, root, labels))


@kernel
def _count_runs(taken, first):  # type: ignore[no-untyped-def]
    """Count the runs of each column."""
    nx, ny, nz = taken.shape
    for i in range(nx):
        for j in range(ny):
            many, before = 0, False
            for k in range(nz):
                many += taken[i, j, k] and not before
                before = taken[i, j, k]
            first[i * ny + j + 1] = many


@kernel
def _note_runs(taken, first, runs):  # type: ignore[no-untyped-def]
    """Note where each run begins and ends."""
    nx, ny, nz = taken.shape
    for i in range(nx):
        for j in range(ny):
            r, before = first[i * ny + j], False
            for k in range(nz):
                if taken[i, j, k] and not before:
                    runs[r, 0] = k
                if before and not taken[i, j, k]:
                    runs[r, 1] = k
                    r += 1
                before = taken[i, j, k]
            if before:
                runs[r, 1] = nz


@kernel
def _root(root, r):  # type: ignore[no-untyped-def]
    """Return the root of a run, and shorten the way to it."""
    while root[r] != r:
        root[r] = root[root[r]]
        r = root[r]
    return r


@kernel
def _unite(root, a, b):  # type: ignore[no-untyped-def]
    """Join two bodies under the root that comes first."""
    a, b = _root(root, a), _root(root, b)
    root[max(a, b)] = min(a, b)


@kernel
def _join_columns(runs, a, a_end, b, b_end, reach, nz, around, root):  # type: ignore[no-untyped-def]
    """Join the runs of two columns that meet, or that meet when one is longer by `reach` at both ends."""
    if a == a_end or b == b_end:
        return
    if around and reach:
        if runs[a, 0] == 0 and runs[b_end - 1, 1] == nz:
            _unite(root, a, b_end - 1)
        if runs[b, 0] == 0 and runs[a_end - 1, 1] == nz:
            _unite(root, b, a_end - 1)
    while a < a_end and b < b_end:
        if runs[a, 0] < runs[b, 1] + reach and runs[b, 0] < runs[a, 1] + reach:
            _unite(root, a, b)
        if runs[a, 1] < runs[b, 1]:
            a += 1
        else:
            b += 1


@kernel
def _join(runs, first, shape, rank, around_x, around_y, around_z, root):  # type: ignore[no-untyped-def]
    """Join the runs of all neighbouring columns."""
    nx, ny, nz = shape
    for i in range(nx):
        for j in range(ny):
            here = i * ny + j
            a, a_end = first[here], first[here + 1]
            if a == a_end:
                continue
            if around_z and runs[a, 0] == 0 and runs[a_end - 1, 1] == nz:
                _unite(root, a, a_end - 1)
            for step in range(4):
                di, dj = (0 if step == 0 else -1), (-1 if step < 2 else step - 2)
                if abs(di) + abs(dj) > rank:
                    continue
                u, v = i + di, j + dj
                if u < 0 and around_x:
                    u += nx
                if v < 0 and around_y:
                    v += ny
                if v >= ny and around_y:
                    v -= ny
                if u < 0 or v < 0 or v >= ny:
                    continue
                there = u * ny + v
                reach = 1 if abs(di) + abs(dj) < rank else 0
                _join_columns(runs, a, a_end, first[there], first[there + 1], reach, nz, around_z, root)


@kernel
def _paint(runs, first, root, labels):  # type: ignore[no-untyped-def]
    """Fill the runs with the numbers of their bodies; return how many there are."""
    nx, ny, _ = labels.shape
    count = 0
    number = np.empty(len(root), np.int32)
    for r in range(len(root)):
        top = _root(root, r)
        if top == r:
            count += 1
            number[r] = count
        else:
            number[r] = number[top]
    for i in range(nx):
        for j in range(ny):
            for r in range(first[i * ny + j], first[i * ny + j + 1]):
                for k in range(runs[r, 0], runs[r, 1]):
                    labels[i, j, k] = number[r]
    return count
