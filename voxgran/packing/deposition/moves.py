"""One move of a sphere: along a line, on a circle about one or two contacts, or along the wall of a cylinder.

It ends at the next event: a contact with a sphere or a wall, the lowest point of the way, or the point at which a
contact no longer presses. On lines and circles all are roots of ``a t^2 + b t = c`` or ``a cos(t) + b sin(t) = c``.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import MESH
from voxgran.geometry.vectors import row_of
from voxgran.packing.deposition.facets import end_on_facets, first_facet, touch_facet
from voxgran.packing.deposition.field import (
    CENTER,
    FIRST,
    MIDDLE,
    REACH,
    SECOND,
    WAY,
    Field,
    Motion,
    copy_row,
    pull_from,
    touch_sphere,
    touch_wall,
    turn_normal,
)
from voxgran.packing.deposition.meetings import CIRCLE, LINE, ROUND_TUBE, first_root, first_sphere
from voxgran.packing.deposition.tube import floor_in_tube, lay_tube, put_in_tube, touch_tube
from voxgran.packing.deposition.walls import ROUND_WALL, TUBE_WALL, touch_round, wall_on_circle, wall_on_line


@bare_kernel
def move_straight(field: Field, place: Floats, r: float, kept: int) -> int:
    """Move along a line to the first contact; return 1, 0 where a triangle ends before, and -1 where there is none."""
    way, lengths = field.vectors[WAY], field.lengths
    end, wall, side = wall_on_line(field, place, r)
    motion = Motion(LINE, place, r, kept, 0.0)
    in_mesh, triangle = field.walls.kind == MESH and not field.central, -1
    if in_mesh:
        end = min(end_on_facets(field, motion), 2.0 * (lengths[0] + lengths[1] + lengths[2]))
    section = r + field.cells.reach[0, 0]
    begin, best, x, y, z, reach = 0.0, math.inf, 0.0, 0.0, 0.0, 0.0
    while begin < end and reach == 0.0 and triangle < 0:
        last = min(begin + section, end)
        at = 0.5 * (begin + last)
        middle = place[0] + at * way[0], place[1] + at * way[1], place[2] + at * way[2]
        best, x, y, z, reach = first_sphere(field, motion, middle, at - begin + r, last)
        if in_mesh:
            best, triangle = first_facet(field, motion, middle, at - begin + r, best)
        begin = last
    if reach == 0.0 and wall < 0 and not in_mesh:
        return -1
    move = best if reach > 0.0 or triangle >= 0 else end
    for axis in range(3):
        place[axis] += move * way[axis]
    for k in range(kept):
        turn_normal(field, place, k)
    if triangle >= 0:
        touch_facet(field, place, r, kept, triangle)
    elif reach > 0.0:
        touch_sphere(field, place, kept, x, y, z, reach)
    elif in_mesh:
        return 0
    elif wall == ROUND_WALL:
        touch_round(field, place, r, kept)
    else:
        place[wall] = r if side > 0.0 else lengths[wall] - r
        touch_wall(field, kept, wall, side)
    return 1


@bare_kernel
def move_round(field: Field, place: Floats, r: float, kept: int) -> int:
    """Move about one or two contacts to the next event; return 1 where that is a contact, 0 else."""
    vectors = field.vectors
    radius = _lay_circle(field, place, kept)
    motion = Motion(CIRCLE, place, r, kept, radius)
    end, middle = _end_of_circle(field, kept, radius), row_of(vectors, MIDDLE)
    in_mesh, triangle = field.walls.kind == MESH and not field.central, -1
    if in_mesh:
        end = min(end, end_on_facets(field, motion))
    angle, x, y, z, reach = first_sphere(field, motion, middle, radius + r, end)
    turned, wall, side = wall_on_circle(field, r, kept, radius, angle)
    angle = min(angle, turned)
    if in_mesh:
        around = radius + r
        if angle < 1.0:
            middle, around = (place[0], place[1], place[2]), radius * angle + r
        angle, triangle = first_facet(field, motion, middle, around, angle)
    for axis in range(3):
        step = math.cos(angle) * vectors[FIRST, axis] + math.sin(angle) * vectors[SECOND, axis]
        place[axis] = vectors[MIDDLE, axis] + radius * step
    for k in range(kept):
        turn_normal(field, place, k)
    if triangle >= 0:
        touch_facet(field, place, r, kept, triangle)
    elif wall == ROUND_WALL:
        touch_round(field, place, r, kept)
    elif wall == TUBE_WALL:
        touch_tube(field, place, kept)
    elif wall >= 0:
        touch_wall(field, kept, wall, side)
    elif reach > 0.0:
        touch_sphere(field, place, kept, x, y, z, reach)
    else:
        return 0
    return 1


@bare_kernel
def move_along_tube(field: Field, place: Floats, r: float) -> int:
    """Move along the wall of a cylinder on a sphere to the next event; return 1 where that is a contact, 0 else."""
    vectors, contacts = field.vectors, field.contacts
    end = lay_tube(field, place, r)
    sphere = 0 if contacts[0, REACH] > 0.0 else 1
    around = contacts[sphere, REACH] + r
    motion = Motion(ROUND_TUBE, place, r, 2, 0.0)
    angle, x, y, z, reach = first_sphere(field, motion, row_of(vectors, MIDDLE), around, end)
    grounded = floor_in_tube(field, r)
    angle = min(angle, grounded)
    put_in_tube(field, place, angle, angle == end and end < math.pi)
    turn_normal(field, place, sphere)
    touch_tube(field, place, 1 - sphere)
    if angle == grounded:
        place[2] = r
        touch_wall(field, 2, 2, 1.0)
        return 1
    if reach > 0.0:
        touch_sphere(field, place, 2, x, y, z, reach)
        return 1
    return 0


@bare_kernel
def _lay_circle(field, place, kept):  # type: ignore[no-untyped-def]
    """Write the middle of the circle on which the center moves and its axes, toward it and ahead; return its radius."""
    contacts, vectors = field.contacts, field.vectors
    middle, first, second = vectors[MIDDLE], vectors[FIRST], vectors[SECOND]
    sphere = 0 if contacts[0, REACH] != 0.0 else 1
    for axis in range(3):
        middle[axis] = contacts[sphere, CENTER + axis]
    if kept == 2:
        other = 1 - sphere
        # the axis of the circle: from center to center, or normal to the wall
        length, along = 0.0, 0.0
        for axis in range(3):
            first[axis] = contacts[other, axis]
            if contacts[other, REACH] != 0.0:
                first[axis] = contacts[other, CENTER + axis] - middle[axis]
            length += first[axis] * first[axis]
        for axis in range(3):
            first[axis] /= math.sqrt(length)
            along += first[axis] * (place[axis] - middle[axis])
        for axis in range(3):
            middle[axis] += along * first[axis]
    radius, ahead = 0.0, 0.0
    for axis in range(3):
        first[axis] = place[axis] - middle[axis]
        radius += first[axis] * first[axis]
    radius = math.sqrt(radius)
    for axis in range(3):
        first[axis] /= radius
        ahead += first[axis] * vectors[WAY, axis]
    length = 0.0
    for axis in range(3):
        second[axis] = vectors[WAY, axis] - ahead * first[axis]
        length += second[axis] * second[axis]
    copy_row(vectors, SECOND, SECOND, math.sqrt(length))
    return radius


@bare_kernel
def _end_of_circle(field, kept, radius):  # type: ignore[no-untyped-def]
    """Return the angle at which the sphere is lowest on its circle, or leaves a contact."""
    vectors = field.vectors
    middle, first, second = vectors[MIDDLE], vectors[FIRST], vectors[SECOND]
    gx, gy, gz = pull_from(field, middle[0], middle[1], middle[2])
    end = math.atan2(gx * second[0] + gy * second[1] + gz * second[2], gx * first[0] + gy * first[1] + gz * first[2])
    if end <= 0.0:
        end += 2.0 * math.pi
    for k in range(kept):
        vx, vy, vz, rest = _press(field, k)
        if kept == 2:
            # what the pull presses on contact k beyond what the other one takes
            contacts, other = field.contacts, 1 - k
            both = 0.0
            for axis in range(3):
                both += contacts[0, axis] * contacts[1, axis]
            ox, oy, oz, more = _press(field, other)
            vx, vy, vz, rest = vx - both * ox, vy - both * oy, vz - both * oz, rest - both * more
        a = radius * (vx * first[0] + vy * first[1] + vz * first[2])
        b = radius * (vx * second[0] + vy * second[1] + vz * second[2])
        c = -rest - vx * middle[0] - vy * middle[1] - vz * middle[2]
        end = min(end, first_root(a, b, c, 0.0))
    return end


@bare_kernel
def _press(field, k):  # type: ignore[no-untyped-def]
    """Return v and a number: the pull along the normal of contact k is their ``v . place`` and the number, where the
    sphere touches it.
    """
    contacts = field.contacts
    x, y, z, reach = contacts[k, CENTER], contacts[k, CENTER + 1], contacts[k, CENTER + 2], contacts[k, REACH]
    gx, gy, gz = pull_from(field, x, y, z)
    if reach == 0.0:
        return 0.0, 0.0, 0.0, gx * contacts[k, 0] + gy * contacts[k, 1] + gz * contacts[k, 2]
    rest = -(gx * x + gy * y + gz * z) / reach
    if field.central:
        rest -= reach
    return gx / reach, gy / reach, gz / reach, rest
