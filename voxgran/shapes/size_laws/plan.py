"""How nearly so many grains can follow a distribution of sizes, before anything is packed."""

import math
from dataclasses import dataclass

import numpy as np

from voxgran._base import ExplainedAttributes
from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, as_count, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.shapes.size_laws.distribution import LARGEST, SizeDistribution

#: shares by volume below which the sizes D10 to D60 lie
SHARES = {"D10": 0.1, "D30": 0.3, "D50": 0.5, "D60": 0.6}
#: distances for which the number of grains is stated, shares by volume of fines that are left out, and most grains
DISTANCES, CUTS, MOST = (0.05, 0.02), (0.01, 0.05, 0.1), 10**12
#: most grains of a plan
MOST_PLANNED = 10_000_000
#: distance above which a packing warns
FAR = 0.1


@dataclass(frozen=True, slots=True)
class SizePlan(ExplainedAttributes):
    """How nearly a number of grains can follow a distribution.

    Attributes
    ----------
    count : int
        Number of grains.
    asked, held : dict
        D10, D30, D50 and D60, the sizes below which 10 to 60 percent by volume lie, the coefficient of uniformity
        Cu = D60 / D10 and that of curvature Cc = D30^2 / (D10 D60): of the distribution, and of the grains.
    distance : float
        Largest difference of the shares by volume up to a size (Kolmogorov and Smirnov).
    at : float
        Size at which it is.
    largest, largest_share, beyond : float
        Size of the largest grain, its share of the volume of all, and the share by volume of the distribution that is
        larger.
    counts : dict
        How many grains, drawn from strata, follow the distribution to a distance of 0.05, and of 0.02.
    fines : tuple of (float, float, float)
        Size, and which shares by volume and by number of the distribution are smaller: what would be left out.
    """

    count: int
    asked: dict[str, float]
    held: dict[str, float]
    distance: float
    at: float
    largest: float
    largest_share: float
    beyond: float
    counts: dict[float, int]
    fines: tuple[tuple[float, float, float], ...]

    def __str__(self) -> str:
        """Return it as a person reads it."""
        lines = [f"{'':8s}{'asked':>12s}{f'{self.count} grains':>16s}"]
        lines += [f"{name:8s}{self.asked[name]:12.4g}{self.held[name]:16.4g}" for name in self.asked]
        lines.append(
            f"distance by volume {self.distance:.3f}, largest at {self.at:.4g}; the largest grain, {self.largest:.4g}, "
            f"is {100 * self.largest_share:.2g} % of the volume, and {100 * self.beyond:.2g} % of the curve is larger"
        )
        lines += [f"{count} grains follow the curve to {distance:g}" for distance, count in self.counts.items()]
        lines += [
            f"below {size:.4g} are {100 * volume:.2g} % of the volume and {100 * number:.3g} % of the grains"
            for size, volume, number in self.fines
        ]
        return "\n".join(lines)


