"""The search for friction and shaking, on beds whose solid fraction is a formula, with chance and without."""

import math

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.settling import search as module
from voxgran.settling.parameters import Settling, Shaking
from voxgran.settling.search import LASTING, MOST_TRIES, STRONGEST, Search


def usual(how):
    """Solid fraction of spheres: by friction, and a little more by shaking."""
    shaken = 0.0 if how.shaking is None else 0.005 * how.shaking.acceleration
    return 0.575 + 0.06 * math.exp(-how.friction / 0.2) + shaken


def angular(how):
    """Solid fraction that falls steeply at little friction, and rises by the root of the shaking."""
    shaken = 0.0 if how.shaking is None else 0.02 * math.sqrt(how.shaking.acceleration)
    return 0.53 + 0.16 * math.exp(-math.sqrt(how.friction) / 0.4) + shaken


def searched(fraction_of, target, *, least=0.0, rests=lambda how: True, **more):
    """Return the search at its end."""
    search = Search(Settling(solid_fraction=target, **more), least, np.zeros((0, 3)))
    while (place := search.next()) is not None:
        how = search.settling_at(place)
        row = [place, fraction_of(how), float(rests(how))]
        search = Search(search.how, least, np.vstack([search.tries, row]))
    return search


@pytest.mark.parametrize("target", [0.577, 0.58, 0.59, 0.6, 0.61, 0.62, 0.634])
def test_the_friction_of_a_formula_is_found_in_few_tries(target):
    search = searched(usual, target)
    assert search.met
    assert len(search.tries) <= 3
    how = search.settling_at(search.tries[search.best, 0])
    assert how.shaking is None
    assert abs(usual(how) - target) <= 0.002
    # all else is as asked
    assert how == Settling(friction=how.friction, solid_fraction=target)


@pytest.mark.parametrize("target", np.linspace(0.55, 0.705, 12))
def test_steep_and_flat_parts_take_a_few_tries_more(target):
    search = searched(angular, target)
    assert search.met
    assert len(search.tries) <= 8


@pytest.mark.parametrize(("friction", "target"), [(0.0, 0.637), (0.3, 0.592), (1.0, 0.58), (2.0, 0.577)])
def test_a_friction_that_is_given_is_that_of_all_tries(friction, target):
    search = searched(usual, target, friction=friction)
    assert search.met
    assert {search.settling_at(place).friction for place in search.tries[:, 0]} == {friction}
    # looser beds need more of it
    search = searched(usual, 0.5, friction=friction)
    assert search.beyond_range
    assert {search.settling_at(place).friction for place in search.tries[:, 0]} == {friction}


def test_denser_beds_are_shaken_without_friction():
    search = searched(usual, 0.641)
    how = search.settling_at(search.tries[search.best, 0])
    assert search.met
    assert math.copysign(1.0, how.friction) == 1.0
    assert how.friction == 0.0
    assert how.shaking.duration == LASTING
    assert how.shaking.acceleration == pytest.approx(1.2, abs=0.4)
    assert all(math.copysign(1.0, search.settling_at(place).friction) == 1.0 for place in search.tries[:, 0])
    # the bed that is not shaken, and the one that is shaken most, were tried before
    found = [search.settling_at(place) for place in search.tries[:-1, 0]]
    assert any(entry.friction == 0.0 and entry.shaking is None for entry in found)
    assert any(entry.shaking is not None and entry.shaking.acceleration == STRONGEST for entry in found)


def test_the_least_friction_is_that_of_the_grains():
    search = searched(usual, 0.629, least=0.05)
    how = search.settling_at(search.tries[search.best, 0])
    assert search.met
    assert how.friction == 0.05
    assert 0.0 < how.shaking.acceleration < STRONGEST
    assert min(search.settling_at(place).friction for place in search.tries[:, 0]) == 0.05


def test_shaking_that_is_given_is_in_every_try_and_becomes_stronger():
    given = Shaking(1.0, 7.0)
    search = searched(usual, 0.635, shaking=given)
    assert search.settling_at(search.tries[search.best, 0]).shaking == given
    search = searched(usual, 0.643, shaking=given)
    how = search.settling_at(search.tries[search.best, 0])
    assert search.met
    assert 1.0 < how.shaking.acceleration <= STRONGEST
    assert how.shaking.duration == 7.0
    # stronger shaking than the search gives is left as it is
    search = searched(usual, 0.7, shaking=Shaking(5.0))
    assert search.beyond_range
    assert {search.settling_at(place).shaking.acceleration for place in search.tries[:, 0]} == {5.0}


@pytest.mark.parametrize("target", [0.3, 0.57, 0.66, 0.9])
def test_beyond_the_range_both_ends_are_tried_and_the_nearest_is_the_best(target):
    search = searched(usual, target)
    assert not search.met
    assert search.beyond_range
    assert len(search.tries) <= 5
    loosest, densest = (search.settling_at(search.tries[number, 0]) for number in search.reached)
    assert loosest.friction == pytest.approx(1.0, rel=1e-12)
    assert loosest.shaking is None
    assert (densest.friction, densest.shaking) == (0.0, Shaking(STRONGEST, LASTING))
    assert search.best == search.reached[target > 0.6]


def test_a_bed_that_does_not_rest_is_not_taken():
    search = searched(usual, 0.6, rests=lambda how: how.friction > 0.19)
    assert not search.met
    assert len(search.tries) == MOST_TRIES
    assert search.tries[search.best, 2] == 1.0
    nearest = np.abs(search.misses[search.tries[:, 2] > 0.0]).min()
    assert abs(search.misses[search.best]) == nearest > 0.002
    # with none that rests, the nearest one is the best
    search = searched(usual, 0.6, rests=lambda how: False)
    assert abs(search.misses[search.best]) == np.abs(search.misses).min()


@pytest.mark.parametrize("formula", [usual, angular])
@pytest.mark.parametrize("scatter", [0.003, 0.008])
def test_beds_that_differ_by_chance_are_met_too(formula, scatter):
    """Also where the first beds are far from the mean: of 200 searches nearly all end well."""
    tries = []
    for seed in range(200):
        noise = stream(seed, "noise")
        search = searched(lambda how, noise=noise: formula(how) + scatter * float(noise.normal()), 0.6)
        tries.append(len(search.tries) if search.met else 1000)
    assert np.mean(np.array(tries) < 1000) >= (0.995 if scatter < 0.005 else 0.97)
    # a bed chosen at random among those of the right friction is within 0.002 with a chance of 0.5 and 0.2
    assert np.median(tries) <= (5 if scatter < 0.005 else 9)


def test_an_end_that_stays_loses_half_of_its_weight(monkeypatch):
    """Plain false position takes hundreds of tries for a curve like this; the Illinois algorithm some ten."""
    for name, value in {"MET": 1e-9, "NARROW": 0.0, "FEW_TRIES": 1000, "MOST_TRIES": 200, "INSIDE": 0.0}.items():
        monkeypatch.setattr(module, name, value)
    for power, target in ((4, 0.55), (0.25, 0.65)):
        search = searched(lambda how, power=power: 0.5 + 0.2 * math.exp(-power * how.friction / 0.2), target)
        assert search.met
        assert len(search.tries) <= 14


def test_where_friction_works_the_wrong_way_the_search_ends():
    search = searched(lambda how: 0.6 + 0.01 * how.friction - (0.0 if how.shaking is None else 0.01), 0.602)
    # what was given, a looser one in vain, and both ends
    assert len(search.tries) == 4
    assert not search.met
    assert not search.beyond_range
