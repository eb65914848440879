"""Images in many small odd blocks give what they give in memory, to the bit."""

import itertools

import numpy as np
import pytest
from kit import slow
from scipy.ndimage import gaussian_filter, laplace, median_filter, uniform_filter
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.lattice import surface
from voxgran.lattice.census import census
from voxgran.lattice.image import Image, as_edges

da = pytest.importorskip("dask.array")
pytest.importorskip("zarr")

SHAPE, BLOCKS = (23, 15, 20), (9, 15, 11)
UNEQUAL = (1.0, 1.3, 0.7)
GREY = gaussian_filter(stream(1, "blocks").random(SHAPE), 1.5)
MASK = np.quantile(GREY, 0.6) > GREY
PERIODS = [False, "yz", "xyz"]


def blocks(values):
    return da.from_array(values, chunks=BLOCKS)


def same(found, expected):
    assert isinstance(found, da.Array)
    assert found.dtype == expected.dtype
    assert np.array_equal(found.compute(), expected)


@pytest.mark.parametrize(
    ("function", "options"),
    [
        (gaussian_filter, {"sigma": (1.5, 0.4, 1.0)}),
        (gaussian_filter, {"sigma": 1.0, "truncate": 3.0, "mode": ("wrap", "nearest", "reflect")}),
        (median_filter, {"size": 3}),
        (median_filter, {"size": (2, 5, 4), "mode": "wrap"}),
        (uniform_filter, {"size": 5}),
        (median_filter, {"footprint": np.ones((3, 1, 3)), "depth": (1, 0, 1)}),
        (median_filter, {"footprint": np.ones((3, 1, 7)), "origin": (1, 0, -2)}),
        (median_filter, {"size": 4, "origin": -2, "mode": "grid-wrap"}),
        (gaussian_filter, {"sigma": 1.0, "radius": 9}),
        (gaussian_filter, {"sigma": (0.5, 2.0), "mode": ("grid-wrap", "nearest"), "axes": (2, 0)}),
    ],
)
def test_filters_are_those_of_scipy(function, options):
    # running means of whole numbers have no round-off
    grey = (GREY * 255).astype(np.uint8) if function is uniform_filter else GREY
    found = vg.filter_image(Image(blocks(grey), as_edges(0.5), unit="mm"), function, **options)
    assert (found.voxel_size, found.unit) == ((0.5, 0.5, 0.5), "mm")
    options.pop("depth", None)
    same(found.values, function(grey, **options))
    assert np.array_equal(vg.filter_image(grey, function, **options).values, function(grey, **options))


def test_a_filter_whose_reach_is_unknown_is_refused():
    for function, image, options, words in (
        (laplace, blocks(GREY), {}, "depth is missing"),
        (median_filter, blocks(GREY), {"size": 3, "depth": -1}, "depth is -1"),
        (median_filter, GREY[0], {"size": 3}, "three axes"),
        ("median", GREY, {}, "function is 'median'"),
        (np.ravel, GREY, {}, r"returns \(6900,\) of \(23, 15, 20\) values"),
    ):
        with pytest.raises(InputError, match=words):
            vg.filter_image(image, function, **options)


@pytest.mark.parametrize("connectivity", [6, 18, 26])
@pytest.mark.parametrize("periodic", PERIODS)
def test_bodies_are_joined_across_blocks(connectivity, periodic):
    mask = stream(2, "mask").random(SHAPE) < 2.0 / connectivity
    expected, count = vg.connected_components(mask, connectivity=connectivity, periodic=periodic)
    found, many = vg.connected_components(blocks(mask), connectivity=connectivity, periodic=periodic)
    assert many == count
    same(found, expected)


def test_blocks_may_have_several_sizes():
    sparse = stream(3, "mask").random(SHAPE) < 0.2
    lazy = da.from_array(sparse, chunks=((3, 11, 1, 8), (14, 1), (7, 2, 11)))
    expected, count = vg.connected_components(sparse)
    found, many = vg.connected_components(lazy)
    assert many == count > 100
    same(found, expected)
    same(vg.distance_transform(~lazy), vg.distance_transform(~sparse))


def test_an_image_without_bodies_has_none_in_blocks():
    found, count = vg.connected_components(blocks(np.zeros(SHAPE, dtype=int)))
    assert count == 0
    assert not found.any()


