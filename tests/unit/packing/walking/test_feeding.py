"""When feeding ends: a container is full where nothing enters though the bed has come to rest, and no sooner."""

import kit
import pytest
from kit import slow

import voxgran as vg
from voxgran.packing.driver import Drive, drive
from voxgran.packing.walking.feeding import SINK_DEPTH, SINK_SWEEPS

SPHERE = vg.make_shape("sphere")
ROOMY = vg.Box((4, 4, 8))


def task_of(method, container, *, count=60, **parameters):
    return kit.task_of(method, SPHERE, container, count=count, **parameters)


@pytest.mark.parametrize(
    ("method", "parameters"),
    [
        slow("digital", {"feed": "layers", "voxel_size": 1 / 64}),
        ("digital", {"feed": "layers", "voxel_size": 1 / 16, "layer_sweeps": 1}),
        ("digital", {"feed": "layers", "voxel_size": 1 / 16, "gravity": (0.4, 0.0, 1.0)}),
        ("control_point", {"feed": "layers", "step": 0.02}),
        ("digital", {"rate": 1.0, "voxel_size": 1 / 16}),
        ("digital", {"rate": 0.95, "voxel_size": 1 / 16, "schedule": "sleeping"}),
        ("control_point", {"rate": 1.0}),
    ],
    ids=str,
)
def test_an_almost_empty_box_is_not_full(method, parameters):
    packing = vg.pack(SPHERE, ROOMY, method=method, count=60, sweeps=5, settle=False, **parameters)
    assert packing.count == 60
    assert vg.verify(packing).ok


def test_large_grains_wait_for_small_ones_to_sink():
    """Steps go with the diameter: small grains stay long where the large ones are to enter."""
    sizes = vg.sizes.discrete([0.1, 2.0], [0.95, 0.05])
    packing = vg.pack(
        SPHERE, vg.Box((4, 4, 5)), "control_point", count=60, sizes=sizes, seed=3, sweeps=5, step=0.02, settle=False
    )
    assert packing.count == 60
    assert packing.diameters.max() == pytest.approx(2.0)


@pytest.mark.parametrize("feed", [slow("rain"), "layers"])
@pytest.mark.parametrize("method", ["digital", "control_point"])
def test_a_full_bed_has_come_to_rest(method, feed):
    """The grains below the entry, here all of them, have not sunk in as many sweeps before feeding ended."""
    voxel = {"voxel_size": 1 / 16} if method == "digital" else {}
    task = task_of(method, vg.Box((3, 3, 3)), count=40, feed=feed, rate=0.05, sweeps=0, **voxel)
    state, heights = task.method.prepare(task.problem), []
    while state.feeding_ended_at is None:
        begins = state.layer_ends
        state = task.method.advance(task.problem, state, 1)
        if begins is None and state.layer_ends is not None:
            rested = state.counters["placed"]
            tried, begun = state.counters["feeds_tried"], state.done
            heights = [task.method.finish(task.problem, state).position[:, 2].sum()]
    assert 12 < state.counters["placed"] == rested < 40
    assert state.counters["feeds_tried"] == tried
    assert state.done - begun == SINK_SWEEPS * rested
    heights.append(task.method.finish(task.problem, state).position[:, 2].sum())
    assert 0 <= heights[0] - heights[1] <= SINK_DEPTH * rested


@pytest.mark.parametrize("method", ["digital", "control_point"])
def test_rests_depend_on_neither_chunks_nor_stops(method):
    finer = {"voxel_size": 1 / 24} if method == "digital" else {"step": 0.03}
    told, ends = {"count": 15, "feed": "layers", "layer_sweeps": 2, "sweeps": 5, **finer}, []
    for chunk in (7, 3001, 100_000):
        task = task_of(method, vg.Box((3, 3, 6)), **told)
        state, rests = task.method.prepare(task.problem), 0
        while not state.stop_reason:
            begins = state.layer_ends
            state = task.method.advance(task.problem, state, chunk)
            rests += begins is None and state.layer_ends is not None
            if chunk == 3001:
                # what a checkpoint does not hold
                state.derived = {}
        assert state.counters["placed"] == 15
        assert chunk > 7 or rests > 5
        ends.append((state.counters, task.method.finish(task.problem, state).position.tobytes()))
    assert ends[0] == ends[1] == ends[2]


def test_nothing_waits_without_gravity_or_all_at_once():
    for parameters in ({"gravity": "none"}, {"feed": "at_once"}):
        task = task_of("digital", vg.Box((3, 3, 3)), count=40, voxel_size=1 / 16, sweeps=1, **parameters)
        state = drive(task.method, task.problem, Drive())
        assert state.stop_reason == "full"
        assert state.layer_ends is None
        # the last in a row
        assert state.counters["feeds_refused_in_a_row"] == 2000
        assert state.counters["moves_tried"] + state.counters["turns_tried"] == state.done - state.feeding_ended_at
