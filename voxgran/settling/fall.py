"""The fall of a bed with inertia, until its grains hardly sink any more."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.settling.bed import Bed
from voxgran.settling.impulses import advance_bodies

#: time step and number of substeps; farthest that a grain moves in a step; distance up to which contacts are found
STEP, SUBSTEPS, MOST, MARGIN = 0.05, 4, 0.05, 0.08
#: share of an overlap that is opened in a substep, and the largest velocity for that
OPENING, FASTEST = 0.136, 2.0


@dataclass(frozen=True, slots=True)
class Fall:
    """How a bed falls; lengths in median diameters, times in sqrt(d / g)."""

    friction: float
    restitution: float = 0.0
    rest: float = 5e-4  # distance that surfaces keep
    step: float = STEP
    substeps: int = SUBSTEPS
    most: float = MOST
    margin: float = MARGIN
    weight: float = 1.0  # factor on gravity


def fall_step(bed: Bed, how: Fall, before: float, pull: Floats | None = None) -> None:
    """Advance the bed by one step.

    before: duration of the substep before, to which its impulses belong, 0 where there is none.  pull: (n, 6) further
    accelerations of the grains, with moments.
    """
    bed.find(how.margin, how.rest)
    if pull is not None:
        bed.bodies[: bed.count, :6] += pull * how.step
    substep = how.step / how.substeps
    part = substep / before if before > 0.0 else 0.0
    approach = np.zeros(bed.m if how.restitution > 0.0 else 0)
    advance_bodies(
        bed.rows, bed.bodies, bed.motion, bed.m, bed.count, how.weight * bed.gravity, how.step, how.substeps, how.friction,
        how.restitution, OPENING, FASTEST, how.most / how.step, part, approach,
    )  # fmt: skip
    bed.move(bed.motion, how.most)


def stop_falling(bed: Bed, substep: float) -> None:
    """Take away the velocities, and turn the impulses of a substep into forces."""
    bed.rows.row[: bed.m, 10:14] /= substep
    bed.bodies[:, :6] = 0.0
