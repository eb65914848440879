"""Pockets: all places near a sphere where another one would touch three, spheres or walls, and overlap none.

They are looked for with a sphere of one radius, whatever the sizes; which grain fits is seen when the place is visited.
"""

import math
from typing import NamedTuple

from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import MESH, ROUND, UPRIGHT, KernelContainer
from voxgran.packing.advancing_front.container import is_inside, is_near_mesh
from voxgran.packing.advancing_front.front import (
    MISSED,
    MISSING,
    PLACED,
    RANKED,
    SIZE,
    Bed,
    Front,
    Rules,
    attempt_once,
    push,
    rank,
)
from voxgran.packing.advancing_front.level_grid import BITS, HERE, SphereCells, cell_range
from voxgran.packing.advancing_front.mesh_pockets import WALL, place_in
from voxgran.packing.advancing_front.tangent_spheres import ABOVE, BENEATH, PLANE, SIDE, foot_of_spheres

#: overlap that does not count here, in radii: the visit decides
LENIENT = 1e-9
#: what is missing for the next step: nothing, places in the front, neighbours, pockets, or only time for more spheres
FRONT_SHORT, NEAR_SHORT, FOUND_SHORT, MORE_TO_RANK = 1, 2, 3, 4
#: spheres whose pockets are listed at a time, at most
RANKS = 64
#: faces that an attempt adds, at most
FACES = 3


class Scratch(NamedTuple):
    """What is thought about a sphere: its neighbours and its pockets.

    ref: sphere and image of each neighbour, -1 where it is only in the way.  near: center from the sphere, radius,
    distance of the surface from the center of the sphere.  key, touched: pockets as the front has them.
    """

    ref: Integers
    near: Floats
    key: Floats
    touched: Integers


@bare_kernel
def advance_front(
    bed: Bed,
    front: Front,
    cells: SphereCells,
    room: KernelContainer,
    rules: Rules,
    scratch: Scratch,
    tally: Integers,
    key: Integers,
    done: int,
    last: int,
) -> int:
    """Make attempts up to the last one; return how many have been made.

    It stops early when all are placed, when no beginning finds room any more, or where `tally` tells what is missing.
    """
    while True:
        tally[MISSING] = 0
        listed = 0
        while tally[RANKED] < tally[PLACED]:
            if listed == RANKS:
                tally[MISSING] = MORE_TO_RANK
                return done
            if not _list_pockets(bed, front, cells, room, rules, scratch, tally, tally[RANKED]):
                return done
            listed += 1
        if done >= last or tally[PLACED] == len(bed.order) or tally[MISSED] >= rules.patience:
            return done
        if tally[SIZE] + FACES > len(front.key):
            tally[MISSING] = FRONT_SHORT
            return done
        attempt_once(bed, front, cells, room, rules, tally, key, done)
        done += 1


@bare_kernel
def _list_pockets(bed, front, cells, room, rules, scratch, tally, sphere):  # type: ignore[no-untyped-def]
    """Add the pockets between a sphere, those before it and the walls to the front; tell if there was room to do so."""
    many = _gather(bed.spheres, cells, room, rules.pocket, scratch, sphere)
    if many > len(scratch.ref):
        tally[MISSING] = NEAR_SHORT
        return False
    found = _between_spheres(bed.spheres, room, rules, scratch, sphere, many)
    found = _at_walls(bed.spheres, room, rules, scratch, sphere, many, found)
    if found > len(scratch.key):
        tally[MISSING] = FOUND_SHORT
        return False
    if tally[SIZE] + found > len(front.key):
        tally[MISSING] = FRONT_SHORT
        return False
    for k in range(found):
        push(front, tally, scratch.key[k], scratch.touched[k, 0], scratch.touched[k, 1], scratch.touched[k, 2])
    tally[RANKED] += 1
    return True


