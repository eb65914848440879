"""Packings of label images whose grains touch, or are cut: no grain overlaps another or reaches through the border."""

import tracemalloc
import warnings

import numpy as np
import pytest
from kit import slow
from scipy.spatial import cKDTree

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran._base.seeds import stream

pytestmark = pytest.mark.filterwarnings("ignore:.*several pieces", "ignore:.*labels have fewer than")


def cells(n, seeds, reach, *, seed=0, period=None):
    """Return an image of n voxels along each axis: the cells of random points, cut at a distance from them."""
    points = stream(seed, "cells").random((seeds, 3)) * n
    places = np.stack(np.indices((n, n, n)), axis=-1).reshape(-1, 3) + 0.5
    distance, nearest = cKDTree(points, boxsize=period).query(places)
    return np.where(distance <= reach, nearest + 1, 0).reshape(n, n, n)


def noise(seed=0, labels=3):
    """Return an image in which every label meets every other in faces, edges and corners."""
    return stream(seed, "noise").integers(0, labels + 1, (7, 6, 8))


def segmented():
    """Return the labels that a watershed finds in the image of a packing."""
    made = vg.pack(vg.make_shape("sphere"), vg.Box((3, 3, 3)), method="digital", count=10, voxel_size=0.1, sweeps=100)
    grey = np.where(vg.to_image(made, 0.1, labels=False), 200.0, 20.0)
    return vg.segment(grey, threshold=100.0)


IMAGES = {
    "with void": (cells(26, 16, 6.5), {}),
    "without void": (cells(20, 12, 99.0), {}),
    "on a torus": (cells(24, 14, 6.5, period=24.0), {"periodic": "xyz"}),
    "periodic along one": (cells(24, 14, 6.5, period=[0, 24, 0]), {"periodic": "y"}),
    "noise": (noise(), {}),
    "periodic noise": (noise(1), {"periodic": "xz"}),
    "one label through it all": (np.pad(np.ones((9, 3, 3), int), ((0, 0), (3, 3), (3, 3))), {"periodic": "x"}),
    "one voxel": (np.ones((1, 1, 1), int), {}),
}
#: images without labels of several pieces
WHOLE = {"with void", "on a torus", "segmented", "one label through it all", "without void", "one voxel"}


@pytest.mark.parametrize("surface", ["smooth", "voxel"])
@pytest.mark.parametrize(
    "name", [slow(name) if name in ("without void", "on a torus") else name for name in [*IMAGES, "segmented"]]
)
def test_grains_neither_overlap_nor_escape(name, surface):
    image, options = IMAGES[name] if name in IMAGES else (segmented(), {})
    packing = vg.packing_of_labels(image, voxel_size=0.1, surface=surface, gravity="none", **options)
    proof = vg.verify(packing)
    assert proof.ok
    assert proof.escaped == proof.overlapping_pairs == 0
    assert packing.count == len(np.unique(image[image > 0]))
    if name in WHOLE:
        counted = np.array([(image == label).sum() for label in packing.provenance["labels"]]) * 1e-3
        np.testing.assert_allclose(packing.volumes, counted, rtol=2e-6 if surface == "smooth" else 1e-9)


@pytest.mark.parametrize("number", [60, slow(5000)])
def test_voxels_of_any_neighbours_touch_and_do_not_overlap(number):
    # around a corner of label 2 are three voxels of label 1, and a fourth one that meets them along edges only
    pinched = np.zeros((2, 3, 3), int)
    pinched[0, 0, 1] = pinched[0, 1, 0] = pinched[0, 2, 1] = pinched[1, 1, :2] = 1
    pinched[0, 1, 1] = 2
    overlapping = [] if is_free_of_overlaps(pinched, "") else [pinched]
    for seed in range(number):
        draw = stream(seed, "labels").integers
        image = draw(0, draw(2, 5), draw(2, 6, 3))
        image[0, 0, 0] = 1
        periodic = ("", "x", "xy", "xyz")[draw(0, 4)]
        if not is_free_of_overlaps(image, periodic):
            overlapping.append((image, periodic))
    assert not overlapping


