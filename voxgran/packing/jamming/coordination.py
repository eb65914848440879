"""Contacts of spheres at given gaps: mean numbers of contacts, and the spheres that none hold."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Booleans, Floats, Integers
from voxgran._base.kernels import kernel


@dataclass(frozen=True, eq=False)
class NearPairs:
    """Pairs of spheres and their gaps (m,), and gaps of spheres to walls (k,), in one unit of lengths.

    count: number of spheres.  i, j: (m,) spheres of a pair.  at_wall: (k,) the sphere of each gap to a wall.
    """

    count: int
    dimension: int
    i: Integers
    j: Integers
    gap: Floats
    at_wall: Integers
    wall_gap: Floats

    def numbers(self, gap: float) -> Integers:
        """Return how many contacts each sphere has, (n,), with gaps up to a limit."""
        pairs, walls = self.gap <= gap, self.wall_gap <= gap
        return self._numbers(pairs, walls, np.ones(self.count, dtype=bool))

    def bearing(self, gap: float, fewest: int | None = None, *, repeated: bool = True) -> Booleans:
        """Return whether each sphere is no rattler, (n,), by its contacts with gaps up to a limit.

        A rattler has fewer contacts than `fewest`, by default the dimension and one. A contact with a wall counts as
        one of its sphere. If `repeated`, contacts with rattlers do not count.
        """
        pairs, walls = self.gap <= gap, self.wall_gap <= gap
        least = self.dimension + 1 if fewest is None else fewest
        numbers = self._numbers(pairs, walls, np.ones(self.count, dtype=bool))
        held = np.asarray(numbers >= least)
        if repeated and not held.all():
            _remove(self.i[pairs], self.j[pairs], least, numbers, held)
        return held

    def held(self, gap: float) -> tuple[float, float]:
        """Return the mean number of contacts of spheres that are no rattlers, and the share of rattlers.

        A rattler has fewer contacts with others that are none than the dimension and one. A contact with a wall counts
        as one of its sphere.
        """
        held = self.bearing(gap)
        many = int(held.sum())
        numbers = self._numbers(self.gap <= gap, self.wall_gap <= gap, held)
        mean = float(numbers[held].sum()) / many if many else 0.0
        return mean, 1.0 - many / max(self.count, 1)

    def _numbers(self, pairs: Booleans, walls: Booleans, held: Booleans) -> Integers:
        """Return numbers of contacts among the spheres that are held, by the contacts that count."""
        live = pairs & held[self.i] & held[self.j]
        ends = np.concatenate([self.i[live], self.j[live], self.at_wall[walls & held[self.at_wall]]])
        return np.bincount(ends, minlength=self.count)


@kernel
def _remove(i, j, least, numbers, held):  # type: ignore[no-untyped-def]
    """Remove spheres with fewer contacts than `least`, and then those that have fewer without them, until none has.

    It is the same whatever the order, so that each contact is looked at once from each end.
    """
    first, following = np.full(len(held), -1), np.empty(2 * len(i), dtype=np.int64)
    waiting, many = np.empty(len(held), dtype=np.int64), 0
    for k in range(len(i)):
        # the contacts of a sphere as a chain of ends: 2 k of sphere i and 2 k + 1 of sphere j
        following[2 * k], first[i[k]] = first[i[k]], 2 * k
        following[2 * k + 1], first[j[k]] = first[j[k]], 2 * k + 1
    for sphere in range(len(held)):
        if not held[sphere]:
            waiting[many] = sphere
            many += 1
    while many > 0:
        many -= 1
        end = first[waiting[many]]
        while end >= 0:
            other = i[end // 2] if end % 2 else j[end // 2]
            numbers[other] -= 1
            if held[other] and numbers[other] < least:
                held[other] = False
                waiting[many] = other
                many += 1
            end = following[end]
