"""Rest without friction: grains sink to the least potential energy while their contacts are springs.

A contact pushes with its stiffness times the depth by which surfaces are nearer than a distance that they keep. The
stiffness grows with the depth below the surface of the bed as the forces do, so that all contacts are compressed alike,
and the masses by which the grains move are those with which all contacts swing alike fast: the real ones would let the
uppermost grains, whose forces are least, take longest. A bed that rests on contacts which are compressed by less than
the distance is one of rigid grains at rest without overlap: the forces of the springs are its proof.

Between two searches for contacts, two spheres keep their exact distance; other contacts are linearized, for small
motions. The descent is FIRE.

References
----------
Bitzek, Koskinen, Gaehler, Moseler & Gumbsch 2006, doi:10.1103/PhysRevLett.97.170201
"""

import math
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.kernels import bare_kernel, kernel
from voxgran._base.stopping import stop_if_asked
from voxgran.contacts.manifolds.rows import ARM_I, ARM_J, GAP, NORMAL, SPHERE
from voxgran.geometry.vectors import add, cross, dot, row_of, sub, times, vector_at
from voxgran.settling.bed import Bed

#: FIRE: first and largest time step over the shortest time of a contact; its other constants
FIRST_STEP, LARGEST_STEP, LEAST_STEP = 0.05, 0.5, 0.01
DELAY, FASTER, SLOWER, LESS_MIXING, MIXING = 5, 1.1, 0.5, 0.99, 0.02
#: rounds between two looks at the grains that do not rest, and forces of contacts between two looks for signals
LOOK, STOPPED_EVERY = 10, 2_000_000
#: motion after which contacts are found again, of spheres and of others, and gap up to which they are found, over that
FAR, NEAR, AHEAD = 0.05, 5e-3, 2.0
#: factors on that motion where grains go back, and where they do not, and the least one
BACK, ONWARD, LEAST_FAR = 0.5, 1.5, 0.02
#: gap, over the motion, of contacts that count for the mass of a grain, least number of them, and the moment of inertia
#: over the mass and the square of the radius
BESIDE, FEWEST, MOMENT = 0.2, 4.0, 0.4
#: share of the grains that are above the surface of a bed
TOP = 0.02
#: radius of curvature of contacts that are linearized
FLAT = 1e3
#: cosine from which on normals are one, square of a distance at which points are one, and angle that counts as none
ONE_NORMAL, SAME_POINT, STRAIGHT = 1.0 - 1e-12, 1e-18, 1e-9
#: gap from which on a contact point does not count for the shares of the others
WIDE = 1e-3


class Springs(NamedTuple):
    """Contacts as springs between points of bodies.

    i, j: (m,) bodies; j is negative at a wall.  line: (m, 3) from the point of body i to that of body j, where no body
    has moved.  arm_i, arm_j: (m, 3) of the points.  reach: (m,) length of the line at which the spring begins to push.
    stiffness: (m,).
    """

    i: Integers
    j: Integers
    line: Floats
    arm_i: Floats
    arm_j: Floats
    reach: Floats
    stiffness: Floats


class Descent(NamedTuple):
    """Bodies on their way down, and what moves them.

    motion, velocity, force: (n + 1, 6) translations and rotations.  load: (n + 1, 3) weights.  lightness: (n + 1, 2)
    inverse masses and moments, 0 of fixed bodies.  limit: (n + 1, 2) net forces and torques up to which they rest.
    radius: (n + 1,) by which a rotation moves a surface.  axis: (3,) along which the lid moves, the last body.
    """

    motion: Floats
    velocity: Floats
    force: Floats
    load: Floats
    lightness: Floats
    limit: Floats
    radius: Floats
    axis: Floats


