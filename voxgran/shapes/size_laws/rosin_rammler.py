"""The distribution of Rosin and Rammler, by its integrals over the logarithm of the score (d / size)^spread."""

import math
from functools import lru_cache
from typing import ClassVar, Literal

import numpy as np

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, as_length
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.shapes.size_laws.distribution import SizeDistribution, inverted

#: spread of a distribution by volume up to which its fines need a limit, and scores between which grains lie
FINES, TINIEST, LARGEST_SCORE = 6.0, 1e-30, 200.0
#: panels of the integrals
PANELS = 512


@parameter_class
class RosinRammler(SizeDistribution):
    """Rosin-Rammler (Weibull) distribution of crushed material: the share below d is 1 - exp(-(d / size)^spread).

    Parameters
    ----------
    size
        size below which 63.2 % lie before truncation.
    spread
        exponent: the larger, the more uniform.
    low
        lower truncation of the sizes.
    high
        upper truncation of the sizes; default: none.
    basis
        quantity that the shares refer to.

    Raises
    ------
    InputError
        If a number is not above 0, the cuts leave nothing, or without a smallest size the fines are infinitely many.

    References
    ----------
    Rosin & Rammler 1933; Weibull 1951, doi:10.1115/1.4010337.
    """

    kind: ClassVar[str] = "rosin_rammler"

    size: float = parameter(unit="length")
    spread: float = parameter(at_least=0.2, at_most=50.0)
    low: float | None = parameter(None, unit="length")
    high: float | None = parameter(None, unit="length")
    basis: Literal["number", "volume"] = parameter("volume")

    def __post_init__(self) -> None:
        """Check the ranges."""
        SizeDistribution.__post_init__(self)
        check_bounds(self)
        for name, value in (("size", self.size), ("low", self.low), ("high", self.high)):
            if value is not None:
                as_length(value, name)
        if self.low is None and self.basis == "volume" and self.spread < FINES:
            raise InputError(
                f"low is missing: with spread {self.spread:g} by volume the fines are infinitely many; give low, the "
                "smallest size"
            )
        first, last = self._ends()
        if not first < last:
            raise InputError(
                f"low is {self.low} and high is {self.high}: next to no grain lies between them; move them apart"
            )

    def _ends(self) -> tuple[float, float]:
        """Return the scores (d / size)^spread of the smallest and the largest grains."""
        low, high = 0.0 if self.low is None else self.low, math.inf if self.high is None else self.high
        with np.errstate(over="ignore"):
            first, last = (float(np.float64(end / self.size) ** self.spread) for end in (low, high))
        return min(max(first, TINIEST), LARGEST_SCORE), min(last, LARGEST_SCORE)

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Integrate numerically over the logarithm of the score, panel by panel."""
        with np.errstate(divide="ignore", over="ignore"):
            scores = libm.log(np.clip(libm.power(np.maximum(sizes, 0.0) / self.size, self.spread), *self._ends()))
        nodes, parts = _panels(self, power)
        place = np.clip(np.searchsorted(nodes, scores, side="right") - 1, 0, len(nodes) - 2)
        return np.asarray(self.size**power * (parts[place] + _gauss(self, power, nodes[place], scores)))

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Invert in closed form where the power is 0, else between two sizes of a table."""
        if power:
            return inverted(self, shares, power)
        first, last = self._ends()
        with np.errstate(divide="ignore"):
            scores = first - libm.log1p(shares * math.expm1(first - last))
        return np.asarray(
            np.clip(self.size * libm.power(scores, 1.0 / self.spread), self.low or 0.0, self.high or math.inf)
        )

    def _reach(self, power: int) -> tuple[float, float, Floats]:
        """Return the sizes of the smallest and the largest score."""
        low, high = (self.size * end ** (1.0 / self.spread) for end in self._ends())
        return low, high, np.zeros(0)


@lru_cache(maxsize=16)
def _panels(law: RosinRammler, power: int) -> tuple[Floats, Floats]:
    """Return logarithms of scores from the smallest to the largest grain, and the integrals up to each."""
    first, last = libm.log(law._ends())
    nodes = np.linspace(first, last, PANELS + 1)
    return nodes, np.concatenate([[0.0], np.cumsum(_gauss(law, power, nodes[:-1], nodes[1:]))])


def _gauss(law: RosinRammler, power: int, start: Floats, end: Floats) -> Floats:
    """Integrate score**(power / spread) over the distribution between logarithms of scores, by 6 points of Gauss."""
    places, weights = linear.gauss_legendre(6)
    half = 0.5 * (end - start)
    total = np.zeros(np.shape(half))
    for place, weight in zip(places, weights, strict=True):
        at = start + half * (1.0 + place)
        total += weight * half * libm.exp(at * (1.0 + power / law.spread) - libm.exp(at))
    return total
