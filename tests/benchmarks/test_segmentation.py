"""The benchmark of segmentation, small."""

import numpy as np
import pytest

import voxgran as vg
from benchmarks.images import segmentation
from benchmarks.images.segmentation import grey_image, judged, measured, scores, snow
from voxgran._base.lazy import load
from voxgran.lattice.segment import Segmentation

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


def test_the_grains_of_a_packing_are_found_both_ways_and_where_the_border_cuts_them(bed, monkeypatch):
    ways = ("default", "two voxels", "watershed")
    monkeypatch.setattr(segmentation, "WAYS", ways)
    rows = measured(iter([("spheres", "jammed", bed)]), qualities=((1.0, 0.1),), across=20)
    images = [(slices, border, way) for slices in (1, 2) for border in ("whole", "cut") for way in ways]
    assert [(row.z_over_x, row.border, row.way) for row in rows] == images
    for row in rows:
        assert (row.suspects == "") == (row.way == "watershed")
        if row.way == "default":
            # some of the fragments are a few voxels thin
            assert abs(row.found - row.true) <= (0 if row.border == "whole" else 1)
            assert row.rand_error < 0.03
            assert row.border == "cut" or row.true == 22


def test_snow_is_left_out_where_it_is_not_installed(monkeypatch, tmp_path):
    solid = np.zeros((12, 12, 12), dtype=bool)
    solid[3:9, 3:9, 3:9] = True
    monkeypatch.setenv("VOXGRAN_PEERS", str(tmp_path / "python"))
    assert snow(solid, (1.0, 1.0, 1.0)) is None


def test_wrong_pairs_and_grains_are_told_from_right_suspects():
    labels = np.zeros((40, 6, 6), dtype=np.int32)
    # grain 1 is split in two, grains 2 and 3 are merged, grain 4 is right
    labels[0:5], labels[5:10], labels[10:20], labels[20:30] = 1, 2, 3, 4
    true = np.repeat([1, 2, 3, 4], [10, 6, 4, 20])[:, None, None] * (labels > 0)
    columns = {"grain": [1, 2, 3, 3], "other": [2, 3, 4, 3], "doubt": [0.9, 0.4, 0.1, 0.2]}
    necks = load("xarray").Dataset({name: ("neck", np.array(values)) for name, values in columns.items()})
    found = Segmentation(labels, necks=necks, grains=4)
    # labels 1 and 2 are rightly suspects, 2 and 3 are not, and label 3 is
    assert judged(true, found) == (3, 2, 2)
    assert found.suspects["grain"].values.tolist() == [1, 2, 3]
    few = Segmentation(labels, necks=necks.assign(doubt=("neck", [0.1, 0.8, 0.1, 0.1])), grains=4)
    assert judged(true, few) == (1, 2, 0)
    # label 3 is right where grain 3, of 144 voxels, does not count
    assert judged(true, found, 200) == (3, 1, 1)
