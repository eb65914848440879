"""Erosion, dilation, opening and closing with spheres of any radius, through the exact distance transform.

The cost does not depend on the radius (Serra 1982, Image analysis and mathematical morphology, for the operations).
The exterior of the image neither erodes nor dilates the interior. A dask array is treated block by block, with what
lies within the radius around each, to the same result.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Booleans, as_number
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran.lattice.blocks import lazy_of, overlapped
from voxgran.lattice.distance import as_mask, distance_transform, lazy_mask
from voxgran.lattice.image import Edges, are_equal, known_edges


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
            mask,
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
