"""Label images: each grain keeps its volume and place, and what is no label image is refused."""

import inspect
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import ndimage
from scipy.spatial import KDTree
from scipy.special import ndtri

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, MissingFileError, PackingWarning
from voxgran._base.seeds import stream
from voxgran.lattice import census as counting
from voxgran.lattice.census import census
from voxgran.lattice.image import Image
from voxgran.lattice.surface import smooth_surface
from voxgran.shapes.repairing.diagnose import diagnose

pytestmark = [pytest.mark.filterwarnings("ignore:the bulk holds"), pytest.mark.usefixtures("forked_readers")]


def sphere_image(radius, *, n=None, middle=None, label=1):
    n = n or int(2 * radius) + 6
    middle = np.full(3, n / 2) if middle is None else np.array(middle)
    grid = np.moveaxis(np.indices((n, n, n)), 0, -1) + 0.5
    return np.where(np.linalg.norm(grid - middle, axis=-1) <= radius, label, 0)


def test_large_labels_of_64_bits_without_sign_are_told_apart():
    image = np.zeros((8, 8, 8), dtype=np.uint64)
    image[1:3, 1:3, 1:3], image[4:7, 4:7, 4:7] = 2**60 + 1, 2**60 + 2
    found = census(image)
    assert found.label.tolist() == [2**60 + 1, 2**60 + 2]
    assert [shape.volume for shape in vg.load_labels(image, voxel_size=1.0)] == pytest.approx([8.0, 27.0], rel=1e-5)
    image[0, 0, 0] = 2**63
    with pytest.raises(InputError, match="holds the label 9223372036854775808: labels are below"):
        vg.label_table(image, voxel_size=1.0)


@pytest.mark.parametrize("radius", [1.0, 2.5, 6.3, 12.0])
def test_a_sphere_keeps_its_volume_and_place(radius):
    image = sphere_image(radius, middle=(9.2, 10.1, 11.4) if radius < 7 else None, n=22 if radius < 7 else 30)
    (shape,) = vg.load_labels(image, voxel_size=0.5)
    assert shape.volume == pytest.approx((image > 0).sum() / 8, rel=1e-5)
    packing = vg.packing_of_labels(image, voxel_size=0.5)
    middle = np.argwhere(image).mean(axis=0) + 0.5
    np.testing.assert_allclose(packing.position[0], 0.5 * middle, atol=0.02)
    assert diagnose(shape).ok


def test_the_surface_comes_nearer_with_finer_voxels():
    errors = []
    for radius in (5, 10, 20):
        (shape,) = vg.load_labels(
            sphere_image(radius + 0.25, middle=np.full(3, radius + 3.37), n=2 * radius + 7), voxel_size=1 / radius
        )
        middle = shape.vertices.mean(axis=0)
        errors.append(np.sqrt(((np.linalg.norm(shape.vertices - middle, axis=1) - (1 + 0.25 / radius)) ** 2).mean()))
    assert errors[2] < errors[1] < errors[0] < 0.05
    assert errors[2] < 0.4 * errors[0]


def test_the_smallest_grains_and_cavities_survive():
    one = np.zeros((5, 5, 5), int)
    one[2, 2, 2] = 7
    (shape,) = vg.load_labels(one, voxel_size=2.0)
    assert shape.volume == pytest.approx(8.0, rel=1e-5)
    assert shape.name == "label 7"
    shell = sphere_image(12.0) - sphere_image(7.0, n=30)
    (hollow,) = vg.load_labels(shell, voxel_size=1.0)
    assert diagnose(hollow).cavities == 1
    assert hollow.volume == pytest.approx(shell.sum(), rel=2e-6)


def test_edges_of_a_voxel_may_differ():
    image = np.zeros((12, 12, 12), int)
    image[3:9, 3:9, 3:9] = 1
    (shape,) = vg.load_labels(image, voxel_size=(1, 2, 3))
    assert shape.volume == pytest.approx(216 * 6)
    extent = np.ptp(shape.vertices, axis=0)
    np.testing.assert_allclose(extent, [6, 12, 18], rtol=0.12)
    table = vg.label_table(image, voxel_size=(1, 2, 3))
    assert table["lower"].values.tolist() == [[3, 6, 9]]
    assert table["upper"].values.tolist() == [[9, 18, 27]]
    assert {value.attrs["units"] for value in table.values()} == {"1"}
    table = vg.label_table(Image(image, 2.0, unit="um"))
    assert [table[name].attrs["units"] for name in ("voxels", "volume", "centroid")] == ["1", "um^3", "um"]


