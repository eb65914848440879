"""Cells that list each sphere wherever it reaches, so that spheres of any size ratio share one grid.

A sphere is listed in all cells that its reach touches, which may be its surface or what it will have grown to. All
spheres that hold a point are then in the list of its cell, and the nearest surface is found ring by ring.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import KernelContainer

#: entries of the lists per sphere at first
ENTRIES = 16
#: cells per sphere
CELLS = 0.4


class ReachCells(NamedTuple):
    """Lists of spheres by cell, for positions from the lower corner of the container.

    span: lengths of the periodic axes, 0 of others.  width, count: (3,) edges and numbers of the cells.  head: the
    entry made last in each cell; item: sphere of an entry; after: the entry made before it (-1: none).  used: (1,)
    number of entries.
    """

    span: Floats
    width: Floats
    count: Integers  # type: ignore[assignment]
    head: NDArray[np.int32]
    item: NDArray[np.int32]
    after: NDArray[np.int32]
    used: Integers


def reach_cells(walls: KernelContainer, spheres: int, per_sphere: float) -> ReachCells:
    """Return empty cells, about `per_sphere` for each sphere, of a container with coordinates from its corner."""
    axes = np.arange(3) < walls.dimension
    lengths = np.where(axes, walls.lengths, 1.0)
    edge = (lengths[axes].prod() / max(1.0, per_sphere * spheres)) ** (1.0 / walls.dimension)
    count = np.where(axes, np.maximum(np.floor(lengths / edge), 1), 1).astype(np.int64)
    entries = np.zeros(ENTRIES * spheres + 64, dtype=np.int32)
    head = np.full(int(count.prod()), -1, dtype=np.int32)
    used = np.zeros(1, dtype=np.int64)
    return ReachCells(
        np.where(axes, walls.lengths * walls.periodic, 0.0), lengths / count, count, head, entries, entries.copy(), used
    )


def with_room(cells: ReachCells) -> ReachCells:
    """Return the cells with room for twice as many entries."""
    more = np.zeros(len(cells.item), dtype=np.int32)
    return cells._replace(item=np.concatenate([cells.item, more]), after=np.concatenate([cells.after, more]))


def cells_with(walls: KernelContainer, count: int, spheres: Floats) -> ReachCells:
    """Return the cells for `count` spheres, in which the first ones, (m, 4), are listed."""
    cells = reach_cells(walls, max(count, 1), CELLS)
    for sphere, (x, y, z, radius) in enumerate(spheres):
        while not list_sphere(cells, sphere, x, y, z, radius, -1.0):
            cells = with_room(cells)
    return cells


@bare_kernel
def list_sphere(cells: ReachCells, sphere: int, x: float, y: float, z: float, reach: float, listed: float) -> bool:
    """List a sphere in the cells that its reach touches, but for those that the reach `listed` touches; -1: none.

    Returns
    -------
    bool
        Whether there was room; without room nothing is listed.
    """
    low_x, high_x = near(cells, 0, x, reach)
    low_y, high_y = near(cells, 1, y, reach)
    low_z, high_z = near(cells, 2, z, reach)
    most = (high_x - low_x + 1) * (high_y - low_y + 1) * (high_z - low_z + 1)
    entry = cells.used[0]
    if entry + most > len(cells.item):
        return False
    for i in range(low_x, high_x + 1):
        gap_x = gap_to(cells, 0, i, x)
        for j in range(low_y, high_y + 1):
            gap_y = gap_to(cells, 1, j, y)
            for k in range(low_z, high_z + 1):
                gap_z = gap_to(cells, 2, k, z)
                away = math.sqrt(gap_x * gap_x + gap_y * gap_y + gap_z * gap_z)
                if listed < away <= reach:
                    cell = cell_of(cells, i, j, k)
                    cells.item[entry], cells.after[entry] = sphere, cells.head[cell]
                    cells.head[cell] = entry
                    entry += 1
    cells.used[0] = entry
    return True


@bare_kernel
def near(cells: ReachCells, axis: int, x: float, reach: float) -> tuple[int, int]:
    """Return the first and the last cell within reach along an axis; they lie beyond the ends of a periodic one."""
    low, high = math.floor((x - reach) / cells.width[axis]), math.floor((x + reach) / cells.width[axis])
    if cells.span[axis] == 0.0:
        last = cells.count[axis] - 1
        return min(max(low, 0), last), min(max(high, 0), last)
    return low, high


@bare_kernel
def gap_to(cells: ReachCells, axis: int, index: int, x: float) -> float:
    """Return the distance of x from a cell along an axis."""
    low = index * cells.width[axis]
    return max(low - x, x - low - cells.width[axis], 0.0)


@bare_kernel
def wrapped(cells: ReachCells, axis: int, x: float) -> float:
    """Return a coordinate within the periodic length."""
    span = cells.span[axis]
    return x - math.floor(x / span) * span if span > 0.0 else x


@bare_kernel
def cell_of(cells: ReachCells, i: int, j: int, k: int) -> int:
    """Return the number of a cell; indices may lie beyond the ends of a periodic axis."""
    count = cells.count
    return ((i % count[0]) * count[1] + j % count[1]) * count[2] + k % count[2]


@bare_kernel
def distance(cells: ReachCells, spheres: Floats, sphere: int, x: float, y: float, z: float) -> float:
    """Return the distance of a point from the center of a sphere, or of its nearest image."""
    dx, dy, dz = abs(x - spheres[sphere, 0]), abs(y - spheres[sphere, 1]), abs(z - spheres[sphere, 2])
    if cells.span[0] > 0.0:
        dx = min(dx, cells.span[0] - dx)
    if cells.span[1] > 0.0:
        dy = min(dy, cells.span[1] - dy)
    if cells.span[2] > 0.0:
        dz = min(dz, cells.span[2] - dz)
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@bare_kernel
def is_covered(cells: ReachCells, spheres: Floats, x: float, y: float, z: float) -> bool:
    """Return whether a listed sphere holds a point."""
    i, j, k = near(cells, 0, x, 0.0)[0], near(cells, 1, y, 0.0)[0], near(cells, 2, z, 0.0)[0]
    entry = cells.head[cell_of(cells, i, j, k)]
    while entry >= 0:
        sphere = cells.item[entry]
        if distance(cells, spheres, sphere, x, y, z) <= spheres[sphere, 3]:
            return True
        entry = cells.after[entry]
    return False


@bare_kernel
def gap_at(cells: ReachCells, spheres: Floats, x: float, y: float, z: float, most: float) -> tuple[float, int]:
    """Return the distance of a point from the nearest surface, up to `most`, and the sphere (-1: none so near)."""
    gap, nearest, ring = most, -1, 0
    # a ring leads as far from any point of its middle cell as it is wide
    step = cells.width[0] if cells.count[2] == 1 else min(cells.width[0], cells.width[2])
    step = min(step, cells.width[1])
    at_x, at_y, at_z = near(cells, 0, x, 0.0)[0], near(cells, 1, y, 0.0)[0], near(cells, 2, z, 0.0)[0]
    while gap > (ring - 1) * step:
        inside = False
        low_x, high_x = ring_range(cells, 0, at_x, ring)
        low_y, high_y = ring_range(cells, 1, at_y, ring)
        low_z, high_z = ring_range(cells, 2, at_z, ring)
        for i in range(low_x, high_x + 1):
            for j in range(low_y, high_y + 1):
                for k in range(low_z, high_z + 1):
                    if max(abs(i - at_x), abs(j - at_y), abs(k - at_z)) < ring:
                        continue
                    inside = True
                    entry = cells.head[cell_of(cells, i, j, k)]
                    while entry >= 0:
                        sphere = cells.item[entry]
                        away = distance(cells, spheres, sphere, x, y, z) - spheres[sphere, 3]
                        if away < gap:
                            gap, nearest = away, sphere
                        entry = cells.after[entry]
        if not inside:
            break
        ring += 1
    return gap, nearest


@bare_kernel
def ring_range(cells: ReachCells, axis: int, at: int, ring: int) -> tuple[int, int]:
    """Return the first and the last cell of a ring along an axis, each cell of a periodic axis once."""
    low, high, count = at - ring, at + ring, cells.count[axis]
    if cells.span[axis] == 0.0:
        return max(low, 0), min(high, count - 1)
    if 2 * ring >= count:
        low, high = at - count // 2, at - count // 2 + count - 1
    return low, high
