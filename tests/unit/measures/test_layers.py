"""Gradations of layers: of random order, of sorted columns, and where middle sizes are on top."""

import math

import numpy as np
import pytest
import scipy.stats

from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.measures.model import measure
from voxgran.measures.registered.segregation import (
    LAYERS,
    QUANTILES,
    TABLES,
    layers_of,
    ranks_of,
    segregation,
    size_layers,
)
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
DISK = Shape.of(Outline("disk", radius=0.5), name="disk")


def layers(sizes, height=None):
    """Return the layers of grains of these sizes, from low to high where no heights are given."""
    sizes = np.asarray(sizes, dtype=float)
    return size_layers(sizes, ranks_of(sizes), np.arange(len(sizes), dtype=float) if height is None else height)


@pytest.mark.slow
def test_p_values_of_random_order_are_uniform():
    generator = stream(1, "orders")
    sizes = 0.5 + generator.random(200)
    found = [layers(generator.permutation(sizes)) for _ in range(200)]
    p_values = np.array([one.p_value for one in found])
    assert scipy.stats.kstest(p_values, "uniform").pvalue > 0.01
    assert scipy.stats.kstest([one.p_values[3] for one in found], "uniform").pvalue > 0.01
    # the largest distance of all layers is rare where each is not
    assert np.mean([one.p_values.min() <= 0.05 for one in found]) > 0.2
    assert np.mean(p_values <= 0.05) < 0.1


def test_few_sizes_are_tested_too():
    generator = stream(2, "orders")
    sizes = np.repeat([0.5, 0.9], [150, 50])
    p_values = [layers(generator.permutation(sizes)).p_value for _ in range(200)]
    # with few different tables p-values are at least as large as uniform ones
    for level in (0.05, 0.2, 0.5):
        assert np.mean(np.array(p_values) <= level) <= level + 4 * math.sqrt(level / 200)
    assert layers(sizes).p_value == 1 / (TABLES + 1)


def test_sorted_columns():
    sizes = np.linspace(0.5, 1.0, 80)
    for one in (layers(sizes), layers(sizes[::-1])):
        assert one.p_value == 1 / (TABLES + 1)
        assert one.largest == pytest.approx(7 / 8)
    rising = layers(sizes)
    assert rising.mean == pytest.approx(sizes.reshape(8, 10).mean(axis=1))
    assert rising.height == pytest.approx(np.arange(80).reshape(8, 10).mean(axis=1))
    assert rising.distance[0] == rising.distance[-1] == pytest.approx(7 / 8)
    assert rising.quantiles[0, QUANTILES.index(0.5)] == pytest.approx(sizes[4])


def test_middle_sizes_on_top_have_no_correlation_but_a_distance():
    sizes = np.linspace(0.5, 1.0, 400)
    order = np.argsort(-np.abs(sizes - 0.75) + 1e-9 * stream(3, "ties").random(400))
    position = np.column_stack([np.full(400, 0.5), np.full(400, 0.5), np.arange(400) + 0.5])
    packing = Packing.of([BALL], Box((1, 1, 400)), position=position, scale=sizes[order])
    assert abs(segregation(packing).whole) < 0.01
    assert layers_of(packing).p_value == 1 / (TABLES + 1)
    tree = measure(packing, "segregation")
    assert float(tree.layer_p_value) == 1 / (TABLES + 1)
    assert float(tree.layer_distance) == float(tree["layers"].distance.max()) > 0.4


def test_the_distance_is_that_of_the_steps_of_both_shares():
    generator = stream(4, "sizes")
    sizes = generator.choice(0.5 + 0.01 * np.arange(40), 333)
    found = layers(sizes)
    assert found.count.tolist() == [42, 42, 42, 42, 42, 41, 41, 41]
    begin = 0
    for k, count in enumerate(found.count):
        some = sizes[begin : begin + count]
        begin += count
        expected = max(abs((some <= size).mean() - (sizes <= size).mean()) for size in sizes)
        assert found.distance[k] == pytest.approx(expected, abs=1e-12)
    # it is that between the layer and the others, times their share
    rest = scipy.stats.ks_2samp(sizes[:42], sizes[42:]).statistic
    assert found.distance[0] == pytest.approx(rest * (1 - 42 / 333), abs=1e-12)


def test_more_sizes_than_classes():
    sizes = 0.5 + stream(5, "many").random(2000)
    found = layers(sizes)
    exact = scipy.stats.ks_2samp(sizes[:250], sizes[250:])
    # the p-value of one layer is that of the exact test of two samples, up to the number of random tables
    assert found.p_values[0] == pytest.approx(exact.pvalue, abs=0.06)
    assert found.distance[0] == pytest.approx(exact.statistic * 7 / 8, abs=1e-12)


@pytest.mark.slow
def test_the_error_of_a_mean():
    generator = stream(6, "means")
    sizes = 0.5 + generator.random(160)
    means = np.array([layers(generator.permutation(sizes)).mean for _ in range(60)])
    assert layers(sizes).error[0] == pytest.approx(means.std(), rel=0.12)
    # of 20 grains half are in a layer: their means scatter less than those of independent grains
    few = 0.5 + generator.random(20)
    means = np.array([layers(generator.permutation(few)).mean for _ in range(400)])
    assert layers(few).error[0] == pytest.approx(means.std(), rel=0.12)


def test_equal_heights_are_in_random_order():
    # the order of the grains is by size, as a method may leave it, and all lie on the floor
    found = layers(np.linspace(0.5, 1.0, 400), height=np.zeros(400))
    assert found.p_value > 0.01


def test_numbers_of_layers():
    assert len(layers(np.linspace(1, 2, 79)).count) == 7
    assert len(layers(np.linspace(1, 2, 1000)).count) == LAYERS
    assert layers(np.linspace(1, 2, 25)).count.tolist() == [13, 12]
    for none in (layers(np.linspace(1, 2, 19)), layers(np.ones(100)), layers([]), layers([1.0])):
        assert len(none.count) == 0
        assert none.quantiles.shape == (0, len(QUANTILES))
        assert math.isnan(none.p_value)
        assert math.isnan(none.largest)


@pytest.mark.parametrize("count", [0, 1, 60])
@pytest.mark.parametrize("dimension", [2, 3])
def test_in_a_tree(count, dimension):
    shape, box = (BALL, Box((1, 1, 60), "xy")) if dimension == 3 else (DISK, Rectangle((1, 60), "x"))
    position = np.full((count, 3), 0.5)
    position[:, dimension:] = 0.0
    position[:, dimension - 1] += np.arange(count)
    scale = 0.5 + 0.4 * stream(7, "scale").random(count)
    packing = Packing.of([shape], box, position=position, scale=scale, unit="mm")
    tree = measure(packing, "segregation")
    assert tree["layers"].sizes["layer"] == (6 if count == 60 else 0)
    assert tree["layers"].mean_diameter.attrs["units"] == "mm"
    without = measure(Packing.of([shape], box, position=position, scale=scale, gravity=None), "segregation")
    assert without["layers"].sizes["layer"] == 0
    assert math.isnan(float(without.layer_p_value))