def is_free_of_overlaps(image, periodic):
    # most labels have several pieces
    with warnings.catch_warnings(action="ignore", category=PackingWarning):
        packing = vg.packing_of_labels(image, voxel_size=1.0, surface="voxel", periodic=periodic, gravity="none")
    return vg.verify(packing).ok


@pytest.mark.parametrize("surface", ["smooth", "voxel"])
def test_neighbours_that_share_faces_touch(surface):
    image = np.zeros((14, 8, 8), int)
    image[2:7, 2:6, 2:6], image[7:12, 2:6, 2:6] = 1, 2
    packing = vg.packing_of_labels(image, voxel_size=1.0, surface=surface)
    contacts = packing.contacts(gap=1e-9)
    assert len(contacts.i) == 1
    assert abs(contacts.gap[0]) < 1e-12
    # in the face that they share; smooth surfaces are rounded at its rim, where the point may lie
    assert contacts.point[0][0] == pytest.approx(7.0, abs=0.1)
    assert contacts.normal[0][0] > (0.3 if surface == "smooth" else 1 - 1e-9)
    assert packing.volumes == pytest.approx([80, 80], rel=2e-6)


def test_cut_grains_end_in_the_wall():
    image = cells(26, 16, 6.5)
    packing = vg.packing_of_labels(image, voxel_size=0.1)
    bounds = [
        (packing.position[k] + shape.vertices.min(axis=0), packing.position[k] + shape.vertices.max(axis=0))
        for k, shape in enumerate(packing.shapes)
    ]
    table = vg.label_table(image, voxel_size=0.1)
    low, high = (np.array(corner) for corner in zip(*bounds, strict=True))
    cut = table["touches_border"].values
    assert cut.sum() > 5
    for found, wall, at in ((low, 0.0, table["lower"].values), (high, 2.6, table["upper"].values)):
        ends = np.isclose(at, wall)
        assert ends.any()
        np.testing.assert_allclose(found[ends], wall, atol=1e-12)


def test_the_image_comes_back_with_its_own_numbers():
    image = 1000 * cells(18, 9, 5.5)
    packing = vg.packing_of_labels(image, voxel_size=0.25, surface="voxel")
    labels = packing.provenance["labels"]
    assert np.array_equal(vg.to_image(packing, 0.25, labels=labels), image)
    assert vg.to_image(packing, 0.25).max() == packing.count
    far = np.array(labels) + 2**40
    assert np.array_equal(vg.to_image(packing, 0.25, labels=far), np.where(image, image + 2**40, 0))
    for wrong in (labels[1:], [0, *labels[1:]], np.array(labels) / 1.0, "abc", [2**63, *labels[1:]]):
        with pytest.raises(InputError, match=f"give one whole number above 0 for each of the {packing.count} grains"):
            vg.to_image(packing, 0.25, labels=wrong)


def test_what_is_left_without_cut_grains_has_the_box_around_it():
    image = np.zeros((30, 12, 12), int)
    image[0:5, 2:8, 2:8], image[8:14, 3:9, 2:8], image[16:22, 4:8, 4:8] = 1, 2, 3
    packing = vg.packing_of_labels(image, voxel_size=1.0, border="drop", surface="voxel")
    assert packing.provenance["labels"] == [2, 3]
    np.testing.assert_allclose(packing.container.bounds, [(8, 3, 2), (22, 9, 8)], atol=1e-12)
    assert packing.solid_fraction == pytest.approx((216 + 96) / (14 * 6 * 6))
    assert vg.verify(packing).ok
    # along a periodic axis, and where no grain is left out, the box is that of the image
    wrapped = vg.packing_of_labels(image, voxel_size=1.0, border="drop", periodic="x")
    assert (wrapped.count, wrapped.container.lengths) == (3, (30.0, 12.0, 12.0))
    image[:, 0, 0] = 4
    wrapped = vg.packing_of_labels(
        np.roll(image, 2, axis=0), voxel_size=1.0, border="drop", surface="voxel", periodic="x"
    )
    np.testing.assert_allclose(wrapped.container.bounds, [(0, 2, 2), (30, 9, 8)], atol=1e-12)
    with warnings.catch_warnings(action="error"):
        vg.load_labels(image, voxel_size=1.0, border="drop")
    with pytest.warns(PackingWarning, match="2 of 4 labels are cut"):
        vg.load_labels(image, voxel_size=1.0)


