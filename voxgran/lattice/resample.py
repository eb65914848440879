"""Resampling of images with conserved sum or nearest values, and cropping to the nonzero part."""

import math
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Floats, Integers, as_array, as_choice, as_count, as_floats, as_positive, float_array
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.lazy import load
from voxgran.lattice.image import Image, block_library, known_edges, lazy_of

#: upper bound of the number of voxels of an image
MOST_VOXELS = 2**32
#: largest denominator of a ratio of edges
FINEST = 10_000


@explained(hint="resample(image, factor=0.5)")
def resample(
    image: "ArrayLike | Image",
    *,
    factor: "ArrayLike | None" = None,
    shape: tuple[int, int, int] | None = None,
    to: Literal["cubic"] | None = None,
    voxel_size: "ArrayLike | None" = None,
    method: str = "mean",
) -> Any:
    """Return an image of the same box with another number of voxels.

    Parameters
    ----------
    image : (nx, ny, nz) array_like or Image
        Volume fractions, grey values or a mask; labels with the method ``"nearest"``. A dask array stays in blocks,
        with the same result to the bit.
    factor : float or (3,) array_like of float, optional
        Number of new voxels per old voxel along each axis, or along x, y and z: 0.5 halves the number of voxels, 2
        doubles it; the result is rounded to whole numbers.
    shape : tuple of int, optional
        Number of new voxels along x, y, z; replaces `factor`.
    to : {"cubic"}, optional
        Makes cubes of the smallest edge of a voxel; replaces `factor`. Where an edge of the box is no whole number of
        cubes, the last cubes end up to half a cube before or behind it.
    voxel_size : float or (3,) array_like of float, optional
        Edge of a voxel, or its edges along x, y and z, which ``to="cubic"`` needs. Default: those that an Image tells.
    method : {"mean", "nearest"}
        ``"mean"`` averages over the volume of a new voxel, so that the sum times the volume of a voxel is conserved;
        ``"nearest"`` uses the value at the new center.

    Returns
    -------
    ndarray or Image
        New image, of type float64 for means, otherwise of the type of `image`; an Image, with the new edges of a voxel,
        if an Image is given.

    Raises
    ------
    InputError
        If the image has not three axes, not exactly one of factor, shape and to is given, one is not above 0, cubes are
        asked for where the edges of a voxel are unknown, or the method is unknown.
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
    >>> vg.resample(np.ones((4, 4, 3)), to="cubic", voxel_size=(0.1, 0.1, 0.2)).shape
    (4, 4, 6)
    """
    lazy = lazy_of(image)
    given = as_array(image, "image") if lazy is None else lazy
    if given.ndim != 3 or not given.size:
        raise InputError(f"image has shape {given.shape}: three axes with voxels are needed")
    if sum(entry is None for entry in (factor, shape, to)) != 2:
        raise InputError("factor, shape and to: give exactly one of them")
    as_choice(method, "method", ("mean", "nearest"))
    edges = known_edges(voxel_size, image)
    if to is not None:
        as_choice(to, "to", ("cubic",))
        if edges is None:
            raise InputError("voxel_size is None: the image does not tell it; give the edges of a voxel to make cubes")
        wanted = [max(1.0, n * edge / min(edges)) for n, edge in zip(given.shape, edges, strict=True)]
    elif shape is None:
        factors = float_array(factor)
        if factors is None or factors.shape != (3,):
            factors = np.full(3, as_positive(factor, "factor"))
        each = [as_positive(value, "factor") for value in factors.tolist()]
        wanted = [max(1.0, n * value) for n, value in zip(given.shape, each, strict=True)]
    else:
        wanted = as_floats(shape, "shape", shape=(3,)).tolist()
    if not math.prod(wanted) < MOST_VOXELS:
        many = math.prod(wanted)
        raise TooLargeError(f"the image would have {many:.3g} voxels: fewer than {MOST_VOXELS} fit; take fewer")
    counts = [as_count(n if shape is not None else round(n), "shape", at_least=1) for n in wanted]
    parts = list(zip(counts, given.shape, strict=True))
    if to is not None and edges is not None:
        parts = [Fraction(edge / min(edges)).limit_denominator(FINEST).as_integer_ratio() for edge in edges]
    made = _means(given, counts, parts) if method == "mean" else _nearest(given, counts, parts)
    if not isinstance(image, Image):
        return made
    if edges is not None:
        x, y, z = (edge * new / old for edge, (old, new) in zip(edges, parts, strict=True))
        edges = (x, y, z) if to is None else (min(edges),) * 3
    return replace(image, values=made, voxel_size=edges)


