"""One move of a sphere: along a line, or on a circle about one or two contacts, to the next event.

An event is a contact with a sphere or a wall, the lowest point of a circle, or the point at which a contact no longer
presses. All are roots of ``a t^2 + b t = c`` or ``a cos(t) + b sin(t) = c``.
"""

import math
from typing import NamedTuple

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.packing.level_grid import LevelGrid, cells_near

#: relative lengths and angles below this are rounding
SLIGHT = 1e-9
#: columns of a contact: normal toward the moving sphere, center of the other sphere, and sum of the radii, 0 for a wall
CENTER, REACH, WIDTH = 3, 6, 7
#: rows of the work space, beside the contacts: direction of motion, pull, middle of a circle and its two axes
WAY, PULL, MIDDLE, FIRST, SECOND, ROWS = range(6)


class Field(NamedTuple):
    """What a sphere moves in, in coordinates from the lower corner of the container.

    spheres: (n, 4) centers and radii.  lengths: of the bounds.  walled: axes with walls on both sides, as 0 or 1.
    up: the axis against the pull.  central: whether the pull is to `target` instead, without walls.
    contacts: (3, WIDTH) and vectors: (ROWS, 3) work space.
    """

    spheres: Floats
    cells: LevelGrid
    lengths: Floats
    walled: Integers
    up: int
    central: bool
    target: Floats
    contacts: Floats
    vectors: Floats


@bare_kernel
def copy_row(vectors: Floats, one: int, other: int, divisor: float) -> None:
    """Write a row over a number into another row."""
    for axis in range(3):
        vectors[other, axis] = vectors[one, axis] / divisor


@bare_kernel
def move_straight(field: Field, place: Floats, r: float, kept: int) -> int:
    """Move along a line to the first contact; return 1, or -1 where there is none."""
    way, lengths = field.vectors[WAY], field.lengths
    end, wall, side = _end_of_line(field, place, r)
    section = r + field.cells.reach[0, 0]
    begin, best, x, y, z, reach = 0.0, math.inf, 0.0, 0.0, 0.0, 0.0
    while begin < end and best == math.inf:
        last = min(begin + section, end)
        best, x, y, z, reach = _first_on_line(field, place, r, begin, last)
        begin = last
    if best == math.inf and wall < 0:
        return -1
    move = min(best, end)
    for axis in range(3):
        place[axis] += move * way[axis]
    for k in range(kept):
        _turn_normal(field, place, k)
    if best < math.inf:
        _touch(field, place, kept, x, y, z, reach)
    else:
        place[wall] = r if side > 0.0 else lengths[wall] - r
        _touch_wall(field, kept, wall, side)
    return 1


@bare_kernel
def _end_of_line(field, place, r):  # type: ignore[no-untyped-def]
    """Return how far the first wall is, its axis and the sign of its normal; no axis where nothing ends the line."""
    way = field.vectors[WAY]
    if field.central:
        far = 0.0
        for axis in range(3):
            far += (place[axis] - field.target[axis]) ** 2
        return 2.0 * math.sqrt(far), -1, 0.0
    end, wall, side = math.inf, -1, 0.0
    for axis in range(3):
        if field.walled[axis] == 1 and abs(way[axis]) > SLIGHT:
            goal = r if way[axis] < 0.0 else field.lengths[axis] - r
            away = max((goal - place[axis]) / way[axis], 0.0)
            if away < end:
                end, wall, side = away, axis, 1.0 if way[axis] < 0.0 else -1.0
    return end, wall, side


@bare_kernel
def _first_on_line(field, place, r, begin, last):  # type: ignore[no-untyped-def]
    """Return the distance to the first sphere on a section of the line, infinite for none, its center and the sum of
    the radii.
    """
    way, cells, at = field.vectors[WAY], field.cells, 0.5 * (begin + last)
    px, py, pz = place[0] + at * way[0], place[1] + at * way[1], place[2] + at * way[2]
    best, bx, by, bz, both = math.inf, 0.0, 0.0, 0.0, 0.0
    for level in range(len(cells.count)):
        far = at - begin + r + cells.reach[level, 0]
        i0, i1 = cells_near(cells, level, 0, px, far)
        j0, j1 = cells_near(cells, level, 1, py, far)
        k0, k1 = cells_near(cells, level, 2, pz, far)
        ni, nj, nk = cells.count[level, 0], cells.count[level, 1], cells.count[level, 2]
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    ti, tj, tk = i // ni, j // nj, k // nk
                    cell = ((i - ti * ni) * nj + j - tj * nj) * nk + k - tk * nk
                    g = cells.head[cells.first[level] + cell]
                    while g >= 0:
                        x = field.spheres[g, 0] + ti * cells.span[0]
                        y = field.spheres[g, 1] + tj * cells.span[1]
                        z = field.spheres[g, 2] + tk * cells.span[2]
                        reach = r + field.spheres[g, 3]
                        t = _meet_on_line(place, way, x, y, z, reach)
                        if t < best and t <= last:
                            best, bx, by, bz, both = t, x, y, z, reach
                        g = cells.after[g]
    return best, bx, by, bz, both


