"""Quasi-static steps, which bring a bed to rest, and the proof that it rests.

In a step of length dt from rest, contact forces within their friction cones are sought with which no gap closes:
``a_n + gap / dt^2 >= 0`` at every contact, with equality where it pushes. Then grains move by ``a dt^2``. The solution
starts from the forces of the step before, which do not depend on dt. The proof is the same problem without motion:
forces at the contacts that touch which balance every weight and torque (:mod:`voxgran.settling.equilibrium`).
"""

import math

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.contacts.manifolds.rows import PUSH
from voxgran.settling.balance import gauss_seidel_forces
from voxgran.settling.bed import Bed
from voxgran.settling.interior_point import frictionless_forces
from voxgran.settling.materials import FrictionTable

#: compression of a contact by a force of one weight, in median diameters; a lid does not compress contacts more
SOFTNESS = 1e-6
#: part of the distance that surfaces keep by which forces without friction compress contacts at most
COMPRESSED = 0.25
#: acceleration, in that of gravity, from which on a grain moves
MOVING = 0.01
#: accuracy of steps without friction, in units of gravity and in gaps
ACCURACY = 3e-3
#: force of a contact, in weights, from which on the second derivatives of its gap count
PRESSED = 0.01
#: farthest that a grain goes on by its momentum, in median diameters: where surfaces are hollow it would meet others
LEAP = 1e-2
#: distance up to which contacts are found in a step, and farthest that a grain moves in it
MARGIN, MOST = 0.1, 0.1


def quasi_static_step(
    bed: Bed, friction: float | FrictionTable, step: float, *, rest: float, iterations: int, margin: float = MARGIN,
    most: float = MOST, reuse: float = 0.0,
) -> float:  # fmt: skip
    """Make a step with friction, and return the share of the grains that moved by more than a hundredth of free fall.

    rest: distance that surfaces keep.  reuse: motion up to which exact contacts of meshes are not found again.
    """
    bed.find(margin, rest, reuse=reuse)
    forces, square = bed.forces(), step * step
    skin = SOFTNESS / (bed.load * square)
    accelerations, _ = gauss_seidel_forces(
        bed.contacts, forces, bed.gap / square, friction=bed.friction_at(friction), skin=skin, iterations=iterations
    )
    bed.keep_forces(forces)
    bed.move(accelerations * square, most, carry=reuse > 0.0)
    return bed.mean(np.linalg.norm(accelerations[: bed.count, :3], axis=1) > MOVING)


def frictionless_step(
    bed: Bed, step: float, *, rest: float, before: tuple[Floats, float], ahead: bool, margin: float = MARGIN,
    most: float = MOST,
) -> tuple[float, Floats, float]:  # fmt: skip
    """Make a step without friction, solved to the end; return the share of the grains that moved as in a step with it.

    Normals turn with the grains, which changes forces of other contacts: second derivatives of the gaps, with the
    forces of the step before, take part as far as they hold grains back. Steps have the momentum of Nesterov.

    before: motions (n + 1, 6)
    of the step before and the number t of Nesterov; those of this step are returned, too.  ahead: whether the grains go
    on along their motions, as in all steps but those before an examination.
    """
    bed.find(margin, rest)
    square, contacts = step * step, bed.contacts
    start = contacts.row[:, PUSH].copy()
    pressed = np.flatnonzero(start > PRESSED)
    forms = bed.finders.curvature(bed.grains, bed.rows, pressed)
    forms *= -square * start[pressed, None, None]
    # the largest force of a tall bed must not compress its contact by more than the distance that surfaces keep
    softness = min(2.0 * SOFTNESS / bed.load, COMPRESSED * rest / start.max(initial=1.0))
    push, accelerations, _ = frictionless_forces(
        contacts, openness=bed.gap / square, skin=softness / square,
        accuracy=ACCURACY / max(1.0, square), start=start, height=-(bed.grains.position @ bed.gravity),
        bend=(pressed, forms),
    )  # fmt: skip
    bed.keep_forces(push[:, None] * contacts.row[:, :3])
    motion = accelerations * square
    velocity, t, part = _with_momentum(bed, motion, *before)
    bed.move(motion + bed.clipped(part * velocity, LEAP) if ahead else motion, most)
    return bed.mean(np.linalg.norm(accelerations[: bed.count, :3], axis=1) > MOVING), velocity, t


def _with_momentum(bed: Bed, motion: Floats, old: Floats, t: float) -> tuple[Floats, float, float]:
    """Return the motions (n + 1, 6) with momentum, the next number of Nesterov, and the part by which grains go on."""
    inverse = bed.bodies[:, 6:8]
    free = inverse > 0.0
    if not len(old) or ((motion * old).reshape(-1, 2, 3).sum(axis=2)[free] / inverse[free]).sum() < 0.0:
        # grains have begun to move back
        t, old = 1.0, np.zeros_like(motion)
    after = _next_number(t)
    return motion + (t - 1.0) / after * old, after, (after - 1.0) / _next_number(after)


def _next_number(t: float) -> float:
    """Return the number of Nesterov after t."""
    return (1.0 + math.sqrt(1.0 + 4.0 * t * t)) / 2.0
