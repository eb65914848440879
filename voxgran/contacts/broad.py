"""Broad phase: pairs of grains whose bounding spheres are close, periodic images included."""

from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran.contacts.assembly import Assembly
from voxgran.containers.model import periods_of
from voxgran.geometry.sphere_pairs import near_pairs


class Pairs(NamedTuple):
    """Candidate pairs of grains.

    Attributes
    ----------
    i, j : (m,) ndarray of int
        Grains in lexical order, i <= j; i == j denotes a grain and its own periodic image.
    image : (m, 3) ndarray of int
        The partner is grain j shifted by `image` times the periods of the container.
    offset : (m, 3) ndarray of float
        Vector from the centroid of grain i to that of its partner.
    """

    i: Integers
    j: Integers
    image: Integers
    offset: Floats

    @property
    def count(self) -> int:  # type: ignore[override]
        """Number of pairs."""
        return len(self.i)

    def where(self, mask: Booleans | Integers) -> "Pairs":
        """Return a subset of the pairs, by a mask or by indices."""
        return Pairs(self.i[mask], self.j[mask], self.image[mask], self.offset[mask])


def grain_pairs(assembly: Assembly, gap: float) -> Pairs:
    """Return the pairs of grains whose bounding spheres are within a gap, each once per periodic image.

    The gap is in the unit of lengths; a negative value is a smallest overlap.
    """
    periods = periods_of(assembly.container)
    # pairs within rounding error of the limit are kept: the exact test follows
    radii = assembly.bounding_radii * (1 + 1e-14)
    i, j, image = near_pairs(
        assembly.position, radii, gap, lower=np.array(assembly.container.bounds[0]), periods=periods
    )
    offset = assembly.position[j] - assembly.position[i] + linear.matmul(image, periods)
    return Pairs(i, j, image, offset)
