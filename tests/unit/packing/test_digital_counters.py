"""What digital packing never touches: inner voxels, far grains, grains that sleep. The counters of its runs tell."""

import pytest

import voxgran as vg
from voxgran.packing.methods.digital import registration as digital
from voxgran.packing.pack import prepare_task


def counted(many, cells, *, each=60, **options):
    """Return the counters of a bed after `each` attempts per grain; `many` grains on each side of its floor."""
    box = vg.Box((1.6 * many, 1.6 * many, 4), periodic=(True, True, False))
    parameters = {"voxel_size": 1 / cells, "orientations": 1, "feed": "at_once", "turns": 0.0, **options}
    task = prepare_task(
        [vg.make_shape("sphere")], box, method="digital", count=2 * many * many, solid_fraction=None, sizes=None,
        weights=None, weights_by="number", seed=1, parameters=parameters,
    )  # fmt: skip
    state = digital.prepare(task.problem)
    return digital.advance(task.problem, state, each * task.problem.count).counters


def attempts(counters):
    """Return how many attempts looked at the canvas or the tables."""
    return counters["moves_tried"] + counters["turns_tried"] + counters["feeds_tried"]


def test_words_do_not_grow_with_the_number_of_grains():
    few, many = counted(3, 16), counted(9, 16)
    assert many["words_tested"] / attempts(many) == pytest.approx(few["words_tested"] / attempts(few), rel=1e-12)


def test_inner_voxels_cost_nothing_of_their_own():
    """Four times the voxels per diameter are 64 times the voxels and 16 times the columns."""
    coarse, fine = counted(3, 12), counted(3, 48)
    words = [found["words_tested"] / attempts(found) for found in (coarse, fine)]
    # rows are filled up to eight columns, columns to words: the coarse grain pays more for that
    assert words[1] < 16 * words[0]
    voxels = vg.voxelize(vg.make_shape("sphere"), voxel_size=1 / 48, cover="touch").mask.sum()
    assert words[1] < voxels / 8


def test_sleeping_grains_look_at_nothing():
    awake, asleep = (
        counted(3, 12, each=3000, up=0.0, feed="rain", schedule=schedule) for schedule in ("random", "sleeping")
    )
    assert awake["slept_through"] == 0
    assert attempts(asleep) + asleep["slept_through"] == attempts(awake)
    assert asleep["words_tested"] < 0.7 * awake["words_tested"]
