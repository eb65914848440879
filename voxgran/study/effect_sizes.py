"""Standardized difference of two groups: Hedges' g with its confidence interval.

References
----------
Hedges 1981, J. Educ. Stat. 6, 107-128, doi:10.3102/10769986006002107: the unbiased estimate
Steiger & Fouladi 1997, in Harlow, Mulaik & Steiger (eds.), Erlbaum: intervals by the noncentral t distribution
"""

import math
from collections.abc import Sequence

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.lazy import load
from voxgran.report.significance import standard_error

#: statistic of a t-test beyond which the normal part of the noncentral distribution vanishes
LARGE = 1000.0


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
