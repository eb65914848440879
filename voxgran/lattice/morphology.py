"""Erosion, dilation, opening and closing with spheres of any radius, through the exact distance transform.

The cost does not depend on the radius (Serra 1982, Image analysis and mathematical morphology, for the operations).
Beyond the image there is nothing: it neither erodes nor dilates what is inside.
"""

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Booleans, as_number
from voxgran._base.axes import Periodic
from voxgran.lattice.distance import as_mask, distance_transform


def dilation(mask: ArrayLike, radius: float, *, periodic: Periodic = False, threads: int = 1) -> Booleans:
    """Return the voxels within a distance of a taken one.

    Parameters
    ----------
    mask : (nx, ny, nz) array_like of bool
        Taken voxels.
    radius : float
        Radius of the sphere in voxels, at least 0; centers at just this distance count.
    periodic : str, bool or sequence
        Axes along which the image repeats, such as ``"xy"``; as of :class:`voxgran.Box`.
    threads : int
        Threads; the result does not depend on them.

    Returns
    -------
    (nx, ny, nz) ndarray of bool

    Raises
    ------
    InputError
        If the image has not three axes, the radius is below 0, or `periodic` names no axes.

    Notes
    -----
    Memory beside the mask: 6 bytes a voxel, as for the other three.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> mask = np.zeros((9, 9, 9), dtype=bool)
    >>> mask[4, 4, 4] = True
    >>> int(vg.dilation(mask, 2.0).sum())
    33
    """
    return _within(~as_mask(mask), radius, periodic, threads)


def erosion(mask: ArrayLike, radius: float, *, periodic: Periodic = False, threads: int = 1) -> Booleans:
    """Return the taken voxels farther than a distance from every free one.

    Parameters
    ----------
    mask, radius, periodic, threads
        As :func:`dilation`.

    Returns
    -------
    (nx, ny, nz) ndarray of bool

    Raises
    ------
    InputError
        If the image has not three axes, the radius is below 0, or `periodic` names no axes.
    """
    return ~_within(as_mask(mask), radius, periodic, threads)


def opening(mask: ArrayLike, radius: float, *, periodic: Periodic = False, threads: int = 1) -> Booleans:
    """Return what spheres cover that fit into the taken voxels: an erosion, then a dilation.

    Parameters
    ----------
    mask, radius, periodic, threads
        As :func:`dilation`.

    Returns
    -------
    (nx, ny, nz) ndarray of bool

    Raises
    ------
    InputError
        If the image has not three axes, the radius is below 0, or `periodic` names no axes.
    """
    core = erosion(mask, radius, periodic=periodic, threads=threads)
    return dilation(core, radius, periodic=periodic, threads=threads)


def closing(mask: ArrayLike, radius: float, *, periodic: Periodic = False, threads: int = 1) -> Booleans:
    """Return the taken voxels and the gaps between them into which no sphere fits: a dilation, then an erosion.

    Parameters
    ----------
    mask, radius, periodic, threads
        As :func:`dilation`.

    Returns
    -------
    (nx, ny, nz) ndarray of bool

    Raises
    ------
    InputError
        If the image has not three axes, the radius is below 0, or `periodic` names no axes.
    """
    hull = dilation(mask, radius, periodic=periodic, threads=threads)
    return erosion(hull, radius, periodic=periodic, threads=threads)


def _within(mask: Booleans, radius: float, periodic: Periodic, threads: int) -> Booleans:
    """Return the voxels within a distance of a free one."""
    reach = as_number(radius, "radius", at_least=0.0)
    squares = distance_transform(mask, periodic=periodic, squared=True, threads=threads)
    # radii such as sqrt(2) hold the centers at just their distance
    return np.asarray(squares <= min(reach * reach * (1 + 1e-12), 2.0**29))