def three():
    """Three boxes with holes in the numbering; the first touches the border."""
    image = np.zeros((20, 12, 12), np.uint16)
    image[0:4, 3:8, 3:8] = 3
    image[6:11, 3:8, 3:8] = 70
    image[11:16, 3:8, 3:8] = 500
    return image


def test_holes_in_the_numbering_and_the_border():
    table = vg.label_table(three(), voxel_size=0.1)
    assert table["label"].values.tolist() == [3, 70, 500]
    assert table["voxels"].values.tolist() == [100, 125, 125]
    assert table["touches_border"].values.tolist() == [True, False, False]
    assert table["centroid"].values[1].tolist() == pytest.approx([0.85, 0.55, 0.55])
    whole = vg.load_labels(three(), voxel_size=0.1, border="drop")
    assert [shape.name for shape in whole] == ["label 70", "label 500"]
    with pytest.warns(PackingWarning, match=r"1 of 3 labels are cut by the border of the image \(label 3 first\)"):
        assert len(vg.load_labels(three(), voxel_size=0.1)) == 3
    # what the image does not cut is told of without a word
    assert len(vg.load_labels(three(), voxel_size=0.1, periodic="x")) == 3


def test_both_readers_of_labels_have_the_same_defaults():
    one, two = (inspect.signature(reader).parameters for reader in (vg.load_labels, vg.packing_of_labels))
    of_packing = {name: item.default for name, item in two.items() if name != "gravity"}
    assert {name: item.default for name, item in one.items()} == of_packing


def test_neighbours_stay_apart_and_the_sample_is_measured():
    packing = vg.packing_of_labels(three(), voxel_size=0.1, unit="mm")
    assert packing.solid_fraction == pytest.approx((three() > 0).mean(), rel=2e-6)
    assert packing.container.lengths == pytest.approx((2.0, 1.2, 1.2))
    assert vg.verify(packing).ok
    assert packing.provenance["labels"] == [3, 70, 500]
    tree = vg.measure(packing, which=["density", "coordination"])
    assert float(tree["solid_fraction"]) == pytest.approx(packing.solid_fraction)


@pytest.mark.slow
def test_a_made_packing_comes_back_from_its_image():
    rock = vg.make_shape("ellipsoid", semi_axes=(0.6, 0.5, 0.4))
    made = vg.pack([rock], vg.Box((4, 4, 5), "xy"), method="digital", count=30, voxel_size=0.1, sweeps=100, seed=1)
    image = vg.to_image(made, 0.05)
    back = vg.packing_of_labels(image, voxel_size=0.05, periodic="xy", gravity="-z")
    assert back.count == made.count
    assert back.container.periodic == (True, True, False)
    np.testing.assert_allclose(back.volumes, made.volumes, rtol=0.03)
    shift = back.position - made.position
    shift[:, :2] -= 4 * np.round(shift[:, :2] / 4)
    assert np.abs(shift).max() < 0.01
    assert back.solid_fraction == pytest.approx(made.solid_fraction, rel=5e-3)
    assert vg.verify(back).ok


def test_several_pieces_keep_the_largest_and_say_so():
    image = np.zeros((20, 10, 10), int)
    image[2:9, 2:8, 2:8] = 4
    image[12:15, 2:5, 2:5] = 4
    with pytest.warns(PackingWarning, match=r"1 of 1 labels have several pieces \(label 4 first\)"):
        (shape,) = vg.load_labels(image, voxel_size=1.0)
    assert shape.volume == pytest.approx(7 * 6 * 6, rel=0.03)


def test_a_memory_map_is_read_slab_by_slab(tmp_path, monkeypatch):
    np.save(tmp_path / "labels.npy", three())
    monkeypatch.setattr(counting, "SLAB", 3 * 12 * 12)
    mapped = np.load(tmp_path / "labels.npy", mmap_mode="r")
    whole, parts = census(three()), census(mapped)
    for name in ("label", "count", "lower", "upper", "at_border"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name))
    np.testing.assert_allclose(whole.middle, parts.middle, rtol=1e-14)
    assert len(vg.load_labels(tmp_path / "labels.npy", voxel_size=1.0, border="drop")) == 2
    for surface in ("smooth", "voxel"):
        whole = vg.packing_of_labels(three(), voxel_size=1.0, surface=surface)
        parts = vg.packing_of_labels(tmp_path / "labels.npy", voxel_size=1.0, surface=surface)
        assert [shape.key for shape in parts.shapes] == [shape.key for shape in whole.shapes]


