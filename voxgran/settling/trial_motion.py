"""What grains want to do in a sweep of settling: fall, or be shaken while they fall."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats
from voxgran.contacts.assembly import Assembly


@dataclass(frozen=True, slots=True)
class Wish:
    """Motions that grains would make if nothing held them back.

    Attributes
    ----------
    step : float
        Scale of the motions, a length.
    fall : (3,) ndarray of float
        Step along gravity.
    slide, spin : (n, 3) ndarray of float
        Of the centroids, and rotation vectors.
    """

    step: float
    fall: Floats
    slide: Floats
    spin: Floats


def falling(assembly: Assembly, fall: Floats) -> Wish:
    """Return the wish of all grains to fall by a step.

    Parameters
    ----------
    assembly : Assembly
        The grains.
    fall : (3,) ndarray of float
        The step.
    """
    none = np.zeros((assembly.count, 3))
    return Wish(float(np.linalg.norm(fall)), fall, none + fall, none)


def shaken(assembly: Assembly, fall: Floats, strength: float, generator: np.random.Generator) -> Wish:
    """Return the wish to fall while every grain is pulled and turned in a direction of its own.

    Parameters
    ----------
    assembly : Assembly
        The grains.
    fall : (3,) ndarray of float
        The step.
    strength : float
        Of the shaking, in gravities.
    generator : Generator
        Draws the directions.
    """
    step, many, flat = float(np.linalg.norm(fall)), assembly.count, assembly.dimension == 2
    pull, turn = generator.normal(size=(2, many, 3))
    if flat:
        pull[:, 2], turn[:, :2] = 0.0, 0.0
    # nobody is to go further than the step, which keeps what the projection leaves out small
    part = 1.0 / max(1.0, strength)
    far = strength * part * step * _at_most_one(turn) / assembly.bounding_radii[:, None]
    return Wish(step, fall, part * (fall + strength * step * _at_most_one(pull)), far)


def _at_most_one(vectors: Floats) -> Floats:
    """Return vectors, the long ones shortened to 1."""
    return np.asarray(vectors / np.maximum(1.0, np.linalg.norm(vectors, axis=1))[:, None])
