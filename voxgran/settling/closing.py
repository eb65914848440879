"""From contacts by grids of distances to the true surfaces of meshes that are not convex.

Grids of distances miss edges that meet edges, so that a gap which they give is too large by up to a few thousandths of
a diameter. Each pair whose surfaces are proven to be separate gets a room, by which its gaps are too large; the others
get more room in each round, and are parted.
"""

import numpy as np

from voxgran._base.arrays import Booleans
from voxgran.contacts.manifolds.rows import GAP, SURFACE
from voxgran.settling.bed import Bed
from voxgran.settling.parting import part_grains

#: distance up to which gaps by grids are found, and up to which exact ones are
FOUND, EXACT = 0.02, 3e-3
#: room by which pairs that are not proven to be separate are parted more in each round, at first and later
FIRST_ROOM, MORE_ROOM = 2e-3, 1e-3
#: least and largest room of a pair
LEAST, MOST = -5e-3, 0.05
#: distance to which grains are parted, rounds of each parting, and gap up to which contacts are looked at
KEPT, ROUNDS, MARGIN = 3e-4, 6, 0.01


def close_round(bed: Bed, *, first: bool) -> int:
    """Make a round of parting, and return the number of pairs that were not proven to be separate, or overlap, before.

    The contacts are those by grids. first: whether it is the first round.
    """
    bed.find(FOUND, 0.0)
    pairs, rows = bed.pairs, bed.rows
    by_grid = np.full(len(pairs.i), np.inf)
    some = np.flatnonzero(pairs.count > 0)
    # the rows of a pair are next to each other
    gap = rows.row[: bed.m, GAP]
    for p in some[(bed.grains.kind[pairs.i[some]] == SURFACE) | (bed.grains.kind[pairs.j[some]] == SURFACE)]:
        by_grid[p] = gap[pairs.first[p] : pairs.first[p] + pairs.count[p]].min() + pairs.room[p]
    exact, proven, mixed = bed.finders.prove(bed.grains, pairs, rows, EXACT)
    known = np.isfinite(by_grid) & np.isfinite(exact) & proven
    pairs.room[known] = np.clip(by_grid[known] - exact[known], LEAST, MOST)
    wrong = mixed & ~proven
    more = FIRST_ROOM if first else MORE_ROOM
    least = np.where(np.isfinite(by_grid), np.maximum(pairs.room, by_grid), pairs.room)
    pairs.room[wrong] = np.minimum(np.maximum(least + more, 1.3 * pairs.room), MOST)[wrong]
    # gaps at walls, and of pairs of other kinds, are exact
    overlapping = int((gap[_unroomed(bed)] < 0.0).sum())
    if wrong.any() or overlapping:
        part_grains(bed, KEPT, ROUNDS, margin=MARGIN)
    return int(wrong.sum()) + overlapping


def _unroomed(bed: Bed) -> Booleans:
    """Return which contacts are none between a grain and a mesh that is not convex."""
    i, j = bed.rows.i[: bed.m], bed.rows.j[: bed.m]
    inner = (j >= 0) & (j < bed.count)
    kind = bed.grains.kind
    other = np.where(inner, j, 0)
    return np.asarray(~inner | ((kind[i] != SURFACE) & (kind[other] != SURFACE)))
