"""From grey values to labels: touching spheres are parted, noise is left out."""

import sys

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, MissingLibraryError
from voxgran._base.seeds import stream
from voxgran.lattice.necks import doubt, relative_sizes

pytest.importorskip("skimage")

MIDDLES = np.array([(12.0, 16, 16), (25.5, 16, 16), (18, 28, 16), (40, 40, 24)])
RADII = np.array([7.0, 7.0, 7.0, 6.0])


@pytest.fixture(scope="module")
def grey():
    grid = np.moveaxis(np.indices((50, 50, 36)), 0, -1) + 0.5
    solid = np.zeros(grid.shape[:3], bool)
    for middle, radius in zip(MIDDLES, RADII, strict=True):
        solid |= np.linalg.norm(grid - middle, axis=-1) <= radius
    generator = stream(1, "grey")
    image = 60 + 120 * solid + generator.normal(0, 8, solid.shape)
    image[3:5, 45:47, 3:5] = 200
    return image, solid


@pytest.mark.parametrize("options", [{}, {"threshold": 120.0}])
def test_touching_spheres_are_parted_and_specks_left_out(grey, options):
    image, solid = grey
    labels = vg.segment(image, **options)
    assert labels.max() == 4
    assert sorted(np.unique(labels)) == [0, 1, 2, 3, 4]
    assert ((labels > 0) == solid).mean() > 0.999
    for middle, radius in zip(MIDDLES, RADII, strict=True):
        here = labels[tuple(middle.astype(int))]
        assert (labels == here).sum() == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.05)
    assert vg.packing_of_labels(labels, voxel_size=0.1).count == 4


def test_dark_grains_and_little_splitting(grey):
    image, _ = grey
    np.testing.assert_array_equal(vg.segment(255 - image, dark_grains=True) > 0, vg.segment(image) > 0)
    assert vg.segment(image, separation=20.0).max() == 2


def test_an_image_without_grains_has_no_labels():
    assert vg.segment(np.full((6, 6, 6), 5.0)).max() == 0


@pytest.mark.parametrize(
    ("image", "options", "words"),
    [
        (np.zeros((4, 4)), {}, "three axes"),
        (np.full((4, 4, 4), np.nan), {}, r"image is nan at voxel \(0, 0, 0\)"),
        (np.zeros((4, 4, 4)), {"threshold": "mean"}, "threshold is 'mean'"),
        (np.zeros((4, 4, 4)), {"min_size": 0}, "min_size is 0"),
        (np.zeros((4, 4, 4)), {"separation": 0.0}, "separation is 0"),
    ],
)
def test_bad_input_is_refused(image, options, words):
    with pytest.raises(InputError, match=words):
        vg.segment(image, **options)


def test_without_scikit_image_the_remedy_is_named(monkeypatch):
    for name in ("skimage", *(name for name in sys.modules if name.startswith("skimage."))):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingLibraryError, match=r"scikit-image is not installed: .*voxgran\[images\]"):
        vg.segment(np.zeros((4, 4, 4)))


@pytest.mark.parametrize("cut", [0, 1])
def test_a_thin_cap_at_the_border_is_a_grain_of_its_own(cut):
    x, y, z = np.indices((60, 44, 20))
    # a sphere that is cut in its middle, and what the border leaves of one that touches it: 4 voxels
    powers = [(x - 20) ** 2 + (y - 21.5) ** 2 + z**2 - 144.0, (x - 37) ** 2 + (y - 21.5) ** 2 + (z + 6) ** 2 - 100.0]
    grey = np.moveaxis(200 * (np.minimum(*powers) < 0), 2, cut)
    found = vg.segment(grey, threshold=100)
    assert found.grains == 2
    assert vg.segment(np.flip(grey, cut), threshold=100).grains == 2
    true = np.where(np.minimum(*powers) < 0, 1 + np.argmin(powers, axis=0), 0)
    assert np.mean(np.moveaxis(true, 2, cut) != found.values) < 0.005


@pytest.mark.parametrize("cut", [0, 2])
def test_a_cap_with_a_neck_as_wide_as_it_is_deep_is_a_grain_of_its_own(cut):
    x, y, z = np.indices((30, 40, 40)) + 0.5
    # what the border leaves of a sphere, 4 voxels, and one that it touches, with a neck of 5 voxels
    inside = [(x + 8) ** 2 + (y - 20) ** 2 + (z - 20) ** 2 < 144, (x - 14) ** 2 + (y - 20) ** 2 + (z - 20) ** 2 < 144]
    grey = np.moveaxis(200.0 * np.any(inside, axis=0), 0, cut)
    found = vg.segment(grey, threshold=100)
    assert found.grains == 2
    # within the volume the neck is 0.95 of the cap, within the border 0.67
    assert float(found.necks["ratio"][0]) == pytest.approx(0.81, abs=0.03)
    assert found.suspects["grain"].values.tolist() == [1]


def test_an_image_without_void_is_one_grain():
    assert vg.segment(np.full((9, 9, 9), 200), threshold=100).grains == 1


def test_doubt_grows_with_what_is_wrong_and_few_grains_say_nothing_of_sizes():
    size = relative_sizes(np.array([1.0, 2.0, 1e6]), np.full(1000, 2.0))
    assert size.tolist() == pytest.approx([-np.log(2) / 0.6 / 1.01, 0.0, 3.0 / 1.01])
    assert relative_sizes(np.array([1.0, 4.0]), np.array([2.0])).tolist() == pytest.approx(
        [-np.log(2) / 0.6 / 11, np.log(2) / 0.6 / 11]
    )
    # the spread is that of the logarithms
    volumes = np.exp(stream(1, "volumes").normal(1.0, 2.0, 20000))
    assert relative_sizes(np.exp([1.0, 3.0]), volumes).tolist() == pytest.approx([0.0, 1.0], abs=0.03)
    ratio, excess, size = np.array([0.5, 0.9, 0.9, 0.9]), np.array([0.0, 0.0, 1.0, 0.0]), np.array([0.0, 0, 0, 2.0])
    parted, joined = (doubt(ratio, excess, size, within) for within in (False, True))
    # parts of one grain have a wide neck, are not bent, and are no larger together than others; merged ones reversely
    assert np.argmax(parted) == 1
    assert np.argmin(joined) == 1
    np.testing.assert_allclose(parted[0], 1 / (1 + np.exp(10.1 - 12.7 * 0.5)))
    assert (
        doubt(ratio, excess, size, np.array([True, False, True, False]))
        == [joined[0], *parted[1:2], joined[2], parted[3]]
    ).all()


def test_the_suspects_of_known_halves_come_first():
    # a row of spheres, of which one was cut in two by a narrow notch
    x, y, z = np.indices((120, 24, 24)) + 0.5
    grey = np.zeros(x.shape)
    for k in range(6):
        grey[(x - 12 - 19 * k) ** 2 + (y - 12) ** 2 + (z - 12) ** 2 < 100] = 1.0
    grey[(np.abs(x - 12) < 1) & (np.hypot(y - 12, z - 12) > 6.0)] = 0.0
    found = vg.segment(grey, threshold=0.5, separation=0.3)
    assert found.grains == 7
    assert found.suspects.sizes["neck"] == 1
    first = found.suspects.isel(neck=0)
    assert sorted({found.values[8, 12, 12], found.values[16, 12, 12]}) == [int(first.grain), int(first.other)]
    assert float(first.doubt) > 0.5
    assert (found.necks.doubt.values > 0.05).sum() == 1
