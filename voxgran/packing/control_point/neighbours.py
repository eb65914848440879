"""Neighbours of a grain in cells, periodic images included, and the test of contact with each."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.geometry.vectors import Vector, dot
from voxgran.packing.control_point.point_contact import HORIZON, may_hold, overlaps_by_points, still_refused_by_points
from voxgran.packing.control_point.records import (
    IS_SPHERE,
    KEEP_OUT,
    LIMIT,
    PAIR,
    RADIUS,
    SDF,
    SLACK,
    STRETCH,
    WAY,
    Cells,
    Pairs,
    Walls,
    World,
    claim_row,
    moved_since,
    row_of_pair,
)
from voxgran.packing.control_point.relative_poses import relate
from voxgran.packing.control_point.sdf_contact import overlaps_by_sdf, still_refused_by_sdf, threshold
from voxgran.packing.control_point.separating_planes import TRIES, find_plane
from voxgran.packing.control_point.verlet_lists import list_close, strayed

#: more than rounding does to the distance of two spheres that touch, in median diameters
EXACT = 1e-12
#: more than rounding does to a distance, in diameters
ROUNDING = 1e-9
#: whether two grains overlap
NO, YES, UNKNOWN = 0, 1, 2


@inlined_kernel
def meets_own_image(world: World, g: int, moved: float) -> bool:
    """Return whether a grain meets one of its periodic images; there is none to look at in a wide container."""
    walls, reach = world.walls, world.pairs.grains.extent[g, RADIUS] + world.cells.reach
    nx, ny, nz = _images(walls, 0, reach), _images(walls, 1, reach), _images(walls, 2, reach)
    for ix in range(-nx, nx + 1):
        for iy in range(-ny, ny + 1):
            for iz in range(-nz, nz + 1):
                if ix != 0 or iy != 0 or iz != 0:
                    way = (
                        ix * (walls.upper[0] - walls.lower[0]),
                        iy * (walls.upper[1] - walls.lower[1]),
                        iz * (walls.upper[2] - walls.lower[2]),
                    )
                    if overlaps(world.pairs, g, g, way, moved):
                        return True
    return False


@bare_kernel
def _images(walls, axis, reach):  # type: ignore[no-untyped-def]
    """Return how many images along an axis, to each side, are within reach."""
    if walls.periodic[axis] == 0:
        return 0
    return np.int64(np.floor(reach / (walls.upper[axis] - walls.lower[axis])))


@inlined_kernel
def meets_any(world: World, g: int, moved: float) -> bool:
    """Return whether a grain meets another: first from the cache, then by comparing the others."""
    pairs, walls, lists, close = world.pairs, world.walls, world.lists, False
    position, place, pending = pairs.grains.position, pairs.scratch.place, pairs.scratch.pending
    if len(lists.near) > 0 and lists.state[0] == 0:
        close = strayed(lists.anchor, walls, g, place) <= lists.slip * lists.slip
    if close:
        count = list_close(lists, walls, position, place, g, pending)
    else:
        reach = world.cells.reach + pairs.grains.extent[g, RADIUS]
        count = list_in_cells(world.cells, walls, position, place, g, reach, pending)
    count = _sift(pairs, walls, g, count, moved)
    for k in range(count):
        if overlaps(pairs, g, pending[k, 0], _offset(pairs, walls, k), moved):
            return True
    return count < 0


@inlined_kernel
def overlaps(pairs: Pairs, g: int, j: int, way: Vector, moved: float) -> bool:
    """Return whether two grains overlap by the test of contact, `bodies.contact`."""
    if pairs.bodies.contact == SDF:
        return overlaps_by_sdf(pairs, g, j, way, moved)
    return overlaps_by_points(pairs, g, j, way, moved)


@bare_kernel
def list_in_cells(
    cells: Cells, walls: Walls, position: Floats, place: Floats, g: int, reach: float, pending: Integers
) -> int:
    """List the neighbours of a grain within a reach, periodic images included, and return how many there are."""
    many, count, lower, upper = 0, cells.count, walls.lower, walls.upper
    ax, bx = _cell_range(cells, walls, 0, place, reach)
    ay, by = _cell_range(cells, walls, 1, place, reach)
    az, bz = _cell_range(cells, walls, 2, place, reach)
    for cx in range(ax, bx + 1):
        ix = 0 if 0 <= cx < count[0] else cx // count[0]
        x = place[0] - ix * (upper[0] - lower[0])
        for cy in range(ay, by + 1):
            iy = 0 if 0 <= cy < count[1] else cy // count[1]
            y = place[1] - iy * (upper[1] - lower[1])
            for cz in range(az, bz + 1):
                iz = 0 if 0 <= cz < count[2] else cz // count[2]
                z = place[2] - iz * (upper[2] - lower[2])
                j = cells.head[((cx - ix * count[0]) * count[1] + cy - iy * count[1]) * count[2] + cz - iz * count[2]]
                while j >= 0:
                    dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
                    if j != g and dx * dx + dy * dy + dz * dz <= reach * reach:
                        pending[many, 0], pending[many, 1], pending[many, 2], pending[many, 3] = j, ix, iy, iz
                        many += 1
                    j = cells.after[j]
    return many


@inlined_kernel
def _offset(pairs, walls, k):  # type: ignore[no-untyped-def]
    """Return the way from the center of a listed neighbour, in its image, to the place that is tried."""
    place, pending, lower, upper = pairs.scratch.place, pairs.scratch.pending, walls.lower, walls.upper
    position, j = pairs.grains.position, pending[k, 0]
    return (
        place[0] - position[j, 0] - pending[k, 1] * (upper[0] - lower[0]),
        place[1] - position[j, 1] - pending[k, 2] * (upper[1] - lower[1]),
        place[2] - position[j, 2] - pending[k, 3] * (upper[2] - lower[2]),
    )


@inlined_kernel
def _sift(pairs, walls, g, count, moved):  # type: ignore[no-untyped-def]
    """Filter the neighbours to those that need a full test; return how many, -1 if an overlap is already certain."""
    left, extent, gap, pending = 0, pairs.grains.extent, pairs.gap, pairs.scratch.pending
    for k in range(count):
        j, way = pending[k, 0], _offset(pairs, walls, k)
        if extent[g, IS_SPHERE] * extent[j, IS_SPHERE] > 0.0:
            apart = extent[g, RADIUS] + extent[j, RADIUS] + gap - EXACT
            if dot(way, way) < apart * apart:
                return -1
            continue
        own, other = extent[g, KEEP_OUT], extent[j, KEEP_OUT]
        low = gap + (max(own, other) if pairs.bodies.contact == SDF else own + other)
        near = extent[g, RADIUS] + extent[j, RADIUS] + low
        if dot(way, way) > near * near:
            continue
        answer = _answer_before_test(pairs, g, j, low, way, moved)
        if answer == YES:
            return -1
        if answer == UNKNOWN:
            for m in range(4):
                pending[left, m] = pending[k, m]
            left += 1
    return left


@inlined_kernel
def _answer_before_test(pairs, g, j, low, way, moved):  # type: ignore[no-untyped-def]
    """Return whether a grain meets another, NO, YES or UNKNOWN, from planes between them and from the cache."""
    grains, cache, reaches, extent = pairs.grains, pairs.cache, pairs.bodies.reaches, pairs.grains.extent
    # fields near edges may tell less than distances, and not any distance
    wide = low * max(extent[g, STRETCH], extent[j, STRETCH]) if low > 0.0 else low
    # a plane does not tell how deep the cores of grains that may overlap lie in each other
    planes = len(reaches.values) > 0 and low <= extent[g, LIMIT] and low <= extent[j, LIMIT] and pairs.gap >= 0.0
    pair = min(g, j) * len(grains.diameter) + max(g, j)
    row, side = row_of_pair(len(cache.pairs), pair), 1.0 if g < j else -1.0
    if planes:
        (dx, dy, dz), span, own = way, grains.span, pairs.scratch.span
        if dx + own[0] > span[j, 1] + wide or dx + own[1] < span[j, 0] - wide:
            return NO
        if dy + own[2] > span[j, 3] + wide or dy + own[3] < span[j, 2] - wide:
            return NO
        if dz + own[4] > span[j, 5] + wide or dz + own[5] < span[j, 4] - wide:
            return NO
        _write_first_direction(pairs, row, pair, side, way)
        if _are_parted(pairs, g, j, way, wide, 1):
            return NO
    answer = _answer_from_cache(pairs, g, j, row, way, moved) if cache.pairs[row, PAIR] == pair else UNKNOWN
    if answer == UNKNOWN and planes:
        parted, best = _are_parted(pairs, g, j, way, wide, TRIES), pairs.scratch.way
        claim_row(cache.pairs, cache.poses, pair)
        for k in range(3):
            cache.poses[row, WAY + k] = side * best[3 + k]
        return NO if parted else UNKNOWN
    return answer


@inlined_kernel
def _write_first_direction(pairs, row, pair, side, way):  # type: ignore[no-untyped-def]
    """Write the direction along which two grains were farthest apart, else that of their centers."""
    poses, first = pairs.cache.poses, pairs.scratch.way
    first[0], first[1], first[2] = side * poses[row, WAY], side * poses[row, WAY + 1], side * poses[row, WAY + 2]
    if pairs.cache.pairs[row, PAIR] != pair or (first[0] == 0.0 and first[1] == 0.0 and first[2] == 0.0):
        apart = max(np.sqrt(dot(way, way)), 1e-300)
        first[0], first[1], first[2] = way[0] / apart, way[1] / apart, way[2] / apart
    first[6] = -np.inf


@inlined_kernel
def _are_parted(pairs, g, j, way, wide, tries):  # type: ignore[no-untyped-def]
    """Return whether a plane that is found in some tries is between two grains."""
    grains, scratch = pairs.grains, pairs.scratch
    one, other = (
        (grains.shape[g], grains.diameter[g], scratch.turn),
        (grains.shape[j], grains.diameter[j], grains.orientation[j]),
    )
    return find_plane(pairs.bodies.reaches.values, one, other, way, wide, scratch.way, tries)


@inlined_kernel
def _answer_from_cache(pairs, g, j, row, way, moved):  # type: ignore[no-untyped-def]
    """Return whether a grain meets another from their row of the cache: what comparing them again would give."""
    a, b, grains, extent, scratch = min(g, j), max(g, j), pairs.grains, pairs.grains.extent, pairs.scratch
    relate(grains, scratch, g, j, way)
    if pairs.bodies.contact == SDF:
        if still_refused_by_sdf(pairs, row, a, b):
            return YES
        # points of b that are near a lie within its radius, the threshold and the slack, which is small
        radius = (extent[a, RADIUS] + threshold(extent, b, a, max(pairs.gap, 0.0))) / grains.diameter[a] + 2.0 * HORIZON
    else:
        if still_refused_by_points(pairs, row, a, b):
            return YES
        if may_hold(grains, a, b, moved):
            return UNKNOWN
        radius = extent[a, RADIUS] / grains.diameter[a]
    far = moved_since(pairs.cache.poses, row, scratch.relative, scratch.shift, radius)
    return NO if far + ROUNDING < pairs.cache.poses[row, SLACK] else UNKNOWN


@bare_kernel
def _cell_range(cells, walls, axis, place, reach):  # type: ignore[no-untyped-def]
    """Return the first and last cell that a reach touches along an axis; beyond the ends only where it is periodic."""
    first = np.int64(np.floor((place[axis] - reach - cells.lower[axis]) / cells.width[axis]))
    last = np.int64(np.floor((place[axis] + reach - cells.lower[axis]) / cells.width[axis]))
    if walls.periodic[axis] == 0:
        return min(max(first, 0), cells.count[axis] - 1), max(min(last, cells.count[axis] - 1), 0)
    return first, last