@bare_kernel
def _meet_on_line(place, way, x, y, z, reach):  # type: ignore[no-untyped-def]
    """Return how far along the line the distance from a center is `reach`, infinite where the line leads away."""
    dx, dy, dz = place[0] - x, place[1] - y, place[2] - z
    along = dx * way[0] + dy * way[1] + dz * way[2]
    if along > -SLIGHT * reach:
        return math.inf
    beyond = dx * dx + dy * dy + dz * dz - reach * reach
    square = along * along - beyond
    if square <= 0.0:
        return math.inf
    # the difference of the two is exact where the sphere touches already
    return max(beyond / (math.sqrt(square) - along), 0.0)


@bare_kernel
def move_round(field: Field, place: Floats, r: float, kept: int) -> int:
    """Move about one or two contacts to the next event; return 1 where that is a contact, 0 else."""
    vectors = field.vectors
    radius = _lay_circle(field, place, kept)
    end = _end_of_circle(field, kept, radius)
    angle, x, y, z, reach = _first_on_circle(field, place, r, kept, radius, end)
    turned, wall, side = _wall_on_circle(field, r, kept, radius, min(angle, end))
    angle = min(angle, end, turned)
    for axis in range(3):
        step = math.cos(angle) * vectors[FIRST, axis] + math.sin(angle) * vectors[SECOND, axis]
        place[axis] = vectors[MIDDLE, axis] + radius * step
    for k in range(kept):
        _turn_normal(field, place, k)
    if wall >= 0:
        _touch_wall(field, kept, wall, side)
        return 1
    if reach > 0.0:
        _touch(field, place, kept, x, y, z, reach)
        return 1
    return 0


@bare_kernel
def _lay_circle(field, place, kept):  # type: ignore[no-untyped-def]
    """Write the middle of the circle on which the center moves and its axes, toward it and ahead; return its radius."""
    contacts, vectors = field.contacts, field.vectors
    middle, first, second = vectors[MIDDLE], vectors[FIRST], vectors[SECOND]
    sphere = 0 if contacts[0, REACH] > 0.0 else 1
    for axis in range(3):
        middle[axis] = contacts[sphere, CENTER + axis]
    if kept == 2:
        other = 1 - sphere
        # the axis of the circle: from center to center, or normal to the wall
        length, along = 0.0, 0.0
        for axis in range(3):
            first[axis] = contacts[other, axis]
            if contacts[other, REACH] > 0.0:
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
def _first_root(a, b, c, slight):  # type: ignore[no-untyped-def]
    """Return the first angle from 0 at which ``a cos + b sin`` reaches c from below, infinite where it does not.

    Differences up to `slight` are rounding: what is at c there has reached it if it grows.
    """
    size = math.hypot(a, b)
    if a > c - slight:
        if abs(b) <= slight:
            return math.inf if a > 0.0 else 0.0
        # it falls first, and comes back as far beyond its lowest value as that is away
        return 0.0 if b > 0.0 else 2.0 * (math.atan2(b, a) + math.pi)
    if size <= abs(c):
        return math.inf
    angle = math.atan2(b, a) - math.acos(c / size)
    return angle + 2.0 * math.pi if angle < 0.0 else angle


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
        end = min(end, _first_root(a, b, c, 0.0))
    return end


