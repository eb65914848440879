"""Fabric tensors and roses of directions whose distribution is known."""

import math

import numpy as np
import pytest
import scipy.stats

from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.measures.directions import RINGS, SECTORS, fabric_of, fitted_density, rose_of, traceless_2, traceless_4


def isotropic(count, dimension, seed=1):
    """Return random unit vectors, (m, 3)."""
    way = stream(seed, "isotropic").normal(size=(count, 3))
    way[:, dimension:] = 0.0
    return way / np.linalg.norm(way, axis=1, keepdims=True)


def by_density(density, count, dimension, seed=2):
    """Return directions of a density relative to an isotropic one, which is at most 4, by rejection."""
    way = isotropic(8 * count, dimension, seed)
    kept = 4.0 * stream(seed, "rejection").random(len(way)) < density(way)
    assert kept.sum() >= count
    return way[kept][:count]


def fcc():
    """Return the directions to the 12 neighbours in a face-centred cubic lattice."""
    signs = np.array([[a, b] for a in (1, -1) for b in (1, -1)])
    return np.concatenate([np.insert(signs, k, 0, axis=1) for k in range(3)]).astype(float)


@pytest.mark.parametrize("dimension", [2, 3])
def test_isotropic_directions(dimension):
    found = fabric_of(isotropic(200_000, dimension), dimension=dimension)
    assert found.second == pytest.approx(np.eye(dimension) / dimension, abs=4e-3)
    assert found.second_order.plain < 0.02
    # the mean of n_x^4: 3/8 in the plane, 1/5 in space
    assert found.fourth[0, 0, 0, 0] == pytest.approx({2: 3 / 8, 3: 1 / 5}[dimension], abs=3e-3)
    assert found.count == 200_000


def test_a_cubic_lattice_has_no_second_order_and_a_fourth():
    found = fabric_of(fcc(), dimension=3)
    assert found.second == pytest.approx(np.eye(3) / 3)
    assert found.second_order.plain == pytest.approx(0.0, abs=1e-12)
    assert found.fourth[0, 0, 0, 0] == pytest.approx(1 / 6)
    assert found.fourth[0, 0, 1, 1] == found.fourth[1, 0, 1, 0] == pytest.approx(1 / 12)
    assert found.fourth[0, 0, 0, 1] == pytest.approx(0.0, abs=1e-15)
    excess = np.array(found.fourth)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                for m in range(3):
                    same = (i == j) * (k == m) + (i == k) * (j == m) + (i == m) * (j == k)
                    excess[i, j, k, m] -= same / 15
    assert found.fourth_order.deviator == pytest.approx(315 / 8 * excess)
    assert found.fourth_order.plain == pytest.approx(math.sqrt(8 / 35 * np.square(315 / 8 * excess).sum()))


@pytest.mark.parametrize(("dimension", "second", "fourth"), [(2, 2.0, 2.0), (3, 5.0, 9.0)])
def test_one_direction_has_the_amplitudes_of_a_delta_function(dimension, second, fourth):
    # 2 in the plane; 2 l + 1 for the Legendre polynomial P_l in space
    way = np.tile(isotropic(1, dimension), (7, 1)) * np.array([1, -1, 1, 1, -1, 3, 1e-200])[:, None]
    found = fabric_of(way, dimension=dimension)
    assert [found.second_order.plain, found.second_order.unbiased] == pytest.approx([second] * 2)
    assert found.fourth_order.plain == pytest.approx(fourth)
    assert found.second_order.error == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_known_distribution_is_found_within_its_error(dimension):
    """The density 1 + a cos 2t + b cos 4t, or 1 + a P_2 + b P_4, around a tilted axis."""
    a, b = 0.6, 0.3
    axis = isotropic(1, dimension, seed=8)[0]

    def density(way):
        c = way @ axis
        if dimension == 2:
            return 1 + a * np.cos(2 * np.arccos(np.clip(c, -1, 1))) + b * np.cos(4 * np.arccos(np.clip(c, -1, 1)))
        return 1 + a * (3 * c**2 - 1) / 2 + b * (35 * c**4 - 30 * c**2 + 3) / 8

    found = [fabric_of(by_density(density, 2000, dimension, seed), dimension=dimension) for seed in range(60)]
    for order, expected in (("second_order", a), ("fourth_order", b)):
        values = np.array([getattr(one, order).unbiased for one in found])
        errors = np.array([getattr(one, order).error for one in found])
        assert values.mean() == pytest.approx(expected, abs=4 * errors.mean() / math.sqrt(60))
        assert values.std(ddof=1) == pytest.approx(errors.mean(), rel=0.3)
    large = fabric_of(by_density(density, 100_000, dimension), dimension=dimension)
    way = isotropic(50, dimension, seed=5)[:, :dimension]
    fitted = fitted_density(large.second_order.deviator, way)
    fitted += np.einsum("ijkl,ci,cj,ck,cl->c", large.fourth_order.deviator, way, way, way, way)
    assert fitted == pytest.approx(density(np.pad(way, ((0, 0), (0, 3 - dimension)))), abs=0.06)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_bias_of_few_directions_is_removed(dimension):
    found = [fabric_of(isotropic(50, dimension, seed), dimension=dimension).second_order for seed in range(800)]
    factor = {2: 4.0 * math.sqrt(1 / 2), 3: 7.5 * math.sqrt(2 / 3)}[dimension]
    # an isotropic distribution has tr N^2 = 1/d, of which a mean of 50 directions keeps (1 - 1/d) / 50 on average
    bias = factor**2 * (1 - 1 / dimension) / 50
    plain = np.array([one.plain for one in found])
    assert np.square(plain).mean() == pytest.approx(bias, rel=0.08)
    # the difference of squares has the mean 0 before it is cut at 0
    rest = 1 - 1 / dimension
    exact = plain**2 - (factor**2 * rest - plain**2) / 49
    assert np.mean(exact) == pytest.approx(0.0, abs=0.08 * bias)
    assert [one.unbiased for one in found] == pytest.approx(np.sqrt(np.maximum(exact, 0.0)), abs=1e-7)


