"""Cells of a Laguerre tessellation (Voronoi cells of weighted seeds) in a container, one by one, in kernels.

A point belongs to the seed of the smallest ``|x - seed|**2 - weight``; with equal weights this is the Voronoi
tessellation. A cell starts as the bounds of the container, and is cut by the planes halfway to the other seeds, from
near ones to distant ones, until no other can reach it. In two dimensions cells are prisms of height 1.

Round walls cut by tangent planes at the directions of the corners beyond them, until corners protrude by little. A wall
of triangles cuts by planes through its points nearest to the seed, across the way to them: what is left is convex and
lies inside, also in containers that are not convex, where corners of the container remain empty.

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
from voxgran._base.tree import closest_on_triangle, square_to_box
from voxgran.containers.kernel_container import MESH, ROUND, UPRIGHT, KernelContainer
from voxgran.packing.tessellation.voronoi_bodies import Bodies, Poses, bodies_of, middle_of_gap, poses_of
from voxgran.packing.tessellation.voronoi_polyhedron import (
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

#: seeds in a cell of the search, about
SEEDS = 2.0
#: protrusion of corners beyond a round wall, in sizes of the cell, and most planes of such a wall per cell
PROTRUSION, ROUND_PLANES = 0.005, 80
#: shift of planes, in sizes of the container, where rounding prevents a cut, and tries
SHIFT, TRIES = 1e-13, 6
#: most planes of walls of triangles per cell, and protrusion, in sizes of the container, that is rounding
TRIANGLE_PLANES, OUTSIDE = 400, 1e-12
#: owners of the faces at round walls and at walls of triangles
ROUND_WALL, MESH_WALL = -7, -8
#: room for faces in the beginning
FACES = 64


class Seeds(NamedTuple):
    """Seeds and weights, with the cells in which they are found.

    place: (n, 3) from the lower corner of the bounds.  weight: (n,).  heaviest: (1,) largest weight.  count, width:
    cells along each axis, and their edges.  head: the first seed in each cell; after: the next one, -1 for none.
    low, high, near: work space.
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
    return Seeds(place, weight, heaviest, count, width, head, after, np.zeros(3), np.zeros(3), np.zeros(4))


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
                found = volume, center, degree, others, slopes
                used = _measure(seeds, self.walls, self.work, *self.none, first, last, *found)
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
def _measure(  # type: ignore[no-untyped-def]
    seeds, walls, cell, bodies, poses, first, last, volume, center, degree, beyond, slope
):
    """Write volumes, centroids and faces of some cells; return the number of faces, -1 or -2 where room is short."""
    used, middle = 0, np.zeros(3)
    for i in range(first, last):
        state = build_cell(seeds, walls, cell, i, bodies, poses, False)
        if state == CROWDED:
            return -1
        degree[i], volume[i] = 0, 0.0
        for c in range(3):
            center[i, c] = seeds.place[i, c]
        if state == EMPTY:
            continue
        volume[i] = volume_and_center(cell, middle)
        for c in range(walls.dimension):
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
def build_cell(
    seeds: Seeds, walls: KernelContainer, cell: Polyhedron, i: int, bodies: Bodies, poses: Poses, around: bool
) -> int:
    """Make the cell of seed i, from the seed; return CUT, EMPTY or CROWDED.

    If `around`, the planes are those in the middle of the gaps between the grains, with the same normals. Where
    rounding prevents a cut, all planes move inward by a shift far below what is of interest.
    """
    size = max(walls.lengths[0], walls.lengths[1], walls.lengths[2])
    state = FAILED
    for k in range(TRIES):
        state = _cut_by_all(seeds, walls, cell, i, size * SHIFT * k * 10.0**k, bodies, poses, around)
        if state != FAILED:
            break
    return EMPTY if state == FAILED else state


@bare_kernel
def _cut_by_all(seeds, walls, cell, i, shift, bodies, poses, around):  # type: ignore[no-untyped-def]
    """Make the cell of seed i with planes that are shifted inward."""
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
    state = _cut_by_seeds(seeds, walls, cell, i, shift, bodies, poses, around)
    if state == CUT and walls.kind in (UPRIGHT, ROUND):
        state = _cut_by_round_wall(seeds, walls, cell, i, shift)
    if state == CUT and walls.kind == MESH:
        state = _cut_by_triangles(seeds, walls, cell, i, shift)
    return state


