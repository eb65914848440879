"""Grey images in many small odd blocks are segmented as in memory, to the bit."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.shapes.images.image_files import Image

da = pytest.importorskip("dask.array")
pytest.importorskip("skimage")
pytest.importorskip("zarr")

EDGES = (0.06, 0.06, 0.09)


def grey_image(edges, kind):
    """Return grey values of 8 touching stones with noise."""
    stones = vg.make_shapes("polyhedron", count=4, seed=1, rounding=0.2)
    place = np.array(list(np.ndindex(2, 2, 2))) * 0.92 + 0.6 + stream(1, "places").uniform(-0.05, 0.05, (8, 3))
    bed = vg.Packing.of(stones, vg.Box((2.1, 2.1, 2.2)), position=place, shape_id=np.arange(8) % 4)
    solid = vg.to_image(bed, edges, labels=False)
    noise = stream(2, "noise").normal(0, 12, solid.shape)
    return (60 + 120 * gaussian_filter(solid.astype(float), 0.8) + noise).astype(kind)


@pytest.mark.parametrize(
    ("edges", "kind", "options"),
    [
        (EDGES, np.uint8, {}),
        pytest.param(EDGES, np.float32, {"separation": 0.08}, marks=pytest.mark.slow),
        pytest.param((0.06,) * 3, np.int16, {"threshold": 120, "min_size": 300}, marks=pytest.mark.slow),
    ],
)
def test_labels_and_necks_are_those_in_memory(edges, kind, options):
    grey = grey_image(edges, kind)
    # blocks of several sizes
    lazy = da.from_array(grey, chunks=((13, 19, grey.shape[0] - 32), 19, grey.shape[2]))
    whole, parts = vg.segment(grey, voxel_size=edges, **options), vg.segment(Image(lazy, edges, unit="mm"), **options)
    assert isinstance(parts.values, da.Array)
    assert (parts.voxel_size, parts.unit, parts.grains) == (edges, "mm", whole.grains)
    assert parts.threshold == whole.threshold
    assert np.array_equal(np.asarray(parts), whole.values)
    assert parts.necks.identical(whole.necks)
    assert str(parts) == str(whole)


@pytest.mark.slow
def test_grains_longer_than_the_surroundings_of_a_block_are_whole():
    x, y, z = np.indices((124, 32, 32))
    # a cone, whose distance rises from one end to the other
    grey = ((y - 15.5) ** 2 + (z - 15.5) ** 2 < (2 + 0.1 * x) ** 2) & (x > 1) & (x < 120)
    lazy = da.from_array(grey * 200, chunks=(11, 32, 32))
    whole, parts = vg.segment(grey * 200, threshold=100), vg.segment(lazy, threshold=100)
    assert whole.grains == 1
    assert np.array_equal(np.asarray(parts), whole.values)


def test_maxima_that_meet_diagonally_are_one():
    x, y, _ = np.indices((30, 30, 7))
    # a plate along a diagonal, whose middle has voxels that share edges and no faces
    grey = 200 * ((np.abs(x - y) < 4) & (np.abs(x + y - 29) < 20))
    whole, parts = vg.segment(grey, threshold=100), vg.segment(da.from_array(grey, chunks=15), threshold=100)
    assert whole.grains == parts.grains == 1
    assert parts.necks.identical(whole.necks)


@pytest.mark.slow
def test_an_image_without_void_is_one_grain_as_in_memory():
    grey = np.full((9, 9, 9), 200)
    assert (np.asarray(vg.segment(da.from_array(grey, chunks=4), threshold=100)) == 1).all()


@pytest.mark.slow
@pytest.mark.usefixtures("jagged_pictures")
def test_the_picture_is_that_in_memory(tmp_path):
    grey = grey_image((0.15, 0.15, 0.2), np.uint8)
    lazy = da.from_array(grey, chunks=(9, *grey.shape[1:]))
    vg.save_slices(vg.segment(grey, min_size=8), tmp_path / "a.png", image=grey)
    vg.save_slices(vg.segment(lazy, min_size=8), tmp_path / "b.png", image=lazy)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_grey_values_that_are_not_finite_are_refused():
    grey = np.zeros((8, 8, 8))
    grey[5, 0, 1] = grey[2, 7, 7] = np.inf
    for image in (grey, da.from_array(grey, chunks=4)):
        with pytest.raises(InputError, match=r"image is inf at voxel \(2, 7, 7\)"):
            vg.segment(image)
