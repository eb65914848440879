"""Neighbours of a grain in cells, periodic images included, and the test of contact with each."""

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, inlined_kernel
from voxgran.packing.control_point.pair_cache import PAIR, WAY, PairCache, claim_row, row_of_pair
from voxgran.packing.control_point.point_contact import cached_answer_by_points, overlaps_by_points
from voxgran.packing.control_point.records import (
    IS_SPHERE,
    KEEP_OUT,
    LIMIT,
    RADIUS,
    STRETCH,
    Bodies,
    Cells,
    GrainPoses,
    Scratch,
    WalkRules,
    Walls,
)
from voxgran.packing.control_point.sdf_contact import cached_answer_by_sdf, overlaps_by_sdf
from voxgran.packing.control_point.separating_planes import TRIES, find_plane
from voxgran.packing.control_point.verlet_lists import list_close, strayed

#: more than rounding does to the distance of two spheres that touch, in median diameters
EXACT = 1e-12


@inlined_kernel
def meets_own_image(
    grains: GrainPoses, bodies: Bodies, cells: Cells, walls: Walls, rules: WalkRules, cache: PairCache,
    scratch: Scratch, g: int, moved: float,
) -> bool:  # fmt: skip
    """Return whether a grain meets one of its periodic images; there is none to look at in a wide container."""
    reach = grains.extent[g, RADIUS] + cells.reach
    nx, ny, nz = _images(walls, 0, reach), _images(walls, 1, reach), _images(walls, 2, reach)
    for ix in range(-nx, nx + 1):
        for iy in range(-ny, ny + 1):
            for iz in range(-nz, nz + 1):
                if ix != 0 or iy != 0 or iz != 0:
                    dx = ix * (walls.upper[0] - walls.lower[0])
                    dy = iy * (walls.upper[1] - walls.lower[1])
                    dz = iz * (walls.upper[2] - walls.lower[2])
                    if overlaps(grains, bodies, bodies.contact, cache, scratch, g, g, rules.gap, dx, dy, dz, moved):
                        return True
    return False


@bare_kernel
def _images(walls, axis, reach):  # type: ignore[no-untyped-def]
    """Return how many images along an axis, to each side, are within reach."""
    if walls.periodic[axis] == 0:
        return 0
    return np.int64(np.floor(reach / (walls.upper[axis] - walls.lower[axis])))


@inlined_kernel
def meets_any(
    grains: GrainPoses, bodies: Bodies, cells: Cells, walls: Walls, rules: WalkRules, cache: PairCache,
    scratch: Scratch, g: int, moved: float,
) -> bool:  # fmt: skip
    """Return whether a grain meets another: first from the cache, then by comparing the others."""
    pending, position = scratch.pending, grains.position
    trees, fields, reaches = bodies.trees, bodies.fields, bodies.reaches
    lists, slip, close = cells.lists, cells.lists.slip, 0
    if len(lists.near) > 0 and lists.state[0] == 0:
        close = strayed(lists.anchor, g, scratch.place, walls.lower, walls.upper, walls.periodic) <= slip * slip
    if close:
        count = list_close(
            *(lists.near, lists.many, position, walls.lower, walls.upper, walls.periodic, scratch.place, g, pending)
        )
    else:
        count = list_in_cells(
            *(position, cells.head, cells.after, cells.lower, cells.width, cells.count, walls.lower, walls.upper),
            *(walls.periodic, scratch.place, g, cells.reach + grains.extent[g, RADIUS], pending),
        )
    count = _sift(
        *(position, grains.orientation, grains.diameter, grains.extent, grains.span, grains.shape, walls.lower),
        *(walls.upper, cache.pairs, cache.poses, cache.lists, trees.points, fields.head, fields.rows, fields.values),
        *(reaches.values, scratch.place, scratch.turn, scratch.span, scratch.way, scratch.relative, scratch.shift),
        *(pending, count, g, rules.gap, moved, bodies.contact),
    )
    for k in range(count):
        j = pending[k, 0]
        dx, dy, dz = _offset(position, walls.lower, walls.upper, scratch.place, pending, k)
        if overlaps(grains, bodies, bodies.contact, cache, scratch, g, j, rules.gap, dx, dy, dz, moved):
            return True
    return count < 0


