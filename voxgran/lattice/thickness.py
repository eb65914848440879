"""Local thickness: the diameter of the largest sphere in the occupied voxels that covers a voxel; pore size for voids.

Only spheres that are not known to lie in another one are looked at (distance ridge, Dougherty & Kunzelmann 2007,
doi:10.1017/S1431927607074430). Boxes of voxels are halved again and again, each with the list of the spheres that reach
into it and are larger than one that contains it: of a wide pore a box is soon in one sphere. The result is exact.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.arrays import Booleans, Floats
from voxgran._base.axes import Periodic, as_periodic
from voxgran._base.calls import explained
from voxgran._base.compiling.threads import in_blocks, using_threads
from voxgran._base.errors import InputError, TooLargeError, shown
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.progress import Step, repeated
from voxgran.lattice.distance import LEAST_VOXELS, NEVER, as_mask, distance_transform, lazy_mask
from voxgran.lattice.image import are_equal, kept, known_edges, lazy_of, overlapped
from voxgran.lattice.resample import at_places, resample

#: edge in voxels of boxes that are divided no more
LEAF = 4
#: spheres that are compared with a box at once
BLOCK = 64
#: squared radius of spheres in voxels below which whole numbers in single precision tell what they cover
SINGLE = 2**22
#: edge in voxels of boxes for which spheres are collected, at least
WIDTH = 64
#: longest step, in voxels, to a sphere that may contain that of a voxel
FARTHEST = 16
#: radius in voxels of spheres for which only neighbours are asked
SMALL = 8
#: difference of squared distances over two voxels, in distances, from which on such a step is tried: it is 4 along the
#: way, and was 3.3 or more where a sphere was found
STEEP = 3.2
#: by how many voxels less the distance may have risen on the way to a sphere that may contain it
LACK = 1.0


@explained(hint="local_thickness(mask); widths are in voxels, or in lengths with voxel_size=")
def local_thickness(
    mask: "ArrayLike", *, voxel_size: "ArrayLike | None" = None, periodic: Periodic = False, threads: int | None = None
) -> NDArray[np.float32]:
    """Return for each voxel the diameter of the largest sphere of occupied voxels that covers it.

    Applied to the void between grains this is the pore size.

    Parameters
    ----------
    mask : (nx, ny, nz) array_like of bool, or Image
        Mask of the occupied voxels; the exterior of the image counts neither as occupied nor as free. A dask array is
        computed block by block, with the same result, on the threads of dask.
    voxel_size : float or (3,) array_like of float, optional
        Edge of a voxel, or its edges along x, y and z. Default: those that an Image tells, otherwise the unit. With
        unequal edges the mask is resampled to cubes of the smallest edge (nearest values), and each voxel gets the
        diameter at its center; the surface is then known to half a voxel along each axis, as in the mask.
    periodic : str, bool or sequence
        Periodic axes, such as ``"xy"``, as in :class:`voxgran.Box`.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.

    Returns
    -------
    (nx, ny, nz) ndarray of float32
        For a dask array a dask array. Diameters in voxels, or in the unit of the voxel size; 0 for free voxels. The
        radius of a sphere is the distance of its center from that of the nearest free voxel, and it covers all closer
        centers; a slab of an even number of voxels therefore has its thickness, and one of an odd number a voxel more.

    Raises
    ------
    InputError
        If the image has not three axes, no voxel is free, an edge of a voxel is not a length, or `periodic` names no
        axes.
    TooLargeError
        If the image of cubes would have 2**32 voxels or more, or a diagonal of 2**15.
    MissingLibraryError
        If the image is a dask array and zarr is not installed.

    Notes
    -----
    Memory beside the mask: 9 bytes per voxel, and for each thread about 100 bytes for each sphere that is looked at
    within the width of the largest one. With 2.3 million voxels and a pore 120 voxels wide it takes half a second
    of the processor (``tools/thickness_speed.py``).

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
    edges, around, lazy = known_edges(voxel_size, mask), as_periodic(periodic), lazy_of(mask)
    taken = as_mask(mask) if lazy is None else lazy_mask(lazy)
    if edges is not None and not are_equal(edges):
        if (
            lazy is None
            and sum((n * edge / min(edges)) ** 2 for n, edge in zip(taken.shape, edges, strict=True)) >= NEVER
        ):
            raise TooLargeError(
                f"voxel_size is {shown(edges)}: the diagonal of the mask must be shorter than 2**15 of the smallest "
                "edge; cut the mask"
            )
        cubes = resample(taken, to="cubic", voxel_size=edges, method="nearest")
        found = local_thickness(cubes, voxel_size=min(edges), periodic=around, threads=threads)
        places = [
            np.minimum(((np.arange(n) + 0.5) * edge / min(edges)).astype(np.int64), many - 1)
            for n, edge, many in zip(taken.shape, edges, cubes.shape, strict=True)
        ]
        return at_places(found, places)
    factor = 2 if edges is None else 2 * min(edges)
    if lazy is not None:
        return _of_blocks(taken, around) * np.float32(factor)
    with using_threads(threads), repeated(None) as told:
        told(Step(stage="local thickness", done=0, total=0))
        squares = distance_transform(taken, periodic=around, squared=True)
        largest = int(squares.max(initial=0))
        _refuse_endless(largest)
        thickness = _covered(squares, around, largest)
    thickness *= factor
    return thickness


