"""Significance of differences between groups: standard errors, Welch's t-test, and permutations of whole packings.

The independent samples are packings, such as those of several seeds. Grains of one packing are correlated and not
independent samples, whatever their number: distributions over grains are described by the Kolmogorov-Smirnov distance,
and probabilities come only from permutations of whole packings.

References
----------
Welch 1947, Biometrika 34, 28-35, doi:10.1093/biomet/34.1-2.28: means of groups with unequal variances
Satterthwaite 1946, Biometrics Bull. 2, 110-114, doi:10.2307/3002019: degrees of freedom of sums of variances
Holm 1979, Scand. J. Statist. 6, 65-70: probabilities of several tests
Phipson & Smyth 2010, Stat. Appl. Genet. Mol. Biol. 9(1) 39, doi:10.2202/1544-6115.1585: probabilities by permutation
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.seeds import stream

#: probability below which a difference is called significant
LEVEL = 0.05
#: relative difference below which numbers differ by rounding only
EQUAL = 1e-9
#: largest number of permutations that are all tried; of more, this number is drawn at random
MOST_REGROUPINGS = 10_000
#: number of values at which distributions of permuted packings are compared
MOST_POINTS = 1000
_BATCH = 256


def all_equal(values: Floats) -> bool:
    """Return whether finite numbers (n,) differ by rounding only."""
    return not len(values) or bool(np.ptp(values) <= EQUAL * np.abs(values).max())


def standard_error(values: Floats) -> float:
    """Return the standard error of the mean of one number of each packing (n,): 0 if all are equal up to rounding, NaN
    for a single value.
    """
    if len(values) < 2:
        return math.nan
    return 0.0 if all_equal(values) else float(values.std(ddof=1) / math.sqrt(len(values)))


@dataclass(frozen=True, slots=True)
class Difference:
    """Difference of the means of two groups, with its standard error and degrees of freedom.

    Attributes
    ----------
    value : float
        Mean of the second group of each block minus that of the first one, averaged over the blocks.
    standard_error : float
        Its standard error, from the variances of both groups of each block.
    degrees : float
        Degrees of freedom of the standard error.
    """

    value: float
    standard_error: float
    degrees: float

    @property
    def statistic(self) -> float:
        """Difference over its standard error."""
        return self.value / self.standard_error

    @property
    def p_value(self) -> float:
        """Probability of a difference as large by chance where the means are equal (two-sided)."""
        return float(2 * load("scipy.special").stdtr(self.degrees, -abs(self.statistic)))

    def interval(self, confidence: float) -> tuple[float, float]:
        """Return the limits of the interval that holds the true difference with this probability."""
        half = self.standard_error * float(load("scipy.special").stdtrit(self.degrees, (1 + confidence) / 2))
        return self.value - half, self.value + half


def difference_of(blocks: Sequence[tuple[Floats, Floats]]) -> Difference | None:
    """Return the difference of the means of two groups, averaged over blocks, by Welch's t-test.

    Parameters
    ----------
    blocks : sequence of tuple
        Values (n,) of the first group and (m,) of the second one in each block; what the blocks differ in does not
        matter to the difference. Blocks have equal weights. One block gives Welch's t-test itself.

    Returns
    -------
    Difference or None
        None if no block has at least two values of both groups, or none of these has any scatter; other blocks are
        left out.
    """
    pairs = [pair for pair in blocks if min(map(len, pair)) >= 2]
    variances = [(standard_error(values) ** 2, len(values) - 1) for pair in pairs for values in pair]
    whole = sum(variance for variance, _ in variances)
    if not whole:
        return None
    value = math.fsum(float(other.mean() - one.mean()) for one, other in pairs) / len(pairs)
    # Satterthwaite: shares of the variance, so that tiny numbers do not vanish when they are squared
    degrees = 1 / sum((variance / whole) ** 2 / freedom for variance, freedom in variances)
    return Difference(value, math.sqrt(whole) / len(pairs), degrees)


def welch_p_value(one: Floats, other: Floats) -> float | None:
    """Return the probability of a difference of the means of (n,) and (m,) packings as large by chance, by Welch's
    t-test; None if a group has fewer than two packings, or neither has any scatter.
    """
    found = difference_of([(one, other)])
    return None if found is None else found.p_value


def holm(p_values: Sequence[float | None]) -> list[float | None]:
    """Return probabilities corrected for their number by the procedure of Holm; None, for what was not tested, stays.

    With all that are below a level called significant, the chance of a wrong claim among them is at most this level.
    """
    tested = sorted((p, place) for place, p in enumerate(p_values) if p is not None)
    corrected: list[float | None] = [None] * len(p_values)
    least = 0.0
    for rank, (p, place) in enumerate(tested):
        least = max(least, min(1.0, (len(tested) - rank) * p))
        corrected[place] = least
    return corrected


def verdict_of(p_value: float | None) -> str:
    """Return the verdict for a probability: ``"significant"``, ``"not significant"``, or ``"not tested"`` for None."""
    if p_value is None:
        return "not tested"
    return "significant" if p_value < LEVEL else "not significant"


def p_text(p_value: float) -> str:
    """Return a probability as text."""
    return "p < 0.0001" if p_value < 1e-4 else f"p = {p_value:.2g}"


def distance_of(one: Sequence[Floats], other: Sequence[Floats]) -> float:
    """Return the Kolmogorov-Smirnov distance of two groups, in [0, 1]: the largest difference of their cumulative
    shares.

    Each array holds nonnegative values of the grains of one packing; within a group each packing has the same weight.
    """
    points = np.unique(np.concatenate([*one, *other]))
    difference = np.zeros(len(points))
    for group, sign in ((one, 1.0), (other, -1.0)):
        for values in group:
            difference += sign / len(group) * _share_up_to(values, points)
    return float(np.abs(difference).max())


def permutation_p_value(one: Sequence[Floats], other: Sequence[Floats]) -> float | None:
    """Return the share of permutations of the packings with a distance at least as large as that of the two groups;
    None if a group has fewer than two packings, or so few packings that no result could be significant.

    All permutations are tried if there are at most 10,000, otherwise as many are drawn with a fixed seed.
    """
    first, count = len(one), len(one) + len(other)
    if min(first, count - first) < 2 or 1 / math.comb(count, first) >= LEVEL:
        return None
    points = np.unique(np.concatenate([*one, *other]))
    points = points[np.unique(np.linspace(0, len(points) - 1, MOST_POINTS).astype(np.int64))]
    shares = np.stack([_share_up_to(values, points) for values in (*one, *other)])

    def distances(chosen: Integers, others: Integers, axis: int) -> Floats:
        """Return the distance of two groups of packings, by their numbers along the last axis."""
        del axis
        apart = shares[chosen].mean(axis=-2) - shares[others].mean(axis=-2)
        return np.asarray(np.abs(apart).max(axis=-1))

    found = load("scipy.stats").permutation_test(
        (np.arange(first), np.arange(first, count)),
        distances,
        n_resamples=MOST_REGROUPINGS,
        batch=_BATCH,
        alternative="greater",
        random_state=stream(0, "regroupings"),
    )
    return float(found.pvalue)


def _share_up_to(values: Floats, points: Floats) -> Floats:
    """Return the share of values up to each point; values that differ by rounding count as equal."""
    return np.searchsorted(np.sort(values), points * (1 + EQUAL), side="right") / len(values)
