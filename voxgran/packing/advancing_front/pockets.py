"""Pockets: all positions near a sphere at which another one touches three spheres or walls and overlaps none.

They are found with a sphere of one radius for all sizes; which grain fits is decided when the pocket is visited.
"""

import math
from typing import NamedTuple

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import MESH, ROUND, UPRIGHT, KernelContainer
from voxgran.geometry.level_grid import LevelGrid, cells_near, first_in_cell, image_shift
from voxgran.geometry.vectors import add, row_of, sub
from voxgran.packing.advancing_front.container import is_inside, is_near_mesh
from voxgran.packing.advancing_front.front import (
    MISSED,
    MISSING,
    PLACED,
    RANKED,
    SIZE,
    Front,
    FrontRules,
    Spheres,
    attempt_once,
    push,
    rank,
)
from voxgran.packing.advancing_front.mesh_pockets import WALL, place_in
from voxgran.packing.advancing_front.sphere_cells import BITS, HERE
from voxgran.packing.advancing_front.tangent_spheres import ABOVE, BENEATH, PLANE, SIDE, foot_of_spheres

#: overlap that is ignored here, in radii: the visit decides
LENIENT = 1e-9
#: what is missing for the next step: capacity of the front, of neighbours or of pockets, or time for further spheres
FRONT_SHORT, NEAR_SHORT, FOUND_SHORT, MORE_TO_RANK = 1, 2, 3, 4
#: largest number of spheres whose pockets are listed at a time
RANKS = 64
#: largest number of faces that an attempt adds
FACES = 3


class Scratch(NamedTuple):
    """Work arrays for one sphere: its neighbours and the pockets found among them.

    ref: sphere and image of each neighbour, -1 if it is an obstacle only.  near: its center from the sphere, its
    radius, and the distance of its surface from the center of the sphere.  key, touched: pockets as in the front.
    """

    ref: Integers
    near: Floats
    key: Floats
    touched: Integers


class Search(NamedTuple):
    """What the search for pockets beside one sphere reads and writes; `many` is the number of its neighbours."""

    spheres: Floats
    walls: KernelContainer
    rules: FrontRules
    scratch: Scratch
    sphere: int
    many: int


@bare_kernel
def advance_front(
    packed: Spheres,
    front: Front,
    cells: LevelGrid,
    walls: KernelContainer,
    rules: FrontRules,
    scratch: Scratch,
    tally: Integers,
    key: Integers,
    done: int,
    last: int,
) -> int:
    """Make attempts up to the last one; return the number of attempts made.

    The loop ends early when all grains are placed, when too many seeds have failed, or if an array is too short, which
    the entry MISSING of `tally` states.
    """
    while True:
        tally[MISSING] = 0
        listed = 0
        while tally[RANKED] < tally[PLACED]:
            if listed == RANKS:
                tally[MISSING] = MORE_TO_RANK
                return done
            if not _list_pockets(packed, front, cells, walls, rules, scratch, tally, tally[RANKED]):
                return done
            listed += 1
        if done >= last or tally[PLACED] == len(packed.order) or tally[MISSED] >= rules.patience:
            return done
        if tally[SIZE] + FACES > len(front.key):
            tally[MISSING] = FRONT_SHORT
            return done
        attempt_once(packed, front, cells, walls, rules, tally, key, done)
        done += 1


@bare_kernel
def _list_pockets(packed, front, cells, walls, rules, scratch, tally, sphere):  # type: ignore[no-untyped-def]
    """Add the pockets between a sphere, previous ones and walls to the front; return whether the arrays sufficed."""
    many = _gather(packed.spheres, cells, walls, rules.pocket, scratch, sphere)
    if many > len(scratch.ref):
        tally[MISSING] = NEAR_SHORT
        return False
    search = Search(packed.spheres, walls, rules, scratch, sphere, many)
    pockets = _at_walls(search, _between_spheres(search))
    if pockets > len(scratch.key):
        tally[MISSING] = FOUND_SHORT
        return False
    if tally[SIZE] + pockets > len(front.key):
        tally[MISSING] = FRONT_SHORT
        return False
    for k in range(pockets):
        push(front, tally, scratch.key[k], scratch.touched[k, 0], scratch.touched[k, 1], scratch.touched[k, 2])
    tally[RANKED] += 1
    return True


