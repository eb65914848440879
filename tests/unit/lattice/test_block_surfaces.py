"""Surfaces of labels made group by group, and what else a packing and an image in blocks have to do with each other."""

import warnings

import numpy as np
import pytest
from kit import slow
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, TooLargeError
from voxgran._base.seeds import stream
from voxgran.lattice import block_surfaces
from voxgran.lattice import image as lattice_image
from voxgran.lattice.label_seams import Seams
from voxgran.lattice.label_surfaces import label_surfaces
from voxgran.shapes.images.image_files import Image

da = pytest.importorskip("dask.array")
pytest.importorskip("zarr")

EDGES = (0.05, 0.05, 0.07)


@pytest.fixture(scope="module")
def bed():
    stones = vg.make_shapes("polyhedron", count=4, seed=1, rounding=0.2)
    place = np.array(list(np.ndindex(3, 3, 3))) + 0.5 + stream(1, "places").uniform(-0.1, 0.1, (27, 3))
    return vg.Packing.of(stones, vg.Box((3, 3, 3.15)), position=place, shape_id=np.arange(27) % 4)


@pytest.fixture(scope="module")
def labels(bed):
    """Grains that touch, one of them in two pieces."""
    image = vg.to_image(bed, EDGES)
    # grown into each other, so that they share faces
    image[1:][image[1:] == 0] = image[:-1][image[1:] == 0]
    image[5:8, 50:53, 40:43] = 2
    return image


def in_groups(labels, monkeypatch, **options):
    monkeypatch.setattr(block_surfaces, "LEAST", 25)
    monkeypatch.setattr(block_surfaces, "BUDGET", 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PackingWarning)
        lazy = Image(da.from_array(labels, chunks=(17, 19, 23)), EDGES)
        return [vg.packing_of_labels(image, voxel_size=EDGES, gravity="none", **options) for image in (labels, lazy)]


def corners(packing):
    return [shape.vertices + place for shape, place in zip(packing.shapes, packing.position, strict=True)]


def test_faces_of_voxels_are_those_of_the_whole_image(labels, monkeypatch):
    whole, grouped = in_groups(labels, monkeypatch, surface="voxel")
    assert whole.provenance["labels"] == grouped.provenance["labels"]
    for one, other in zip(whole.shapes, grouped.shapes, strict=True):
        assert np.array_equal(one.faces, other.faces)
        assert np.array_equal(one.vertices, other.vertices)


@pytest.mark.slow
def test_smooth_surfaces_have_the_same_triangles_and_volumes_and_share_them(labels, monkeypatch):
    whole, grouped = in_groups(labels, monkeypatch)
    assert grouped.provenance["labels"] == whole.provenance["labels"]
    for one, other in zip(whole.shapes, grouped.shapes, strict=True):
        # quadrangles whose diagonals are about equal may be cut along the other one
        assert (one.faces != other.faces).any(axis=1).mean() < 0.05
        assert other.volume == pytest.approx(one.volume, rel=2e-6)
        assert other.surface_area == pytest.approx(one.surface_area, rel=3e-3)
    moved = np.abs((np.concatenate(corners(grouped)) - np.concatenate(corners(whole))) / EDGES).max(axis=1)
    # those of crossings that are repaired in one of both
    assert np.quantile(moved, 0.99) < 0.005
    assert moved.max() < 1
    # neighbours in different groups have common points
    proof = vg.verify(grouped)
    assert proof.ok
    assert proof.deepest == vg.verify(whole).deepest == 0.0
    area, expected = (float(vg.measure(p, which=["contacts"])["contacts"].area.sum()) for p in (grouped, whole))
    assert area == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("periodic", "surface"), [("x", "smooth"), ("yz", "voxel"), slow("xyz", "smooth")])
def test_grains_go_on_across_periodic_faces_in_groups_too(labels, monkeypatch, periodic, surface):
    image = np.roll(labels, (11, 7, 5), (0, 1, 2))
    # one that fills an axis
    image[:, 20:24, 30:34], image[20:24, :, 30:34], image[30:34, 20:24] = 99, 100, 101
    # narrow windows, so that some do not take whole axes
    monkeypatch.setattr(block_surfaces, "MARGIN", 5)
    whole, grouped = in_groups(image, monkeypatch, surface=surface, periodic=periodic)
    assert grouped.provenance["labels"] == whole.provenance["labels"]
    far = []
    for one, other, here, there in zip(whole.shapes, grouped.shapes, whole.position, grouped.position, strict=True):
        assert len(one.faces) == len(other.faces)
        assert other.volume == pytest.approx(one.volume, rel=2e-6)
        # one of several pieces may lie a period further on
        period = np.round((here - there) / whole.container.lengths) * whole.container.lengths
        assert one.name == "label 2" or not period.any()
        away, _ = cKDTree(one.vertices + here).query(other.vertices + there + period)
        far.append(away / min(EDGES))
    far = np.concatenate(far)
    # bars that cut grains make many crossings that are repaired
    assert np.quantile(far, 0.95) < (0.02 if surface == "smooth" else 1e-9)
    assert far.max() < (1 if surface == "smooth" else 1e-9)
    proof = vg.verify(grouped)
    assert proof.ok
    assert proof.deepest == 0.0


