"""Hierarchical grid of linked cells: search of the grains that a new one overlaps, for any size ratio.

Grains are sorted into levels by size, each level half as large as the one before, and each level has cells of its own
that are about as wide as its largest grain. A query visits few cells of each level, whatever the ratio of the sizes.
Grains are spheres (in two dimensions disks) or boxes along the axes.

The advancing front has a grid of its own (:mod:`voxgran.packing.advancing_front.level_grid`): the order in which both
traverse their cells decides which of several equal answers is found, and with it the bits of a packing.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import WHOLE, Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import KernelContainer

#: largest number of cells of a level, per grain
CELLS_PER_GRAIN = 2
#: largest number of levels; all smaller grains are in the last one
LEVELS = 40


class Grains(NamedTuple):
    """Positions, half extents and levels of grains, and whether each is placed.

    half: (n, 3) of boxes (in two dimensions 1 along z), (n, 1) of spheres, the radius. In two dimensions z is 0.
    boxes: whether grains are boxes, not spheres.
    """

    position: Floats
    half: Floats
    level: NDArray[np.int8]
    entered: NDArray[np.int8]
    boxes: bool


class Cells(NamedTuple):
    """Cells of all levels one after the other: the first grain of each, and the next grain after each (-1: none).

    count, width: number and edges of the cells along the axes, of each level.  first: first cell of each level.
    reach: largest half extents of each level.  filled: number of linked grains of each level.
    """

    count: Integers  # type: ignore[assignment]
    width: Floats
    first: Integers
    reach: Floats
    filled: Integers
    head: NDArray[np.int32]
    after: NDArray[np.int32]


def sort_into_levels(half: Floats) -> NDArray[np.int8]:
    """Return the level of each grain by its largest half extent; 0 is that of the largest grain.

    Parameters
    ----------
    half : (n, 1, 2 or 3) ndarray of float
        Half the extents along the axes, of spheres the radii.
    """
    size = half.max(axis=1, initial=0.0)
    largest = size.max(initial=0.0)
    exact = np.log2(largest / size) if len(size) else np.zeros(0)
    return np.clip(np.floor(exact + WHOLE), 0, LEVELS - 1).astype(np.int8)


def lay_out(half: Floats, level: NDArray[np.int8], walls: KernelContainer, dimension: int) -> Cells:
    """Return empty cells.

    Parameters
    ----------
    half : (n, 1 or 3) ndarray of float
        Half the extents of the grains.
    level : (n,) ndarray of int
        Their levels.
    walls : KernelContainer
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
            span = walls.lengths[:dimension]
            wanted = np.maximum(span / (2 * reach[k, :dimension]), 1.0)
            most = max(CELLS_PER_GRAIN * many[k], 1)
            wanted *= min(1.0, (most / np.prod(wanted)) ** (1 / dimension))
            count[k, :dimension] = np.maximum(np.floor(wanted + WHOLE), 1)
    first = np.concatenate([[0], np.cumsum(np.prod(count, axis=1))]).astype(np.int64)
    return Cells(
        *(count, walls.lengths / count, first[:-1], reach, np.zeros(levels, dtype=np.int64)),
        # untouched zeros take no memory until grains are linked
        *(np.full(int(first[-1]), -1, dtype=np.int32), np.zeros(len(half), dtype=np.int32)),
    )


@bare_kernel
def enter(grains: Grains, cells: Cells, walls: KernelContainer, g: int, x: float, y: float, z: float) -> None:
    """Place a grain at a position, wrapped into the container along periodic axes."""
    grains.position[g, 0] = _wrapped(walls, 0, x)
    grains.position[g, 1] = _wrapped(walls, 1, y)
    grains.position[g, 2] = _wrapped(walls, 2, z)
    grains.entered[g] = 1
    link(grains, cells, walls, g)


@bare_kernel
def link(grains: Grains, cells: Cells, walls: KernelContainer, g: int) -> None:
    """Link a grain that has its position into its cell."""
    level = grains.level[g]
    flat = 0
    for axis in range(3):
        index = math.floor((grains.position[g, axis] - walls.lower[axis]) / cells.width[level, axis])
        flat = flat * cells.count[level, axis] + min(max(index, 0), cells.count[level, axis] - 1)
    flat += cells.first[level]
    cells.after[g] = cells.head[flat]
    cells.head[flat] = g
    cells.filled[level] += 1


@bare_kernel
def link_all(grains: Grains, cells: Cells, walls: KernelContainer, order: NDArray[np.int32]) -> None:
    """Link all placed grains into empty cells, in the given order."""
    for k in range(len(order)):
        if grains.entered[order[k]] == 1:
            link(grains, cells, walls, order[k])


