"""The state of digital packing."""

from dataclasses import dataclass, field

import numpy as np

from voxgran._base.arrays import Integers
from voxgran.packing.walking.state import TALLY, WalkState, no_integers

#: counters that the kernel changes, in its order, and the places of those that other walks do not have
COUNTERS = (*TALLY, "slept_through", "rows_read", "pairs_read")
SLEPT, ROWS, PAIRS = range(len(TALLY), len(TALLY) + 3)


@dataclass(slots=True, kw_only=True)
class DigitalState(WalkState):
    """State of digital packing."""

    slept_through: int = 0  # attempts on sleeping grains
    rows_read: int = 0  # rows of columns that were tested
    pairs_read: int = 0  # pairs that were looked up
    lid_layers: int = 0  # layers of voxels that the lid has taken
    # (n, 3): lattice site of the centroid of each grain
    site: Integers = field(default_factory=no_integers)
    # (n,): member of the bank, -1 before the grain enters
    member: Integers = field(default_factory=no_integers)
    # (n,): number of its lattice rotation
    turn: Integers = field(default_factory=no_integers)
    # grains along a curve through space; empty unless the schedule is "sorted"
    order: Integers = field(default_factory=no_integers)
    # (n or 0, 3): normal of the contact that refused the last move; empty unless moves are guided
    hint: Integers = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    # (n or 0,), empty unless the schedule is "sleeping": attempts since a grain reached its lowest height, that height,
    # and the attempt at which it fell asleep (-1: awake)
    calm: Integers = field(default_factory=no_integers)
    depth: Integers = field(default_factory=no_integers)
    slept: Integers = field(default_factory=no_integers)
    # last attempt at which a grain sank in each cell of space
    stirred: Integers = field(default_factory=no_integers)
    # (4,): number of those cells along each axis, and the edge of one in voxels
    cells: Integers = field(default_factory=lambda: np.ones(4, dtype=np.int64))
