"""The benchmark of the pore space, small."""

import math

import pytest

import voxgran as vg
from benchmarks.images.voids import cubic_lattice, mean_chords, measured, polyhedra


def test_mean_chords_of_spheres_are_those_of_their_surface():
    packing = cubic_lattice(2)
    surface = 8 * math.pi
    assert vg.verify(packing).ok
    assert mean_chords(packing) == pytest.approx([4 * (8 - packing.volumes.sum()) / surface] * 3)


def test_mean_chords_of_a_cube_differ_from_axis_to_axis():
    brick = vg.Packing.of(
        vg.make_shape("box", lengths=(1, 2, 3)), vg.Box((4, 4, 4), periodic="xyz"), position=[(2, 2, 2)]
    )
    assert mean_chords(brick) == pytest.approx([58 / 6, 58 / 3, 58 / 2])


def test_errors_of_a_lattice_decrease_with_the_voxel():
    coarse, fine = measured("cubic lattice", cubic_lattice(1), math.sqrt(3) - 1, resolutions=(10, 40))
    assert (coarse[0], coarse[1], fine[1]) == ("cubic lattice", 10, 40)
    assert fine[3] < coarse[3] / 3
    assert fine[5] < coarse[5] / 2 < 0.01
    assert fine[6] == pytest.approx(0, abs=1e-12)


def test_rows_of_polyhedra_know_no_largest_pore():
    packing = polyhedra(8, 3)
    assert vg.verify(packing).ok
    (row,) = measured("polyhedra", packing, None, resolutions=(20,))
    assert row[5] is None
    # the stated error is one standard error
    assert row[3] < 4 * row[4]