@explained(hint="plan_sizes(vg.sizes.lognormal(2.0, 0.5), 500)")
def plan_sizes(sizes: SizeDistribution, count: int, *, dimension: int = 3, seed: int = 0) -> SizePlan:
    """Return how nearly a number of grains can follow a distribution of sizes.

    Parameters
    ----------
    sizes : SizeDistribution
        The distribution.
    count : int
        Number of grains.
    dimension : int
        2 or 3; volumes are areas in two dimensions.
    seed : int
        Seed of the sizes.

    Raises
    ------
    InputError
        If the count is not from 1 to ten million, or something else is no distribution.

    Examples
    --------
    >>> import voxgran as vg
    >>> curve = vg.sizes.sieve([2.8, 4, 8, 16, 31.5, 63], [0, 4, 15, 35, 65, 100])
    >>> plan = vg.plan_sizes(curve, 500)
    >>> round(plan.distance, 2), round(plan.largest_share, 2)
    (0.19, 0.33)
    """
    check_type(sizes, SizeDistribution, "sizes", "a distribution such as vg.sizes.lognormal(2.0, 0.5)")
    n = as_count(count, "count", at_least=1, at_most=MOST_PLANNED)
    drawn = (sizes.sample if sizes.independent else sizes.strata)(n, stream(seed, "sizes"), dimension=dimension)
    drawn = np.sort(drawn)
    volumes = libm.power(drawn, dimension) / libm.power(drawn, dimension).sum()
    held = np.cumsum(volumes)
    points, first = np.unique(drawn, return_index=True)
    at = held[np.append(first[1:], n) - 1]
    differences = np.abs(
        [
            at - sizes.cumulative(points, basis="volume", dimension=dimension),
            np.append(0.0, at[:-1]) - sizes.cumulative(points * (1.0 - 1e-12), basis="volume", dimension=dimension),
        ]
    ).max(axis=0)
    cuts = sizes.quantile(CUTS, basis="volume", dimension=dimension)
    numbers = sizes.cumulative(cuts, basis="number", dimension=dimension)
    return SizePlan(
        count=n,
        asked=_sizes_at(sizes.quantile(list(SHARES.values()), basis="volume", dimension=dimension)),
        held=_sizes_at(drawn[np.minimum(np.searchsorted(held, list(SHARES.values())), n - 1)]),
        distance=float(differences.max()),
        at=float(points[np.argmax(differences)]),
        largest=float(drawn[-1]),
        largest_share=float(volumes[-1]),
        beyond=float(1.0 - sizes.cumulative(drawn[-1], basis="volume", dimension=dimension)),
        counts={distance: count_within(sizes, distance, dimension) for distance in DISTANCES},
        fines=tuple(zip(cuts.tolist(), CUTS, numbers.tolist(), strict=True)),
    )


def _sizes_at(found: Floats) -> dict[str, float]:
    """Return D10 to D60 with the coefficients of uniformity and of curvature."""
    values = dict(zip(SHARES, found.tolist(), strict=True))
    ten, thirty, sixty = values["D10"], values["D30"], values["D60"]
    return values | {"Cu": sixty / ten, "Cc": thirty**2 / (ten * sixty)}


def stratum_distance(sizes: SizeDistribution, count: int, dimension: int) -> float:
    """Return the distance by volume between a distribution and so many grains, by the strata of the largest ones.

    The shares agree at the ends of strata, and differ between them by what is larger or smaller than the grain. In a
    distribution of single sizes that is at most one of the largest grains.
    """
    mean = sizes.mean_volume(dimension=dimension) * (6.0 if dimension == 3 else 4.0) / math.pi
    if not sizes.is_continuous:
        return float(libm.power(sizes.quantile(1.0), dimension) / (count * mean))
    ends = sizes.quantile(np.arange(max(0, count - LARGEST), count + 1) / count, basis="number", dimension=dimension)
    shares = sizes.cumulative(ends, basis="volume", dimension=dimension)
    grains = libm.power(np.diff(shares) * count * mean, 1.0 / dimension)
    at = sizes.cumulative(np.clip(grains, ends[:-1], ends[1:]), basis="volume", dimension=dimension)
    return float(np.maximum(shares[1:] - at, at - shares[:-1]).max())


def count_within(sizes: SizeDistribution, distance: float, dimension: int) -> int:
    """Return about the least number of grains that follow a distribution to a distance by volume.

    Raises
    ------
    InputError
        If they are more than 10^12.
    """
    low, high = 0, 1
    while stratum_distance(sizes, high, dimension) > distance:
        low, high = high, 2 * high
        if high > MOST:
            raise InputError(f"more than {MOST:g} grains follow the distribution to {distance:g}: leave out its fines")
    while high - low > max(1, high // 100):
        middle = (low + high) // 2
        near = stratum_distance(sizes, middle, dimension) <= distance
        low, high = (low, middle) if near else (middle, high)
    return high
