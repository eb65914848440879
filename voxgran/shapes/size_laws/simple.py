"""Distributions of grain sizes in closed form: log-normal, uniform, power law, discrete, one size."""

import math
from typing import ClassVar, Literal

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, as_length, as_number
from voxgran._base.config import check_bounds, parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran._base.lazy import load
from voxgran.shapes.size_laws.distribution import SizeDistribution, check_weights, same_length

#: largest standard deviation of the logarithm of the size; sizes then typically differ by a factor of a million
WIDEST = 5.0


@parameter_class
class Lognormal(SizeDistribution):
    """Log-normal distribution, optionally truncated below and above.

    Parameters
    ----------
    median
        median before truncation, in the basis of the distribution.
    sigma
        standard deviation of the natural logarithm of the size.
    low
        lower truncation of the sizes; default: none.
    high
        upper truncation of the sizes; default: none.

    Raises
    ------
    InputError
        If a number is not above 0, `sigma` is above 5, or the cuts leave nothing.
    """

    kind: ClassVar[str] = "lognormal"

    median: float = parameter(unit="length")
    sigma: float = parameter()
    low: float | None = parameter(None, unit="length")
    high: float | None = parameter(None, unit="length")

    def __post_init__(self) -> None:
        """Check the ranges."""
        SizeDistribution.__post_init__(self)
        as_length(self.median, "median")
        as_number(self.sigma, "sigma", above=0.0, at_most=WIDEST)
        for name, value in (("low", self.low), ("high", self.high)):
            if value is not None:
                as_length(value, name)
        below, above = self._cuts(0)
        if not below < above:
            raise InputError(
                f"low is {self.low} and high is {self.high}: next to no grain lies between them; move them apart"
            )

    def _scores(self, sizes: Floats, power: int) -> Floats:
        """Return the standard scores of sizes in the distribution weighted by size**power."""
        with np.errstate(divide="ignore", over="ignore"):
            return np.asarray(libm.log(np.maximum(sizes, 0.0) / self.median) / self.sigma - power * self.sigma)

    def _cuts(self, power: int) -> tuple[float, float]:
        """Return the shares below the two cuts."""
        if self.low is None and self.high is None:
            return 0.0, 1.0
        ends = np.array([self.low or 0.0, self.high or math.inf])
        below, above = load("scipy.special").ndtr(self._scores(ends, power))
        return float(below), float(above)

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Integrate in closed form."""
        below, above = self._cuts(power)
        share = load("scipy.special").ndtr(self._scores(sizes, power))
        moment = self.median**power * math.exp(0.5 * (power * self.sigma) ** 2)
        return np.asarray(moment * (np.clip(share, below, above) - below))

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Invert in closed form; the median is a factor, so that a power of two scales without rounding."""
        below, above = self._cuts(power)
        score = load("scipy.special").ndtri(below + shares * (above - below))
        sizes = self.median * libm.exp(self.sigma * (score + power * self.sigma))
        return np.asarray(np.clip(sizes, self.low or 0.0, self.high or math.inf))


@parameter_class
class Uniform(SizeDistribution):
    """Uniform distribution between two sizes.

    Parameters
    ----------
    low
        smallest size.
    high
        largest size.

    Raises
    ------
    InputError
        If a size is not above 0, or the largest not above the smallest.
    """

    kind: ClassVar[str] = "uniform"

    low: float = parameter(unit="length")
    high: float = parameter(unit="length")

    def __post_init__(self) -> None:
        """Check the ranges."""
        SizeDistribution.__post_init__(self)
        as_number(as_length(self.high, "high"), "high", above=as_length(self.low, "low"))

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Integrate in closed form."""
        return power_law(self.low, self.high, 1.0, sizes, power)

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Invert in closed form."""
        return power_law_inverse(self.low, self.high, 1.0, shares, power)


@parameter_class
class Fuller(SizeDistribution):
    """Power law of concrete and asphalt with a limit of fines: the share below d is (d^n - low^n) / (high^n - low^n).

    Parameters
    ----------
    low
        smallest size.
    high
        largest size.
    exponent
        exponent n of the size.
    basis
        quantity that the shares refer to.

    Raises
    ------
    InputError
        If a number is not above 0, or the largest size not above the smallest.

    References
    ----------
    Fuller & Thompson 1907, doi:10.1061/taceat.0001979; with the limit of fines as in Funk & Dinger 1994,
    doi:10.1007/978-1-4615-3118-0.
    """

    kind: ClassVar[str] = "fuller"

    low: float = parameter(unit="length")
    high: float = parameter(unit="length")
    exponent: float = parameter(0.5, above=0.0, at_most=10.0)
    basis: Literal["number", "volume"] = parameter("volume")

    def __post_init__(self) -> None:
        """Check the ranges."""
        SizeDistribution.__post_init__(self)
        check_bounds(self)
        as_number(as_length(self.high, "high"), "high", above=as_length(self.low, "low"))

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Integrate in closed form."""
        return power_law(self.low, self.high, self.exponent, sizes, power)

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Invert in closed form."""
        return power_law_inverse(self.low, self.high, self.exponent, shares, power)