def test_weights():
    way = isotropic(40, 3)
    twice = np.arange(40) % 3 == 0
    doubled = fabric_of(np.concatenate([way, way[twice]]), dimension=3)
    weighted = fabric_of(way, 1.0 + twice, dimension=3)
    assert weighted.second == pytest.approx(doubled.second)
    assert weighted.fourth == pytest.approx(doubled.fourth)
    assert weighted.second_order.plain == pytest.approx(doubled.second_order.plain)
    tiny = fabric_of(way * 1e-180, (1.0 + twice) * 1e-200, dimension=3)
    assert tiny.second == pytest.approx(doubled.second)
    assert tiny.second_order.error == pytest.approx(weighted.second_order.error)


def test_turned_directions_have_the_same_anisotropy():
    way = isotropic(300, 3) * [1.0, 1.5, 3.0]
    turn = rotation_matrices(random_rotations(stream(3, "turn"), 1))[0]
    one, two = fabric_of(way, dimension=3), fabric_of(way @ turn.T, dimension=3)
    for order in ("second_order", "fourth_order"):
        for name in ("plain", "unbiased", "error"):
            assert getattr(getattr(two, order), name) == pytest.approx(getattr(getattr(one, order), name))
    assert two.second == pytest.approx(turn @ one.second @ turn.T)


@pytest.mark.parametrize("dimension", [2, 3])
def test_traceless_parts(dimension):
    found = fabric_of(isotropic(30, dimension) * [1, 2, 3], dimension=dimension)
    assert np.trace(traceless_2(found.second)) == pytest.approx(0.0, abs=1e-15)
    assert np.einsum("iijk->jk", traceless_4(found.fourth)) == pytest.approx(np.zeros((dimension,) * 2), abs=1e-15)


def test_the_scatter_is_that_of_the_longest_waves():
    way, turns = isotropic(4000, 3), stream(4, "turns").random((4000, 3))
    alone = fabric_of(way, dimension=3).second_order
    here = fabric_of(way, dimension=3, turns=turns).second_order
    # independent directions at independent places
    assert here.error == pytest.approx(alone.error, rel=0.15)
    # each direction four times: four times the squared error of the mean of so many independent ones
    copies = fabric_of(np.tile(way[:1000], (4, 1)), dimension=3, turns=np.tile(turns[:1000], (4, 1))).second_order
    thousand = fabric_of(way[:1000], dimension=3).second_order
    assert copies.error == pytest.approx(thousand.error, rel=0.15)
    assert copies.unbiased == pytest.approx(thousand.unbiased, abs=0.02)
    # dense and empty parts of a sample are no scatter of its directions
    long = way * [1, 1, 6]
    crowded = fabric_of(long, dimension=3, turns=turns**4).second_order
    assert crowded.error == pytest.approx(fabric_of(long, dimension=3).second_order.error, rel=0.25)
    aligned = fabric_of(np.tile([[1.0, 2, 3]], (50, 1)), dimension=3, turns=turns[:50])
    for one in (aligned.second_order, aligned.fourth_order):
        assert one.unbiased == pytest.approx(one.plain, abs=1e-6)
    # a lattice repeats itself: its mean does not scatter
    ticks = np.arange(4) / 4
    cells = np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3)
    bent = fcc() * [1, 1, 1.2]
    lattice = fabric_of(np.tile(bent, (64, 1)), dimension=3, turns=np.repeat(cells, 12, axis=0)).second_order
    assert lattice.error == pytest.approx(0.0, abs=1e-9)
    assert lattice.unbiased == pytest.approx(lattice.plain)


