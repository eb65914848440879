"""Two-point correlation and chord lengths of images, against plain loops and closed forms."""

import itertools

import numpy as np
import pytest

import voxgran as vg


def test_against_plain_loops():
    mask = np.random.default_rng(0).random((7, 6, 9)) < 0.6
    edges = (1.0, 0.5, 2.0)
    for axis, periodic in itertools.product(range(3), (False, True)):
        lines = np.moveaxis(mask, axis, 2).reshape(-1, mask.shape[axis])
        n = lines.shape[1]
        lengths, shares = vg.two_point_correlation(mask, voxel_size=edges, periodic=periodic)[axis]
        assert lengths.tolist() == (np.arange(n // 2 + 1) * edges[axis]).tolist()
        for lag in range(n // 2 + 1):
            many = n if periodic else n - lag
            both = [line[k] and line[(k + lag) % n] for line in lines for k in range(many)]
            assert shares[lag] == pytest.approx(np.mean(both))
        chords = []
        for line in lines:
            if periodic and line.all():
                continue
            turned = np.roll(line, -int(np.argmin(line))) if periodic else line
            runs = [(key, len(list(group))) for key, group in itertools.groupby(turned)]
            inner = runs if periodic else runs[1:-1]
            chords += [length * edges[axis] for key, length in inner if key]
        found = vg.chord_lengths(mask, voxel_size=edges, periodic=periodic)[axis]
        assert sorted(found.tolist()) == sorted(chords)


def test_a_sphere_and_nothing():
    # mean chord 2 d / 3, and the slope of the correlation: projected area over the volume
    x = np.arange(48) - 23.5
    sphere = x[:, None, None] ** 2 + x[:, None] ** 2 + x**2 < 20**2
    for chords in vg.chord_lengths(sphere):
        assert chords.mean() == pytest.approx(80 / 3, rel=0.01)
    for lengths, shares in vg.two_point_correlation(sphere, voxel_size=(1, 2, 3), periodic=True):
        assert (shares[0] - shares[1]) / lengths[1] == pytest.approx(np.pi * 400 / 48**3 / lengths[1], rel=0.01)
    empty = np.zeros((2, 3, 4), bool)
    assert [len(chords) for chords in vg.chord_lengths(empty)] == [0] * 3
    assert [len(chords) for chords in vg.chord_lengths(~empty, periodic=True)] == [0] * 3
    assert [shares.tolist() for _, shares in vg.two_point_correlation(~empty)] == [[1.0] * 2, [1.0] * 2, [1.0] * 3]
