"""Connected bodies against a flood and against SciPy."""

import numpy as np
import pytest
from scipy.ndimage import generate_binary_structure, label

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.lattice.label import connected_components

RANKS = [(6, 1), (18, 2), (26, 3)]


def flood(mask, reach, periodic):
    """Number the bodies one voxel at a time: the plain twin."""
    found = np.zeros(mask.shape, dtype=int)
    steps = [s for s in np.ndindex(3, 3, 3) if 0 < np.abs(np.array(s) - 1).sum() <= reach]
    count = 0
    for start in map(tuple, np.argwhere(mask)):
        if found[start]:
            continue
        count += 1
        found[start], waiting = count, [start]
        while waiting:
            here = waiting.pop()
            for step in steps:
                there = tuple(
                    (h + s - 1) % n if turn else h + s - 1
                    for h, s, n, turn in zip(here, step, mask.shape, periodic, strict=True)
                )
                inside = all(0 <= t < n for t, n in zip(there, mask.shape, strict=True))
                if inside and mask[there] and not found[there]:
                    found[there] = count
                    waiting.append(there)
    return found, count


@pytest.mark.parametrize(("connectivity", "reach"), RANKS)
@pytest.mark.parametrize("periodic", [(False,) * 3, (True, False, False), (False, True, True), (True, True, True)])
@pytest.mark.parametrize("shape", [(8, 7, 6), (1, 1, 9), (2, 2, 2), (1, 5, 3), (5, 1, 4)])
def test_bodies_are_those_of_a_flood(connectivity, reach, periodic, shape):
    for k, share in enumerate((0.2, 0.4, 0.7)):
        mask = stream(2, "mask", k).random(shape) < share
        labels, count = connected_components(mask, connectivity=connectivity, periodic=periodic)
        expected, many = flood(mask, reach, periodic)
        assert count == many
        assert np.array_equal(labels, expected)


@pytest.mark.parametrize(("connectivity", "rank"), RANKS)
@pytest.mark.parametrize("share", [0.1, 0.31, 0.6])
def test_large_images_are_labelled_as_scipy_does(connectivity, rank, share):
    mask = stream(3, "mask").random((60, 50, 70)) < share
    labels, count = connected_components(mask, connectivity=connectivity)
    expected, many = label(mask, generate_binary_structure(3, rank))
    assert labels.dtype == np.int32
    assert count == many
    assert np.array_equal(labels, expected)


def test_nothing_and_bad_input():
    assert connected_components(np.zeros((3, 4, 5), dtype=bool))[1] == 0
    with pytest.raises(InputError, match="connectivity"):
        connected_components(np.ones((2, 2, 2), dtype=bool), connectivity=8)
    with pytest.raises(InputError, match="three axes"):
        connected_components(np.ones((2, 2), dtype=bool))
