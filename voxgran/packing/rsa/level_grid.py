"""Linked cells for grains of any gradation: which grains does a new one overlap?

Grains are sorted into levels by size, each level half as large as the one before, and each level has cells of its own
that are about as wide as its largest grain. A question then visits few cells of each level, whatever the ratio of the
sizes. Grains are spheres (in the plane disks), or boxes along the axes.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import WHOLE, Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import KernelContainer

#: cells of a level at the most, per grain of it
CELLS_PER_GRAIN = 2
#: levels at the most; all smaller grains are in the last one
LEVELS = 40


class Bed(NamedTuple):
    """The grains: where they are, half their extents, their levels, who is in.

    half: of boxes a column for each axis (in the plane 1 along z), of spheres one, the radius. In the plane z is 0.
    `boxes`: grains are boxes, not spheres.
    """

    position: Floats
    half: Floats
    level: NDArray[np.int8]
    entered: NDArray[np.int8]
    boxes: bool


class Cells(NamedTuple):
    """Cells of all levels one after the other: the first grain of each, and the next grain after each (-1: none).

    count, width: cells along the axes, and their lengths, of each level.  first: the first cell of each level.
    reach: largest half extents of each level.  filled: how many grains are in.
    """

    count: Integers  # type: ignore[assignment]
    width: Floats
    first: Integers
    reach: Floats
    filled: Integers
    head: NDArray[np.int32]
    after: NDArray[np.int32]


def sort_into_levels(half: Floats) -> NDArray[np.int8]:
    """Return the level of each grain by half its largest extent; 0 is that of the largest grain.

    Parameters
    ----------
    half : (n, 1, 2 or 3) ndarray of float
        Half the extents along the axes of the plane or of space, of spheres the radii.
    """
    size = half.max(axis=1, initial=0.0)
    largest = size.max(initial=0.0)
    exact = np.log2(largest / size) if len(size) else np.zeros(0)
    return np.clip(np.floor(exact + WHOLE), 0, LEVELS - 1).astype(np.int8)


def lay_out(half: Floats, level: NDArray[np.int8], room: KernelContainer, dimension: int) -> Cells:
    """Return empty cells.

    Parameters
    ----------
    half : (n, 1 or 3) ndarray of float
        Half the extents of the grains.
    level : (n,) ndarray of int
        Their levels.
    room : KernelContainer
        The container.
    dimension : int
        2 or 3.
    """
    levels = int(level.max(initial=0)) + 1
    many = np.bincount(level, minlength=levels)
    reach = np.zeros((levels, 3))
    np.maximum.at(reach, level, half)
    count = np.ones((levels, 3), dtype=np.int64)
    for k in range(levels):
        if many[k]:
            span = room.lengths[:dimension]
            wanted = np.maximum(span / (2 * reach[k, :dimension]), 1.0)
            most = max(CELLS_PER_GRAIN * many[k], 1)
            wanted *= min(1.0, (most / np.prod(wanted)) ** (1 / dimension))
            count[k, :dimension] = np.maximum(np.floor(wanted + WHOLE), 1)
    first = np.concatenate([[0], np.cumsum(np.prod(count, axis=1))]).astype(np.int64)
    return Cells(
        *(count, room.lengths / count, first[:-1], reach, np.zeros(levels, dtype=np.int64)),
        # what comes after a grain is written when it enters: zeros take no memory before
        *(np.full(int(first[-1]), -1, dtype=np.int32), np.zeros(len(half), dtype=np.int32)),
    )


@bare_kernel
def enter(bed: Bed, cells: Cells, room: KernelContainer, g: int, x: float, y: float, z: float) -> None:
    """Put a grain at a place, which is wrapped into the container along periodic axes."""
    bed.position[g, 0] = _wrapped(room, 0, x)
    bed.position[g, 1] = _wrapped(room, 1, y)
    bed.position[g, 2] = _wrapped(room, 2, z)
    bed.entered[g] = 1
    link(bed, cells, room, g)


@bare_kernel
def link(bed: Bed, cells: Cells, room: KernelContainer, g: int) -> None:
    """Put a grain, at its place already, into its cell."""
    level = bed.level[g]
    flat = 0
    for axis in range(3):
        index = math.floor((bed.position[g, axis] - room.lower[axis]) / cells.width[level, axis])
        flat = flat * cells.count[level, axis] + min(max(index, 0), cells.count[level, axis] - 1)
    flat += cells.first[level]
    cells.after[g] = cells.head[flat]
    cells.head[flat] = g
    cells.filled[level] += 1


@bare_kernel
def link_all(bed: Bed, cells: Cells, room: KernelContainer, order: NDArray[np.int32]) -> None:
    """Put all grains that have entered into empty cells, in the order in which they entered."""
    for k in range(len(order)):
        if bed.entered[order[k]] == 1:
            link(bed, cells, room, order[k])


@bare_kernel
def cells_near(
    lower: Floats, periodic: Integers, count: Integers, width: Floats, level: int, axis: int, x: float, reach: float
) -> tuple[int, int]:
    """Return the first and the last cell of a level, along an axis, that hold what is within `reach` of x.

    Along a periodic axis they go on beyond the ends, to the images.
    """
    begin = math.floor((x - reach - lower[axis]) / width[level, axis])
    end = math.floor((x + reach - lower[axis]) / width[level, axis])
    if periodic[axis] == 0:
        last = count[level, axis] - 1
        return min(max(begin, 0), last), min(max(end, 0), last)
    return begin, end


@bare_kernel
def find_overlap(
    bed: Bed,
    cells: Cells,
    room: KernelContainer,
    x: float,
    y: float,
    z: float,
    hx: float,
    hy: float,
    hz: float,
    slack: float,
    deepest: bool,
) -> tuple[int, float, float, float, float]:
    """Return a grain that a new one overlaps by more than `slack`, -1 for none.

    Parameters
    ----------
    bed, cells, room
        Grains and container.
    x, y, z : float
        Centre of the new grain, inside the container.
    hx, hy, hz : float
        Half its extents.
    slack : float
        Overlap that does not count.
    deepest : bool
        Whether the grain with the deepest overlap is wanted, or any.

    Returns
    -------
    grain : int
        The grain.
    overlap : float
        How deep.
    dx, dy, dz : float
        From its centre, in the image that is met, to that of the new one.
    """
    position, half, boxes, lower, periodic = bed.position, bed.half, bed.boxes, room.lower, room.periodic
    count, width, head, after = cells.count, cells.width, cells.head, cells.after
    best, most, bx, by, bz = -1, slack, 0.0, 0.0, 0.0
    for level in range(len(cells.first)):
        if cells.filled[level] == 0:
            continue
        x0, x1 = cells_near(lower, periodic, count, width, level, 0, x, hx + cells.reach[level, 0])
        y0, y1 = cells_near(lower, periodic, count, width, level, 1, y, hy + cells.reach[level, 1])
        z0, z1 = cells_near(lower, periodic, count, width, level, 2, z, hz + cells.reach[level, 2])
        nx, ny, nz = count[level, 0], count[level, 1], count[level, 2]
        for ix in range(x0, x1 + 1):
            kx = ix // nx
            for iy in range(y0, y1 + 1):
                ky = iy // ny
                row = cells.first[level] + ((ix - kx * nx) * ny + iy - ky * ny) * nz
                for iz in range(z0, z1 + 1):
                    kz = iz // nz
                    g = head[row + iz - kz * nz]
                    while g >= 0:
                        dx = x - position[g, 0] - kx * room.lengths[0]
                        dy = y - position[g, 1] - ky * room.lengths[1]
                        dz = z - position[g, 2] - kz * room.lengths[2]
                        if boxes:
                            overlap = _box_overlap(half, g, dx, dy, dz, hx, hy, hz)
                        else:
                            overlap = _sphere_overlap(half, g, dx, dy, dz, hx, most)
                        if overlap > most:
                            best, most, bx, by, bz = g, overlap, dx, dy, dz
                            if not deepest:
                                return best, most, bx, by, bz
                        g = after[g]
    return best, most, bx, by, bz


@bare_kernel
def gather(
    bed: Bed,
    cells: Cells,
    room: KernelContainer,
    x: float,
    y: float,
    z: float,
    hx: float,
    hy: float,
    hz: float,
    ex: float,
    ey: float,
    ez: float,
    near: Floats,
) -> int:
    """List the grains that block a place in a box for the centre of a new grain.

    Parameters
    ----------
    bed, cells, room
        Grains and container.
    x, y, z, ex, ey, ez : float
        Middle of the box and half its edges.
    hx, hy, hz : float
        Half the extents of the new grain.
    near : (m, 6) ndarray of float
        Where they are written: from the middle of the box to the centre of the grain, and how far that blocks along the
        axes (of spheres: in all directions).

    Returns
    -------
    int
        How many they are, m at the most; -1 where one of them blocks the whole box.
    """
    position, half, lower, periodic = bed.position, bed.half, room.lower, room.periodic
    count, width, head, after = cells.count, cells.width, cells.head, cells.after
    many = 0
    for level in range(len(cells.first)):
        if cells.filled[level] == 0:
            continue
        x0, x1 = cells_near(lower, periodic, count, width, level, 0, x, ex + hx + cells.reach[level, 0])
        y0, y1 = cells_near(lower, periodic, count, width, level, 1, y, ey + hy + cells.reach[level, 1])
        z0, z1 = cells_near(lower, periodic, count, width, level, 2, z, ez + hz + cells.reach[level, 2])
        nx, ny, nz = count[level, 0], count[level, 1], count[level, 2]
        for ix in range(x0, x1 + 1):
            kx = ix // nx
            for iy in range(y0, y1 + 1):
                ky = iy // ny
                row = cells.first[level] + ((ix - kx * nx) * ny + iy - ky * ny) * nz
                for iz in range(z0, z1 + 1):
                    kz = iz // nz
                    g = head[row + iz - kz * nz]
                    while g >= 0 and many < len(near):
                        near[many, 0] = position[g, 0] + kx * room.lengths[0] - x
                        near[many, 1] = position[g, 1] + ky * room.lengths[1] - y
                        near[many, 2] = position[g, 2] + kz * room.lengths[2] - z
                        gx, gy, gz = extents(half, g)
                        near[many, 3], near[many, 4], near[many, 5] = hx + gx, hy + gy, hz + gz
                        if is_within(bed.boxes, near, many, 0.0, 0.0, 0.0, ex, ey, ez):
                            return -1
                        # with extents below zero: does it block the nearest point?
                        many += is_within(bed.boxes, near, many, 0.0, 0.0, 0.0, -ex, -ey, -ez)
                        g = after[g]
    return many


@bare_kernel
def is_within(boxes: bool, near: Floats, k: int, x: float, y: float, z: float, ex: float, ey: float, ez: float) -> bool:
    """Return whether the farthest corner of a box, and so all of it, lies in what grain k of those near blocks."""
    dx, dy, dz = (
        max(abs(x - near[k, 0]) + ex, 0.0),
        max(abs(y - near[k, 1]) + ey, 0.0),
        max(abs(z - near[k, 2]) + ez, 0.0),
    )
    if boxes:
        return dx < near[k, 3] and dy < near[k, 4] and dz < near[k, 5]
    return dx * dx + dy * dy + dz * dz < near[k, 3] * near[k, 3]


@bare_kernel
def extents(half: Floats, g: int) -> tuple[float, float, float]:
    """Return half the extents of grain g along the axes; those of a sphere are all in one column."""
    last = half.shape[1] - 1
    return half[g, 0], half[g, last >> 1], half[g, last]


@bare_kernel
def _sphere_overlap(half, g, dx, dy, dz, radius, least):  # type: ignore[no-untyped-def]
    """Return by how much a sphere overlaps sphere g where that is more than `least`, else `least`."""
    reach = radius + half[g, 0]
    square = dx * dx + dy * dy + dz * dz
    near = reach - least
    if near <= 0.0 or square >= near * near:
        return least
    # where the root rounds to the reach they overlap all the same
    return max(reach - math.sqrt(square), least + 1e-300)


@bare_kernel
def _box_overlap(half, g, dx, dy, dz, hx, hy, hz):  # type: ignore[no-untyped-def]
    """Return by how much a box overlaps box g, along the axis where that is least; not above 0 where it does not."""
    return min(hx + half[g, 0] - abs(dx), hy + half[g, 1] - abs(dy), hz + half[g, 2] - abs(dz))


@bare_kernel
def _wrapped(room, axis, x):  # type: ignore[no-untyped-def]
    """Return a coordinate inside the container along a periodic axis, and as it is along others."""
    if room.periodic[axis] == 0:
        return x
    shift = math.floor((x - room.lower[axis]) / room.lengths[axis])
    return x - shift * room.lengths[axis]
