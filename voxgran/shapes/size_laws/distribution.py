"""What distributions of grain sizes have in common.

A size is an equivalent diameter: that of the sphere of equal volume, in two dimensions of the disk of equal area; for a
sieve curve it is the intermediate axis by default. A distribution is given by number or by volume (by mass, for grains
of one density). Each follows exactly from the other: the density by volume is the density by number weighted by d**3
(d**2 in two dimensions), where d is the diameter. Grains are drawn by number.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from functools import lru_cache
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arithmetic import libm, linear
from voxgran._base.arrays import Floats, as_choice, as_count, as_flag, as_number, as_positive
from voxgran._base.config import parameter, parameter_class, parameters_of, to_mapping
from voxgran._base.errors import InputError, shown
from voxgran._base.lazy import load
from voxgran._base.scalars import whole_number_of

Basis = Literal["number", "volume"]
#: how many of the largest grains have the mean volume of their strata, and ratio of the sizes that a wide one ends at
LARGEST, WIDE = 4096, 1.05
#: nodes of the tables by which sizes are found, most steps between two nodes, and error of a share that ends them
NODES, STEPS, CLOSE = 4097, 60, 1e-13
#: from how many sizes on they are found by polynomials, points of each polynomial, and error of a share at these points
MANY, POINTS, EXACT = 100_000, 8, 5e-16


@parameter_class
class SizeDistribution(ABC):
    """A distribution of grain sizes; `kind` is its name in scene files.

    Parameters
    ----------
    basis
        quantity that the shares refer to.
    independent
        whether each size is drawn independently of the others, as in a sample of a population, rather than one from
        each of as many strata as there are grains, which follow the distribution as nearly as so many can.
    """

    kind: ClassVar[str]

    basis: Literal["number", "volume"] = parameter("number")
    independent: bool = parameter(False)

    def __post_init__(self) -> None:
        """Check what all distributions have."""
        as_choice(self.basis, "basis", ("number", "volume"))
        as_flag(self.independent, "independent")

    @property
    def is_continuous(self) -> bool:
        """Whether sizes between two that occur occur too, apart from gaps."""
        return True

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
        law, unit = self._in_unit()
        return law._inverse(share, self._power(basis, dimension)) * unit

    def sample(self, count: int, generator: np.random.Generator, *, dimension: int = 3) -> Floats:
        """Draw random grain sizes, by number, each independently of the others.

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
        law, unit = self._in_unit()
        # 0 is a possible draw, the size 0 is not
        return law._inverse(np.maximum(draws, 2.0**-54), self._power("number", dimension)) * unit

    def strata(self, count: int, generator: np.random.Generator, *, dimension: int = 3) -> Floats:
        """Return sizes that follow the distribution as nearly as so many grains can, the smallest first.

        The distribution is divided into strata of equal number, one for each grain, whose size is random within its
        stratum. If the distribution is given by volume, each of the largest grains whose stratum is wide has the mean
        volume of the stratum instead, so that the shares by volume hold as well: one large grain is often a large part
        of the volume of all.

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
        n, power = as_count(count, "count"), self._power("number", dimension)
        law, unit = self._in_unit()
        shares = np.arange(n, dtype=np.float64)
        shares += generator.random(n)
        shares /= max(n, 1)
        # 0 is a possible share, the size 0 is not
        sizes = law._inverse(np.maximum(shares, 2.0**-54, out=shares), power)
        if self.basis == "volume" and self.is_continuous and n:
            first = max(0, n - LARGEST)
            ends = law._inverse(np.maximum(np.arange(first, n + 1) / n, 2.0**-54), power)
            volumes = n * np.diff(law._partial(ends, power + dimension)) / law._partial(np.array(math.inf), power)
            mean = np.clip(libm.power(volumes, 1.0 / dimension), ends[:-1], ends[1:])
            sizes[first:] = np.where(ends[1:] > WIDE * ends[:-1], mean, sizes[first:])
        sizes *= unit
        return sizes

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
        law, unit = self._in_unit()
        mean = float(law._partial(whole, power + dimension) / law._partial(whole, power))
        return mean * unit**dimension * math.pi / (6 if dimension == 3 else 4)

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
        return replace(self, **sizes)

    def _in_unit(self) -> tuple[Self, float]:
        """Return the distribution in a power of two as the unit, and this unit.

        Logarithms, roots and powers then round in the same way in all units that differ by a power of two.
        """
        unit = 2.0 ** (math.frexp(self._length())[1] - 1)
        return (self, 1.0) if unit == 1.0 else (self.scaled(1.0 / unit), unit)

    def _length(self) -> float:
        """Return the first length that is given."""
        values = (getattr(self, entry.name) for entry in parameters_of(type(self)) if entry.unit == "length")
        return float(np.ravel(next(value for value in values if value is not None))[-1])

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values, from which `make_sizes` restores the distribution."""
        values = {key: value for key, value in to_mapping(self).items() if value is not None}
        if not values.pop("independent"):
            return {"kind": self.kind, **values}
        return {"kind": self.kind, **values, "independent": True}

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

    def _reach(self, power: int) -> tuple[float, float, Floats]:
        """Return between which sizes next to all of the integral of size**power lies, and at which it has steps."""
        low, high = self._inverse(np.array([2.0**-54, 1.0 - 2.0**-53]), power)
        return float(low), float(high), np.zeros(0)


