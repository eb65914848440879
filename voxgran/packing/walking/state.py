"""The state that the walking methods share."""

import math
from dataclasses import dataclass, field

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.packing.method import TypedState


def no_integers() -> Integers:
    """Return an empty array of integers."""
    return np.zeros(0, dtype=np.int64)


#: counters of :class:`WalkState` that the kernels change, in their order
TALLY = (
    *("placed", "moves_accepted", "moves_tried", "turns_accepted", "turns_tried"),
    *("feeds_tried", "feeds_refused_in_a_row"),
)


@dataclass(slots=True, kw_only=True)
class WalkState(TypedState):
    """Where a walk stands, from feeding to settling.

    Attributes
    ----------
    placed : int
        Number of grains that have entered.
    moves_accepted, moves_tried, turns_accepted, turns_tried, feeds_tried, feeds_refused_in_a_row : int
        Translations, rotations, and attempts to insert a grain.
    feeding_ended_at, layer_ends : int or None
        Attempts at which feeding ended and at which it is to be resumed while it is interrupted.
    layer_placed : int
        Number of grains that had entered when feeding was last resumed.
    walk_end, walked : int or None, int
        Why the walk ended, an index into `finishing.ENDS`, and after how many attempts.
    parting_sweeps, left_overlapping, settling_at, settling_sweeps : int
        Sweeps of parting, overlaps after the last one, attempt at which settling began (-1: not yet), and its sweeps.
    waiting : (n,) ndarray of int
        All grains: first those that are waiting, then those that have entered.
    height : float
        Sum of the heights of the centroids when the bed was last examined.
    surface_height, surface_grains : float, int
        Sum of the heights of grains near the entry when feeding was interrupted, and their number.
    lid_lowered : float
        Distance by which the lid has been lowered, in median diameters.
    position, orientation : ndarray of float
        Poses of the grains that have entered, once the walk has ended; before, as a method uses them.
    settling : (3,) ndarray of float
        Step of settling, mean height at its beginning, and first step.
    """

    placed: int = 0
    moves_accepted: int = 0
    moves_tried: int = 0
    turns_accepted: int = 0
    turns_tried: int = 0
    feeds_tried: int = 0
    feeds_refused_in_a_row: int = 0
    feeding_ended_at: int | None = None
    layer_ends: int | None = None
    layer_placed: int = 0
    walk_end: int | None = None
    walked: int = 0
    parting_sweeps: int = 0
    left_overlapping: int = 0
    settling_at: int = -1
    settling_sweeps: int = 0
    surface_grains: int = 0
    waiting: Integers = field(default_factory=no_integers)
    height: float = math.inf
    surface_height: float = 0.0
    lid_lowered: float = 0.0
    position: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    orientation: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    settling: Floats = field(default_factory=lambda: np.zeros(3))

    @property
    def has_all(self) -> bool:
        """Whether all grains have entered."""
        return self.placed == len(self.waiting)

    @property
    def grains(self) -> Integers:
        """The grains that have entered, in ascending order."""
        return np.sort(self.waiting[len(self.waiting) - self.placed :])

    @property
    def sweep(self) -> int:
        """Number of attempts of a sweep: as many as grains have entered, at least 1."""
        return max(self.placed, 1)

    def tally(self, names: tuple[str, ...] = TALLY) -> Integers:
        """Return counters as a kernel takes them."""
        return np.array([getattr(self, name) for name in names], dtype=np.int64)

    def count(self, tally: Integers, names: tuple[str, ...] = TALLY) -> None:
        """Take over the counters that a kernel has changed."""
        for name, value in zip(names, tally.tolist(), strict=True):
            setattr(self, name, value)