@bare_kernel
def _gather(spheres, cells, room, pocket, scratch, sphere):  # type: ignore[no-untyped-def]
    """Write all that could touch or overlap a sphere in a pocket; return how many, also where there are too many.

    Those before the sphere carry their number and image, all others -1: they are only in the way.
    """
    many = 0
    x, y, z, r = spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2], spheres[sphere, 3]
    for level in range(len(cells.largest)):
        reach = r + cells.largest[level] + 2.0 * pocket
        i0, i1 = cell_range(cells, level, 0, x, reach)
        j0, j1 = cell_range(cells, level, 1, y, reach)
        k0, k1 = cell_range(cells, level, 2, z, reach)
        ni, nj, nk = cells.count[level, 0], cells.count[level, 1], cells.count[level, 2]
        for i in range(i0, i1 + 1):
            turn_i = 0 if 0 <= i < ni else i // ni
            for j in range(j0, j1 + 1):
                turn_j = 0 if 0 <= j < nj else j // nj
                row = cells.first[level] + ((i - turn_i * ni) * nj + j - turn_j * nj) * nk
                for k in range(k0, k1 + 1):
                    turn_k = 0 if 0 <= k < nk else k // nk
                    # cells that come again on an axis that is not periodic are the same cells
                    tx, ty, tz = turn_i * room.periodic[0], turn_j * room.periodic[1], turn_k * room.periodic[2]
                    image, partner = HERE + tx + 3 * ty + 9 * tz, max(abs(tx), abs(ty), abs(tz)) <= 1
                    other = cells.head[row + k - turn_k * nk]
                    while other >= 0:
                        dx = spheres[other, 0] + turn_i * cells.span[0] - x
                        dy = spheres[other, 1] + turn_j * cells.span[1] - y
                        dz = spheres[other, 2] + turn_k * cells.span[2] - z
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
    """Write a neighbour behind those whose surfaces are nearer: what is near is often in the way."""
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
def _between_spheres(spheres, room, rules, scratch, sphere, many):  # type: ignore[no-untyped-def]
    """Write the pockets between a sphere and two others; return how many, also where there are too many."""
    found, pocket, near, in_the_way = 0, rules.pocket, scratch.near, 0
    if room.dimension == 2:
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
                px, py, pz = spheres[sphere, 0] + x + hx, spheres[sphere, 1] + y + hy, spheres[sphere, 2] + z + hz
                b, c = (scratch.ref[u], scratch.ref[v]) if side == 0 else (scratch.ref[v], scratch.ref[u])
                found = _note(room, rules, scratch, (sphere << BITS) + HERE, b, c, px, py, pz, found)
    return found


@bare_kernel
def _at_walls(spheres, room, rules, scratch, sphere, many, found):  # type: ignore[no-untyped-def]
    """Write the pockets between a sphere, walls, and another sphere or none; return how many pockets there are then.

    The faces of a loose front are between spheres: there the plane of disks is the only wall.
    """
    here = (sphere << BITS) + HERE
    if room.kind == MESH:
        return _at_mesh(spheres, room, rules, scratch, sphere, many, found)
    low, high = (SIDE, 0) if rules.dense else (PLANE, PLANE + 1)
    if room.kind == ROUND:
        # from inside a sphere is a sphere of negative radius: the last row
        wall = (len(spheres) - 1 << BITS) + HERE
        dx, dy, dz = (
            spheres[sphere, 0] - room.radius,
            spheres[sphere, 1] - room.radius,
            spheres[sphere, 2] - room.radius,
        )
        near = room.radius - math.sqrt(dx * dx + dy * dy + dz * dz) < spheres[sphere, 3] + 2.0 * rules.pocket
        for u in range(many if near and rules.dense else 0):
            if scratch.ref[u] >= 0:
                found = _try_at(spheres, room, rules, scratch, sphere, many, here, scratch.ref[u], wall, u, found)
                found = _try_at(spheres, room, rules, scratch, sphere, many, scratch.ref[u], here, wall, u, found)
        return found
    for wall in range(low, high):
        if not _is_wall_near(spheres, room, rules.pocket, wall, sphere):
            continue
        # disks lie in their plane: it is one of the three
        for u in range(many if room.dimension == 3 or wall == PLANE else 0):
            if scratch.ref[u] >= 0:
                found = _try_at(spheres, room, rules, scratch, sphere, many, here, scratch.ref[u], wall, u, found)
                found = _try_at(spheres, room, rules, scratch, sphere, many, scratch.ref[u], here, wall, u, found)
        for second in range(low, high):
            if room.dimension == 2 and PLANE not in (wall, second):
                continue
            if second != wall and _is_wall_near(spheres, room, rules.pocket, second, sphere):
                found = _try_at(spheres, room, rules, scratch, sphere, many, here, wall, second, -1, found)
    if room.kind == UPRIGHT and rules.dense and 2.0 * (room.radius - rules.pocket) <= spheres[sphere, 3] + rules.pocket:
        # in so narrow a tube no two spheres pass each other
        found = _try_at(spheres, room, rules, scratch, sphere, many, here, SIDE, ABOVE, -1, found)
        found = _try_at(spheres, room, rules, scratch, sphere, many, here, SIDE, BENEATH, -1, found)
    return found