def same_length(one: tuple[Any, ...], two: tuple[Any, ...], names: tuple[str, str]) -> None:
    """Refuse lists that do not correspond.

    Raises
    ------
    InputError
        If their lengths differ, or they are empty.
    """
    if len(one) != len(two) or not one:
        raise InputError(
            f"{names[0]} has {len(one)} entries and {names[1]} {len(two)}: give as many of both, at least one"
        )


def check_weights(values: tuple[float, ...], name: str, one: str) -> None:
    """Refuse weights of which one is negative or all are 0.

    Raises
    ------
    InputError
        If one is negative, or all are 0.
    """
    for value in values:
        as_number(value, one, at_least=0.0)
    if not 0 < sum(values) < math.inf:
        raise InputError(f"{name} are {shown(list(values))}: one must be above 0, and their sum finite; change them")


@lru_cache(maxsize=16)
def _table(law: SizeDistribution, power: int) -> tuple[Floats, Floats]:
    """Return sizes, from small to large, and the shares of the whole integral of size**power up to them: from 0 to 1.

    Where the distribution has a step, so has the table.
    """
    low, high, steps = law._reach(power)
    sizes = np.unique(np.concatenate([np.geomspace(low, high, NODES), steps, np.nextafter(steps, 0.0)]))
    shares = law._partial(sizes, power) / law._partial(np.array(math.inf), power)
    shares[0], shares[-1] = 0.0, 1.0
    return sizes, shares


def inverted(law: SizeDistribution, shares: Floats, power: int) -> Floats:
    """Return the sizes at which the integral of size**power reaches shares of the whole; many by polynomials."""
    if shares.size < MANY:
        return _iterated(law, shares, power)
    sizes = np.asarray(libm.exp(_curve(law, power)(shares)))
    others = np.isnan(sizes)
    sizes[others] = _iterated(law, shares[others], power)
    return sizes


@lru_cache(maxsize=16)
def _curve(law: SizeDistribution, power: int) -> Any:
    """Return the logarithm of the size as piecewise polynomials of the share of the whole integral of size**power.

    Between two nodes of a table the polynomial goes through sizes that are iterated. It is NaN where it misses others
    by more than the iteration may, as beside gaps of a distribution, and far in its tails.
    """
    nodes = np.unique(_table(law, power)[1])
    first, step = nodes[:-1], np.diff(nodes)
    at = 0.5 - 0.5 * libm.cos(np.pi * (np.arange(POINTS) + 0.5) / POINTS)
    known = libm.log(_iterated(law, first + step * at[:, None], power, EXACT))
    factors = linear.solve(np.vander(at), known)
    between = np.concatenate([[0.0], 0.5 * (at[1:] + at[:-1]), [1.0]])
    made = libm.exp(linear.matmul(np.vander(between, POINTS), factors))
    missed = law._partial(made, power) / law._partial(np.array(math.inf), power) - first - step * between[:, None]
    # where the distribution has a step, all shares have one size
    wrong = (np.abs(missed).max(axis=0) > CLOSE) & (np.ptp(known, axis=0) > EXACT) | (step < EXACT)
    factors[:, wrong], step[wrong] = np.nan, 1.0
    return load("scipy.interpolate").PPoly(
        factors / libm.power(step, np.arange(POINTS - 1.0, -1.0, -1.0)[:, None]), nodes
    )


def _iterated(law: SizeDistribution, shares: Floats, power: int, close: float = CLOSE) -> Floats:
    """Return the sizes of shares to an error of these, found between two of a table.

    Regula falsi, of which the Illinois rule halves the share of an end that stays, goes on where it has not converged.
    """
    sizes, known = _table(law, power)
    want, whole = np.asarray(shares, dtype=np.float64), law._partial(np.array(math.inf), power)
    place = np.clip(np.searchsorted(known, want.ravel(), side="right"), 1, len(sizes) - 1)
    found, left = sizes[place], np.arange(want.size)
    low, high, aim = sizes[place - 1], sizes[place], want.ravel()
    under, over = known[place - 1] - aim, known[place] - aim
    for _ in range(STEPS):
        middle = np.clip(high - over * (high - low) / np.maximum(over - under, 1e-300), low, high)
        rest = law._partial(middle, power) / whole - aim
        found[left] = middle
        going = (np.abs(rest) > close) & (high > low)
        left, aim, middle, rest = left[going], aim[going], middle[going], rest[going]
        low, high, under, over = low[going], high[going], under[going], over[going]
        below = rest < 0.0
        under, over = np.where(below, rest, 0.5 * under), np.where(below, 0.5 * over, rest)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
        if not len(left):
            break
    return found.reshape(want.shape)
