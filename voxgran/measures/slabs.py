"""Spheres near a box, found from their order along each axis, so that thin slices do not visit all spheres."""

from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran.containers.model import Container

#: share of the spheres above which all are visited
MOST = 0.5
#: relative widening of a slab against rounding
SLACK = 1e-12


@dataclass(frozen=True, eq=False)
class Ordered:
    """Coordinates of centers along one axis in ascending order; on a periodic axis they are folded into one period."""

    places: Floats  # (n,)
    order: Integers  # (n,) indices of the spheres
    low: float  # lower end of the period
    period: float  # 0 on an axis that is not periodic

    @classmethod
    def of(cls, centers: Floats, container: Container, axis: int) -> "Ordered":
        """Return the spheres with centers (n, 3) in their order along an axis."""
        low, high = container.bounds[:, axis]
        period = float(high - low) if container.periodic[axis] else 0.0
        places = np.mod(centers[:, axis] - low, period) if period else centers[:, axis]
        order = np.argsort(places)
        return cls(places[order], order, float(low), period)

    def between(self, start: float, end: float) -> list[tuple[int, int]]:
        """Return the ranges of `order` with the spheres whose centers, or periodic images of them, are in an interval.

        On a periodic axis one end of a range may hold centers just outside.
        """
        if not self.period:
            return [self._range(start, end)]
        if end - start >= self.period:
            return [(0, len(self.order))]
        begin = float(np.mod(start - self.low, self.period))
        beyond = begin + (end - start) - self.period
        if beyond < 0.0:
            return [self._range(begin, begin + (end - start))]
        return [self._range(0.0, beyond), self._range(begin, self.period)]

    def _range(self, start: float, end: float) -> tuple[int, int]:
        """Return the range of places in a closed interval."""
        return int(np.searchsorted(self.places, start, "left")), int(np.searchsorted(self.places, end, "right"))


def near_box(ordered: list[Ordered], reach: float, lower: Floats, upper: Floats) -> Integers | None:
    """Return, in ascending order, the spheres that may reach into a box, or None where these are most of all.

    It is the axis along which fewest spheres are near that selects them; none is left out, and others may be included.

    Parameters
    ----------
    ordered : list of Ordered
        The spheres along each of the d axes.
    reach : float
        Largest radius.
    lower, upper : (d,) ndarray of float
        Corners of the box, infinite on open sides.
    """
    fewest, chosen = MOST * len(ordered[0].order), None
    for axis, along in enumerate(ordered):
        if not (np.isfinite(lower[axis]) and np.isfinite(upper[axis])):
            continue
        wide = reach + SLACK * (reach + abs(lower[axis]) + abs(upper[axis]))
        ranges = along.between(lower[axis] - wide, upper[axis] + wide)
        count = sum(end - start for start, end in ranges)
        if count < fewest:
            fewest, chosen = count, np.concatenate([along.order[start:end] for start, end in ranges])
    return None if chosen is None else np.sort(chosen)
