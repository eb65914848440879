"""Forces at contacts, within their friction cones, that balance the weights of grains best.

Half the sum of squared accelerations, weighted by mass and moment of inertia, is minimised over the friction cones.
Unlike the law of Coulomb (:mod:`voxgran.settling.balance`), this is a convex problem. If grains can rest, its solution
has forces with which they do.

References
----------
Anitescu & Tasora 2010, An iterative approach for cone complementarity problems for nonsmooth dynamics,
doi:10.1007/s10589-008-9223-4
Mazhar, Heyn, Negrut & Tasora 2015, Using Nesterov's method to accelerate multibody dynamics with friction and contact,
doi:10.1145/2735627
O'Donoghue & Candes 2015, Adaptive restart for accelerated gradient schemes, doi:10.1007/s10208-013-9150-3
"""

import math

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.compiling.threads import in_blocks
from voxgran._base.kernels import bare_kernel, inlined_kernel, kernel
from voxgran._base.stopping import stop_if_asked
from voxgran.geometry.vectors import along, cross, dot, sub, times, vector_at
from voxgran.settling.balance import WORK, LoadedContacts, fill_work, masses_of, net_accelerations, set_momentum
from voxgran.settling.cell import NONE, add_to_both, approach_of

#: iterations between two looks at the distance from the optimum
AT_ONCE = 16
#: share of the bodies that is few, and share of those that accelerate to which they become fewer but slowly
FEW, SLOWLY = 0.1, 0.97
#: rows from which on forces are found by all threads, and rows of which the turning back is summed on its own
MANY, BLOCK = 100_000, 8192


def accelerated_projected_gradient(
    contacts: LoadedContacts, forces: Floats, *, friction: float | Floats, iterations: int, tolerance: float | Floats,
    near: float, patience: int | None = None, held: Booleans | None = None,
) -> tuple[Floats, int, float]:  # fmt: skip
    """Change the forces (m, 3), within their friction cones, to those that balance all bodies best.

    Return the accelerations (n + 1, 6) that are left, the number of iterations made, and an estimate of how far the
    accelerations are from the optimal ones, which are unique: the root mean square of the difference, weighted by mass.

    forces: the first guess, changed in place.  tolerance: the iterations end where no body accelerates by more, nor its
    points at the radius of gyration; one for all, or (n + 1, 2).  near: they also end at this distance from the
    optimum.  patience: iterations after which they also end where few bodies accelerate by more than the tolerance, and
    these hardly become fewer.  held: (m,) which forces do not change.
    """
    m, j, last = len(contacts.i), contacts.j, len(contacts.bodies) - 1
    work, rub = np.empty((m, WORK)), np.array(friction, dtype=np.float64, ndmin=1)
    share = np.bincount(contacts.i, minlength=last + 1) + np.bincount(j[j >= 0], minlength=last + 1)
    fill_work(contacts, forces, np.zeros(m), 0.0, np.maximum(share, 1).astype(np.float64), np.arange(m), work)
    if held is not None:
        work[held, 10:12] = 0.0
    accelerations = net_accelerations(contacts, forces)
    new, extrapolated, state = accelerations.copy(), accelerations.copy(), np.array([1.0, 0.0])
    masses = masses_of(contacts)
    lists = _rows_of_bodies(contacts) if m >= MANY else None
    made, distance, least, improved = 0, math.inf, FEW * last, 0
    while made < iterations:
        stop_if_asked()
        for _ in range(min(AT_ONCE, iterations - made)):
            if lists is None:
                _descend(contacts, work, rub, accelerations, new, extrapolated, state)
            else:
                _descend_at_once(contacts, work, rub, accelerations, extrapolated, state, lists)
            made += 1
        # squares of the motions, by mass; the optimum, which has the least sum, is no farther than they are large
        squares = (accelerations.reshape(-1, 2, 3) ** 2).sum(axis=2) * masses
        excess = float(excess_at(contacts, work[:, 12:15].copy(), rub, accelerations).sum())
        distance = math.sqrt(min(max(excess, 0.0), float(squares.sum())) / max(float(masses[:, 0].sum()), 1e-300))
        moving = np.sqrt(squares) > tolerance * np.sqrt(masses[:, :1])
        if not moving.any() or distance <= near:
            break
        left = int(moving.any(axis=1).sum())
        if left > FEW * last or left < SLOWLY * least:
            least, improved = min(left, least), made
        if patience is not None and made - improved >= patience:
            break
    forces[:m] = work[:, 12:15]
    return net_accelerations(contacts, forces), made, distance


