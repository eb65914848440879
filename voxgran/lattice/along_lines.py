"""Statistics of an image along its axes: two-point correlation and chord lengths, for any edges of voxels."""

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran.lattice.distance import as_mask
from voxgran.lattice.image import known_edges


@explained(hint="two_point_correlation(labels > 0, periodic='xyz')")
def two_point_correlation(
    mask: "ArrayLike", *, voxel_size: "ArrayLike | None" = None, periodic: Periodic = False
) -> tuple[tuple[Floats, Floats], ...]:
    """Return the probability that both ends of a line along an axis lie in taken voxels, by the length of the line.

    At length 0 it is the share of the taken voxels, its slope there is minus a quarter of the specific surface in
    isotropic images, and far away it is the square of the share (Debye, Anderson & Brumberger 1957,
    doi:10.1063/1.1722830).

    Parameters
    ----------
    mask : (nx, ny, nz) array_like of bool, or Image
        Mask of the occupied voxels.
    voxel_size : float or (3,) array_like of float, optional
        Edge of a voxel, or its edges along x, y and z. Default: those that an Image tells, otherwise the unit.
    periodic : str, bool or sequence
        Periodic axes, such as ``"xy"``, as in :class:`voxgran.Box`.

    Returns
    -------
    tuple of (lengths (m,), probabilities (m,)), one for each axis
        Lengths up to half the image, in steps of the edge along the axis. Lines that leave the image do not count.

    Raises
    ------
    InputError
        If the image has not three axes, an edge of a voxel is not a length, or `periodic` names no axes.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> stripes = np.zeros((1, 1, 8), dtype=bool)
    >>> stripes[..., ::2] = True
    >>> vg.two_point_correlation(stripes, voxel_size=(1, 1, 0.5), periodic="z")[2][1].tolist()
    [0.5, 0.0, 0.5, 0.0, 0.5]
    """
    taken, edges, around = as_mask(mask), known_edges(voxel_size, mask) or (1.0, 1.0, 1.0), as_periodic(periodic)
    found: list[tuple[Floats, Floats]] = []
    for axis in range(3):
        lines = np.moveaxis(taken, axis, 0)
        n = len(lines)
        shares = []
        for lag in range(n // 2 + 1):
            both, lines_of_it = np.count_nonzero(lines[lag:] & lines[: n - lag]), n - lag
            if around[axis] and lag:
                both, lines_of_it = both + np.count_nonzero(lines[:lag] & lines[n - lag :]), n
            shares.append(both / max(lines_of_it * lines[:1].size, 1))
        found.append((np.arange(n // 2 + 1, dtype=np.float64) * edges[axis], np.array(shares)))
    return tuple(found)


@explained(hint="chord_lengths(labels == 0, voxel_size=(5, 5, 8))")
def chord_lengths(
    mask: "ArrayLike", *, voxel_size: "ArrayLike | None" = None, periodic: Periodic = False
) -> tuple[Floats, ...]:
    """Return the lengths of the chords of taken voxels along each axis, one array (m,) for each.

    Chords that the border of the image cuts are left out, as are lines without an end in a periodic image.

    Parameters
    ----------
    mask : (nx, ny, nz) array_like of bool, or Image
        Mask of the occupied voxels: of the pores, ``labels == 0``, or of the grains, ``labels > 0``.
    voxel_size : float or (3,) array_like of float, optional
        Edge of a voxel, or its edges along x, y and z. Default: those that an Image tells, otherwise the unit.
    periodic : str, bool or sequence
        Periodic axes, such as ``"xy"``, as in :class:`voxgran.Box`.

    Returns
    -------
    tuple of (m,) ndarray of float
        Lengths of the chords along x, y and z, in the unit of the edges.

    Raises
    ------
    InputError
        If the image has not three axes, an edge of a voxel is not a length, or `periodic` names no axes.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> line = np.array([1, 0, 1, 1, 1, 0, 0, 1], dtype=bool).reshape(1, 1, 8)
    >>> vg.chord_lengths(line, voxel_size=0.5)[2].tolist()
    [1.5]
    >>> vg.chord_lengths(line, voxel_size=0.5, periodic="z")[2].tolist()
    [1.5, 1.0]
    """
    taken, edges, around = as_mask(mask), known_edges(voxel_size, mask) or (1.0, 1.0, 1.0), as_periodic(periodic)
    return tuple(_chords(np.moveaxis(taken, axis, 2), around[axis]) * edges[axis] for axis in range(3))


def _chords(lines: Booleans, periodic: bool) -> Floats:
    """Return the numbers of voxels of the chords along the last axis."""
    n = lines.shape[2]
    if periodic:
        # each chord begins once in the first period, and a line with a free voxel ends it in the second one
        lines = np.concatenate([lines, lines, np.zeros_like(lines[..., :1])], axis=2)
    free_first = np.pad(~lines, ((0, 0), (0, 0), (1, 0)))
    begins = np.argwhere(lines & free_first[..., :-1])
    ends = np.argwhere(lines[..., :-1] & ~lines[..., 1:])
    if not len(begins) or not len(ends):
        return np.zeros(0)
    width = lines.shape[2]
    start = linear.matmul(begins, (lines.shape[1] * width, width, 1))
    stop = linear.matmul(ends, (lines.shape[1] * width, width, 1))
    after = np.searchsorted(stop, start)
    stops = stop[np.minimum(after, len(stop) - 1)]
    whole = (after < len(stop)) & (stops // width == start // width)
    if periodic:
        whole &= begins[:, 2] <= n
    return (stops - start + 1.0)[whole]
