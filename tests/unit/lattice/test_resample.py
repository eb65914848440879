"""Resampling against overlaps voxel by voxel; cropping; iso-surfaces."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.shapes.repairing.diagnose import diagnose


def overlap_mean(image, shape):
    """Return the mean over each new voxel, one after the other: the plain twin."""
    found = np.zeros(shape)
    old = image.shape
    for new in np.ndindex(*shape):
        total = 0.0
        for voxel in np.ndindex(*old):
            part = 1.0
            for a, b, n, m in zip(voxel, new, old, shape, strict=True):
                part *= max(0.0, min((a + 1) / n, (b + 1) / m) - max(a / n, b / m)) * m
            total += part * image[voxel]
        found[new] = total
    return found


@pytest.mark.parametrize("shape", [(4, 3, 5), (2, 6, 10), (1, 1, 1), (5, 7, 3), (8, 6, 10)])
def test_means_are_those_of_the_overlaps(shape):
    image = stream(1, "image").random((4, 3, 5))
    found = vg.resample(image, shape=shape)
    assert np.allclose(found, overlap_mean(image, shape), rtol=1e-12)
    assert found.mean() == pytest.approx(image.mean(), rel=1e-13)


def test_factors_and_nearest_labels():
    labels = stream(2, "labels").integers(0, 300, (6, 4, 8)).astype(np.uint16)
    fine = vg.resample(labels, factor=3, method="nearest")
    assert fine.dtype == np.uint16
    assert np.array_equal(fine, labels.repeat(3, 0).repeat(3, 1).repeat(3, 2))
    assert np.array_equal(vg.resample(fine, factor=1 / 3, method="nearest"), labels)
    mask = labels > 100
    assert np.array_equal(vg.resample(mask, factor=0.5), mask.reshape(3, 2, 2, 2, 4, 2).mean(axis=(1, 3, 5)))


def test_crop_keeps_what_is_there():
    image = np.zeros((9, 8, 7), dtype=int)
    image[2:4, 5, 3:6] = 7
    part, start = vg.crop(image)
    assert part.shape == (2, 1, 3)
    assert start.tolist() == [2, 5, 3]
    assert (part == 7).all()
    part, start = vg.crop(image, margin=3)
    assert part.shape == (7, 6, 7)
    assert start.tolist() == [0, 2, 0]
    assert vg.crop(image * 0)[0].size == 0


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"factor": 2, "shape": (1, 1, 1)},
        {"factor": -1},
        {"shape": (0, 1, 1)},
        {"shape": (1, 1)},
        {"factor": 2, "method": "cubic"},
    ],
)
def test_bad_input_is_refused(arguments):
    with pytest.raises(InputError):
        vg.resample(np.ones((2, 2, 2)), **arguments)


def test_images_without_three_axes_are_refused():
    for call in (lambda: vg.resample(np.ones((2, 2)), factor=2), lambda: vg.crop(np.ones(3))):
        with pytest.raises(InputError, match="axes"):
            call()
    with pytest.raises(InputError, match="margin"):
        vg.crop(np.ones((2, 2, 2)), margin=-1)


def volume(vertices, faces):
    return vg.Shape.from_mesh(vertices, faces).volume


@pytest.mark.parametrize("name", ["eros.obj", "bennu_lp.obj"])
def test_iso_surfaces_keep_the_volume(name, data_dir):
    scan = vg.load_shape(data_dir / name)
    voxels = vg.voxelize(scan, voxel_size=scan.diameter / 24, fraction=True)
    vertices, faces = vg.iso_surface(voxels.fraction)
    assert diagnose(vertices, faces).ok
    assert volume(vertices, faces) == pytest.approx(voxels.fraction.sum(), rel=1e-9)
    half = vg.iso_surface(voxels.fraction, volume=voxels.fraction.sum() / 2)
    assert volume(*half) == pytest.approx(voxels.fraction.sum() / 2, rel=1e-9)


def test_a_level_of_a_known_field():
    x = np.indices((24, 24, 24)) + 0.5 - 12.3
    field = 8.0 - np.sqrt((x**2).sum(axis=0))
    vertices, faces = vg.iso_surface(field, level=0.0)
    assert np.linalg.norm(vertices - 12.3, axis=1) == pytest.approx(8.0, abs=0.03)
    assert volume(vertices, faces) == pytest.approx(4 / 3 * np.pi * 512, rel=0.01)


def test_bodies_at_the_border_are_closed_there():
    mask = np.zeros((6, 6, 6))
    mask[:, :, :3] = 1.0
    vertices, faces = vg.iso_surface(mask, volume=108.0)
    assert volume(vertices, faces) == pytest.approx(108, rel=1e-9)


def test_levels_that_are_nowhere_are_refused():
    field = np.arange(27.0).reshape(3, 3, 3)
    for arguments, text in (
        ({"level": 26.0}, "at most"),
        ({"level": -1.0}, "at least"),
        ({"level": 1.0, "volume": 2.0}, "one of them"),
        ({"volume": -1.0}, "volume"),
        ({"volume": 27.0}, "27 voxels"),
    ):
        with pytest.raises(InputError, match=text):
            vg.iso_surface(field, **arguments)
    with pytest.raises(InputError, match="nan"):
        vg.iso_surface(field * np.nan)
    with pytest.raises(InputError, match="free"):
        vg.iso_surface(np.ones((2, 2, 2)), volume=3.0)
