"""Search of the grains that a new one overlaps, for any size ratio.

Grains are spheres (in two dimensions disks) or boxes along the axes, in a hierarchical grid of linked cells whose
levels are halves of each other in size.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import WHOLE, Floats
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.containers.kernel_container import KernelContainer
from voxgran.geometry.level_grid import LevelGrid, cells_near, cells_of, first_in_cell, image_shift, link_at, turns_at
from voxgran.geometry.vectors import Vector, add, along, dot, row_of, sub

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


class Bed(NamedTuple):
    """Grains, the cells in which those that are placed are linked, and the walls around them."""

    grains: Grains
    cells: LevelGrid
    walls: KernelContainer


def sort_into_levels(half: Floats) -> NDArray[np.int8]:
    """Return the level of each grain by its largest half extent (n, axes); 0 is that of the largest grain."""
    size = half.max(axis=1, initial=0.0)
    largest = size.max(initial=0.0)
    exact = libm.log2(largest / size) if len(size) else np.zeros(0)
    return np.clip(np.floor(exact + WHOLE), 0, LEVELS - 1).astype(np.int8)


def lay_out(half: Floats, level: NDArray[np.int8], walls: KernelContainer, dimension: int) -> LevelGrid:
    """Return empty cells for grains of half extents `half`, (n, 1 or 3), and their levels."""
    number = np.bincount(level, minlength=1)
    reach = np.zeros((len(number), 3))
    np.maximum.at(reach, level, half)
    return cells_of(walls.lengths, walls.periods, reach, number, dimension)


@bare_kernel
def enter(bed: Bed, g: int, place: Vector) -> None:
    """Place a grain at a position, wrapped into the container along periodic axes."""
    position, turns = bed.grains.position, turns_at(bed.cells, *from_corner(bed, place))
    position[g, 0], position[g, 1], position[g, 2] = sub(place, image_shift(bed.cells, *turns))
    bed.grains.entered[g] = 1
    _link(bed, g)


@bare_kernel
def _link(bed, g):  # type: ignore[no-untyped-def]
    """Link a grain that has its position into its cell."""
    link_at(bed.cells, g, bed.grains.level[g], *from_corner(bed, row_of(bed.grains.position, g)))


@inlined_kernel
def from_corner(bed: Bed, place: Vector) -> Vector:
    """Return the vector from the lower corner of the container to a place."""
    lower = bed.walls.lower
    return place[0] - lower[0], place[1] - lower[1], place[2] - lower[2]


@bare_kernel
def link_all(bed: Bed, order: NDArray[np.int32]) -> None:
    """Link all placed grains into empty cells, in the given order."""
    for k in range(len(order)):
        if bed.grains.entered[order[k]] == 1:
            _link(bed, order[k])


@inlined_kernel
def find_overlap(bed: Bed, place: Vector, half: Vector, slack: float, deepest: bool) -> tuple[int, float, Vector]:
    """Return a grain that a new one overlaps by more than `slack`, or -1; the deepest one, or just any.

    The overlap follows, and the vector from its center, in the image that overlaps, to `place`, that of the new grain,
    which has the half extents `half`.
    """
    grains, cells = bed.grains, bed.cells
    best, most, away = -1, slack, (0.0, 0.0, 0.0)
    for level in range(len(cells.first)):
        if cells.filled[level] == 0:
            continue
        reach = along(half, 1.0, row_of(cells.reach, level))
        low, high = cells_near(cells, level, *from_corner(bed, place), reach)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    g, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    while g >= 0:
                        way = sub(sub(place, row_of(grains.position, g)), image_shift(cells, ti, tj, tk))
                        if grains.boxes:
                            overlap = _box_overlap(grains.half, g, way, half)
                        else:
                            overlap = _sphere_overlap(grains.half, g, way, half[0], most)
                        if overlap > most:
                            best, most, away = g, overlap, way
                            if not deepest:
                                return best, most, away
                        g = cells.after[g]
    return best, most, away


@bare_kernel
def gather(bed: Bed, place: Vector, half: Vector, edge: Vector, near: Floats) -> int:
    """List the grains that exclude a part of a box for the center of a new grain; return their number.

    The box has its middle at `place` and half edges `edge`; the half extents of the new grain are `half`. Rows of
    `near`, (m, 6), are the vector from the middle to the center of each grain, and half extents of the region that it
    excludes (of spheres the radius). The number is at most m; -1 if one grain excludes the whole box.
    """
    grains, cells, (x, y, z) = bed.grains, bed.cells, place
    (hx, hy, hz), middle, inner = half, (0.0, 0.0, 0.0), (-edge[0], -edge[1], -edge[2])
    many = 0
    for level in range(len(cells.first)):
        if cells.filled[level] == 0:
            continue
        reach = along(along(edge, 1.0, half), 1.0, row_of(cells.reach, level))
        low, high = cells_near(cells, level, *from_corner(bed, place), reach)
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    g, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    while g >= 0 and many < len(near):
                        dx, dy, dz = add(row_of(grains.position, g), image_shift(cells, ti, tj, tk))
                        near[many, 0], near[many, 1], near[many, 2] = dx - x, dy - y, dz - z
                        gx, gy, gz = extents(grains.half, g)
                        near[many, 3], near[many, 4], near[many, 5] = hx + gx, hy + gy, hz + gz
                        if is_within(grains.boxes, near, many, middle, edge):
                            return -1
                        # with negative extents: is the nearest point excluded?
                        many += is_within(grains.boxes, near, many, middle, inner)
                        g = cells.after[g]
    return many


@bare_kernel
def is_within(boxes: bool, near: Floats, k: int, middle: Vector, edge: Vector) -> bool:
    """Return whether a box, by its middle and half edges, lies in the region that grain k of `near` excludes."""
    dx, dy, dz = (
        max(abs(middle[0] - near[k, 0]) + edge[0], 0.0),
        max(abs(middle[1] - near[k, 1]) + edge[1], 0.0),
        max(abs(middle[2] - near[k, 2]) + edge[2], 0.0),
    )
    if boxes:
        return dx < near[k, 3] and dy < near[k, 4] and dz < near[k, 5]
    return dx * dx + dy * dy + dz * dz < near[k, 3] * near[k, 3]


@bare_kernel
def extents(half: Floats, g: int) -> Vector:
    """Return half the extents of grain g along the axes; of a sphere all are its radius."""
    last = half.shape[1] - 1
    return half[g, 0], half[g, last >> 1], half[g, last]


@bare_kernel
def _sphere_overlap(half, g, way, radius, least):  # type: ignore[no-untyped-def]
    """Return the overlap with sphere g if it is more than `least`, else `least`."""
    reach, square = radius + half[g, 0], dot(way, way)
    near = reach - least
    if near <= 0.0 or square >= near * near:
        return least
    # they overlap even if the root rounds to the sum of the radii
    return max(reach - math.sqrt(square), least + 1e-300)


@bare_kernel
def _box_overlap(half, g, way, own):  # type: ignore[no-untyped-def]
    """Return the overlap with box g along the axis where it is least; 0 or less if they do not overlap."""
    return min(own[0] + half[g, 0] - abs(way[0]), own[1] + half[g, 1] - abs(way[1]), own[2] + half[g, 2] - abs(way[2]))
