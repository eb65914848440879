"""Statistics of studies: SciPy's numbers where it has them, exact twins, published examples, and what chance does."""

import itertools
import math
import warnings

import numpy as np
import pytest
import scipy.stats
import xarray as xr
from kit import slow

from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.seeds import stream
from voxgran.report.significance import difference_of, holm, welch_p_value
from voxgran.study import comparisons
from voxgran.study.comparisons import compare, compared_axis, hedges_g, rank_test
from voxgran.study.statistics import confidence_limits, summary

#: hours of sleep gained by two drugs, Student 1908, as in R's data set `sleep`
SLEEP = (
    np.array([0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]),
    np.array([1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]),
)
#: half-times of mucociliary efficiency, Hollander & Wolfe 1973, as in R's help on `kruskal.test`
MUCOCILIARY = (np.array([2.9, 3.0, 2.5, 2.6, 3.2]), np.array([3.8, 2.7, 4.0, 2.4]), np.array([2.8, 3.4, 3.7, 2.2, 2.0]))


def drawn(seed, *shape):
    return stream(seed, "values").normal(0.6, 0.01, shape)


def study(values, **axes):
    """Return the dataset of a study: values along axes and seeds, failures where they are NaN."""
    values = np.asarray(values, dtype=float)
    dims = (*axes, "seed")
    failure = np.where(np.isnan(values), "it failed", "").astype(object)
    variables = {
        "solid_fraction": (dims, values, {"units": "1", "long_name": "solid fraction"}),
        "failure": (dims, failure),
    }
    return xr.Dataset(variables, {**axes, "seed": np.arange(values.shape[-1])})


@pytest.mark.parametrize(
    ("bulk", "bed", "whole", "main"),
    [
        # the same count in the same container: what the study varies does not show in it
        ([[0.6, 0.61], [0.62, 0.63]], [[0.5, 0.51], [0.52, 0.53]], [[0.4, 0.41], [0.4, 0.41]], "bulk_solid_fraction"),
        ([[math.nan] * 2, [0.62, 0.63]], [[0.5, 0.51], [0.52, 0.53]], [[0.4, 0.41], [0.4, 0.41]], "bed_solid_fraction"),
        # a cell without a bulk would be left out
        (
            [[0.6] * 2, [0.7] * 2, [math.nan] * 2],
            [[0.5] * 2, [0.6] * 2, [0.7] * 2],
            [[0.4] * 2] * 3,
            "bed_solid_fraction",
        ),
        ([[math.nan] * 2] * 2, [[math.nan] * 2] * 2, [[0.4, 0.41], [0.4, 0.41]], "solid_fraction"),
        # without walls the bulk is the whole
        ([[0.6, 0.61], [0.62, 0.63]], [[math.nan] * 2] * 2, [[0.6, 0.61], [0.62, 0.63]], "solid_fraction"),
        # a single cell: seeds differ
        ([[0.6, 0.6]], [[0.5, 0.51]], [[0.4, 0.4]], "bed_solid_fraction"),
        # nothing varies: that of the container is still the last to tell of the packings
        ([[0.6, 0.6]], [[0.5, 0.5]], [[0.4, 0.4]], "bulk_solid_fraction"),
        ([[math.nan] * 2], [[0.5, 0.5]], [[0.4, 0.4]], "bed_solid_fraction"),
    ],
)
def test_the_default_variable_is_the_first_solid_fraction_that_varies(bulk, bed, whole, main):
    made = study(whole, method=["rsa", "jam", "gravity"][: len(whole)])
    dims = made.solid_fraction.dims
    made = made.assign(bulk_solid_fraction=(dims, np.array(bulk)), bed_solid_fraction=(dims, np.array(bed)))
    assert summary(made).attrs["variable"] == main
    if len(whole) > 1:
        assert {row["variable"] for row in compare(made)} == {main}


def pair(rows, one, other, **place):
    """Return the row of Welch's test of two groups."""
    found = [
        row
        for row in rows
        if (row["one"], row["other"]) == (one, other) and all(row[name] == value for name, value in place.items())
    ]
    assert len(found) == 1
    return found[0]