def test_smoothing_brings_a_sphere_nearer_to_its_shape():
    n, radius = 30, 9.3
    away = np.linalg.norm(np.stack(np.indices((n, n, n)), axis=-1) + 0.5 - (14.9, 15.2, 14.6), axis=-1)
    image = np.where(away <= radius, 1, 0)
    # another grain near it, so that it is fitted
    image[:2] = 2
    image[2:6, 13:16, 13:16] = 2
    found = {}
    for surface in ("smooth", "voxel"):
        packing = vg.packing_of_labels(image, voxel_size=1.0, surface=surface)
        assert packing.volumes[0] == pytest.approx((image == 1).sum(), rel=2e-6)
        corners = packing.shapes[0].vertices + packing.position[0]
        off = np.linalg.norm(corners - (14.9, 15.2, 14.6), axis=1) - radius
        found[surface] = np.sqrt(np.mean(off[corners[:, 0] > 8] ** 2))
    assert found["smooth"] < 0.15
    assert found["voxel"] > 2 * found["smooth"]


@pytest.mark.parametrize("surface", ["smooth", "voxel"])
def test_whoever_waits_is_told_of_grains_and_of_pairs(surface):
    image = np.zeros((24, 12, 12), dtype=int)
    image[2:9, 2:10, 2:10], image[9:16, 2:10, 2:10], image[16:22, 2:10, 2:10] = 1, 2, 3
    steps = []
    packing = vg.packing_of_labels(image, voxel_size=1.0, surface=surface, on_step=steps.append)
    assert [(step.stage, step.done, step.total) for step in steps] == [("grains", k, 3) for k in range(3)]
    del steps[:]
    assert vg.verify(packing, on_step=steps.append).ok
    # 1 touches 2, and 2 touches 3
    told = [(step.stage, step.done, step.total) for step in steps]
    assert told == [("surfaces", 0, 2), ("surfaces", 1, 2), ("overlaps", 0, 2), ("overlaps", 1, 2)]
    with pytest.raises(vg.VoxgranError, match="on_step is 3: it must be a function of a step; change it"):
        vg.verify(packing, on_step=3)


@pytest.mark.parametrize(("n", "seeds", "reach", "most"), [(60, 12, 14.0, 3.0), (60, 1, 24.0, 1.0), (48, 27, 8.0, 5.0)])
def test_a_file_of_surfaces_is_a_few_times_the_size_of_its_image(tmp_path, n, seeds, reach, most):
    image = cells(n, seeds, reach).astype(np.uint16)
    vg.save(vg.packing_of_labels(image, voxel_size=1.0, gravity="none"), tmp_path / "labels.vtp")
    assert (tmp_path / "labels.vtp").stat().st_size < most * image.nbytes


def test_a_triangle_of_a_label_takes_eighteen_bytes():
    image = np.zeros((60, 60, 60), dtype=np.uint8)
    image[((np.indices(image.shape) - 29.5) ** 2).sum(axis=0) < 24**2] = 1
    (shape,) = vg.load_labels(image, voxel_size=1.0)
    tracemalloc.start()
    kept = [vg.load_labels(image, voxel_size=1.0) for _ in range(8)]
    each = tracemalloc.get_traced_memory()[0] / len(kept)
    tracemalloc.stop()
    # three corners in 16 bits, and half a vertex
    assert each < 19 * len(shape.geometry.corners)