@bare_kernel
def _cut_by_seeds(seeds, walls, cell, i, shift, bodies, poses, around):  # type: ignore[no-untyped-def]
    """Cut by the planes between seed i and all others that reach the cell, in shells of cells around it."""
    flat, narrow = walls.dimension == 2, math.inf
    for c in range(walls.dimension):
        narrow = min(narrow, seeds.width[c])
    reach, shell = reach_of(cell, flat), 0
    own = seeds.weight[i]
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
                        reach = _cut_by_cell(seeds, walls, cell, i, dx, dy, 0, reach, shift, bodies, poses, around)
                else:
                    # the whole side of the shell, or its two ends
                    step = 1 if edge or shell == 0 else 2 * shell
                    for dz in range(-shell, shell + 1, step):
                        reach = _cut_by_cell(seeds, walls, cell, i, dx, dy, dz, reach, shift, bodies, poses, around)
                        if reach < 0.0:
                            return int(-reach)
                if reach < 0.0:
                    return int(-reach)
        shell += 1


@bare_kernel
def _cut_by_cell(seeds, walls, cell, i, dx, dy, dz, reach, shift, bodies, poses, around):  # type: ignore[no-untyped-def]
    """Cut by the seeds in one cell of the search; return the reach of what is left, or minus the state of a failure."""
    count, lengths = seeds.count, walls.lengths
    x = min(max(int(seeds.place[i, 0] / seeds.width[0]), 0), count[0] - 1) + dx
    y = min(max(int(seeds.place[i, 1] / seeds.width[1]), 0), count[1] - 1) + dy
    z = min(max(int(seeds.place[i, 2] / seeds.width[2]), 0), count[2] - 1) + dz
    sx, sy, sz = x // count[0], y // count[1], z // count[2]
    if (
        (sx != 0 and walls.periodic[0] == 0)
        or (sy != 0 and walls.periodic[1] == 0)
        or (sz != 0 and walls.periodic[2] == 0)
    ):
        return reach
    j = seeds.head[((x - sx * count[0]) * count[1] + y - sy * count[1]) * count[2] + z - sz * count[2]]
    while j >= 0:
        if j != i:
            ux = seeds.place[j, 0] - seeds.place[i, 0] + sx * lengths[0]
            uy = seeds.place[j, 1] - seeds.place[i, 1] + sy * lengths[1]
            uz = seeds.place[j, 2] - seeds.place[i, 2] + sz * lengths[2]
            square = ux * ux + uy * uy + uz * uz
            away = math.sqrt(square)
            offset = (square + seeds.weight[i] - seeds.weight[j]) / (2.0 * away) if away > 0.0 else math.inf
            if around and away > 0.0:
                offset = 0.5 * (away - poses.bound[i] - poses.bound[j])
                if offset < reach:
                    offset = middle_of_gap(bodies, poses, i, j, ux / away, uy / away, uz / away, away)
            if offset < reach:
                state = clip(cell, ux / away, uy / away, uz / away, offset - shift, j, away)
                if state > CUT:
                    return -float(state)
                if state == CUT:
                    reach = reach_of(cell, walls.dimension == 2)
        j = seeds.after[j]
    return reach


