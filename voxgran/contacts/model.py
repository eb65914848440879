"""Contacts: pairs of grains with gap, normal and point."""

from dataclasses import dataclass, fields

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arrays import Booleans, Floats, Integers


@dataclass(frozen=True, eq=False)
class Contacts(ExplainedAttributes):
    """Pairs of grains closer than a given gap, each once per periodic image.

    Attributes
    ----------
    i, j : (m,) ndarray of int
        Grains of the pair, i <= j.
    image : (m, 3) ndarray of int
        The partner is grain j shifted by `image` times the lengths of the container.
    gap : (m,) ndarray of float
        Distance of the surfaces, in the unit of lengths; negative where they overlap (the depth).
    normal : (m, 3) ndarray of float
        Unit vector from grain i to grain j.
    point : (m, 3) ndarray of float
        Middle between the nearest points, near grain i.
    """

    i: Integers
    j: Integers
    image: Integers
    gap: Floats
    normal: Floats
    point: Floats

    @property
    def count(self) -> int:
        """Number of contacts."""
        return len(self.i)

    def where(self, mask: Booleans) -> "Contacts":
        """Return the contacts of a mask (m,); these themselves where it holds all of them."""
        if mask.all():
            return self
        kept = np.flatnonzero(mask)
        return Contacts(*(np.take(getattr(self, one.name), kept, axis=0) for one in fields(self)))

    @classmethod
    def none(cls) -> "Contacts":
        """Return an empty record."""
        index, vectors = np.zeros(0, np.int64), np.zeros((0, 3))
        return cls(index, index, np.zeros((0, 3), np.int64), np.zeros(0), vectors, vectors)
