"""Outlines from pictures: areas, places, labels, and what is refused."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingFileError


def disk_picture(shape, middle, radius):
    """Grey values that fall from 1 inside to 0 outside over two pixels: a distance, cut."""
    x, y = np.meshgrid(*(np.arange(n) + 0.5 for n in shape), indexing="ij")
    return np.clip(0.5 + (radius - np.hypot(x - middle[0], y - middle[1])) / 2, 0.0, 1.0)


@pytest.mark.parametrize("radius", [6.0, 20.0])
def test_a_grey_disk_has_its_area(radius):
    picture = disk_picture((60, 70), (28.3, 33.9), radius)
    (shape,) = vg.load_outlines(picture, pixel_size=0.5)
    assert shape.dimension == 2
    assert shape.volume == pytest.approx(np.pi * radius**2 / 4, rel=2 / radius**2)
    corners = np.linalg.norm(shape.vertices[:, :2], axis=1)
    assert np.abs(corners - radius / 2).max() < 0.05


def test_area_of_a_disk_comes_closer_with_the_pixels():
    errors = []
    for n in (1, 2, 4):
        (shape,) = vg.load_outlines(disk_picture((40 * n, 40 * n), (19.7 * n, 20.2 * n), 9.0 * n), pixel_size=1 / n)
        errors.append(abs(shape.volume - 81 * np.pi))
    assert errors[2] < errors[0] / 8


def test_squares_of_pixels_lose_only_their_corners():
    mask = np.zeros((30, 20), dtype=bool)
    mask[3:13, 4:14] = True
    mask[17:27, 4:16] = True
    mask[20:24, 8:12] = False  # a hole is filled
    shapes = vg.load_outlines(mask)
    assert [shape.name for shape in shapes] == ["outline 0", "outline 1"]
    # half a pixel of corners
    assert [shape.volume for shape in shapes] == pytest.approx([99.5, 119.5])
    assert len(shapes[0].vertices) == 8


def test_labels_that_touch_are_traced_one_by_one():
    labels = np.zeros((20, 12), dtype=np.int32)
    labels[2:10, 2:10], labels[10:18, 2:10] = 3, 7
    assert len(vg.load_outlines(labels)) == 2
    assert len(vg.load_outlines(labels > 0)) == 1


def test_particles_at_the_border():
    mask = np.zeros((20, 20), dtype=bool)
    mask[:6, 4:10] = True
    mask[10:16, 8:15] = True
    assert len(vg.load_outlines(mask)) == 1
    assert [s.volume for s in vg.load_outlines(mask, border="keep")] == pytest.approx([35.5, 41.5])


def test_pictures_are_read_with_y_upward(tmp_path):
    picture = np.zeros((40, 30))
    picture[5:20, 5:10] = 1.0
    picture[5:8, 5:25] = 1.0  # an L
    from matplotlib.image import imsave

    imsave(tmp_path / "l.png", np.repeat(picture.T[::-1, :, None], 3, axis=2))
    np.save(tmp_path / "l.npy", picture)
    (one,), (other,) = (vg.load_outlines(tmp_path / name) for name in ("l.png", "l.npy"))
    assert one.volume == pytest.approx(other.volume)
    assert np.allclose(np.sort(one.vertices, axis=0), np.sort(other.vertices, axis=0))


@pytest.mark.slow
def test_outlines_pack_without_overlap():
    shapes = vg.load_outlines(
        np.concatenate([disk_picture((30, 30), (15, 15), 9), disk_picture((30, 30), (15, 15), 6)])
    )
    mean = np.mean([shape.diameter for shape in shapes])
    packing = vg.pack(
        [shape.scaled(1 / mean) for shape in shapes], vg.Rectangle((6, 8)), method="digital", count=20,
        voxel_size=1 / 16, sweeps=300, cycles=2,
    )  # fmt: skip
    assert packing.count == 20
    assert vg.verify(packing).ok


@pytest.mark.parametrize(
    ("values", "options", "words"),
    [
        (np.zeros((8, 8)), {}, "no closed particle"),
        (np.ones((4, 4, 4)), {}, "two axes"),
        (np.full((8, 8), np.nan), {}, "not finite"),
        (np.eye(8), {"border": "cut"}, "border is 'cut'"),
        (np.eye(8), {"pixel_size": 0.0}, "pixel_size"),
        (np.eye(8), {"min_area": -1.0}, "min_area"),
        (np.ones((9, 1)), {}, "2 pixels"),
    ],
)
def test_bad_images_are_refused(values, options, words):
    with pytest.raises(InputError, match=words):
        vg.load_outlines(values, **options)


def test_files_that_are_not_there_or_damaged(tmp_path):
    with pytest.raises(MissingFileError):
        vg.load_outlines(tmp_path / "no.png")
    (tmp_path / "bad.png").write_bytes(b"no picture")
    with pytest.raises(FileFormatError):
        vg.load_outlines(tmp_path / "bad.png")