def test_means_errors_and_students_intervals_are_those_of_scipy():
    values = drawn(1, 2, 3, 6)
    found = summary(study(values, method=["a", "b"], shape=["s", "t", "u"]))
    assert found["mean"].dims == ("method", "shape")
    np.testing.assert_allclose(found["mean"], values.mean(axis=-1), rtol=1e-14)
    np.testing.assert_allclose(found.standard_error, scipy.stats.sem(values, axis=-1), rtol=1e-12)
    low, high = scipy.stats.t.interval(0.95, 5, values.mean(axis=-1), scipy.stats.sem(values, axis=-1))
    np.testing.assert_allclose(found.confidence_low, low, rtol=1e-12)
    np.testing.assert_allclose(found.confidence_high, high, rtol=1e-12)
    assert found["count"].values.tolist() == [[6] * 3] * 2
    assert found.attrs == {"variable": "solid_fraction", "confidence": 0.95, "interval": "auto"}
    wide = summary(study(values, method=["a", "b"], shape=["s", "t", "u"]), confidence=0.99)
    assert (wide.confidence_low < found.confidence_low).all()


def test_bootstrap_intervals_are_those_of_all_resamples():
    values = drawn(2, 5)
    means = np.sort([np.mean(one) for one in itertools.product(values, repeat=5)])
    low, high = confidence_limits([values], 0.9, "percentile")
    step = np.ptp(means) / 60
    assert low[0] == pytest.approx(np.quantile(means, 0.05), abs=step)
    assert high[0] == pytest.approx(np.quantile(means, 0.95), abs=step)
    # bias-corrected and accelerated, after Efron 1987, by the distribution of all resamples
    normal = scipy.stats.norm
    bias = normal.ppf(((means < values.mean()).mean() + (means <= values.mean()).mean()) / 2)
    left_out = np.array([np.delete(values, k).mean() for k in range(5)])
    centred = left_out.mean() - left_out
    acceleration = (centred**3).sum() / (6 * (centred**2).sum() ** 1.5)
    limits = []
    for share in (0.05, 0.95):
        z = bias + normal.ppf(share)
        limits.append(np.quantile(means, normal.cdf(bias + z / (1 - acceleration * z))))
    low, high = confidence_limits([values], 0.9, "bca")
    assert (low[0], high[0]) == pytest.approx(tuple(limits), abs=step)


def test_the_bootstrap_is_taken_of_many_values_and_depends_on_those_of_the_cell_only():
    many = stream(3, "values").exponential(1.0, 25)
    alone = confidence_limits([many], 0.95, "auto")
    assert alone == confidence_limits([many], 0.95, "bca")
    assert alone != confidence_limits([many], 0.95, "student")
    others = [drawn(4, 25), many, drawn(5, 7)]
    assert confidence_limits(others, 0.95, "auto")[0][1] == pytest.approx(alone[0][0], rel=1e-9)
    few = drawn(6, 19)
    assert confidence_limits([few], 0.95, "auto") == confidence_limits([few], 0.95, "student")


@pytest.mark.slow
@pytest.mark.parametrize(("count", "samples", "least", "most"), [slow(5, 2000, 0.80, 0.89), (20, 600, 0.90, 0.96)])
def test_intervals_of_few_values_hold_the_mean_as_often_as_they_say(count, samples, least, most):
    values = list(drawn(7, samples, count))
    shares = {}
    for kind in ("student", "bca", "percentile"):
        low, high = confidence_limits(values, 0.95, kind)
        shares[kind] = float(((low <= 0.6) & (high >= 0.6)).mean())
    told = ", ".join(f"{kind} {100 * share:.1f} %" for kind, share in shares.items())
    print(f"95 % intervals of {count} normal values hold the mean: {told}")  # noqa: T201
    assert shares["student"] == pytest.approx(0.95, abs=0.02)
    # why the bootstrap is not taken of few values
    assert least < shares["bca"] < most
    assert shares["percentile"] == pytest.approx(shares["bca"], abs=0.02)


