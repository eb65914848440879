import math

import numpy as np
import pytest

from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.shapes import sizes

LAWS = {
    "lognormal": sizes.lognormal(2.0, 0.3),
    "lognormal by volume": sizes.lognormal(2.0, 0.3, basis="volume"),
    "lognormal, cut": sizes.lognormal(2.0, 0.5, basis="volume", low=1.0, high=3.0),
    "uniform": sizes.uniform(1.0, 3.0),
    "uniform by volume": sizes.uniform(1.0, 3.0, basis="volume"),
    "sieve": sizes.sieve([0.1, 0.5, 1.0, 2.0], [0.0, 0.2, 0.7, 1.0]),
    "sieve with a gap": sizes.sieve([0.1, 0.5, 1.0, 2.0], [0.0, 0.4, 0.4, 1.0], as_diameter=True),
    "sieve by number": sizes.sieve([0.1, 0.5, 1.0, 2.0], [0.0, 0.2, 0.7, 1.0], basis="number"),
}
STEPS = {
    "discrete": sizes.discrete([1.0, 2.0, 0.5], [1.0, 2.0, 3.0]),
    "discrete by volume": sizes.discrete([1.0, 2.0, 0.5], [1.0, 2.0, 3.0], basis="volume"),
    "fixed": sizes.fixed(2.0),
}


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", LAWS)
def test_samples_follow_the_law(name, dimension):
    law = LAWS[name]
    drawn = law.sample(20000, stream(5, name), dimension=dimension)
    test = load("scipy.stats").kstest(drawn, lambda d: law.cumulative(d, basis="number", dimension=dimension))
    assert test.pvalue > 1e-3


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", LAWS | STEPS)
def test_volume_follows_from_number(name, dimension):
    law = (LAWS | STEPS)[name]
    # dense quantiles by number stand for the grains
    grains = law.quantile((np.arange(200000) + 0.5) / 200000, basis="number", dimension=dimension)
    weights = np.cumsum(grains**dimension)
    looks = np.quantile(grains, [0.1, 0.3, 0.5, 0.8, 0.99])
    place = np.searchsorted(grains, looks * (1 + 1e-9), side="right") - 1
    expected = weights[place] / weights[-1]
    got = law.cumulative(looks * (1 + 1e-9), basis="volume", dimension=dimension)
    assert got == pytest.approx(expected, abs=3e-4)
    unit = math.pi / (6 if dimension == 3 else 4)
    assert law.mean_volume(dimension=dimension) == pytest.approx(unit * (grains**dimension).mean(), rel=1e-3)


@pytest.mark.parametrize("basis", ["number", "volume"])
@pytest.mark.parametrize("name", LAWS)
def test_quantiles_invert_the_law(name, basis):
    shares = np.linspace(0.001, 0.999, 25)
    got = LAWS[name].cumulative(LAWS[name].quantile(shares, basis=basis), basis=basis)
    assert got == pytest.approx(shares, abs=1e-13)


@pytest.mark.parametrize("name", LAWS | STEPS)
def test_laws_begin_at_zero_and_end_at_one(name):
    law = (LAWS | STEPS)[name]
    for basis in ("number", "volume"):
        ends = law.cumulative([0.0, 1e-9, 1e9, math.inf], basis=basis)
        assert ends == pytest.approx([0, 0, 1, 1], abs=1e-15)
    assert law.quantile(0.5).shape == ()


@pytest.mark.parametrize("power", [-20, 20])
def test_a_power_of_two_gives_the_same_bits(power):
    factor = 2.0**power
    pairs = [
        (sizes.lognormal(1.3, 0.4), sizes.lognormal(1.3 * factor, 0.4)),
        (sizes.lognormal(1.3, 0.4, basis="volume"), sizes.lognormal(1.3 * factor, 0.4, basis="volume")),
        (
            sizes.lognormal(1.3, 0.4, low=1.0, high=1.7),
            sizes.lognormal(1.3 * factor, 0.4, low=factor, high=1.7 * factor),
        ),
        (sizes.uniform(1.1, 2.3), sizes.uniform(1.1 * factor, 2.3 * factor)),
        (sizes.uniform(1.1, 2.3, basis="volume"), sizes.uniform(1.1 * factor, 2.3 * factor, basis="volume")),
        (
            sizes.discrete([1.1, 0.7], [1, 2], basis="volume"),
            sizes.discrete([1.1 * factor, 0.7 * factor], [1, 2], basis="volume"),
        ),
        (
            sizes.sieve([0.3, 0.7, 1.9], [0, 0.3, 1]),
            sizes.sieve([0.3 * factor, 0.7 * factor, 1.9 * factor], [0, 0.3, 1]),
        ),
    ]
    for one, two in pairs:
        drawn = one.sample(500, stream(1, "bits")), two.sample(500, stream(1, "bits"))
        assert (drawn[0] * factor == drawn[1]).all(), one


def test_lognormal_in_closed_form():
    law = sizes.lognormal(2.0, 0.3)
    assert law.quantile(0.5) == pytest.approx(2.0, rel=1e-15)
    assert law.quantile(0.5, basis="volume") == pytest.approx(2.0 * math.exp(3 * 0.09), rel=1e-15)
    assert law.quantile(0.5, basis="volume", dimension=2) == pytest.approx(2.0 * math.exp(2 * 0.09), rel=1e-15)
    assert law.mean_volume() == pytest.approx(math.pi / 6 * 8 * math.exp(4.5 * 0.09), rel=1e-14)
    by_volume = sizes.lognormal(2.0 * math.exp(3 * 0.09), 0.3, basis="volume")
    looks = np.linspace(0.5, 6, 12)
    assert by_volume.cumulative(looks, basis="number") == pytest.approx(law.cumulative(looks), abs=1e-15)