@bare_kernel
def pull_from(field: Field, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the pull at a place, of any length."""
    if field.central:
        return field.target[0] - x, field.target[1] - y, field.target[2] - z
    return 0.0, -1.0 if field.up == 1 else 0.0, -1.0 if field.up == 2 else 0.0


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


@bare_kernel
def _first_on_circle(field, place, r, kept, radius, end):  # type: ignore[no-untyped-def]
    """Return the first angle at which the sphere touches another one, infinite for none, its center and the sum of the
    radii.
    """
    cells, middle = field.cells, field.vectors[MIDDLE]
    best, bx, by, bz, both = end, 0.0, 0.0, 0.0, 0.0
    for level in range(len(cells.count)):
        far = radius + r + cells.reach[level, 0]
        i0, i1 = cells_near(cells, level, 0, middle[0], far)
        j0, j1 = cells_near(cells, level, 1, middle[1], far)
        k0, k1 = cells_near(cells, level, 2, middle[2], far)
        ni, nj, nk = cells.count[level, 0], cells.count[level, 1], cells.count[level, 2]
        for i in range(i0, i1 + 1):
            for j in range(j0, j1 + 1):
                for k in range(k0, k1 + 1):
                    ti, tj, tk = i // ni, j // nj, k // nk
                    cell = ((i - ti * ni) * nj + j - tj * nj) * nk + k - tk * nk
                    g = cells.head[cells.first[level] + cell]
                    while g >= 0:
                        x = field.spheres[g, 0] + ti * cells.span[0]
                        y = field.spheres[g, 1] + tj * cells.span[1]
                        z = field.spheres[g, 2] + tk * cells.span[2]
                        reach = r + field.spheres[g, 3]
                        angle = _meet_on_circle(field, kept, radius, x, y, z, reach)
                        if angle <= best:
                            best, bx, by, bz, both = angle, x, y, z, reach
                        g = cells.after[g]
    return best, bx, by, bz, both


@bare_kernel
def _meet_on_circle(field, kept, radius, x, y, z, reach):  # type: ignore[no-untyped-def]
    """Return the angle at which the sphere touches a center, infinite where it does not or keeps that contact."""
    contacts, vectors = field.contacts, field.vectors
    for k in range(kept):
        if x == contacts[k, CENTER] and y == contacts[k, CENTER + 1] and z == contacts[k, CENTER + 2]:
            return math.inf
    dx, dy, dz = x - vectors[MIDDLE, 0], y - vectors[MIDDLE, 1], z - vectors[MIDDLE, 2]
    far = dx * dx + dy * dy + dz * dz
    if far > (radius + reach) ** 2:
        return math.inf
    a = 2.0 * radius * (dx * vectors[FIRST, 0] + dy * vectors[FIRST, 1] + dz * vectors[FIRST, 2])
    b = 2.0 * radius * (dx * vectors[SECOND, 0] + dy * vectors[SECOND, 1] + dz * vectors[SECOND, 2])
    c = radius * radius + far - reach * reach
    return _first_root(a, b, c, SLIGHT * reach * reach)


@bare_kernel
def _wall_on_circle(field, r, kept, radius, end):  # type: ignore[no-untyped-def]
    """Return the angle up to `end` at which the sphere touches a wall, its axis, -1 for none, and the sign of its
    normal.
    """
    vectors, contacts, best, wall, side = field.vectors, field.contacts, end, -1, 0.0
    if field.central:
        return best, wall, side
    for axis in range(3):
        if field.walled[axis] == 0:
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
            angle = _first_root(a, b, c, SLIGHT * r)
            if angle <= best:
                best, wall, side = angle, axis, -sign
    return best, wall, side


@bare_kernel
def _touch(field, place, row, x, y, z, reach):  # type: ignore[no-untyped-def]
    """Write a contact with a sphere."""
    contact = field.contacts[row]
    contact[CENTER], contact[CENTER + 1], contact[CENTER + 2], contact[REACH] = x, y, z, reach
    _turn_normal(field, place, row)


@bare_kernel
def _touch_wall(field, row, axis, side):  # type: ignore[no-untyped-def]
    """Write a contact with a wall."""
    for column in range(WIDTH):
        field.contacts[row, column] = side if column == axis else 0.0


@bare_kernel
def _turn_normal(field, place, k):  # type: ignore[no-untyped-def]
    """Write the normal of a contact with a sphere at the present place."""
    contact = field.contacts[k]
    if contact[REACH] > 0.0:
        for axis in range(3):
            contact[axis] = (place[axis] - contact[CENTER + axis]) / contact[REACH]
