"""Parting: the least motions that leave a small gap between all grains that overlap or are too near.

Grids of distances miss edges that meet edges, so that a gap which they give is too large by up to a few thousandths of
a diameter. Each pair whose surfaces are proven to be separate gets a room, by which its gaps are too large; the others
get more room in each round, and are parted.
"""

import math
from dataclasses import replace

import numpy as np

from voxgran._base.arrays import Booleans, Floats
from voxgran.contacts.assembly import Assembly
from voxgran.contacts.manifolds.rows import GAP, NORMAL, PUSH, SURFACE
from voxgran.containers.model import UNKNOWN, boundary_of
from voxgran.settling.balance import LoadedContacts, gauss_seidel_forces
from voxgran.settling.bed import Bed

#: rounds after which a solution gets more iterations: in beds of many layers under load
PATIENCE = 8
#: iterations of a solution, and the farthest that a grain moves in one round
ITERATIONS, MOST = 60, 0.02
#: distance up to which contacts are looked at, beyond that which is kept
MARGIN = 0.03
#: square of the length of a step, in which gravity moves nothing; its direction is that of the lid
MOMENT = 1e-12
#: motion of a pair, in that distance, up to which exact contacts of meshes are not found again
UNCHANGED = 0.1
#: share of the distance that may be missed, and first rounds in which contacts that bear forces are closed
MISSED, CLOSING = 0.2, 2
#: most rounds in which grains are spread, and the share of the gap that may be missed then
SPREADING, CLOSE = 40, 0.02
#: distance up to which gaps by grids are found, and up to which exact ones are
GRID, TRUE = 0.02, 3e-3
#: room by which pairs that are not proven to be separate are parted more in each round, at first and later
FIRST_ROOM, MORE_ROOM = 2e-3, 1e-3
#: least and largest room of a pair
LEAST_ROOM, MOST_ROOM = -5e-3, 0.05
#: distance to which they are parted, rounds of each parting, and gap up to which contacts are looked at
CLOSED, CLOSED_ROUNDS, CLOSED_MARGIN = 3e-4, 6, 0.01