@bare_kernel
def cells_near(
    lower: Floats, periodic: Integers, count: Integers, width: Floats, level: int, axis: int, x: float, reach: float
) -> tuple[int, int]:
    """Return the first and the last cell of a level along an axis within `reach` of x.

    Along a periodic axis they may lie beyond the ends, in the images.
    """
    begin = math.floor((x - reach - lower[axis]) / width[level, axis])
    end = math.floor((x + reach - lower[axis]) / width[level, axis])
    if periodic[axis] == 0:
        last = count[level, axis] - 1
        return min(max(begin, 0), last), min(max(end, 0), last)
    return begin, end


@bare_kernel
def find_overlap(
    grains: Grains,
    cells: Cells,
    walls: KernelContainer,
    x: float,
    y: float,
    z: float,
    hx: float,
    hy: float,
    hz: float,
    slack: float,
    deepest: bool,
) -> tuple[int, float, float, float, float]:
    """Return a grain that a new one overlaps by more than `slack`, or -1.

    Parameters
    ----------
    grains, cells, walls
        Grains and container.
    x, y, z : float
        Center of the new grain, inside the container.
    hx, hy, hz : float
        Half its extents.
    slack : float
        Overlap that is ignored.
    deepest : bool
        Whether to return the grain with the deepest overlap, not just any.

    Returns
    -------
    grain : int
        Index of the grain.
    overlap : float
        Depth of the overlap.
    dx, dy, dz : float
        Vector from its center, in the image that overlaps, to that of the new one.
    """
    position, half, boxes, lower, periodic = grains.position, grains.half, grains.boxes, walls.lower, walls.periodic
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
                        dx = x - position[g, 0] - kx * walls.lengths[0]
                        dy = y - position[g, 1] - ky * walls.lengths[1]
                        dz = z - position[g, 2] - kz * walls.lengths[2]
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
    grains: Grains,
    cells: Cells,
    walls: KernelContainer,
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
    """List the grains that exclude a part of a box for the center of a new grain.

    Parameters
    ----------
    grains, cells, walls
        Grains and container.
    x, y, z, ex, ey, ez : float
        Middle of the box and half its edges.
    hx, hy, hz : float
        Half the extents of the new grain.
    near : (m, 6) ndarray of float
        Output: vector from the middle of the box to the center of each grain, and half extents of the region that it
        excludes (of spheres the radius).

    Returns
    -------
    int
        Number of these grains, at most m; -1 if one of them excludes the whole box.
    """
    position, half, lower, periodic = grains.position, grains.half, walls.lower, walls.periodic
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
                        near[many, 0] = position[g, 0] + kx * walls.lengths[0] - x
                        near[many, 1] = position[g, 1] + ky * walls.lengths[1] - y
                        near[many, 2] = position[g, 2] + kz * walls.lengths[2] - z
                        gx, gy, gz = extents(half, g)
                        near[many, 3], near[many, 4], near[many, 5] = hx + gx, hy + gy, hz + gz
                        if is_within(grains.boxes, near, many, 0.0, 0.0, 0.0, ex, ey, ez):
                            return -1
                        # with negative extents: is the nearest point excluded?
                        many += is_within(grains.boxes, near, many, 0.0, 0.0, 0.0, -ex, -ey, -ez)
                        g = after[g]
    return many


@bare_kernel
def is_within(boxes: bool, near: Floats, k: int, x: float, y: float, z: float, ex: float, ey: float, ez: float) -> bool:
    """Return whether the whole box lies in the region that grain k of `near` excludes."""
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
    """Return half the extents of grain g along the axes; of a sphere all are its radius."""
    last = half.shape[1] - 1
    return half[g, 0], half[g, last >> 1], half[g, last]


@bare_kernel
def _sphere_overlap(half, g, dx, dy, dz, radius, least):  # type: ignore[no-untyped-def]
    """Return the overlap with sphere g if it is more than `least`, else `least`."""
    reach = radius + half[g, 0]
    square = dx * dx + dy * dy + dz * dz
    near = reach - least
    if near <= 0.0 or square >= near * near:
        return least
    # they overlap even if the root rounds to the sum of the radii
    return max(reach - math.sqrt(square), least + 1e-300)


@bare_kernel
def _box_overlap(half, g, dx, dy, dz, hx, hy, hz):  # type: ignore[no-untyped-def]
    """Return the overlap with box g along the axis where it is least; 0 or less if they do not overlap."""
    return min(hx + half[g, 0] - abs(dx), hy + half[g, 1] - abs(dy), hz + half[g, 2] - abs(dz))


@bare_kernel
def _wrapped(walls, axis, x):  # type: ignore[no-untyped-def]
    """Return a coordinate wrapped into the container along a periodic axis, unchanged along others."""
    if walls.periodic[axis] == 0:
        return x
    shift = math.floor((x - walls.lower[axis]) / walls.lengths[axis])
    return x - shift * walls.lengths[axis]
