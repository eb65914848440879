"""Exact Euclidean distances on a lattice.

The squared distance of a voxel from the nearest free one is a sum over the axes and is therefore computed axis by axis,
in integers (Felzenszwalb & Huttenlocher 2012, doi:10.4086/toc.2012.v008a019). Along the second and the third axis 64
lines are processed at once. For short distances, as in the pores and grains of a packing, neighbours are scanned up to
the distance at which they can no longer contribute (Meijster, Roerdink & Hesselink 2000,
doi:10.1007/0-306-47025-X_36); for long distances the lower envelope of parabolas is constructed line by line. Both give
the same bits.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Booleans, Floats, as_array, check_type
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.compiling.threads import in_blocks, using_threads
from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.kernels import kernel
from voxgran._base.lazy import load
from voxgran.lattice.image import Edges, are_equal, block_library, kept, known_edges, lazy_of, overlapped

#: squared distance without a free voxel; larger than any in an accepted lattice
NEVER = 2**30
#: distance above which the envelope is faster than the scan of neighbours
LONG = 40.0
#: voxels of which a thread takes no fewer
LEAST_VOXELS = 2**15
#: width in voxels of the first surroundings of a block
NEAR = 16


@explained(hint="distance_transform(mask); distances are in voxels, or in lengths with voxel_size=")
def distance_transform(
    mask: "ArrayLike",
    *,
    voxel_size: "ArrayLike | None" = None,
    periodic: Periodic = False,
    squared: bool = False,
    threads: int | None = None,
    out: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """Return the exact distance of each occupied voxel's center from that of the nearest free voxel.

    Parameters
    ----------
    mask : (nx, ny, nz) array_like of bool, or Image
        Mask of the occupied voxels; the exterior of the image counts neither as occupied nor as free. A dask array is
        computed block by block, with the same result, on the threads of dask.
    voxel_size : float or (3,) array_like of float, optional
        Edge of a voxel, or its edges along x, y and z. Default: those that an Image tells, otherwise the unit.
    periodic : str, bool or sequence
        Periodic axes, such as ``"xy"``, as in :class:`voxgran.Box`.
    squared : bool
        Whether to return squared distances, as whole numbers, which they are in voxels only.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.
    out : (nx, ny, nz) ndarray of float32, float64 or int32, optional
        Array for the result, of type int32 for squared distances. Default: a new array.

    Returns
    -------
    (nx, ny, nz) ndarray
        Distances in the unit of the voxel size, or in voxels: float32, or int32 for squared distances; 0 for free
        voxels; for a dask array a dask array. Without any free voxel they are infinite, or 2**30 for squared distances.

    Raises
    ------
    InputError
        If the image has not three axes, an edge of a voxel is not a length, `out` has another shape or type, squared
        distances are asked for in lengths, `out` is given for a dask array, or `periodic` names no axes.
    TooLargeError
        If the diagonal of the image is longer than 2**15 voxels.
    MissingLibraryError
        If the image is a dask array and zarr is not installed.

    Notes
    -----
    Memory beside the mask: 4 bytes per voxel for the result and 4 for the squares it is made from (squared: 4 in all).
    Unequal edges are left to `scipy.ndimage.distance_transform_edt`, on one thread, with 70 bytes per voxel of the
    image and of half a period on each side of a periodic axis. A dask array is computed block by block with what lies
    around a block up to the largest distance, which is sought first: the mask is kept in the temporary folder of dask,
    and each thread has two such parts in memory.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> mask = np.ones((1, 1, 6), dtype=bool)
    >>> mask[0, 0, 1] = False
    >>> vg.distance_transform(mask)[0, 0].tolist()
    [1.0, 0.0, 1.0, 2.0, 3.0, 4.0]
    >>> vg.distance_transform(mask, periodic="z")[0, 0].tolist()
    [1.0, 0.0, 1.0, 2.0, 3.0, 2.0]
    """
    edges = known_edges(voxel_size, mask)
    turns, lazy = as_periodic(periodic), lazy_of(mask)
    if lazy is not None:
        return _of_blocks(lazy_mask(lazy), edges, turns, squared, out)
    taken = as_mask(mask)
    if sum(n * n for n in taken.shape) >= NEVER:
        raise TooLargeError(f"mask has shape {taken.shape}: its diagonal must be shorter than 2**15 voxels; cut it")
    _refuse_squared(squared, edges)
    wanted = (np.dtype(np.int32),) if squared else (np.dtype(np.float32), np.dtype(np.float64))
    check_type(out, (np.ndarray, type(None)), "out", "an array; leave it out for a new one")
    if out is not None and (out.shape != taken.shape or out.dtype not in wanted):
        raise InputError(
            f"out has shape {out.shape} and type {out.dtype}: it must have shape {taken.shape} and type {wanted[0]}"
        )
    if edges is not None and not are_equal(edges):
        result = np.empty(taken.shape, dtype=np.float32) if out is None else out
        result[...] = _unequal(taken, edges, turns)
        return result
    squares = np.empty(taken.shape, dtype=np.int32) if out is None or not squared else out
    least = max(1, LEAST_VOXELS // max(max(taken.shape[0], taken.shape[1]) * taken.shape[2], 1))
    with using_threads(threads):
        in_blocks(_pass_planes, taken.shape[0], taken, squares, turns[2], turns[1], LONG, least=least)
        in_blocks(_pass_columns, taken.shape[1], squares, turns[0], LONG, least=least)
    if squared:
        return squares
    result = np.empty(taken.shape, dtype=np.float32) if out is None else out
    np.sqrt(squares, out=result, casting="unsafe", dtype=result.dtype)
    if squares.size and squares.max() == NEVER:
        result[squares == NEVER] = np.inf
    if edges is not None:
        result *= min(edges)
    return result


def _refuse_squared(squared: bool, edges: Edges | None) -> None:
    """Refuse squared distances in lengths."""
    if squared and edges is not None:
        raise InputError(
            f"squared is True and voxel_size is {edges}: squared distances are whole numbers of voxels; give an array "
            "without voxel_size, or square the distances"
        )


def _of_blocks(mask: Any, edges: Edges | None, turns: tuple[bool, bool, bool], squared: bool, out: Any) -> Any:
    """Return distances of a dask array, of blocks with surroundings as wide as the largest distance that is found.

    A distance that is no longer than the surroundings are wide is the true one, and any other is too long.
    """
    _refuse_squared(squared, edges)
    if out is not None:
        raise InputError("out is given for an image in blocks: the result is a dask array; leave it out")
    step, mask = (1.0, 1.0, 1.0) if edges is None else edges, kept(mask)

    def found(block: Booleans) -> NDArray[Any]:
        return distance_transform(block, voxel_size=edges, squared=squared, threads=1)

    reach = NEAR * min(step)
    while True:
        dtype = np.int32 if squared else np.float32
        distances = overlapped(mask, found, reach, step, turns, dtype)
        largest = np.asarray(distances.max()).item()
        if squared:
            largest = math.inf if largest == NEVER else math.sqrt(largest)
        whole = all(math.ceil(reach / edge) >= n for edge, n in zip(step, mask.shape, strict=True))
        if largest <= reach or whole:
            return distances
        if largest == math.inf and mask.all():
            return block_library("dask.array").full_like(mask, NEVER if squared else np.inf, dtype=dtype)
        # a distance may be larger than a true one, but for rounding not smaller
        reach = 2 * reach if largest == math.inf else largest * (1 + 1e-6)


def _unequal(taken: Booleans, edges: Edges, around: tuple[bool, bool, bool]) -> Floats:
    """Return distances for voxels with unequal edges, by SciPy; the nearest free voxel across a periodic face is no
    farther than half a period along each axis.
    """
    if taken.all():
        return np.full(taken.shape, np.inf)
    beside = [n // 2 if turn else 0 for n, turn in zip(taken.shape, around, strict=True)]
    wide = np.pad(taken, [(n, n) for n in beside], mode="wrap")
    inner = tuple(slice(k, k + n) for k, n in zip(beside, taken.shape, strict=True))
    found: Floats = load("scipy.ndimage").distance_transform_edt(wide, sampling=edges)[inner]
    return found


def inside_distance(mask: Booleans, voxel_size: float) -> Floats:
    """Return the distance of each occupied voxel's center from the nearest free voxel, minus half a voxel; 0 for free
    voxels.

    This is the radius of the largest sphere about the center inside the occupied voxels, within half a voxel's
    diagonal, in the unit of the voxel size. The exterior of the lattice counts as free.
    """
    squares = distance_transform(np.pad(mask, 1), squared=True)[1:-1, 1:-1, 1:-1]
    return np.asarray(np.maximum(np.sqrt(squares.astype(np.float64)) - 0.5, 0.0) * voxel_size)


def as_mask(image: "ArrayLike", name: str = "mask") -> Booleans:
    """Return an image as a contiguous (nx, ny, nz) array of bool.

    Raises
    ------
    InputError
        If the image does not have three axes, or contains values other than bool, 0 and 1.
    """
    array = as_array(image, name)
    if array.ndim != 3:
        raise InputError(f"{name} has shape {array.shape}: three axes x, y, z are needed; give a slice an axis of one")
    if array.dtype != np.bool_:
        if array.dtype.kind not in "iu" or (array.size and (array.min() < 0 or array.max() > 1)):
            raise InputError(f"{name} holds {array.dtype}: taken voxels are True or 1; compare labels with 0 first")
        array = array.astype(np.bool_)
    return np.ascontiguousarray(array)


def lazy_mask(image: Any) -> Any:
    """Return a dask array as one of bool; values other than bool, 0 and 1 are refused when they are computed.

    Raises
    ------
    InputError
        If the image does not have three axes, or no whole numbers.
    """
    if image.dtype.kind not in "biu" or image.ndim != 3:
        return as_mask(np.empty((0,) * image.ndim, dtype=image.dtype), "mask")
    return image if image.dtype == np.bool_ else image.map_blocks(as_mask, "mask", dtype=np.bool_)


@kernel
def _pass_planes(taken, squares, around_z, around_y, far, begin, end):  # type: ignore[no-untyped-def]
    """Fill planes across x with the squared distances within each plane."""
    ny = taken.shape[1]
    lines, found = np.empty((ny, 64), np.int32), np.empty((ny, 64), np.int32)
    height, place = np.empty(2 * ny + 2, np.int64), np.empty(2 * ny + 2, np.int64)
    for i in range(begin, end):
        for j in range(ny):
            _walk(taken[i, j], squares[i, j], around_z)
        _pass_plane(squares, False, i, lines, found, height, place, around_y, far)


@kernel
def _pass_columns(squares, around, far, begin, end):  # type: ignore[no-untyped-def]
    """Add the contribution along x, for planes across y."""
    nx = squares.shape[0]
    lines, found = np.empty((nx, 64), np.int32), np.empty((nx, 64), np.int32)
    height, place = np.empty(2 * nx + 2, np.int64), np.empty(2 * nx + 2, np.int64)
    for j in range(begin, end):
        _pass_plane(squares, True, j, lines, found, height, place, around, far)


@kernel
def _pass_plane(squares, across_y, at, lines, found, height, place, around, far):  # type: ignore[no-untyped-def]
    """Add the contribution along x (of a plane across y) or y (of a plane across x), 64 lines at a time."""
    n, nz = len(lines), squares.shape[2]
    for first in range(0, nz, 64):
        width = min(64, nz - first)
        longest = np.int32(0)
        for k in range(n):
            i, j = (k, at) if across_y else (at, k)
            for t in range(width):
                lines[k, t] = squares[i, j, first + t]
                longest = max(longest, lines[k, t])
            for t in range(width, 64):
                lines[k, t] = 0
        if longest == 0:
            continue
        _find_lowest(lines, width, longest, found, height, place, around, far)
        for k in range(n):
            i, j = (k, at) if across_y else (at, k)
            for t in range(width):
                squares[i, j, first + t] = found[k, t]


@kernel
def _walk(taken, squares, around):  # type: ignore[no-untyped-def]
    """Fill a line with the squared distance from the nearest free voxel along it."""
    n, never = len(taken), np.int32(2**30)
    count = np.int32(2**15)
    if around:
        # the last free voxel, from the other end
        for k in range(n):
            count = np.int32(0) if not taken[n - 1 - k] else count
            if count == 0:
                count = np.int32(k)
                break
    for k in range(n):
        count = np.int32(0) if not taken[k] else np.int32(count + 1)
        squares[k] = count
    count = np.int32(2**15)
    if around:
        for k in range(n):
            if not taken[k]:
                count = np.int32(k)
                break
    for k in range(n - 1, -1, -1):
        count = np.int32(0) if not taken[k] else np.int32(count + 1)
        least = min(squares[k], count)
        squares[k] = never if least >= np.int32(2**15) else np.int32(least * least)


@kernel
def _find_lowest(lines, width, longest, found, height, place, around, far):  # type: ignore[no-untyped-def]
    """Compute the minimum of value + distance^2 along 64 lines by the faster method."""
    if longest > far * far and len(lines) > far:
        for t in range(width):
            _envelope(lines, t, found, height, place, around, np.int32(2**30))
    else:
        _look(lines, found, np.empty(64, np.int32), around)


@kernel
def _look(lines, found, low, around):  # type: ignore[no-untyped-def]
    """Compute the minimum of value + distance^2 along 64 lines at once, by a scan of increasing distance."""
    n = len(lines)
    for j in range(n):
        largest = np.int32(0)
        for t in range(64):
            low[t] = lines[j, t]
        for t in range(64):
            largest = max(largest, low[t])
        d = 1
        while d * d < largest and d < n:
            square = np.int32(d * d)
            back, ahead = j - d, j + d
            if around:
                back, ahead = back + n if back < 0 else back, ahead - n if ahead >= n else ahead
            if back >= 0:
                for t in range(64):
                    low[t] = min(low[t], np.int32(lines[back, t] + square))
            if ahead < n:
                for t in range(64):
                    low[t] = min(low[t], np.int32(lines[ahead, t] + square))
            if d & 3 == 0:
                largest = np.int32(0)
                for t in range(64):
                    largest = max(largest, low[t])
            d += 1
        for t in range(64):
            found[j, t] = min(low[t], np.int32(2**30))


@kernel
def _envelope(lines, t, found, height, place, around, never):  # type: ignore[no-untyped-def]
    """Compute the minimum of value + distance^2 along one line, by the lower envelope of parabolas in integers."""
    n = len(lines)
    # a periodic line is extended by half its length at both ends
    before = n // 2 if around else 0
    many = -1
    for q in range(-before, n + before):
        value = lines[(q + n) % n, t] if around else lines[q, t]
        if value >= never:
            continue
        start = -before
        while many >= 0:
            p = place[many]
            other = lines[(p + n) % n, t] if around else lines[p, t]
            # the first integer at which q lies below p
            start = (np.int64(value) + q * q - other - p * p) // (2 * (q - p)) + 1
            if start <= height[many]:
                many -= 1
            else:
                break
        if many < 0:
            start = -before
        if start < n:
            many += 1
            place[many], height[many] = q, start
    if many < 0:
        for j in range(n):
            found[j, t] = never
        return
    at = 0
    for j in range(n):
        while at < many and height[at + 1] <= j:
            at += 1
        p = place[at]
        value = lines[(p + n) % n, t] if around else lines[p, t]
        found[j, t] = np.int32(value + (j - p) * (j - p))
