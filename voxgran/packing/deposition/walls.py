"""The walls that a sphere touches on a line or a circle: plane ones, and round ones from inside."""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import ROUND, UPRIGHT
from voxgran.packing.deposition.field import FIRST, MIDDLE, REACH, SECOND, SLIGHT, WAY, Field, touch_sphere
from voxgran.packing.deposition.meetings import first_root, meet_on_circle
from voxgran.packing.deposition.tube import tube_on_circle

#: numbers of walls beside those across the axes: none, around a point, around an axis
NO_WALL, ROUND_WALL, TUBE_WALL = -1, 3, 4


@bare_kernel
def is_round(field: Field) -> bool:
    """Return whether there is a wall around a point; that of a disk is one as well."""
    return field.walls.kind == ROUND or (field.walls.kind == UPRIGHT and field.up == 1)


@bare_kernel
def touch_round(field: Field, place: Floats, r: float, row: int) -> None:
    """Write a contact with the wall around a point."""
    middle = field.walls.middle
    touch_sphere(field, place, row, middle[0], middle[1], middle[2], r - field.walls.radius)


@bare_kernel
def wall_on_line(field: Field, place: Floats, r: float) -> tuple[float, int, float]:
    """Return how far the first wall is, its number and the sign of its normal; `NO_WALL` where nothing ends the line.

    Toward the center there are no walls, and the line ends beyond the center.
    """
    way = field.vectors[WAY]
    if field.central:
        far = 0.0
        for axis in range(3):
            far += (place[axis] - field.target[axis]) ** 2
        return 2.0 * math.sqrt(far), NO_WALL, 0.0
    end, wall, side = math.inf, NO_WALL, 0.0
    for axis in range(3):
        if field.flat[axis] == 1 and abs(way[axis]) > SLIGHT:
            goal = r if way[axis] < 0.0 else field.lengths[axis] - r
            away = max((goal - place[axis]) / way[axis], 0.0)
            if away < end:
                end, wall, side = away, axis, 1.0 if way[axis] < 0.0 else -1.0
    if is_round(field):
        along, room, middle = 0.0, (field.walls.radius - r) ** 2, field.walls.middle
        for axis in range(3):
            along += way[axis] * (place[axis] - middle[axis])
            room -= (place[axis] - middle[axis]) ** 2
        # of the two forms of the root that without a difference
        root = math.sqrt(max(along * along + room, 0.0))
        away = room / (root + along) if along > 0.0 else root - along
        end, wall = max(away, 0.0), ROUND_WALL
    return end, wall, side


@bare_kernel
def wall_on_circle(field: Field, r: float, kept: int, radius: float, end: float) -> tuple[float, int, float]:
    """Return the angle up to `end` at which the sphere touches a wall, its number, and the sign of its normal."""
    vectors, contacts, best, wall, side = field.vectors, field.contacts, end, NO_WALL, 0.0
    if field.central:
        return best, wall, side
    for axis in range(3):
        if field.flat[axis] == 0:
            continue
        for sign in (-1.0, 1.0):
            # toward the upper wall along an axis for 1
            known = False
            for k in range(kept):
                known = known or (contacts[k, REACH] == 0.0 and contacts[k, axis] == -sign)
            if known:
                continue
            a, b = sign * radius * vectors[FIRST, axis], sign * radius * vectors[SECOND, axis]
            limit = field.lengths[axis] - r if sign > 0.0 else -r
            c = limit - sign * vectors[MIDDLE, axis]
            angle = first_root(a, b, c, SLIGHT * r)
            if angle <= best:
                best, wall, side = angle, axis, -sign
    if is_round(field):
        middle = field.walls.middle
        angle = meet_on_circle(field, kept, radius, middle[0], middle[1], middle[2], r - field.walls.radius)
        if angle <= best:
            best, wall = angle, ROUND_WALL
    elif field.walls.kind == UPRIGHT:
        angle = tube_on_circle(field, r, radius, best)
        if angle <= best:
            best, wall = angle, TUBE_WALL
    return best, wall, side