def test_what_is_not_known_is_nan_and_equal_values_have_no_error():
    values = [[0.5, 0.6, np.nan], [0.5, np.nan, np.nan], [np.nan] * 3, [0.6, 0.6 + 1e-15, 0.6]]
    with warnings.catch_warnings(action="error"):
        for kind in ("auto", "bca", "percentile", "student"):
            found = summary(study(values, method=list("abcd")), interval=kind)
    assert found["count"].values.tolist() == [2, 1, 0, 3]
    assert found.failures.values.tolist() == [1, 2, 3, 0]
    np.testing.assert_allclose(found["mean"], [0.55, 0.5, np.nan, 0.6])
    np.testing.assert_array_equal(np.isnan(found.standard_error), [False, True, True, False])
    np.testing.assert_array_equal(np.isnan(found.confidence_low), [False, True, True, False])
    assert found.standard_error[3] == 0
    assert found.confidence_low[3] == found.confidence_high[3] == found["mean"][3]


def test_any_order_of_dimensions_and_coordinates_beside_them_are_kept():
    values = drawn(8, 2, 3, 4)
    data = study(values, method=["a", "b"], shape=[0.5, 1.0, 2.0]).assign_coords(sizes=("shape", ["x", "y", "z"]))
    turned = data.transpose("seed", "shape", "method")
    found = summary(turned).transpose("method", "shape")
    np.testing.assert_array_equal(found["mean"], summary(data)["mean"])
    assert found["sizes"].values.tolist() == ["x", "y", "z"]
    assert "seed" not in found.coords


def test_one_cell_without_axes():
    found = summary(study(drawn(9, 5)))
    assert found["mean"].shape == ()
    assert found["mean"] == pytest.approx(drawn(9, 5).mean())
    assert compared_axis(study(drawn(9, 5))) is None


def test_what_breaks_a_rule_is_said():
    data = study(drawn(10, 2, 3), method=["a", "b"])
    with pytest.raises(UnknownNameError, match="solid_fraction"):
        summary(data, "solid_fracton")
    with pytest.raises(InputError, match="dimension 'seed'"):
        summary(data.mean("seed"))
    with pytest.raises(InputError, match="confidence"):
        summary(data, confidence=1.0)
    with pytest.raises(InputError, match="interval"):
        summary(data, interval="normal")
    with pytest.raises(UnknownNameError, match="method"):
        compare(data, over="metod")
    with pytest.raises(InputError, match="one value a"):
        compare(data.isel(method=[0]), over="method")
    with pytest.raises(InputError, match="one cell"):
        compare(data.isel(method=[0]))


def test_welch_gives_the_published_numbers_of_student_1908():
    found = difference_of([SLEEP])
    # R: t.test(extra ~ group, data = sleep); group 1 minus group 2 there
    assert found.statistic == pytest.approx(1.8608, abs=5e-5)
    assert found.degrees == pytest.approx(17.776, abs=5e-4)
    assert found.p_value == pytest.approx(0.07939, abs=5e-6)
    assert found.interval(0.95) == pytest.approx((-0.2054832, 3.3654832), abs=5e-8)
    assert welch_p_value(*SLEEP) == found.p_value


def test_one_block_is_welch_of_scipy_and_blocks_average():
    blocks = [(drawn(11, 4), drawn(12, 7) + 0.01), (drawn(13, 5) + 0.3, drawn(14, 3) + 0.32)]
    for one, other in blocks:
        found, expected = difference_of([(one, other)]), scipy.stats.ttest_ind(other, one, equal_var=False)
        assert found.statistic == pytest.approx(expected.statistic, rel=1e-9)
        assert found.degrees == pytest.approx(expected.df, rel=1e-9)
        assert found.p_value == pytest.approx(expected.pvalue, rel=1e-9)
        assert found.interval(0.9) == pytest.approx(tuple(expected.confidence_interval(0.9)), rel=1e-9)
    both = difference_of(blocks)
    singles = [difference_of([block]) for block in blocks]
    assert both.value == pytest.approx(np.mean([one.value for one in singles]))
    assert both.standard_error == pytest.approx(math.hypot(*(one.standard_error for one in singles)) / 2)
    # a block with a single value has no scatter, and is left out
    assert difference_of([*blocks, (drawn(15, 1), drawn(16, 4))]) == both
    assert difference_of([(np.full(3, 0.5), np.full(3, 0.6))]) is None


