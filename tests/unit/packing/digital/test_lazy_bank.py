"""Banks of many orientations: voxelized when they are needed, and the same walk."""

import kit
import numpy as np

import voxgran as vg
from voxgran.packing.digital import precompute as digital_setting
from voxgran.packing.digital.walk_method import registration as digital


def walked(orientations, attempts):
    shape, asked = vg.make_shape("solid_union", seed=1), {"voxel_size": 1 / 10, "orientations": orientations}
    task = kit.task_of("digital", shape, vg.Box((5, 5, 6), "x"), count=20, seed=5, **asked)
    state = digital.prepare(task.problem)
    for many in attempts:
        state = digital.advance(task.problem, state, many)
    return task.problem, state


def test_the_walk_is_the_same(monkeypatch):
    monkeypatch.setattr(digital_setting, "LAZY", 10**9)
    _, eager = walked(96, (20_000,))
    monkeypatch.setattr(digital_setting, "LAZY", 1)
    for attempts in ((20_000,), (3, 9_997, 10_000)):
        _, lazy = walked(96, attempts)
        assert lazy.counters == eager.counters
        for name in ("site", "member", "turn", "waiting"):
            assert np.array_equal(lazy.arrays[name], eager.arrays[name])
    assert eager.counters["turns_accepted"] > 100


def test_only_what_is_needed_is_voxelized():
    problem, state = walked(24 * 1000, (300,))
    bank = state.derived["precomputed"].bank
    assert len(bank.size) == 16 * 1000
    made = int((bank.start[:, 0] >= 0).sum())
    assert made == problem.counters["voxelized_shapes"]
    # each feed and each turn needs one at most
    assert 0 < made <= state.counters["feeds_tried"] + state.counters["turns_tried"] + 1
    occupied = state.derived["precomputed"].canvas.occupied(state.derived["words"])
    placed = state.arrays["member"] >= 0
    assert occupied.sum() == bank.voxels[state.arrays["member"][placed]].sum()


def test_packing_with_a_large_bank_is_free_of_overlaps():
    packing = vg.pack(
        vg.make_shape("box", lengths=(1, 0.7, 0.5)), vg.Box((4, 4, 5)), method="digital", count=15, voxel_size=0.1,
        settle=False, sweeps=300, cycles=2, orientations=24 * 50, seed=2,
    )  # fmt: skip
    assert packing.count == 15
    assert vg.verify(packing).ok
