"""Distributions of grain sizes: log-normal, uniform, discrete, one size, sieve curve.

A size is an equivalent diameter: that of the sphere of equal volume, in two dimensions of the disk of equal area; for a
sieve curve it is the intermediate axis by default. A distribution is given by number or by volume (by mass, for grains
of one density). Each follows exactly from the other: the density by volume is the density by number weighted by d**3
(d**2 in two dimensions), where d is the diameter. Grains are drawn by number.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats, as_choice, as_count, as_length, as_number, as_positive, as_share
from voxgran._base.config import parameter, parameter_class, parameters_of, to_mapping
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load
from voxgran._base.scalars import whole_number_of

Basis = Literal["number", "volume"]
#: largest standard deviation of the logarithm of the size; sizes then typically differ by a factor of a million
WIDEST = 5.0


class SizeDistribution(ABC):
    """A distribution of grain sizes.

    Attributes
    ----------
    kind : str
        Name in scene files.
    basis : {"number", "volume"}
        Quantity that the shares refer to.
    """

    __slots__ = ()

    kind: ClassVar[str]
    basis: Basis

    @property
    def by_intermediate_axis(self) -> bool:
        """Whether sizes are intermediate axes; the caller turns them into equivalent diameters."""
        return False

    def cumulative(self, sizes: "ArrayLike", *, basis: Basis | None = None, dimension: int = 3) -> Floats:
        """Return the cumulative distribution function, the share of grains up to a size.

        Parameters
        ----------
        sizes : array_like of float
            Sizes, in the unit of lengths.
        basis : {"number", "volume"}, optional
            Quantity that the shares refer to. Default: the basis of the distribution.
        dimension : int
            2 or 3.

        Returns
        -------
        ndarray of float
            Shares in [0, 1], in the shape of `sizes`.

        Raises
        ------
        InputError
            If the basis is not known or the dimension is not 2 or 3.
        """
        power = self._power(basis, dimension)
        whole = self._partial(np.array(math.inf), power)
        return self._partial(np.asarray(sizes, dtype=np.float64), power) / whole

    def quantile(self, shares: "ArrayLike", *, basis: Basis | None = None, dimension: int = 3) -> Floats:
        """Return the sizes up to which given shares of the grains lie.

        Parameters
        ----------
        shares : array_like of float
            Shares in [0, 1]; 0.5 gives the median.
        basis : {"number", "volume"}, optional
            Quantity that the shares refer to. Default: the basis of the distribution.
        dimension : int
            2 or 3.

        Returns
        -------
        ndarray of float
            Sizes, in the unit of lengths, in the shape of `shares`.

        Raises
        ------
        InputError
            If a share is not in [0, 1], the basis is not known or the dimension is not 2 or 3.
        """
        share = np.asarray(shares, dtype=np.float64)
        if share.size and not ((share >= 0) & (share <= 1)).all():
            raise InputError(f"shares reach from {share.min()} to {share.max()}: each must be in [0, 1]; change them")
        return self._inverse(share, self._power(basis, dimension))

    def sample(self, count: int, generator: np.random.Generator, *, dimension: int = 3) -> Floats:
        """Draw random grain sizes, by number.

        Parameters
        ----------
        count : int
            Number of sizes.
        generator : numpy.random.Generator
            Source of random numbers.
        dimension : int
            2 or 3; used only if the distribution is given by volume.

        Returns
        -------
        (count,) ndarray of float
            Sizes, in the unit of lengths.

        Raises
        ------
        InputError
            If the count is negative or the dimension not 2 or 3.
        """
        draws = generator.random(as_count(count, "count"))
        # 0 is a possible draw, the size 0 is not
        return self._inverse(np.maximum(draws, 2.0**-54), self._power("number", dimension))

    def mean_volume(self, *, dimension: int = 3) -> float:
        """Return the mean volume of a grain (area in 2D).

        Parameters
        ----------
        dimension : int
            2 or 3.

        Raises
        ------
        InputError
            If the dimension is not 2 or 3.
        """
        power, whole = self._power("number", dimension), np.array(math.inf)
        mean = float(self._partial(whole, power + dimension) / self._partial(whole, power))
        return mean * math.pi / (6 if dimension == 3 else 4)

    def scaled(self, factor: float) -> Self:
        """Return the distribution with all sizes multiplied by a factor above 0.

        Raises
        ------
        InputError
            If the factor is not a finite number above 0.
        """
        times = as_positive(factor, "factor")
        sizes: dict[str, Any] = {}
        for entry in parameters_of(type(self)):
            value = getattr(self, entry.name)
            if entry.unit == "length" and value is not None:
                sizes[entry.name] = tuple(times * v for v in value) if isinstance(value, tuple) else times * value
        return replace(self, **sizes)  # type: ignore[type-var]

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values, from which `make_sizes` restores the distribution."""
        values = {key: value for key, value in to_mapping(self).items() if value is not None}
        return {"kind": self.kind, **values}

    def _power(self, basis: Basis | None, dimension: int) -> int:
        """Return k such that the share in the wanted basis is the integral of size**k in the distribution's basis."""
        wanted = self.basis if basis is None else as_choice(basis, "basis", ("number", "volume"))
        if whole_number_of(dimension) not in (2, 3):
            raise InputError(f"dimension is {shown(dimension)}: it must be 2 or 3")
        return dimension * ((wanted == "volume") - (self.basis == "volume"))

    @abstractmethod
    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Integrate size**power over the grains up to the sizes, in the distribution's basis."""

    @abstractmethod
    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Return the sizes at which the partial integral reaches the shares of the whole."""


@parameter_class
class Lognormal(SizeDistribution):
    """Log-normal distribution, optionally truncated below and above.

    Raises
    ------
    InputError
        If a number is not above 0, `sigma` is above 5, or the cuts leave nothing.
    """

    kind: ClassVar[str] = "lognormal"

    median: float = parameter(doc="median before truncation, in the basis of the distribution", unit="length")
    sigma: float = parameter(doc="standard deviation of the natural logarithm of the size")
    basis: Literal["number", "volume"] = parameter("number", doc="quantity that the shares refer to")
    low: float | None = parameter(None, doc="lower truncation of the sizes; default: none", unit="length")
    high: float | None = parameter(None, doc="upper truncation of the sizes; default: none", unit="length")

    def __post_init__(self) -> None:
        """Check the ranges."""
        as_length(self.median, "median")
        as_number(self.sigma, "sigma", above=0.0, at_most=WIDEST)
        as_choice(self.basis, "basis", ("number", "volume"))
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
            return np.asarray(np.log(np.maximum(sizes, 0.0) / self.median) / self.sigma - power * self.sigma)

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
        sizes = self.median * np.exp(self.sigma * (score + power * self.sigma))
        return np.asarray(np.clip(sizes, self.low or 0.0, self.high or math.inf))


@parameter_class
class Uniform(SizeDistribution):
    """Uniform distribution between two sizes.

    Raises
    ------
    InputError
        If a size is not above 0, or the largest not above the smallest.
    """

    kind: ClassVar[str] = "uniform"

    low: float = parameter(doc="smallest size", unit="length")
    high: float = parameter(doc="largest size", unit="length")
    basis: Literal["number", "volume"] = parameter("number", doc="quantity that the shares refer to")

    def __post_init__(self) -> None:
        """Check the ranges."""
        as_choice(self.basis, "basis", ("number", "volume"))
        as_number(as_length(self.high, "high"), "high", above=as_length(self.low, "low"))

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Integrate in closed form."""
        ratio = self.high / self.low
        share = (np.clip(sizes / self.low, 1.0, ratio) ** (power + 1) - 1.0) / (power + 1)
        return np.asarray(self.low**power * share / (ratio - 1.0))

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Invert in closed form."""
        if power == 0:
            return np.asarray(self.low + shares * (self.high - self.low))
        whole = (self.high / self.low) ** (power + 1) - 1.0
        return np.asarray(self.low * (1.0 + shares * whole) ** (1.0 / (power + 1)))


@parameter_class
class Discrete(SizeDistribution):
    """Discrete distribution: a few sizes, each with its weight.

    Raises
    ------
    InputError
        If the numbers of sizes and weights differ, a size is not above 0, a weight is negative or all are 0.
    """

    kind: ClassVar[str] = "discrete"

    diameters: tuple[float, ...] = parameter(doc="sizes", unit="length")
    weights: tuple[float, ...] = parameter(doc="weights of the sizes; normalized to a sum of 1")
    basis: Literal["number", "volume"] = parameter("number", doc="quantity that the weights refer to")

    def __post_init__(self) -> None:
        """Check the ranges."""
        as_choice(self.basis, "basis", ("number", "volume"))
        _same_length(self.diameters, self.weights, ("diameters", "weights"))
        for value in self.diameters:
            as_length(value, "diameter")
        for value in self.weights:
            as_number(value, "weight", at_least=0.0)
        if not 0 < sum(self.weights) < math.inf:
            given = shown(list(self.weights))
            raise InputError(f"weights are {given}: one must be above 0, and their sum finite; change them")

    def _steps(self, power: int) -> tuple[Floats, Floats]:
        """Return the sizes in order and their shares, each times size**power in units of the largest."""
        order = np.argsort(self.diameters, kind="stable")
        sizes = np.array(self.diameters, dtype=np.float64)[order]
        shares = np.array(self.weights, dtype=np.float64)[order] / sum(self.weights)
        return sizes, shares * (sizes / sizes[-1]) ** power

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

    Raises
    ------
    InputError
        If the size is not above 0.
    """

    kind: ClassVar[str] = "fixed"

    diameter: float = parameter(1.0, doc="size", unit="length")
    basis: Literal["number", "volume"] = parameter("number", doc="quantity that the shares refer to; without effect")

    def __post_init__(self) -> None:
        """Check the size."""
        as_length(self.diameter, "diameter")
        as_choice(self.basis, "basis", ("number", "volume"))

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Return the step function at the size."""
        return np.asarray(np.where(sizes >= self.diameter, self.diameter**power, 0.0))

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Return the size, whatever the share."""
        return np.full(shares.shape, self.diameter)


