"""How good a segmentation is: necks against closed forms, merging against h-maxima, grains of anisotropic images."""

import numpy as np
import pytest
from scipy import ndimage

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.lattice import segment as segmenting
from voxgran.lattice.distance import distance_transform
from voxgran.lattice.image import Image
from voxgran.lattice.necks import Basins, Pairs, basins_from, merged, pairs_of, tally, touching

morphology = pytest.importorskip("skimage.morphology")


def spheres(middles, radii, shape, edges=(1.0, 1.0, 1.0)):
    """Return the union of spheres as grey values of 0 and 1; lengths are in the unit of the edges."""
    places = (np.moveaxis(np.indices(shape), 0, -1) + 0.5) * edges
    solid = np.zeros(shape)
    for middle, radius in zip(middles, radii, strict=True):
        solid[np.linalg.norm(places - middle, axis=-1) < radius] = 1.0
    return solid


def test_the_neck_of_two_spheres_has_the_diameter_of_their_circle():
    for edge in (1.0, 0.05):
        grey = spheres([(14, 14, 14), (32, 14, 14)], [12.0, 10.0], (46, 28, 28))
        found = vg.segment(grey, threshold=0.5, voxel_size=edge)
        # the plane of the circle lies at x from the first center
        x = (18**2 + 12**2 - 10**2) / (2 * 18)
        circle = 2 * np.sqrt(12**2 - x**2)
        assert found.necks.sizes["neck"] == 1
        assert float(found.necks["diameter"][0]) == pytest.approx(circle * edge, abs=1.5 * edge)
        assert float(found.necks["ratio"][0]) == pytest.approx(circle / 20, abs=0.08)
        assert not found.suspects.sizes["neck"]


@pytest.mark.parametrize("periodic", [(False, False, False), (True, False, True)])
@pytest.mark.parametrize("faces", [1, 2, 5])
def test_labels_touch_that_share_faces_enough(periodic, faces):
    image = np.random.default_rng(0).integers(0, 9, (4, 5, 6)).astype(np.int32)
    shared = np.zeros((9, 9), dtype=int)
    for place in np.ndindex(image.shape):
        for axis in range(3):
            ahead = list(place)
            ahead[axis] += 1
            if ahead[axis] == image.shape[axis]:
                if not periodic[axis]:
                    continue
                ahead[axis] = 0
            pair = image[place], image[tuple(ahead)]
            if 0 < pair[0] != pair[1] > 0:
                shared[pair] += 1
    expected = (shared + shared.T >= faces).sum(axis=0)
    assert 0 < expected.sum() < 9 * 8
    assert touching(image, periodic, faces=faces).tolist() == expected.tolist()


def test_of_a_void_image_nothing_touches():
    assert touching(np.zeros((3, 3, 3), dtype=np.int32), (False,) * 3, faces=1).tolist() == [0]


def test_a_waist_is_suspect_and_so_is_what_was_merged():
    # a waist of 0.8 is parted, and may be one grain
    reach = 2 * np.sqrt(12**2 - 9.6**2)
    waist = spheres([(14, 14, 14), (14 + reach, 14, 14)], [12.0, 12.0], (44, 28, 28))
    found = vg.segment(waist, threshold=0.5)
    assert found.max() == 2
    assert found.suspects["grain"].values.tolist() == [1]
    assert found.suspects["other"].values.tolist() == [2]
    # spheres that hardly touch, taken for one grain
    apart = spheres([(12, 12, 12), (31, 12, 12)], [10.0, 10.0], (43, 24, 24))
    assert not vg.segment(apart, threshold=0.5).suspects.sizes["neck"]
    one = vg.segment(apart, threshold=0.5, separation=15.0)
    assert one.max() == 1
    assert one.suspects["grain"].values.tolist() == one.suspects["other"].values.tolist() == [1]
    assert float(one.suspects["ratio"][0]) < 0.5
    assert "suspects=1" in repr(one)