def test_a_label_that_a_window_cuts_in_two_is_whole(monkeypatch):
    image = np.zeros((64, 24, 8), dtype=np.int32)
    # two legs, with a grain between them
    image[:, 2:8], image[:, 16:22], image[54:, 8:16], image[5:12, 8:16] = 1, 1, 1, 2
    whole, grouped = in_groups(image, monkeypatch)
    assert np.abs(np.concatenate(corners(grouped)) - np.concatenate(corners(whole))).max() < 0.03 * 0.05


def test_pieces_are_left_out_and_grains_at_the_border_too(labels, monkeypatch):
    monkeypatch.setattr(block_surfaces, "LEAST", 25)
    monkeypatch.setattr(block_surfaces, "BUDGET", 1)
    lazy = da.from_array(labels, chunks=20)
    with pytest.warns(PackingWarning) as told:
        vg.load_labels(lazy, voxel_size=EDGES, surface="voxel")
    assert "1 of 27 labels have several pieces (label 2 first)" in str(told[0].message)
    whole, grouped = in_groups(labels, monkeypatch, surface="voxel", border="drop")
    assert whole.count == grouped.count < 27
    assert np.array_equal(whole.container.bounds, grouped.container.bounds)


def test_what_cannot_be_done_in_blocks_is_said(labels, monkeypatch):
    lazy = da.from_array(labels, chunks=20)
    with pytest.raises(InputError, match="grey values"):
        vg.load_labels(lazy + 0.5, voxel_size=1.0)
    monkeypatch.setattr(lattice_image, "memory_limit", lambda: 1000)
    with pytest.raises(TooLargeError, match=r"with label \d+ spans 60 x .* voxels: they are more than the memory"):
        vg.load_labels(lazy, voxel_size=1.0)