@inlined_kernel
def overlaps(
    grains: GrainPoses, bodies: Bodies, contact: int | None, cache: PairCache, scratch: Scratch, g: int, j: int,
    gap: float, dx: float, dy: float, dz: float, moved: float,
) -> bool:  # fmt: skip
    """Return whether two grains overlap by the test of contact, `bodies.contact`."""
    if contact is None:
        return overlaps_by_sdf(grains, bodies, cache, scratch, g, j, gap, dx, dy, dz, moved)
    return overlaps_by_points(grains, bodies, cache, scratch, g, j, gap, dx, dy, dz, moved)


@bare_kernel
def list_in_cells(
    position: Floats, head: Integers, after: Integers, origin: Floats, width: Floats, cells: Integers, lower: Floats,
    upper: Floats, periodic: Integers, place: Floats, g: int, reach: float, pending: Integers,
) -> int:  # fmt: skip
    """List the neighbours of a grain within a reach, periodic images included, and return how many there are."""
    found = 0
    ax, bx = _cell_range(origin[0], width[0], cells[0], periodic[0], place[0], reach)
    ay, by = _cell_range(origin[1], width[1], cells[1], periodic[1], place[1], reach)
    az, bz = _cell_range(origin[2], width[2], cells[2], periodic[2], place[2], reach)
    for cx in range(ax, bx + 1):
        ix = 0 if 0 <= cx < cells[0] else cx // cells[0]
        x = place[0] - ix * (upper[0] - lower[0])
        for cy in range(ay, by + 1):
            iy = 0 if 0 <= cy < cells[1] else cy // cells[1]
            y = place[1] - iy * (upper[1] - lower[1])
            for cz in range(az, bz + 1):
                iz = 0 if 0 <= cz < cells[2] else cz // cells[2]
                z = place[2] - iz * (upper[2] - lower[2])
                j = head[((cx - ix * cells[0]) * cells[1] + cy - iy * cells[1]) * cells[2] + cz - iz * cells[2]]
                while j >= 0:
                    dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
                    if j != g and dx * dx + dy * dy + dz * dz <= reach * reach:
                        pending[found, 0], pending[found, 1], pending[found, 2], pending[found, 3] = j, ix, iy, iz
                        found += 1
                    j = after[j]
    return found


@inlined_kernel
def _offset(position, lower, upper, place, pending, k):  # type: ignore[no-untyped-def]
    """Return the way from the center of a listed neighbour, in its image, to a place."""
    j = pending[k, 0]
    return (
        place[0] - position[j, 0] - pending[k, 1] * (upper[0] - lower[0]),
        place[1] - position[j, 1] - pending[k, 2] * (upper[1] - lower[1]),
        place[2] - position[j, 2] - pending[k, 3] * (upper[2] - lower[2]),
    )


@inlined_kernel
def _sift(  # type: ignore[no-untyped-def]
    position, orientation, diameter, extent, span, shape, lower, upper, pairs, poses, lists, points, field_head,
    field_rows, field_values, reaches, place, turn, own_span, way, relative, shift, pending, count, g, gap, moved,
    contact,
):  # fmt: skip
    """Filter the neighbours to those that need a full test; return how many, -1 if an overlap is already certain."""
    found = 0
    for k in range(count):
        j = pending[k, 0]
        dx, dy, dz = _offset(position, lower, upper, place, pending, k)
        if extent[g, IS_SPHERE] * extent[j, IS_SPHERE] > 0.0:
            apart = extent[g, RADIUS] + extent[j, RADIUS] + gap - EXACT
            if dx * dx + dy * dy + dz * dz < apart * apart:
                return -1
            continue
        own, other = extent[g, KEEP_OUT], extent[j, KEEP_OUT]
        low = gap + (max(own, other) if contact is None else own + other)
        near = extent[g, RADIUS] + extent[j, RADIUS] + low
        if dx * dx + dy * dy + dz * dz > near * near:
            continue
        answer = _cached_answer(
            *(orientation, diameter, extent, span, shape, pairs, poses, lists, points, field_head),
            *(field_rows, field_values, reaches, turn, own_span, way, relative, shift, g, j, gap, low),
            *(dx, dy, dz, moved, contact),
        )
        if answer == 1:
            return -1
        if answer == 2:
            for m in range(4):
                pending[found, m] = pending[k, m]
            found += 1
    return found


