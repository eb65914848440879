"""When a compression ends: with balance that more iterations confirm, and with each axial stress met."""

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran.settling.stress_balance import evenly

pytestmark = pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")


def loose(count=60, seed=0):
    edge = 5 * (count / 60) ** (1 / 3)
    return vg.pack(vg.shapes.sphere(), vg.Box((edge,) * 3, periodic="xyz"), "rsa", count=count, seed=seed)


@pytest.mark.parametrize("seed", range(3))
def test_each_axial_stress_is_met_to_its_own_hundredth(seed):
    # two layers of a few bars bear any ratio of stresses
    bars = vg.make_shape("box", lengths=(1.6, 0.8, 0.8))
    asked = np.array((1.0, 1.0, 50.0))
    specimen = vg.compress(vg.pack(bars, vg.Box((5, 5, 5), periodic="xyz"), "rsa", count=15, seed=seed), stress=asked)
    # the smaller stresses were once met to a hundredth of the largest one only, and then not within the steps
    assert specimen.stop_reason == "compressed"
    assert np.diag(specimen.forces.stress) / asked == pytest.approx(np.ones(3), abs=0.01)


@pytest.mark.parametrize(
    ("seed", "friction", "stress"), [(0, 0.1, (1, 1, 8)), (1, 0.1, (1, 15, 15)), (2, 0.5, (1, 40, 40))]
)
def test_a_container_of_grains_that_yield_is_no_needle_and_no_layer(seed, friction, stress):
    specimen = vg.compress(loose(seed=seed), stress=stress, friction=friction)
    assert specimen.stop_reason == "yielded"
    # a cell became 31 x 2 x 1 mean diameters once, or 18 lengths below 0
    lengths = np.array(specimen.container.lengths)
    assert lengths.max() / lengths.min() < np.exp(1.05)
    assert vg.verify(specimen).ok


@pytest.mark.parametrize("seed", [0, slow(2)])
def test_grains_that_bear_no_such_stress_do_not_overlap_at_the_end(seed):
    grains = vg.pack(vg.shapes.sphere(), vg.Box((3.74,) * 3, periodic="xyz"), "rsa", count=30, seed=seed)
    specimen = vg.compress(grains, stress=(1, 1, 6), friction=0.02)
    assert specimen.stop_reason != "compressed"
    assert specimen.provenance["compression"]["smallest_gap"] >= 0.0
    # by 0.002 diameters once, and by 0.03 of 300 spheres
    assert vg.verify(specimen).deepest <= 0.0
    assert np.allclose(specimen.solid_fraction, specimen.provenance["compression"]["path"][-1][0], rtol=0.02)


@pytest.mark.parametrize(("friction", "most"), [(0.0, 20.0), (0.5, 52.4), (1.0, 117.0)])
def test_far_more_unequal_stresses_than_grains_bear_are_refused(friction, most):
    words = rf"stress is .*: the largest is 1e\+09 times .* bear up to {most / 10:.3g} times .*, up to {most:.3g} times"
    with pytest.raises(vg.VoxgranError, match=words):
        vg.compress(loose(), stress=(1e-9, 1, 1), friction=friction)
    with pytest.raises(vg.VoxgranError, match="Rowe 1962"):
        vg.pack(vg.shapes.sphere(), vg.Box((5, 5, 5)), "compress", stress=(1, 1, 1.05 * most), friction=friction)
    # a friction that is found is up to 1
    with pytest.raises(vg.VoxgranError, match=r"a friction of 1 bear up to 11\.7 times"):
        vg.compress(loose(), stress=(1e-9, 1, 1), solid_fraction=0.6)


def test_stresses_along_axes_that_do_not_move_count_for_nothing():
    drum = vg.pack(vg.shapes.sphere(), vg.Cylinder(2.5, 4), "rsa", count=40)
    by_one, by_two = (vg.compress(drum, stress=(1, 1, last), axes="xy") for last in (1.0, 1e9))
    assert np.array_equal(by_one.position, by_two.position)
    assert by_one.forces.stress == pytest.approx(by_two.forces.stress)


def test_a_cell_of_few_grains_that_are_a_crystal_does_not_change_its_shape_for_ever():
    grains = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4), periodic=True), "rsa", count=30, seed=1)
    specimen = vg.compress(grains, friction=0.0)
    assert specimen.solid_fraction > 0.69
    assert specimen.stop_reason == "compressed"
    assert specimen.verify().ok


def test_small_stresses_strain_a_container_as_much_as_large_ones():
    load, modes = np.array([1.0, 4.0, 100.0, 0.0, 0.0, 0.0]), np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    assert evenly(modes, load) @ load == pytest.approx([100.0, 100.0, 100.0, 0.0, 0.0, 0.0])
    assert np.array_equal(evenly(modes, np.ones(6)), modes)


def test_grains_are_in_balance_where_the_last_examination_finds_less():
    specimen = vg.compress(loose(), rate=0.1)
    assert specimen.stop_reason == "compressed"
    assert vg.equilibrium(specimen).attrs["share_at_rest_without_rattlers"] >= 0.98


@pytest.mark.slow
def test_grains_that_bear_no_such_ratio_of_stresses_yield():
    with pytest.warns(vg.PackingWarning, match=r"asked for is 0.3 of the largest one, .*axial stresses of 0"):
        flows = vg.compress(loose(300), stress=(0.3, 0.3, 1.0), friction=0.1)
    record = flows.provenance["compression"]
    assert flows.stop_reason == "yielded"
    # a friction of 0.1 bears a third to two thirds
    assert 0.3 < record["stress_ratio"] < 0.75
    assert record["steps"] < 300
    bears = vg.compress(loose(300), stress=(0.8, 0.8, 1.0), friction=0.1)
    assert bears.stop_reason == "compressed"
    assert bears.provenance["compression"]["stress_ratio"] == pytest.approx(0.8, abs=0.1)
