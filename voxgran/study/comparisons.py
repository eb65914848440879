"""Comparison of the values of one axis of a study, such as its methods: differences, tests and effect sizes.

Two values of the axis are compared by Welch's t-test, all of them by the test of Kruskal and Wallis: within each
combination of the other axes, and pooled over all combinations as blocks. The runs of a cell, one for each seed, are
its independent samples.

The test of Kruskal and Wallis tells whether the values of several groups differ, and Hedges' g by how much the values
of two groups do. In several blocks the test ranks values within each, so that what blocks differ in does not count. Its
statistic compares the sums of ranks with those expected, by their covariances under permutation within the blocks: in
one block it is that of Kruskal and Wallis, with one value of each group in each block that of Friedman.

References
----------
Kruskal & Wallis 1952, J. Am. Stat. Assoc. 47, 583-621, doi:10.1080/01621459.1952.10483441: one block
Friedman 1937, J. Am. Stat. Assoc. 32, 675-701, doi:10.1080/01621459.1937.10503522: one value of each group a block
Mack & Skillings 1980, J. Am. Stat. Assoc. 75, 947-951, doi:10.1080/01621459.1980.10477577: several values
Hedges 1981, J. Educ. Stat. 6, 107-128, doi:10.3102/10769986006002107: the unbiased estimate
Steiger & Fouladi 1997, in Harlow, Mulaik & Steiger (eds.), Erlbaum: its interval by the noncentral t distribution
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers, as_number
from voxgran._base.errors import InputError, check_known
from voxgran._base.lazy import Dataset, load
from voxgran._base.seeds import stream
from voxgran.report.significance import EQUAL, all_equal, difference_of, holm, standard_error, verdict_of
from voxgran.study.axes import Label
from voxgran.study.cell_values import axes_of, labels_of, main_variable, text_of, values_of, varied_axes
from voxgran.study.cells import LISTED

#: what the columns of the other axes say in rows that are pooled over them
POOLED = "all"


@dataclass(frozen=True, slots=True)
class _Block:
    """One combination of the values of the other axes, with the values (n,) of each group; empty where it has none."""

    labels: dict[str, Label]
    groups: tuple[Floats, ...]


def compare(
    dataset: "Dataset", variable: str | None = None, over: str | None = None, *, confidence: float = 0.95
) -> list[dict[str, Any]]:
    """Compare the values of one axis of a study.

    Parameters
    ----------
    dataset : xarray.Dataset
        That of a study, with the dimension ``seed``.
    variable : str, optional
        Name of the variable. Default: that of :func:`voxgran.study.statistics.summary`.
    over : str, optional
        Axis whose values are compared; axes that vary together with it are compared as one. Default: `method` where it
        varies, otherwise the first axis that does.
    confidence : float
        Probability that an interval holds the true value, above 0, at most 0.9999.

    Returns
    -------
    list of dict
        One row for each test, with the columns

        =====================================  =====================================================================
        `variable`, `over`                     what is compared
        name of each other axis                its value, or ``"all"`` in rows that are pooled over all combinations
        `test`                                 ``"Welch"`` of two values, ``"Kruskal-Wallis"`` of all
        `one`, `other`                         the two values; empty for all
        `blocks`                               number of combinations with values that enter
        `count_one`, `count_other`             numbers of runs; for all, `count_one` is their sum
        `difference`                           mean of `other` minus mean of `one`, averaged over the blocks
        `difference_low`, `difference_high`    limits of its confidence interval
        `statistic`, `degrees_of_freedom`      t of Welch, or H of Kruskal and Wallis
        `p_value`, `p_holm`                    probability of as much by chance; corrected for the number of tests
        `effect`, `effect_size`                ``"hedges_g"`` or ``"epsilon_squared"``, and its value
        `effect_low`, `effect_high`            limits of the confidence interval of Hedges' g
        `verdict`                              ``"equal"``, ``"significant"``, ``"not significant"``, ``"not tested"``
        =====================================  =====================================================================

        Numbers are NaN where they are not known: p-values where a group has fewer than two runs or there is no scatter.

    Raises
    ------
    InputError
        If it is no dataset of a study, it has a single value of that axis or no axes, or `confidence` breaks a rule.
    UnknownNameError
        If the study has no variable or axis of that name; the message gives the nearest one.

    Notes
    -----
    `p_holm` is corrected by the procedure of Holm for all tests of the same kind in the table: of all pairs in all
    combinations, of all pairs pooled, and of Kruskal and Wallis in all combinations. A row is called significant where
    it is below 0.05; the chance that one of a kind is so where nothing differs is then at most 5 %.

    Seeds are independent samples of a cell. Two methods may draw the same random numbers of the same seed; the tests
    are then conservative.

    Examples
    --------
    >>> import xarray as xr
    >>> from voxgran.study.comparisons import compare
    >>> values = [[0.50, 0.52, 0.54], [0.60, 0.61, 0.62]]
    >>> data = xr.Dataset({"solid_fraction": (("method", "seed"), values)}, {"method": ["rsa", "jam"]})
    >>> [(row["test"], round(row["difference"], 3), row["verdict"]) for row in compare(data)]
    [('Welch', 0.09, 'significant'), ('Kruskal-Wallis', nan, 'not significant')]
    """
    level = as_number(confidence, "confidence", above=0, at_most=0.9999)
    variable = main_variable(dataset) if variable is None else variable
    values = values_of(dataset, variable)
    axis = compared_axis(dataset) if over is None else over
    if axis is None:
        raise InputError("the study has one cell: vary an axis to compare its values")
    names, blocks = _blocks(dataset, axis, values)
    others = list(dict.fromkeys(name for block in blocks for name in block.labels))
    tables: list[tuple[dict[str, Label], Sequence[_Block]]] = [(block.labels, [block]) for block in blocks]
    if len(blocks) > 1:
        tables.append((dict.fromkeys(others, POOLED), blocks))
    rows, kinds = [], []
    for labels, of_table in tables:
        head = {"variable": variable, "over": axis, **{name: labels.get(name, "") for name in others}}
        for row in _tests(names, of_table, level, of_table is blocks or len(blocks) == 1):
            rows.append({**head, **row})
            kinds.append((row["test"], len(of_table) > 1))
    for kind in dict.fromkeys(kinds):
        of_kind = [row for row, its in zip(rows, kinds, strict=True) if its == kind]
        for row, p_value in zip(of_kind, holm([row["p_value"] for row in of_kind]), strict=True):
            row["verdict"] = row["verdict"] or verdict_of(p_value)
            row["p_value"], row["p_holm"] = _number(row["p_value"]), _number(p_value)
    return rows


def compared_axis(dataset: "Dataset") -> str | None:
    """Return the axis whose values are compared by default: `method` where it varies, otherwise the first that does;
    None where none does.
    """
    varied = varied_axes(dataset)
    return "method" if "method" in varied else next(iter(varied), None)


def _number(value: float | None) -> float:
    """Return a number, NaN for None."""
    return math.nan if value is None else float(value)


def _blocks(dataset: "Dataset", over: str, values: Floats) -> tuple[list[str], list[_Block]]:
    """Return the names of the groups, and each combination of the other axes with the values of each group.

    Raises
    ------
    InputError
        If the axis has one value.
    UnknownNameError
        If there is no such axis.
    """
    axes = axes_of(dataset)
    check_known("axis", over, axes)
    dimension = axes[over]
    # axes that vary together are one; listed cells have axes of their own, and a name for each cell
    if dimension == LISTED and over != LISTED:
        own = [over]
        left_out = {over, LISTED}
    else:
        own = [name for name, of in axes.items() if of == dimension]
        left_out = set(own)
    others = [name for name in axes if name not in left_out]
    labels = labels_of(dataset)
    keys = [tuple(cell[name] for name in own) for cell in labels]
    groups = list(dict.fromkeys(keys))
    if len(groups) < 2:
        raise InputError(f"axis {over} has the one value {text_of(groups[0][0])}: give it another to compare with it")
    found: dict[tuple[Label, ...], list[list[Floats]]] = {}
    for cell, key, row in zip(labels, keys, values, strict=True):
        block = found.setdefault(tuple(cell[name] for name in others), [[] for _ in groups])
        block[groups.index(key)].append(row[np.isfinite(row)])
    # an axis with one value says nothing in a table
    shown = [name for at, name in enumerate(others) if len({place[at] for place in found}) > 1]
    blocks = [
        _Block(
            {name: label for name, label in zip(others, place, strict=True) if name in shown},
            tuple(np.concatenate(group) if group else np.zeros(0) for group in of_place),
        )
        for place, of_place in found.items()
    ]
    names = [", ".join(text_of(label) for label in key) for key in groups]
    return names, blocks


def _tests(names: Sequence[str], blocks: Sequence[_Block], level: float, whole: bool) -> Iterator[dict[str, Any]]:
    """Yield a row for each pair of groups, and one for all of them if none is without values in all blocks.

    whole: whether these are all blocks, so that groups without values are told as well.
    """
    for at, to in combinations(range(len(names)), 2):
        pairs = [(block.groups[at], block.groups[to]) for block in blocks]
        if whole or all(len(one) and len(other) for one, other in pairs):
            yield {"test": "Welch", "one": names[at], "other": names[to], **_pair(pairs, level)}
    found = rank_test([block.groups for block in blocks])
    entering = [block for block in blocks if sum(len(values) > 0 for values in block.groups) > 1]
    if not entering:
        return
    yield {
        "test": "Kruskal-Wallis",
        "one": "",
        "other": "",
        "blocks": len(entering),
        "count_one": sum(len(values) for block in entering for values in block.groups),
        "count_other": 0,
        **dict.fromkeys(("difference", "difference_low", "difference_high"), math.nan),
        "statistic": math.nan if found is None else found.statistic,
        "degrees_of_freedom": math.nan if found is None else float(found.degrees),
        "p_value": None if found is None else found.p_value,
        "p_holm": None,
        "effect": "epsilon_squared",
        "effect_size": math.nan if found is None else found.epsilon_squared,
        **dict.fromkeys(("effect_low", "effect_high"), math.nan),
        "verdict": "",
    }


def _pair(given: Sequence[tuple[Floats, Floats]], level: float) -> dict[str, Any]:
    """Return the comparison of two groups, by their values in each block."""
    # with scatter where there is any: blocks with one run of a group count only if there are no others
    pairs = [pair for pair in given if min(map(len, pair)) >= 2] or [pair for pair in given if all(map(len, pair))]
    means = [(float(one.mean()), float(other.mean())) for one, other in pairs]
    equal = bool(means) and all(all_equal(np.array(pair)) for pair in means)
    found, effect = difference_of(pairs), hedges_g(pairs, level)
    low, high = found.interval(level) if found is not None else (math.nan, math.nan)
    g, g_low, g_high = effect if effect is not None else (math.nan, math.nan, math.nan)
    value = math.fsum(other - one for one, other in means) / len(means) if means else math.nan
    return {
        "blocks": len(pairs),
        "count_one": sum(len(one) for one, _ in pairs),
        "count_other": sum(len(other) for _, other in pairs),
        "difference": 0.0 if equal else value,
        "difference_low": low,
        "difference_high": high,
        "statistic": math.nan if found is None else found.statistic,
        "degrees_of_freedom": math.nan if found is None else float(found.degrees),
        "p_value": None if equal or found is None else found.p_value,
        "p_holm": None,
        "effect": "hedges_g",
        "effect_size": g,
        "effect_low": g_low,
        "effect_high": g_high,
        "verdict": "equal" if equal else "",
    }


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
