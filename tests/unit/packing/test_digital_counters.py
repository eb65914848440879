"""Grains that sleep are not looked at: the counters of a run tell."""

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


def test_sleeping_grains_look_at_nothing():
    awake, asleep = (
        counted(3, 12, each=3000, up=0.0, feed="rain", schedule=schedule) for schedule in ("random", "sleeping")
    )
    assert awake["slept_through"] == 0
    assert attempts(asleep) + asleep["slept_through"] == attempts(awake)
    assert attempts(asleep) < 0.7 * attempts(awake)
