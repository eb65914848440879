"""Tables of pairs: the same walk as by columns, and when they are used."""

import kit
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran.packing.digital import precompute as digital_setting
from voxgran.packing.digital.precompute import precomputed_of
from voxgran.packing.digital.walk_method import registration as digital

CASES = {
    "spheres": ("sphere", {}, vg.Box((5, 5, 6)), {"orientations": 1}),
    "boxes, periodic": (
        "box", {"lengths": (1, 0.8, 0.6)}, vg.Box((6, 5, 6), periodic=(True, True, False)), {"orientations": 24},
    ),
    "cones without gravity": (
        "cone", {}, vg.Box((6, 7, 6), periodic=(True, False, False)),
        {"orientations": 24, "gravity": "none", "feed": "at_once"},
    ),
    "sleeping disks": ("disk", {}, vg.Rectangle((7, 9), "x"), {"schedule": "sleeping"}),
    "few cells": ("sphere", {}, vg.Box((2.4, 2.6, 9)), {"orientations": 1, "schedule": "sorted"}),
}  # fmt: skip


def walked(case, attempts=(12_000,)):
    name, shape, container, options = CASES[case]
    shape = vg.make_shape(name, **shape)
    task = kit.task_of("digital", shape, container, count=24, seed=3, **{"voxel_size": 1 / 8, **options})
    state = digital.prepare(task.problem)
    for many in attempts:
        state = digital.advance(task.problem, state, many)
        # as after a checkpoint
        state.derived.clear()
    precomputed_of(task.problem, state)
    return state


#: what the two do not have in common
READ = {"rows_read": 0, "pairs_read": 0}


@pytest.mark.parametrize(
    "case", ["spheres", slow("boxes, periodic"), slow("cones without gravity"), slow("sleeping disks"), "few cells"]
)
def test_walk_is_that_by_columns(case, monkeypatch):
    columns = walked(case)
    assert not len(columns.derived["pairs"].at)
    monkeypatch.setattr(digital_setting, "TABLE_VOXELS", 0)
    monkeypatch.setattr(digital_setting, "TABLE_BYTES", 2**31)
    pairs_read = set()
    for attempts in ((12_000,), (3001, 1, 8998)):
        tables = walked(case, attempts)
        assert len(tables.derived["pairs"].at)
        assert not len(tables.derived["words"])
        assert {**tables.counters, **READ} == {**columns.counters, **READ}
        for name in ("site", "member", "turn", "waiting"):
            assert np.array_equal(tables.arrays[name], columns.arrays[name])
        pairs_read.add(tables.counters["pairs_read"])
    # whether the cells were made again or not
    assert len(pairs_read) == 1
    assert columns.counters["moves_accepted"] > 400


@pytest.mark.parametrize(
    ("container", "options"),
    [
        (vg.Cylinder(2.0, 5), {}),
        (vg.Box((4, 4, 5)), {"lid": True}),
        (vg.Box((4, 4, 5)), {"guided": 0.2}),
        (vg.Box((1.7, 4, 5), periodic=(True, False, False)), {}),
        (vg.Box((4, 4, 5)), {"voxel_size": 0.1}),
    ],
    ids=["round walls", "lid", "guided", "short period", "small grains"],
)
def test_columns_are_kept_where_tables_do_not_do(container, options, monkeypatch):
    if "voxel_size" not in options:
        monkeypatch.setattr(digital_setting, "TABLE_VOXELS", 0)
    asked = {"voxel_size": 0.125, **options}
    task = kit.task_of("digital", vg.make_shape("sphere"), container, count=5, **asked)
    state = digital.prepare(task.problem)
    precomputed_of(task.problem, state)
    assert not len(state.derived["pairs"].at)


def test_large_grains_get_tables():
    packing_options = {
        "method": "digital",
        "settle": False,
        "count": 6,
        "voxel_size": 1 / 40,
        "sweeps": 200,
        "cycles": 1,
    }
    packing = vg.pack(vg.make_shape("sphere"), vg.Box((2.5, 2.5, 4)), **packing_options)
    assert packing.count == 6
    assert vg.verify(packing).ok