def _nearest(given: NDArray[Any], counts: list[int], parts: list[tuple[int, int]]) -> NDArray[Any]:
    """Return the values at the new centers; `parts` are the edges of old and new voxels along each axis in a common
    unit.
    """
    places = [
        np.minimum((2 * np.arange(many) + 1) * new // (2 * old), n - 1)
        for n, many, (old, new) in zip(given.shape, counts, parts, strict=True)
    ]
    return at_places(given, places)


def at_places(values: Any, places: Sequence[Integers]) -> Any:
    """Return the values at some places along each axis, of an array or a dask array."""
    if lazy_of(values) is None:
        return np.asarray(values[np.ix_(*places)])
    for axis, along in enumerate(places):
        values = values[(slice(None),) * axis + (along,)]
    return values


def _means(given: Any, counts: list[int], parts: list[tuple[int, int]]) -> Any:
    """Return the means over new voxels, as far as they lie within the image, of an array or a dask array."""
    mean = given.astype(np.float64)
    for axis, (many, (old, new)) in enumerate(zip(counts, parts, strict=True)):
        n = mean.shape[axis]
        if (many, old) == (n, new):
            continue
        shares = _overlaps(n, many, old, new)
        if lazy_of(mean) is None:
            mean = _along(mean, shares, axis)
            continue
        step, made = math.ceil(many * mean.chunksize[axis] / n), []
        for low in range(0, many, step):
            rows = shares[low : low + step]
            some = slice(int(rows.indices.min()), int(rows.indices.max()) + 1)
            lines = mean[(slice(None),) * axis + (some,)].rechunk({axis: -1})
            chunks = (*lines.chunks[:axis], (rows.shape[0],), *lines.chunks[axis + 1 :])
            made.append(lines.map_blocks(_along, rows[:, some], axis, dtype=np.float64, chunks=chunks))
        mean = block_library("dask.array").concatenate(made, axis=axis)
    return np.ascontiguousarray(mean) if lazy_of(mean) is None else mean


def _along(mean: Floats, shares: Any, axis: int) -> Floats:
    """Return the sums, along an axis, of some shares (many, n) of the values."""
    lines = np.moveaxis(mean, axis, 0)
    flat = shares @ lines.reshape(len(lines), -1)  # bits: sparse
    return np.moveaxis(flat.reshape(-1, *lines.shape[1:]), 0, axis)


@explained(hint="crop(image, margin=1)")
def crop(image: "ArrayLike", *, margin: int = 0) -> tuple[NDArray[Any], Integers]:
    """Return the part of an image that contains all nonzero voxels.

    Parameters
    ----------
    image : (nx, ny, nz) array_like
        Mask, labels or volume fractions; a dask array is searched and stays in blocks.
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
    lazy = lazy_of(image)
    given = as_array(image, "image") if lazy is None else lazy
    if given.ndim != 3:
        raise InputError(f"image has shape {given.shape}: three axes are needed")
    layers = min(as_count(margin, "margin"), max(given.shape))
    start, window = np.zeros(3, dtype=np.int64), []
    for axis in range(3):
        along = np.flatnonzero(np.asarray(given.any(axis=tuple(k for k in range(3) if k != axis))))
        first, behind = (along[0] - layers, along[-1] + 1 + layers) if len(along) else (0, 0)
        start[axis] = max(first, 0)
        window.append(slice(int(start[axis]), int(min(behind, given.shape[axis]))))
    return given[tuple(window)], start


def _overlaps(n: int, many: int, old: int, new: int) -> Any:
    """Return the sparse (many, n) matrix of the share of each old voxel in the part of a new one within the image, by
    the edges of both in a common unit.
    """
    end = min(n * old, many * new)
    edges = np.union1d(np.arange(n + 1) * old, np.arange(many + 1) * new).astype(np.int64)
    edges = edges[edges <= end]
    rows, columns = edges[:-1] // new, edges[:-1] // old
    lengths = np.diff(edges)
    shares: Floats = lengths / np.bincount(rows, lengths)[rows]
    return load("scipy.sparse").coo_array((shares, (rows, columns)), shape=(many, n)).tocsr()
