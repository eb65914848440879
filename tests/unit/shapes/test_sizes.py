import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, UnknownNameError
from voxgran._base.lazy import load
from voxgran._base.seeds import stream
from voxgran.packing.draw import Request, draw_grains
from voxgran.shapes import sizes
from voxgran.shapes.size_laws import distribution

LAWS = {
    "lognormal": sizes.lognormal(2.0, 0.3),
    "lognormal by volume": sizes.lognormal(2.0, 0.3, basis="volume"),
    "lognormal, cut": sizes.lognormal(2.0, 0.5, basis="volume", low=1.0, high=3.0),
    "uniform": sizes.uniform(1.0, 3.0),
    "uniform by volume": sizes.uniform(1.0, 3.0, basis="volume"),
    "sieve": sizes.sieve([0.1, 0.5, 1.0, 2.0], [0.0, 0.2, 0.7, 1.0]),
    "sieve with a gap": sizes.sieve([0.1, 0.5, 1.0, 2.0], [0.0, 0.4, 0.4, 1.0], as_diameter=True),
    "fuller": sizes.fuller(1.0, 8.0),
    "fuller by number": sizes.fuller(1.0, 4.0, 3.0, basis="number"),
    "Rosin-Rammler": sizes.rosin_rammler(2.0, 1.5, low=0.5),
    "Rosin-Rammler, cut": sizes.rosin_rammler(2.0, 3.0, low=1.0, high=4.0),
    "Rosin-Rammler by number": sizes.rosin_rammler(2.0, 2.0, basis="number"),
    "mixture": sizes.mixture([sizes.fuller(0.5, 1.0), sizes.lognormal(2.0, 0.2, basis="volume")], [0.3, 0.7]),
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


@pytest.mark.parametrize("name", LAWS | STEPS)
@pytest.mark.parametrize("dimension", [2, 3])
def test_strata_quantiles_and_volumes_have_the_same_bits_in_any_power_of_two(name, dimension):
    one, factor = (LAWS | STEPS)[name].scaled(1.3), 2.0**-10
    two = one.scaled(factor)
    for count in (7, 200):
        found = [law.strata(count, stream(2, name), dimension=dimension) for law in (one, two)]
        np.testing.assert_array_equal(found[0] * factor, found[1])
    shares = np.linspace(0.01, 0.99, 9)
    for basis in ("number", "volume"):
        found = [law.quantile(shares, basis=basis, dimension=dimension) for law in (one, two)]
        np.testing.assert_array_equal(found[0] * factor, found[1])
    assert one.mean_volume(dimension=dimension) * factor**dimension == two.mean_volume(dimension=dimension)


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
    (lambda: sizes.sieve([2.0, 1.0], [0.0, 1.0]), "passing falls from 1 at 1 to 0 at 2"),
    (lambda: sizes.sieve([1.0], [1.0]), "at least two"),
    (lambda: sizes.sieve([1.0, 2.0, 3.0], [0.0, 0.2, 100.0]), "shares up to 1 and percent up to 100 are mixed"),
    (lambda: sizes.sieve([1.0, 2.0, 3.0], [0.0, 1.0, 0.5]), "passing falls from 1 at 2 to 0.5 at 3"),
    (lambda: sizes.sieve([1.0, 2.0], [0.0, 0.9]), "passing reaches 0.9: it must reach 1, or 100"),
    (lambda: sizes.sieve([1.0, 2.0, 3.0], [0.0, 60.0, 50.0]), "passing falls from 60 at 2 to 50 at 3"),
    (lambda: sizes.sieve([1.0, 2.0, 1.0], [0.0, 1.0, 0.0]), "openings have 1 twice"),
    (lambda: sizes.sieve([1.0, -2.0], [0.0, 1.0]), "openings have -2"),
    (lambda: sizes.sieve([0.0, 1.0, 2.0], [0.1, 0.5, 1.0]), "an opening of 0 lets 0.1 pass"),
    (lambda: sizes.sieve([1.0, 2.0]), "needs openings, and passing or retained"),
    (lambda: sizes.sieve([1.0, 2.0], [0, 1], retained=[1, 0]), "leave one out"),
    (lambda: sizes.sieve([1.0, 2.0], retained=[-1.0, 0.0]), "retained have -1"),
    (lambda: sizes.sieve([1.0, 2.0], retained=[0.0, 0.0]), "retained are all 0"),
    (lambda: sizes.sieve([1.0, 2.0], retained=[1.0, 2.0]), "the largest sieve, 2, retains 2"),
    (lambda: sizes.sieve([1.0, 2.0], [0.1, 1.0], smallest=1.5), "smallest is 1.5"),
    (lambda: sizes.sieve({"opening [um]": [1, 2], "passing": [0, 1]}), "openings in um: give unit"),
    (lambda: sizes.sieve({"opening": [1, 2], "colour": [0, 1]}), "must have 'opening', and 'passing'"),
    (lambda: sizes.sieve({"opening": [1, 2], "passing": [0, "x"]}), "row 2: passing is 'x'"),
    (lambda: sizes.sieve({"opening": [1, 2], "size": [1, 2], "passing": [0, 1]}), "both columns of openings"),
    (lambda: sizes.fuller(2.0, 1.0), "high is 1.0"),
    (lambda: sizes.rosin_rammler(2.0, 1.5), "fines are infinitely many; give low"),
    (lambda: sizes.rosin_rammler(2.0, 1.5, low=2.0, high=1.0), "next to no grain"),
    (lambda: sizes.mixture([sizes.fixed(1.0)], [1.0]), "a part is by number and the mixture by volume"),
    (lambda: sizes.mixture([1.0], [1.0]), "part is"),
    (lambda: sizes.openings("ISO 566"), "did you mean 'ISO 565'"),
    (lambda: sizes.openings("ASTM E11", [201]), "sieve of ASTM E11"),
    (lambda: sizes.openings("ISO 565", [200]), "only the sieves of ASTM E11 have numbers"),
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


SHEET = {"openings": [2.8, 4.0, 8.0, 16.0, 31.5, 63.0], "passing": [0, 4, 15, 35, 65, 100]}
CURVE = sizes.sieve(**SHEET)


def test_a_curve_is_the_same_however_it_is_written(tmp_path):
    """In any order, in percent, by what is retained, as table, series and file, in other units."""
    pandas = load("pandas")
    passing = np.array(SHEET["passing"]) / 100.0
    order = [3, 0, 5, 1, 4, 2]
    shuffled = [np.array(SHEET["openings"])[order], passing[order]]
    retained = [*(1250.0 * np.diff(passing)), 0.0]
    frame = pandas.DataFrame({"Opening (mm)": SHEET["openings"], "% passing": SHEET["passing"]})
    frame.to_csv(tmp_path / "curve.csv", index=False)
    lines = [f"{size:g};{share:g}".replace(".", ",") for size, share in zip(*SHEET.values(), strict=True)]
    (tmp_path / "european.csv").write_text("\n".join(["Sieve [mm];Passing [%]", *lines]), encoding="utf-8")
    micrometres = {"size [um]": 1000.0 * np.array(SHEET["openings"]), "mass": retained}
    by_opening = pandas.Series(SHEET["passing"], index=SHEET["openings"])
    same = [
        sizes.sieve(*shuffled),
        sizes.sieve(SHEET["openings"], retained=retained),
        sizes.sieve([*SHEET["openings"], 0.0], retained=[*retained, 0.0]),
        sizes.sieve(frame, unit="mm"),
        sizes.sieve(tmp_path / "curve.csv", unit="mm"),
        sizes.sieve(tmp_path / "european.csv", unit="mm"),
        sizes.sieve(micrometres, unit="mm"),
        sizes.sieve(by_opening),
        sizes.sieve(pandas.Series(retained, index=SHEET["openings"], name="mass retained [g]")),
        sizes.make_sizes({"kind": "sieve", "file": str(tmp_path / "curve.csv"), "unit": "mm"}),
    ]
    for law in same:
        assert law.openings == pytest.approx(CURVE.openings, rel=1e-14)
        assert law.passing == pytest.approx(CURVE.passing, abs=1e-14)


def test_what_passes_the_smallest_sieve_is_a_class_of_its_own():
    with pytest.warns(PackingWarning, match=r"10 % pass the smallest sieve, 1: .* as large as 0.5 at least"):
        law = sizes.sieve([1.0, 2.0], [0.1, 1.0])
    assert law.openings == (0.5, 1.0, 2.0)
    assert sizes.sieve([1.0, 2.0, 0.0], retained=[9, 0, 1], smallest=0.25).openings == (0.25, 1.0, 2.0)


def test_standard_sieves_are_those_of_the_standards():
    """Openings of ISO 565 are preferred numbers, 10^(3 / 20) apart, to three digits; those of ASTM have numbers."""
    main = np.array(sizes.openings("ISO 565"))
    assert np.abs(main / (main[-1] * 10.0 ** (-0.15 * np.arange(len(main))[::-1])) - 1.0).max() < 0.02
    assert {1.0, 2.0, 63.0, 0.063, 11.2, 0.355} <= set(main)
    finer = np.array(sizes.openings("ISO 565 R40/3"))
    assert {4.75, 2.36, 1.18, 0.6, 0.3, 0.15, 0.075} <= set(finer)
    assert sizes.openings("ASTM E11", [4, "10", "No. 40", 200]) == (4.75, 2.0, 0.425, 0.075)
    assert set(sizes.openings("ASTM E11")) > set(sizes.openings("ASTM E11", [4, 10, 40, 200]))


def test_laws_of_crushed_and_of_concrete_material_are_theirs():
    share = 1.0 - math.exp(-((3.0 / 2.0) ** 1.5))
    assert sizes.rosin_rammler(2.0, 1.5, low=1e-9).cumulative(3.0) == pytest.approx(share, rel=1e-12)
    assert sizes.fuller(1.0, 9.0).cumulative(4.0) == pytest.approx(0.5, rel=1e-14)
    assert sizes.fuller(1.0, 3.0, 1.0, basis="number").quantile(0.3) == sizes.uniform(1.0, 3.0).quantile(0.3)
    # far in the tail, cut there: the share up to d is that of an exponential distribution of the score
    tail = sizes.rosin_rammler(1.0, 1.0, low=60.0)
    assert tail.quantile(0.5) == pytest.approx(60.0 + math.log(2.0), rel=1e-12)
    assert tail.cumulative(61.0) == pytest.approx(1.0 - math.exp(-1.0), rel=1e-9)
    # by number, the integral of d^-3 over exp(-(d / 2)^2) d dd / 2 from 1: by SciPy
    law = sizes.rosin_rammler(2.0, 2.0, low=1.0)
    whole, part = (
        load("scipy.integrate").quad(lambda d: math.exp(-((d / 2.0) ** 2)) / d**2, 1.0, end)[0] for end in (30.0, 2.5)
    )
    assert law.cumulative(2.5, basis="number") == pytest.approx(part / whole, rel=1e-10)


@pytest.mark.parametrize("name", ["Rosin-Rammler", "Rosin-Rammler, cut", "mixture", "steps", "bends"])
def test_many_sizes_are_found_by_polynomials_as_a_few_are_by_iteration(name):
    some = {"steps": sizes.fixed(1.0), "bends": sizes.uniform(2.50013, 2.50027)}
    law = LAWS.get(name) or sizes.mixture([some[name], sizes.uniform(2.0, 3.0)], [0.5, 0.5], basis="number")
    power = law._power("number", 3)
    shares = (np.arange(distribution.MANY) + 0.5) / distribution.MANY
    made = law.quantile(shares, basis="number")
    # half of the values of the last distribution lie between two nodes, where its density changes, and are iterated
    iterated, error = (0.6, 1e-9) if name == "bends" else (2e-3, 1.5e-13)
    assert np.isnan(distribution._curve(law, power)(shares)).mean() < iterated
    assert (np.diff(made) >= -1e-15 * made[1:]).all()
    assert np.abs(made[::97] / law.quantile(shares[::97], basis="number") - 1.0).max() < 1e-10
    if name != "steps":
        assert np.abs(law.cumulative(made, basis="number") - shares).max() < error


def test_sizes_by_number_of_crushed_material_are_those_of_the_exponential_integral():
    law, count = sizes.rosin_rammler(2.0, 3.0, low=1.0), distribution.MANY
    made = law.strata(count, np.random.default_rng(0))[: count - distribution.LARGEST]
    # by number the share of scores up to s is that of the integral of exp(-t) / t
    whole, rest = (load("scipy.special").exp1(score) for score in (1.0 / 8.0, (made / 2.0) ** 3))
    shares = 1.0 - rest / whole
    drawn = np.arange(count) + np.random.default_rng(0).random(count)
    assert np.abs(shares - drawn[: len(made)] / count).max() < 1e-13


def test_steps_of_a_mixture_are_sizes_of_its_grains():
    law = sizes.mixture([sizes.fixed(1.0), sizes.uniform(2.0, 3.0)], [0.5, 0.5], basis="number")
    grains = law.strata(1000, stream(0, "mixture"))
    assert grains[:500] == pytest.approx(1.0, rel=1e-12)
    assert grains[500:].min() > 2.0
    assert sizes.make_sizes(law.to_mapping()) == law
    assert law.scaled(2.0).quantile(0.25) == pytest.approx(2.0, rel=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", LAWS)
def test_strata_follow_the_law_more_nearly_than_draws(name, dimension):
    """By number no farther than one grain from it; by volume nearer than independent draws, at best by their number."""
    law, n = LAWS[name], 3000
    grains = law.strata(n, stream(3, name), dimension=dimension)
    assert (np.diff(grains) >= -1e-12).all()
    shares = law.cumulative(grains, basis="number", dimension=dimension)
    assert np.abs(shares - (np.arange(n) + 0.5) / n).max() <= 1.0 / n
    drawn = law.sample(n, stream(3, name), dimension=dimension)
    near, far = (distance_by_volume(law, sizes_, dimension) for sizes_ in (grains, np.sort(drawn)))
    assert near < 0.75 * far


def distance_by_volume(law, grains, dimension):
    """Return the largest difference of the shares by volume up to a size, by its definition."""
    volumes = np.cumsum(grains**dimension)
    asked = law.cumulative(grains, basis="volume", dimension=dimension)
    below = np.concatenate([[0.0], volumes[:-1]])
    return max(np.abs(volumes / volumes[-1] - asked).max(), np.abs(below / volumes[-1] - asked).max())


@pytest.mark.parametrize(("count", "at_most"), [(500, 0.2), (10_000, 0.025), (1_000_000, 1e-3)])
def test_a_sieve_curve_is_followed_as_nearly_as_a_count_can(count, at_most):
    """A prototype that lays grains along the curve, the largest first, is at 0.18 and 0.022."""
    grains = CURVE.strata(count, stream(1, "sieve"))
    distance = distance_by_volume(CURVE, grains, 3)
    assert distance < at_most
    plan = vg.plan_sizes(CURVE, count)
    assert plan.distance == pytest.approx(distance, rel=0.05)
    assert plan.held["D50"] == pytest.approx(plan.asked["D50"], rel=2.0 * distance + 1e-3)
    # the stated numbers of grains reach what they are stated for
    for wanted, many in plan.counts.items():
        assert distance_by_volume(CURVE, CURVE.strata(many, stream(2, "sieve")), 3) < 1.05 * wanted


def test_a_plan_says_what_fines_are():
    plan = vg.plan_sizes(CURVE, 500)
    size, volume, number = plan.fines[0]
    assert volume == pytest.approx(CURVE.cumulative(size), rel=1e-12)
    assert number == pytest.approx(CURVE.cumulative(size, basis="number"), rel=1e-12)
    assert plan.asked["Cu"] == pytest.approx(CURVE.quantile(0.6) / CURVE.quantile(0.1))
    assert "500 grains" in str(plan)
    assert "4000 grains follow the curve to 0.05" in str(plan)
    # the plan of independent draws is that of such draws
    alone = sizes.sieve(**SHEET, independent=True)
    drawn = np.sort(alone.sample(500, stream(0, "sizes")))
    assert vg.plan_sizes(alone, 500).distance == pytest.approx(distance_by_volume(alone, drawn, 3), rel=1e-9)
    single = vg.plan_sizes(sizes.discrete([1, 2, 4], [1, 1, 1], basis="volume"), 500)
    assert single.distance < 0.02


def drawn_for(shapes, container, law, **request):
    """Return the grains that are drawn for a packing."""
    asked = Request(shapes, container, "rsa", sizes=law, **request)
    return draw_grains(asked, surplus=False, stretches=False, sizing="drawn", own_shapes=False)


@pytest.mark.parametrize("dimension", [2, 3])
def test_shapes_and_sizes_of_strata_are_independent(dimension):
    """In each tenth of the grains by size the shapes have their shares; beginnings of the list have all sizes."""
    names = ("disk", "polygon") if dimension == 2 else ("sphere", "box")
    shapes = [vg.make_shape(name, diameter=1.0) for name in names]
    box = vg.Rectangle((1e3, 1e3)) if dimension == 2 else vg.Box((1e2, 1e2, 1e2))
    law = sizes.lognormal(1.0, 0.4)
    grains = drawn_for(shapes, box, law, count=5000, weights=[3, 1], seed=4)
    order = np.argsort(grains.diameter)
    parts = grains.shape_id[order].reshape(10, 500).mean(axis=1)
    assert parts == pytest.approx(0.25, abs=0.01)
    for many in (100, 777, 2500):
        first = np.sort(law.cumulative(grains.diameter[:many]))
        assert np.abs(first - (np.arange(many) + 0.5) / many).max() < 2.0 / math.sqrt(many) / 2.5


def test_independent_draws_are_a_sample():
    """The distance of a sample is that of Kolmogorov, and that of strata far below."""
    law = sizes.lognormal(1.0, 0.3, independent=True)
    box, sphere = vg.Box((60.0, 60.0, 60.0)), [vg.shapes.sphere()]
    drawn = drawn_for(sphere, box, law, count=2000, seed=2).diameter
    laid = drawn_for(sphere, box, sizes.lognormal(1.0, 0.3), count=2000, seed=2).diameter
    test = load("scipy.stats").kstest
    assert test(drawn, law.cumulative).statistic * math.sqrt(2000) > 0.4
    assert test(laid, law.cumulative).statistic <= 1.0 / 2000 + 1e-12
    assert sizes.make_sizes(law.to_mapping()).independent


def test_a_container_is_filled_to_the_solid_fraction():
    """Also where the volumes of the shapes of the largest grains are not the mean ones."""
    shapes, box = [vg.shapes.sphere(), vg.shapes.box(aspect=(1, 2, 3))], vg.Box((400.0, 400.0, 400.0))
    grains = drawn_for(shapes, box, CURVE, solid_fraction=0.3, seed=1)
    unit = np.array([shape.volume / shape.diameter**3 for shape in shapes])[grains.shape_id]
    volumes = unit * grains.diameter**3
    assert 0.0 <= volumes.sum() / box.volume - 0.3 < volumes.max() / box.volume


def test_few_grains_of_a_wide_curve_are_warned_of():
    with pytest.warns(
        PackingWarning, match=r"500 grains follow the sizes to 0.19 by volume.*about 4000 grains for 0.05"
    ):
        vg.pack(vg.shapes.sphere(), vg.Box((400, 400, 400)), "rsa", count=500, sizes=CURVE)