def _rows_of_bodies(contacts: LoadedContacts) -> tuple[Integers, Integers]:
    """Return where the rows of each body begin in a list, (n + 2,), and the list: twice the row, and 1 more for j."""
    bodies = np.stack([contacts.i, contacts.j], axis=1).ravel()
    ends = np.argsort(bodies, kind="stable")
    return np.searchsorted(bodies[ends], np.arange(len(contacts.bodies) + 1)), ends


def _descend_at_once(
    contacts: LoadedContacts, work: Floats, friction: Floats, accelerations: Floats, extrapolated: Floats,
    state: Floats, lists: tuple[Integers, Integers],
) -> None:  # fmt: skip
    """Do what `_descend` does on all threads: first forces, by row, then what they do, by body.

    The forces on a body are added in the order of the rows, as there: results have the same bits for any number of
    threads. lists: the rows of each body.
    """
    turned = np.empty(-(-len(work) // BLOCK))
    in_blocks(_project_blocks, len(turned), contacts, work, friction, extrapolated, state, turned)
    set_momentum(state, float(turned.sum()))
    in_blocks(_add_up, len(accelerations), contacts, work, *lists, accelerations, extrapolated, state)


@bare_kernel
def _descend(contacts, work, friction, accelerations, new, extrapolated, state):  # type: ignore[no-untyped-def]
    """Make one iteration of the projected gradient: a step from the extrapolated forces, and the next momentum.

    accelerations: under the forces, new: to be written, extrapolated: under the extrapolated forces.  state: the two
    numbers t and momentum.
    """
    bodies, gravity, turned, own = contacts.bodies, contacts.gravity, 0.0, len(friction) - 1
    for k in range(len(bodies)):
        free = 1.0 if bodies[k, 6] > 0.0 else 0.0
        for s in range(3):
            new[k, s], new[k, 3 + s] = free * gravity[s], 0.0
    for k in range(len(work)):
        c, one, other = work[k], contacts.i[k], contacts.j[k]
        force, back = _projected(c, approach_of(c, extrapolated, one, other), state[1], friction[min(k, own)])
        turned += back
        if force != NONE:
            add_to_both(new, bodies, gravity, c, one, other, force)
    set_momentum(state, turned)
    for k in range(len(bodies)):
        for s in range(6):
            here = new[k, s]
            extrapolated[k, s] = here + state[1] * (here - accelerations[k, s])
            accelerations[k, s] = here


@inlined_kernel
def _projected(c, apart, momentum, friction):  # type: ignore[no-untyped-def]
    """Make a step of the force of a contact within its cone; return the force, and by how much it turns back."""
    before, normal = vector_at(c, 12), vector_at(c, 0)
    ahead = along(before, momentum, sub(before, vector_at(c, 15)))
    c[15], c[16], c[17] = before
    un, fn = dot(apart, normal), dot(ahead, normal)
    sn, st, turned = c[10], c[11], 0.0
    across = along(along(ahead, -fn, normal), -st, along(apart, -un, normal))
    push, part = _onto_cone(fn - sn * un, math.sqrt(dot(across, across)), friction, sn, st)
    force = along(times(normal, push), part, across)
    c[12], c[13], c[14] = force
    step, back = sub(force, before), sub(ahead, force)
    if sn > 0.0 and st > 0.0:
        product = dot(step, normal) * dot(back, normal)
        turned = product / sn + (dot(back, step) - product) / st
    return force, turned


@bare_kernel
def _project_blocks(contacts, work, friction, extrapolated, state, turned, first, end):  # type: ignore[no-untyped-def]
    """Make a step of the forces in blocks of rows, and write by how much those of each block turn back."""
    own = len(friction) - 1
    for block in range(first, end):
        total = 0.0
        for k in range(block * BLOCK, min((block + 1) * BLOCK, len(work))):
            c = work[k]
            apart = approach_of(c, extrapolated, contacts.i[k], contacts.j[k])
            total += _projected(c, apart, state[1], friction[min(k, own)])[1]
        turned[block] = total


@bare_kernel
def _add_up(contacts, work, begin, ends, accelerations, extrapolated, state, first, end):  # type: ignore[no-untyped-def]
    """Write the accelerations of bodies under the forces in their rows, and extrapolate them."""
    bodies, gravity, momentum = contacts.bodies, vector_at(contacts.gravity, 0), state[1]
    for k in range(first, end):
        mass, moment = bodies[k, 6], bodies[k, 7]
        moved, turned = times(gravity, 1.0 if mass > 0.0 else 0.0), NONE
        for e in range(begin[k], begin[k + 1]):
            c = work[ends[e] // 2]
            force = vector_at(c, 12)
            if force == NONE:
                continue
            if k == len(bodies) - 1:
                # a lid moves along gravity only
                moved = along(moved, mass * dot(force, gravity), gravity)
            elif ends[e] % 2:
                moved, turned = along(moved, mass, force), along(turned, moment, cross(vector_at(c, 6), force))
            else:
                moved, turned = along(moved, -mass, force), along(turned, -moment, cross(vector_at(c, 3), force))
        for s, here in enumerate((*moved, *turned)):
            extrapolated[k, s] = here + momentum * (here - accelerations[k, s])
            accelerations[k, s] = here


@bare_kernel
def _onto_cone(push, rub, friction, sn, st):  # type: ignore[no-untyped-def]
    """Return the normal force, and the factor on the force across, of the nearest point of a friction cone.

    It is the nearest one in the metric in which the steps sn along the normal and st across it are those of a gradient.
    """
    if push >= 0.0 and rub <= friction * push:
        return push, 1.0
    metric = sn / st if st > 0.0 else 0.0
    nearest = (push + friction * rub * metric) / (1.0 + friction * friction * metric)
    if nearest <= 0.0:
        return 0.0, 0.0
    return nearest, friction * nearest / rub if rub > 0.0 else 0.0


@kernel
def excess_at(contacts: LoadedContacts, forces: Floats, friction: Floats, accelerations: Floats) -> Floats:
    """Return parts (m,) of a bound of the squared distance from the optimum in accelerations, weighted by mass.

    The accelerations of the optimum are the least ones within a convex set. The square of the distance from them is
    therefore at most the product of these accelerations with the distance, which is the power of the forces less that
    of the forces of the optimum. Where contact points approach each other, that is at most the approach times the
    normal force, which is taken to be at most that of now and a mean one. No part is below 0 but for rounding.
    """
    parts, mean, own = np.empty(len(forces)), 0.0, len(friction) - 1
    for k in range(len(forces)):
        mean += dot(vector_at(contacts.row[k], 0), vector_at(forces[k], 0)) / len(forces)
    for k in range(len(forces)):
        normal, force = vector_at(contacts.row[k], 0), vector_at(forces[k], 0)
        apart = approach_of(contacts.row[k], accelerations, contacts.i[k], contacts.j[k])
        un = dot(apart, normal)
        across = math.sqrt(max(dot(apart, apart) - un * un, 0.0))
        approach = max(friction[min(k, own)] * across - un, 0.0)
        parts[k] = dot(force, apart) + approach * (dot(force, normal) + mean)
    return parts
