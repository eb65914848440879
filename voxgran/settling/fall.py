"""The fall of a bed with inertia, until its grains hardly sink any more."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.seeds import stream
from voxgran.settling.bed import Bed
from voxgran.settling.impulses import Fall, advance_bodies

#: kinetic energy of a grain, and the share of grains above a speed, in sqrt(g d), below which a bed is slow
ENERGY, FAST, FEW = 0.05, 0.2, 0.05
#: steps for which a grain is shaken in one direction
SHAKEN_STEPS = 4


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


def is_slow(bed: Bed) -> bool:
    """Return whether the grains have little kinetic energy, and few of them move fast."""
    speed = np.linalg.norm(bed.bodies[: bed.count, :3], axis=1)
    return bed.kinetic_energy < ENERGY and bed.mean(speed > FAST) < FEW


def random_pull(bed: Bed, seed: int, step: int) -> Floats:
    """Return random accelerations (n, 6) of all grains with moments, of the amplitude 1, in a step of shaking."""
    draws = stream(seed, "shaking", step // SHAKEN_STEPS).normal(size=(bed.count, 6))
    if bed.assembly.dimension == 2:
        draws[:, 2:5] = 0.0
    # grains of any size turn as far as they move
    return np.asarray(draws * np.where(np.arange(6) < 3, 1.0, 2.0 / bed.diameter[:, None]))
