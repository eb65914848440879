"""Voxels with three edges: distances, morphology, thickness and resampling against plain twins and cubic images."""

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.seeds import stream
from voxgran.lattice.image import Image, known_edges

EDGES = (0.1, 0.13, 0.25)
BAD = [(1.0, 2.0), (1, 1, 1, 1), 0.0, (1.0, 0.0, 1.0), np.nan, (1, np.nan, 1), -1.0, "thin", np.inf]


def brute(mask, edges, periodic=""):
    """Return the least distances from free voxels and their images: the plain twin."""
    free = np.argwhere(~mask)
    found = np.full(mask.shape, np.inf)
    for voxel in np.ndindex(mask.shape):
        step = np.abs(free - voxel)
        for axis in range(3):
            if "xyz"[axis] in periodic:
                step[:, axis] = np.minimum(step[:, axis], mask.shape[axis] - step[:, axis])
        found[voxel] = np.linalg.norm(step * edges, axis=1).min(initial=np.inf)
    return found


@pytest.mark.parametrize("periodic", ["", "x", "yz", "xyz"])
@pytest.mark.parametrize("edges", [EDGES, (0.25, 0.1, 0.1), 0.3, (0.3, 0.3, 0.3)])
def test_distances_are_those_of_a_search(edges, periodic):
    for shape, share in (((7, 8, 5), 0.97), ((1, 6, 11), 0.9), ((3, 2, 4), 1.0)):
        mask = stream(1, "mask", shape[2]).random(shape) < share
        expected = brute(mask, np.broadcast_to(edges, 3), periodic)
        found = vg.distance_transform(mask, voxel_size=edges, periodic=periodic)
        assert found.dtype == np.float32
        np.testing.assert_allclose(found, expected, rtol=1e-6)
        out = np.zeros(shape)
        assert vg.distance_transform(mask, voxel_size=edges, periodic=periodic, out=out) is out
        np.testing.assert_allclose(out, expected, rtol=1e-12)


@pytest.mark.parametrize("edges", [EDGES, 0.2])
def test_morphology_is_that_of_a_search(edges):
    mask = stream(2, "mask").random((8, 9, 6)) < 0.85
    radius = 2 * np.max(edges)
    sizes = np.broadcast_to(edges, 3)

    def dilated(taken):
        return brute(~taken, sizes, "y") <= radius * (1 + 1e-9)

    options = {"voxel_size": edges, "periodic": "y"}
    eroded = ~dilated(~mask)
    assert np.array_equal(vg.dilation(~mask, radius, **options), dilated(~mask))
    assert np.array_equal(vg.erosion(mask, radius, **options), eroded)
    assert np.array_equal(vg.opening(mask, radius, **options), dilated(eroded))
    assert np.array_equal(vg.closing(~mask, radius, **options), ~dilated(~dilated(~mask)))


def sphere(edges, diameter=2.0, room=2.6):
    """Return the mask of a sphere in a cube of edge `room`."""
    counts = np.rint(room / np.asarray(edges)).astype(int)
    places = [(np.arange(n) + 0.5) * edge - room / 2 for n, edge in zip(counts, edges, strict=True)]
    x, y, z = np.meshgrid(*places, indexing="ij")
    return x**2 + y**2 + z**2 < (diameter / 2) ** 2


def test_thickness_is_a_length():
    mask = sphere((0.1, 0.1, 0.1))
    assert np.allclose(vg.local_thickness(mask, voxel_size=0.1), 0.1 * vg.local_thickness(mask), rtol=1e-6)
    flat = sphere((0.1, 0.1, 0.2))
    found = vg.local_thickness(flat, voxel_size=(0.1, 0.1, 0.2))
    assert np.array_equal(found > 0, flat)
    assert np.median(found[flat]) == pytest.approx(2.0, abs=0.25)
    # two voxels along z are one, so that the cubic image is known to the bit
    cubes = flat.repeat(2, axis=2)
    assert np.array_equal(found, vg.local_thickness(cubes, voxel_size=0.1)[:, :, 1::2])
    slab = np.zeros((9, 4, 6), dtype=bool)
    slab[2:6] = True
    assert set(np.unique(vg.local_thickness(slab, voxel_size=(0.25, 0.1, 0.17))[slab])) == {1.0}


