"""Compression with thermal motion: grains grow slowly while they move at random and collide.

The slower the grains grow, the more of their neighbours' arrangements they try, and the denser they jam (Lubachevsky &
Stillinger 1990, there by exact collisions, one after the other). Here a step is one of contact dynamics
(:mod:`voxgran.settling.fall`) without weight and friction: velocities lose a share of themselves, and random ones take
its place, which keeps the temperature.

The pressure tells how far the grains can grow: that of hard bodies goes to infinity where they jam, and the reciprocal
of the reduced one, here the *free growth*, to zero as the relative growth that is left. Steps get shorter with it.

References
----------
Lubachevsky & Stillinger 1990, Geometric properties of random disk packings, Journal of Statistical Physics 60, 561-583,
doi:10.1007/BF01025983.
Donev, Torquato & Stillinger 2005, Neighbor list collision-driven molecular dynamics simulation for nonspherical hard
particles: I. Algorithmic details, Journal of Computational Physics 202, 737-764, doi:10.1016/j.jcp.2004.08.014.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran.contacts.manifolds.rows import ARM_I, ARM_J, GAP, NORMAL, PUSH
from voxgran.settling.bed import Bed
from voxgran.settling.fall import fall_step
from voxgran.settling.impulses import Fall

#: thermal speed along each axis of a grain of unit mass, in median diameters in a unit of time
SPEED = 0.3
#: share of its velocity that a grain keeps in a step
PERSISTENCE = 0.9
#: longest motion of a step at thermal speed, in median diameters, and in the free growth
LONGEST, OF_FREE = 0.03, 0.3
#: substeps of a step; farthest that a grain moves in it, which slows down the fastest ones in long steps; distance up
#: to which contacts are found
SUBSTEPS, MOST, MARGIN = 4, 0.05, 0.05
#: free growth at the beginning, and share of the new pressure in the running mean
FIRST_FREE, NEW = 0.1, 0.05
#: columns of velocities and angular velocities by dimension
FREEDOMS = {2: (0, 1, 5), 3: (0, 1, 2, 3, 4, 5)}


@dataclass(frozen=True, slots=True)
class Motion:
    """What the next step depends on, beside the bed."""

    free: float = FIRST_FREE  # relative growth that is left until the grains jam, a running mean
    substep: float = (
        0.0  # duration of the last substep, to which the impulses of the bed belong; 0 where there are none
    )


def thermal_step(bed: Bed, motion: Motion, generator: np.random.Generator, *, kept: float) -> tuple[Motion, float]:
    """Move the grains for a step; return what the next one depends on, and the motion at thermal speed.

    kept: distance that surfaces keep.
    """
    way = min(OF_FREE * motion.free, LONGEST)
    step = way / SPEED
    how = Fall(friction=0.0, rest=kept, step=step, substeps=SUBSTEPS, most=MOST, margin=MARGIN, weight=0.0)
    _heat(bed, generator)
    fall_step(bed, how, motion.substep)
    substep = step / SUBSTEPS
    free = motion.free + NEW * (1.0 / (1.0 + _excess_pressure(bed, substep)) - motion.free)
    return Motion(free, substep), way


def stop_moving(bed: Bed) -> None:
    """Take away the velocities and the impulses."""
    bed.bodies[:, :6] = 0.0
    bed.rows.row[: bed.m, PUSH : PUSH + 4] = 0.0


def _heat(bed: Bed, generator: np.random.Generator) -> None:
    """Replace a part of the velocities by random ones of the temperature."""
    n, dimension = bed.count, bed.assembly.dimension
    freedoms = np.array(FREEDOMS[dimension])
    # inverse mass for translations, inverse moment of inertia for rotations
    inverse = bed.bodies[:n, np.where(freedoms < 3, 6, 7)]
    random = generator.normal(size=(n, len(freedoms)))
    fresh = SPEED * np.sqrt((1.0 - PERSISTENCE**2) * inverse) * random
    bed.bodies[:n, freedoms] = PERSISTENCE * bed.bodies[:n, freedoms] + fresh


def _excess_pressure(bed: Bed, substep: float) -> float:
    """Return the reduced pressure beyond that of an ideal gas, by the impulses of the last substep (virial)."""
    row: Floats = bed.rows.row[: bed.m]
    apart = ((row[:, ARM_I:ARM_J] - row[:, ARM_J:GAP]) * row[:, NORMAL:ARM_I]).sum(axis=1)
    kinetic = bed.assembly.dimension * int(bed.movable.sum()) * SPEED**2
    return max(float(linear.matmul(row[:, PUSH], apart)) / (substep * kinetic), 0.0)