def test_temporary_folders_are_removed_with_their_arrays(tmp_path):
    with pytest.importorskip("dask").config.set(temporary_directory=str(tmp_path)):
        found = vg.connected_components(blocks(MASK))[0][3:]
    assert found.any()
    assert len(list(tmp_path.iterdir())) == 1
    del found
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("periodic", "edges"),
    [case if case == ("xyz", UNEQUAL) else slow(*case) for case in itertools.product(PERIODS, (None, 0.3, UNEQUAL))],
)
def test_distances_are_those_of_the_whole_image(edges, periodic):
    far = np.ones(SHAPE, dtype=bool)
    far[3, 4, 5] = far[20, 12, 2] = False
    for mask in (MASK, far, ~far):
        found = vg.distance_transform(blocks(mask), voxel_size=edges, periodic=periodic)
        same(found, vg.distance_transform(mask, voxel_size=edges, periodic=periodic))


@pytest.mark.slow
def test_distances_are_longer_than_the_first_surroundings():
    mask = np.ones((56, 3, 4), dtype=bool)
    mask[2, 1, 0] = False
    for edges in (None, (0.5, 1.0, 1.0)):
        found = vg.distance_transform(da.from_array(mask, chunks=8), voxel_size=edges)
        same(found, vg.distance_transform(mask, voxel_size=edges))


def test_squared_distances_and_masks_without_a_free_voxel():
    full = np.ones(SHAPE, dtype=bool)
    same(vg.distance_transform(blocks(MASK), squared=True), vg.distance_transform(MASK, squared=True))
    same(vg.distance_transform(blocks(full), squared=True), vg.distance_transform(full, squared=True))
    same(vg.distance_transform(blocks(full)), vg.distance_transform(full))


@pytest.mark.parametrize("operation", [vg.dilation, vg.erosion, vg.opening, vg.closing])
@pytest.mark.parametrize(("radius", "edges"), [(4.0, 1.0), (2.5, UNEQUAL)])
def test_morphology_is_that_of_the_whole_image(operation, radius, edges):
    found = operation(Image(blocks(MASK), as_edges(edges)), radius, periodic="xz")
    same(found, operation(MASK, radius, voxel_size=edges, periodic="xz"))


@pytest.mark.parametrize(
    ("edges", "periodic"), [(0.3, "y"), slow((0.3, 0.3, 0.6), False), slow(0.3, False), slow((0.3, 0.3, 0.6), "y")]
)
def test_thickness_is_that_of_the_whole_image(edges, periodic):
    wide = np.indices(SHAPE)[0] % 15 > 2
    for mask in (MASK, wide):
        found = vg.local_thickness(blocks(mask), voxel_size=edges, periodic=periodic)
        same(found, vg.local_thickness(mask, voxel_size=edges, periodic=periodic))


def test_labels_are_counted_block_by_block():
    labels = vg.connected_components(MASK)[0].astype(np.uint16) * 3
    one, other = census(labels), census(blocks(labels))
    for name in ("label", "count", "lower", "upper", "middle", "at_border"):
        assert np.array_equal(getattr(one, name), getattr(other, name))
    table = vg.label_table(Image(blocks(labels), UNEQUAL))
    assert table.identical(vg.label_table(labels, voxel_size=UNEQUAL))


def test_nearest_values_stay_in_blocks():
    labels = vg.connected_components(MASK)[0]
    found = vg.resample(Image(blocks(labels), UNEQUAL), to="cubic", method="nearest")
    same(found.values, vg.resample(labels, to="cubic", voxel_size=UNEQUAL, method="nearest"))


def test_what_is_no_mask_is_refused():
    with pytest.raises(InputError, match="float64"):
        vg.connected_components(blocks(GREY))
    with pytest.raises(InputError, match="three axes"):
        vg.distance_transform(blocks(MASK)[0])
    with pytest.raises(InputError, match="compare labels with 0 first"):
        vg.distance_transform(blocks(MASK * 2)).compute()
    with pytest.raises(InputError, match="out is given"):
        vg.distance_transform(blocks(MASK), out=np.empty(SHAPE))
    with pytest.raises(InputError, match="no free voxel"):
        vg.local_thickness(blocks(np.ones(SHAPE, dtype=bool)))
    with pytest.raises(InputError, match="grey values"):
        vg.label_table(blocks(GREY), voxel_size=1.0)


