"""Quasi-static steps, which bring a bed to rest, and the proof that it rests.

In a step of length dt from rest, contact forces within their friction cones are sought with which no gap closes:
``a_n + gap / dt^2 >= 0`` at every contact, with equality where it pushes. Then grains move by ``a dt^2``. The solution
starts from the forces of the step before, which do not depend on dt. Presets have the numbers of the solver by the kind
of the grains and the friction. The proof is the same problem without motion:
forces at the contacts that touch which balance every weight and torque (:mod:`voxgran.settling.equilibrium`).
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran.contacts.manifolds.rows import ARM_I, ARM_J, NORMAL, SURFACE
from voxgran.settling.balance import LoadedContacts, gauss_seidel_forces
from voxgran.settling.bed import Bed
from voxgran.settling.cell import INVERSE_MOMENT
from voxgran.settling.materials import FrictionTable

#: compression of a contact by a force of one weight, in median diameters; a lid does not compress contacts more
SOFTNESS = 1e-6
#: acceleration, in that of gravity, from which on a grain moves
MOVING = 0.01
#: distance up to which contacts are found in a step, and farthest that a grain moves in it
MARGIN, MOST = 0.1, 0.1
#: distance that surfaces keep
KEPT = 5e-4
#: share of the smaller diameter from which on an overlap is opened without rotations
DEEP = 0.02


@dataclass(frozen=True, slots=True)
class SolverPreset:
    """Numbers by which quasi-static steps are made; lengths are in median diameters."""

    kept: float  # distance that surfaces keep
    margin: float  # gap up to which contacts are found
    most: float  # farthest that a grain moves in a step
    first: float  # length of the first step
    last: float  # of the last ones
    steps: int  # largest number of steps
    examined: int = 0  # steps between two examinations; 0: when hardly any grain moves
    late: int = 0  # steps from which on steps become shorter; 0: when few grains move
    reuse: float = 0.0  # motion of a pair up to which its contacts are not found again


#: of spheres, disks, polygons and convex grains, whose steps become shorter only where a bed has not come to rest for
#: long: long grains may slip to and fro between two poses, one step each, for ever in steps of one length
FRICTIONAL = SolverPreset(KEPT, 0.1, 0.1, first=0.3, last=0.1, steps=150, late=75)
#: of the same without friction, on soft contacts, whose lengths are compressions, which become less after so many steps
#: at the latest; and of shapes that are not convex without friction
SOFT = (
    SolverPreset(KEPT, 0.1, 0.1, first=3e-4, last=0.0, steps=200, examined=4, late=20),
    SolverPreset(KEPT, 0.1, 0.1, first=1.6e-4, last=0.0, steps=150, examined=6, late=2),
)
FRICTIONLESS = SolverPreset(KEPT, 0.1, 0.03, first=0.2, last=0.05, steps=60)
#: of meshes that are not convex: by grids of distances, the same where it is known by how much these are wrong, then by
#: triangles
GRIDS = SolverPreset(4e-3, 0.024, 0.02, first=0.15, last=0.1, steps=50)
ROOMED = SolverPreset(KEPT, 0.024, 5e-3, first=0.1, last=0.1, steps=8)
TRIANGLES = SolverPreset(KEPT, 5e-3, 4e-3, first=0.1, last=0.05, steps=160, examined=10, reuse=4e-3)


def quasi_static_step(
    bed: Bed, friction: float | FrictionTable, step: float, *, rest: float, iterations: int, margin: float = MARGIN,
    most: float = MOST, reuse: float = 0.0,
) -> float:  # fmt: skip
    """Make a step with friction, and return the share of the grains that moved by more than a hundredth of free fall.

    rest: distance that surfaces keep.  reuse: motion up to which exact contacts of meshes are not found again.
    """
    bed.find(margin, rest, reuse=reuse)
    if bed.grains.kind.any() and SURFACE not in bed.grains.kind:
        _do_not_turn(bed)
    forces, square = bed.forces(), step * step
    skin = SOFTNESS / (bed.load * square)
    accelerations, _ = gauss_seidel_forces(
        _rolling(bed), forces, bed.gap / square, friction=bed.friction_at(friction), skin=skin, iterations=iterations
    )
    bed.keep_forces(forces)
    bed.move(accelerations * square, most, carry=reuse > 0.0)
    return bed.mean(linear.norm(accelerations[: bed.count, :3], axis=1) > MOVING)


def _rolling(bed: Bed) -> LoadedContacts:
    """Return the contacts of a bed, in which slender grains turn about their axes as easily as they do."""
    if not bed.rolls.any():
        return bed.contacts
    grains, bodies = bed.grains, bed.bodies
    roll = linear.einsum("nij,nj->ni", grains.matrix, bed.rolls[grains.shape]) * np.sqrt(
        bodies[:-1, INVERSE_MOMENT, None]
    )
    return bed.contacts._replace(bodies=np.hstack([bodies, np.vstack([roll, np.zeros(3)])]))


def _do_not_turn(bed: Bed) -> None:
    """Let contacts that overlap deeply act at the centroids of their grains.

    The depth is that of a translation. A rotation opens it to first order only: convex grains deep in each other meet
    at other points then, and overlap as deep.
    """
    i, j, row = bed.contacts.i, bed.contacts.j, bed.rows.row[: bed.m]
    other = np.where((j >= 0) & (j < bed.count), j, i)
    deep = np.flatnonzero(bed.gap < -DEEP * np.minimum(bed.diameter[i], bed.diameter[other]))
    normal = row[deep, NORMAL : NORMAL + 3]
    for arm in (ARM_I, ARM_J):
        row[deep, arm : arm + 3] = (row[deep, arm : arm + 3] * normal).sum(axis=1)[:, None] * normal
