"""The fall of a bed with inertia, until its grains hardly sink any more."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.settling.bed import Bed
from voxgran.settling.impulses import Fall, advance_bodies


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
    how = how._replace(friction=np.array(bed.friction_at(how.friction), dtype=np.float64, ndmin=1))
    advance_bodies(bed.rows, bed.m, bed.bodies, bed.motion, how.weight * bed.gravity, how, part, approach)
    bed.move(bed.motion, how.most)


def stop_falling(bed: Bed, substep: float) -> None:
    """Take away the velocities, and turn the impulses of a substep into forces."""
    bed.rows.row[: bed.m, 10:14] /= substep
    bed.bodies[:, :6] = 0.0
