"""Maps of feasible places against FFT correlation and against plain tries."""

import numpy as np
import pytest
from scipy.signal import fftconvolve

from voxgran._base.seeds import stream
from voxgran.packing.digital.bit_columns import mask_of_words
from voxgran.packing.digital.feasible_places import (
    Room,
    add_table,
    blocked_map,
    blocked_sides,
    count_contacts,
    nth_of_contacts,
    overlap_table,
    places_with,
    runs_of,
)

CASES = [((5, 4, 6), (3, 3, 2)), ((2, 7, 70), (4, 3, 75)), ((6, 2, 130), (1, 1, 1)), ((3, 3, 64), (5, 5, 64))]


def random_box(shape, *index):
    """Return a mask that fills its box."""
    mask = stream(1, "places", *index).random(shape) < 0.5
    mask[0, 0, 0] = mask[-1, -1, -1] = True
    return mask


@pytest.mark.parametrize("case", range(len(CASES)))
def test_tables_are_the_correlation_of_the_voxels(case):
    here, there = (random_box(shape, case, k) for k, shape in enumerate(CASES[case]))
    low_here, low_there = np.array([-2, 1, -30]), np.array([0, -3, 5])
    table = overlap_table(here, low_here, there, low_there)
    expected = fftconvolve(here.astype(float), there[::-1, ::-1, ::-1].astype(float)) > 0.5
    assert np.array_equal(mask_of_words(table.words, table.size[2]), expected)
    # the lowest difference: the lowest voxel of one at the highest of the other
    assert np.array_equal(table.low, low_here - (low_there + np.array(there.shape) - 1))


def test_runs_are_those_of_the_mask():
    mask = random_box((4, 5, 9), 7)
    again = np.zeros_like(mask)
    for x, y, z, length in runs_of(mask):
        assert not again[x, y, z : z + length].any()
        again[x, y, z : z + length] = True
    assert np.array_equal(again, mask)


@pytest.mark.parametrize("periodic", [(0, 0, 0), (1, 0, 0), (0, 1, 1), (1, 1, 1)])
def test_maps_are_those_of_plain_tries(periodic):
    shape, grain, low = np.array([9, 8, 70]), random_box((3, 2, 4), 11), np.array([-1, -1, -2])
    taken = stream(2, "taken").random(tuple(shape)) < 0.05
    turns = np.array(periodic, dtype=np.int64)
    places = shape + 1 - turns
    room = Room(places, int(-(-places[2] // 64)), turns)
    words = blocked_map(room, taken, low, grain, shape)
    other, other_low, at = random_box((2, 3, 3), 12), np.array([-1, -2, -1]), np.array([1, 7, 69])
    add_table(words, room, overlap_table(other, other_low, grain, low), at)
    for voxel in np.argwhere(other) + other_low + at:
        voxel = np.where(turns, voxel % shape, voxel)
        if (voxel >= 0).all() and (voxel < shape).all():
            taken[tuple(voxel)] = True
    # without walls voxels beyond the lattice count too: they block places that the walls block anyway
    expected = np.zeros(tuple(places), dtype=bool)
    for place in np.ndindex(*places):
        voxels = np.argwhere(grain) + low + np.array(place)
        wrapped = np.where(turns, voxels % shape, voxels)
        outside = (wrapped < 0).any() or (wrapped >= shape).any()
        expected[place] = outside or taken[tuple(wrapped.T)].any()
    assert np.array_equal(mask_of_words(words, places[2]), expected)


@pytest.mark.parametrize("periodic", [(0, 0, 0), (1, 0, 1)])
def test_contacts_are_counted_side_by_side(periodic):
    turns = np.array(periodic, dtype=np.int64)
    places = np.array([4, 5, 70])
    blocked = stream(3, "blocked").random(tuple(places)) < 0.6
    words = np.full((4, 2, 5), np.uint64(0xFFFFFFFFFFFFFFFF))
    padded = np.pad(blocked, ((0, 0), (0, 0), (0, 58)), constant_values=True)
    words[...] = np.packbits(padded, axis=2, bitorder="little").view(np.uint64).transpose(0, 2, 1)

    def sides_of(place, axes=(0, 1, 2)):
        sides = 0
        for axis in axes:
            for step in (-1, 1):
                there = np.array(place)
                there[axis] += step
                if turns[axis]:
                    there %= places
                sides += (there < 0).any() or (there >= places).any() or bool(blocked[tuple(there)])
        return sides

    free = [tuple(p) for p in np.argwhere(~blocked)]
    histogram = np.zeros(7, dtype=np.int64)
    for first, last in ((0, 1), (1, 4)):
        count_contacts(words, turns, places, histogram, first, last)
    expected = np.bincount([sides_of(p) for p in free], minlength=7)
    assert np.array_equal(histogram, expected)
    place, seen = np.zeros(3, dtype=np.int64), set()
    for rank in range(expected[4]):
        left = nth_of_contacts(words, turns, places, 4, rank, place, 0, 1)
        if left >= 0:
            left = nth_of_contacts(words, turns, places, 4, left, place, 1, 4)
        assert left == -1
        seen.add(tuple(place.tolist()))
    assert seen == {p for p in free if sides_of(p) == 4}
    for axis, level in ((0, 2), (1, 0), (2, 65)):
        own = [p for p in free if p[axis] == level]
        across = [k for k in range(3) if k != axis]
        sides = blocked_sides(words, level, axis, Room(places, 2, turns))
        best = int(sides.max())
        scores = [sides_of(p, across) for p in own]
        assert best == max(scores)
        seen = [tuple(place) for place in places_with(sides, best, level, axis).tolist()]
        order = sorted(seen, key=lambda p: (p[0], p[2] // 64, p[1], p[2]))
        assert seen == order == [p for p in order if p in own]
        assert set(seen) == {p for p, score in zip(own, scores, strict=True) if score == best}
    full = np.full_like(words, np.uint64(0xFFFFFFFFFFFFFFFF))
    assert (blocked_sides(full, 2, 0, Room(places, 2, turns)) == -1).all()