@parameter_class
class Discrete(SizeDistribution):
    """Discrete distribution: a few sizes, each with its weight.

    Parameters
    ----------
    diameters
        sizes.
    weights
        weights of the sizes; normalized to a sum of 1.

    Raises
    ------
    InputError
        If the numbers of sizes and weights differ, a size is not above 0, a weight is negative or all are 0.
    """

    kind: ClassVar[str] = "discrete"

    diameters: tuple[float, ...] = parameter(unit="length")
    weights: tuple[float, ...] = parameter()

    def __post_init__(self) -> None:
        """Check the ranges."""
        SizeDistribution.__post_init__(self)
        same_length(self.diameters, self.weights, ("diameters", "weights"))
        for value in self.diameters:
            as_length(value, "diameter")
        check_weights(self.weights, "weights", "weight")

    @property
    def is_continuous(self) -> bool:
        """False: there are no sizes between two."""
        return False

    def _reach(self, power: int) -> tuple[float, float, Floats]:
        """Return the smallest and the largest size, and all of them."""
        return min(self.diameters), max(self.diameters), np.array(self.diameters, dtype=np.float64)

    def _steps(self, power: int) -> tuple[Floats, Floats]:
        """Return the sizes in order and their shares, each times size**power in units of the largest."""
        order = np.argsort(self.diameters, kind="stable")
        sizes = np.array(self.diameters, dtype=np.float64)[order]
        shares = np.array(self.weights, dtype=np.float64)[order] / sum(self.weights)
        return sizes, shares * libm.power(sizes / sizes[-1], power)

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Sum the steps."""
        steps, weights = self._steps(power)
        total = np.concatenate([[0.0], np.cumsum(weights)])
        return np.asarray(steps[-1] ** power * total[np.searchsorted(steps, sizes, side="right")])

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Look up the step."""
        steps, weights = self._steps(power)
        total = np.cumsum(weights)
        last = int(np.flatnonzero(weights)[-1])
        place = np.searchsorted(total, shares * total[-1], side="right")
        return np.asarray(steps[np.minimum(place, last)])


@parameter_class
class Fixed(SizeDistribution):
    """One size for all grains.

    Parameters
    ----------
    diameter
        size.

    Raises
    ------
    InputError
        If the size is not above 0.
    """

    kind: ClassVar[str] = "fixed"

    diameter: float = parameter(1.0, unit="length")

    def __post_init__(self) -> None:
        """Check the size."""
        SizeDistribution.__post_init__(self)
        as_length(self.diameter, "diameter")

    @property
    def is_continuous(self) -> bool:
        """False: there is one size."""
        return False

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Return the step function at the size."""
        return np.asarray(np.where(sizes >= self.diameter, self.diameter**power, 0.0))

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Return the size, whatever the share."""
        return np.full(shares.shape, self.diameter)

    def _reach(self, power: int) -> tuple[float, float, Floats]:
        """Return the size."""
        return self.diameter, self.diameter, np.array([self.diameter])


def growth(ratio: Floats, power: float) -> Floats:
    """Return the integral of x**(power - 1) from 1 to a ratio."""
    return libm.log(ratio) if power == 0 else (libm.power(ratio, power) - 1.0) / power


def power_law(low: float, high: float, exponent: float, sizes: Floats, power: int) -> Floats:
    """Integrate size**power over the grains up to sizes, whose number rises as size**exponent."""
    ratio = high / low
    share = growth(np.clip(np.asarray(sizes) / low, 1.0, ratio), power + exponent)
    return np.asarray(low**power * share / growth(np.array(ratio), exponent))


def power_law_inverse(low: float, high: float, exponent: float, shares: Floats, power: int) -> Floats:
    """Return the sizes at which the integral of `power_law` reaches shares of the whole."""
    ratio, total = high / low, power + exponent
    if total == 0:
        return np.asarray(low * libm.power(ratio, shares))
    # exact at both ends
    return np.asarray(np.clip(low * libm.power(1.0 + shares * (ratio**total - 1.0), 1.0 / total), low, high))
