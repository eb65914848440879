"""Search of the grains that a new one overlaps, for any size ratio.

Grains are spheres (in two dimensions disks) or boxes along the axes, in a hierarchical grid of linked cells whose
levels are halves of each other in size.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import WHOLE, Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import KernelContainer
from voxgran.geometry.level_grid import LevelGrid, cells_near, empty_grid, first_in_cell, link_at

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


def sort_into_levels(half: Floats) -> NDArray[np.int8]:
    """Return the level of each grain by its largest half extent (n, axes); 0 is that of the largest grain."""
    size = half.max(axis=1, initial=0.0)
    largest = size.max(initial=0.0)
    exact = np.log2(largest / size) if len(size) else np.zeros(0)
    return np.clip(np.floor(exact + WHOLE), 0, LEVELS - 1).astype(np.int8)


def lay_out(half: Floats, level: NDArray[np.int8], walls: KernelContainer, dimension: int) -> LevelGrid:
    """Return empty cells for grains of half extents `half`, (n, 1 or 3), and their levels."""
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
    wraps = np.tile(walls.periodic, (levels, 1))
    return empty_grid(walls.lengths * walls.periodic, reach, walls.lengths / count, count, wraps, len(half))


@bare_kernel
def enter(grains: Grains, cells: LevelGrid, walls: KernelContainer, g: int, x: float, y: float, z: float) -> None:
    """Place a grain at a position, wrapped into the container along periodic axes."""
    grains.position[g, 0] = _wrapped(walls, 0, x)
    grains.position[g, 1] = _wrapped(walls, 1, y)
    grains.position[g, 2] = _wrapped(walls, 2, z)
    grains.entered[g] = 1
    _link(grains, cells, walls, g)


@bare_kernel
def _link(grains, cells, walls, g):  # type: ignore[no-untyped-def]
    """Link a grain that has its position into its cell."""
    x, y, z = grains.position[g, 0], grains.position[g, 1], grains.position[g, 2]
    link_at(cells, g, grains.level[g], x - walls.lower[0], y - walls.lower[1], z - walls.lower[2])


@bare_kernel
def link_all(grains: Grains, cells: LevelGrid, walls: KernelContainer, order: NDArray[np.int32]) -> None:
    """Link all placed grains into empty cells, in the given order."""
    for k in range(len(order)):
        g = order[k]
        if grains.entered[g] == 1:
            _link(grains, cells, walls, g)


@bare_kernel
def find_overlap(
    grains: Grains,
    cells: LevelGrid,
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
    """Return a grain that a new one at (x, y, z) overlaps by more than `slack`, or -1; the deepest one, or just any.

    The overlap follows, and the vector from its center, in the image that overlaps, to that of the new grain, which has
    the half extents (hx, hy, hz).
    """
    position, half, boxes, lower = grains.position, grains.half, grains.boxes, walls.lower
    span, after = cells.span, cells.after
    best, most, bx, by, bz = -1, slack, 0.0, 0.0, 0.0
    for level in range(len(cells.first)):
        if cells.filled[level] == 0:
            continue
        reach = hx + cells.reach[level, 0], hy + cells.reach[level, 1], hz + cells.reach[level, 2]
        low, high = cells_near(cells, level, x - lower[0], y - lower[1], z - lower[2], reach)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    g, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    while g >= 0:
                        dx = x - position[g, 0] - ti * span[0]
                        dy = y - position[g, 1] - tj * span[1]
                        dz = z - position[g, 2] - tk * span[2]
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
    cells: LevelGrid,
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
    """List the grains that exclude a part of a box for the center of a new grain; return their number.

    The box has its middle at (x, y, z) and half edges (ex, ey, ez); the half extents of the new grain are (hx, hy, hz).
    Rows of `near`, (m, 6), are the vector from the middle to the center of each grain, and half extents of the region
    that it excludes (of spheres the radius). The number is at most m; -1 if one grain excludes the whole box.
    """
    position, half, lower = grains.position, grains.half, walls.lower
    span, after = cells.span, cells.after
    many = 0
    for level in range(len(cells.first)):
        if cells.filled[level] == 0:
            continue
        reach = ex + hx + cells.reach[level, 0], ey + hy + cells.reach[level, 1], ez + hz + cells.reach[level, 2]
        low, high = cells_near(cells, level, x - lower[0], y - lower[1], z - lower[2], reach)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    g, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    while g >= 0 and many < len(near):
                        near[many, 0] = position[g, 0] + ti * span[0] - x
                        near[many, 1] = position[g, 1] + tj * span[1] - y
                        near[many, 2] = position[g, 2] + tk * span[2] - z
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
