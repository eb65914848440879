"""Near pairs against all pairs and all images."""

import itertools

import numpy as np
import pytest
from kit import slow

from voxgran._base.compiling.threads import using_threads
from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.geometry import sphere_pairs
from voxgran.geometry.sphere_pairs import near_pairs, spheres_near

LENGTHS = np.array([1.0, 1.3, 1.7])


def periods(periodic, tilt=(0.0, 0.0, 0.0)):
    vectors = np.diag(np.where(periodic, LENGTHS, 0.0))
    vectors[np.tril_indices(3, -1)] = tilt
    return vectors


def all_pairs(centers, radii, gap, vectors):
    found = set()
    for image in itertools.product(*[range(-5, 6) if length else [0] for length in vectors.diagonal()]):
        shift = np.array(image) @ vectors
        apart = np.linalg.norm(centers[None] + shift - centers[:, None], axis=2) - radii[:, None] - radii
        for i, j in np.argwhere(apart <= gap):
            if i < j or (i == j and image > (0, 0, 0)):
                found.add((int(i), int(j), *image))
    return found


@pytest.mark.parametrize("periodic", [(False, False, False), (True, True, False), (True, True, True)])
@pytest.mark.parametrize(("count", "largest"), [(60, 0.3), slow(200, 0.05), (3, 0.8), (1, 0.9)])
def test_pairs_are_all_pairs(periodic, count, largest):
    random = stream(0, "pairs", count)
    centers, radii = random.random((count, 3)) * 3 - 1, random.random(count) * largest
    i, j, image = near_pairs(centers, radii, 0.01, lower=np.array([0.1, 0, 0]), periods=periods(periodic))
    found = [(int(a), int(b), *map(int, c)) for a, b, c in zip(i, j, image, strict=True)]
    assert len(found) == len(set(found))
    assert set(found) == all_pairs(centers, radii, 0.01, periods(periodic))


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_threads_find_the_same_pairs(monkeypatch, threads):
    random = stream(0, "pairs of threads")
    spheres = random.random((200, 3)), np.where(np.arange(200) % 4, 0.05, 0.005)
    alone = near_pairs(*spheres, 0.1)
    monkeypatch.setattr(sphere_pairs, "BLOCK", 7)
    with using_threads(threads):
        for found, expected in zip(near_pairs(*spheres, 0.1), alone, strict=True):
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("tilt", [(0.5, 0.3, -0.65), (-0.2, 0.0, 0.0), (0.0, 0.0, 0.4)])
def test_pairs_in_a_tilted_cell_are_all_pairs(tilt):
    random = stream(0, "pairs", 1)
    centers, radii = random.random((50, 3)) * 3 - 1, random.random(50) * 0.3
    vectors = periods((True, True, True), tilt)
    i, j, image = near_pairs(centers, radii, 0.01, lower=np.array([0.1, 0, 0]), periods=vectors)
    found = [(int(a), int(b), *map(int, c)) for a, b, c in zip(i, j, image, strict=True)]
    assert found == sorted(found)
    assert set(found) == all_pairs(centers, radii, 0.01, vectors)


@pytest.mark.parametrize("periodic", [(False, False, False), slow((True, True, True))])
@pytest.mark.parametrize("gap", [slow(0.0), slow(-0.001), 0.05])
def test_pairs_of_sizes_of_all_magnitudes(periodic, gap):
    random = stream(0, "pairs of all magnitudes")
    centers, radii = random.random((300, 3)) * 3 - 1, 0.5 * 10 ** (-6 * random.random(300))
    i, j, image = near_pairs(centers, radii, gap, lower=np.array([0.1, 0, 0]), periods=periods(periodic))
    found = [(int(a), int(b), *map(int, c)) for a, b, c in zip(i, j, image, strict=True)]
    assert len(found) == len(set(found))
    assert set(found) == all_pairs(centers, radii, gap, periods(periodic))
    assert np.array_equal(np.lexsort((j, i)), np.arange(len(i)))


def test_no_spheres_no_pairs():
    i, j, image = near_pairs(np.zeros((0, 3)), np.zeros(0), 0.0, periods=periods(True))
    assert len(i) == len(j) == len(image) == 0


@pytest.mark.parametrize(("radius", "gap"), [(0.1, 1e3), (1e9, 0.0), (0.1, 40.0)])
def test_images_beyond_counting_are_refused_before_the_search(radius, gap):
    box = {"periods": periods(True)}
    with pytest.raises(InputError, match="periodic images: there must be at most 10000"):
        near_pairs(np.full((2, 3), 0.5), np.array([0.1, radius]), gap, **box)
    with pytest.raises(InputError, match="periodic images"):
        spheres_near(np.zeros((1, 3)), np.full(1, gap), np.full((1, 3), 0.5), np.full(1, radius), **box)
    # on open axes there are none
    pairs = near_pairs(np.full((2, 3), 0.5), np.array([0.1, radius]), gap)
    assert len(pairs[0]) == 1
