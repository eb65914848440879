"""Cells of a Laguerre tessellation (Voronoi cells of weighted seeds) in a container, one by one, in kernels.

A point belongs to the seed of the smallest ``|x - seed|**2 - weight``; with equal weights this is the Voronoi
tessellation. A cell starts as the bounds of the container, and is cut by the planes halfway to the other seeds, from
near ones to distant ones, until no other can reach it. In two dimensions cells are prisms of height 1.

Walls that are not flat cut by planes (:mod:`voxgran.packing.tessellation.voronoi_walls`).

References
----------
Aurenhammer 1987, Power diagrams: properties, algorithms and applications, SIAM Journal on Computing 16, 78-96,
doi:10.1137/0216006.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran.containers.kernel_container import MESH, ROUND, UPRIGHT, KernelContainer
from voxgran.geometry.polyhedron import (
    CROWDED,
    CUT,
    EMPTY,
    FAILED,
    Polyhedron,
    area_of_face,
    clip,
    empty_polyhedron,
    reach_of,
    set_box,
    volume_and_center,
)
from voxgran.packing.tessellation.voronoi_bodies import Bodies, Poses, bodies_of, middle_of_gap, poses_of
from voxgran.packing.tessellation.voronoi_walls import cut_by_round_wall, cut_by_triangles

#: seeds in a cell of the search, about
SEEDS = 2.0
#: shift of planes, in sizes of the container, where rounding prevents a cut, and tries
SHIFT, TRIES = 1e-13, 6
#: planes that are sorted at a time
QUEUE = 128
#: room for faces in the beginning
FACES = 64


class Seeds(NamedTuple):
    """Seeds and weights, with the cells in which they are found.

    place: (n, 3) from the lower corner of the bounds.  weight: (n,).  heaviest: (1,) largest weight.  count, width:
    cells along each axis, and their edges.  head: the first seed in each cell; after: the next one, -1 for none.
    low, high, near, queue, number: work space.
    """

    place: Floats
    weight: Floats
    heaviest: Floats
    count: Integers  # type: ignore[assignment]
    width: Floats
    head: Integers
    after: Integers
    low: Floats
    high: Floats
    near: Floats
    queue: Floats
    number: Integers


class Tessellation(NamedTuple):
    """What the cell of a seed is made from, the cell as work space, and the grains that lie about the seeds."""

    seeds: Seeds
    walls: KernelContainer
    cell: Polyhedron
    bodies: Bodies
    poses: Poses


def seeds_of(place: Floats, weight: Floats, walls: KernelContainer) -> Seeds:
    """Return seeds, (n, 3) from the lower corner, in cells for searches."""
    n, axes = max(len(place), 1), np.arange(3) < walls.dimension
    lengths = np.where(axes, walls.lengths, 1.0)
    edge = (SEEDS * lengths[axes].prod() / n) ** (1.0 / walls.dimension)
    count = np.where(axes, np.maximum(np.floor(lengths / edge), 1.0), 1.0).astype(np.int64)
    width = lengths / count
    where = np.clip((place / width).astype(np.int64), 0, count - 1)
    flat = (where[:, 0] * count[1] + where[:, 1]) * count[2] + where[:, 2]
    head, after = np.full(int(count.prod()), -1, dtype=np.int64), np.full(len(place), -1, dtype=np.int64)
    order = np.argsort(flat, kind="stable")
    chained = flat[order]
    same = np.flatnonzero(chained[1:] == chained[:-1])
    after[order[same]] = order[same + 1]
    first = np.concatenate([[True], chained[1:] != chained[:-1]]) if len(place) else np.zeros(0, dtype=np.bool_)
    head[chained[first]] = order[first]
    heaviest = np.array([weight.max(initial=-np.inf)])
    return Seeds(
        place,
        weight,
        heaviest,
        count,
        width,
        head,
        after,
        np.zeros(3),
        np.zeros(3),
        np.zeros(4),
        np.zeros((QUEUE, 5)),
        np.zeros(QUEUE, dtype=np.int64),
    )


class Diagram(NamedTuple):
    """Volumes (n,) of all cells, their centroids (n, 3) from the lower corner, and their faces to other cells.

    The faces of cell i are those from ``start[i]`` to ``start[i + 1]``: the seed beyond, and the change of the volume
    with the difference of the weights, which is the area over twice the distance of the seeds.
    """

    volume: Floats
    center: Floats
    start: Integers
    beyond: Integers
    slope: Floats


class Cells:
    """All cells of a tessellation, with work space that grows as needed."""

    def __init__(self, walls: KernelContainer) -> None:
        self.walls = walls
        self.work, self.faces = empty_polyhedron(FACES), FACES // 2
        # no grains: kernels are compiled once for cells with and without them
        none = np.zeros((0, 3)), np.zeros((0, 4)), np.zeros(0)
        self.none = bodies_of([]), poses_of([], np.zeros(0, dtype=np.int64), *none)

    def around(self, seeds: Seeds, bodies: Bodies | None = None, poses: Poses | None = None) -> Tessellation:
        """Return what kernels make the cells of seeds from, with grains or without."""
        return Tessellation(seeds, self.walls, self.work, bodies or self.none[0], poses or self.none[1])

    def grow(self) -> None:
        """Make room for twice as many faces of a cell."""
        self.work = empty_polyhedron(2 * len(self.work.size))

    def measured(self, seeds: Seeds, block: int, look: Callable[[], None]) -> Diagram:
        """Return the diagram; `look` is called before each block of so many cells, and may raise."""
        n = len(seeds.place)
        volume, center, degree = np.zeros(n), np.zeros((n, 3)), np.zeros(n, dtype=np.int64)
        beyond: list[Integers] = []
        slope: list[Floats] = []
        for first in range(0, n, block):
            look()
            last, room = min(first + block, n), self.faces * block
            while True:
                others, slopes = np.zeros(room, dtype=np.int64), np.zeros(room)
                used = _measure(self.around(seeds), first, last, volume, center, degree, others, slopes)
                if used >= 0:
                    break
                if used == -1:
                    self.grow()
                else:
                    self.faces *= 2
                    room = self.faces * block
            beyond.append(others[:used])
            slope.append(slopes[:used])
        start = np.concatenate([[0], np.cumsum(degree)])
        none = np.zeros(0, dtype=np.int64), np.zeros(0)
        return Diagram(volume, center, start, np.concatenate([none[0], *beyond]), np.concatenate([none[1], *slope]))


@kernel
def _measure(tessellation, first, last, volume, center, degree, beyond, slope):  # type: ignore[no-untyped-def]
    """Write volumes, centroids and faces of some cells; return the number of faces, -1 or -2 where room is short."""
    used, middle, cell = 0, np.zeros(3), tessellation.cell
    for i in range(first, last):
        state = build_cell(tessellation, i, False)
        if state == CROWDED:
            return -1
        degree[i], volume[i] = 0, 0.0
        for c in range(3):
            center[i, c] = tessellation.seeds.place[i, c]
        if state == EMPTY:
            continue
        volume[i] = volume_and_center(cell, middle)
        for c in range(tessellation.walls.dimension):
            center[i, c] += middle[c]
        for f in range(cell.count[1]):
            if cell.owner[f] >= 0:
                if used >= len(beyond):
                    return -2
                beyond[used], slope[used] = cell.owner[f], area_of_face(cell, f) / (2.0 * cell.span[f])
                used += 1
                degree[i] += 1
    return used


@bare_kernel
def build_cell(tessellation: Tessellation, i: int, around: bool) -> int:
    """Make the cell of seed i, from the seed; return CUT, EMPTY or CROWDED.

    If `around`, the planes are those in the middle of the gaps between the grains, with the same normals. Where
    rounding prevents a cut, all planes move inward by a shift far below what is of interest.
    """
    lengths, state = tessellation.walls.lengths, FAILED
    size = max(lengths[0], lengths[1], lengths[2])
    for k in range(TRIES):
        state = _cut_by_all(tessellation, i, size * SHIFT * k * 10.0**k, around)
        if state != FAILED:
            break
    return EMPTY if state == FAILED else state


@bare_kernel
def _cut_by_all(tessellation, i, shift, around):  # type: ignore[no-untyped-def]
    """Make the cell of seed i with planes that are shifted inward."""
    seeds, walls, cell = tessellation.seeds, tessellation.walls, tessellation.cell
    for c in range(3):
        if c >= walls.dimension:
            seeds.low[c], seeds.high[c] = -0.5, 0.5
            continue
        if walls.periodic[c] == 1:
            seeds.low[c], seeds.high[c] = -0.5 * walls.lengths[c], 0.5 * walls.lengths[c]
        else:
            seeds.low[c], seeds.high[c] = -seeds.place[i, c], walls.lengths[c] - seeds.place[i, c]
        if walls.kind == MESH:
            # no face of the box lies in a wall, where rounding would decide
            seeds.low[c], seeds.high[c] = seeds.low[c] - walls.lengths[c], seeds.high[c] + walls.lengths[c]
    set_box(cell, seeds.low, seeds.high)
    state = _cut_by_seeds(tessellation, i, shift, around)
    if state == CUT and walls.kind in (UPRIGHT, ROUND):
        state = cut_by_round_wall(seeds.place, walls, cell, i, shift)
    if state == CUT and walls.kind == MESH:
        state = cut_by_triangles(seeds.place, walls, cell, i, shift, seeds.near)
    return state


@bare_kernel
def _cut_by_seeds(tessellation, i, shift, around):  # type: ignore[no-untyped-def]
    """Cut by the planes between seed i and all others that reach the cell, in shells of cells around it."""
    seeds, walls, cell, poses = tessellation.seeds, tessellation.walls, tessellation.cell, tessellation.poses
    flat, narrow = walls.dimension == 2, math.inf
    for c in range(walls.dimension):
        narrow = min(narrow, seeds.width[c])
    reach, shell = reach_of(cell, flat), 0
    own = seeds.weight[i]
    if not around:
        reach, shell = _cut_by_nearest(seeds, walls, cell, i, reach, shift), 2
        if reach < 0.0:
            return int(-reach)
    while True:
        limit = reach + math.sqrt(max(reach * reach + seeds.heaviest[0] - own, 0.0))
        if around:
            limit = 2.0 * reach + poses.bound[i] + poses.farthest[3]
        if (shell - 1) * narrow > limit:
            return CUT
        for dx in range(-shell, shell + 1):
            for dy in range(-shell, shell + 1):
                edge = max(abs(dx), abs(dy)) == shell
                if flat:
                    if edge:
                        reach = _cut_by_cell(tessellation, i, (dx, dy, 0), reach, shift, around)
                else:
                    # the whole side of the shell, or its two ends
                    step = 1 if edge or shell == 0 else 2 * shell
                    for dz in range(-shell, shell + 1, step):
                        reach = _cut_by_cell(tessellation, i, (dx, dy, dz), reach, shift, around)
                        if reach < 0.0:
                            return int(-reach)
                if reach < 0.0:
                    return int(-reach)
        shell += 1


@bare_kernel
def _cut_by_nearest(seeds, walls, cell, i, reach, shift):  # type: ignore[no-untyped-def]
    """Cut by the seeds in the cells of the search around that of seed i, the nearest plane first: few cuts are in vain.

    Return the reach of what is left, or minus the state of a failure.
    """
    many, deep = 0, 1 if walls.dimension == 3 else 0
    for dx in range(-1, 2):
        for dy in range(-1, 2):
            for dz in range(-deep, deep + 1):
                j, period = _first_in(seeds, walls, i, (dx, dy, dz))
                while j >= 0:
                    if j != i:
                        if many == len(seeds.number):
                            reach, many = _cut_by_queue(seeds, walls, cell, many, reach, shift), 0
                            if reach < 0.0:
                                return reach
                        _enqueue(seeds, many, j, _plane_to(seeds, walls, i, j, period, reach))
                        many += 1
                    j = seeds.after[j]
    return _cut_by_queue(seeds, walls, cell, many, reach, shift)


@bare_kernel
def _enqueue(seeds, many, j, plane):  # type: ignore[no-untyped-def]
    """Put a plane into the queue of `many`, which is sorted by the offsets."""
    queue, place = seeds.queue, many
    while place > 0 and queue[place - 1, 4] > plane[4]:
        for c in range(5):
            queue[place, c] = queue[place - 1, c]
        seeds.number[place] = seeds.number[place - 1]
        place -= 1
    for c in range(5):
        queue[place, c] = plane[c]
    seeds.number[place] = j


@bare_kernel
def _cut_by_queue(seeds, walls, cell, many, reach, shift):  # type: ignore[no-untyped-def]
    """Cut by the planes in the queue; return the reach of what is left, or minus the state of a failure."""
    queue = seeds.queue
    for k in range(many):
        if queue[k, 4] >= reach:
            break
        plane = queue[k, 0], queue[k, 1], queue[k, 2], queue[k, 4] - shift
        state = clip(cell, plane[0], plane[1], plane[2], plane[3], seeds.number[k], queue[k, 3])
        if state > CUT:
            return -float(state)
        if state == CUT:
            reach = reach_of(cell, walls.dimension == 2)
    return reach


@bare_kernel
def _first_in(seeds, walls, i, steps):  # type: ignore[no-untyped-def]
    """Return the first seed in a cell of the search, by its steps from that of seed i, and the periods to its image.

    It is -1 where there is none, or the cell lies beyond a wall.
    """
    count = seeds.count
    x = min(max(int(seeds.place[i, 0] / seeds.width[0]), 0), count[0] - 1) + steps[0]
    y = min(max(int(seeds.place[i, 1] / seeds.width[1]), 0), count[1] - 1) + steps[1]
    z = min(max(int(seeds.place[i, 2] / seeds.width[2]), 0), count[2] - 1) + steps[2]
    sx, sy, sz = x // count[0], y // count[1], z // count[2]
    if (
        (sx != 0 and walls.periodic[0] == 0)
        or (sy != 0 and walls.periodic[1] == 0)
        or (sz != 0 and walls.periodic[2] == 0)
    ):
        return -1, (sx, sy, sz)
    flat = ((x - sx * count[0]) * count[1] + y - sy * count[1]) * count[2] + z - sz * count[2]
    return seeds.head[flat], (sx, sy, sz)


@bare_kernel
def _plane_to(seeds, walls, i, j, period, reach):  # type: ignore[no-untyped-def]
    """Return normal, distance of the seeds and offset of the plane between seed i and an image of seed j.

    The offset is infinite where the plane is farther than the reach, which needs no root.
    """
    ux = seeds.place[j, 0] - seeds.place[i, 0] + period[0] * walls.lengths[0]
    uy = seeds.place[j, 1] - seeds.place[i, 1] + period[1] * walls.lengths[1]
    uz = seeds.place[j, 2] - seeds.place[i, 2] + period[2] * walls.lengths[2]
    square = ux * ux + uy * uy + uz * uz
    ahead = square + seeds.weight[i] - seeds.weight[j]
    if square == 0.0 or (ahead > 0.0 and ahead * ahead > 4.0 * reach * reach * square):
        return 0.0, 0.0, 0.0, 0.0, math.inf
    away = math.sqrt(square)
    return ux / away, uy / away, uz / away, away, ahead / (2.0 * away)


@bare_kernel
def _cut_by_cell(tessellation, i, steps, reach, shift, around):  # type: ignore[no-untyped-def]
    """Cut by the seeds in one cell of the search; return the reach of what is left, or minus the state of a failure."""
    seeds, walls, cell, poses = tessellation.seeds, tessellation.walls, tessellation.cell, tessellation.poses
    j, period = _first_in(seeds, walls, i, steps)
    while j >= 0:
        if j != i:
            x, y, z, away, offset = _plane_to(seeds, walls, i, j, period, math.inf if around else reach)
            if around and away > 0.0:
                offset = 0.5 * (away - poses.bound[i] - poses.bound[j])
                if offset < reach:
                    offset = middle_of_gap(tessellation.bodies, poses, i, j, x, y, z, away)
            if offset < reach:
                state = clip(cell, x, y, z, offset - shift, j, away)
                if state > CUT:
                    return -float(state)
                if state == CUT:
                    reach = reach_of(cell, walls.dimension == 2)
        j = seeds.after[j]
    return reach