def soft_step(
    bed: Bed, size: float, velocity: Floats, *, rest: float, tolerance: float, enough: float, iterations: int
) -> tuple[float, Floats, float]:
    """Let the grains descend; return the share that does not rest, the velocities and the largest compression.

    The bed keeps the forces of its contacts.

    size: compression of a contact by the mean force at its depth, in median diameters.  velocity: (n + 1, 6) of the
    step before, or empty.  rest: distance that surfaces keep.  tolerance: net force, in weights, and net torque, in
    weights times radii, up to which a grain rests.  enough: share of grains that need not rest with which the descent
    ends, before so many iterations are made.
    """
    n, round_grains, free = bed.count, not bed.grains.kind.any(), bed.bodies[:, 6] > 0.0
    far, radius = FAR if round_grains else NEAR, np.append(0.5 * bed.diameter, 1.0)
    weight = np.where(free, 1.0 / np.where(free, bed.bodies[:, 6], 1.0), 0.0)
    limit = tolerance * weight[:, None] * np.stack([np.ones(n + 1), radius], axis=1)
    velocity = velocity if velocity.shape == (n + 1, 6) else np.zeros((n + 1, 6))
    state, made, movable = np.array([FIRST_STEP, MIXING, 0.0]), 0, max(int(free[:n].sum()), 1)
    near, before = far, np.zeros((n + 1, 6))
    while True:
        bed.find(AHEAD * far, rest)
        springs, lightness = _springs_of(bed, size, rest, BESIDE * far)
        descent = Descent(
            np.zeros((n + 1, 6)), velocity, np.zeros((n + 1, 6)), weight[:, None] * bed.gravity, lightness, limit,
            np.append(bed.grains.radius, 0.0), bed.gravity,
        )  # fmt: skip
        done, ended = 0, False
        # a descent is asked from time to time whether to stop
        part = LOOK * max(1, STOPPED_EVERY // (LOOK * max(len(springs.i), 1)))
        while not ended:
            stop_if_asked()
            part = min(part, iterations - made)
            more, restless, deepest = descend(springs, descent, state, part, enough * movable, near, round_grains)
            done, made = done + more, made + more
            ended = more < part or made >= iterations or restless <= enough * movable
        push = spring_forces(springs, descent.motion)
        bed.keep_forces(push[:, None] * bed.contacts.row[:, NORMAL : NORMAL + 3])
        bed.move(descent.motion, math.inf)
        if not round_grains:
            # a grain that goes to and fro turns each time farther than linearized contacts say
            back = float((descent.motion * before).sum()) < 0.0
            near, before = max(near * BACK, LEAST_FAR * far) if back else min(near * ONWARD, far), descent.motion
        # where grains rest by linearized contacts, they are to rest by those that are found anew
        calm = restless <= enough * movable and (round_grains or done <= LOOK)
        if calm or made >= iterations:
            return restless / movable, velocity, deepest


def _springs_of(bed: Bed, size: float, rest: float, beside: float) -> tuple[Springs, Floats]:
    """Return the contacts that a bed has found as springs, and inverse masses and moments (n + 1, 2) of the bodies.

    The mean force at its depth compresses a spring by a size, and no contact swings faster than with the time 1.
    beside: gap up to which contacts count for the masses.
    """
    contacts, n = bed.contacts, bed.count
    row, i, j = contacts.row, contacts.i, contacts.j
    other = np.where((j >= 0) & (j < n), j, i)
    normal, one, two = (row[:, at : at + 3].copy() for at in (NORMAL, ARM_I, ARM_J))
    spheres = (j >= 0) & (j < n) & (bed.grains.kind[i] == SPHERE) & (bed.grains.kind[other] == SPHERE)
    reach = np.where(spheres, ((one - two) * normal).sum(axis=1) + rest, FLAT)
    one[spheres], two[spheres] = 0.0, 0.0
    force, power = _mean_force(bed), bed.assembly.dimension - 1
    smaller = np.minimum(bed.diameter[i], bed.diameter[other])
    stiffness = 0.5 * (force[i] + force[other]) * libm.power(smaller, power) / size * shares_of_corners(row, i, j)
    line = normal * (reach + row[:, GAP])[:, None]
    near = row[:, GAP] < beside
    inner = near & (j >= 0)
    mass = np.bincount(i[near], stiffness[near], n + 1) + np.bincount(j[inner], stiffness[inner], n + 1)
    least = FEWEST * np.append(force * libm.power(bed.diameter, power), 1.0) / size
    lightness = np.zeros((n + 1, 2))
    lightness[:, 0] = np.where(bed.bodies[:, 6] > 0.0, FEWEST / np.maximum(mass, least), 0.0)
    lightness[:n, 1] = lightness[:n, 0] / (MOMENT * bed.grains.radius**2)
    return Springs(i.copy(), j.copy(), line, one, two, reach, stiffness), lightness


def _mean_force(bed: Bed) -> Floats:
    """Return about the mean force of a contact of each grain, (n,), by its depth below the surface and the lid."""
    height = -linear.matmul(bed.grains.position, bed.gravity)
    depth = np.maximum(np.quantile(height, 1.0 - TOP) - height, 0.0)
    return 1.0 + depth + (bed.load - 1.0) * depth.max(initial=1.0)


@kernel
def shares_of_corners(row: Floats, i: Integers, j: Integers) -> Floats:
    """Return the shares (m,) of contact points in the contacts of which they are corners.

    The points of two bodies with one normal are the corners of a polygon. The share of a corner is the angle there by
    which its boundary turns, over a full turn: it changes continuously where corners come, go, or become others.
    Corners with wide gaps count less: for each gap there is a polygon of the corners whose gaps are smaller, and the
    shares are a mean over these polygons.
    """
    shares, first, m = np.ones(len(i)), 0, len(i)
    while first < m:
        last = first + 1
        n = row_of(row, first)
        while last < m and i[last] == i[first] and j[last] == j[first] and dot(n, row_of(row, last)) > ONE_NORMAL:
            last += 1
        if last - first > 1:
            order = first + np.argsort(row[first:last, GAP])
            shares[first:last], low = 0.0, 0.0
            for k in range(len(order)):
                next_one = min(row[order[k + 1], GAP] / WIDE, 1.0) if k + 1 < len(order) else 1.0
                if next_one > low:
                    _share(row, order[: k + 1], shares, next_one - low)
                    low = next_one
        first = last
    return shares


@bare_kernel
def _share(row, corners, shares, whole):  # type: ignore[no-untyped-def]
    """Add the shares of the corners of one polygon in a whole, by going around it; points within it have none."""
    n = row_of(row, corners[0])
    across = cross(n, (1.0, 0.0, 0.0) if abs(n[0]) < 0.6 else (0.0, 1.0, 0.0))
    along = cross(n, across)
    start, part = corners[0], whole / (2.0 * math.pi)
    for k in corners:
        if dot(sub(vector_at(row[k], ARM_I), vector_at(row[start], ARM_I)), along) < 0.0:
            start = k
    at, x, y, turned = start, 1.0, 0.0, 0.0
    for _ in range(len(corners)):
        least, far, to, tx, ty = 2.0 * math.pi, 0.0, -1, 0.0, 0.0
        for k in corners:
            way = sub(vector_at(row[k], ARM_I), vector_at(row[at], ARM_I))
            p, q = dot(way, across), dot(way, along)
            square = p * p + q * q
            if square > SAME_POINT:
                angle = math.atan2(x * q - y * p, x * p + y * q)
                angle = 0.0 if abs(angle) < STRAIGHT else angle + 2.0 * math.pi if angle < 0.0 else angle
                if angle < least - STRAIGHT or (angle < least + STRAIGHT and square > far):
                    least, far, to, tx, ty = angle, square, k, p, q
        if to < 0 or turned + least >= 2.0 * math.pi - STRAIGHT:
            break
        shares[at] += least * part
        turned += least
        at, x, y = to, tx, ty
    shares[start] += (2.0 * math.pi - turned) * part


@kernel
def spring_forces(springs: Springs, motion: Floats) -> Floats:
    """Return the normal forces (m,) of springs after motions (n + 1, 6) of their bodies."""
    push = np.zeros(len(springs.i))
    for c in range(len(push)):
        line = _line_of(springs, motion, c, False)
        push[c] = springs.stiffness[c] * max(springs.reach[c] - math.sqrt(dot(line, line)), 0.0)
    return push


@bare_kernel
def _line_of(springs, motion, c, round_grains):  # type: ignore[no-untyped-def]
    """Return the line of a spring after motions."""
    i, j, line = springs.i[c], springs.j[c], row_of(springs.line, c)
    a = motion[i]
    line = sub(line, vector_at(a, 0))
    if not round_grains:
        line = sub(line, cross(vector_at(a, 3), row_of(springs.arm_i, c)))
    if j >= 0:
        b = motion[j]
        line = add(line, vector_at(b, 0))
        if not round_grains:
            line = add(line, cross(vector_at(b, 3), row_of(springs.arm_j, c)))
    return line


@bare_kernel
def _push(springs, descent, round_grains):  # type: ignore[no-untyped-def]
    """Write the forces and torques on the bodies, and return the largest compression."""
    force, last, deepest = descent.force, len(descent.force) - 1, 0.0
    for k in range(last + 1):
        for a in range(3):
            force[k, a], force[k, 3 + a] = descent.load[k, a], 0.0
    for c in range(len(springs.i)):
        line = _line_of(springs, descent.motion, c, round_grains)
        square, reach = dot(line, line), springs.reach[c]
        if square >= reach * reach:
            continue
        length = math.sqrt(square)
        deepest = max(deepest, reach - length)
        push = times(line, springs.stiffness[c] * (reach / length - 1.0))
        _add_force(force[springs.i[c]], times(push, -1.0), row_of(springs.arm_i, c), round_grains)
        if springs.j[c] >= 0:
            _add_force(force[springs.j[c]], push, row_of(springs.arm_j, c), round_grains)
    lid, axis = force[last], vector_at(descent.axis, 0)
    lid[0], lid[1], lid[2] = times(axis, dot(vector_at(lid, 0), axis))
    lid[3] = lid[4] = lid[5] = 0.0
    return deepest


@bare_kernel
def _add_force(total, force, arm, round_grains):  # type: ignore[no-untyped-def]
    """Add a force at an arm to the net force and torque of a body."""
    total[0] += force[0]
    total[1] += force[1]
    total[2] += force[2]
    if not round_grains:
        turn = cross(arm, force)
        total[3] += turn[0]
        total[4] += turn[1]
        total[5] += turn[2]


@bare_kernel
def _restless(descent, freedoms):  # type: ignore[no-untyped-def]
    """Return the number of bodies, but for the lid, whose net force or torque is beyond its limit."""
    found = 0
    for k in range(len(descent.force) - 1):
        if descent.lightness[k, 0] > 0.0:
            for part in range(freedoms // 3):
                square = 0.0
                for a in range(3 * part, 3 * part + 3):
                    square += descent.force[k, a] ** 2
                if square > descent.limit[k, part] ** 2:
                    found += 1
                    break
    return found


@kernel
def descend(
    springs: Springs, descent: Descent, state: Floats, iterations: int, few: float, far: float, round_grains: bool
) -> tuple[int, int, float]:
    """Make iterations of FIRE; return their number, that of the bodies that do not rest, and the largest compression.

    They end where no more than a few bodies do not rest, and where a point of a surface has moved as far as given.

    state: (3,) time step, mixing, and iterations since the last one that went uphill.  round_grains: whether all grains
    are spheres, which do not rotate.
    """
    motion, velocity, force = descent.motion, descent.velocity, descent.force
    freedoms, made = 3 if round_grains else 6, 0
    deepest = _push(springs, descent, round_grains)
    restless = _restless(descent, freedoms)
    while made < iterations and restless > few:
        made += 1
        uphill = _change_step(motion, velocity, force, freedoms, state)
        if uphill:
            velocity[:] = 0.0
        gone = _go(descent, state, freedoms)
        deepest = _push(springs, descent, round_grains)
        if made % LOOK == 0 or gone > far * far or made == iterations:
            restless = _restless(descent, freedoms)
        if gone > far * far:
            break
    return made, restless, deepest


@bare_kernel
def _change_step(motion, velocity, force, freedoms, state):  # type: ignore[no-untyped-def]
    """Change the time step and the mixing; where velocities point uphill go half a step back, and return that."""
    power = 0.0
    for k in range(len(force)):
        for a in range(freedoms):
            power += force[k, a] * velocity[k, a]
    if power > 0.0:
        state[2] += 1.0
        if state[2] > DELAY:
            state[0], state[1] = min(state[0] * FASTER, LARGEST_STEP), state[1] * LESS_MIXING
        return False
    for k in range(len(force)):
        for a in range(freedoms):
            motion[k, a] -= 0.5 * state[0] * velocity[k, a]
    state[0], state[1], state[2] = max(state[0] * SLOWER, LEAST_STEP), MIXING, 0.0
    return True


@bare_kernel
def _go(descent, state, freedoms):  # type: ignore[no-untyped-def]
    """Make a step of semi-implicit Euler with mixed velocities; return the largest square of a motion."""
    motion, velocity, force, lightness = descent.motion, descent.velocity, descent.force, descent.lightness
    step, mixing, speed, strength, far = state[0], state[1], 0.0, 0.0, 0.0
    for k in range(len(force)):
        for a in range(freedoms):
            inverse = lightness[k, a // 3]
            if inverse > 0.0:
                velocity[k, a] += step * force[k, a] * inverse
                speed += velocity[k, a] ** 2 / inverse
                strength += force[k, a] ** 2 * inverse
    turn = mixing * math.sqrt(speed / strength) if strength > 0.0 else 0.0
    for k in range(len(force)):
        square, turned = 0.0, 0.0
        for a in range(freedoms):
            velocity[k, a] = (1.0 - mixing) * velocity[k, a] + turn * force[k, a] * lightness[k, a // 3]
            motion[k, a] += step * velocity[k, a]
            if a < 3:
                square += motion[k, a] ** 2
            else:
                turned += motion[k, a] ** 2
        far = max(far, square, turned * descent.radius[k] ** 2)
    return far
