"""Quasi-static steps, which bring a bed to rest, and the proof that it rests.

In a step of length dt from rest, contact forces within their friction cones are sought with which no gap closes:
``a_n + gap / dt^2 >= 0`` at every contact, with equality where it pushes. Then grains move by ``a dt^2``. The solution
starts from the forces of the step before, which do not depend on dt. The proof is the same problem without motion:
forces at the contacts that touch which balance every weight and torque (:mod:`voxgran.settling.equilibrium`).
"""

import numpy as np

from voxgran.settling.balance import gauss_seidel_forces
from voxgran.settling.bed import Bed
from voxgran.settling.materials import FrictionTable

#: compression of a contact by a force of one weight, in median diameters; a lid does not compress contacts more
SOFTNESS = 1e-6
#: acceleration, in that of gravity, from which on a grain moves
MOVING = 0.01
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