@bare_kernel
def _gather(spheres, cells, walls, pocket, scratch, sphere):  # type: ignore[no-untyped-def]
    """Write all spheres that could touch or overlap one in a pocket; return their number, even beyond the capacity.

    Those placed before the sphere have their index and image, all others -1: they are obstacles only.
    """
    many = 0
    x, y, z, r = spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2], spheres[sphere, 3]
    for level in range(len(cells.first)):
        reach = r + cells.reach[level, 0] + 2.0 * pocket
        low, high = cells_near(cells, level, x, y, z, (reach, reach, reach))
        for i in range(low[0], high[0]):
            for j in range(low[1], high[1]):
                for k in range(low[2], high[2]):
                    other, ti, tj, tk = first_in_cell(cells, level, i, j, k)
                    # cells that repeat along an axis that is not periodic are the same cells
                    tx, ty, tz = ti * walls.periodic[0], tj * walls.periodic[1], tk * walls.periodic[2]
                    image, partner = HERE + tx + 3 * ty + 9 * tz, max(abs(tx), abs(ty), abs(tz)) <= 1
                    while other >= 0:
                        dx, dy, dz = sub(add(row_of(spheres, other), image_shift(cells, ti, tj, tk)), (x, y, z))
                        apart = r + spheres[other, 3] + 2.0 * pocket
                        square = dx * dx + dy * dy + dz * dz
                        if square < apart * apart and (other != sphere or image != HERE):
                            if many < len(scratch.ref):
                                ref = (other << BITS) + image if partner and other <= sphere else -1
                                _sort_in(scratch, many, ref, dx, dy, dz, spheres[other, 3], math.sqrt(square))
                            many += 1
                        other = cells.after[other]
    return many


@bare_kernel
def _sort_in(scratch, many, ref, x, y, z, r, away):  # type: ignore[no-untyped-def]
    """Insert a neighbour by the distance of its surface: near ones exclude most pockets."""
    at = many
    while at > 0 and scratch.near[at - 1, 4] > away - r:
        scratch.ref[at] = scratch.ref[at - 1]
        for k in range(5):
            scratch.near[at, k] = scratch.near[at - 1, k]
        at -= 1
    scratch.ref[at] = ref
    scratch.near[at, 0], scratch.near[at, 1], scratch.near[at, 2], scratch.near[at, 3] = x, y, z, r
    scratch.near[at, 4] = away - r


@bare_kernel
def _between_spheres(search):  # type: ignore[no-untyped-def]
    """Write the pockets between a sphere and two others; return their number, even beyond the capacity."""
    spheres, scratch, sphere, many = search.spheres, search.scratch, search.sphere, search.many
    count, pocket, near, in_the_way = 0, search.rules.pocket, scratch.near, 0
    if search.walls.dimension == 2:
        return 0
    d1 = spheres[sphere, 3] + pocket
    for u in range(many):
        if scratch.ref[u] < 0:
            continue
        ux, uy, uz, d2 = near[u, 0], near[u, 1], near[u, 2], near[u, 3] + pocket
        for v in range(u):
            vx, vy, vz, d3 = near[v, 0], near[v, 1], near[v, 2], near[v, 3] + pocket
            if scratch.ref[v] < 0 or (ux - vx) ** 2 + (uy - vy) ** 2 + (uz - vz) ** 2 >= (d2 + d3) ** 2:
                continue
            touch, x, y, z, hx, hy, hz = foot_of_spheres(ux, uy, uz, vx, vy, vz, d1, d2, d3)
            if not touch:
                continue
            for side in range(2):
                if side == 1:
                    hx, hy, hz = -hx, -hy, -hz
                blocked = _blocked(near, many, u, v, x + hx, y + hy, z + hz, pocket, in_the_way)
                if blocked >= 0:
                    in_the_way = blocked
                    continue
                place = spheres[sphere, 0] + x + hx, spheres[sphere, 1] + y + hy, spheres[sphere, 2] + z + hz
                b, c = (scratch.ref[u], scratch.ref[v]) if side == 0 else (scratch.ref[v], scratch.ref[u])
                count = _note(search, ((sphere << BITS) + HERE, b, c), place, count)
    return count


