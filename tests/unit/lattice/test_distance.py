import numpy as np
import pytest

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.lattice.distance import inside_distance
from voxgran.lattice.label import connected_components


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


def flood(mask, reach):
    """Number the bodies one voxel at a time: the plain twin."""
    label = np.zeros(mask.shape, dtype=int)
    steps = [s for s in np.ndindex(3, 3, 3) if 0 < np.abs(np.array(s) - 1).sum() <= reach]
    count = 0
    for start in map(tuple, np.argwhere(mask)):
        if label[start]:
            continue
        count += 1
        label[start], waiting = count, [start]
        while waiting:
            here = waiting.pop()
            for step in steps:
                there = tuple(h + s - 1 for h, s in zip(here, step, strict=True))
                inside = all(0 <= t < n for t, n in zip(there, mask.shape, strict=True))
                if inside and mask[there] and not label[there]:
                    label[there] = count
                    waiting.append(there)
    return label, count


@pytest.mark.parametrize(("connectivity", "reach"), [(6, 1), (18, 2), (26, 3)])
def test_bodies_are_those_of_a_flood(connectivity, reach):
    mask = stream(2, "mask").random((8, 7, 6)) < 0.3
    labels, count = connected_components(mask, connectivity=connectivity)
    expected, many = flood(mask, reach)
    assert count == many
    assert np.array_equal(labels, expected)


def test_an_unknown_connectivity_is_refused():
    with pytest.raises(InputError, match="connectivity"):
        connected_components(np.ones((2, 2, 2), dtype=bool), connectivity=8)