@given(seed=st.integers(0, 10**6), n=st.integers(1, 9), labels=st.integers(1, 4), factor=st.sampled_from([1, 5, 2**23]))
def test_the_census_is_that_of_plain_numpy(seed, n, labels, factor):
    image = stream(seed, "census").integers(0, labels + 1, (n, n + 1, n + 2)) * factor
    found = census(image)
    assert found.label.tolist() == [label for label in np.unique(image).tolist() if label]
    for k, label in enumerate(found.label):
        places = np.argwhere(image == label)
        assert found.count[k] == len(places)
        assert found.lower[k].tolist() == places.min(axis=0).tolist()
        assert found.upper[k].tolist() == (places.max(axis=0) + 1).tolist()
        np.testing.assert_allclose(found.middle[k], places.mean(axis=0) + 0.5)


@given(seed=st.integers(0, 10**6), share=st.floats(0.05, 0.9))
@example(seed=1128, share=0.890625)  # all points that are free come to the ends of their boxes
def test_any_mask_gives_closed_surfaces_of_its_volume(seed, share):
    mask = stream(seed, "mask").random((5, 6, 4)) < share
    mask[2, 2, 2] = True
    vertices, faces = smooth_surface(mask)
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    assert np.einsum("fi,fi->", a, np.cross(b, c)) / 6 == pytest.approx(mask.sum(), rel=1e-9)
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        (shape,) = vg.load_labels(mask.astype(int), voxel_size=1.0, border="keep")
    assert diagnose(shape).ok


@given(
    seed=st.integers(0, 10**6),
    labels=st.integers(1, 4),
    periodic=st.sampled_from(["x", "yz", "xyz"]),
    surface=st.sampled_from(["smooth", "voxel"]),
)
@example(seed=121, labels=1, periodic="x", surface="smooth")  # a label that fills an axis, and winds along it
@example(seed=0, labels=4, periodic="xyz", surface="voxel")
def test_periodic_labels_bound_one_body_of_their_volume(seed, labels, periodic, surface):
    image = stream(seed, "labels").integers(0, labels + 1, (6, 7, 5))
    image[2, 3, 2] = 1
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        shapes = vg.load_labels(image, voxel_size=1.0, periodic=periodic, surface=surface)
    wraps = [axis in periodic for axis in "xyz"]
    for shape, label in zip(shapes, np.unique(image[image > 0]), strict=True):
        assert diagnose(shape).ok
        bodies = vg.connected_components(image == label, periodic=wraps)[0]
        assert shape.volume == pytest.approx(np.bincount(bodies.ravel())[1:].max(), rel=1e-5)


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.ones((4, 4), int), r"has the shape \(4, 4\)"),
        (np.ones((2, 4, 4, 4), int), "three axes"),
        (np.zeros((4, 4, 4), int), "holds 0 labels"),
        (np.zeros((0, 4, 4), int), "no voxel"),
        (np.full((4, 4, 4), -2), "label -2"),
        (np.full((4, 4, 4), 0.5), "segment it first"),
        (np.full((4, 4, 4), np.nan), "segment it first"),
        (np.full((4, 4, 4), "a"), "whole numbers"),
        (np.ones((4, 4, 4), int), "all 1 labels touch the border"),
    ],
)
def test_what_is_no_label_image_is_refused(image, words):
    with pytest.raises(InputError, match=words):
        vg.load_labels(image, voxel_size=1.0, border="drop")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "voxel_size is None"),
        ({"voxel_size": 0.0}, "voxel_size is 0.0"),
        ({"voxel_size": (1, 2, -1)}, "above 0"),
        ({"voxel_size": (1, 2)}, "voxel_size"),
        ({"voxel_size": 1.0, "border": "cut"}, "border is 'cut'"),
        ({"voxel_size": 1.0, "surface": "exact"}, "surface is 'exact': .*smooth.*voxel"),
        ({"voxel_size": 1.0, "smoothing": 0.0}, "smoothing is 0"),
        ({"voxel_size": 1.0, "periodic": "w"}, "periodic is 'w'"),
    ],
)
def test_bad_options_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        vg.load_labels(three(), **options)


def test_missing_and_unknown_files_are_refused(tmp_path):
    with pytest.raises(MissingFileError):
        vg.load_labels(tmp_path / "none.npy", voxel_size=1.0)
    (tmp_path / "image.bmp").write_bytes(b"BM")
    with pytest.raises(FileFormatError, match=r"images are read from \.npy"):
        vg.load_labels(tmp_path / "image.bmp", voxel_size=1.0)


@pytest.fixture
def grey():
    image = sphere_image(6.0, n=20) * 1000 + stream(3, "noise").integers(100, 400, (20, 20, 20))
    return image.astype(np.uint16)


