"""The state of digital packing."""

from dataclasses import dataclass, field

import numpy as np

from voxgran._base.arrays import Integers
from voxgran.packing.walking.state import WalkState, no_integers


@dataclass(slots=True, kw_only=True)
class DigitalState(WalkState):
    """State of digital packing.

    Attributes
    ----------
    slept_through, rows_read, pairs_read : int
        Attempts on sleeping grains, rows of columns tested, and pairs looked up.
    lid_layers : int
        Number of layers of voxels that the lid has taken.
    site : (n, 3) ndarray of int
        Lattice site of the centroid of each grain.
    member, turn : (n,) ndarray of int
        Member of the bank, -1 before the grain enters, and number of its lattice rotation.
    order : (m,) ndarray of int
        Grains along a curve through space; empty unless the schedule is "sorted".
    hint : (n or 0, 3) ndarray of int
        Normal of the contact that refused the last move of each grain; empty unless moves are guided.
    calm, depth, slept : (n or 0,) ndarray of int
        Attempts of each grain since it reached its lowest height, that height, and the attempt at which it fell asleep
        (-1: awake); empty unless the schedule is "sleeping".
    stirred : (c or 0,) ndarray of int
        Last attempt at which a grain sank in each cell of space.
    cells : (4,) ndarray of int
        Number of those cells along each axis, and the edge of one in voxels.
    """

    slept_through: int = 0
    rows_read: int = 0
    pairs_read: int = 0
    lid_layers: int = 0
    site: Integers = field(default_factory=no_integers)
    member: Integers = field(default_factory=no_integers)
    turn: Integers = field(default_factory=no_integers)
    order: Integers = field(default_factory=no_integers)
    hint: Integers = field(default_factory=lambda: np.zeros((0, 3), dtype=np.int64))
    calm: Integers = field(default_factory=no_integers)
    depth: Integers = field(default_factory=no_integers)
    slept: Integers = field(default_factory=no_integers)
    stirred: Integers = field(default_factory=no_integers)
    cells: Integers = field(default_factory=lambda: np.ones(4, dtype=np.int64))