def test_probabilities_over_blocks_are_uniform_where_nothing_differs():
    """Groups of unequal sizes and variances; blocks differ by much more than their scatter."""
    generator = stream(17, "values")
    scales = [(0.01, 0.03), (0.02, 0.01), (0.05, 0.05)]
    p_values = []
    for _ in range(1500):
        blocks = [(generator.normal(k, one, 5), generator.normal(k, other, 8)) for k, (one, other) in enumerate(scales)]
        p_values.append(difference_of(blocks).p_value)
    assert scipy.stats.kstest(p_values, "uniform").pvalue > 0.01


def test_holm_is_the_closed_test_of_bonferroni():
    # an example in many textbooks
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    p_values = stream(18, "values").uniform(size=6) ** 2
    expected = [
        max(
            min(1.0, len(chosen) * min(p_values[k] for k in chosen))
            for count in range(1, 7)
            for chosen in itertools.combinations(range(6), count)
            if at in chosen
        )
        for at in range(6)
    ]
    assert holm(list(p_values)) == pytest.approx(expected)
    assert holm([None, 0.02, None, 0.03]) == [None, 0.04, None, 0.04]
    assert holm([]) == []


def test_hedges_g_is_that_of_its_formula_and_its_limits_leave_these_tails():
    one, other = drawn(19, 6), drawn(20, 9) + 0.012
    g, low, high = hedges_g([(one, other)], 0.9)
    pooled = math.sqrt((5 * one.var(ddof=1) + 8 * other.var(ddof=1)) / 13)
    factor = math.gamma(6.5) / math.sqrt(6.5) / math.gamma(6)
    assert g == pytest.approx(factor * (other.mean() - one.mean()) / pooled)
    root = math.sqrt(6 * 9 / 15)
    statistic = scipy.stats.ttest_ind(other, one).statistic
    assert scipy.stats.nct.cdf(statistic, 13, low / factor * root) == pytest.approx(0.95, abs=1e-5)
    assert scipy.stats.nct.cdf(statistic, 13, high / factor * root) == pytest.approx(0.05, abs=1e-5)
    back = hedges_g([(other, one)], 0.9)
    assert back == pytest.approx((-g, -high, -low), rel=1e-4)
    assert hedges_g([(one[:1], other)]) is None
    assert hedges_g([(np.full(3, 0.5), np.full(3, 0.6))]) is None


def test_hedges_g_holds_the_true_effect_and_is_unbiased():
    generator = stream(21, "values")
    found = []
    for _ in range(1500):
        # three blocks that differ, with a true effect of 1.5 standard deviations in the mean
        pairs = [(generator.normal(k, 0.1, 5), generator.normal(k + 0.15, 0.1, 5)) for k in range(3)]
        found.append(hedges_g(pairs))
    g, low, high = np.array(found).T
    assert g.mean() == pytest.approx(1.5, abs=4 * g.std() / math.sqrt(len(g)))
    assert ((low <= 1.5) & (high >= 1.5)).mean() == pytest.approx(0.95, abs=0.018)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("probability", [0.025, 0.975])
def test_limits_of_huge_effects_go_on_without_a_step(sign, probability, monkeypatch):
    near = comparisons._noncentrality(sign * 999.0, 8, probability)
    monkeypatch.setattr(comparisons, "LARGE", 100.0)
    assert comparisons._noncentrality(sign * 999.0, 8, probability) == pytest.approx(near, rel=1e-3)


def test_kruskal_wallis_gives_the_published_numbers():
    found = rank_test([MUCOCILIARY])
    assert found.statistic == pytest.approx(0.7714, abs=5e-5)
    assert found.degrees == 2
    assert found.epsilon_squared == pytest.approx(found.statistic / 13)
    # R gives 0.68 by chi-squared; one group has four values, so that permutations are drawn here
    assert found.p_value == pytest.approx(0.68, abs=0.04)