def test_uniform_in_closed_form():
    law = sizes.uniform(1.0, 3.0)
    assert law.cumulative(2.0, basis="volume") == pytest.approx((16 - 1) / (81 - 1), rel=1e-14)
    assert law.mean_volume() == pytest.approx(math.pi / 6 * (81 - 1) / 4 / 2, rel=1e-14)


def test_sieve_curve_goes_through_its_points_and_straight_between():
    law = LAWS["sieve"]
    assert law.cumulative([0.1, 0.5, 1.0, 2.0]) == pytest.approx([0, 0.2, 0.7, 1.0], abs=1e-15)
    assert law.cumulative(math.sqrt(0.5)) == pytest.approx(0.45, rel=1e-14)
    assert law.by_intermediate_axis
    assert not LAWS["sieve with a gap"].by_intermediate_axis
    assert not LAWS["lognormal"].by_intermediate_axis
    inside = LAWS["sieve with a gap"].sample(2000, stream(0, "gap"))
    assert not ((inside > 0.5) & (inside < 1.0)).any()


def test_weights_by_volume_are_shares_of_volume():
    law = sizes.discrete([1.0, 2.0], [0.5, 0.5], basis="volume")
    assert law.cumulative(1.0, basis="number") == pytest.approx(8 / 9, rel=1e-15)
    assert law.cumulative(1.0, basis="number", dimension=2) == pytest.approx(4 / 5, rel=1e-15)
    never = sizes.discrete([1.0, 2.0, 3.0], [1.0, 0.0, 0.0])
    assert set(never.sample(100, stream(0, "never"))) == {1.0}


@pytest.mark.parametrize("name", LAWS | STEPS)
def test_mapping_makes_the_same_law(name):
    law = (LAWS | STEPS)[name]
    assert sizes.make_sizes(law.to_mapping()) == law
    assert law.to_mapping()["kind"] in sizes.size_kinds()


def test_whole_numbers_are_numbers():
    law = sizes.lognormal(np.int64(2), 1, basis="volume")
    assert law.median == 2.0
    assert law.mean_volume() > 0
    assert sizes.uniform(1, np.int64(3), basis="volume").quantile(1.0) == pytest.approx(3.0)
    assert sizes.fixed(np.int64(2)).mean_volume() == pytest.approx(math.pi / 6 * 8)


def test_no_grain_is_drawn_for_count_zero():
    assert sizes.lognormal(1.0, 0.2).sample(0, stream(0, "none")).shape == (0,)


BAD = [
    (lambda: sizes.lognormal(0.0, 0.2), "median is 0.0"),
    (lambda: sizes.lognormal(1.0, -0.1), "sigma is -0.1"),
    (lambda: sizes.lognormal(1.0, math.nan), "sigma is nan"),
    (lambda: sizes.lognormal(1.0, 0.2, low=2.0, high=1.0), "low is 2.0 and high is 1.0"),
    (lambda: sizes.lognormal(1.0, 0.2, basis="mass"), "basis is 'mass'"),
    (lambda: sizes.fixed(-1.0), "diameter is -1.0"),
    (lambda: sizes.lognormal("large", 0.2), "must be a number"),
    (lambda: sizes.discrete(["large"], [1.0]), "must be an array of numbers of shape"),
    (lambda: sizes.sieve([1.0, math.inf], [0.0, 1.0]), "finite"),
    (lambda: sizes.uniform(0.0, 1.0), "low is 0.0"),
    (lambda: sizes.uniform(2.0, 1.0), "high is 1.0"),
    (lambda: sizes.discrete([1.0, 2.0], [1.0]), "2 entries and weights 1"),
    (lambda: sizes.discrete([], []), "0 entries"),
    (lambda: sizes.discrete([1.0, 0.0], [1.0, 1.0]), "diameter is 0.0"),
    (lambda: sizes.discrete([1.0, 2.0], [1.0, -1.0]), "weight is -1.0"),
    (lambda: sizes.discrete([1.0, 2.0], [0.0, 0.0]), "above 0"),
    (lambda: sizes.sieve([2.0, 1.0], [0.0, 1.0]), "increase"),
    (lambda: sizes.sieve([1.0], [1.0]), "at least two"),
    (lambda: sizes.sieve([1.0, 2.0], [0.0, 100.0]), "passing is 100.0"),
    (lambda: sizes.sieve([1.0, 2.0, 3.0], [0.0, 0.6, 0.5]), "never falling"),
    (lambda: sizes.sieve([1.0, 2.0], [0.1, 1.0]), "rise from 0 to 1"),
    (lambda: sizes.sieve([1.0, 2.0], [0.0, 0.9]), "rise from 0 to 1"),
    (lambda: sizes.lognormal(1.0, 0.2).sample(-1, stream(0, "x")), "count is -1"),
    (lambda: sizes.lognormal(1.0, 0.2).quantile(1.5), "shares"),
    (lambda: sizes.lognormal(1.0, 0.2).cumulative(1.0, dimension=4), "dimension is 4"),
    (lambda: sizes.make_sizes({"median": 1.0}), "kind is missing"),
    (lambda: sizes.make_sizes({"kind": "uniform", "low": 1.0}), "high is missing"),
]


@pytest.mark.parametrize(("call", "message"), BAD, ids=[row[1] for row in BAD])
def test_what_is_no_distribution_is_refused(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_unknown_names_give_the_nearest():
    with pytest.raises(UnknownNameError, match="did you mean 'lognormal'"):
        sizes.make_sizes({"kind": "log-normal"})
    with pytest.raises(UnknownNameError, match="did you mean 'median'"):
        sizes.make_sizes({"kind": "lognormal", "mediam": 2.0})
