"""Forces at contacts, within their friction cones, with which grains do what the law of Coulomb says.

The unknowns are forces f, one for each contact, which act on its body j and with opposite sign on its body i. They
give the bodies accelerations a = gravity + (sum of forces and of their moments) / (mass and moment of inertia). A
quasi-static step of length dt moves bodies by a dt^2 from rest, so that its contacts obey ``0 <= f_n, 0 <= a_n + gap /
dt^2 + skin f_n``, and one of both is 0; across the normal a force of friction is at most `friction` times as large as
f_n, a number for all contacts or one for each. Without the gaps it is the question whether the bodies rest.

With the law of Coulomb sliding does not open contacts, so that the problem is not convex. A convex problem close to it
proves whether bodies rest (:mod:`voxgran.settling.projected_gradient`). The sweeps have the momentum of Nesterov
with restarts (O'Donoghue & Candes 2015, doi:10.1007/s10208-013-9150-3).
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.compiling.threads import in_blocks
from voxgran._base.kernels import bare_kernel
from voxgran.contacts.manifolds.rounds import Rounds, rounds_of
from voxgran.geometry.vectors import add, along, dot, sub, times, vector_at
from voxgran.settling.cell import (
    INVERSE_MASS,
    INVERSE_MOMENT,
    NONE,
    RIGID,
    Cell,
    add_forces,
    add_to_both,
    add_to_cell,
    approach_of,
    branch_of,
    effective_at,
    effective_cell,
    strained,
)

#: numbers in a row of work: normal (3), arms (6), openness, steps along the normal and across it; then two forces (3):
#: that of now, and that of the iteration before
WORK = 18


class LoadedContacts(NamedTuple):
    """Contacts of bodies under gravity, in a container that may be pressed.

    row: (m, 16) rows of the contacts.  i, j: (m,) their bodies; j is negative at a wall, and n at the lid.
    bodies: (n + 1, 8) rows of the grains and of the lid, or 11 columns where slender grains roll.  gravity: (3,)
    acceleration.  cell: how the container deforms; then there is no lid.
    """

    row: Floats
    i: Integers
    j: Integers
    bodies: Floats
    gravity: Floats
    cell: Cell = RIGID


class Sweeps(NamedTuple):
    """Arrays that the sweeps use.

    contacts: with bodies in the order of the rounds.  work: (m, 18) rows of `fill_work` in that order.  state: rows of
    bodies with accelerations, inverse masses and moments.  friction: (m,) or (1,).  accelerations: (n + 1, 6) of the
    iteration before.  ahead: (n + 1, 6) extrapolated ones.  sums: for each set, squares of the change since the
    iteration before and of the forces, and by how much bodies turn back.  pace: the numbers t and momentum.
    """

    contacts: LoadedContacts
    work: Floats
    state: Floats
    friction: Floats
    skin: float
    accelerations: Floats
    ahead: Floats
    rounds: Rounds
    sums: Floats
    pace: Floats


def masses_of(contacts: LoadedContacts) -> Floats:
    """Return the masses and moments of inertia (n + 1, 2) of bodies; of fixed ones they are 0."""
    inverse = contacts.bodies[:, INVERSE_MASS : INVERSE_MOMENT + 1]
    return np.where(inverse > 0.0, 1.0 / np.where(inverse > 0.0, inverse, 1.0), 0.0)


def net_accelerations(contacts: LoadedContacts, forces: Floats) -> Floats:
    """Return the accelerations (n + 1, 6) of bodies under gravity and under the forces (m, 3) at contacts.

    The first three are those of the centroids, in units of gravity; then the angular ones. Bodies without inverse mass
    are fixed.
    """
    accelerations = np.zeros((len(contacts.bodies), 6))
    add_forces(contacts, forces, accelerations)
    return accelerations


def gauss_seidel_forces(
    contacts: LoadedContacts, forces: Floats, openness: Floats, *, friction: float | Floats, skin: float,
    iterations: int, tolerance: float = 1e-6,
) -> tuple[Floats, int]:  # fmt: skip
    """Change the forces (m, 3) to those of a quasi-static step; return accelerations (n + 1, 6) and iterations made.

    Projected Gauss-Seidel sweeps over the contacts, forwards and backwards in turn, with the momentum of Nesterov and
    restarts. An iteration is two sweeps.

    forces: the first guess, changed in place.  openness: (m,) gaps divided by the square of the length of the step.
    skin: acceleration by which a contact may approach for a unit of its force.  tolerance: relative change of the
    forces in an iteration at which they end.
    """
    count = len(contacts.bodies)
    rounds = rounds_of(contacts.i, contacts.j, count, shared=len(contacts.cell.mobility) > 0)
    rows, work = rounds.rows, np.empty((len(contacts.i), WORK))
    fill_work(contacts, forces, openness, skin, np.ones(count), rows, work)
    accelerations, state, ahead = net_accelerations(contacts, forces), contacts.bodies.copy(), np.empty((count, 6))
    state[:, :6] = accelerations
    rub = np.array(friction, dtype=np.float64, ndmin=1)
    visited = contacts._replace(i=contacts.i[rows], j=contacts.j[rows])
    sums, pace = np.zeros((len(rounds.ends) - 1, 3)), np.array([1.0, 0.0])
    sweeps = Sweeps(visited, work, state, rounds.of_each(rub), skin, accelerations, ahead, rounds, sums, pace)
    made = (_gauss_seidel if len(rounds.bodies) == 2 else _gauss_seidel_at_once)(sweeps, iterations, tolerance)
    forces[rows] = work[:, 12:15]
    return net_accelerations(contacts, forces), made


@bare_kernel
def fill_work(
    contacts: LoadedContacts, forces: Floats, openness: Floats, skin: float, share: Floats, rows: Integers,
    work: Floats,
) -> None:  # fmt: skip
    """Write rows of `WORK` numbers of the contacts, in the order of `rows`.

    share: (n + 1,) in how many parts the mass of a body is split among its contacts; 1 where they are solved in turn.
    """
    bodies, gravity, last = contacts.bodies, contacts.gravity, len(contacts.bodies) - 1
    cell, deforms = contacts.cell, len(contacts.cell.mobility) > 0
    for q in range(len(work)):
        k = rows[q]
        c, w, one, other = contacts.row[k], work[q], contacts.i[k], contacts.j[k]
        normal, across = effective_at(c, 3, bodies[one], share[one])
        if other == last:
            cosine = c[0] * gravity[0] + c[1] * gravity[1] + c[2] * gravity[2]
            normal += share[last] * bodies[last, 6] * (abs(cosine) if share[one] > 1.0 else cosine * cosine)
            across += share[last] * bodies[last, 6] * math.sqrt(max(1.0 - cosine * cosine, 0.0))
        elif other >= 0:
            more = effective_at(c, 6, bodies[other], share[other])
            normal, across = normal + more[0], across + more[1]
            if other == one:
                # of a grain and its own image, whose arms point opposite ways
                normal, across = 2.0 * normal, 2.0 * across
        if deforms:
            along_branch, across_it = effective_cell(cell.mobility, vector_at(c, 0), branch_of(c))
            normal, across = normal + along_branch, across + across_it
        for s in range(9):
            w[s] = c[s]
        # of two fixed bodies there is nothing to solve for
        w[9] = openness[k]
        w[10] = 1.0 / (normal + skin) if normal > 0.0 else 0.0
        w[11] = 1.0 / across if across > 0.0 else 0.0
        for s in range(3):
            w[12 + s] = w[15 + s] = forces[k, s]


@bare_kernel
def _gauss_seidel(sweeps, iterations, tolerance):  # type: ignore[no-untyped-def]
    """Solve for the forces in rows that are a single set, and return the number of iterations."""
    made, sums = 0, sweeps.sums
    while made < iterations:
        _visit(sweeps, True, True, 0, 1)
        made += 1
        if sums[0, 0] <= tolerance * tolerance * sums[0, 1]:
            break
        set_momentum(sweeps.pace, sums[0, 2])
    return made


def _gauss_seidel_at_once(sweeps: Sweeps, iterations: int, tolerance: float) -> int:
    """Do what `_gauss_seidel` does on all threads, round by round, the last one forwards and backwards in one."""
    spans = list(pairwise(sweeps.rounds.sets.tolist()))
    turns = [*((span, True, False) for span in spans[:-1]), (spans[-1], True, True)]
    turns += [(span, False, True) for span in spans[-2::-1]]
    made = 0
    while made < iterations:
        for (first, end), forth, back in turns:
            in_blocks(_visit, end - first, sweeps, forth, back, begin=first)
        made += 1
        change, size, turned = sweeps.sums.sum(axis=0)
        if change <= tolerance * tolerance * size:
            break
        set_momentum(sweeps.pace, turned)
    return made


@bare_kernel
def _visit(sweeps, forth, back, first, end):  # type: ignore[no-untyped-def]
    """Visit sets of contacts on the way forwards, backwards, or both; the first round also moves bodies ahead.

    The momentum begins anew where the accelerations move back from the extrapolated ones.
    """
    rounds, state, sums, momentum = sweeps.rounds, sweeps.state, sweeps.sums, sweeps.pace[1]
    ahead, accelerations = sweeps.ahead, sweeps.accelerations
    for s in range(first, end):
        own = s < len(rounds.bodies) - 1
        if forth:
            for k in range(rounds.bodies[s] if own else 0, rounds.bodies[s + 1] if own else 0):
                for c in range(6):
                    here = state[k, c]
                    state[k, c] = ahead[k, c] = here + momentum * (here - accelerations[k, c])
                    accelerations[k, c] = here
            _sweep(sweeps, False, rounds.ends[s], rounds.ends[s + 1])
        if back:
            sums[s, 0], sums[s, 1] = _sweep(sweeps, True, rounds.ends[s], rounds.ends[s + 1])
            sums[s, 2] = _turned(sweeps, rounds.bodies[s], rounds.bodies[s + 1]) if own else 0.0


@bare_kernel
def _turned(sweeps, first, end):  # type: ignore[no-untyped-def]
    """Return the product, by mass, of the way back from extrapolated accelerations with the change in an iteration."""
    state, ahead, before, mobility = sweeps.state, sweeps.ahead, sweeps.accelerations, sweeps.contacts.cell.mobility
    turned = 0.0
    for k in range(first, end):
        for c in range(6):
            inverse = state[k, 6 + c // 3]
            if inverse > 0.0:
                turned += (ahead[k, c] - state[k, c]) * (state[k, c] - before[k, c]) / inverse
    last = len(state) - 1
    for c in range(len(mobility)):
        if mobility[c, c] > 0.0:
            # strains of a container that deforms stand in the last row
            turned += (ahead[last, c] - state[last, c]) * (state[last, c] - before[last, c]) / mobility[c, c]
    return turned


@bare_kernel
def _sweep(sweeps, backwards, begin, end):  # type: ignore[no-untyped-def]
    """Visit contacts once; extrapolate their forces on the way forwards, and compare them on the way backwards.

    Return, of the way backwards, the square of the change since the iteration before, and that of the forces.
    """
    contacts, work, state, friction, skin = sweeps.contacts, sweeps.work, sweeps.state, sweeps.friction, sweeps.skin
    momentum, last, own, change, size = sweeps.pace[1], len(state) - 1, len(friction) - 1, 0.0, 0.0
    mobility, deforms = contacts.cell.mobility, len(contacts.cell.mobility) > 0
    for q in range(begin, end):
        k = begin + end - 1 - q if backwards else q
        c, one, other = work[k], contacts.i[k], contacts.j[k]
        normal, force = vector_at(c, 0), vector_at(c, 12)
        if not backwards:
            ahead = along(force, momentum, sub(force, vector_at(c, 15)))
            c[15], c[16], c[17] = force
            force = ahead
        apart = approach_of(c, state, one, other)
        if deforms:
            apart = add(apart, strained(state[last], branch_of(contacts.row[k])))
        un, fn = dot(apart, normal), dot(force, normal)
        push = fn - c[10] * (un + c[9] + skin * fn)
        pressed = NONE
        if push > 0.0:
            limit, part = friction[min(k, own)] * push, 1.0
            across = along(along(force, -fn, normal), -c[11], along(apart, -un, normal))
            square = dot(across, across)
            if square > limit * limit:
                part = limit / math.sqrt(square)
            pressed = along(times(normal, push), part, across)
        c[12], c[13], c[14] = pressed
        if backwards:
            step = sub(pressed, vector_at(c, 15))
            change += dot(step, step)
            size += dot(pressed, pressed)
        more = sub(pressed, force)
        if more == NONE:
            continue
        add_to_both(state, state, contacts.gravity, c, one, other, more)
        if deforms:
            add_to_cell(state[last], mobility, more, branch_of(contacts.row[k]))
    return change, size


@bare_kernel
def set_momentum(state: Floats, turned: float) -> None:
    """Write the next t and momentum, anew where the forces have turned back."""
    t = 1.0 if turned > 0.0 else state[0]
    state[0] = (1.0 + math.sqrt(1.0 + 4.0 * t * t)) / 2.0
    state[1] = (t - 1.0) / state[0]