def test_one_block_is_kruskal_wallis_of_scipy_also_with_ties():
    generator = stream(22, "values")
    for tied in (False, True):
        groups = [generator.normal(0.6 + 0.01 * k, 0.02, 5 + k) for k in range(4)]
        groups = [np.round(group, 2) for group in groups] if tied else groups
        found, expected = rank_test([groups]), scipy.stats.kruskal(*groups)
        assert found.statistic == pytest.approx(expected.statistic, rel=1e-9)
        assert found.p_value == pytest.approx(expected.pvalue, rel=1e-9)
        assert found.degrees == 3
    # values that differ by rounding are ties
    moved = [group * (1 + 1e-14 * k) for k, group in enumerate(groups)]
    assert rank_test([moved]).statistic == pytest.approx(expected.statistic, rel=1e-9)


def test_one_value_of_each_group_in_each_block_is_friedman_of_scipy():
    values = np.round(drawn(23, 12, 4) + 0.004 * np.arange(4) + np.arange(12)[:, None], 2)
    found = rank_test([[np.array([value]) for value in row] for row in values])
    expected = scipy.stats.friedmanchisquare(*values.T)
    assert found.statistic == pytest.approx(expected.statistic, rel=1e-9)
    assert found.p_value == pytest.approx(expected.pvalue, abs=0.02)
    # epsilon squared is then the coefficient of concordance of Kendall
    assert found.epsilon_squared <= 1


def test_few_values_have_the_exact_probability_of_permutations():
    low, high = np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.5, 0.6])
    # 2 of 20 ways of grouping; chi-squared would say 0.0495
    assert rank_test([[low, high]]).p_value == pytest.approx(0.1, abs=0.012)
    # in two blocks 2 of 400
    assert rank_test([[low, high], [low + 5, high + 5]]).p_value == pytest.approx(0.005, abs=0.003)
    assert rank_test([[low, high], [high, low]]).p_value == pytest.approx(1.0, abs=0.01)


def test_what_cannot_be_ranked_is_not_tested():
    assert rank_test([]) is None
    assert rank_test([[np.array([0.5]), np.array([0.6]), np.array([0.7])]]) is None
    assert rank_test([[np.array([0.5, 0.6]), np.zeros(0)]]) is None
    assert rank_test([[np.full(3, 0.5), np.full(3, 0.5 + 1e-15)]]) is None
    # groups that no block connects: two pairs, two degrees of freedom
    one, none = drawn(24, 5), np.zeros(0)
    found = rank_test([[one, one + 0.01, none, none], [none, none, one, one + 0.02]])
    assert found.degrees == 2
    assert math.isfinite(found.p_value)


@pytest.mark.parametrize("count", [slow(3), 8])
def test_rank_probabilities_are_uniform_where_nothing_differs(count):
    generator = stream(25, "values")
    p_values = []
    for _ in range(400):
        blocks = [[generator.normal(5 * block, 1, count) for _ in range(3)] for block in range(2)]
        p_values.append(rank_test(blocks).p_value)
    assert scipy.stats.kstest(p_values, "uniform").pvalue > 0.01
    assert np.mean(np.array(p_values) < 0.05) < 0.085


@pytest.mark.slow
def test_a_table_of_many_pairs_seldom_claims_what_is_not():
    """Of 300 studies of five methods that do not differ, at most 5 % claim a difference anywhere."""
    wrong, uncorrected = 0, 0
    for number in range(300):
        rows = compare(study(drawn(100 + number, 5, 6), method=list("abcde")))
        pairs = [row for row in rows if row["test"] == "Welch"]
        assert len(pairs) == 10
        wrong += any(row["verdict"] == "significant" for row in pairs)
        uncorrected += any(row["p_value"] < 0.05 for row in pairs)
    # three standard deviations of a share of 300
    assert wrong / 300 <= 0.05 + 3 * math.sqrt(0.05 * 0.95 / 300)
    assert uncorrected / 300 > 0.15