@parameter_class
class Sieve(SizeDistribution):
    """Measured sieve curve, interpolated linearly in the logarithm of the opening.

    Raises
    ------
    InputError
        If there are fewer than two sieves, openings do not increase, or shares do not rise from 0 to 1.
    """

    kind: ClassVar[str] = "sieve"

    openings: tuple[float, ...] = parameter(doc="openings of the sieves, strictly increasing", unit="length")
    passing: tuple[float, ...] = parameter(doc="share that passes each sieve, increasing from 0 to 1")
    as_diameter: bool = parameter(False, doc="whether openings are equivalent diameters rather than intermediate axes")
    basis: Literal["number", "volume"] = parameter("volume", doc="quantity that the shares refer to")

    def __post_init__(self) -> None:
        """Check the ranges."""
        as_choice(self.basis, "basis", ("number", "volume"))
        _same_length(self.openings, self.passing, ("openings", "passing"))
        for value in self.openings:
            as_length(value, "opening")
        for value in self.passing:
            as_share(value, "passing", zero=True)
        if len(self.openings) < 2 or (np.diff(self.openings) <= 0).any():
            given = shown(list(self.openings))
            raise InputError(f"openings are {given}: at least two must increase strictly; sort them")
        if (np.diff(self.passing) < 0).any() or self.passing[0] != 0 or self.passing[-1] != 1:
            raise InputError(
                f"passing is {shown(list(self.passing))}: it must rise from 0 to 1, never falling; add an opening that "
                "nothing passes and one that all passes"
            )

    @property
    def by_intermediate_axis(self) -> bool:
        """Whether sizes are intermediate axes; the caller turns them into equivalent diameters."""
        return not self.as_diameter

    def _bins(self, power: int) -> tuple[Floats, Floats, Floats]:
        """Return lower openings, ratios to the upper ones, and the integrals of (size / largest)**power."""
        openings, passing = np.array(self.openings), np.array(self.passing)
        low, ratio = openings[:-1], openings[1:] / openings[:-1]
        height = np.diff(passing) / np.log(ratio)
        return low, ratio, height * (low / openings[-1]) ** power * _growth(ratio, power)

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Integrate in closed form, bin by bin."""
        low, ratio, weights = self._bins(power)
        total = np.concatenate([[0.0], np.cumsum(weights)])
        place = np.clip(np.searchsorted(self.openings, sizes, side="right") - 1, 0, len(low) - 1)
        inside = np.clip(sizes / low[place], 1.0, ratio[place])
        part = _growth(inside, power) / _growth(ratio[place], power)
        return np.asarray(self.openings[-1] ** power * (total[place] + weights[place] * part))

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Invert in closed form, bin by bin."""
        low, ratio, weights = self._bins(power)
        full = np.flatnonzero(weights)
        low, ratio, weights = low[full], ratio[full], weights[full]
        total = np.cumsum(weights)
        want = shares * total[-1]
        place = np.minimum(np.searchsorted(total, want, side="right"), len(low) - 1)
        part = np.clip(1.0 - (total[place] - want) / weights[place], 0.0, 1.0)
        if power == 0:
            return np.asarray(low[place] * ratio[place] ** part)
        return np.asarray(low[place] * (1.0 + part * (ratio[place] ** power - 1.0)) ** (1.0 / power))


def _growth(ratio: Floats, power: int) -> Floats:
    """Return the integral of x**(power - 1) from 1 to a ratio."""
    return np.log(ratio) if power == 0 else (ratio**power - 1.0) / power


def _same_length(one: tuple[float, ...], two: tuple[float, ...], names: tuple[str, str]) -> None:
    """Refuse lists that do not correspond."""
    if len(one) != len(two) or not one:
        raise InputError(
            f"{names[0]} has {len(one)} entries and {names[1]} {len(two)}: give as many of both, at least one"
        )
