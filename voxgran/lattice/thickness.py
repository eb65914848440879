"""Local thickness: the diameter of the largest sphere in the occupied voxels that covers a voxel; pore size for voids.

Only spheres that no neighbour's sphere contains are drawn; a table gives the radius that a neighbour needs (distance
ridge, Dougherty & Kunzelmann 2007, doi:10.1017/S1431927607074430). On the lattice the result is exact.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Integers
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.compiling.threads import in_blocks, using_threads
from voxgran._base.errors import InputError
from voxgran._base.kernels import kernel
from voxgran.lattice.distance import LEAST_VOXELS, NEVER, as_mask, distance_transform


@explained(hint="local_thickness(mask); widths are in voxels")
def local_thickness(
    mask: "ArrayLike", *, periodic: Periodic = False, threads: int | None = None
) -> NDArray[np.float32]:
    """Return for each voxel the diameter of the largest sphere of occupied voxels that covers it.

    Applied to the void between grains this is the pore size.

    Parameters
    ----------
    mask : (nx, ny, nz) array_like of bool
        Mask of the occupied voxels; the exterior of the image counts neither as occupied nor as free.
    periodic : str, bool or sequence
        Periodic axes, such as ``"xy"``, as in :class:`voxgran.Box`.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.

    Returns
    -------
    (nx, ny, nz) ndarray of float32
        Diameters in voxels; 0 for free voxels. The radius of a sphere is the distance of its center from that of the
        nearest free voxel, and it covers all closer centers; a slab of an even number of voxels therefore has its
        thickness, and one of an odd number a voxel more.

    Raises
    ------
    InputError
        If the image has not three axes, no voxel is free, or `periodic` names no axes.

    Notes
    -----
    Memory beside the mask: 8 bytes per voxel.

    References
    ----------
    Hildebrand & Rüegsegger 1997, A new method for the model-independent assessment of thickness in three-dimensional
    images, doi:10.1046/j.1365-2818.1997.1340694.x

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> mask = np.zeros((1, 1, 8), dtype=bool)
    >>> mask[0, 0, 2:6] = True
    >>> vg.local_thickness(mask)[0, 0].tolist()
    [0.0, 0.0, 4.0, 4.0, 4.0, 4.0, 0.0, 0.0]
    """
    around, taken = as_periodic(periodic), as_mask(mask)
    with using_threads(threads):
        squares = distance_transform(taken, periodic=around, squared=True)
        largest = int(squares.max(initial=0))
        if largest == NEVER:
            raise InputError("mask has no free voxel: no sphere ends anywhere; leave a free layer around the body")
        covered = np.zeros(taken.shape, dtype=np.int32)
        least = max(1, LEAST_VOXELS // max(taken.shape[1] * taken.shape[2], 1))
        arguments = squares, _needed(largest), np.array(around), covered
        in_blocks(_paint_spheres, taken.shape[0], *arguments, least=least)
    thickness = squares.view(np.float32)
    np.sqrt(covered, out=thickness, dtype=np.float32, casting="unsafe")
    thickness *= 2
    return thickness


def _needed(largest: int) -> Integers:
    """Return the squared radius that a neighbour's sphere needs to contain a sphere, (3, largest + 1).

    A sphere of squared radius s contains the lattice points with a squared distance below s. Row n is for a step along
    n + 1 axes.
    """
    reach = int(np.sqrt(largest)) + 1
    y, z = np.meshgrid(np.arange(reach + 1), np.arange(reach + 1), indexing="ij")
    most = np.zeros((3, largest + 1), dtype=np.int64)
    for x in range(reach + 1):
        distance = x * x + y * y + z * z
        held = distance < largest
        for row, aside in enumerate((0 * y, y, y + z)):
            # the farthest points lie on the other side of the sphere
            farther = distance + 2 * (x + aside) + row + 1
            np.maximum.at(most[row], distance[held] + 1, farther[held] + 1)
    return np.maximum.accumulate(most, axis=1)


@kernel
def _is_held(squares, needed, around, i, j, k):  # type: ignore[no-untyped-def]
    """Return whether the sphere of a neighbour contains the sphere of a voxel."""
    nx, ny, nz = squares.shape
    own = squares[i, j, k]
    for di in range(-1, 2):
        u = i + di
        if u < 0 or u >= nx:
            if not around[0]:
                continue
            u = (u + nx) % nx
        for dj in range(-1, 2):
            v = j + dj
            if v < 0 or v >= ny:
                if not around[1]:
                    continue
                v = (v + ny) % ny
            for dk in range(-1, 2):
                w = k + dk
                if w < 0 or w >= nz:
                    if not around[2]:
                        continue
                    w = (w + nz) % nz
                step = abs(di) + abs(dj) + abs(dk)
                if step and squares[u, v, w] > own and squares[u, v, w] >= needed[step - 1, own]:
                    return True
    return False


@kernel
def _paint_spheres(squares, needed, around, covered, first, stop):  # type: ignore[no-untyped-def]
    """Raise each voxel of some planes to the largest squared radius of the spheres that cover it."""
    nx, ny, nz = squares.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                own = squares[i, j, k]
                if own == 0:
                    continue
                reach = int(np.ceil(np.sqrt(own))) - 1
                if i + reach < first and not (around[0] and i - reach < 0):
                    continue
                if i - reach >= stop and not (around[0] and i + reach >= nx):
                    continue
                if _is_held(squares, needed, around, i, j, k):
                    continue
                for u in range(i - reach, i + reach + 1):
                    if (u < 0 or u >= nx) and not around[0]:
                        continue
                    if not first <= (u + nx) % nx < stop:
                        continue
                    for v in range(j - reach, j + reach + 1):
                        if (v < 0 or v >= ny) and not around[1]:
                            continue
                        rest = own - (u - i) ** 2 - (v - j) ** 2
                        if rest <= 0:
                            continue
                        half = int(np.ceil(np.sqrt(rest))) - 1
                        row = covered[(u + nx) % nx, (v + ny) % ny]
                        if around[2]:
                            for w in range(k - half, k + half + 1):
                                row[w % nz] = max(row[w % nz], own)
                        else:
                            for w in range(max(k - half, 0), min(k + half, nz - 1) + 1):
                                row[w] = max(row[w], own)
