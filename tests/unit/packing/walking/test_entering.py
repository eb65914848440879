"""Grains enter in turn, with their sizes spread over the order, and fall at once: beds are not sorted by size."""

import kit
import numpy as np
import pytest
from scipy.stats import spearmanr

import voxgran as vg
from voxgran._base.seeds import stream
from voxgran.packing.walking.entering import CLASSES, NEWEST, entry_order, spread_sizes

SPHERE = vg.make_shape("sphere")
METHODS = ["digital", "control_point"]


def test_each_part_of_the_order_has_one_grain_of_each_class():
    diameter = stream(3, "sizes").lognormal(size=12 * CLASSES)
    order = spread_sizes(diameter, stream(3, "order"))
    assert sorted(order.tolist()) == list(range(len(diameter)))
    rank = np.argsort(np.argsort(diameter))[order]
    for part in rank.reshape(12, CLASSES):
        assert sorted((part // 12).tolist()) == list(range(CLASSES))


@pytest.mark.parametrize("count", [0, 1, 5])
def test_few_grains_have_an_order_too(count):
    assert sorted(spread_sizes(np.ones(count), stream(1, "order")).tolist()) == list(range(count))


@pytest.mark.parametrize("method", METHODS)
def test_grains_enter_in_turn_and_fall_to_the_first_contact(method):
    task = kit.task_of(
        method, SPHERE, vg.Box((6, 6, 12)), count=NEWEST + 20, sizes=vg.sizes.uniform(0.7, 1.3), sweeps=1
    )
    state = task.method.advance(task.problem, task.method.prepare(task.problem), 1)
    first = task.method.finish(task.problem, state)
    # a voxel of 1/16, or a step of 0.1 diameters, above the floor
    assert first.position[0, 2] - first.diameters[0] / 2 < 0.15
    order, entered = entry_order(task.problem, 0)[::-1].tolist(), 1
    while state.feeding_ended_at is None:
        state = task.method.advance(task.problem, state, 10)
        if state.placed > entered:
            entered = state.placed
            assert set(state.grains.tolist()) == set(order[:entered])
    assert entered == task.problem.count


@pytest.mark.parametrize("method", METHODS)
def test_graded_beds_are_not_sorted_by_size(method):
    """Of 200 lognormal spheres; 0.8 to 0.9 where any waiting grain may enter first."""
    box = vg.Box((5, 5, 21), periodic="xy")
    bed = vg.pack(SPHERE, box, method, count=200, sizes=vg.sizes.lognormal(1.0, 0.3), seed=2)
    assert bed.count == 200
    assert abs(spearmanr(bed.diameters, bed.position[:, 2])[0]) < 0.15
