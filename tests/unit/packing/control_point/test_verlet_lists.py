"""Lists of near grains: nobody is missing, and a run without lists gives the same bits."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.packing.control_point import verlet_lists as close_lists
from voxgran.packing.control_point.method import registration as control_point
from voxgran.packing.draw import Request
from voxgran.packing.pack import prepare_task


def problem_of(shapes, container, **parameters):
    asked = {"count": 50, "sizes": vg.sizes.lognormal(1.0, 0.1), "seed": 3, "parameters": parameters}
    return prepare_task(Request(shapes, container, "control_point", **asked)).problem


@pytest.mark.parametrize("periodic", [(False, False, False), (True, True, False)])
def test_lists_hold_all_who_are_near(periodic):
    """After each 500 attempts, while grains fall and are shaken: every pair within reach is in both lists."""
    problem = problem_of([vg.make_shape("box", aspect=(1.2, 1.0, 0.9))], vg.Box((7.5, 7.5, 8), periodic), spacing=0.4)
    state, looked = control_point.prepare(problem), 0
    lengths = np.where(periodic, problem.container.bounds[1] - problem.container.bounds[0], np.inf)
    while state.feeding_ended_at is None:
        state = control_point.advance(problem, state, 1000)
    for _ in range(20):
        state = control_point.advance(problem, state, 500)
        setting = state.derived["precomputed"]
        lists, position = setting.lists, state.arrays["position"]
        assert len(lists.near) == 50
        if lists.state[0] != 0:
            continue
        ways = position[:, None] - position[None]
        ways -= np.where(np.isfinite(lengths), lengths, 0.0) * np.round(ways / lengths)
        radius = setting.extent[:, 0]
        near = np.linalg.norm(ways, axis=2) <= radius[:, None] + radius[None] + 2 * setting.extent[:, 5].max()
        for g in range(50):
            listed = set(lists.near[g, : lists.many[g]].tolist())
            assert listed >= set(np.flatnonzero(near[g]).tolist()) - {g}
            looked += len(listed)
    assert looked > 1000


def test_a_run_without_lists_gives_the_same_bits(monkeypatch):
    made = []
    for most in (50, 49):
        monkeypatch.setattr(close_lists, "MOST_GRAINS", most)
        problem = problem_of([vg.make_shape("sphere"), vg.make_shape("cone")], vg.Box((7.5, 7.5, 8), "xy"), spacing=0.4)
        state = control_point.prepare(problem)
        while state.feeding_ended_at is None:
            state = control_point.advance(problem, state, 1000)
        state = control_point.advance(problem, state, 20_000)
        assert (len(state.derived["precomputed"].lists.near) > 0) == (most == 50)
        made.append(state.arrays["position"].tobytes())
    assert made[0] == made[1]
