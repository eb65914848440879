"""Resampling of images with conserved sum or nearest values, and cropping to the nonzero part."""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Floats, Integers, as_array, as_choice, as_count, as_floats, as_positive
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.lazy import load

#: upper bound of the number of voxels of an image
MOST_VOXELS = 2**32


@explained(hint="resample(image, factor=0.5)")
def resample(
    image: "ArrayLike", *, factor: float | None = None, shape: tuple[int, int, int] | None = None, method: str = "mean"
) -> NDArray[Any]:
    """Return an image of the same box with another number of voxels.

    Parameters
    ----------
    image : (nx, ny, nz) array_like
        Volume fractions, grey values or a mask; labels with the method ``"nearest"``.
    factor : float, optional
        Number of new voxels per old voxel along each axis: 0.5 halves the number of voxels, 2 doubles it; the result is
        rounded to whole numbers.
    shape : tuple of int, optional
        Number of new voxels along x, y, z; replaces `factor`.
    method : {"mean", "nearest"}
        ``"mean"`` averages over the volume of a new voxel, so that the sum times the volume of a voxel is conserved;
        ``"nearest"`` uses the value at the new center.

    Returns
    -------
    ndarray
        New image, of type float64 for means, otherwise of the type of `image`.

    Raises
    ------
    InputError
        If the image has not three axes, not exactly one of factor and shape is given, one is not above 0, or the
        method is unknown.
    TooLargeError
        If there would be 2**32 voxels or more.

    Notes
    -----
    Memory beside the image: that of the result, and for means 16 bytes per voxel of the larger image.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> vg.resample(np.arange(6.0).reshape(1, 1, 6), shape=(1, 1, 4))[0, 0].round(3).tolist()
    [0.333, 1.667, 3.333, 4.667]
    """
    given = as_array(image, "image")
    if given.ndim != 3 or not given.size:
        raise InputError(f"image has shape {given.shape}: three axes with voxels are needed")
    if (factor is None) == (shape is None):
        raise InputError("factor and shape: give exactly one of them")
    as_choice(method, "method", ("mean", "nearest"))
    if shape is None:
        wanted = [max(1.0, n * as_positive(factor, "factor")) for n in given.shape]
    else:
        wanted = as_floats(shape, "shape", shape=(3,)).tolist()
    if not math.prod(wanted) < MOST_VOXELS:
        many = math.prod(wanted)
        raise TooLargeError(f"the image would have {many:.3g} voxels: fewer than {MOST_VOXELS} fit; take fewer")
    counts = [as_count(n if factor is None else round(n), "shape", at_least=1) for n in wanted]
    if method == "nearest":
        places = [((np.arange(m) + 0.5) * n / m).astype(np.int64) for n, m in zip(given.shape, counts, strict=True)]
        return np.asarray(given[np.ix_(*places)])
    mean = np.asarray(given, dtype=np.float64)
    for axis, many in enumerate(counts):
        if many != mean.shape[axis]:
            lines = np.moveaxis(mean, axis, 0)
            flat = _overlaps(mean.shape[axis], many) @ lines.reshape(mean.shape[axis], -1)
            mean = np.moveaxis(flat.reshape(many, *lines.shape[1:]), 0, axis)
    return np.ascontiguousarray(mean)


@explained(hint="crop(image, margin=1)")
def crop(image: "ArrayLike", *, margin: int = 0) -> tuple[NDArray[Any], Integers]:
    """Return the part of an image that contains all nonzero voxels.

    Parameters
    ----------
    image : (nx, ny, nz) array_like
        Mask, labels or volume fractions.
    margin : int
        Number of additional layers on each side, within the image.

    Returns
    -------
    part : ndarray
        View of the image; empty if all voxels are 0.
    start : (3,) ndarray of int
        Index of the first voxel of the part.

    Raises
    ------
    InputError
        If the image has not three axes or the margin is below 0.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> image = np.zeros((5, 6, 7), dtype=int)
    >>> image[1, 2:4, 5] = 3
    >>> part, start = vg.crop(image, margin=1)
    >>> part.shape, start.tolist()
    ((3, 4, 3), [0, 1, 4])
    """
    given = as_array(image, "image")
    if given.ndim != 3:
        raise InputError(f"image has shape {given.shape}: three axes are needed")
    layers = min(as_count(margin, "margin"), max(given.shape))
    start, window = np.zeros(3, dtype=np.int64), []
    for axis in range(3):
        along = np.flatnonzero(given.any(axis=tuple(k for k in range(3) if k != axis)))
        first, behind = (along[0] - layers, along[-1] + 1 + layers) if len(along) else (0, 0)
        start[axis] = max(first, 0)
        window.append(slice(int(start[axis]), int(min(behind, given.shape[axis]))))
    return given[tuple(window)], start


def _overlaps(old: int, new: int) -> Any:
    """Return the sparse (new, old) matrix of the share of each old voxel in a new one."""
    edges = np.union1d(np.arange(old + 1) * new, np.arange(new + 1) * old).astype(np.int64)
    length: Floats = np.diff(edges) / old
    rows, columns = edges[:-1] // old, edges[:-1] // new
    return load("scipy.sparse").coo_array((length, (rows, columns)), shape=(new, old)).tocsr()