@pytest.mark.parametrize("labelled", [slow(True), False, "known"])
def test_a_packing_is_painted_by_blocks(bed, labelled):
    for packing in (bed, vg.pack(vg.shapes.sphere(), vg.Box((3, 3, 3), periodic="xy"), "rsa", count=12, seed=1)):
        how = {"labels": np.arange(packing.count) + 7 if labelled == "known" else labelled}
        whole, parts = vg.to_image(packing, EDGES, **how), vg.to_image(packing, EDGES, block=(17, 60, 13), **how)
        assert parts.numblocks == (4, 1, -(-whole.shape[2] // 13))
        assert parts.dtype == whole.dtype
        assert np.array_equal(parts.compute(), whole)


def test_boxes_whose_faces_pass_through_voxel_centers_are_painted_alike():
    cubes = vg.Packing.of([vg.make_shape("box")], vg.Box((3, 3, 3)), position=[(0.75, 0.85, 0.65), (2.15, 1.95, 2.25)])
    whole = vg.to_image(cubes, 0.1)
    assert np.array_equal(vg.to_image(cubes, 0.1, block=7).compute(), whole)


def test_a_packing_goes_to_zarr_and_back(bed, tmp_path):
    parts = vg.to_image(bed, EDGES, block=32)
    vg.save_image(parts, tmp_path / "bed.zarr", voxel_size=EDGES, origin=(1, 2, 3), unit="mm")
    opened = vg.open_image(tmp_path / "bed.zarr")
    assert (opened.voxel_size, opened.origin, opened.unit) == (EDGES, (1.0, 2.0, 3.0), "mm")
    assert np.array_equal(np.asarray(opened), vg.to_image(bed, EDGES))
    assert vg.label_table(tmp_path / "bed.zarr").sizes["label"] == 27
    with pytest.raises(FileExistsError):
        vg.save_image(parts, tmp_path / "bed.zarr", voxel_size=EDGES)
    vg.save_image(np.zeros((4, 5, 6)), tmp_path / "bed.zarr", voxel_size=1.0, overwrite=True)
    assert vg.open_image(tmp_path / "bed.zarr").values.shape == (4, 5, 6)
    (tmp_path / "bed.zarr" / "mine.txt").write_text("notes")
    with pytest.raises(FileExistsError, match=r"mine\.txt"):
        vg.save_image(parts, tmp_path / "bed.zarr", voxel_size=EDGES, overwrite=True)


def test_what_two_labels_share_stays_as_it_was():
    image = np.zeros((12, 8, 8), dtype=np.int32)
    image[2:6, 2:6, 1:7], image[6:10, 1:7, 2:6] = 1, 2
    seams = Seams(
        np.array(image.shape) + 1,
        np.zeros(3, dtype=np.int64),
        whole=np.ones(3, dtype=bool),
        own=np.array([False, True, False]),
        due=np.array([False, True, True]),
    )
    how = {"wraps": np.zeros(3, dtype=bool), "smoothing": 1.0, "spacing": np.ones(3), "seams": seams}
    first = label_surfaces(image.copy(), 2, **how)
    later = np.array([False, False, True])
    seams.keep(first.net, 0.9 * first.moved, ~first.crossed, later, 0)
    second = label_surfaces(image.copy(), 2, **how)
    shared = (first.net.side > 0).all(axis=1)
    assert np.array_equal(second.crossed, first.crossed ^ shared)
    points = np.unique(first.net.quad[shared])
    assert np.array_equal(second.moved[points], 0.9 * first.moved[points])
    # planes before those that are still needed are forgotten
    seams.keep(first.net, first.moved, first.crossed, later, 7)
    assert not len(seams.points)
    assert not len(seams.quads)


@pytest.mark.filterwarnings("ignore:.*labels have fewer than")
def test_labels_of_few_voxels_beside_an_earlier_group_keep_their_volume(monkeypatch):
    # two labels of one and two voxels at the last one of the first group, which would move their points
    image = np.zeros((40, 12, 12), dtype=np.int32)
    image[2:20, 2:9, 2:9], image[20, 4, 4], image[20:22, 8, 9] = 1, 2, 3
    monkeypatch.setattr(block_surfaces, "LEAST", 4)
    monkeypatch.setattr(block_surfaces, "BUDGET", 1)
    shapes = vg.load_labels(da.from_array(image, chunks=9), voxel_size=1.0)
    assert [shape.volume for shape in shapes] == pytest.approx([882, 1, 2], rel=1e-5)


def test_labels_that_fill_an_image_keep_their_volume_to_the_last_group(monkeypatch):
    # the last groups have nothing but each other's faces to move
    shape = np.array([12, 29, 26])
    apart = (np.indices(shape).T + 0.5)[..., None, :] - stream(0, "places").uniform(0, 1, (8, 3)) * shape
    image = np.linalg.norm(apart - np.round(apart / shape) * shape, axis=-1).argmin(axis=-1).T + 1
    monkeypatch.setattr(block_surfaces, "LEAST", 6)
    monkeypatch.setattr(block_surfaces, "BUDGET", 1)
    packing = vg.packing_of_labels(da.from_array(image, chunks=15), voxel_size=1.0, periodic="xyz", gravity="none")
    assert packing.volumes == pytest.approx(np.bincount(image.ravel())[1:], rel=1e-5)
    assert vg.verify(packing).ok


def test_a_diagonal_between_later_labels_stays_where_all_its_points_do():
    # labels 2 and 3 beside each other in a flat hole of label 1, which touches all points between them
    image = np.zeros((8, 8, 8), dtype=np.int32)
    image[1:7, 1:7, 1:7], image[2:4, 2:6, 4], image[4:6, 2:6, 4] = 1, 2, 3
    none = np.zeros(3, dtype=np.int64)
    seams = Seams(np.array(image.shape) + 1, none, np.ones(4, dtype=bool), np.arange(4) == 1, np.arange(4) > 0)
    how = {"wraps": np.zeros(3, dtype=bool), "smoothing": 1.0, "spacing": np.ones(3), "seams": seams}
    first = label_surfaces(image.copy(), 3, **how)
    seams.keep(first.net, first.moved, ~first.crossed, np.arange(4) > 1, 0)
    second = label_surfaces(image.copy(), 3, **how)
    points = seams.touched(first.net, seams.own) & seams.touched(first.net, np.arange(4) > 1)
    held = points[first.net.quad].all(axis=1)
    later = (first.net.side > 1).all(axis=1)
    assert (held & later).any()
    assert np.array_equal(second.crossed, first.crossed ^ held)
