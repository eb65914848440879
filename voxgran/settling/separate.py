"""Separation of grains by the smallest translations that leave a gap between all true shapes.

The solver is that of settling (:mod:`voxgran.settling.gauss_seidel`) without fall and rotations: each sweep makes the
smallest motions, weighted by volume, that open all gaps to first order; a few sweeps suffice where there is space.
"""

from dataclasses import replace

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.contacts.assembly import Assembly
from voxgran.settling.contact_points import find_contact_points
from voxgran.settling.gauss_seidel import project

#: largest number of sweeps, iterations in each, and fraction of the gap within which they end
SWEEPS, ITERATIONS, CLOSE = 40, 50, 0.02


def spread(assembly: Assembly, room: float, up: Floats) -> Assembly:
    """Return the grains moved, where there is space, until their surfaces are some distance apart; they may overlap.

    `room` is the wanted distance of surfaces from each other and from walls, above 0, and `up` the direction along
    which contacts are sorted before each Gauss-Seidel pass. Orientations do not change. Where there is no space, gaps
    are left that are less.
    """
    inverse_mass, wraps, lower = 1.0 / assembly.volumes, list(assembly.container.periodic), assembly.container.bounds[0]
    lengths = (assembly.container.bounds[1] - lower)[wraps]
    for _ in range(SWEEPS):
        contacts = find_contact_points(assembly, 2.0 * room)
        many, limits = len(contacts.i), contacts.gap - room
        if not many or float(limits.min()) >= -CLOSE * room:
            break
        translation, rotation = np.zeros((assembly.count, 3)), np.zeros((assembly.count, 3))
        order = np.argsort(assembly.position[contacts.i] @ up, kind="stable")
        project(
            contacts.i, contacts.j, contacts.normal, limits, contacts.arm_i, contacts.arm_j, inverse_mass,
            np.zeros(assembly.count), 0.0, translation, rotation, np.zeros(many), np.zeros((many, 3)), order,
            np.zeros(many), np.zeros(3), 0, ITERATIONS, 0.1 * CLOSE * room, assembly.dimension == 2,
        )  # fmt: skip
        translation *= np.minimum(1.0, room / np.maximum(np.linalg.norm(translation, axis=1), 1e-300))[:, None]
        position = assembly.position + translation
        position[:, wraps] = lower[wraps] + (position - lower)[:, wraps] % lengths
        assembly = replace(assembly, position=position)
    return assembly
