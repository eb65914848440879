"""Which grains rest under the best forces: a search in the whole bed, and clusters that are solved alone.

A search in a whole bed converges slowly to the best forces, and its error is bounded for all grains together only.
Grains that do not rest lie in small clusters, of which two questions are asked that cost less. First, can any forces of
the neighbours hold the cluster? The neighbours are fixed, and their forces are free; if a grain moves even then, no
forces of the whole bed hold the cluster. Second, do the grains of the cluster rest if only the forces nearby change?
The search goes on for grains that are neither proven to move nor found to rest.
"""

from typing import TypeAlias

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.settling.balance import LoadedContacts, masses_of, net_accelerations
from voxgran.settling.cell import INVERSE_MASS, INVERSE_MOMENT
from voxgran.settling.projected_gradient import accelerated_projected_gradient, excess_at

#: iterations of the first round, while each further round has twice as many; largest share of moving grains with which
#: clusters are solved; share of undecided grains below which the search ends, and part to which a round must reduce it
FIRST, FEW, ENOUGH, FEWER = 512, 0.02, 5e-4, 0.5
#: part of the distance from the optimum to which the search goes on for undecided grains
NEARER = 0.25
#: size of a cluster about the grains in question, in contacts: of a cluster among fixed neighbours, one more in each
#: round, and of a cluster whose forces change while all others are held; most iterations for each
ALONE, HELD, LOCAL = 1, 4, 2048
#: an acceleration that none exceeds
ANY = 1e30

#: contacts near some bodies, which rows they are, which bodies, and which of these are fixed for that
Part: TypeAlias = tuple[LoadedContacts, Integers, Integers, Booleans]


def decide_rest(
    contacts: LoadedContacts, forces: Floats, friction: Floats, *, limit: Floats, near: float, iterations: int
) -> tuple[Booleans, int, float]:
    """Change forces (m, 3) to those that balance bodies best; return which ones (n,) are undecided.

    Return also the iterations made, and the distance from the optimum as `accelerated_projected_gradient` does.

    friction: (m,) or (1,).  limit: (n + 1, 2) accelerations up to which bodies rest, and those of points at their
    radius of gyration.  near: distance from the optimum at which the search ends where no grains are undecided.
    """
    proven, made, size, before, hops = np.zeros(len(limit), dtype=bool), 0, FIRST, len(limit), ALONE
    while True:
        # what is proven to move is no reason to go on
        asked = np.where(proven[:, None], ANY, limit)
        found, more, distance = accelerated_projected_gradient(
            contacts, forces, friction=friction, iterations=min(size, iterations - made), tolerance=asked, near=near
        )
        made += more
        moving, close, last = _moves(contacts, found, asked), distance <= near, made >= iterations
        few = moving.sum() <= FEW * len(limit)
        if few and moving.any():
            proven |= moving & _part_moves(contacts, forces, friction, limit, _part_of(contacts, moving, hops), size)
            asked = np.where(proven[:, None], ANY, limit)
            moving = _solve_part(contacts, forces, friction, asked, moving & ~proven, size)
        elif last or close:
            moving &= ~_moves(contacts, found, limit, _errors(contacts, forces, friction, found))
        left = int(moving.sum())
        if last or not left or ((few or close) and (left < ENOUGH * (len(limit) - 1) or left > FEWER * before)):
            return moving[:-1], made, distance
        near *= NEARER if close else 1.0
        size, before, hops = 2 * size, left if few or close else before, hops + 1


def _moves(contacts: LoadedContacts, found: Floats, limit: Floats, error: Floats | None = None) -> Booleans:
    """Return which bodies (n + 1,) accelerate by more than their limit and an error, which is weighted by mass."""
    root = np.sqrt(masses_of(contacts))
    beyond = linear.norm(found.reshape(-1, 2, 3), axis=2) * root - limit * root[:, :1]
    return np.asarray(beyond.max(axis=1) > (0.0 if error is None else error))


def _errors(contacts: LoadedContacts, forces: Floats, friction: Floats, found: Floats) -> Floats:
    """Return estimates (n + 1,) of how far the accelerations of bodies are from the optimal ones, weighted by mass.

    An estimate is the bound of the contacts of a body and of its neighbours.
    """
    part = np.maximum(excess_at(contacts, forces, friction, found), 0.0)
    i, inner, size = contacts.i, contacts.j >= 0, len(found)
    one, other = i[inner], contacts.j[inner]
    own = np.bincount(i, part, size) + np.bincount(other, part[inner], size)
    return np.sqrt(own + np.bincount(one, own[other], size) + np.bincount(other, own[one], size))


def _part_moves(
    contacts: LoadedContacts, forces: Floats, friction: Floats, limit: Floats, near: Part, size: int
) -> Booleans:
    """Return which bodies (n + 1,) of a part move whatever the forces on the bodies of the part are."""
    part, rows, own, _ = near
    push, rub, moves = forces[rows], friction[rows] if len(friction) > 1 else friction, np.zeros(len(limit), dtype=bool)
    found, _, _ = accelerated_projected_gradient(
        part, push, friction=rub, iterations=min(LOCAL, size * len(contacts.i) // max(len(rows), 1)),
        tolerance=limit[own], near=-1.0,
    )  # fmt: skip
    moves[own] = _moves(part, found, limit[own], _errors(part, push, rub, found))
    return moves


def _solve_part(
    contacts: LoadedContacts, forces: Floats, friction: Floats, asked: Floats, some: Booleans, size: int
) -> Booleans:
    """Change forces near some bodies (n + 1,), all that move by more than asked, to those that balance the part best.

    Return which bodies still move, those included that did not before; forces stay where more would.
    """
    part, rows, own, outside = _part_of(contacts, some, HELD)
    changed, push = forces.copy(), forces[rows]
    accelerated_projected_gradient(
        part, push, friction=friction[rows] if len(friction) > 1 else friction,
        iterations=min(LOCAL, size * len(contacts.i) // max(len(rows), 1)), tolerance=asked[own], near=-1.0,
        held=outside[part.i] | (outside[part.j] & (part.j >= 0)),
    )  # fmt: skip
    changed[rows] = push
    moving = _moves(contacts, net_accelerations(contacts, changed), asked)
    if moving.sum() > some.sum():
        return some
    forces[rows] = push
    return moving


def _part_of(contacts: LoadedContacts, some: Booleans, hops: int) -> Part:
    """Return the contacts of some bodies (n + 1,) and of those that are a few contacts away, all others fixed.

    Return also which rows they are, which bodies, of which the lid is the last, and which of these are fixed for that.
    """
    last, bodies = len(some) - 1, contacts.bodies
    inner = (contacts.j >= 0) & (contacts.j < last)
    one, other = contacts.i[inner], contacts.j[inner]
    for _ in range(hops):
        more = some.copy()
        more[one[some[other]]] = more[other[some[one]]] = True
        some = more
    rows = np.flatnonzero(some[contacts.i] | (inner & some[contacts.j]))
    i, j = contacts.i[rows], contacts.j[rows]
    own = np.append(np.union1d(i, j[inner[rows]]), last)
    place, bodies = np.full(last + 1, -1), bodies[own]
    place[own] = np.arange(len(own))
    outside = (bodies[:, INVERSE_MASS] > 0.0) & ~some[own]
    bodies[outside, INVERSE_MASS : INVERSE_MOMENT + 1] = 0.0
    part = contacts._replace(row=contacts.row[rows], i=place[i], j=np.where(j < 0, j, place[j]), bodies=bodies)
    return part, rows, own, outside
