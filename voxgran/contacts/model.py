"""Contacts: pairs of grains with gap, normal and point; and the contact of one pair.

The tests of one pair are given each grain in its own frame, the transformation from the frame of the second to that of
the first (`matrix`, a rotation times a scale, and `offset`), and `reach`, the largest distance searched, in the unit of
the first. The contact is in the frame and unit of the first.
"""

from dataclasses import dataclass, fields

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import linear
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


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """The nearest or deepest contact of two grains."""

    gap: float  # distance of the surfaces; negative where they overlap (the depth)
    normal: Floats  # unit vector from the first to the second, (3,)
    point: Floats  # middle between the nearest points, (3,)

    @classmethod
    def apart(cls) -> "Touch":
        """Return the value for grains beyond the distance searched."""
        return cls(np.inf, np.zeros(3), np.zeros(3))

    @classmethod
    def between(cls, distance: float, point: Floats, partner: Floats, offset: Floats) -> "Touch":
        """Return the contact of separate grains at their nearest points; an infinite distance is beyond the search."""
        if distance == np.inf:
            return cls.apart()
        return cls(distance, direction(partner - point, offset), (point + partner) / 2)

    def moved(self, *, matrix: Floats, offset: Floats, factor: float) -> "Touch":
        """Return the contact transformed by `matrix` (a rotation times `factor`) and `offset`."""
        turn = matrix / factor
        return Touch(self.gap * factor, linear.matmul(turn, self.normal), linear.matmul(matrix, self.point) + offset)

    def flipped(self) -> "Touch":
        """Return the contact with both grains exchanged."""
        return Touch(self.gap, -self.normal, self.point)


def direction(vector: Floats, fallback: Floats) -> Floats:
    """Return the unit vector along the first of both vectors that is not zero, else along x."""
    for candidate in (vector, fallback):
        length = float(linear.norm(candidate))
        if length > 0:
            return candidate / length
    return np.array([1.0, 0.0, 0.0])
