"""Grains that are removed at random, with the gradation kept."""

import warnings

import numpy as np
import pytest
from scipy.stats import kstest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning

BOX = vg.Box((8, 8, 8), periodic="xyz")
GRADED = vg.sizes.lognormal(1.0, 0.3)


@pytest.fixture(scope="module")
def dense():
    return vg.pack(vg.make_shape("sphere"), BOX, method="expand", solid_fraction=0.6, sizes=GRADED)


def test_the_solid_fraction_is_met_to_half_a_grain(dense):
    largest = dense.volumes.max() / BOX.volume
    for wanted in (0.55, 0.4, 0.2, 0.0):
        with warnings.catch_warnings(action="ignore", category=PackingWarning):
            kept = vg.remove_grains(dense, solid_fraction=wanted)
        assert abs(kept.solid_fraction - wanted) <= 0.5 * largest
        assert kept.provenance["removal"]["removed"] == dense.count - kept.count
    assert kept.count == 0


def test_the_gradation_is_kept_better_than_by_chance(dense):
    kept = vg.remove_grains(dense, solid_fraction=0.3, seed=3)
    # a half that is taken at random differs by 0.87 / sqrt(n) on average, an even one by a few grains
    assert kept.provenance["removal"]["gradation_distance"] < 3 / kept.count
    assert kept.stop_reason == "solid_fraction"


def test_grains_are_removed_everywhere_and_the_others_stay(dense):
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        kept, other = (vg.remove_grains(dense, solid_fraction=0.3, seed=seed) for seed in (0, 1))
    where = np.flatnonzero((dense.position[:, None] == kept.position).all(axis=2).any(axis=1))
    assert np.array_equal(dense.position[where], kept.position)
    assert np.array_equal(dense.diameters[where], kept.diameters)
    for axis in range(3):
        assert kstest(kept.position[:, axis] / 8, "uniform").pvalue > 1e-3
    assert not np.array_equal(kept.position[: other.count], other.position[: kept.count])


def test_grains_that_cannot_carry_each_other_any_more_are_told():
    jammed = vg.pack(vg.make_shape("sphere"), BOX, method="jam", count=300)
    with pytest.warns(PackingWarning, match="contacts each on average, and had"):
        vg.remove_grains(jammed, solid_fraction=0.3)


def test_nothing_is_removed_where_nothing_has_to_be(dense):
    kept = vg.remove_grains(dense, solid_fraction=dense.solid_fraction)
    assert kept.count == dense.count


@pytest.mark.parametrize(("wanted", "words"), [(0.7, "grains are only removed here"), (-0.1, "solid_fraction")])
def test_what_cannot_be_is_refused(wanted, words, dense):
    with pytest.raises(InputError, match=words):
        vg.remove_grains(dense, solid_fraction=wanted)
