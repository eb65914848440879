"""The trade-off of segmentation, small."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.bench.tradeoffs.segmentation import WAYS, grey_image, measured, scores

pytest.importorskip("skimage")


@pytest.fixture(scope="module")
def bed():
    return vg.pack(vg.make_shape("sphere"), vg.Box((3, 3, 3)), "jam", count=22, seed=1)


def test_scores_tell_splitting_from_merging():
    true = np.array([1, 1, 1, 1, 2, 2, 2, 2, 0, 3])
    assert scores(true, true) == pytest.approx((0.0, 0.0, 0.0))
    # a voxel that is void in one of them does not count
    error, splitting, merging = scores(true, np.array([1, 1, 4, 4, 2, 2, 2, 2, 9, 0]))
    assert error > 0.1
    assert (splitting, merging) == pytest.approx((0.5, 0.0))
    _, splitting, merging = scores(true, np.array([1, 1, 1, 1, 1, 1, 1, 1, 9, 0]))
    assert (splitting, merging) == pytest.approx((0.0, 1.0))


def test_grey_images_have_the_contrast_and_noise_asked_for():
    solid = np.zeros((20, 20, 20), dtype=bool)
    solid[:10] = True
    grey = grey_image(solid, blur=1.0, noise=0.1, slices=2)
    assert grey.shape == (20, 20, 10)
    assert grey[:6].mean() == pytest.approx(1.0, abs=0.01)
    assert grey[14:].std() == pytest.approx(0.1, abs=0.01)


def test_the_grains_of_a_packing_are_found_both_ways(bed):
    rows = measured(iter([("spheres", "jammed", bed)]), qualities=((1.0, 0.1),), across=20)
    assert [row[5:7] for row in rows] == [(slices, way) for slices in (1, 2) for way in WAYS]
    for row in rows:
        if row[6] == "default":
            assert row[8] == row[7] == 22
            assert row[9] < 0.03
