"""The state of control-point packing."""

from dataclasses import dataclass, field

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.packing.walking.state import WalkState, no_integers


@dataclass(slots=True, kw_only=True)
class ControlState(WalkState):
    """State of control-point packing."""

    # (n, 3) and (n, 4): centroids and orientations of all grains, of use for those that have entered
    position: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    orientation: Floats = field(default_factory=lambda: np.zeros((0, 4)))
    # (n,): 1 for grains that have entered, else 0
    entered: Integers = field(default_factory=no_integers)
    # (n,): present step length of each grain
    step: Floats = field(default_factory=lambda: np.zeros(0))
    # (n,): upward moves that each grain still makes after a collision
    lifted: Integers = field(default_factory=no_integers)
    lid_before: float = 0.0  # distance by which the lid had been lowered when the bed was last examined
