"""By how much the values of groups differ: the test of Kruskal and Wallis for several of them, Hedges' g for two.

In several blocks the test ranks values within each, so that what blocks differ in does not count. Its statistic
compares the sums of ranks with those expected, by their covariances under permutation within the blocks: in one block
it is that of Kruskal and Wallis, with one value of each group in each block that of Friedman.

References
----------
Kruskal & Wallis 1952, J. Am. Stat. Assoc. 47, 583-621, doi:10.1080/01621459.1952.10483441: one block
Friedman 1937, J. Am. Stat. Assoc. 32, 675-701, doi:10.1080/01621459.1937.10503522: one value of each group a block
Mack & Skillings 1980, J. Am. Stat. Assoc. 75, 947-951, doi:10.1080/01621459.1980.10477577: several values
Hedges 1981, J. Educ. Stat. 6, 107-128, doi:10.3102/10769986006002107: the unbiased estimate
Steiger & Fouladi 1997, in Harlow, Mulaik & Steiger (eds.), Erlbaum: its interval by the noncentral t distribution
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.report.significance import EQUAL, standard_error

#: fewest values of each group in each block for which the chi-squared distribution gives probabilities
LEAST_FOR_CHI_SQUARED = 5
#: permutations that are drawn for fewer
PERMUTATIONS = 9999
#: statistic of a t-test beyond which the normal part of the noncentral distribution vanishes
LARGE = 1000.0


@dataclass(frozen=True, slots=True)
class RankTest:
    """Result of the test.

    Attributes
    ----------
    statistic : float
        H of Kruskal and Wallis, corrected for ties, over all blocks.
    degrees : int
        Number of groups minus one, less where no block connects them.
    p_value : float
        Probability of a statistic as large where the groups do not differ.
    epsilon_squared : float
        Share of the variance of the ranks within blocks that is between groups, in [0, 1].
    """

    statistic: float
    degrees: int
    p_value: float
    epsilon_squared: float


def rank_test(blocks: Sequence[Sequence[Floats]]) -> RankTest | None:
    """Return whether the values of groups differ; None if no block has values of
    two groups, the only one that has is without repetition, or all values of each block are equal.

    Parameters
    ----------
    blocks : sequence of sequence of numpy.ndarray
        In each block the values (n,) of each group, in the same order of groups; they may be empty.

    Notes
    -----
    The probability is that of the chi-squared distribution if each group has at least five values in each block in
    which it has any; otherwise the share of 9,999 permutations within blocks, drawn with a fixed seed, with a statistic
    as large. Chi-squared gives two groups of three values a probability of 0.0495, where the exact one is 0.1.
    """
    used = [block for block in blocks if sum(len(values) > 0 for values in block) > 1]
    # one value of each group in one block: all permutations have the same statistic
    if not used or (len(used) == 1 and max(map(len, used[0])) < 2):
        return None
    count = len(used[0])
    ranks, groups = [], []
    for block in used:
        rank = load("scipy.stats").rankdata(_rounded(np.concatenate(block)))
        ranks.append(rank - rank.mean())
        groups.append(np.repeat(np.arange(count), [len(values) for values in block]))
    covariance = _covariance(ranks, groups, count)
    degrees = int(np.linalg.matrix_rank(covariance, hermitian=True))
    if not degrees:
        return None
    inverse = np.linalg.pinv(covariance, hermitian=True).astype(np.float64)
    sums = _sums(ranks, groups, count)
    statistic = float(sums @ inverse @ sums)
    sizes = [len(values) for block in used for values in block if len(values)]
    if min(sizes) >= LEAST_FOR_CHI_SQUARED:
        p_value = float(load("scipy.stats").chi2.sf(statistic, degrees))
    else:
        p_value = _permuted(ranks, groups, count, inverse=inverse, statistic=statistic)
    largest = sum(len(rank) - 1 for rank in ranks)
    return RankTest(statistic, degrees, p_value, min(1.0, statistic / largest))


def _rounded(values: Floats) -> Floats:
    """Return values of which those that differ by rounding are equal."""
    order = np.argsort(values, kind="stable")
    made = values[order]
    new = np.diff(made, prepend=made[:1]) > EQUAL * np.abs(made).max()
    made = made[np.maximum.accumulate(np.where(new, np.arange(len(made)), 0))]
    rounded = np.empty_like(made)
    rounded[order] = made
    return rounded


def _sums(ranks: Sequence[Floats], groups: Sequence[Integers], count: int) -> Floats:
    """Return the sum of the centred ranks of each group, over all blocks."""
    return np.sum([np.bincount(g, weights=r, minlength=count) for r, g in zip(ranks, groups, strict=True)], axis=0)


def _covariance(ranks: Sequence[Floats], groups: Sequence[Integers], count: int) -> Floats:
    """Return the covariances (groups, groups) of these sums under permutation within blocks."""
    whole = np.zeros((count, count))
    for rank, group in zip(ranks, groups, strict=True):
        sizes = np.bincount(group, minlength=count).astype(np.float64)
        variance = float(rank @ rank) / (len(rank) - 1)
        whole += variance * (np.diag(sizes) - np.outer(sizes, sizes) / len(rank))
    return whole


def _permuted(
    ranks: Sequence[Floats], groups: Sequence[Integers], count: int, *, inverse: Floats, statistic: float
) -> float:
    """Return the share of permutations within blocks with a statistic as large; the actual order is one of them."""
    sums = np.zeros((PERMUTATIONS, count))
    for number, (rank, group) in enumerate(zip(ranks, groups, strict=True)):
        generator = stream(0, "rank permutations", number)
        shuffled = generator.permuted(np.broadcast_to(rank, (PERMUTATIONS, len(rank))), axis=1)
        for at in range(count):
            sums[:, at] += shuffled[:, group == at].sum(axis=1)
    found = np.einsum("pi,ij,pj->p", sums, inverse, sums)
    return float((1 + np.count_nonzero(found >= statistic * (1 - EQUAL))) / (1 + PERMUTATIONS))


def hedges_g(blocks: Sequence[tuple[Floats, Floats]], confidence: float = 0.95) -> tuple[float, float, float] | None:
    """Return Hedges' g, the difference of two means in standard deviations, and the limits of its interval.

    Parameters
    ----------
    blocks : sequence of tuple
        Values (n,) of the first group and (m,) of the second one in each block. Differences are averaged over blocks of
        equal weights, and the standard deviation is the one common to all groups and blocks.
    confidence : float
        Probability that the interval holds the true value.

    Returns
    -------
    tuple of float or None
        g and the limits of its interval, by the noncentral t distribution, which is exact for normal values of equal
        variance; None if no block has at least two values of both groups, or none of these has any scatter.
    """
    pairs = [pair for pair in blocks if min(map(len, pair)) >= 2]
    degrees = sum(len(values) - 1 for pair in pairs for values in pair)
    squares = sum((len(v) - 1) * len(v) * standard_error(v) ** 2 for pair in pairs for v in pair)
    if not squares:
        return None
    deviation = math.sqrt(squares / degrees)
    difference = math.fsum(float(other.mean() - one.mean()) for one, other in pairs) / len(pairs)
    # standard error of the difference in standard deviations
    error = math.sqrt(sum(1 / len(one) + 1 / len(other) for one, other in pairs)) / len(pairs)
    unbiased = _correction(degrees) * error
    statistic = difference / deviation / error
    limits = [unbiased * _noncentrality(statistic, degrees, p) for p in ((1 + confidence) / 2, (1 - confidence) / 2)]
    return unbiased * statistic, limits[0], limits[1]


def _correction(degrees: float) -> float:
    """Return the factor that makes a standardized difference unbiased."""
    special = load("scipy.special")
    return float(np.exp(special.gammaln(degrees / 2) - special.gammaln((degrees - 1) / 2)) / math.sqrt(degrees / 2))


def _noncentrality(statistic: float, degrees: float, probability: float) -> float:
    """Return the noncentrality with which a smaller statistic has this probability."""
    if abs(statistic) > LARGE:
        tail = probability if statistic > 0 else 1 - probability
        return statistic * math.sqrt(float(load("scipy.stats").chi2.isf(tail, degrees)) / degrees)
    return float(load("scipy.special").nctdtrinc(degrees, probability, statistic))
