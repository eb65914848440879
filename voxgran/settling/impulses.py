"""Contact dynamics with small substeps: impulses of contacts, and the motions that they leave.

In each substep the velocities are first those of free motion with the impulses of the substep before; one projected
Gauss-Seidel sweep then changes the impulses so that no gap closes within the substep, with Coulomb friction as a cone.
Gaps count with what the bodies have moved since the contacts were found. A second sweep, after the motion, takes away
the velocity by which overlaps were pushed open, so that no energy comes from there; with restitution it makes bodies
that have met rebound.

Moreau 1988, doi:10.1007/978-3-7091-2624-0_1. Macklin et al. 2019, doi:10.1145/3309486.3340247 (small substeps).
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.compiling.threads import in_blocks
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.manifolds.rounds import Rounds, rounds_of
from voxgran.contacts.manifolds.rows import ContactRows
from voxgran.geometry.vectors import Vector, cross, dot
from voxgran.settling.materials import FrictionTable
from voxgran.shapes.model import Shape

#: time step and number of substeps; farthest that a grain moves in a step; distance up to which contacts are found
STEP, SUBSTEPS, MOST, MARGIN = 0.05, 4, 0.05, 0.08
#: share of an overlap that is opened in a substep, and the largest velocity for that
OPENING, FASTEST = 0.136, 2.0
#: velocity of approach, in sqrt(g d), below which bodies do not rebound
SLOW = 0.05
#: overlap that is not opened, and how contacts yield while they open others: factors on the change of an impulse and on
#: the impulse that is lost; those of a spring of angular frequency 1.57 / h with 5 times the critical damping
LEFT, GAIN, LOSS = 2.5e-4, 0.9478, 0.0522
#: phases of a step: free motion, impulses of before, approach of bodies, and sweeps before and after the motion
FREE, TAKE_OVER, NOTE, FORTH, MOVE, BACK, GIVE_BACK = range(7)
#: numbers of a body: velocity (3), angular velocity (3), inverse mass and inverse moment of inertia
BODY = 8
#: ratio of the mean moment of inertia to the least one from which on a grain is slender
SLENDER = 4.0


class Fall(NamedTuple):
    """How a bed falls; lengths in median diameters, times in sqrt(d / g).

    Kernels take the friction of each contact, (m,), or that of all contacts, (1,).
    """

    friction: float | FrictionTable | Floats
    restitution: float = 0.0
    rest: float = 5e-4  # distance that surfaces keep
    step: float = STEP
    substeps: int = SUBSTEPS
    most: float = MOST
    margin: float = MARGIN
    weight: float = 1.0  # factor on gravity


def bodies_of(assembly: Assembly, order: Integers, lid_weight: float) -> Floats:
    """Return the rows (n + 1, 8) of grains at rest, and of the lid; fixed grains have infinite mass."""
    n = assembly.count
    bodies = np.zeros((n + 1, BODY))
    unit = math.pi / 6 if assembly.dimension == 3 else math.pi / 4
    density = assembly.relative_densities[order]
    mass = assembly.volumes[order] / unit * density
    bodies[:n, 6] = 1.0 / mass
    # the mean of the three principal moments stands for all: rest does not depend on them
    own = [np.trace(shape.inertia) / 3 if assembly.dimension == 3 else shape.inertia[2, 2] for shape in assembly.shapes]
    power = assembly.dimension + 2
    moment = (
        np.array(own)[assembly.shape_id[order]] * libm.power(assembly.scale[order], power) / unit if n else np.zeros(0)
    )
    bodies[:n, 7] = 1.0 / (moment * density)
    bodies[:n, 6:][~assembly.movable[order]] = 0.0
    bodies[n, 6] = 1.0 / lid_weight if assembly.lid is not None else 0.0
    return bodies


def rolls_of(shapes: Sequence[Shape]) -> Floats:
    """Return vectors (s, 3) along the axes of slender shapes, with a least moment of inertia far below the mean.

    The square of a vector is what the inverse of the least moment has beyond that of the mean, over the latter.
    """
    inertia = [shape.inertia if shape.dimension == 3 else np.eye(3) for shape in shapes]
    moments, axes = linear.eigh(np.reshape(inertia, (-1, 3, 3)))
    more = moments.mean(axis=1) / moments[:, 0] - 1.0
    return np.asarray(np.sqrt(np.where(more > SLENDER - 1.0, more, 0.0))[:, None] * axes[:, :, 0])


@bare_kernel
def add_impulse(b: Floats, arm: Vector, impulse: Vector) -> None:
    """Add an impulse at an arm to the velocities of a body."""
    m, t, turn = b[6], b[7], cross(arm, impulse)
    b[0] += m * impulse[0]
    b[1] += m * impulse[1]
    b[2] += m * impulse[2]
    b[3] += t * turn[0]
    b[4] += t * turn[1]
    b[5] += t * turn[2]


@bare_kernel
def add_to_partner(bodies: Floats, j: int, axis: Vector, arm: Vector, impulse: Vector) -> None:
    """Add an impulse to a partner: a grain, or the lid, the last body, which moves along an axis only."""
    b = bodies[j]
    if j < len(bodies) - 1:
        add_impulse(b, arm, impulse)
    else:
        along = b[6] * dot(impulse, axis)
        b[0] += along * axis[0]
        b[1] += along * axis[1]
        b[2] += along * axis[2]


@bare_kernel
def effective_masses(row: Floats, a: Floats, b: Floats, paired: bool) -> tuple[float, float]:
    """Return the inverse effective masses of a contact along its normal and across it; b counts where `paired`."""
    x, y, z = row[0], row[1], row[2]
    along = row[3] * x + row[4] * y + row[5] * z
    square = row[3] * row[3] + row[4] * row[4] + row[5] * row[5]
    normal = a[6] + a[7] * (square - along * along)
    across = a[6] + a[7] * square
    if paired:
        along = row[6] * x + row[7] * y + row[8] * z
        square = row[6] * row[6] + row[7] * row[7] + row[8] * row[8]
        normal += b[6] + b[7] * (square - along * along)
        across += b[6] + b[7] * square
    return normal, across


@bare_kernel
def _take_over(work, axis, begin, end):  # type: ignore[no-untyped-def]
    """Write the found rows in the order of the rounds, with effective masses, and apply impulses of the step before."""
    rows, bodies = work.rows, work.bodies
    for k in range(begin, end):
        row, i, j = rows.row[k], rows.i[k], rows.j[k]
        for column in range(14):
            row[column] = work.found[work.rounds.rows[k], column]
        normal, across = effective_masses(row, bodies[i], bodies[max(j, 0)], j >= 0)
        row[14] = 1.0 / normal if normal > 0.0 else 0.0
        row[15] = 1.0 / across if across > 0.0 else 0.0
        for column in range(10, 14):
            row[column] *= work.part
        push = row[10]
        px, py, pz = push * row[0] + row[11], push * row[1] + row[12], push * row[2] + row[13]
        if px == 0.0 and py == 0.0 and pz == 0.0:
            continue
        add_impulse(bodies[i], (row[3], row[4], row[5]), (-px, -py, -pz))
        if j >= 0:
            add_to_partner(bodies, j, axis, (row[6], row[7], row[8]), (px, py, pz))


@inlined_kernel
def _held_back(row, ux, uy, uz, speed, limit):  # type: ignore[no-untyped-def]
    """Return the tangential impulse that stops sliding, at most a limit; (ux, uy, uz): relative velocity."""
    nx, ny, nz, mass = row[0], row[1], row[2], row[15]
    tx = row[11] - (ux - speed * nx) * mass
    ty = row[12] - (uy - speed * ny) * mass
    tz = row[13] - (uz - speed * nz) * mass
    # the old impulse leans out of the tangent plane when the normal has turned
    lean = tx * nx + ty * ny + tz * nz
    tx -= lean * nx
    ty -= lean * ny
    tz -= lean * nz
    square = tx * tx + ty * ty + tz * tz
    if square > limit * limit:
        part = limit / math.sqrt(square)
        tx *= part
        ty *= part
        tz *= part
    return tx, ty, tz


@bare_kernel
def _sweep(rows, bodies, motion, axis, fall, approach, moving, begin, end):  # type: ignore[no-untyped-def]
    """Make one projected Gauss-Seidel sweep over the impulses of contacts, backwards after the motion.

    moving: whether gaps still close within this substep; overlaps are then opened by a share of themselves. Otherwise
    bodies only stop, or rebound by the share `restitution` of their approach.
    """
    friction, restitution, rate = fall.friction, fall.restitution, fall.substeps / fall.step
    own = len(friction) - 1
    for q in range(begin, end):
        k = q if moving else begin + end - 1 - q
        row, i, j = rows.row[k], rows.i[k], rows.j[k]
        a, da = bodies[i], motion[i]
        nx, ny, nz = row[0], row[1], row[2]
        rx, ry, rz = row[3], row[4], row[5]
        sx, sy, sz = row[6], row[7], row[8]
        ux = -(a[0] + a[4] * rz - a[5] * ry)
        uy = -(a[1] + a[5] * rx - a[3] * rz)
        uz = -(a[2] + a[3] * ry - a[4] * rx)
        # from all that the bodies have moved: summed up, gaps of 0 would be open or closed by other rounding
        gap = (
            row[9]
            - nx * (da[0] + da[4] * rz - da[5] * ry)
            - ny * (da[1] + da[5] * rx - da[3] * rz)
            - nz * (da[2] + da[3] * ry - da[4] * rx)
        )
        if j >= 0:
            b, db = bodies[j], motion[j]
            ux += b[0] + b[4] * sz - b[5] * sy
            uy += b[1] + b[5] * sx - b[3] * sz
            uz += b[2] + b[3] * sy - b[4] * sx
            gap += (
                nx * (db[0] + db[4] * sz - db[5] * sy)
                + ny * (db[1] + db[5] * sx - db[3] * sz)
                + nz * (db[2] + db[3] * sy - db[4] * sx)
            )
        speed = ux * nx + uy * ny + uz * nz
        excess = speed
        if gap > 0.0:
            excess = speed + gap * rate
        elif moving:
            excess = speed + max(OPENING * min(gap + LEFT, 0.0) * rate, -FASTEST)
        # bodies have met that push, and those that would within the next substep
        if not moving and restitution > 0.0 and approach[k] < 0.0 and (row[10] > 0.0 or excess < 0.0):
            excess = speed + restitution * approach[k]
        old = row[10]
        if moving and gap <= 0.0:
            push = max(old - GAIN * excess * row[14] - LOSS * old, 0.0)
        else:
            push = max(old - excess * row[14], 0.0)
        row[10] = push
        change = push - old
        px, py, pz = change * nx, change * ny, change * nz
        rub = friction[min(k, own)]
        if rub > 0.0 and (push > 0.0 or row[11] != 0.0 or row[12] != 0.0 or row[13] != 0.0):
            tx, ty, tz = _held_back(row, ux, uy, uz, speed, rub * push)
            px += tx - row[11]
            py += ty - row[12]
            pz += tz - row[13]
            row[11], row[12], row[13] = tx, ty, tz
        if px != 0.0 or py != 0.0 or pz != 0.0:
            add_impulse(a, (rx, ry, rz), (-px, -py, -pz))
            if j >= 0:
                add_to_partner(bodies, j, axis, (sx, sy, sz), (px, py, pz))


@bare_kernel
def _note_approach(rows, free, approach, begin, end):  # type: ignore[no-untyped-def]
    """Write the velocity with which the bodies of each contact approach each other; 0 where it is small."""
    for k in range(begin, end):
        row, j = rows.row[k], rows.j[k]
        speed = -normal_velocity(row, free[rows.i[k]], 3)
        if j >= 0:
            speed += normal_velocity(row, free[j], 6)
        approach[k] = speed if speed < -SLOW else 0.0


@bare_kernel
def normal_velocity(row: Floats, b: Floats, arm: int) -> float:
    """Return the velocity of a body at its arm, which begins in a column of the row, along the normal."""
    x, y, z = row[arm], row[arm + 1], row[arm + 2]
    return (
        row[0] * (b[0] + b[4] * z - b[5] * y)
        + row[1] * (b[1] + b[5] * x - b[3] * z)
        + row[2] * (b[2] + b[3] * y - b[4] * x)
    )


class StepWork(NamedTuple):
    """Arrays that the phases of a step use.

    found: (m, 16) rows as they were found, rows: the same in the order of the rounds.  part, approach: as in
    `advance_bodies`.  free: (n + 1, 6) velocities before the contacts act, those of free motion in a substep.
    """

    found: Floats
    rows: ContactRows
    bodies: Floats
    motion: Floats
    gravity: Floats
    fall: Fall
    part: float
    approach: Floats
    free: Floats
    rounds: Rounds


@bare_kernel
def _move_freely(work, first, end):  # type: ignore[no-untyped-def]
    """Write velocities of free motion in a substep, with what contacts have changed in them, as they do it again."""
    bodies, free, fall = work.bodies, work.free, work.fall
    h, most = fall.step / fall.substeps, fall.most / fall.step
    for i in range(first, end):
        b = bodies[i]
        if b[6] == 0.0:
            b[:6] = free[i] = 0.0
            continue
        square = b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
        slower = most / math.sqrt(square) if square > most * most else 1.0
        for c in range(6):
            change = b[c] - free[i, c]
            free[i, c] = b[c] * slower + work.gravity[c] * h if c < 3 else b[c]
            b[c] = free[i, c] + change


@bare_kernel
def _act(work, phase, first, end):  # type: ignore[no-untyped-def]
    """Do a phase of a step for sets of contacts, or for the blocks of bodies with these numbers."""
    rows, bodies, motion, fall, rounds = work.rows, work.bodies, work.motion, work.fall, work.rounds
    gravity = work.gravity
    size = math.sqrt(gravity[0] ** 2 + gravity[1] ** 2 + gravity[2] ** 2)
    unit = size if size > 0.0 else 1.0
    axis, h = (gravity[0] / unit, gravity[1] / unit, gravity[2] / unit), fall.step / fall.substeps
    for s in range(first, end):
        begin, stop = rounds.ends[s], rounds.ends[s + 1]
        if phase == FREE:
            _move_freely(work, rounds.bodies[s], rounds.bodies[s + 1])
        elif phase == TAKE_OVER:
            _take_over(work, axis, begin, stop)
        elif phase == NOTE:
            _note_approach(rows, work.free, work.approach, begin, stop)
        elif phase == MOVE:
            for i in range(rounds.bodies[s], rounds.bodies[s + 1]):
                for c in range(6):
                    motion[i, c] += h * bodies[i, c]
        elif phase == GIVE_BACK:
            for k in range(begin, stop):
                for column in range(10, 14):
                    work.found[rounds.rows[k], column] = rows.row[k, column]
        else:
            _sweep(rows, bodies, motion, axis, fall, work.approach, phase == FORTH, begin, stop)


@kernel
def _act_in_turn(work, plan):  # type: ignore[no-untyped-def]
    """Do the phases of a step one after the other."""
    for phase, first, end in plan:
        _act(work, phase, first, end)


def advance_bodies(
    rows: ContactRows, m: int, bodies: Floats, motion: Floats, gravity: Floats, fall: Fall, part: float,
    approach: Floats,
) -> None:  # fmt: skip
    """Advance velocities and impulses by a step, and write the motions (n + 1, 6) of the bodies.

    gravity: (3,) acceleration.  part: factor on the impulses of the step before.  approach: (m,) to work with, where
    bodies rebound.
    """
    rounds = rounds_of(rows.i[:m], rows.j[:m], len(bodies))
    motion[:] = 0.0
    found, many = rows.row, len(rounds.bodies) > 2
    if many:
        # old rows are not needed after a search: there is room for rows in the order of the rounds
        rows = rows._replace(row=rows.old, i=rows.i[rounds.rows], j=rows.j[rounds.rows])
        fall = fall._replace(friction=rounds.of_each(np.asarray(fall.friction, dtype=np.float64)))
    work = StepWork(found, rows, bodies, motion, gravity, fall, part, approach, bodies[:, :6].copy(), rounds)
    spans = list(pairwise(rounds.sets.tolist()))
    first, plan = spans[0], []
    for substep in range(fall.substeps):
        plan.append((FREE, *first))
        if not substep:
            plan += [(TAKE_OVER, *span) for span in spans]
        if fall.restitution > 0.0:
            plan += [(NOTE, *span) for span in spans]
        plan += [*((FORTH, *span) for span in spans), (MOVE, *first), *((BACK, *span) for span in reversed(spans))]
    if not many:
        _act_in_turn(work, np.array(plan))
        return
    for phase, begin, end in [*plan, (GIVE_BACK, 0, len(rounds.ends) - 1)]:
        in_blocks(_act, end - begin, work, phase, begin=begin)


@kernel
def move_bodies(position: Floats, orientation: Floats, matrix: Floats, motion: Floats, radius: Floats, way: Floats,
    most: float) -> float:  # fmt: skip
    """Translate and rotate grains by motions (n, 6), each point by no more than `most`; return the largest translation.

    `way` grows by a bound of how far any point of the surface moves. Also writes the rotation matrices.
    """
    far = 0.0
    for i in range(len(position)):
        dx, dy, dz = motion[i, 0], motion[i, 1], motion[i, 2]
        wx, wy, wz = motion[i, 3], motion[i, 4], motion[i, 5]
        shift = math.sqrt(dx * dx + dy * dy + dz * dz)
        angle = math.sqrt(wx * wx + wy * wy + wz * wz)
        if shift > most:
            part = most / shift
            dx, dy, dz, shift = dx * part, dy * part, dz * part, most
        if angle * radius[i] > most:
            part = most / (angle * radius[i])
            wx, wy, wz, angle = wx * part, wy * part, wz * part, angle * part
        position[i, 0] += dx
        position[i, 1] += dy
        position[i, 2] += dz
        way[i] += shift + angle * radius[i]
        far = max(far, shift)
        half = 0.5 * angle
        sine = math.sin(half) / angle if angle > 1e-12 else 0.5
        turn, wx, wy, wz = math.cos(half), wx * sine, wy * sine, wz * sine
        a, b, c, d = orientation[i, 0], orientation[i, 1], orientation[i, 2], orientation[i, 3]
        p = turn * a - wx * b - wy * c - wz * d
        q = turn * b + wx * a + wy * d - wz * c
        r = turn * c + wy * a + wz * b - wx * d
        s = turn * d + wz * a + wx * c - wy * b
        norm = 1.0 / math.sqrt(p * p + q * q + r * r + s * s)
        orientation[i, 0], orientation[i, 1], orientation[i, 2], orientation[i, 3] = (
            p * norm,
            q * norm,
            r * norm,
            s * norm,
        )
        rotate(orientation[i], matrix[i])
    return far


@bare_kernel
def rotate(q: Floats, matrix: Floats) -> None:
    """Write the rotation matrix of a unit quaternion."""
    a, b, c, d = q[0], q[1], q[2], q[3]
    matrix[0, 0] = 1.0 - 2.0 * (c * c + d * d)
    matrix[0, 1] = 2.0 * (b * c - a * d)
    matrix[0, 2] = 2.0 * (b * d + a * c)
    matrix[1, 0] = 2.0 * (b * c + a * d)
    matrix[1, 1] = 1.0 - 2.0 * (b * b + d * d)
    matrix[1, 2] = 2.0 * (c * d - a * b)
    matrix[2, 0] = 2.0 * (b * d - a * c)
    matrix[2, 1] = 2.0 * (c * d + a * b)
    matrix[2, 2] = 1.0 - 2.0 * (b * b + c * c)


@kernel
def write_matrices(orientation: Floats, matrix: Floats) -> None:
    """Write the rotation matrices (n, 3, 3) of unit quaternions (n, 4)."""
    for i in range(len(orientation)):
        rotate(orientation[i], matrix[i])