@bare_kernel
def _cut_by_round_wall(seeds, walls, cell, i, shift):  # type: ignore[no-untyped-def]
    """Cut by tangent planes of a cylinder or a sphere, at the corner that is farthest beyond it, again and again."""
    mx, my = walls.middle[0] - seeds.place[i, 0], walls.middle[1] - seeds.place[i, 1]
    mz = walls.middle[2] - seeds.place[i, 2] if walls.kind == ROUND else 0.0
    for _ in range(ROUND_PLANES):
        # of what is left of the cell: before the cuts it may reach far beyond the wall
        worst, most = -1, walls.radius + PROTRUSION * reach_of(cell, walls.dimension == 2)
        for v in range(cell.count[0]):
            x, y = cell.corner[v, 0] - mx, cell.corner[v, 1] - my
            z = cell.corner[v, 2] - mz if walls.kind == ROUND else 0.0
            far = math.sqrt(x * x + y * y + z * z)
            if far > most:
                worst, most = v, far
        if worst < 0:
            return CUT
        x, y = (cell.corner[worst, 0] - mx) / most, (cell.corner[worst, 1] - my) / most
        z = (cell.corner[worst, 2] - mz) / most if walls.kind == ROUND else 0.0
        state = clip(cell, x, y, z, walls.radius + x * mx + y * my + z * mz - shift, ROUND_WALL, 0.0)
        if state > CUT:
            return state
    return CUT


@bare_kernel
def _cut_by_triangles(seeds, walls, cell, i, shift):  # type: ignore[no-untyped-def]
    """Cut by planes through the nearest points of triangles, the nearest triangle first, until none is inside."""
    mesh, near = walls.mesh, seeds.near
    px = seeds.place[i, 0] + mesh.shift[0]
    py = seeds.place[i, 1] + mesh.shift[1]
    pz = seeds.place[i, 2] + mesh.shift[2]
    slack = OUTSIDE * max(walls.lengths[0], walls.lengths[1], walls.lengths[2])
    passed, last = -1.0, -1
    for _ in range(TRIANGLE_PLANES):
        reach = reach_of(cell, walls.dimension == 2)
        last = _next_inside(mesh, cell, px, py, pz, reach * reach, slack, passed, last, near)
        if last < 0:
            return CUT
        passed = near[3]
        if passed == 0.0:
            return EMPTY
        state = clip(cell, near[0], near[1], near[2], math.sqrt(passed) - shift, MESH_WALL, 0.0)
        if state > CUT:
            return state
    return EMPTY


@bare_kernel
def _next_inside(mesh, cell, px, py, pz, best, slack, passed, last, near):  # type: ignore[no-untyped-def]
    """Return the nearest triangle that is not yet cut off, after triangle `last` at the squared distance `passed`.

    Write the direction of its nearest point and the squared distance of that; -1 where there is none within the square
    root of `best`.
    """
    found, feature = -1, 0
    mesh.stack[0], depth, leaves = 0, 1, len(mesh.low) // 2
    while depth > 0:
        depth -= 1
        node = mesh.stack[depth]
        if square_to_box(mesh.low, mesh.high, node, px, py, pz) > best:
            continue
        if node < leaves:
            mesh.stack[depth], mesh.stack[depth + 1] = 2 * node + 1, 2 * node + 2
            depth += 2
            continue
        for t in range(mesh.start[node, 0], mesh.start[node, 1]):
            x, y, z, part = closest_on_triangle(mesh.corners, t, px, py, pz)
            x, y, z = x - px, y - py, z - pz
            square = x * x + y * y + z * z
            # those at one distance come in the order of their numbers
            comes = square > passed or (square == passed and t > last)
            nearer = square < best or (square == best and (found < 0 or t < found))
            if comes and nearer and not _is_cut_off(cell, mesh, t, px, py, pz, slack):
                best, found, feature = square, t, part
                near[0], near[1], near[2] = x, y, z
    if found >= 0:
        away = math.sqrt(best)
        for c in range(3):
            # at a face its own normal, which rounding leaves as it is
            near[c] = mesh.normals[found, 0, c] if feature == 0 else near[c] / max(away, 1e-300)
        near[3] = best
    return found


@bare_kernel
def _is_cut_off(cell, mesh, t, px, py, pz, slack):  # type: ignore[no-untyped-def]
    """Return whether a triangle lies beyond one of the planes."""
    for f in range(cell.count[1]):
        beyond = True
        for k in range(3):
            x, y, z = mesh.corners[t, k, 0] - px, mesh.corners[t, k, 1] - py, mesh.corners[t, k, 2] - pz
            side = cell.plane[f, 0] * x + cell.plane[f, 1] * y + cell.plane[f, 2] * z - cell.plane[f, 3]
            beyond = beyond and side >= -slack
        if beyond:
            return True
    return False