def part_grains(
    bed: Bed, distance: float, rounds: int, *, missed: float = MISSED, most: float = MOST, margin: float = MARGIN,
    iterations: int = ITERATIONS, closed: float = math.inf,
) -> float:  # fmt: skip
    """Part grains until all surfaces are nearly `distance` apart, in at most `rounds` rounds; return the smallest gap.

    Each round solves for the least motions, weighted by mass, that open all gaps to first order: a quasi-static step
    without gravity and friction. The forces that the bed keeps do not change.

    missed: share of the distance that may be missed.  most: farthest that a grain moves in one round.
    margin: gap up to which contacts are looked at.  iterations: of the solution in the first rounds.
    closed: in the first rounds contacts that bear forces get no larger gap.
    """
    bodies = bed.bodies.copy()
    # a lid that moves has the mass of a grain here: sweeps converge slowly where masses differ much
    bodies[-1, 6] = 1.0 if bodies[-1, 6] > 0.0 else 0.0
    for turn in range(rounds + 1):
        # contacts of triangles hardly change where grains are not parted, and are carried along
        bed.find(distance + max(margin, most), distance, reuse=UNCHANGED * distance)
        smallest = float(bed.gap.min(initial=np.inf))
        contacts, gap = bed.contacts._replace(bodies=bodies), bed.gap
        bears = bed.rows.row[: bed.m, PUSH] > 0.0
        opened = turn < CLOSING and bool((gap[bears] > closed - (1.0 - missed) * distance).any())
        if (smallest > -missed * distance and not opened) or turn == rounds:
            break
        if opened:
            contacts, gap = _both_ways(contacts, gap, bears, closed - distance)
        accelerations, _ = gauss_seidel_forces(
            contacts, np.zeros((len(gap), 3)), gap / MOMENT,
            friction=0.0, skin=0.0, iterations=iterations * (1 + turn // PATIENCE),
        )  # fmt: skip
        bed.move(MOMENT * accelerations, most, carry=bed.finders.exact)
    return smallest + distance


def _both_ways(contacts: LoadedContacts, gap: Floats, some: Booleans, widest: float) -> tuple[LoadedContacts, Floats]:
    """Return contacts and gaps with, of some, those that bound the gap from above: they push the other way."""
    back = contacts.row[some]
    back[:, NORMAL : NORMAL + 3] *= -1.0
    i, j = (np.concatenate([bodies, bodies[some]]) for bodies in (contacts.i, contacts.j))
    row = np.concatenate([contacts.row, back])
    return contacts._replace(row=row, i=i, j=j), np.concatenate([gap, widest - gap[some]])


def spread(assembly: Assembly, room: float, up: Floats) -> Assembly:
    """Return the grains moved, where there is space, until their surfaces are some distance apart; they may overlap.

    `room` is the wanted distance of surfaces from each other and from walls, above 0, and `up` the direction along
    which grains are numbered. Orientations do not change. Where there is no space, gaps are left that are less. Open
    surfaces, and grains in containers whose walls are not known, stay where they are.
    """
    if any(shape.is_open for shape in assembly.shapes) or boundary_of(assembly.container) is UNKNOWN:
        return assembly
    bed = Bed(replace(assembly, lid=None), -np.asarray(up, dtype=np.float64), exact=True)
    bed.bodies[:, 7] = 0.0
    part_grains(bed, room, SPREADING, missed=CLOSE, most=room)
    return replace(assembly, position=bed.poses()[0])


def close_round(bed: Bed, *, first: bool) -> int:
    """Make a round of parting, and return the number of pairs that were not proven to be separate, or overlap, before.

    The contacts are those by grids. first: whether it is the first round.
    """
    bed.find(GRID, 0.0)
    pairs, rows = bed.pairs, bed.rows
    by_grid = np.full(len(pairs.i), np.inf)
    some = np.flatnonzero(pairs.count > 0)
    # the rows of a pair are next to each other
    gap = rows.row[: bed.m, GAP]
    for p in some[(bed.grains.kind[pairs.i[some]] == SURFACE) | (bed.grains.kind[pairs.j[some]] == SURFACE)]:
        by_grid[p] = gap[pairs.first[p] : pairs.first[p] + pairs.count[p]].min() + pairs.room[p]
    exact, proven, mixed = bed.finders.prove(bed.grains, pairs, rows, TRUE)
    known = np.isfinite(by_grid) & np.isfinite(exact) & proven
    pairs.room[known] = np.clip(by_grid[known] - exact[known], LEAST_ROOM, MOST_ROOM)
    wrong = mixed & ~proven
    more = FIRST_ROOM if first else MORE_ROOM
    least = np.where(np.isfinite(by_grid), np.maximum(pairs.room, by_grid), pairs.room)
    pairs.room[wrong] = np.minimum(np.maximum(least + more, 1.3 * pairs.room), MOST_ROOM)[wrong]
    # gaps at walls, and of pairs of other kinds, are exact
    overlapping = int((gap[_unroomed(bed)] < 0.0).sum())
    if wrong.any() or overlapping:
        part_grains(bed, CLOSED, CLOSED_ROUNDS, margin=CLOSED_MARGIN)
    return int(wrong.sum()) + overlapping


def _unroomed(bed: Bed) -> Booleans:
    """Return which contacts are none between a grain and a mesh that is not convex."""
    i, j = bed.rows.i[: bed.m], bed.rows.j[: bed.m]
    inner = (j >= 0) & (j < bed.count)
    kind = bed.grains.kind
    other = np.where(inner, j, 0)
    return np.asarray(~inner | ((kind[i] != SURFACE) & (kind[other] != SURFACE)))
