"""Spheres that are dropped one after the other, each to the best of some places."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers, Words
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.seeds import philox_block, unit_float
from voxgran.containers.kernel_container import MESH, ROUND, UPRIGHT, is_held, mesh_distance
from voxgran.geometry.level_grid import link_at
from voxgran.packing.deposition.field import WAY, Field, Motion
from voxgran.packing.deposition.meetings import STILL, first_sphere
from voxgran.packing.deposition.paths import fall

#: attempts in a row that find no place, after which the container is full
PATIENCE = 200
#: what is counted: spheres placed, attempts in a row without a place, and drops that came to no rest
PLACED, MISSED, LOST, TALLIES = range(4)
#: length in radii up to which a sphere may reach beyond the wall of a mesh
ROUNDING = 1e-10
#: lines that are tried to find room in a mesh, or below an inlet
TRIES = 100
#: number of a draw beyond those of all drops
APART = 2**32


class Tops(NamedTuple):
    """Columns with the height of the highest sphere in each, from which a sphere begins to fall.

    count: (2,) columns along the axes across the pull.  width: (2,) of a column.  height: (columns,).  extent: (1,)
    distance of the farthest surface from the target.
    """

    count: Integers  # type: ignore[assignment]
    width: Floats
    height: Floats
    extent: Floats


@kernel
def drop_spheres(
    field: Field, tops: Tops, radius: Floats, level: Integers, drops: int, sticking: float, key: Words,
    tally: Integers, done: int, last: int,
) -> int:  # fmt: skip
    """Make attempts up to number `last`, and return the number after the last one that was made.

    Each drops the next sphere `drops` times and keeps the lowest place, or the nearest to the target.
    """
    place, lowest = np.zeros(3), np.zeros(3)
    while done < last and tally[PLACED] < len(radius) and tally[MISSED] < PATIENCE:
        n, r, best = tally[PLACED], radius[tally[PLACED]], math.inf
        word = philox_block(key[0], key[1], np.uint64(done), np.uint64(APART))[0]
        sticks, flown = unit_float(word) < sticking, False
        for k in range(drops):
            words = philox_block(key[0], key[1], np.uint64(done), np.uint64(k))
            u, v, w = unit_float(words[0]), unit_float(words[1]), unit_float(words[2])
            if field.central:
                _aim(field, tops.extent[0], r, u, v, w, unit_float(words[3]), place)
                met = fall(field, place, r, sticks, True) if n > 0 else 1
                flown = flown or met == 0
            else:
                free = _lift(field, tops, r, u, v, w, place)
                for again in range(1, TRIES if free < 0 else 0):
                    # the line may not be below the inlet, or lead through no room of a mesh
                    words = philox_block(key[0], key[1], np.uint64(done), np.uint64(k + again * APART * 2))
                    u, v, w = unit_float(words[0]), unit_float(words[1]), unit_float(words[2])
                    free = _lift(field, tops, r, u, v, w, place)
                    if free >= 0:
                        break
                met = fall(field, place, r, sticks, False) if free > 0 else 0
            if met < 0:
                tally[LOST] += 1
            if met > 0 and _fits(field, place, r):
                depth = _depth(field, place)
                if depth < best:
                    best = depth
                    lowest[0], lowest[1], lowest[2] = place[0], place[1], place[2]
        if best < math.inf:
            _put(field, tops, n, r, level[n], lowest)
            tally[PLACED] += 1
            tally[MISSED] = 0
        elif not flown:
            tally[MISSED] += 1
        done += 1
    return done


@bare_kernel
def _lift(field, tops, r, u, v, w, place):  # type: ignore[no-untyped-def]
    """Write a random place above all spheres that may be in the way; return 1, or 0 where it is taken.

    It may be taken where a round wall or that of a mesh is above. Return -1 where a vertical line is not below the
    inlet, or has no room in a mesh; where it has several, w is the share of the height near which one is chosen.
    """
    across = 3 - field.up
    place[0], place[1], place[2] = 0.0, 0.0, 0.0
    highest, ceiling = 0.0, math.inf
    if field.walls.kind == UPRIGHT or field.walls.kind == ROUND:
        highest, ceiling = _within_round(field, r, u, v, place)
    else:
        for axis, share in ((0, u), (across, v)):
            if field.lengths[axis] > 0.0:
                inset = r if field.flat[axis] == 1 else 0.0
                place[axis] = inset + share * (field.lengths[axis] - 2.0 * inset)
    if not _is_below_inlet(field, r, place):
        return -1
    if field.walls.kind == MESH:
        highest, ceiling = _within_mesh(field, r, w, place)
        if ceiling == math.inf:
            return -1
    i, j = int(place[0] / tops.width[0]), int(place[across] / tops.width[1])
    for di in range(-1, 2):
        for dj in range(-1, 2):
            # beyond a wall there is another column of this container, which does no harm
            column = (i + di) % tops.count[0] * tops.count[1] + (j + dj) % tops.count[1]
            highest = max(highest, tops.height[column])
    place[field.up] = min(highest + 1.001 * r, ceiling)
    if place[field.up] < ceiling:
        return 1
    still = Motion(STILL, place, r, 0, 0.0)
    return int(first_sphere(field, still, (place[0], place[1], place[2]), r, 0.0)[4] == 0.0)


@bare_kernel
def _is_below_inlet(field, r, place):  # type: ignore[no-untyped-def]
    """Return whether a vertical line through a place is below the inlet, if there is one, as far as the sphere goes."""
    a, b, half_a, half_b, is_disk = field.inlet
    away_a, away_b = abs(place[0] - a), abs(place[3 - field.up] - b)
    if is_disk == 1.0:
        return math.hypot(away_a, away_b) <= half_a - r
    return away_a <= half_a - r and away_b <= half_b - r


@bare_kernel
def _within_round(field, r, u, v, place):  # type: ignore[no-untyped-def]
    """Write a random place across the pull within a round wall, and return two heights: one that is inside at any such
    place, and the greatest one of a center there.
    """
    walls = field.walls
    room, middle = walls.radius - r, walls.middle
    if field.up == 1:
        offset = room * (2.0 * v - 1.0)
        place[0] = middle[0] + offset
    else:
        offset, turn = room * math.sqrt(v), 2.0 * math.pi * u
        place[0], place[1] = middle[0] + offset * math.cos(turn), middle[1] + offset * math.sin(turn)
        if walls.kind == UPRIGHT:
            return 0.0, math.inf
    return middle[field.up], middle[field.up] + math.sqrt(max(room * room - offset * offset, 0.0))


@bare_kernel
def _within_mesh(field, r, w, place):  # type: ignore[no-untyped-def]
    """Return two heights between which a vertical line has room in a mesh, near a share w of its height.

    Infinite where it has none. Distances from the walls say how far each step may go.
    """
    up, least = field.up, 0.02 * r
    top = field.lengths[up]
    begin = w * top
    for direction in (-1.0, 1.0):
        place[up] = begin
        room = _room(field, r, place)
        while room < 0.0 and 0.0 < place[up] < top:
            place[up] += direction * max(-room, least)
            room = _room(field, r, place)
        if room >= 0.0:
            low = place[up]
            high = low
            while room >= 0.0:
                high = place[up]
                place[up] += max(room, least)
                room = _room(field, r, place)
            return low, high
    return math.inf, math.inf


@bare_kernel
def _room(field, r, place):  # type: ignore[no-untyped-def]
    """Return how much farther than its radius the wall of a mesh is from the center of a sphere."""
    return -mesh_distance(field.walls.mesh, place[0], place[1], place[2]) - r


@bare_kernel
def _aim(field, extent, r, u, v, w, t, place):  # type: ignore[no-untyped-def]
    """Write a random place outside of all spheres, and a way that leads toward them; the target for the first sphere.

    Ways are uniform among all lines that meet a sphere about the target.
    """
    way, target, far = field.vectors[WAY], field.target, extent + 2.0 * r
    if extent == 0.0:
        place[0], place[1], place[2] = target[0], target[1], target[2]
        return
    if field.up == 1:
        angle, offset = 2.0 * math.pi * u, (extent + r) * (2.0 * v - 1.0)
        way[0], way[1], way[2] = math.cos(angle), math.sin(angle), 0.0
        place[0] = target[0] - far * way[0] - offset * way[1]
        place[1] = target[1] - far * way[1] + offset * way[0]
        place[2] = target[2]
        return
    angle, z, turn, offset = 2.0 * math.pi * u, 2.0 * v - 1.0, 2.0 * math.pi * w, (extent + r) * math.sqrt(t)
    flat = math.sqrt(1.0 - z * z)
    cx, cy = math.cos(angle), math.sin(angle)
    way[0], way[1], way[2] = flat * cx, flat * cy, z
    # two axes across the way
    a, b = offset * math.cos(turn), offset * math.sin(turn)
    place[0] = target[0] - far * way[0] - a * cy - b * z * cx
    place[1] = target[1] - far * way[1] + a * cx - b * z * cy
    place[2] = target[2] - far * way[2] + b * flat


@bare_kernel
def _fits(field, place, r):  # type: ignore[no-untyped-def]
    """Bring a place into the periodic lengths, and return whether the container holds a sphere there."""
    for axis in range(3):
        span = field.cells.span[axis]
        if span > 0.0:
            place[axis] -= math.floor(place[axis] / span) * span
    if field.walls.kind == MESH and not field.central:
        return _room(field, r, place) >= -ROUNDING * r
    return is_held(field.walls, place[0], place[1], place[2], r, r, r)


@bare_kernel
def _depth(field, place):  # type: ignore[no-untyped-def]
    """Return the height of a place, or its distance from the target."""
    return _far_of(field, place) if field.central else place[field.up]


@bare_kernel
def _put(field, tops, n, r, level, place):  # type: ignore[no-untyped-def]
    """Place sphere n."""
    field.spheres[n, 0], field.spheres[n, 1], field.spheres[n, 2], field.spheres[n, 3] = place[0], place[1], place[2], r
    link_at(field.cells, n, level, place[0], place[1], place[2])
    tops.extent[0] = max(tops.extent[0], _far_of(field, place) + r)
    column = _column(field, tops, place)
    tops.height[column] = max(tops.height[column], place[field.up] + r)


@bare_kernel
def _far_of(field, place):  # type: ignore[no-untyped-def]
    """Return the distance of a place from the target."""
    square = 0.0
    for axis in range(3):
        square += (place[axis] - field.target[axis]) ** 2
    return math.sqrt(square)


@bare_kernel
def _column(field, tops, place):  # type: ignore[no-untyped-def]
    """Return the column of a place."""
    i, j = int(place[0] / tops.width[0]), int(place[3 - field.up] / tops.width[1])
    return min(i, tops.count[0] - 1) * tops.count[1] + min(j, tops.count[1] - 1)


@kernel
def put_again(field: Field, tops: Tops, level: NDArray[np.int64], count: int) -> None:
    """Link the first `count` spheres, as if they had just been placed."""
    place = np.zeros(3)
    for n in range(count):
        for axis in range(3):
            place[axis] = field.spheres[n, axis]
        _put(field, tops, n, field.spheres[n, 3], level[n], place)