@inlined_kernel
def _cached_answer(  # type: ignore[no-untyped-def]
    orientation, diameter, extent, span, shape, pairs, poses, lists, points, field_head, field_rows, field_values,
    reaches, turn, own_span, way, relative, shift, g, j, gap, low, dx, dy, dz, moved, contact,
):  # fmt: skip
    """Return whether a grain meets another, 0 no, 1 yes, 2 unknown, from planes between them and from the cache."""
    # fields near edges may tell less than distances, and not any distance
    wide = low * max(extent[g, STRETCH], extent[j, STRETCH]) if low > 0.0 else low
    # a plane does not tell how deep the cores of grains that may overlap lie in each other
    planes = len(reaches) > 0 and low <= extent[g, LIMIT] and low <= extent[j, LIMIT] and gap >= 0.0
    pair = min(g, j) * len(diameter) + max(g, j)
    row, side = row_of_pair(len(pairs), pair), 1.0 if g < j else -1.0
    if planes:
        if dx + own_span[0] > span[j, 1] + wide or dx + own_span[1] < span[j, 0] - wide:
            return 0
        if dy + own_span[2] > span[j, 3] + wide or dy + own_span[3] < span[j, 2] - wide:
            return 0
        if dz + own_span[4] > span[j, 5] + wide or dz + own_span[5] < span[j, 4] - wide:
            return 0
        way[0], way[1], way[2] = side * poses[row, WAY], side * poses[row, WAY + 1], side * poses[row, WAY + 2]
        if pairs[row, PAIR] != pair or (way[0] == 0.0 and way[1] == 0.0 and way[2] == 0.0):
            apart = max(np.sqrt(dx * dx + dy * dy + dz * dz), 1e-300)
            way[0], way[1], way[2] = dx / apart, dy / apart, dz / apart
        way[6] = -np.inf
        if find_plane(
            *(reaches, shape[g], diameter[g], turn, shape[j], diameter[j], orientation[j], way, dx, dy, dz, wide, 1)
        ):
            return 0
    if contact is None:
        answer = cached_answer_by_sdf(
            *(orientation, diameter, extent, shape, pairs, poses, points, field_head, field_rows, field_values),
            *(turn, relative, shift, g, j, gap, dx, dy, dz),
        )
    else:
        answer = cached_answer_by_points(
            *(orientation, diameter, extent, pairs, poses, lists, points, turn, relative, shift, g, j, gap),
            *(dx, dy, dz, moved),
        )
    if answer == 2 and planes:
        found = find_plane(
            *(reaches, shape[g], diameter[g], turn, shape[j], diameter[j], orientation[j], way, dx, dy, dz, wide),
            TRIES,
        )
        claim_row(pairs, poses, pair)
        poses[row, WAY], poses[row, WAY + 1], poses[row, WAY + 2] = side * way[3], side * way[4], side * way[5]
        return 0 if found else 2
    return answer


@bare_kernel
def _cell_range(origin, width, cells, periodic, x, reach):  # type: ignore[no-untyped-def]
    """Return the first and last cell that a reach touches along an axis; beyond the ends only where it is periodic."""
    first = np.int64(np.floor((x - reach - origin) / width))
    last = np.int64(np.floor((x + reach - origin) / width))
    if periodic == 0:
        return min(max(first, 0), cells - 1), max(min(last, cells - 1), 0)
    return first, last
