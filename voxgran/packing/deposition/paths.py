"""The path of one sphere that falls among others: lines and arcs of circles, from contact to contact.

A sphere falls along a line until it touches another or a wall. It then follows the steepest descent, by lines along
walls, great circles on one sphere and circles about two, until it touches something else, leaves what it rolls on, or
rests on contacts that leave no way down. Each event is a root in closed form, so that paths are exact to rounding. A
round wall is a sphere that is touched from inside; along the wall of a cylinder the way is no circle (`tube`). The pull
points down an axis, or to a point.

References
----------
Visscher & Bolsterli 1972, Random packing of equal and unequal spheres in two and three dimensions, Nature 239, 504-507,
doi:10.1038/239504a0.
"""

import math

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import MESH
from voxgran.packing.deposition.facets import still_touched
from voxgran.packing.deposition.field import (
    KIND,
    PULL,
    REACH,
    SECOND,
    SLIGHT,
    TUBE,
    WAY,
    WIDTH,
    Field,
    copy_row,
    pull_from,
)
from voxgran.packing.deposition.moves import move_along_tube, move_round, move_straight

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