@pytest.mark.parametrize("decrease", [0.7, 1.5, 3.0])
def test_basins_merge_as_the_markers_of_h_maxima(decrease):

    from skimage.segmentation import watershed

    generator = stream(2, "blobs")
    solid = spheres(generator.uniform(4, 36, (60, 3)), generator.uniform(3, 7, 60), (40, 40, 40)) > 0
    distance = distance_transform(np.pad(solid, 1))[1:-1, 1:-1, 1:-1]
    seeds, count = ndimage.label(morphology.local_maxima(distance) & solid, np.ones((3, 3, 3)))
    basins = watershed(-distance, seeds, mask=solid)
    moments, peak = tally(basins, distance, np.zeros(3, dtype=np.int64), count)
    found = basins_from(peak, moments, pairs_of(basins, distance), [])
    root, joined, _, _ = merged(found, decrease=decrease, share=0.0)
    # basins meet at faces, in the twin also at edges: joined there it can only have fewer
    _, twin = ndimage.label(morphology.h_maxima(distance, decrease, ndimage.generate_binary_structure(3, 1)))
    assert len(np.unique(root[1:])) == pytest.approx(twin, abs=2)
    assert len(np.unique(root[1:])) + len(joined.one) == count


def moments_of(middles, radii):
    """Return the moments of spheres, (n + 1, 10), of which the first entry is the void."""
    moments, pairs = np.zeros((len(radii) + 1, 10), dtype=np.int64), ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    for row, middle, radius in zip(moments[1:], middles, radii, strict=True):
        places = np.argwhere(spheres([middle], [radius], (90, 30, 30)) > 0)
        row[:4] = [len(places), *places.sum(axis=0)]
        row[4:] = [(places[:, p] * places[:, q]).sum() for p, q in pairs]
    return moments


def test_grains_merge_from_the_widest_neck_on():
    pairs = Pairs(np.array([1, 2, 3]), np.array([2, 3, 4]), np.array([[9.5, 9.5], [8.0, 8.0], [3.0, 3.0]]))
    peak = np.repeat([[0], [10], [10.0], [8.5], [5.0]], 2, axis=1)
    # one upon the other: nothing but the necks parts them
    found = Basins(peak, moments_of([(14, 14, 14)] * 4, [8.0] * 4), pairs)
    root, joined, ratios, excess = merged(found, decrease=None, share=0.9)
    assert root[1] == root[2] == root[3] != root[4]
    assert joined.neck[:, 0].tolist() == [9.5, 8.0]
    np.testing.assert_allclose(ratios, [0.95, 8.0 / 8.5])
    np.testing.assert_allclose(excess, -1.0)


def test_the_excess_of_touching_spheres_and_of_halves_of_one_is_that_in_closed_form():
    pair = Pairs(np.array([1]), np.array([2]), np.array([[9.0, 9.0]]))
    touching = Basins(np.full((3, 2), 10.0), moments_of([(14, 14, 14), (34, 14, 14)], [10.0, 10.0]), pair)
    ratio, excess = touching.alike(pair)
    # the moments along the line of centers are 6 times those of a sphere
    assert (float(ratio[0]), float(excess[0])) == pytest.approx((0.9, np.sqrt(6) - 2), abs=0.01)
    # the neck alone would make them one
    assert len(merged(touching, decrease=None, share=0.85)[1].one) == 0
    assert len(merged(touching, decrease=2.0, share=0.85)[1].one) == 1
    both = spheres([(14, 14, 14)], [12.0], (28, 28, 28)).astype(np.int32)
    both[14:] *= 2
    moments, _ = tally(both, both.astype(np.float32), np.array([5, -3, 7]), 2)
    halves = Basins(np.full((3, 2), 10.0), moments, pair)
    # a half has 0.2 - 9 / 64 of the square of the radius along its axis
    half = np.sqrt((0.2 - 9 / 64) / 0.2)
    assert float(halves.alike(pair)[1][0]) == pytest.approx((1 - 2 * half) / half, abs=0.01)


def test_moments_and_largest_distances_are_those_of_numpy():
    generator = stream(4, "labels")
    labels = generator.integers(0, 4, (7, 8, 9)).astype(np.int32)
    distance, start = generator.random((7, 8, 9), dtype=np.float32), np.array([100, -20, 3])
    moments, peak = tally(labels, distance, start, 4)
    for label in range(1, 4):
        x, y, z = (np.argwhere(labels == label) + start).T
        terms = [np.ones_like(x), x, y, z, x * x, y * y, z * z, x * y, x * z, y * z]
        assert moments[label].tolist() == [term.sum() for term in terms]
        assert peak[label] == distance[labels == label].max()
    assert not moments[[0, 4]].any()