def test_cubes_of_the_smallest_edge():
    labels = stream(3, "labels").integers(0, 300, (4, 5, 6)).astype(np.uint16)
    cubes = vg.resample(labels, to="cubic", voxel_size=(0.1, 0.3, 0.2), method="nearest")
    assert cubes.dtype == np.uint16
    assert np.array_equal(cubes, labels.repeat(3, 1).repeat(2, 2))
    # 5 voxels of 0.25 are 12.5 cubes of 0.1: 12, of which the third is half in the second voxel
    grey = np.arange(5.0).reshape(1, 1, 5)
    found = vg.resample(grey, to="cubic", voxel_size=(0.1, 0.1, 0.25))[0, 0]
    assert found.tolist() == [0, 0, 0.5, 1, 1, 2, 2, 2.5, 3, 3, 4, 4]
    near = vg.resample(grey, to="cubic", voxel_size=(0.1, 0.1, 0.25), method="nearest")[0, 0]
    assert near.tolist() == [0, 0, 1, 1, 1, 2, 2, 3, 3, 3, 4, 4]
    # 3 voxels of 0.16 are 4.8 cubes: the last one reaches beyond the image and has the mean of its part within
    last = vg.resample(np.arange(3.0).reshape(1, 1, 3), to="cubic", voxel_size=(0.1, 0.1, 0.16))[0, 0]
    np.testing.assert_allclose(last, [0, 0.4, 1, 1.8, 2], atol=1e-12)


def test_factors_of_three_axes_and_images_stay_images():
    mask = stream(4, "mask").random((4, 6, 3)) < 0.5
    assert np.array_equal(vg.resample(mask, factor=(1, 0.5, 2)), mask.reshape(4, 3, 2, 3).mean(axis=2).repeat(2, 2))
    image = Image(mask, (0.1, 0.1, 0.25), origin=(1.0, 2.0, 3.0), unit="mm")
    made = vg.resample(image, factor=(1, 0.5, 2))
    np.testing.assert_allclose(made.voxel_size, (0.1, 0.2, 0.125))
    assert (made.origin, made.unit, made.values.shape) == ((1.0, 2.0, 3.0), "mm", (4, 3, 6))
    assert vg.resample(image, to="cubic").voxel_size == (0.1, 0.1, 0.1)
    assert vg.resample(Image(mask), shape=(2, 2, 2)).voxel_size is None
    assert isinstance(vg.resample(mask, to="cubic", voxel_size=EDGES), np.ndarray)


def test_the_edges_of_an_image_are_the_default():
    mask = stream(5, "mask").random((9, 8, 7)) < 0.8
    image = Image(mask, EDGES)
    for function, rest in (
        (vg.distance_transform, ()),
        (vg.local_thickness, ()),
        *((function, (0.25,)) for function in (vg.dilation, vg.erosion, vg.opening, vg.closing)),
    ):
        told = function(image, *rest)
        assert np.array_equal(told, function(mask, *rest, voxel_size=EDGES))
        assert np.array_equal(function(image, *rest, voxel_size=1.0), function(mask, *rest))
        assert not np.array_equal(told, function(mask, *rest))


@pytest.mark.parametrize("value", BAD)
def test_edges_that_are_no_lengths_are_refused(value):
    mask = np.pad(np.ones((2, 2, 2), dtype=bool), 1)
    for call in (
        lambda: vg.distance_transform(mask, voxel_size=value),
        lambda: vg.local_thickness(mask, voxel_size=value),
        lambda: vg.closing(mask, 1.0, voxel_size=value),
        lambda: vg.resample(mask, to="cubic", voxel_size=value),
        lambda: vg.load_labels(mask.astype(int), voxel_size=value),
    ):
        with pytest.raises(InputError, match=r"voxel_size is .* above 0; give one or three"):
            call()


def test_what_does_not_fit_together_is_refused():
    mask = np.ones((2, 2, 2), dtype=bool)
    with pytest.raises(InputError, match=r"squared is True and voxel_size is \(0.5, 0.5, 0.5\)"):
        vg.distance_transform(mask, voxel_size=0.5, squared=True)
    with pytest.raises(InputError, match="does not tell it"):
        vg.resample(mask, to="cubic")
    with pytest.raises(InputError, match="to is 'fine'"):
        vg.resample(mask, to="fine", voxel_size=1.0)
    with pytest.raises(InputError, match="exactly one"):
        vg.resample(mask, to="cubic", factor=2.0, voxel_size=1.0)
    assert known_edges(None, mask) is None


@pytest.mark.parametrize("edges", [(1.0, 1.0, 1e9), (1.0, 1e5, 1.0), (1e-5, 1.0, 1.0)])
def test_thickness_of_edges_that_differ_too_much_is_refused_before_cubes_are_made(edges):
    mask = np.zeros((4, 4, 4), dtype=bool)
    mask[1:3, 1:3, 1:3] = True
    with pytest.raises(TooLargeError, match=r"voxel_size is \(.*cut the mask"):
        vg.local_thickness(mask, voxel_size=edges)
