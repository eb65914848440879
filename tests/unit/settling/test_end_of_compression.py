"""When a compression ends: with balance that more iterations confirm, and with each axial stress met."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.settling.stress_balance import evenly

pytestmark = pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")


def loose(count=60, seed=0):
    edge = 5 * (count / 60) ** (1 / 3)
    return vg.pack(vg.shapes.sphere(), vg.Box((edge,) * 3, periodic="xyz"), "rsa", count=count, seed=seed)


@pytest.mark.parametrize("seed", range(4))
def test_each_axial_stress_is_met_to_its_own_hundredth(seed):
    asked = np.array((1.0, 1.0, 100.0))
    specimen = vg.compress(loose(seed=seed), stress=asked.tolist())
    met = np.allclose(np.diag(specimen.forces.stress) / asked, 1.0, rtol=0.01)
    # the smaller stresses were once met to a hundredth of the largest one only, and then not within the steps
    assert specimen.stop_reason == ("compressed" if met else "yielded")
    # two of these four specimens shear on in a few layers, which bear any ratio; the others bear no more than friction
    assert met == (seed >= 2)


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
