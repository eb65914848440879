"""The largest place of a shape in a convex cell.

In a given orientation a shape lies within planes ``n . x <= b`` if ``n . c + s h(n) <= b`` for each, with its centroid
c, its size s and its support function h: the largest size follows from a linear programme in c and s (simplex method).
A search over orientations tries some at random, and then turns the best one by random angles that become smaller after
failures and larger after successes (a 1+1 evolution strategy). A round wall adds planes at the points that reach beyond
it until none does.
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers, Words
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.seeds import philox_block, unit_float
from voxgran.containers.kernel_container import ROUND, UPRIGHT
from voxgran.geometry.polyhedron import CROWDED, CUT, volume_and_center
from voxgran.packing.tessellation.voronoi_bodies import farthest_from_axis, reach_along
from voxgran.packing.tessellation.voronoi_cells import Tessellation, build_cell

#: share of the orientations that are random, first angle of the others, and its factors after a success and a failure
RANDOM, FIRST_ANGLE, WIDER, NARROWER = 0.25, 0.6, 1.6, 0.87
#: size of numbers that are rounding in the simplex method, and most pivots per plane
ROUNDING, PIVOTS = 1e-12, 20
#: planes at a round wall, at most, and the protrusion up to which they are added, in sizes of the cell
AT_WALL, PROTRUSION = 25, 1e-9
#: margin that keeps shapes apart whatever the rounding
MARGIN = 1e-11


class Programme(NamedTuple):
    """Work space of a linear programme.

    plane: (m, 4) unit normals and offsets, from the centroid of the cell.  table: (m + 1, 6), the objective in the last
    row.  row: (m,) which variable a row has, -1 for the slack of a plane.  column: (5,) the same for columns.  found:
    (4,) place and size.  turn: (9,) rotation matrix.  trial: (4,) its quaternion.  way: (6,) two points or directions.
    """

    plane: Floats
    table: Floats
    row: Integers
    column: Integers
    found: Floats
    turn: Floats
    trial: Floats
    way: Floats


def empty_programme(planes: int) -> Programme:
    """Return work space for so many planes."""
    room = planes + AT_WALL + 1
    whole = np.int64
    return Programme(
        *(np.zeros((room, 4)), np.zeros((room + 1, 6)), np.zeros(room, whole), np.zeros(5, whole)),
        *(np.zeros(4), np.zeros(9), np.zeros(4), np.zeros(6)),
    )


class Places(NamedTuple):
    """Where grains fit: centroids from their seeds, (n, 3), quaternions, (n, 4), and diameters, (n,)."""

    arm: Floats
    turn: Floats
    size: Floats


@kernel
def fit_shapes(
    tessellation: Tessellation, work: Programme, places: Places, around: bool, most: Floats, tries: int, key: Words,
    first: int, last: int,
) -> int:  # fmt: skip
    """Write the largest place of each grain in its cell, or in the room `around` it.

    The arrays hold earlier places, than which a place must be larger. No grain gets larger than `most`. With 0 `tries`
    grains keep their orientations. Return
    the number after the last grain; less than `last` where the work space is too small for a cell.
    """
    walls, cell, shapes = tessellation.walls, tessellation.cell, tessellation.poses.shape_id
    middle, best, turn, size = np.zeros(3), np.zeros(4), places.turn, places.size
    for i in range(first, last):
        if size[i] >= most[i]:
            continue
        state = build_cell(tessellation, i, around)
        if state == CROWDED or cell.count[1] + AT_WALL >= len(work.plane):
            return i
        if state != CUT or volume_and_center(cell, middle) <= 0.0:
            continue
        if walls.dimension == 2:
            middle[2] = 0.0
        planes = _planes_of(walls, cell, work, middle)
        shape, fitted = shapes[i], size[i] > 0.0 or tries == 0
        once = tessellation.bodies.round[shape] == 1 or tries == 0
        angle = FIRST_ANGLE
        for c in range(4):
            best[c] = turn[i, c]
        for k in range(1 if once else tries):
            if fitted and k == 0:
                for c in range(4):
                    work.trial[c] = best[c]
            else:
                random = not fitted and k < RANDOM * tries
                angle = _draw_turn(work.trial, best, walls.dimension, random, once, angle, key, i, k)
            _place(tessellation.seeds.place[i], middle, walls, work, tessellation.bodies, shape, planes)
            if work.found[3] > size[i]:
                size[i] = min(work.found[3], most[i])
                for c in range(3):
                    places.arm[i, c] = middle[c] + work.found[c]
                for c in range(4):
                    turn[i, c] = best[c] = work.trial[c]
                angle *= WIDER / NARROWER
            if size[i] >= most[i]:
                break
    return last


@bare_kernel
def _planes_of(walls, cell, work, middle):  # type: ignore[no-untyped-def]
    """Write the planes of the cell, from its centroid; return their number."""
    planes = 0
    for f in range(cell.count[1]):
        if walls.dimension == 2 and (cell.owner[f] == -5 or cell.owner[f] == -6):
            continue
        inner = 0.0
        for c in range(3):
            work.plane[planes, c] = cell.plane[f, c]
            inner += cell.plane[f, c] * middle[c]
        work.plane[planes, 3] = cell.plane[f, 3] - inner
        planes += 1
    return planes


@bare_kernel
def _draw_turn(trial, best, dimension, random, upright, angle, key, i, k):  # type: ignore[no-untyped-def]
    """Write the orientation of try k of grain i; return the angle of the next one, should this one fail."""
    trial[0], trial[1], trial[2], trial[3] = 1.0, 0.0, 0.0, 0.0
    if upright:
        return angle
    words = philox_block(key[0], key[1], np.uint64(i), np.uint64(k))
    u, v, w = unit_float(words[0]), unit_float(words[1]), unit_float(words[2])
    if random and dimension == 2:
        trial[0], trial[3] = math.cos(math.pi * u), math.sin(math.pi * u)
        return angle
    if random:
        # uniform over all rotations (Shoemake 1992, in Graphics Gems III, page 124)
        p, q = math.sqrt(1.0 - u), math.sqrt(u)
        trial[0], trial[1] = p * math.sin(2.0 * math.pi * v), p * math.cos(2.0 * math.pi * v)
        trial[2], trial[3] = q * math.sin(2.0 * math.pi * w), q * math.cos(2.0 * math.pi * w)
        return angle
    flat = 0.0 if dimension == 2 else angle
    a, b, c = flat * (u - 0.5), flat * (v - 0.5), angle * (w - 0.5)
    s = 1.0 / math.sqrt(1.0 + a * a + b * b + c * c)
    o, x, y, z = best[0], best[1], best[2], best[3]
    trial[0] = s * (o - a * x - b * y - c * z)
    trial[1] = s * (x + a * o + b * z - c * y)
    trial[2] = s * (y - a * z + b * o + c * x)
    trial[3] = s * (z + a * y - b * x + c * o)
    return angle * NARROWER


@bare_kernel
def _place(seed, middle, walls, work, bodies, s, planes):  # type: ignore[no-untyped-def]
    """Write place and size of shape s at the orientation `trial`, within the planes and a round wall."""
    o, x, y, z = work.trial[0], work.trial[1], work.trial[2], work.trial[3]
    turn = work.turn
    turn[0], turn[1], turn[2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - o * z), 2.0 * (x * z + o * y)
    turn[3], turn[4], turn[5] = 2.0 * (x * y + o * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - o * x)
    turn[6], turn[7], turn[8] = 2.0 * (x * z - o * y), 2.0 * (y * z + o * x), 1.0 - 2.0 * (x * x + y * y)
    found = work.found
    _solve(work, bodies, s, planes, walls.dimension)
    if walls.kind in (UPRIGHT, ROUND):
        axes = 3 if walls.kind == ROUND else 2
        ox, oy = seed[0] + middle[0] - walls.middle[0], seed[1] + middle[1] - walls.middle[1]
        oz = seed[2] + middle[2] - walls.middle[2]
        for k in range(AT_WALL):
            far = farthest_from_axis(
                bodies, s, turn, found[3], ox + found[0], oy + found[1], oz + found[2], axes, work.way
            )
            if far <= walls.radius + PROTRUSION * found[3]:
                break
            row = work.plane[planes + k]
            row[0], row[1], row[2] = work.way[0], work.way[1], work.way[2] if axes == 3 else 0.0
            row[3] = walls.radius - row[0] * ox - row[1] * oy - row[2] * oz
            _solve(work, bodies, s, planes + k + 1, walls.dimension)
        _draw_back(walls, work, bodies, s, ox, oy, oz, axes)
    found[3] *= 1.0 - MARGIN


@bare_kernel
def _draw_back(walls, work, bodies, s, ox, oy, oz, axes):  # type: ignore[no-untyped-def]
    """Make the shape smaller where it still reaches beyond a round wall; the reach is convex in the size."""
    found = work.found
    x, y, z = ox + found[0], oy + found[1], oz + found[2] if axes == 3 else 0.0
    core = math.sqrt(x * x + y * y + z * z)
    far = farthest_from_axis(bodies, s, work.turn, found[3], x, y, oz + found[2], axes, work.way)
    if core >= walls.radius:
        found[3] = 0.0
    elif far > walls.radius:
        found[3] *= (walls.radius - core) / (far - core)


@bare_kernel
def _solve(work, bodies, s, planes, dimension):  # type: ignore[no-untyped-def]
    """Write the place and the size of the largest shape within the planes, by the simplex method.

    The centroid of the cell with size 0 is within all planes, from where the method starts. Columns have the variables
    that are 0, rows those that are not: at first those of place and size, and the slacks of the planes.
    """
    table, row, column, found = work.table, work.row, work.column, work.found
    columns = dimension + 1
    for k in range(planes):
        x, y, z = work.plane[k, 0], work.plane[k, 1], work.plane[k, 2]
        for c in range(dimension):
            table[k, c] = work.plane[k, c]
        table[k, dimension] = reach_along(bodies, s, work.turn, x, y, z, work.way)
        table[k, columns], row[k] = max(work.plane[k, 3], 0.0), -1
    for c in range(columns):
        column[c], table[planes, c], found[c] = c, 0.0, 0.0
    table[planes, dimension], table[planes, columns] = 1.0, 0.0
    found[3] = 0.0
    for _ in range(PIVOTS * planes):
        j = _entering(table, column, planes, columns)
        if j < 0:
            break
        sense = 1.0 if table[planes, j] > 0.0 else -1.0
        i = _leaving(table, row, planes, columns, j, sense)
        if i < 0:
            break
        _pivot(table, row, column, planes, columns, i, j)
    for k in range(planes):
        if row[k] >= 0:
            found[3 if row[k] == dimension else row[k]] = table[k, columns]
    if dimension == 2:
        found[2] = 0.0
    # what rounding has left: the size that these planes allow at this place
    size = math.inf
    for k in range(planes):
        room = work.plane[k, 3]
        for c in range(dimension):
            room -= work.plane[k, c] * found[c]
        reach = reach_along(bodies, s, work.turn, work.plane[k, 0], work.plane[k, 1], work.plane[k, 2], work.way)
        size = min(size, room / max(reach, 1e-300))
    found[3] = max(size, 0.0) if math.isfinite(size) else 0.0


@bare_kernel
def _entering(table, column, planes, columns):  # type: ignore[no-untyped-def]
    """Return the column whose variable increases the size the most, -1 for none; a slack may only increase."""
    best, most = -1, ROUNDING
    for j in range(columns):
        rate = abs(table[planes, j]) if column[j] >= 0 else table[planes, j]
        if rate > most:
            best, most = j, rate
    return best


@bare_kernel
def _leaving(table, row, planes, columns, j, sense):  # type: ignore[no-untyped-def]
    """Return the row of the slack that becomes 0 first, -1 for none."""
    best, least, largest = -1, math.inf, 0.0
    for k in range(planes):
        rate = sense * table[k, j]
        if row[k] < 0 and rate > ROUNDING:
            ratio = table[k, columns] / rate
            if ratio < least or (ratio == least and rate > largest):
                best, least, largest = k, ratio, rate
    return best


@bare_kernel
def _pivot(table, row, column, planes, columns, i, j):  # type: ignore[no-untyped-def]
    """Exchange the variables of a row and a column."""
    share = 1.0 / table[i, j]
    for c in range(columns + 1):
        table[i, c] = share if c == j else table[i, c] * share
    for k in range(planes + 1):
        if k != i:
            factor = table[k, j]
            if factor != 0.0:
                for c in range(columns + 1):
                    table[k, c] = -factor * share if c == j else table[k, c] - factor * table[i, c]
    row[i], column[j] = column[j], row[i]
