"""Erosion, dilation, opening and closing with spheres of any radius, through the exact distance transform; and filters.

The cost does not depend on the radius (Serra 1982, Image analysis and mathematical morphology, for the operations).
The exterior of the image neither erodes nor dilates the interior. A dask array is treated block by block, with what
lies within the radius around each, to the same result.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Booleans, Floats, as_array, as_count, as_number
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.errors import InputError, shown
from voxgran._base.guarded import reason_of
from voxgran.lattice.distance import as_mask, distance_transform, lazy_mask
from voxgran.lattice.image import Edges, Image, are_equal, kept, known_edges, lazy_of, overlapped, windowed


@explained(hint="dilation(mask, 3); the radius is in voxels, or a length with voxel_size=")
def dilation(
    mask: "ArrayLike",
    radius: float,
    *,
    voxel_size: "ArrayLike | None" = None,
    periodic: Periodic = False,
    threads: int | None = None,
) -> Booleans:
    """Return the voxels within a distance of an occupied one.

    Parameters
    ----------
    mask : (nx, ny, nz) array_like of bool, or Image
        Mask of the occupied voxels.
    radius : float
        Radius of the sphere, at least 0, in voxels or in the unit of the voxel size; centers at exactly this distance
        are included.
    voxel_size : float or (3,) array_like of float, optional
        Edge of a voxel, or its edges along x, y and z. Default: those that an Image tells, otherwise the unit.
    periodic : str, bool or sequence
        Periodic axes, such as ``"xy"``, as in :class:`voxgran.Box`.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.

    Returns
    -------
    (nx, ny, nz) ndarray of bool

    Raises
    ------
    InputError
        If the image has not three axes, the radius is below 0, an edge of a voxel is not a length, or `periodic` names
        no axes.
    MissingLibraryError
        If the image is a dask array and zarr is not installed.

    Notes
    -----
    Memory beside the mask: 6 bytes per voxel, as for the other three; with unequal edges that of
    :func:`distance_transform`.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> mask = np.zeros((9, 9, 9), dtype=bool)
    >>> mask[4, 4, 4] = True
    >>> int(vg.dilation(mask, 2.0).sum())
    33
    """
    return _within(~_as_mask(mask), radius, known_edges(voxel_size, mask), periodic, threads)


@explained(hint="erosion(mask, 3); the radius is in voxels, or a length with voxel_size=")
def erosion(
    mask: "ArrayLike",
    radius: float,
    *,
    voxel_size: "ArrayLike | None" = None,
    periodic: Periodic = False,
    threads: int | None = None,
) -> Booleans:
    """Return the occupied voxels farther than a distance from every free one.

    Parameters
    ----------
    mask, radius, voxel_size, periodic, threads
        As :func:`dilation`.

    Returns
    -------
    (nx, ny, nz) ndarray of bool

    Raises
    ------
    InputError
        If the image has not three axes, the radius is below 0, an edge of a voxel is not a length, or `periodic` names
        no axes.
    MissingLibraryError
        If the image is a dask array and zarr is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> mask = np.zeros((9, 9, 9), dtype=bool)
    >>> mask[2:7, 2:7, 2:7] = True
    >>> int(vg.erosion(mask, 1.0).sum())
    27
    """
    return ~_within(_as_mask(mask), radius, known_edges(voxel_size, mask), periodic, threads)


@explained(hint="opening(mask, 3); the radius is in voxels, or a length with voxel_size=")
def opening(
    mask: "ArrayLike",
    radius: float,
    *,
    voxel_size: "ArrayLike | None" = None,
    periodic: Periodic = False,
    threads: int | None = None,
) -> Booleans:
    """Return the voxels covered by spheres inside the occupied ones: an erosion followed by a dilation.

    Parameters
    ----------
    mask, radius, voxel_size, periodic, threads
        As :func:`dilation`.

    Returns
    -------
    (nx, ny, nz) ndarray of bool

    Raises
    ------
    InputError
        If the image has not three axes, the radius is below 0, an edge of a voxel is not a length, or `periodic` names
        no axes.
    MissingLibraryError
        If the image is a dask array and zarr is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> mask = np.zeros((9, 9, 9), dtype=bool)
    >>> mask[2:7, 2:7, 2:7] = True
    >>> mask[4, 4, 8] = True
    >>> int(vg.opening(mask, 1.0).sum()), bool(vg.opening(mask, 1.0)[4, 4, 8])
    (81, False)
    """
    edges = known_edges(voxel_size, mask)
    core = erosion(mask, radius, voxel_size=edges, periodic=periodic, threads=threads)
    return dilation(core, radius, voxel_size=edges, periodic=periodic, threads=threads)


@explained(hint="closing(mask, 3); the radius is in voxels, or a length with voxel_size=")
def closing(
    mask: "ArrayLike",
    radius: float,
    *,
    voxel_size: "ArrayLike | None" = None,
    periodic: Periodic = False,
    threads: int | None = None,
) -> Booleans:
    """Return the occupied voxels and the gaps in which no sphere fits: a dilation followed by an erosion.

    Parameters
    ----------
    mask, radius, voxel_size, periodic, threads
        As :func:`dilation`.

    Returns
    -------
    (nx, ny, nz) ndarray of bool

    Raises
    ------
    InputError
        If the image has not three axes, the radius is below 0, an edge of a voxel is not a length, or `periodic` names
        no axes.
    MissingLibraryError
        If the image is a dask array and zarr is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> mask = np.ones((9, 9, 9), dtype=bool)
    >>> mask[4, 4, 4] = False
    >>> bool(vg.closing(mask, 1.0).all())
    True
    """
    edges = known_edges(voxel_size, mask)
    hull = dilation(mask, radius, voxel_size=edges, periodic=periodic, threads=threads)
    return erosion(hull, radius, voxel_size=edges, periodic=periodic, threads=threads)


@explained(hint="filter_image(image, scipy.ndimage.median_filter, size=3)")
def filter_image(
    image: "ArrayLike | Image",
    function: Callable[..., Any],
    *,
    depth: "int | Sequence[int] | None" = None,
    **options: Any,
) -> Image:
    """Apply a filter, such as those of `scipy.ndimage`, to an image of any size.

    Parameters
    ----------
    image : (nx, ny, nz) array_like or Image
        Values; a dask array, as :func:`voxgran.open_image` returns it, is filtered block by block.
    function : callable
        Called as ``function(values, **options)``; it returns as many values, each of which depends on those around it,
        as `scipy.ndimage.median_filter` does.
    depth : int or (3,) sequence of int, optional
        How many voxels around a voxel its result depends on, along each axis. Default: as the options say, half of
        `size`, `footprint`, `structure` or `weights` and `origin`; or `radius`, or `truncate`, which is 4, times
        `sigma`.
    **options
        What the function is given.

    Returns
    -------
    Image
        With the lattice of the image, and values of the type that the function returns. Those of a dask array are a
        dask array, which is computed at once and kept in the temporary folder of dask.

    Raises
    ------
    InputError
        If the image has not three axes, the function is none, does not take the values and options, or returns fewer or
        more values than it is given, or depth is neither given nor follows from the options.
    MissingLibraryError
        If the image is a dask array and zarr is not installed.

    Notes
    -----
    The result is that in memory, to the bit, if no sum of the function is longer than `depth`. Each block is read with
    what lies around it, where ``map_overlap`` of dask may hold most of the image.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> from scipy.ndimage import maximum_filter
    >>> dot = np.zeros((9, 9, 9), dtype=np.uint8)
    >>> dot[4, 4, 4] = 5
    >>> filtered = vg.filter_image(vg.open_image(dot, block=5), maximum_filter, size=3)
    >>> int(filtered.values.sum())
    135
    """
    if not callable(function):
        raise InputError(f"function is {shown(function)}: it must be called with values; give one of scipy.ndimage")
    lazy = lazy_of(image)
    given = image if isinstance(image, Image) else Image(as_array(image, "image") if lazy is None else lazy)
    if given.values.ndim != 3:
        raise InputError(f"image has the shape {given.values.shape}: three axes are needed; stack slices")

    def filtered(values: NDArray[Any]) -> NDArray[Any]:
        try:
            found = np.asarray(function(values, **options))
        except (TypeError, ValueError, RuntimeError) as error:
            raise InputError(
                f"function is {shown(function)}: it does not take values with {', '.join(options) or 'no options'} "
                f"({reason_of(error)}); give one of scipy.ndimage with its options"
            ) from error
        if found.shape != values.shape:
            raise InputError(
                f"function returns {found.shape} of {values.shape} values: a filter returns as many; give one"
            )
        return found

    if lazy is None:
        return replace(given, values=filtered(np.asarray(given.values)))
    depth = _reach(options) if depth is None else depth
    wide = [as_count(n, "depth") for n in np.broadcast_to(np.array(depth), 3).tolist()]
    turns = _each_axis(options, np.isin(options.get("mode", ""), ("wrap", "grid-wrap")))
    kind = filtered(np.ones((1, 1, 1), dtype=lazy.dtype)).dtype
    return replace(given, values=kept(windowed([lazy], filtered, wide, kind, turns.astype(bool).tolist())))


def _reach(options: dict[str, Any]) -> list[int]:
    """Return how far a filter of `scipy.ndimage` reaches along each axis.

    Raises
    ------
    InputError
        If its options do not tell.
    """
    kernels = [np.shape(options[name]) for name in ("footprint", "structure", "weights") if name in options]
    sizes = kernels + [options[name] for name in ("size",) if options.get(name) is not None]
    radius = options.get("radius")
    if not sizes and radius is None and "sigma" not in options:
        raise InputError(
            "depth is missing: none of sigma, size, footprint, structure and weights tells how far the filter reaches; "
            "give voxels"
        )
    if radius is None:
        radius = np.multiply(options.get("sigma", 0), options.get("truncate", 4.0)) + 0.5
    shifted = np.abs(_each_axis(options, options.get("origin", 0)))
    reach = [_each_axis(options, radius), *(_each_axis(options, size) // 2 + shifted for size in sizes)]
    return np.max(reach, axis=0).astype(int).tolist()


def _each_axis(options: dict[str, Any], value: Any) -> Floats:
    """Return an option along each of the three axes; 0 along those that the filter leaves out."""
    along = np.zeros(3)
    axes = options.get("axes")
    along[slice(None) if axes is None else np.atleast_1d(axes)] = value
    return along


def _as_mask(mask: "ArrayLike") -> Any:
    """Return an image as an array of bool, in blocks if it is a dask array."""
    return as_mask(mask) if (lazy := lazy_of(mask)) is None else lazy_mask(lazy)


def _within(mask: Any, radius: float, edges: Edges | None, periodic: Periodic, threads: int | None) -> Any:
    """Return the voxels within a distance of a free one."""
    reach = as_number(radius, "radius", at_least=0.0)
    if lazy_of(mask) is not None:
        # one voxel more than the radius, for rounding
        step = (1.0, 1.0, 1.0) if edges is None else edges
        return overlapped(
            kept(mask),
            lambda block: _within(block, reach, edges, False, 1),
            reach + min(step),
            step,
            as_periodic(periodic),
            np.bool_,
        )
    if edges is not None and not are_equal(edges):
        out = np.empty(mask.shape)
        distance_transform(mask, voxel_size=edges, periodic=periodic, threads=threads, out=out)
        return np.asarray(out <= reach * (1 + 1e-12))
    reach /= 1.0 if edges is None else min(edges)
    squares = distance_transform(mask, periodic=periodic, squared=True, threads=threads)
    # radii such as sqrt(2) include the centers at exactly this distance
    return np.asarray(squares <= min(reach * reach * (1 + 1e-12), 2.0**29))