def test_the_part_with_voxels_stays_in_blocks():
    image = np.zeros((9, 12, 7), dtype=np.uint16)
    image[2:5, 4:11, 3] = 3
    for values, margin in ((image, 0), (image, 2), (np.zeros_like(image), 1)):
        whole, start = vg.crop(values, margin=margin)
        part, first = vg.crop(da.from_array(values, chunks=4), margin=margin)
        assert isinstance(part, da.Array)
        assert start.tolist() == first.tolist()
        assert np.array_equal(np.asarray(part), whole)


@pytest.mark.parametrize(
    "how", [{"factor": (0.4, 1.7, 1)}, {"shape": (7, 15, 31)}, {"to": "cubic", "voxel_size": UNEQUAL}]
)
def test_means_of_blocks_are_those_in_memory(how):
    same(vg.resample(blocks(GREY), **how), vg.resample(GREY, **how))
    same(vg.resample(blocks(MASK), **how), vg.resample(MASK, **how))


@pytest.mark.parametrize("part", [BLOCKS, slow((22, 3, 1)), (23, 15, 20)])
def test_level_surfaces_are_joined_across_blocks(part, monkeypatch):
    monkeypatch.setattr(surface, "LEAST_BLOCK", 1)
    level = float(np.quantile(GREY, 0.6))
    vertices, faces = vg.iso_surface(GREY, level=level)
    found, triangles = vg.iso_surface(da.from_array(GREY, chunks=part), level=level)
    assert (len(found), len(triangles)) == (len(vertices), len(faces))
    # vertices in memory have single precision
    apart, nearest = cKDTree(vertices).query(found)
    assert apart.max() < 1e-5
    assert len(np.unique(nearest)) == len(vertices)
    least = [np.roll(face, -face.argmin()).tolist() for face in (*faces, *nearest[triangles])]
    assert sorted(least[: len(faces)]) == sorted(least[len(faces) :])
    # each edge has two triangles, in opposite directions
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    assert len(np.unique(ends, axis=0)) == len(ends)
    assert set(map(tuple, ends)) == set(map(tuple, ends[:, ::-1]))


def test_level_surfaces_of_blocks_have_the_volume_that_is_asked_for():
    vertices, faces = vg.iso_surface(blocks(MASK))
    body = vg.Shape.from_mesh(vertices, faces)
    assert body.volume == pytest.approx(MASK.sum(), rel=1e-9)
    assert len(faces) == pytest.approx(len(vg.iso_surface(MASK)[1]), rel=0.01)
    at_level = blocks(np.where(MASK, 1.0, 0.0))
    assert len(vg.iso_surface(at_level, level=0.5)[1]) == len(vg.iso_surface(MASK.astype(float), level=0.5)[1])
    bad = np.zeros((8, 8, 8))
    bad[5, 1, 7] = bad[6, 0, 0] = np.nan
    with pytest.raises(InputError, match=r"nan at voxel \(5, 1, 7\)"):
        vg.iso_surface(da.from_array(bad, chunks=(8, 4, 4)))
    with pytest.raises(InputError, match="three axes"):
        vg.iso_surface(da.zeros((8, 8), chunks=4))
    with pytest.raises(InputError, match="the field is at most"):
        vg.iso_surface(blocks(GREY), level=2.0)


def test_blocks_of_unknown_sizes_are_refused():
    values = da.arange(64, chunks=8)
    some = values[values > 3][:, None, None]
    for take in (vg.open_image, vg.segment, vg.connected_components):
        with pytest.raises(InputError, match="compute_chunk_sizes"):
            take(some)


def test_what_is_no_label_is_named_with_its_voxel():
    labels = np.zeros((8, 6, 6))
    labels[5, 2, 4] = 0.5
    for image in (labels, da.from_array(labels, chunks=(4, 6, 3))):
        with pytest.raises(InputError, match=r"the image is 0.5 at voxel \(5, 2, 4\): labels are whole numbers"):
            vg.packing_of_labels(image, voxel_size=1.0)
