"""The end of settling: the best bed that was examined is remembered and replaces one that is worse."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.packing.settling_run import normalized_assembly
from voxgran.settling.parameters import Settling
from voxgran.settling.stages import ENDED, STILL, Settler

DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def resting():
    """Return 40 spheres at rest."""
    bed = vg.pack(vg.make_shape("sphere"), vg.Box((3, 3, 12), periodic="xy"), "gravity", count=40)
    assert bed.stop_reason == "settled"
    return normalized_assembly(bed)[0]


def examined(assembly):
    """Return a settler after an examination of a bed that rests, and its position."""
    settler = Settler(assembly, Settling(), DOWN)
    settler.progress.stage = STILL
    settler._examine(3000)
    return settler, settler.bed.grains.position.copy()


@pytest.mark.parametrize("rise", [-0.05, 0.05], ids=["overlaps", "floats"])
def test_a_bed_that_became_worse_ends_as_the_best_one(resting, rise):
    settler, position = examined(resting)
    assert settler.progress.best < 0.05
    top = settler.bed.count - 1
    settler.bed.move(np.where(np.arange(top + 2)[:, None] == top, [0, 0, rise, 0, 0, 0], 0.0), 1.0)
    settler._end()
    np.testing.assert_array_equal(settler.bed.grains.position, position)
    assert settler.progress.stage == ENDED
    assert settler.progress.proven
    assert settler.progress.smallest >= 0.0
    assert not settler.progress.best_position.size


def test_a_bed_that_rests_stays_where_it_is(resting):
    settler, _ = examined(resting)
    settler.progress.best_position = settler.progress.best_position + 1.0
    before = settler.bed.grains.position.copy()
    settler._end()
    np.testing.assert_array_equal(settler.bed.grains.position, before)


def test_beds_that_overlap_are_not_remembered(resting):
    settler = Settler(resting, Settling(), DOWN)
    settler.progress.stage = STILL
    settler.bed.move(np.tile([0, 0, -0.1, 0, 0, 0.0], (settler.bed.count + 1, 1)), 1.0)
    settler._examine(300)
    assert settler.progress.smallest < 0.0
    assert not settler.progress.best_position.size