@pytest.mark.parametrize("take", [vg.load_labels, vg.packing_of_labels])
def test_grey_values_are_refused_at_once(grey, take):
    with pytest.raises(InputError, match=r"values, which rise and fall .* make labels with segment\(load_image"):
        take(grey, voxel_size=0.1)


def test_grey_values_within_a_mask_of_zeros_are_refused_too(grey):
    masked = np.zeros((40, 40, 40), dtype=np.uint16)
    masked[:12, :12, :12] = grey[:12, :12, :12]
    with pytest.raises(InputError, match="these are grey values"):
        vg.load_labels(masked, voxel_size=0.1)


@pytest.mark.parametrize("blur", [0.5, 1.0, 4.0, 12.0])
def test_smooth_grey_values_are_refused_too(blur):
    noise = stream(4, "blur").normal(size=(40, 40, 40))
    grains = ndimage.gaussian_filter(noise, 4.0) > 0
    image = ndimage.gaussian_filter(180.0 * grains + 40, blur) if blur < 10 else ndimage.gaussian_filter(noise, blur)
    image = np.interp(image, (image.min(), image.max()), (1, 255)).astype(np.uint8)
    with pytest.raises(InputError, match="these are grey values"):
        vg.load_labels(image, voxel_size=0.1)


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_grains_that_touch_are_no_grey_values():
    points = stream(5, "cells").uniform(0, 20, (120, 3))
    points = points[np.argsort(points[:, 0])]  # neighbours have labels that are near each other, as from a raster scan
    voxels = np.argwhere(np.ones((20, 20, 20), dtype=bool))
    cells = KDTree(points).query(voxels)[1].reshape(20, 20, 20) + 1
    assert len(vg.load_labels(cells, voxel_size=1.0, surface="voxel", border="keep")) == 120


@pytest.mark.parametrize("share", [0.01, 0.1, 0.2])
def test_labels_of_single_voxels_are_no_grey_values(share):
    solid = stream(6, "single").random((30, 30, 30)) < share
    labels = np.zeros(solid.shape, dtype=np.int32)
    labels[solid] = stream(7, "numbers").permutation(int(solid.sum())) + 1
    assert vg.label_table(labels, voxel_size=1.0).sizes["label"] == solid.sum()


@pytest.mark.filterwarnings("ignore:.*cut by the border")
def test_many_small_grains_are_no_grey_values():
    cells = np.arange(1, 126).reshape(5, 5, 5)
    touching = cells.repeat(2, 0).repeat(2, 1).repeat(2, 2)
    assert len(vg.load_labels(touching, voxel_size=1.0, surface="voxel")) == 125
    apart = np.zeros((20, 20, 20), dtype=int)
    apart[1::4, 1::4, 1::4] = cells
    assert len(vg.load_labels(apart, voxel_size=1.0, surface="voxel")) == 125


def test_an_image_is_taken_as_it_is_by_what_takes_arrays(grey, tmp_path):
    np.save(tmp_path / "grey.npy", grey)
    image = vg.load_image(tmp_path / "grey.npy")
    assert repr(image) == "Image(shape=(20, 20, 20), uint16)"
    assert np.array_equal(np.asarray(image), grey)
    assert np.array(image, dtype=float).dtype == float
    assert len(vg.load_labels(replace(image, values=sphere_image(4.0)), voxel_size=1.0)) == 1
    pytest.importorskip("skimage")
    assert vg.segment(image).max() == 1
    with pytest.raises(InputError, match=r"is the path '.*grey.npy': grey values are needed; write segment\(load"):
        vg.segment(tmp_path / "grey.npy")
    with pytest.raises(InputError, match=r'write load_image\("scan.npy", voxel_size=0.1, unit="mm"\)'):
        vg.load_image()


def bed(axis, upward):
    """Return an image whose grains leave more than half of it empty along one side of an axis."""
    image = np.zeros((14, 14, 30), dtype=int)
    image[1:13, 1:7, 1:12], image[1:13, 7:13, 1:12] = 1, 2
    return np.moveaxis(image if upward else image[:, :, ::-1], 2, axis)


@pytest.mark.parametrize(
    ("axis", "upward", "gravity"), [(0, True, "-x"), (1, False, r"\+y"), (2, True, "-z"), (2, False, r"\+z")]
)
def test_a_bed_in_an_image_is_told_to_give_its_gravity(axis, upward, gravity):
    image = bed(axis, upward)
    with pytest.warns(PackingWarning, match=f"give gravity='{gravity}'"):
        loose = vg.packing_of_labels(image, voxel_size=0.1)
    held = vg.packing_of_labels(image, voxel_size=0.1, gravity=gravity.replace("\\", ""))
    assert loose.gravity is None
    assert held.gravity[axis] == (-1.0 if upward else 1.0)
    room = [float(one.measure("voids").pore_porosity) for one in (loose, held)]
    assert room[1] < 0.5 * room[0]


