"""Pictures of many shapes in rows."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, OutputExistsError
from voxgran._base.lazy import load
from voxgran.report.gallery import SHADES, picture_shapes
from voxgran.report.stage import png_of


def inked(picture):
    """Return the mask of pixels that are not background."""
    return np.abs(picture.astype(int) - picture[0, 0]).sum(axis=2) > 40


def test_each_shape_has_its_place():
    shapes = [vg.make_shape("box"), vg.make_shape("sphere"), vg.make_shape("cone"), vg.make_shape("sphere")]
    picture = picture_shapes([*shapes, vg.make_shape("ellipsoid")], columns=3)
    high, wide = picture.shape[0] // 2, picture.shape[1] // 3
    parts = [inked(picture[r * high : (r + 1) * high, c * wide : (c + 1) * wide]) for r in (0, 1) for c in range(3)]
    shares = [float(part.mean()) for part in parts]
    assert all(share > 0.2 for share in shares[:5])
    assert shares[5] == 0
    # two spheres of one size look alike, and nothing is cut at the edges of its place
    assert shares[1] == pytest.approx(shares[3], rel=0.02)
    assert not any(part[:, 0].any() or part[:, -1].any() or part[0].any() or part[-1].any() for part in parts)


def test_a_shape_much_larger_than_the_others_does_not_make_them_small():
    spheres = [vg.make_shape("sphere")] * 19
    picture = inked(picture_shapes([*spheres, vg.make_shape("sphere", diameter=50.0)], columns=5))
    assert picture.mean() > 0.3


@pytest.mark.parametrize("family", ["disk", "sheet"])
def test_flat_and_open_shapes_are_drawn(family, tmp_path):
    vg.save_gallery([vg.make_shape(family)], tmp_path / "one.png")
    assert (tmp_path / "one.png").stat().st_size > 1000


def test_wrong_calls_are_explained(tmp_path):
    path = tmp_path / "gallery.png"
    with pytest.raises(InputError, match="shapes is empty: a gallery needs at least one"):
        vg.save_gallery([], path)
    with pytest.raises(InputError, match="columns is 0"):
        vg.save_gallery([vg.make_shape("box")], path, columns=0)
    with pytest.raises(InputError, match="a list of shapes; make_shapes makes one"):
        vg.save_gallery([3], path)
    with pytest.raises(FileFormatError, match="pictures are kept as"):
        vg.save_gallery([vg.make_shape("box")], tmp_path / "gallery.jpg")
    path.write_text("mine")
    with pytest.raises(OutputExistsError, match="gallery"):
        vg.save_gallery([vg.make_shape("box")], path)
    assert path.read_text() == "mine"


def test_a_file_has_a_palette_that_shows_the_same(tmp_path):
    shapes = vg.make_shapes("solid_union", count=4, seed=1)
    vg.save_gallery(shapes, tmp_path / "gallery.png", columns=2)
    with load("PIL.Image").open(tmp_path / "gallery.png") as image:
        assert image.mode == "P"
        shown = np.asarray(image.convert("RGB")).astype(int)
    drawn = picture_shapes(shapes, columns=2).astype(int)
    difference = np.abs(shown - drawn)
    assert 10 < len(np.unique(shown.reshape(-1, 3), axis=0)) <= SHADES
    assert difference.mean() < 0.5
    assert np.quantile(difference, 0.99) <= 4
    plain = len(png_of(picture_shapes(shapes, columns=2)))
    assert (tmp_path / "gallery.png").stat().st_size < 0.6 * plain
