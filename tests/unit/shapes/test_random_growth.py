"""Random growth: the kernel against a plain twin, probabilities of small clusters, radii and axes of large ones."""

import math

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.shapes.families.random import random_growth
from voxgran.shapes.families.random.random_growth import GAIN, RandomGrowth, grown

STEPS = np.array([(-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), (0, 0, -1), (0, 0, 1)])


def grown_plainly(parameters, generator):
    """Return the places of the cubes with sets and lists, from the same random numbers as the kernel."""
    aspect = np.array(parameters.aspect or (1.0, 1.0, 1.0))
    log_aspect = np.log(aspect) - np.log(aspect).mean()
    rate = np.array(parameters.rates or (1.0, 1.0, 1.0))
    rate, power, draws = rate / rate.max(), parameters.power, iter(())
    cells, taken, bonds = [], set(), []

    def take(place):
        cells.append(place)
        taken.add(place)
        for k, step in enumerate(STEPS.tolist()):
            beside = tuple(a + b for a, b in zip(place, step, strict=True))
            if beside not in taken:
                bonds.append((beside, k // 2))

    take((0, 0, 0))
    while len(cells) < parameters.cubes:
        pair = next(draws, None)
        if pair is None:
            draws = iter(generator.random(random_growth.DRAWN).reshape(-1, 2).tolist())
            continue
        pick = int(pair[0] * len(bonds))
        place, axis = bonds[pick]
        if place in taken:
            bonds[pick] = bonds[-1]
            bonds.pop()
            continue
        many = sum(tuple(np.add(place, step)) in taken for step in STEPS)
        chance = (many / 6) ** (power - 1) if power > 1 else many ** (power - 1)
        if pair[1] >= rate[axis] * chance:
            continue
        take(place)
        if parameters.aspect:
            wanted = log_aspect - 0.5 * np.log(np.var(cells, axis=0) + 1 / 12)
            wanted -= wanted.mean()
            rate = np.exp(GAIN * (wanted - wanted.max()))
    return np.array(cells)


@pytest.mark.parametrize(
    "given",
    [{}, {"power": 0.0}, {"power": 2.5}, {"power": -3.0}, {"rates": (1.0, 2.0, 5.0)}, {"aspect": (1.0, 2.0, 3.0)}],
)
def test_cubes_are_those_of_a_plain_twin(given):
    parameters = RandomGrowth(cubes=250, **given)
    cells = grown(parameters, stream(1, "twin"))
    assert (cells == grown_plainly(parameters, stream(1, "twin"))).all()


def test_a_grid_that_is_too_small_changes_nothing_but_the_order_of_free_places(monkeypatch):
    cells = grown(RandomGrowth(cubes=4000, rates=(1.0, 1.0, 10.0)), stream(1, "wide"))
    assert len(np.unique(cells, axis=0)) == 4000
    assert np.abs(cells[:, 2]).max() > 3 + 0.8 * 4000 ** (1 / 3)  # the first grid was too small
    apart = np.abs(cells[1:, None] - cells[None, :400]).sum(axis=2)[:400]
    earlier = np.arange(400)[None] < np.arange(1, 401)[:, None]
    assert ((apart == 1) & earlier).any(axis=1).all()


@pytest.mark.parametrize("power", [-2.0, slow(0.0), slow(1.0), 3.0])
def test_small_clusters_have_their_exact_probabilities(power):
    # the third cube lies in line with the others on 2 of 10 places; beside an L of three, one place has two neighbours
    # and 12 have one
    many, lines, squares = 3000, 0, 0
    generator, parameters = stream(5, f"small {power}"), RandomGrowth(cubes=4, power=power)
    for _ in range(many):
        cells = grown(parameters, generator)
        lines += int(np.count_nonzero(np.ptp(cells[:3], axis=0)) == 1)
        squares += int(sorted(np.ptp(cells, axis=0).tolist()) == [0, 1, 1])
    square = 0.8 * 2.0**power / (12 + 2.0**power)
    for found, p in ((lines, 0.2), (squares, square)):
        assert found / many == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / many))


def test_rates_are_those_of_the_first_step():
    many, generator = 3000, stream(6, "rates")
    first = np.array([np.abs(grown(RandomGrowth(cubes=2, rates=(1, 2, 5)), generator)[1]) for _ in range(many)])
    assert first.mean(axis=0) == pytest.approx(np.array([1, 2, 5]) / 8, abs=4 * math.sqrt(0.25 / many))


def radii(cubes, seeds, **given):
    """Return the radii of gyration along the axes of clusters, (seeds, 3)."""
    clusters = (grown(RandomGrowth(cubes=cubes, **given), stream(seed, "radii")) for seed in range(seeds))
    return np.array([np.sqrt(cells.var(axis=0) + 1 / 12) for cells in clusters])


@pytest.mark.parametrize("power", [0.0, 1.0, 3.0])
def test_radii_grow_as_the_cube_root_of_the_number(power):
    small, large = (np.sqrt((radii(n, 4, power=power) ** 2).sum(axis=1)) for n in (20_000, 160_000))
    exponents = np.log(large / small) / math.log(8)
    # clusters become denser as they grow, so that exponents lie a little below
    assert exponents.mean() == pytest.approx(1 / 3, abs=0.03 if power == 0.0 else 0.02)
    sphere = math.sqrt(3 / 5) * (3 * 160_000 / (4 * math.pi)) ** (1 / 3)
    assert (large > 0.999 * sphere).all()
    assert (large < {0.0: 1.05, 1.0: 1.025, 3.0: 1.015}[power] * sphere).all()


def test_the_zone_in_which_a_cluster_grows_gets_narrow():
    widths = []
    for many in (20_000, 160_000):
        cells = grown(RandomGrowth(cubes=many), stream(1, "rough"))
        last = np.linalg.norm(cells - cells.mean(axis=0), axis=1)[-many // 50 :]
        widths.append(last.std() / last.mean())
    # relative to the radius, which doubles
    assert widths[1] < 0.7 * widths[0] < 0.1


@pytest.mark.parametrize("aspect", [(1, 2, 3), (3, 1, 1), (1, 4, 4)])
def test_axes_have_the_ratio_that_is_asked_for(aspect):
    ratio = radii(20_000, 6, aspect=aspect) / np.array(aspect)
    ratio /= np.prod(ratio, axis=1, keepdims=True) ** (1 / 3)
    assert ratio.mean(axis=0) == pytest.approx(np.ones(3), abs=0.025)
    assert np.abs(np.log(ratio)).max() < 0.04


def test_the_record_holds_cubes_and_radii():
    shape = vg.make_shape("random_growth", seed=3, cubes=3000, aspect=(1, 1, 2), edge=1.0)
    record = shape.record
    assert record["cubes"] == 3000
    # the inertia of the exact solid is the other way to the same radii
    moments = np.diag(shape.inertia) / shape.volume
    assert np.sqrt(moments.sum() / 2 - moments) == pytest.approx(record["gyration_radii"], rel=1e-9)