@bare_kernel
def _at_walls(search, count):  # type: ignore[no-untyped-def]
    """Write the pockets between a sphere, walls, and another sphere or none; return the number of all pockets.

    Faces of a loose front are between spheres: there the plane of disks is the only wall.
    """
    spheres, walls, rules, sphere = search.spheres, search.walls, search.rules, search.sphere
    here = (sphere << BITS) + HERE
    if walls.kind == MESH:
        if walls.dimension == 2:
            count = _at_wall(search, PLANE, count)
        reach = spheres[sphere, 3] + 2.0 * rules.pocket
        if rules.dense and is_near_mesh(walls, spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2], reach):
            if walls.dimension == 3:
                return _at_wall(search, WALL, count)
            count = _try_at(search, here, WALL, PLANE, -1, count)
            count = _try_at(search, here, PLANE, WALL, -1, count)
        return count
    low, high = (SIDE, 0) if rules.dense else (PLANE, PLANE + 1)
    if walls.kind == ROUND:
        # the wall of a spherical container is a sphere of negative radius: the last row
        wall = (len(spheres) - 1 << BITS) + HERE
        dx, dy, dz = (
            spheres[sphere, 0] - walls.radius,
            spheres[sphere, 1] - walls.radius,
            spheres[sphere, 2] - walls.radius,
        )
        near = walls.radius - math.sqrt(dx * dx + dy * dy + dz * dz) < spheres[sphere, 3] + 2.0 * rules.pocket
        return _at_wall(search, wall, count) if near and rules.dense else count
    for wall in range(low, high):
        if not _is_wall_near(search, wall):
            continue
        # disks lie in their plane: it is one of the three
        if walls.dimension == 3 or wall == PLANE:
            count = _at_wall(search, wall, count)
        for second in range(low, high):
            if walls.dimension == 2 and PLANE not in (wall, second):
                continue
            if second != wall and _is_wall_near(search, second):
                count = _try_at(search, here, wall, second, -1, count)
    if (
        walls.kind == UPRIGHT
        and rules.dense
        and 2.0 * (walls.radius - rules.pocket) <= spheres[sphere, 3] + rules.pocket
    ):
        # in such a narrow tube no two spheres fit beside each other
        count = _try_at(search, here, SIDE, ABOVE, -1, count)
        count = _try_at(search, here, SIDE, BENEATH, -1, count)
    return count


@bare_kernel
def _at_wall(search, wall, count):  # type: ignore[no-untyped-def]
    """Write the pockets between a sphere, each other one and a wall; return the number of all pockets."""
    here, ref = (search.sphere << BITS) + HERE, search.scratch.ref
    for u in range(search.many):
        if ref[u] >= 0:
            count = _try_at(search, here, ref[u], wall, u, count)
            count = _try_at(search, ref[u], here, wall, u, count)
    return count


@bare_kernel
def _try_at(search, a, b, c, u, count):  # type: ignore[no-untyped-def]
    """Write a pocket at a wall, if there is one that no neighbour but u touches; return the number of all pockets."""
    spheres, sphere, pocket = search.spheres, search.sphere, search.rules.pocket
    touch, x, y, z = place_in(spheres, search.walls, a, b, c, pocket)
    dx, dy, dz = x - spheres[sphere, 0], y - spheres[sphere, 1], z - spheres[sphere, 2]
    if not touch or _blocked(search.scratch.near, search.many, u, u, dx, dy, dz, pocket, 0) >= 0:
        return count
    return _note(search, (a, b, c), (x, y, z), count)


@bare_kernel
def _is_wall_near(search, wall):  # type: ignore[no-untyped-def]
    """Return whether a sphere in a pocket of another could touch a wall; disks are always in their plane."""
    spheres, walls, sphere = search.spheres, search.walls, search.sphere
    if wall == PLANE:
        return walls.dimension == 2
    reach = spheres[sphere, 3] + 2.0 * search.rules.pocket
    if wall == SIDE:
        out = math.hypot(spheres[sphere, 0] - walls.radius, spheres[sphere, 1] - walls.radius)
        return walls.kind == UPRIGHT and walls.radius - out < reach
    axis, high = (-1 - wall) // 2, (-1 - wall) % 2
    # the bottom and the top of a cylinder are flat
    if walls.walled[axis] == 0 or walls.kind == MESH or (walls.kind == UPRIGHT and axis != 2):
        return False
    at = spheres[sphere, axis]
    return (walls.lengths[axis] - at if high else at) < reach


@bare_kernel
def _blocked(near, many, u, v, x, y, z, pocket, first):  # type: ignore[no-untyped-def]
    """Return a neighbour that a sphere would overlap, testing `first` before all others; -1 if there is none."""
    for k in range(-1, many):
        w = first if k < 0 else k
        if w in (u, v) or w >= many:
            continue
        apart = (pocket + near[w, 3]) - LENIENT * pocket
        if (x - near[w, 0]) ** 2 + (y - near[w, 1]) ** 2 + (z - near[w, 2]) ** 2 < apart * apart:
            return w
    return -1


@bare_kernel
def _note(search, touched, place, count):  # type: ignore[no-untyped-def]
    """Write a pocket, if no wall excludes it; return the number of all pockets."""
    rules, scratch = search.rules, search.scratch
    if not is_inside(search.walls, *place, rules.pocket * (1.0 - LENIENT)):
        return count
    if count < len(scratch.key):
        scratch.key[count] = rank(search.walls, rules, *place)
        scratch.touched[count, 0], scratch.touched[count, 1], scratch.touched[count, 2] = touched
    return count + 1
