"""Grains spread in place: each moves as little as it takes that all true shapes have some room between them.

The motions are those of settling (:mod:`voxgran.settling.gauss_seidel`) without a fall and without turns: at each sweep
the least ones, weighted by the volumes, that open all gaps to first order; a few sweeps do where there is room.
"""

from dataclasses import replace

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.contacts.assembly import Assembly
from voxgran.settling.contact_points import find_touching
from voxgran.settling.gauss_seidel import project

#: sweeps at the most, iterations of a projection, and the part of the room at which all is well
SWEEPS, ITERATIONS, CLOSE = 40, 50, 0.02


def spread(assembly: Assembly, room: float, up: Floats) -> Assembly:
    """Return the grains moved, where there is space, so far that their surfaces are some room apart.

    Parameters
    ----------
    assembly : Assembly
        The grains; they may overlap.
    room : float
        Wanted distance of surfaces from each other and from walls, in the unit of lengths; above 0.
    up : (3,) ndarray of float
        In this order contacts are solved.

    Returns
    -------
    Assembly
        With the orientations that they had. Where there is no space for them, gaps are left that are less.
    """
    light, wraps, lower = 1.0 / assembly.volumes, list(assembly.container.periodic), assembly.container.bounds[0]
    lengths = (assembly.container.bounds[1] - lower)[wraps]
    for _ in range(SWEEPS):
        touching = find_touching(assembly, 2.0 * room)
        many, limits = len(touching.i), touching.gap - room
        if not many or float(limits.min()) >= -CLOSE * room:
            break
        slide, spin = np.zeros((assembly.count, 3)), np.zeros((assembly.count, 3))
        order = np.argsort(assembly.position[touching.i] @ up, kind="stable")
        project(
            touching.i, touching.j, touching.normal, limits, touching.arm_i, touching.arm_j, light,
            np.zeros(assembly.count), 0.0, slide, spin, np.zeros(many), np.zeros((many, 3)), order, np.zeros(many),
            np.zeros(3), 0, ITERATIONS, 0.1 * CLOSE * room, assembly.dimension == 2,
        )  # fmt: skip
        slide *= np.minimum(1.0, room / np.maximum(np.linalg.norm(slide, axis=1), 1e-300))[:, None]
        position = assembly.position + slide
        position[:, wraps] = lower[wraps] + (position - lower)[:, wraps] % lengths
        assembly = replace(assembly, position=position)
    return assembly
