"""The fall of a bed with inertia, until its grains hardly sink any more."""

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.seeds import stream
from voxgran.contacts.manifolds.rows import MASS, PUSH
from voxgran.settling.bed import Bed
from voxgran.settling.impulses import Fall, advance_bodies

#: kinetic energy of a grain, and the share of grains above a speed, in sqrt(g d), below which a bed is slow
ENERGY, FAST, FEW = 0.05, 0.2, 0.05
#: residual from which on a grain that does not rest falls while the others are held, largest share of such grains, and
#: number of steps for which they fall
LOOSE, MOST_LOOSE, LOOSE_STEPS = 0.03, 0.2, 20
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


def let_fall(bed: Bed, residual: Floats, how: Fall) -> Bed:
    """Let the few grains fall that do not rest, by grids of distances, between all others; return the bed.

    Exact steps move a grain by no more than their short reach of contacts, so that a bed would wait for grains that
    slide or fall farther. Spheres have no grid, and the grids of other grains keep them at a distance: a bed with
    spheres is returned as it is.

    residual: (n,) net forces and torques on the grains, in their weights and radii.
    """
    loose = bed.movable & (residual > LOOSE)
    if not (bed.finders.gridded and 0.0 < bed.mean(loose) < MOST_LOOSE):
        return bed
    fallen, old, substep = bed.copy(), bed.grains, how.step / how.substeps
    fallen.finders, fallen.fixed, fallen.listed = bed.finders.by_grids(), ~loose, False
    # the room of pairs that exact contacts have parted since would lift their grains again
    fallen.pairs.room[:] = 0.0
    fallen.rows.row[: fallen.m, PUSH:MASS] = 0.0
    fallen.bodies[:, :6] = 0.0
    fallen.bodies[np.append(~loose, True), 6:] = 0.0
    for step in range(LOOSE_STEPS):
        fall_step(fallen, how, substep if step else 0.0)
    # the bounds on how far surfaces have moved since the last search do not hold for these grains any more
    old.way[loose] += linear.norm(fallen.grains.position - old.position, axis=1)[loose] + 2.0 * old.radius[loose]
    for name in ("position", "matrix"):
        getattr(old, name)[:] = getattr(fallen.grains, name)
    bed.orientation[:], bed.carried = fallen.orientation, np.full(2, np.nan)
    return bed


def stop_falling(bed: Bed, substep: float) -> None:
    """Take away the velocities, and turn the impulses of a substep into forces."""
    bed.rows.row[: bed.m, 10:14] /= substep
    bed.bodies[:, :6] = 0.0


def is_slow(bed: Bed) -> bool:
    """Return whether the grains have little kinetic energy, and few of them move fast."""
    speed = linear.norm(bed.bodies[: bed.count, :3], axis=1)
    return bed.kinetic_energy < ENERGY and bed.mean(speed > FAST) < FEW


def random_pull(bed: Bed, seed: int, step: int) -> Floats:
    """Return random accelerations (n, 6) of all grains with moments, of the amplitude 1, in a step of shaking."""
    draws = stream(seed, "shaking", step // SHAKEN_STEPS).normal(size=(bed.count, 6))
    if bed.assembly.dimension == 2:
        draws[:, 2:5] = 0.0
    # grains of any size turn as far as they move
    return np.asarray(draws * np.where(np.arange(6) < 3, 1.0, 2.0 / bed.diameter[:, None]))
