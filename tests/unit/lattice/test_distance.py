"""Distances against brute force and SciPy, bit for bit."""

import numpy as np
import pytest
from kit import slow
from scipy.ndimage import distance_transform_edt

from voxgran._base.errors import InputError, TooLargeError
from voxgran._base.seeds import stream
from voxgran.lattice import distance as module
from voxgran.lattice.distance import NEVER, distance_transform, inside_distance

TURNS = [(False, False, False), (True, False, False), (False, True, False), (False, False, True), (True, True, True)]


def brute(mask, periodic):
    """Return the least squared distances from free voxels and their images: the plain twin."""
    free = np.argwhere(~mask)
    least = np.full(mask.shape, NEVER)
    for voxel in np.ndindex(mask.shape):
        step = np.abs(free - voxel)
        for axis, turn in enumerate(periodic):
            if turn:
                step[:, axis] = np.minimum(step[:, axis], mask.shape[axis] - step[:, axis])
        least[voxel] = (step**2).sum(axis=1).min(initial=NEVER)
    return least


@pytest.fixture(params=[40.0, 0.0, 1e9], ids=["as chosen", "envelope", "neighbours"])
def far(request, monkeypatch):
    monkeypatch.setattr(module, "LONG", request.param)


@pytest.mark.usefixtures("far")
@pytest.mark.parametrize("periodic", TURNS)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 9), (9, 1, 1), (2, 3, 4), (11, 9, 13), (3, 5, 70)])
@pytest.mark.parametrize("share", [0.3, 0.98, 1.0])
def test_squares_are_those_of_a_search(shape, share, periodic):
    mask = stream(1, "mask", shape[2]).random(shape) < share
    found = distance_transform(mask, periodic=periodic, squared=True)
    assert found.dtype == np.int32
    assert np.array_equal(found, brute(mask, periodic))


@pytest.fixture(scope="module")
def large():
    """Return masks of large images, each with its squared distances by SciPy."""
    x, y, z = np.indices((120, 90, 150))
    sphere = (x - 60) ** 2 + (y - 40) ** 2 + (z - 80) ** 2 < 38**2
    masks = sphere, ~sphere, stream(2, "noise").random(sphere.shape) < 0.999
    return [(mask, np.round(distance_transform_edt(mask) ** 2).astype(np.int32)) for mask in masks]


@pytest.mark.usefixtures("far")
@pytest.mark.parametrize("threads", [1, slow(2), 7])
def test_large_images_are_bit_identical_to_scipy(large, threads):
    for mask, expected in large:
        assert np.array_equal(distance_transform(mask, squared=True, threads=threads), expected)


@pytest.mark.usefixtures("far")
def test_periodic_images_are_those_of_27_copies():
    mask = stream(3, "noise").random((40, 33, 47)) < 0.9995
    tiled = np.round(distance_transform_edt(np.tile(mask, (3, 3, 3))) ** 2).astype(np.int32)
    middle = tiled[40:80, 33:66, 47:94]
    assert np.array_equal(distance_transform(mask, periodic=(True, True, True), squared=True), middle)


def test_roots_and_where_they_are_written():
    mask = stream(4, "mask").random((9, 8, 7)) < 0.8
    squares = distance_transform(mask, squared=True)
    roots = distance_transform(mask)
    assert roots.dtype == np.float32
    assert np.array_equal(roots, np.sqrt(squares).astype(np.float32))
    out = np.zeros(mask.shape)
    assert distance_transform(mask.astype(np.uint8), out=out) is out
    assert np.array_equal(out, np.sqrt(squares))
    whole = np.zeros(mask.shape, dtype=np.int32)
    assert distance_transform(mask, squared=True, out=whole) is whole
    assert np.array_equal(whole, squares)
    assert np.isinf(distance_transform(np.ones((2, 3, 4), dtype=bool))).all()


def test_bad_input_is_refused():
    mask = np.ones((3, 4, 5), dtype=bool)
    with pytest.raises(InputError, match="three axes"):
        distance_transform(mask[0])
    with pytest.raises(InputError, match="labels"):
        distance_transform(np.full((2, 2, 2), 3))
    with pytest.raises(InputError, match="out"):
        distance_transform(mask, out=np.zeros((3, 4, 4)))
    with pytest.raises(InputError, match="out"):
        distance_transform(mask, squared=True, out=np.zeros((3, 4, 5)))
    with pytest.raises(InputError, match="threads"):
        distance_transform(mask, threads=0)
    with pytest.raises(TooLargeError, match="diagonal"):
        distance_transform(np.ones((40_000, 1, 1), dtype=bool))


def test_distance_is_that_to_the_nearest_free_center_less_half_a_voxel():
    mask = stream(1, "mask").random((7, 6, 5)) < 0.7
    distance = inside_distance(mask, 0.5)
    free = np.argwhere(~np.pad(mask, 1)) - 1
    for voxel in np.argwhere(mask):
        nearest = np.sqrt(((free - voxel) ** 2).sum(axis=1)).min()
        assert distance[tuple(voxel)] == pytest.approx((nearest - 0.5) * 0.5, rel=1e-12)
    assert (distance[~mask] == 0).all()


def test_beyond_the_lattice_is_free():
    distance = inside_distance(np.ones((5, 5, 5), dtype=bool), 1.0)
    assert distance[2, 2, 2] == 2.5
    assert distance[0, 2, 2] == 0.5