@pytest.mark.parametrize("dimension", [2, 3])
def test_few_directions(dimension):
    none = fabric_of(np.zeros((0, 3)), dimension=dimension)
    zero = fabric_of(np.zeros((4, 3)), dimension=dimension, turns=np.zeros((4, dimension)))
    for found in (none, zero):
        assert found.count == 0
        assert np.isnan(found.fourth).all()
        assert math.isnan(found.second_order.plain)
        assert found.fourth.shape == (dimension,) * 4
    one = fabric_of(np.array([[2.0, 0, 0]]), dimension=dimension)
    assert one.second[0, 0] == 1.0
    assert math.isnan(one.second_order.error)
    assert math.isnan(one.second_order.unbiased)
    assert np.isnan(rose_of(np.zeros((0, 3)), dimension=dimension).density).all()


def test_cells_have_equal_areas_and_tile_the_hemisphere():
    cells = rose_of(np.zeros((0, 3)), dimension=3).cells
    assert len(cells) == (2 * RINGS + 1) ** 2
    area = (np.cos(cells[:, 0, 0]) - np.cos(cells[:, 0, 1])) * (cells[:, 1, 1] - cells[:, 1, 0])
    assert area == pytest.approx(2 * np.pi / len(cells))
    flat = rose_of(np.zeros((0, 3)), dimension=2).cells
    assert flat[:, 1].mean(axis=1) == pytest.approx(np.arange(SECTORS) * np.pi / SECTORS)


@pytest.mark.parametrize("pole", [0, 1, 2])
def test_a_direction_is_in_its_cell(pole):
    cells = rose_of(np.zeros((0, 3)), dimension=3).cells
    polar, azimuth = cells.mean(axis=2).T
    polar[0] = 0.0
    way = np.empty((len(cells), 3))
    way[:, (pole + 1) % 3] = np.sin(polar) * np.cos(azimuth)
    way[:, (pole + 2) % 3] = np.sin(polar) * np.sin(azimuth)
    way[:, pole] = np.cos(polar)
    for k, one in enumerate(way):
        for sign in (1.0, -1.0):
            found = rose_of(sign * one[None], dimension=3, pole=pole).density
            assert np.flatnonzero(found).tolist() == [k]
    assert rose_of(way, dimension=3, pole=pole).density == pytest.approx(1.0)


def test_directions_on_the_equator_count_on_both_sides():
    found = rose_of(np.array([[1.0, 0, 0], [0, 2.0, 0]]), dimension=3)
    assert np.flatnonzero(found.density).tolist() == [49, 57, 65, 73]
    assert found.density.mean() == pytest.approx(1.0)
    assert found.density[49] == pytest.approx(81 / 4)
    flat = rose_of(np.array([[1.0, -1e-17, 0], [-1.0, -1e-17, 0], [0, 1.0, 0]]), dimension=2)
    assert np.flatnonzero(flat.density).tolist() == [0, 9]
    assert flat.density[0] == pytest.approx(SECTORS * 2 / 3)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_rose_of_isotropic_directions_scatters_as_it_says(dimension):
    found = rose_of(isotropic(20_000, dimension), dimension=dimension)
    score = (found.density - 1.0) / found.error
    assert found.density.mean() == pytest.approx(1.0)
    assert scipy.stats.chi2.sf(np.square(score).sum(), len(score) - 1) > 1e-3
    assert found.error.mean() == pytest.approx(math.sqrt((len(score) - 1) / 20_000), rel=0.05)
    share = 1.0 / len(score)
    assert found.error[0] == pytest.approx(
        len(score) * math.sqrt(found.density[0] * share * (1 - found.density[0] * share) / 20_000)
    )