@bare_kernel
def _at_mesh(spheres, room, rules, scratch, sphere, many, found):  # type: ignore[no-untyped-def]
    """Write the pockets between a sphere, another one and the wall of a mesh; return how many there are then."""
    here, reach = (sphere << BITS) + HERE, spheres[sphere, 3] + 2.0 * rules.pocket
    if not rules.dense or not is_near_mesh(room, spheres[sphere, 0], spheres[sphere, 1], spheres[sphere, 2], reach):
        return found
    for u in range(many):
        if scratch.ref[u] >= 0:
            found = _try_at(spheres, room, rules, scratch, sphere, many, here, scratch.ref[u], WALL, u, found)
            found = _try_at(spheres, room, rules, scratch, sphere, many, scratch.ref[u], here, WALL, u, found)
    return found


@bare_kernel
def _try_at(spheres, room, rules, scratch, sphere, many, a, b, c, u, found):  # type: ignore[no-untyped-def]
    """Write a pocket at a wall, if there is one and neighbour u is alone in it; return how many there are then."""
    touch, x, y, z = place_in(spheres, room, a, b, c, rules.pocket)
    dx, dy, dz = x - spheres[sphere, 0], y - spheres[sphere, 1], z - spheres[sphere, 2]
    if not touch or _blocked(scratch.near, many, u, u, dx, dy, dz, rules.pocket, 0) >= 0:
        return found
    return _note(room, rules, scratch, a, b, c, x, y, z, found)


@bare_kernel
def _is_wall_near(spheres, room, pocket, wall, sphere):  # type: ignore[no-untyped-def]
    """Return whether a sphere in a pocket beside another could touch a wall; disks are always in their plane."""
    if wall == PLANE:
        return room.dimension == 2
    reach = spheres[sphere, 3] + 2.0 * pocket
    if wall == SIDE:
        out = math.hypot(spheres[sphere, 0] - room.radius, spheres[sphere, 1] - room.radius)
        return room.kind == UPRIGHT and room.radius - out < reach
    axis, high = (-1 - wall) // 2, (-1 - wall) % 2
    # the floor and the lid of a cylinder are flat
    if room.walled[axis] == 0 or room.kind == MESH or (room.kind == UPRIGHT and axis != 2):
        return False
    at = spheres[sphere, axis]
    return (room.lengths[axis] - at if high else at) < reach


@bare_kernel
def _blocked(near, many, u, v, x, y, z, pocket, first):  # type: ignore[no-untyped-def]
    """Return a neighbour that a sphere would overlap, looking at `first` before all others; -1 where there is none."""
    for k in range(-1, many):
        w = first if k < 0 else k
        if w in (u, v) or w >= many:
            continue
        apart = (pocket + near[w, 3]) - LENIENT * pocket
        if (x - near[w, 0]) ** 2 + (y - near[w, 1]) ** 2 + (z - near[w, 2]) ** 2 < apart * apart:
            return w
    return -1


@bare_kernel
def _note(room, rules, scratch, a, b, c, x, y, z, found):  # type: ignore[no-untyped-def]
    """Write a pocket, if no wall is in the way; return how many there are then."""
    if not is_inside(room, x, y, z, rules.pocket * (1.0 - LENIENT)):
        return found
    if found < len(scratch.key):
        scratch.key[found] = rank(room, rules, x, y, z)
        scratch.touched[found, 0], scratch.touched[found, 1], scratch.touched[found, 2] = a, b, c
    return found + 1
