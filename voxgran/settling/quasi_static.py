"""Quasi-static steps, which bring a bed to rest, and the proof that it rests.

In a step of length dt from rest, contact forces within their friction cones are sought with which no gap closes:
``a_n + gap / dt^2 >= 0`` at every contact, with equality where it pushes. Then grains move by ``a dt^2``. The solution
starts from the forces of the step before, which do not depend on dt. The proof is the same problem without motion:
forces at the contacts that touch which balance every weight and torque.
"""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.settling.balance import accelerated_projected_gradient, gauss_seidel_forces
from voxgran.settling.bed import Bed

#: compression of a contact by a force of one weight, in median diameters
SOFTNESS = 1e-6
#: residual, in weights, from which on a grain does not rest
RESIDUAL = 0.01
#: distance of the residuals from the least ones, root mean square, at which an examination ends
NEAR = 1e-3
#: distance up to which contacts are found in a step, and farthest that a grain moves in it
MARGIN, MOST = 0.1, 0.1


@dataclass(frozen=True, slots=True)
class Balance:
    """How far the grains of a bed are from equilibrium."""

    residual: Floats  # (n,): net force, in weights of the grain, in the order of the bed
    torque: Floats  # (n,): net torque, in weights times radii
    gap: float  # smallest gap of all contacts, in median diameters

    @property
    def moving(self) -> float:
        """Share of the grains that do not rest."""
        return float((np.maximum(self.residual, self.torque) > RESIDUAL).mean()) if len(self.residual) else 0.0


def quasi_static_step(
    bed: Bed, friction: float, step: float, *, rest: float, iterations: int, margin: float = MARGIN, most: float = MOST
) -> float:
    """Make one step with friction, and return the share of the grains that moved by more than a hundredth of free fall.

    rest: distance that surfaces keep.
    """
    bed.find(margin, rest)
    forces, square = bed.forces(), step * step
    rows = bed.rows
    accelerations, _ = gauss_seidel_forces(
        rows.row, rows.i, rows.j, bed.m, bed.bodies, bed.gravity, forces, bed.gap / square,
        friction=friction, skin=SOFTNESS / square, iterations=iterations,
    )  # fmt: skip
    bed.keep_forces(forces)
    bed.move(accelerations * square, most)
    return float((np.linalg.norm(accelerations[: bed.count, :3], axis=1) > RESIDUAL).mean())


def balance_of(bed: Bed, friction: float, *, reach: float, iterations: int) -> Balance:
    """Return how well forces at the contacts within reach can balance the grains; they are kept in the bed."""
    bed.find(reach, 0.0)
    forces, n, rows = bed.forces(), bed.count, bed.rows
    accelerations, *_ = accelerated_projected_gradient(
        rows.row, rows.i, rows.j, bed.m, bed.bodies, bed.gravity, forces,
        friction=friction, iterations=iterations, tolerance=RESIDUAL / 2, near=NEAR,
    )  # fmt: skip
    bed.keep_forces(forces)
    inertia = bed.bodies[:n, 6] / bed.bodies[:n, 7]
    return Balance(
        np.linalg.norm(accelerations[:n, :3], axis=1),
        np.linalg.norm(accelerations[:n, 3:], axis=1) * inertia / (bed.diameter / 2),
        float(bed.gap.min(initial=np.inf)),
    )
