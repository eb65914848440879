"""The path of one sphere that falls among others: lines and arcs of circles, from contact to contact.

A sphere falls along a line until it touches another or a wall. It then follows the steepest descent, by lines along
walls, great circles on one sphere and circles about two, until it touches something else, leaves what it rolls on, or
rests on contacts that leave no way down. Each event is a root in closed form, so that paths are exact to rounding. A
round wall is a sphere that is touched from inside; along the wall of a cylinder the way is no circle (`tube`). The pull
points down an axis, or to a point.

One move is along a line, on a circle about one or two contacts, or along the wall of a cylinder. It ends at the next
event: a contact with a sphere or a wall, the lowest point of the way, or the point at which a contact no longer
presses. On lines and circles all are roots of ``a t^2 + b t = c`` or ``a cos(t) + b sin(t) = c``.

References
----------
Visscher & Bolsterli 1972, Random packing of equal and unequal spheres in two and three dimensions, Nature 239, 504-507,
doi:10.1038/239504a0.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import MESH
from voxgran.geometry.vectors import row_of
from voxgran.packing.deposition.facets import (
    ROUND_WALL,
    TUBE_WALL,
    end_on_facets,
    first_facet,
    still_touched,
    touch_facet,
    touch_round,
    wall_on_circle,
    wall_on_line,
)
from voxgran.packing.deposition.field import (
    CENTER,
    FIRST,
    KIND,
    MIDDLE,
    PULL,
    REACH,
    SECOND,
    SLIGHT,
    TUBE,
    WAY,
    WIDTH,
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

#: largest number of events on a path, and on one in a mesh, whose edges are passed in small steps
MOST_EVENTS = 400, 4000
#: squares of directions below this leave no way
TINY = 1e-14


@bare_kernel
def fall(field: Field, place: Floats, r: float, sticks: bool, flies: bool) -> int:
    """Move a sphere of radius r from `place`, (3,), to where it rests, or first touches something if it `sticks`.

    flies: whether it first moves along ``vectors[WAY]`` instead of along the pull. Return 1 where it stays, 0 where it
    touches nothing, and -1 where it has found no place to rest after so many events.
    """
    touching, most = 0, MOST_EVENTS[1] if field.walls.kind == MESH else MOST_EVENTS[0]
    for event in range(most):
        kept = 0
        if event > 0 or not flies:
            kept = _choose_way(field, place, touching)
        if kept < 0:
            return 1
        found = _move(field, place, r, kept)
        if found < 0:
            return 0
        touching = kept + found
        if field.walls.kind == MESH:
            touching = still_touched(field, place, r, touching)
        if sticks and touching > 0:
            return 1
    return -1


@bare_kernel
def _move(field, place, r, kept):  # type: ignore[no-untyped-def]
    """Move to the next event; return 1 where that is a contact, 0 else, and -1 where nothing ends the line."""
    contacts = field.contacts
    on_spheres = (kept > 0 and contacts[0, REACH] != 0.0) or (kept > 1 and contacts[1, REACH] != 0.0)
    if not on_spheres:
        return move_straight(field, place, r, kept)
    if kept == 2 and (contacts[0, KIND] == TUBE or contacts[1, KIND] == TUBE):
        return move_along_tube(field, place, r)
    return move_round(field, place, r, kept)


@bare_kernel
def _choose_way(field, place, touching):  # type: ignore[no-untyped-def]
    """Write the direction of steepest descent that the contacts leave, and return how many contacts are kept.

    These become the first ones; -1 if there is no way.
    """
    contacts, vectors = field.contacts, field.vectors
    _pull(field, place)
    if touching == 0:
        copy_row(vectors, PULL, WAY, 1.0)
        return 0
    best, one, two = TINY, -1, -1
    for a in range(-1, touching):
        for b in range(a if a < 0 else a + 1, touching):
            gain = _project(contacts, vectors, a, b)
            # a contact that presses by rounding alone is not kept
            if gain > best * (1.0 + SLIGHT) and _is_free(contacts, vectors, touching, math.sqrt(gain)):
                best, one, two = gain, a, b
                copy_row(vectors, SECOND, WAY, math.sqrt(gain))
    if best == TINY:
        return -1
    if two < 0:
        return 0
    if one < 0:
        _swap(contacts, 0, two)
        return 1
    _swap(contacts, 0, one)
    _swap(contacts, 1, two)
    return 2


@bare_kernel
def _pull(field, place):  # type: ignore[no-untyped-def]
    """Write the unit vector of the pull."""
    vectors = field.vectors
    vectors[PULL, 0], vectors[PULL, 1], vectors[PULL, 2] = pull_from(field, place[0], place[1], place[2])
    far = math.sqrt(vectors[PULL, 0] ** 2 + vectors[PULL, 1] ** 2 + vectors[PULL, 2] ** 2)
    copy_row(vectors, PULL, PULL, far if far > 0.0 else 1.0)


@bare_kernel
def _project(contacts, vectors, a, b):  # type: ignore[no-untyped-def]
    """Write the part of the pull that contacts a and b, -1 for none, leave; return its square."""
    pull, rest = vectors[PULL], vectors[SECOND]
    if b < 0:
        rest[0], rest[1], rest[2] = pull[0], pull[1], pull[2]
    elif a < 0:
        along = pull[0] * contacts[b, 0] + pull[1] * contacts[b, 1] + pull[2] * contacts[b, 2]
        for axis in range(3):
            rest[axis] = pull[axis] - along * contacts[b, axis]
    else:
        x = contacts[a, 1] * contacts[b, 2] - contacts[a, 2] * contacts[b, 1]
        y = contacts[a, 2] * contacts[b, 0] - contacts[a, 0] * contacts[b, 2]
        z = contacts[a, 0] * contacts[b, 1] - contacts[a, 1] * contacts[b, 0]
        square = x * x + y * y + z * z
        along = (pull[0] * x + pull[1] * y + pull[2] * z) / square if square > TINY else 0.0
        rest[0], rest[1], rest[2] = along * x, along * y, along * z
    return rest[0] * rest[0] + rest[1] * rest[1] + rest[2] * rest[2]


@bare_kernel
def _is_free(contacts, vectors, touching, length):  # type: ignore[no-untyped-def]
    """Return whether a way leads into no contact."""
    rest = vectors[SECOND]
    for k in range(touching):
        if rest[0] * contacts[k, 0] + rest[1] * contacts[k, 1] + rest[2] * contacts[k, 2] < -0.1 * SLIGHT * length:
            return False
    return True


@bare_kernel
def _swap(contacts, i, j):  # type: ignore[no-untyped-def]
    """Exchange two contacts."""
    for column in range(WIDTH):
        contacts[i, column], contacts[j, column] = contacts[j, column], contacts[i, column]


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
