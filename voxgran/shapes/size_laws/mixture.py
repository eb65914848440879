"""Several distributions of grain sizes together."""

import math
from dataclasses import replace
from typing import Any, ClassVar, Literal

import numpy as np

from voxgran._base.arrays import Floats, check_type
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import InputError
from voxgran.shapes.size_laws.distribution import SizeDistribution, check_weights, inverted, same_length


@parameter_class
class Mixture(SizeDistribution):
    """Several distributions together, each with its share by volume or by number.

    Parameters
    ----------
    parts
        distributions; in a scene a list of tables such as [sizes].
    shares
        shares of the distributions; normalized to a sum of 1.
    basis
        quantity that the shares refer to.

    Raises
    ------
    InputError
        If the numbers of distributions and shares differ, a share is negative or all are 0.
    """

    kind: ClassVar[str] = "mixture"

    parts: tuple[Any, ...] = parameter()
    shares: tuple[float, ...] = parameter()
    basis: Literal["number", "volume"] = parameter("volume")

    def __post_init__(self) -> None:
        """Check the ranges."""
        SizeDistribution.__post_init__(self)
        same_length(self.parts, self.shares, ("parts", "shares"))
        for part in self.parts:
            check_type(part, SizeDistribution, "part", "a distribution such as vg.sizes.uniform(1, 2)")
            if part.basis != self.basis:
                raise InputError(
                    f"a part is by {part.basis} and the mixture by {self.basis}: give the part basis={self.basis!r}"
                )
        if len({part.by_intermediate_axis for part in self.parts}) > 1:
            raise InputError("parts has intermediate axes and equivalent diameters: give sieve curves as_diameter=True")
        check_weights(self.shares, "shares", "share")

    @property
    def by_intermediate_axis(self) -> bool:
        """Whether sizes are intermediate axes; the caller turns them into equivalent diameters."""
        return bool(self.parts[0].by_intermediate_axis)

    @property
    def is_continuous(self) -> bool:
        """Whether sizes between two that occur occur too, apart from gaps."""
        return all(part.is_continuous for part in self.parts)

    def scaled(self, factor: float) -> "Mixture":
        """Return the distribution with all sizes multiplied by a factor above 0.

        Raises
        ------
        InputError
            If the factor is not a finite number above 0.
        """
        return replace(self, parts=tuple(part.scaled(factor) for part in self.parts))

    def _length(self) -> float:
        """Return a length of the first part."""
        return self.parts[0]._length()

    def to_mapping(self) -> dict[str, Any]:
        """Return kind and parameters as JSON-able values, from which `make_sizes` restores the distribution."""
        return SizeDistribution.to_mapping(self) | {"parts": [part.to_mapping() for part in self.parts]}

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Sum the parts."""
        total, whole = np.zeros(np.shape(sizes)), np.array(math.inf)
        for part, share in zip(self.parts, self.shares, strict=True):
            total += share / sum(self.shares) * part._partial(sizes, power) / part._partial(whole, 0)
        return total

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Invert between two sizes of a table."""
        return inverted(self, shares, power)

    def _reach(self, power: int) -> tuple[float, float, Floats]:
        """Join the parts."""
        low, high, steps = zip(*(part._reach(power) for part in self.parts), strict=True)
        return min(low), max(high), np.concatenate(steps)