def test_a_full_image_is_not_taken_for_a_bed():
    with warnings.catch_warnings(action="error"):
        vg.packing_of_labels(three(), voxel_size=0.1)
        vg.packing_of_labels(bed(2, True), voxel_size=0.1, gravity="none")


def image_with_specks():
    """Return two cubes of 512 voxels, one with a second piece of a voxel, two specks, and the tip of a grain."""
    image = np.zeros((12, 12, 22), dtype=np.int32)
    image[1:9, 1:9, 1:9], image[1:9, 1:9, 11:19], image[10, 10, 10], image[5, 10, 5:7], image[10, 1, 1] = 1, 2, 2, 3, 4
    image[11, 11, 21] = 5
    return image


def test_specks_are_told_and_left_out_by_their_size():
    """Each was a grain as any other, of which twins drew as many as of the true ones."""
    image = image_with_specks()
    with pytest.warns(PackingWarning) as told:
        every = vg.packing_of_labels(image, voxel_size=0.1, gravity="none")
    assert any(
        "2 of 5 labels have fewer than 27 voxels (label 3 first), others 512" in str(one.message) for one in told
    )
    assert any("without 0.097 % of the volume of all" in str(one.message) for one in told)
    with pytest.warns(PackingWarning, match="1 of 2 labels have several pieces"):
        large = vg.packing_of_labels(image, voxel_size=0.1, gravity="none", min_size=27)
    assert (every.count, large.provenance["labels"]) == (5, [1, 2])
    assert large.container == every.container
    with pytest.raises(InputError, match="min_size is 600 and the largest label has 513 voxels"):
        vg.load_labels(image, voxel_size=0.1, min_size=600)


@pytest.mark.filterwarnings("ignore:.*several pieces")
def test_specks_that_are_left_out_make_the_sample_no_smaller():
    """With the border dropped, the container was that around the grains, though only specks had been left out."""
    how = {"voxel_size": 0.1, "gravity": "none", "border": "drop", "min_size": 27}
    image = image_with_specks()
    assert vg.packing_of_labels(image, **how).container.lengths == pytest.approx((1.2, 1.2, 2.2))
    image[:6, 11, :9] = 6
    assert vg.packing_of_labels(image, **how).container.lengths[1] < 1.0


def image_of_cubes(edges):
    """Return an image of cubes that do not touch."""
    cell = max(edges) + 2
    image = np.zeros((cell, cell, cell * len(edges)), dtype=np.int32)
    for k, edge in enumerate(edges):
        image[1 : edge + 1, 1 : edge + 1, cell * k + 1 : cell * k + edge + 1] = k + 1
    return image


def test_small_grains_of_a_wide_distribution_are_no_specks():
    """Of a powder whose sizes scatter by 0.6 (logarithms) they were told to be noise."""
    share = (np.arange(60) + 0.5) / 60
    edges = np.maximum(np.rint(5.0 * np.exp(0.6 * ndtri(share))), 1).astype(int)
    assert 0.05 < (edges < 3).mean() < 0.2
    with warnings.catch_warnings(action="error"):
        vg.load_labels(image_of_cubes(edges), voxel_size=0.1)
    with pytest.warns(PackingWarning, match=r"8 of 20 .* fewer than 22 voxels .* others 216: .* min_size=22"):
        vg.load_labels(image_of_cubes([1] * 8 + [6] * 12), voxel_size=0.1)


@pytest.mark.slow
def test_the_gap_of_long_voxels_is_that_of_cubes_of_their_volume():
    """Open pairs add 0.2 to the coordination number, as in cubes of that volume; by the longest edge they added 1.9."""
    shape, box = vg.shapes.ellipsoid(aspect=(1.5, 1.2, 1)), vg.Box((2.85,) * 3, "xyz")
    grains = vg.pack(shape, box, "expand", solid_fraction=0.62, count=30, seed=1)
    edges = (2.85 / 52, 2.85 / 52, 2.85 / 17)
    scan = vg.packing_of_labels(vg.to_image(grains, edges), voxel_size=edges, periodic="xyz", gravity="none")
    assert scan.contact_gap == pytest.approx(np.cbrt(np.prod(edges)))
    open_, longest = (2 * (scan.contacts(gap).count - scan.contacts(1e-6).count) / 30 for gap in (None, edges[2]))
    assert open_ < 0.5 < 1.0 < longest
