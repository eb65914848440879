"""Pictures of slices of a segmentation: outlines in the colours of their kinds, and what cannot be drawn."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, OutputExistsError
from voxgran.report.slices import GRAIN, ONE, SEVERAL, _slices, outlined

pytest.importorskip("skimage")


def test_outlines_lie_on_the_outermost_voxels_in_the_colour_of_the_grain():
    labels = np.zeros((7, 5), dtype=np.int64)
    labels[1:4, 1:4], labels[4:6, 1:4] = 1, 2
    picture = outlined(np.zeros((7, 5)), labels, np.array([0, 1, 3]))
    first = (np.abs(picture - to_rgb(GRAIN)).max(axis=2) == 0) & (labels == 1)
    assert first.sum() == 8
    assert not first[2, 2]
    assert (np.abs(picture - to_rgb(SEVERAL)).max(axis=2) == 0).sum() == 6
    assert np.allclose(picture[labels == 0], 0.15)


def test_slices_are_where_suspects_are():
    suspect = np.zeros(60, dtype=int)
    suspect[3], suspect[5], suspect[19] = 4, 1, 1
    assert _slices(suspect) == [3, 19, 25, 35, 45, 55]
    assert len(_slices(suspect[:2])) == 6


def test_suspects_are_in_the_picture(tmp_path):
    x, y, z = np.indices((44, 26, 26))
    solid = np.minimum((x - 13) ** 2, (x - 27) ** 2) + (y - 13) ** 2 + (z - 13) ** 2 < 11.7**2
    found = vg.segment(solid * 1.0, threshold=0.5)
    assert found.suspects.sizes["neck"] == 1
    path = tmp_path / "slices.png"
    vg.save_slices(found, path, image=solid * 1.0)

    def share(color):
        with Image.open(path) as picture:
            pixels = np.asarray(picture)[..., :3] / 255
        return (np.abs(pixels - to_rgb(color)).max(axis=2) < 0.01).mean()

    assert share(ONE) > 0.01
    # the legend alone
    assert share(GRAIN) < 0.002
    with pytest.raises(OutputExistsError):
        vg.save_slices(found, path)
    with pytest.raises(FileFormatError):
        vg.save_slices(found, tmp_path / "slices.svg")
    with pytest.raises(InputError, match=r"image has shape \(2, 2, 2\)"):
        vg.save_slices(found, tmp_path / "b.png", image=np.zeros((2, 2, 2)))
    with pytest.raises(InputError, match="segmentation is"):
        vg.save_slices(found.labels, tmp_path / "b.png")
