"""Significance: independent samples are packings, equal to rounding is equal, and SciPy agrees where it can."""

import itertools
import math

import numpy as np
import pytest
import scipy.stats

from voxgran._base.seeds import stream
from voxgran.report import significance
from voxgran.report.significance import all_equal, distance_of, permutation_p_value, standard_error, welch_p_value


def samples(seed, packings, shift=0.0, scatter=0.0, grains=60):
    """Return values of grains of several packings; `scatter` moves all grains of a packing at once."""
    generator = stream(seed, "samples")
    return [generator.uniform(1, 2, grains) + shift + scatter * generator.normal() for _ in range(packings)]


def test_equal_to_rounding_is_equal():
    assert all_equal(np.array([0.6, 0.6 + 1e-13, 0.6 - 1e-13]))
    assert not all_equal(np.array([0.6, 0.6 + 1e-8]))
    assert all_equal(np.array([-1e300, -1e300 * (1 + 1e-12)]))
    assert not all_equal(np.array([1e-300, 2e-300]))
    assert all_equal(np.zeros(3))
    assert all_equal(np.zeros(0))


def test_the_standard_error_is_that_of_scipy_and_0_where_only_rounding_differs():
    values = stream(1, "values").normal(0.6, 0.01, 7)
    assert standard_error(values) == pytest.approx(scipy.stats.sem(values), rel=1e-12)
    assert standard_error(0.6 + 1e-13 * values) == 0.0
    assert math.isnan(standard_error(values[:1]))


@pytest.mark.parametrize(("n", "m"), [(2, 2), (3, 5), (8, 4)])
def test_welch_is_that_of_scipy(n, m):
    one, other = stream(2, "one").normal(0.6, 0.01, n), stream(2, "other").normal(0.61, 0.03, m)
    expected = scipy.stats.ttest_ind(one, other, equal_var=False).pvalue
    assert welch_p_value(one, other) == pytest.approx(expected, rel=1e-9)
    assert welch_p_value(other, one) == pytest.approx(expected, rel=1e-9)


def test_welch_says_nothing_where_nothing_can_be_said():
    values = stream(3, "values").normal(size=5)
    assert welch_p_value(values[:1], values) is None
    assert welch_p_value(values, values[:1]) is None
    assert welch_p_value(np.full(3, 0.5), np.full(4, 0.6)) is None
    # rounding is no scatter, and no warning of SciPy comes through
    assert welch_p_value(np.array([0.5, 0.5 + 1e-16, 0.5]), np.array([0.6, 0.6 + 1e-16])) is None
    one_sided = welch_p_value(np.full(3, 0.5), np.array([0.6, 0.7, 0.8]))
    assert one_sided == pytest.approx(scipy.stats.ttest_1samp([0.6, 0.7, 0.8], 0.5).pvalue, rel=1e-9)


def test_the_distance_is_that_of_scipy_and_each_packing_weighs_the_same():
    one, other = samples(4, 3), samples(5, 2, shift=0.1)
    expected = scipy.stats.ks_2samp(np.concatenate(one), np.concatenate(other)).statistic
    assert distance_of(one, other) == pytest.approx(expected, abs=1e-12)
    assert distance_of([np.array([1.0] * 99), np.array([2.0])], [np.array([2.0])]) == pytest.approx(0.5)
    assert distance_of([np.array([1.0, 2.0])], [np.array([1.0 + 1e-13, 2.0 - 1e-13])]) == pytest.approx(0.0, abs=1e-12)
    assert distance_of([np.array([1.0])], [np.array([2.0])]) == 1.0


def test_the_permutation_is_that_of_all_regroupings():
    one, other = samples(6, 3, scatter=0.1), samples(7, 5, shift=0.15, scatter=0.1)
    every, observed = [*one, *other], distance_of(one, other)
    found = []
    for chosen in itertools.combinations(range(8), 3):
        rest = [every[k] for k in range(8) if k not in chosen]
        found.append(distance_of([every[k] for k in chosen], rest) >= observed * (1 - 1e-12))
    assert 2 < sum(found) < len(found)
    assert permutation_p_value(one, other) == pytest.approx(np.mean(found))


def test_many_regroupings_are_drawn_and_agree_with_all_of_them(monkeypatch):
    one, other = samples(8, 6, scatter=0.1), samples(9, 7, shift=0.1, scatter=0.1)
    every = permutation_p_value(one, other)
    monkeypatch.setattr(significance, "MOST_REGROUPINGS", 1500)
    drawn = permutation_p_value(one, other)
    assert 0 < every < 1
    assert drawn == pytest.approx(every, abs=4 * math.sqrt(every * (1 - every) / 1500) + 1e-3)
    assert drawn == permutation_p_value(one, other)


@pytest.mark.parametrize(
    ("n", "m", "enough"),
    [(1, 40, False), (2, 4, False), (2, 5, True), (3, 3, False), (3, 4, True), (4, 4, True), (1, 1, False)],
)
def test_too_few_packings_are_not_tested(n, m, enough):
    one, other = samples(10, n), samples(11, m, shift=5.0)
    for p_value in (permutation_p_value(one, other), permutation_p_value(other, one)):
        assert (p_value is not None) == enough
        if enough:
            assert p_value == pytest.approx((2 if n == m else 1) / math.comb(n + m, n))
            assert p_value < significance.LEVEL


def test_many_grains_of_packings_that_scatter_are_no_evidence():
    """Grains of a packing share its scatter: a test that pools them finds differences where there are none."""
    pooled = alarms = 0
    for seed in range(40):
        every = samples(100 + seed, 8, scatter=0.1, grains=400)
        pooled += scipy.stats.ks_2samp(np.concatenate(every[:4]), np.concatenate(every[4:])).pvalue < 0.05
        alarms += permutation_p_value(every[:4], every[4:]) < 0.05
    assert pooled > 25
    assert alarms <= 6
