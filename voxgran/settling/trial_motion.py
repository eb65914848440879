"""Trial motions of a settling sweep: free fall, optionally with random shaking."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.contacts.assembly import Assembly


@dataclass(frozen=True, slots=True)
class TrialMotion:
    """Motions that grains would make without contacts."""

    step: float  # scale of the motions, a length
    fall: Floats  # (3,): step along gravity
    translation: Floats  # (n, 3): displacements of the centroids
    rotation: Floats  # (n, 3): rotation vectors


def free_fall(assembly: Assembly, fall: Floats) -> TrialMotion:
    """Return the fall of all grains by a step (3,)."""
    none = np.zeros((assembly.count, 3))
    return TrialMotion(float(np.linalg.norm(fall)), fall, none + fall, none)


def shaken_fall(assembly: Assembly, fall: Floats, strength: float, generator: np.random.Generator) -> TrialMotion:
    """Return a fall by a step (3,) during which every grain is also displaced and rotated at random.

    `strength` is the amplitude of the shaking in gravitational accelerations.
    """
    step, many, flat = float(np.linalg.norm(fall)), assembly.count, assembly.dimension == 2
    pull, turn = generator.normal(size=(2, many, 3))
    if flat:
        pull[:, 2], turn[:, :2] = 0.0, 0.0
    # no motion exceeds the step, which keeps second-order errors small
    part = 1.0 / max(1.0, strength)
    far = strength * part * step * _at_most_one(turn) / assembly.bounding_radii[:, None]
    return TrialMotion(step, fall, part * (fall + strength * step * _at_most_one(pull)), far)


def _at_most_one(vectors: Floats) -> Floats:
    """Return vectors, the long ones shortened to 1."""
    return np.asarray(vectors / np.maximum(1.0, np.linalg.norm(vectors, axis=1))[:, None])
