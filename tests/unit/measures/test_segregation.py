"""Segregation of beds that were sorted, reversed or shuffled by hand."""

import math

import numpy as np
import pytest
import scipy.stats

from voxgran._base.seeds import stream
from voxgran.containers.kinds.box import Box
from voxgran.containers.kinds.rectangle import Rectangle
from voxgran.measures.model import measure
from voxgran.measures.registered.segregation import heights, is_notable, ranks_of, segregation, warning_of
from voxgran.packing.model import Packing
from voxgran.shapes.model import Shape
from voxgran.shapes.outline import Outline
from voxgran.shapes.primitive import Primitive

BALL = Shape.of(Primitive("sphere", (0.5,)), name="sphere")
COUNT = 216


def bed(sizes, gravity="-z", axis=2, **more):
    """Return spheres in layers of 6 x 6 along an axis, in the order of their height."""
    layer, place = np.divmod(np.arange(len(sizes)), 36)
    position = np.column_stack([place % 6 + 0.5, place // 6 + 0.5, layer + 0.5 + 1e-6 * place])
    position = np.roll(position, axis + 1, axis=1)
    return Packing.of([BALL], Box((6, 6, 6)), position=position, scale=sizes, gravity=gravity, **more)


SIZES = np.sort(0.5 + 0.4 * stream(1, "sizes").random(COUNT))


def test_a_sorted_bed():
    assert segregation(bed(SIZES)).whole == pytest.approx(1.0)
    assert segregation(bed(SIZES[::-1])).whole == pytest.approx(-1.0)
    assert segregation(bed(SIZES)).bulk == pytest.approx(1.0)
    assert segregation(bed(SIZES, gravity="+z")).whole == pytest.approx(-1.0)
    assert segregation(bed(SIZES, gravity="-x", axis=0)).whole == pytest.approx(1.0)


def test_a_shuffled_bed_has_none_but_for_noise():
    found = [segregation(bed(stream(seed, "order").permutation(SIZES))).whole for seed in range(20)]
    # the standard deviation of the rank correlation of independent values is 1 / sqrt(n - 1)
    assert np.abs(found).max() < 4 / math.sqrt(COUNT - 1)
    assert np.std(found) == pytest.approx(1 / math.sqrt(COUNT - 1), rel=0.5)


def test_it_is_the_correlation_of_scipy():
    sizes = stream(2, "ties").choice([0.5, 0.7, 0.9], COUNT)
    packing = bed(sizes)
    expected = scipy.stats.spearmanr(packing.diameters, packing.position[:, 2]).statistic
    assert segregation(packing).whole == pytest.approx(expected, abs=1e-12)
    # round-off does not rank equal sizes
    noisy = bed(sizes * (1 + 1e-13 * stream(3, "noise").random(COUNT)))
    assert segregation(noisy).whole == pytest.approx(expected, abs=1e-12)


def test_the_bulk_is_that_of_the_solid_fraction():
    packing = bed(SIZES)
    tree = measure(packing, ["density", "segregation"])
    inside = np.abs(packing.position - 3).max(axis=1) <= 3 - 1.5 * np.median(packing.diameters)
    below = packing.position[:, 2] < 6
    assert inside.sum() == int(tree.bulk_count)
    kept = inside & below
    expected = scipy.stats.spearmanr(packing.diameters[kept], packing.position[kept, 2]).statistic
    assert float(tree.bulk_segregation) == pytest.approx(expected, abs=1e-12)


def test_what_has_no_segregation():
    equal = bed(np.full(COUNT, 0.9))
    for packing in (equal, bed(SIZES, gravity=None), bed(SIZES[:2]), bed(SIZES[:0])):
        assert math.isnan(segregation(packing).whole)
        assert math.isnan(segregation(packing).bulk)
        assert math.isnan(float(measure(packing, "segregation").segregation))
    assert "segregation" not in measure(equal, ["density"]).data_vars
    assert "/size_classes" not in measure(equal).groups


def test_classes_of_sizes():
    found = segregation(bed(SIZES))
    assert found.count.tolist() == [43, 43, 44, 43, 43]
    assert (found.smallest[1:] > found.largest[:-1]).all()
    assert (np.diff(found.height) > 0).all()
    order = bed(SIZES).position[:, 2]
    assert found.height[0] == pytest.approx(order[:43].mean())
    two = segregation(bed(np.repeat([0.5, 0.9], COUNT // 2)))
    assert two.count.tolist() == [108, 108]
    assert two.smallest.tolist() == two.largest.tolist() == [0.5, 0.9]
    # most grains have one size: it is one class
    skew = segregation(bed(np.concatenate([np.full(200, 0.5), 0.6 + 0.01 * np.arange(16)])))
    assert skew.count.sum() == COUNT
    assert skew.count[0] == 200


def test_heights_run_against_gravity():
    packing = bed(SIZES, gravity=(3.0, 0.0, -4.0))
    up = np.array([-0.6, 0.0, 0.8])
    assert heights(packing) == pytest.approx((packing.position - [6, 0, 0]) @ up)
    assert heights(packing).min() >= 0


def test_grains_of_two_densities():
    """Two shapes of one size: the heavy ones in the lower layers, in the upper ones, and anywhere."""
    heavy, light = BALL, Shape.of(Primitive("sphere", (0.5,)), name="light")

    def mixed(which, density=(7800.0, 2500.0)):
        layers = bed(np.full(COUNT, 0.9))
        shapes = [heavy, light]
        return Packing.of(
            shapes,
            layers.container,
            position=layers.position,
            scale=np.full(COUNT, 0.9),
            shape_id=which,
            gravity="-z",
            density=density,
        )

    low = np.arange(COUNT) // (COUNT // 2)
    shuffled = stream(4, "order").permutation(low)
    for which in (low, 1 - low, shuffled):
        packing = mixed(which)
        expected = scipy.stats.spearmanr(packing.densities, packing.position[:, 2]).statistic
        assert float(measure(packing).density_segregation) == pytest.approx(expected, abs=1e-12)
        assert math.isnan(float(measure(packing).segregation))
    assert segregation(mixed(low)).by_density == pytest.approx(-math.sqrt(3) / 2, abs=1e-4)
    assert segregation(mixed(1 - low)).by_density == pytest.approx(math.sqrt(3) / 2, abs=1e-4)
    assert abs(segregation(mixed(shuffled)).by_density) < 4 / math.sqrt(COUNT - 1)
    equal = mixed(low, density=2500.0)
    assert math.isnan(segregation(equal).by_density)
    assert "density_segregation" not in measure(bed(SIZES), "segregation")


def test_disks():
    disk = Shape.of(Outline("disk", radius=0.5), name="disk")
    position = np.column_stack([np.full(9, 0.5), np.arange(9) + 0.5, np.zeros(9)])
    packing = Packing.of([disk], Rectangle((1, 9)), position=position, scale=np.linspace(0.5, 0.9, 9))
    assert segregation(packing).whole == pytest.approx(1.0)


def test_ranks_of_sizes():
    assert ranks_of(np.array([2.0, 1.0, 2.0 + 1e-12, 3.0])).tolist() == [1, 0, 1, 2]
    assert ranks_of(np.zeros(0)).tolist() == []


def test_a_warning_is_of_more_than_noise():
    assert is_notable(0.31, 1000)
    assert is_notable(-0.31, 1000)
    assert not is_notable(0.29, 10_000)
    assert not is_notable(0.5, 20)
    assert not is_notable(math.nan, 1000)
    assert "large grains lie above small ones" in warning_of(0.76, 1000)
    assert "correlation of diameter and height is -0.76" in warning_of(-0.76, 1000)
    assert "below" in warning_of(-0.76, 1000)
    assert warning_of(0.1, 1000) == ""
