"""Forces of soft spheres and their relaxation by FIRE, over lists of near pairs.

Two spheres, or a sphere and a wall, that overlap by a depth push each other away by a force equal to it: harmonic
repulsion without friction. A sphere lies in the cells of its own level of size, so that the search for pairs costs as
much for a wide gradation as for equal spheres. A list holds the pairs that may touch before any sphere has moved by a
share of its own radius.

References
----------
Bitzek, Koskinen, Gaehler, Moseler & Gumbsch 2006, Structural relaxation made simple, Physical Review Letters 97,
170201, doi:10.1103/PhysRevLett.97.170201.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel
from voxgran.containers.kernel_container import FLAT, MESH, ROUND, UPRIGHT, KernelContainer, wall_of_mesh
from voxgran.geometry.level_grid import LevelGrid, cells_near, first_in_cell, image_shift, link_at
from voxgran.geometry.tree import square_to_box
from voxgran.geometry.triangles import closest_on_triangle

#: images of a periodic length at which a partner may lie, on either side
MOST_IMAGES = 2
IMAGES = 2 * MOST_IMAGES + 1
#: rows of the numbers that the relaxation carries from call to call
STEP, MIXING, UPHILL_FREE = 0, 1, 2
ENERGY, DEPTH, RESIDUAL, PUSH, TOUCHING = 3, 4, 5, 6, 7
NUMBERS = 8
#: FIRE: first and largest time step, for a stiffness and a mass of 1; its other constants are those of the paper
FIRST_STEP, LARGEST_STEP = 0.1, 0.45
DELAY, FASTER, SLOWER, LESS_MIXING, FIRST_MIXING = 5, 1.1, 0.5, 0.99, 0.1


class PairList(NamedTuple):
    """Pairs that may touch: sphere i with ``other[first[i]:first[i + 1]]``, moved by ``shift[image]``.

    near_wall: spheres that may touch a wall.
    """

    first: Integers
    other: NDArray[np.int32]
    image: NDArray[np.uint8]
    shift: Floats
    near_wall: Integers


def image_shifts(periods: Floats) -> Floats:
    """Return the vector of each image, (IMAGES**3, 3), by the vectors (3, 3) by which the container repeats."""
    turns = np.indices((IMAGES,) * 3).reshape(3, -1).T - MOST_IMAGES
    return np.ascontiguousarray(linear.matmul(turns, periods))


@bare_kernel
def list_pairs(
    cells: LevelGrid,
    level: Integers,
    spheres: Floats,
    lower: Floats,
    reach: float,
    first: Integers,
    other: NDArray[np.int32],
    image: NDArray[np.uint8],
) -> int:
    """Write the pairs with ``distance < reach * (r_i + r_j)`` and return how many there are; the arrays need one place
    more, and pairs for which there is none are only counted.

    A sphere is paired with larger ones, and with those before it on its own level: on the only one, the others need not
    be linked yet.
    """
    found, alone = 0, len(cells.first) == 1
    for i in range(0 if alone else len(spheres)):
        link_at(cells, i, level[i], spheres[i, 0] - lower[0], spheres[i, 1] - lower[1], spheres[i, 2] - lower[2])
    for i in range(len(spheres)):
        first[i] = found
        if alone:
            link_at(cells, i, 0, spheres[i, 0] - lower[0], spheres[i, 1] - lower[1], spheres[i, 2] - lower[2])
        for other_level in range(level[i] + 1):
            found = _list_level(cells, other_level, level[i], spheres, lower, reach, i, found, other, image)
    first[len(spheres)] = found
    return found


@bare_kernel
def _list_level(cells, other_level, own, spheres, lower, reach, i, found, other, image):  # type: ignore[no-untyped-def]
    """Write the partners of one sphere on a level, and return the new number of pairs."""
    x, y, z, r = spheres[i, 0] - lower[0], spheres[i, 1] - lower[1], spheres[i, 2] - lower[2], spheres[i, 3]
    far = reach * r + cells.reach[other_level, 0]
    low, high = cells_near(cells, other_level, x, y, z, (far, far, far))
    for ci in range(low[0], high[0]):
        for cj in range(low[1], high[1]):
            for ck in range(low[2], high[2]):
                j, ti, tj, tk = first_in_cell(cells, other_level, ci, cj, ck)
                if j < 0 or max(abs(ti), abs(tj), abs(tk)) > MOST_IMAGES:
                    continue
                sx, sy, sz = image_shift(cells, ti, tj, tk)
                turned = ((ti + MOST_IMAGES) * IMAGES + tj + MOST_IMAGES) * IMAGES + tk + MOST_IMAGES
                ahead = ti > 0 or (ti == 0 and (tj > 0 or (tj == 0 and tk > 0)))
                while j >= 0:
                    if other_level < own or j < i or (j == i and ahead):
                        dx = spheres[j, 0] - lower[0] + sx - x
                        dy = spheres[j, 1] - lower[1] + sy - y
                        dz = spheres[j, 2] - lower[2] + sz - z
                        limit = reach * (r + spheres[j, 3])
                        # written in any case, and kept if near: a branch that is guessed wrong takes longer
                        at = min(found, len(other) - 1)
                        other[at], image[at] = j, turned
                        found += 1 if dx * dx + dy * dy + dz * dz < limit * limit else 0
                    j = cells.after[j]
    return found


@bare_kernel
def push_spheres(
    spheres: Floats, pairs: PairList, walls: KernelContainer, beyond: Floats, force: Floats, numbers: Floats
) -> None:
    """Write the forces on the spheres; `numbers` gets energy, largest relative depth, contacts, and sum of forces.

    beyond: (near walls, 4) distance and inward normal of walls that are known by their distance only; empty for others.
    """
    energy, depth, push, touching = 0.0, 0.0, 0.0, 0
    for i in range(len(spheres)):
        force[i, 0] = force[i, 1] = force[i, 2] = 0.0
    for i in range(len(spheres)):
        x, y, z, r = spheres[i, 0], spheres[i, 1], spheres[i, 2], spheres[i, 3]
        fx, fy, fz = 0.0, 0.0, 0.0
        for k in range(pairs.first[i], pairs.first[i + 1]):
            j, image = pairs.other[k], pairs.image[k]
            dx = spheres[j, 0] + pairs.shift[image, 0] - x
            dy = spheres[j, 1] + pairs.shift[image, 1] - y
            dz = spheres[j, 2] + pairs.shift[image, 2] - z
            both = r + spheres[j, 3]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            # pairs apart push by nothing: a branch that is guessed wrong takes longer than the sums
            deep = max(both - distance, 0.0)
            if distance == 0.0:
                # centers that coincide are parted along x
                dx, distance = 1.0, 1.0
            pull = deep / distance
            fx -= pull * dx
            fy -= pull * dy
            fz -= pull * dz
            force[j, 0] += pull * dx
            force[j, 1] += pull * dy
            force[j, 2] += pull * dz
            energy += deep * deep
            push += deep
            touching += 1 if deep > 0.0 else 0
            if deep > depth * both:
                depth = deep / both
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
    numbers[ENERGY], numbers[DEPTH], numbers[PUSH], numbers[TOUCHING] = energy, depth, push, touching
    for k in range(len(pairs.near_wall)):
        _push_from_walls(spheres, pairs.near_wall[k], k, walls, beyond, force, numbers)


@bare_kernel
def _push_from_walls(spheres, i, k, walls, beyond, force, numbers):  # type: ignore[no-untyped-def]
    """Add the forces of all walls on one sphere."""
    plane = len(beyond) == 0
    for axis in range(3):
        # bounds of other kinds are no walls, but for the ends of cylinders
        if walls.walled[axis] == 1 and plane and (walls.kind == FLAT or (walls.kind == UPRIGHT and axis == 2)):
            low = spheres[i, axis] - walls.lower[axis]
            high = walls.lower[axis] + walls.lengths[axis] - spheres[i, axis]
            _push_from_wall(i, spheres[i, 3], low, axis, 1.0, force, numbers)
            _push_from_wall(i, spheres[i, 3], high, axis, -1.0, force, numbers)
    nx, ny, nz, away = 0.0, 0.0, 0.0, np.inf
    if walls.kind == UPRIGHT or walls.kind == ROUND:
        nx, ny = walls.middle[0] - spheres[i, 0], walls.middle[1] - spheres[i, 1]
        nz = walls.middle[2] - spheres[i, 2] if walls.kind == ROUND else 0.0
        long = math.sqrt(nx * nx + ny * ny + nz * nz)
        away = walls.radius - long
        if long > 0.0:
            nx, ny, nz = nx / long, ny / long, nz / long
    elif walls.kind == MESH:
        x, y, z = spheres[i, 0], spheres[i, 1], spheres[i, 2]
        distance, px, py, pz = wall_of_mesh(walls.mesh, x, y, z)
        away = -distance
        if away != 0.0:
            nx, ny, nz = (x - px) / away, (y - py) / away, (z - pz) / away
        if 0.0 < away < spheres[i, 3]:
            _push_from_faces(spheres, i, away, walls, force, numbers)
    elif len(beyond) > 0:
        away, nx, ny, nz = beyond[k, 0], beyond[k, 1], beyond[k, 2], beyond[k, 3]
    deep = spheres[i, 3] - away
    if walls.dimension == 2:
        nz = 0.0
    if deep > 0.0:
        force[i, 0] += deep * nx
        force[i, 1] += deep * ny
        force[i, 2] += deep * nz
        _count_wall(spheres[i, 3], deep, numbers)


@bare_kernel
def _push_from_faces(spheres, i, nearest, walls, force, numbers):  # type: ignore[no-untyped-def]
    """Add the forces of the faces of a mesh beyond the nearest one: a corner holds a sphere by all of its faces.

    A face counts where the foot of the perpendicular from the center lies in it.
    """
    mesh, r = walls.mesh, spheres[i, 3]
    x, y, z = spheres[i, 0] + mesh.shift[0], spheres[i, 1] + mesh.shift[1], spheres[i, 2] + mesh.shift[2]
    stack, leaves = mesh.stack, len(mesh.low) // 2
    stack[0], waiting = 0, 1
    while waiting > 0:
        waiting -= 1
        node = stack[waiting]
        if square_to_box(mesh.low, mesh.high, node, x, y, z) >= r * r:
            continue
        if node < leaves:
            stack[waiting], stack[waiting + 1] = 2 * node + 1, 2 * node + 2
            waiting += 2
            continue
        for k in range(mesh.start[node, 0], mesh.start[node, 1]):
            px, py, pz, feature = closest_on_triangle(mesh.corners, k, x, y, z)
            away = math.sqrt((px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2)
            if feature == 0 and nearest < away < r:
                pull = (r - away) / away
                force[i, 0] += pull * (x - px)
                force[i, 1] += pull * (y - py)
                if walls.dimension == 3:
                    force[i, 2] += pull * (z - pz)
                _count_wall(r, r - away, numbers)


@bare_kernel
def _push_from_wall(i, r, away, axis, sign, force, numbers):  # type: ignore[no-untyped-def]
    """Add the force of a plane wall at the distance `away` from the center."""
    if away < r:
        force[i, axis] += sign * (r - away)
        _count_wall(r, r - away, numbers)


@bare_kernel
def _count_wall(r, deep, numbers):  # type: ignore[no-untyped-def]
    """Count a contact with a wall."""
    numbers[ENERGY] += deep * deep
    numbers[DEPTH] = max(numbers[DEPTH], deep / r)
    numbers[PUSH] += deep
    numbers[TOUCHING] += 1


class Relaxation(NamedTuple):
    """Spheres on their way to rest, and the numbers that are kept from call to call.

    spheres: (n, 4) centers and radii.  velocity, force: (n, 3); the force is that at the present positions.
    lightness: (n,) inverse masses.  listed: (n, 3) centers when the pairs were listed.  numbers: (NUMBERS,).
    """

    spheres: Floats
    velocity: Floats
    force: Floats
    lightness: Floats
    listed: Floats
    numbers: Floats


@bare_kernel
def relax_spheres(
    soft: Relaxation, pairs: PairList, walls: KernelContainer, beyond: Floats, free: float, iterations: int,
    goal: float, calm: float,
) -> int:  # fmt: skip
    """Make up to so many FIRE iterations, and return how many were made.

    It ends earlier when a sphere has moved from where it was listed by `free` of its radius, so that pairs must be
    listed again; when no relative depth is above `goal`; and when the residual force is below `calm` of the mean
    contact force.
    """
    spheres, velocity, force, lightness, listed, numbers = soft
    n = len(spheres)
    for done in range(iterations):
        power, speed, strength = 0.0, 0.0, 0.0
        for i in range(n):
            for a in range(3):
                power += force[i, a] * velocity[i, a]
                speed += velocity[i, a] * velocity[i, a]
                strength += force[i, a] * force[i, a]
        if power > 0.0:
            numbers[UPHILL_FREE] += 1.0
            if numbers[UPHILL_FREE] > DELAY:
                numbers[STEP] = min(numbers[STEP] * FASTER, LARGEST_STEP)
                numbers[MIXING] *= LESS_MIXING
        else:
            if numbers[UPHILL_FREE] > 0.0:
                numbers[STEP] *= SLOWER
            numbers[UPHILL_FREE], numbers[MIXING], speed = 0.0, FIRST_MIXING, 0.0
        step, mixing = numbers[STEP], numbers[MIXING]
        keep = (1.0 - mixing) if power > 0.0 else 0.0
        turn = mixing * math.sqrt(speed / strength) if strength > 0.0 else 0.0
        moved = False
        for i in range(n):
            away, reach = 0.0, free * spheres[i, 3]
            for a in range(3):
                v = keep * velocity[i, a] + (turn + step * lightness[i]) * force[i, a]
                velocity[i, a] = v
                spheres[i, a] += step * v
                gone = spheres[i, a] - listed[i, a]
                away += gone * gone
            moved = moved or away > reach * reach
        if moved:
            numbers[RESIDUAL] = -1.0
            return done + 1
        push_spheres(spheres, pairs, walls, beyond, force, numbers)
        strength = 0.0
        for i in range(n):
            strength += force[i, 0] * force[i, 0] + force[i, 1] * force[i, 1] + force[i, 2] * force[i, 2]
        mean = numbers[PUSH] / max(numbers[TOUCHING], 1.0)
        numbers[RESIDUAL] = math.sqrt(strength / n) / mean if mean > 0.0 else 0.0
        if numbers[DEPTH] <= goal or numbers[RESIDUAL] < calm:
            return done + 1
    return iterations