def test_pairs_within_combinations_and_pooled():
    values = drawn(26, 3, 2, 6) + np.array([0.0, 0.0, 0.05])[:, None, None] + np.array([0.0, 0.3])[:, None]
    rows = compare(study(values, method=["a", "b", "c"], shape=["s", "t"]))
    kinds = [(row["test"], row["shape"]) for row in rows]
    assert {kind: kinds.count(kind) for kind in kinds} == {
        ("Welch", "s"): 3,
        ("Welch", "t"): 3,
        ("Welch", "all"): 3,
        ("Kruskal-Wallis", "s"): 1,
        ("Kruskal-Wallis", "t"): 1,
        ("Kruskal-Wallis", "all"): 1,
    }
    row = pair(rows, "a", "c", shape="t")
    expected = scipy.stats.ttest_ind(values[2, 1], values[0, 1], equal_var=False)
    assert (row["statistic"], row["p_value"]) == pytest.approx((expected.statistic, expected.pvalue))
    assert row["difference"] == pytest.approx(values[2, 1].mean() - values[0, 1].mean())
    assert row["effect"] == "hedges_g"
    assert row["effect_low"] < row["effect_size"] < row["effect_high"]
    # six tests in the combinations are one family
    family = [one for one in rows if one["test"] == "Welch" and one["shape"] != "all"]
    assert [one["p_holm"] for one in family] == pytest.approx(holm([one["p_value"] for one in family]))
    pooled = pair(rows, "a", "c", shape="all")
    assert (pooled["blocks"], pooled["count_one"], pooled["verdict"]) == (2, 12, "significant")
    assert pooled["difference"] == pytest.approx(np.mean(values[2].mean(axis=1) - values[0].mean(axis=1)))
    assert pooled["difference_low"] < 0.05 < pooled["difference_high"]
    assert pair(rows, "a", "b", shape="all")["verdict"] == "not significant"
    kruskal = next(one for one in rows if one["test"] == "Kruskal-Wallis" and one["shape"] == "s")
    assert kruskal["statistic"] == pytest.approx(scipy.stats.kruskal(*values[:, 0]).statistic)
    assert kruskal["effect_size"] == pytest.approx(kruskal["statistic"] / 17)
    assert {tuple(one) for one in rows} == {tuple(rows[0])}


def test_failed_cells_are_left_out_and_equal_means_are_equal():
    values = drawn(27, 3, 2, 4)
    values[1, 0] = np.nan
    values[2, 1] = values[0, 1] + 1e-14
    rows = compare(study(values, method=["a", "b", "c"], shape=["s", "t"]))
    assert [row["one"] + row["other"] for row in rows if row["test"] == "Welch" and row["shape"] == "s"] == ["ac"]
    assert pair(rows, "a", "b", shape="all")["blocks"] == 1
    same = pair(rows, "a", "c", shape="t")
    assert (same["verdict"], same["difference"]) == ("equal", 0.0)
    assert math.isnan(same["p_value"])
    alone = compare(study(values[:, :, :1], method=["a", "b", "c"], shape=["s", "t"]))
    assert {row["verdict"] for row in alone if row["test"] == "Welch"} == {"not tested", "equal"}


def test_axes_that_vary_together_are_compared_as_one_and_listed_cells_by_each_axis():
    values = drawn(28, 2, 3)
    zipped = study(values, method=["a", "b"]).assign_coords({"shape": ("method", ["s", "t"])})
    assert [row["one"] for row in compare(zipped) if row["test"] == "Welch"] == ["a, s"]
    assert [row["other"] for row in compare(zipped, over="shape") if row["test"] == "Welch"] == ["b, t"]
    listed = study(drawn(29, 4, 3), cell=["1", "2", "3", "4"]).assign_coords(
        {"method": ("cell", ["a", "b", "a", "b"]), "packing.friction": ("cell", [0.0, 0.0, 0.5, 0.5])}
    )
    rows = [row for row in compare(listed) if row["test"] == "Welch"]
    assert [(row["packing.friction"], row["one"], row["other"]) for row in rows] == [
        (0.0, "a", "b"),
        (0.5, "a", "b"),
        ("all", "a", "b"),
    ]
    assert compared_axis(listed) == "method"
    assert compared_axis(study(values, shape=["s", "t"])) == "shape"
