"""The state that the walking methods share."""

import math
from dataclasses import dataclass, field

import numpy as np

from voxgran._base.arrays import Integers
from voxgran.packing.method import TypedState


def no_integers() -> Integers:
    """Return an empty array of integers."""
    return np.zeros(0, dtype=np.int64)


#: counters of :class:`WalkState` that the kernels change, in their order
TALLY = (
    *("placed", "moves_accepted", "moves_tried", "turns_accepted", "turns_tried"),
    *("feeds_tried", "feeds_refused_in_a_row"),
)
#: their places in the array that a kernel takes
PLACED, MOVED, MOVES, TURNED, TURNS, FEEDS, REFUSED = range(7)


@dataclass(slots=True, kw_only=True)
class WalkState(TypedState):
    """State of a walk, from feeding to the end of vibration."""

    placed: int = 0  # grains that have entered
    moves_accepted: int = 0  # translations
    moves_tried: int = 0
    turns_accepted: int = 0  # rotations
    turns_tried: int = 0
    feeds_tried: int = 0  # attempts to insert a grain
    feeds_refused_in_a_row: int = 0
    feeding_ended_at: int | None = None  # attempt at which feeding ended
    layer_ends: int | None = None  # attempt at which feeding is to be resumed while it is interrupted
    layer_placed: int = 0  # grains that had entered when feeding was last resumed
    surface_grains: int = 0  # grains near the entry when feeding was interrupted
    waiting: Integers = field(default_factory=no_integers)  # (n,): first grains that are waiting, then the others
    height: float = math.inf  # sum of the heights of the centroids when the bed was last examined
    surface_height: float = 0.0  # sum of the heights of the `surface_grains`
    lid_lowered: float = 0.0  # distance by which the lid has been lowered, in median diameters

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