def _refuse_endless(largest: int) -> None:
    """Refuse a mask that has no free voxel."""
    if largest == NEVER:
        raise InputError("mask has no free voxel: no sphere ends anywhere; leave a free layer around the body")


def _covered(squares: NDArray[np.int32], around: tuple[bool, bool, bool], largest: int) -> NDArray[np.float32]:
    """Return the radii of the largest spheres that cover the voxels, in place of the squared radii about them."""
    needed, covered = ridge(squares, around), np.zeros(squares.shape, dtype=np.int32)
    least = max(1, LEAST_VOXELS // max(squares.shape[1] * squares.shape[2], 1))
    numbers = np.zeros(0, dtype=np.float32 if largest < SINGLE else np.float64)
    in_blocks(_cover_planes, len(squares), squares, needed, np.array(around), largest, numbers, covered, least=least)
    thickness = squares.view(np.float32)
    return np.sqrt(covered, out=thickness, dtype=np.float32, casting="unsafe")


def _of_blocks(mask: Any, around: tuple[bool, bool, bool]) -> Any:
    """Return the same radii for a dask array: no sphere reaches farther than the largest radius."""
    squares = kept(distance_transform(mask, periodic=around, squared=True))
    largest = int(squares.max())
    _refuse_endless(largest)

    def covered(block: NDArray[np.int32]) -> NDArray[np.float32]:
        return _covered(block.copy(), (False, False, False), largest)

    return overlapped(squares, covered, math.sqrt(largest), (1.0, 1.0, 1.0), around, np.float32)


def ridge(squares: NDArray[np.int32], around: tuple[bool, bool, bool]) -> Booleans:
    """Return the mask of the voxels whose spheres, of these squared radii, are not known to lie in other spheres."""
    needed = np.empty(squares.shape, dtype=np.bool_)
    least = max(1, LEAST_VOXELS // max(squares.shape[1] * squares.shape[2], 1))
    in_blocks(_mark_needed, squares.shape[0], squares, np.array(around), needed, least=least)
    return needed


def cover(mask: Booleans, spheres: Floats, around: tuple[bool, bool, bool]) -> Floats:
    """Return for each occupied voxel the squared radius of the largest sphere that covers its center, 0 for none.

    Spheres (n, 4) are given by their center, in voxels from that of the first voxel, and squared radius.
    """
    for axis in np.flatnonzero(around):
        n, parts, place, reach = mask.shape[axis], [spheres], spheres[:, axis], np.sqrt(spheres[:, 3])
        for turn in range(1, int(reach.max(initial=0.0) // n) + 2):
            for shift, inside in ((turn * n, place + turn * n - reach < n), (-turn * n, place - turn * n + reach > -1)):
                parts.append(spheres[inside] + np.array([shift if k == axis else 0.0 for k in range(4)]))
        spheres = np.concatenate(parts)
    spheres = np.ascontiguousarray(spheres[np.argsort(-spheres[:, 3], kind="stable")])
    covered = np.zeros(mask.shape)
    for low in np.ndindex(*(-(-n // WIDTH) for n in mask.shape)):
        lower = np.array(low) * WIDTH
        upper = np.minimum(lower + WIDTH, mask.shape) - 1
        aside = np.maximum(np.maximum(lower - spheres[:, :3], spheres[:, :3] - upper), 0.0)
        near = spheres[(aside**2).sum(axis=1) < spheres[:, 3]]
        _cover_box(mask, near, tuple(int(value) for value in (*lower, *upper)), covered)
    return covered


@kernel
def _mark_needed(squares, around, needed, first, stop):  # type: ignore[no-untyped-def]
    """Mark the voxels of some planes whose spheres are not known to lie in other spheres."""
    ny, nz = squares.shape[1:]
    # largest values of rows along z: of the row itself, of the four beside it and of the four across; with ends
    rows = np.empty((3, nz + 2), np.int32)
    own, beside, across = rows[0], rows[1], rows[2]
    for i in range(first, stop):
        for j in range(ny):
            _gather_rows(squares, around, i, j, rows)
            for k in range(nz):
                square = own[k + 1]
                needed[i, j, k] = square > 0 and not (
                    _holds(max(own[k], own[k + 2], beside[k + 1]), square, 1)
                    or _holds(max(beside[k], beside[k + 2], across[k + 1]), square, 2)
                    or _holds(max(across[k], across[k + 2]), square, 3)
                    or (square >= SMALL**2 and _is_held(squares, around, i, j, k))
                )


@bare_kernel
def _gather_rows(squares, around, i, j, rows):  # type: ignore[no-untyped-def]
    """Write the row at (i, j) and the largest values of those around it, with what follows beyond both ends."""
    nx, ny, nz = squares.shape
    for n in range(3):
        for k in range(nz + 2):
            rows[n, k] = 0
    for di in range(-1, 2):
        for dj in range(-1, 2):
            x, y = (i + di) % nx, (j + dj) % ny
            if (x != i + di and not around[0]) or (y != j + dj and not around[1]):
                continue
            row, most = squares[x, y], rows[abs(di) + abs(dj)]
            for k in range(nz):
                most[k + 1] = max(most[k + 1], row[k])
    for n in range(3 if around[2] else 0):
        rows[n, 0], rows[n, nz + 1] = rows[n, nz], rows[n, 1]


@kernel
def _is_held(squares, around, i, j, k):  # type: ignore[no-untyped-def]
    """Return whether the sphere of a voxel lies in that of a voxel farther from the solid."""
    own = squares[i, j, k]
    # near the voxel the gradient leads away from the nearest free voxel
    x = _at(squares, around, i + 1, j, k) - _at(squares, around, i - 1, j, k)
    y = _at(squares, around, i, j + 1, k) - _at(squares, around, i, j - 1, k)
    z = _at(squares, around, i, j, k + 1) - _at(squares, around, i, j, k - 1)
    length, radius = np.sqrt(float(x) ** 2 + float(y) ** 2 + float(z) ** 2), np.sqrt(float(own))
    # on the way to the center of a sphere that contains it the distance rises by the way itself
    if length < STEEP * radius:
        return False
    p, q, r = x / length, y / length, z / length
    for step in range(2, FARTHEST + 1):
        u, v, w = int(np.rint(step * p)), int(np.rint(step * q)), int(np.rint(step * r))
        other = _at(squares, around, i + u, j + v, k + w)
        if _holds(other, own, u * u + v * v + w * w):
            return True
        if other < (radius + step - LACK) ** 2:
            return False
    return False


@bare_kernel
def _holds(other, own, step):  # type: ignore[no-untyped-def]
    """Return whether a sphere contains another one, for their squared radii and the square of the way between centers.

    A sphere of squared radius s contains the lattice points p with p^2 <= s - 1. From a center at e their squared
    distance is p^2 + 2 pe + e^2, where pe is a whole number, at most the root of p^2 e^2.
    """
    twice = np.int64(other) - own - step
    half = (twice >> 1) + 1
    return twice >= 0 and half * half > (np.int64(own) - 1) * step


@kernel
def _at(squares, around, i, j, k):  # type: ignore[no-untyped-def]
    """Return the squared distance at a voxel, 0 outside of the image."""
    nx, ny, nz = squares.shape
    if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
        i, j, k = i % nx if around[0] else i, j % ny if around[1] else j, k % nz if around[2] else k
        if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
            return np.int32(0)
    return squares[i, j, k]


@kernel
def _cover_planes(squares, needed, around, largest, numbers, covered, first, stop):  # type: ignore[no-untyped-def]
    """Write for the voxels of some planes the squared radius of the largest sphere that covers them.

    Spheres are numbers of the type of an array. The planes are divided into boxes about as wide as the largest sphere.
    """
    ny, nz = squares.shape[1:]
    edge = max(WIDTH, int(np.sqrt(largest)))
    spheres = np.empty((1024, 4), np.int32)
    for a in range(first, stop, edge):
        for b in range(0, ny, edge):
            for c in range(0, nz, edge):
                box = (a, b, c, min(a + edge, stop) - 1, min(b + edge, ny) - 1, min(c + edge, nz) - 1)
                count = _collect(squares, needed, around, largest, box, spheres)
                if count > len(spheres):
                    spheres = np.empty((count, 4), np.int32)
                    _collect(squares, needed, around, largest, box, spheres)
                _cover_box(squares, _sorted(spheres[:count], largest, numbers), box, covered)


@kernel
def _collect(squares, needed, around, largest, box, spheres):  # type: ignore[no-untyped-def]
    """Write centers and squared radii of the marked spheres that reach into a box, with their images across periodic
    faces, as long as there is room; return their number.
    """
    nx, ny, nz = squares.shape
    reach, count, room = int(np.sqrt(largest)) + 1, 0, len(spheres)
    for x in range(box[0] - reach, box[3] + reach + 1):
        if not (around[0] or 0 <= x < nx):
            continue
        for y in range(box[1] - reach, box[4] + reach + 1):
            if not (around[1] or 0 <= y < ny):
                continue
            aside = max(box[0] - x, x - box[3], 0) ** 2 + max(box[1] - y, y - box[4], 0) ** 2
            if aside >= largest:
                continue
            row, marks, far = squares[x % nx, y % ny], needed[x % nx, y % ny], int(np.sqrt(largest - aside))
            low, high = box[2] - far, box[5] + far + 1
            for z in range(low if around[2] else max(low, 0), high if around[2] else min(high, nz)):
                w = z if 0 <= z < nz else z % nz
                if marks[w] and aside + max(box[2] - z, z - box[5], 0) ** 2 < row[w]:
                    if count < room:
                        spheres[count, 0], spheres[count, 1], spheres[count, 2], spheres[count, 3] = x, y, z, row[w]
                    count += 1
    return count


@kernel
def _sorted(spheres, largest, numbers):  # type: ignore[no-untyped-def]
    """Return spheres by their squared radii, the largest first, as numbers of the type of an array; by counting."""
    place, ordered = np.zeros(largest + 2, np.int64), np.empty(spheres.shape, numbers.dtype)
    for s in range(len(spheres)):
        place[largest - spheres[s, 3] + 1] += 1
    for square in range(largest):
        place[square + 1] += place[square]
    for s in range(len(spheres)):
        k = largest - spheres[s, 3]
        ordered[place[k]] = spheres[s]
        place[k] += 1
    return ordered


@kernel
def _cover_box(squares, spheres, box, covered):  # type: ignore[no-untyped-def]
    """Write for the voxels of a box the squared radius of the first sphere that covers them; spheres become smaller.

    Boxes are halved along each axis. The list of a box holds the spheres that reach into it, up to the first one that
    contains it.
    """
    many, count = len(spheres), 1
    # by columns, which become vector instructions
    lists = np.empty((4, 2 * many + 1), spheres.dtype)
    for k in range(many):
        for column in range(4):
            lists[column, k] = spheres[k, column]
    # the ends of a box, and where the list of the box around it begins and ends
    boxes = np.empty((7 * 32, 8), np.int64)
    for side in range(6):
        boxes[0, side] = box[side]
    boxes[0, 6], boxes[0, 7] = 0, many
    sites, best = np.empty((3, LEAF**3), lists.dtype), np.empty(LEAF**3, lists.dtype)
    room, margins = np.zeros(7, lists.dtype), np.empty((2, BLOCK), lists.dtype)
    while count:
        count -= 1
        a, b, c, d, e, f, begin, end = boxes[count]
        if lists.shape[1] <= 2 * end - begin:
            longer = np.empty((4, 2 * lists.shape[1]), lists.dtype)
            for column in range(4):
                for k in range(end):
                    longer[column, k] = lists[column, k]
            lists = longer
        room[0], room[1], room[2] = (a + d) / 2, (b + e) / 2, (c + f) / 2
        room[3], room[4], room[5] = (d - a) / 2, (e - b) / 2, (f - c) / 2
        last = _reaching(lists, room, begin, end, margins)
        if max(d - a, e - b, f - c) < LEAF:
            _cover_leaf(squares, lists, boxes[count], last, sites, best, covered)
            continue
        if last <= end + 1:
            # where no sphere is left, none reaches: its square is 0
            lists[3, last] = 0.0
            x, y, z, square = lists[0, end], lists[1, end], lists[2, end], lists[3, end]
            for i in range(a, d + 1):
                for j in range(b, e + 1):
                    for k in range(c, f + 1):
                        if squares[i, j, k] and (i - x) ** 2 + (j - y) ** 2 + (k - z) ** 2 < square:
                            covered[i, j, k] = square
            continue
        x, y, z = (a + d) // 2, (b + e) // 2, (c + f) // 2
        for low, high in ((a, x), (x + 1, d)):
            for left, right in ((b, y), (y + 1, e)):
                for under, over in ((c, z), (z + 1, f)):
                    if low <= high and left <= right and under <= over:
                        boxes[count] = low, left, under, high, right, over, end, last
                        count += 1


@bare_kernel
def _reaching(lists, room, begin, end, margins):  # type: ignore[no-untyped-def]
    """Append the spheres of a list that reach into a box, up to the first one that contains it; return the new end.

    The box is given by its middle and half its edges, before a zero. What does not reach is written too and then
    overwritten: a step that cannot be foreseen takes longer.
    """
    a, b, c, d, e, f, none = room[0], room[1], room[2], room[3], room[4], room[5], room[6]
    near, within, last = margins[0], margins[1], end
    for first in range(begin, end, BLOCK):
        stop = min(first + BLOCK, end)
        xs, ys, zs, squares = lists[0, first:stop], lists[1, first:stop], lists[2, first:stop], lists[3, first:stop]
        for s in range(len(xs)):
            x, y, z = abs(xs[s] - a), abs(ys[s] - b), abs(zs[s] - c)
            u, v, w = max(x - d, none), max(y - e, none), max(z - f, none)
            near[s] = squares[s] - (u * u + v * v + w * w)
            u, v, w = x + d, y + e, z + f
            within[s] = squares[s] - (u * u + v * v + w * w)
        for s in range(len(xs)):
            lists[0, last], lists[1, last], lists[2, last], lists[3, last] = xs[s], ys[s], zs[s], squares[s]
            last += near[s] > none
            if within[s] > none:
                return last
    return last


@bare_kernel
def _cover_leaf(squares, lists, box, last, sites, best, covered):  # type: ignore[no-untyped-def]
    """Write the same for the few voxels of a small box, sphere by sphere, which become vector instructions."""
    many = 0
    for i in range(box[0], box[3] + 1):
        for j in range(box[1], box[4] + 1):
            for k in range(box[2], box[5] + 1):
                if squares[i, j, k]:
                    sites[0, many], sites[1, many], sites[2, many], best[many] = i, j, k, 0.0
                    many += 1
    best[0] = 0.0
    x, y, z, none = sites[0], sites[1], sites[2], best[0]
    for s in range(box[7], last):
        if s % 8 == 0:
            left = 0
            for v in range(many):
                left += best[v] == 0.0
            if left == 0:
                break
        p, q, r, square = lists[0, s], lists[1, s], lists[2, s], lists[3, s]
        for v in range(many):
            aside = (x[v] - p) * (x[v] - p) + (y[v] - q) * (y[v] - q) + (z[v] - r) * (z[v] - r)
            best[v] = max(best[v], square if aside < square else none)
    for v in range(many):
        covered[int(x[v]), int(y[v]), int(z[v])] = best[v]