def test_a_cap_that_the_border_leaves_is_as_wide_as_its_section():
    labels = np.ones((20, 20, 1), dtype=np.int32)
    labels[10:] = 2
    distance = np.full((20, 20, 1), 3.0, dtype=np.float32)
    distance[10:] = 8.0
    inner = Pairs(np.array([1]), np.array([2]), np.array([2.5]))
    found = basins_from(np.array([0, 3.0, 5.0]), np.ones((3, 10), dtype=np.int64), inner, [(labels, distance)])
    assert found.peak.tolist() == [[0, 0], [3, 3], [5, 8]]
    assert found.pairs.neck.tolist() == [[2.5, 3.0]]


@pytest.fixture(scope="module")
def bed():
    return vg.pack(
        vg.make_shape("sphere"), vg.Box((5, 5, 5)), "jam", count=110, sizes=vg.sizes.lognormal(1.0, 0.2), seed=3
    )


@pytest.mark.slow
def test_the_grains_of_an_anisotropic_image_are_those_of_the_cubic_one(bed):
    cubes = vg.to_image(bed, 0.06, labels=False)[:, :, :82].astype(float)
    # every second slice
    thin = Image(cubes[:, :, ::2], (0.06, 0.06, 0.12))
    fine = vg.segment(cubes, threshold=0.5, voxel_size=0.06)
    coarse = vg.segment(thin, threshold=0.5, min_size=32)
    again = vg.segment(vg.resample(thin, to="cubic"), threshold=0.5)
    assert fine.max() == pytest.approx(bed.count, rel=0.02)
    for other in (coarse, again):
        assert other.max() == pytest.approx(fine.max(), rel=0.03)
        assert float(other.necks["ratio"].median()) == pytest.approx(float(fine.necks["ratio"].median()), abs=0.1)
    assert coarse.voxel_size == (0.06, 0.06, 0.12)
    # a separation is a length
    assert vg.segment(thin, threshold=0.5, min_size=32, separation=fine.separation).max() == pytest.approx(
        fine.max(), rel=0.03
    )
    assert vg.segment(thin, threshold=0.5, min_size=32, separation=0.5).max() < 0.5 * fine.max()


def test_a_segmentation_is_an_image_of_labels_and_works_like_their_array():
    grey = Image(spheres([(14, 14, 14), (32, 14, 14)], [12.0, 10.0], (46, 28, 28)), (0.1, 0.1, 0.1), (1, 2, 3), "mm")
    found = vg.segment(grey, threshold=0.5)
    labels = found.labels
    assert labels.dtype == np.int64
    assert isinstance(found > 0, np.ndarray)
    assert np.array_equal(found == 1, labels == 1)
    assert np.array_equal(2 * found, 2 * labels)
    assert (found.shape, len(found), found[14, 14, 14]) == (labels.shape, 46, labels[14, 14, 14])
    assert np.array_equal(np.unique(found), [0, 1, 2])
    assert (found.origin, found.unit) == ((1, 2, 3), "mm")
    packing = vg.packing_of_labels(found)
    assert packing.count == 2
    assert packing.volumes.sum() == pytest.approx((labels > 0).sum() * 1e-3, rel=0.02)
    with pytest.raises(AttributeError, match="Segmentation has no attribute 'bodies'"):
        getattr(found, "bodies")  # noqa: B009


def test_smoothed_distances_part_grains_where_they_touch(bed, monkeypatch):
    true = vg.to_image(bed, 0.06)[:, :, :82]
    soft = ndimage.gaussian_filter((true > 0).astype(float), 1.5) + stream(3, "noise").normal(0, 0.15, true.shape)
    wrong = {}
    for smooth in (segmenting.SMOOTH, 0.0):
        monkeypatch.setattr(segmenting, "SMOOTH", smooth)
        found = vg.segment(soft)
        both = (found > 0) & (true > 0)
        pairs, counts = np.unique(np.stack([found[both], true[both]]), axis=1, return_counts=True)
        # voxels of a label that are not of its main grain
        wrong[smooth] = counts.sum() - ndimage.maximum(counts, pairs[0], np.unique(pairs[0])).sum()
        if smooth:
            assert found.max() == pytest.approx(bed.count, rel=0.02)
    assert wrong[0.7] < 0.95 * wrong[0.0]
    assert wrong[0.7] < 0.01 * (true > 0).sum()
