"""What every packing method must keep, run over the registry: a new file is tested the moment it exists."""

import dataclasses
import os
import subprocess
import sys
import zlib

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import GrainTooLargeError, InputError
from voxgran._base.stopping import Stopped, stopping_when
from voxgran.packing.driver import Drive, drive
from voxgran.packing.method import method_registry
from voxgran.packing.pack import prepare_task

#: methods, and what else of a method has to keep it all, by name
VARIANTS = {
    "control_point, points": {"contact": "points"},
    "control_point, kdtree": {"contact": "kdtree"},
    "control_point, one way": {"tested_points": "one"},
    "control_point, open surfaces": {"contact": "points"},
}
METHODS = [*vg.packing_methods(), *VARIANTS]
#: what else goes on after a stop
STAGES = {
    "advancing_front, dense": {"mode": "dense"},
    "digital_fill, contact": {"place": "contact"},
    "rsa, saturated": {"until": "saturated", "tries": 20},
    "digital, settling": {"cover": "center", "settling": 20, "shaking": 5},
    "control_point, settling": {"settling": 20},
}
#: what makes a method quick here; anything else is its default
QUICK = {"sweeps": 120, "cycles": 2, "voxel_size": 0.1, "spacing": 0.25, "orientations": 24}


def name_of(method):
    return method.partition(",")[0]


def quick(method):
    known = {field.name for field in dataclasses.fields(method_registry().get(name_of(method)).parameters)}
    return {name: value for name, value in QUICK.items() if name in known} | {**VARIANTS, **STAGES}.get(method, {})


def task_of(method, count=10, seed=1):
    shapes = [vg.make_shape("box", lengths=(1.1, 0.9, 0.7)), vg.make_shape("sphere")]
    if "open surfaces" in method:
        shapes[0] = vg.make_shape("sheet", roll=150)
    return prepare_task(
        shapes,
        vg.Box((3.5, 3.5, 4), periodic=(True, False, False)),
        method=name_of(method),
        count=count,
        solid_fraction=None,
        sizes=vg.sizes.lognormal(0.8, 0.2),
        weights=None,
        weights_by="number",
        seed=seed,
        parameters=quick(method),
    )


def bits_of(packing):
    parts = (packing.position, packing.orientation, packing.scale, packing.shape_id)
    return b"".join(array.tobytes() for array in parts)


def packed(method, chunk=None, **keywords):
    task = task_of(method, **keywords)
    return task.method.finish(task.problem, drive(task.method, task.problem, Drive(chunk=chunk)))


@pytest.fixture(scope="module", params=METHODS)
def method(request):
    return request.param


@pytest.fixture(scope="module")
def packing(method):
    return packed(method)


def test_true_shapes_do_not_overlap_or_escape(method, packing):
    allowed = method_registry().get(name_of(method)).tolerance(task_of(method).problem.parameters)
    proof = vg.verify(packing)
    assert packing.count > 0
    assert proof.escaped == 0
    assert proof.ok or proof.deepest <= allowed


def test_results_do_not_depend_on_the_chunk(method, packing):
    for chunk in (7, 1000):
        assert bits_of(packed(method, chunk)) == bits_of(packing)


def test_single_attempts_give_the_same(method):
    """Chunks of one attempt, over the first attempts only: a whole run of them would take too long."""
    runs = []
    for chunk in (1, 600):
        task = task_of(method)
        state = task.method.prepare(task.problem)
        while state.done < 600 and not state.stop_reason:
            state = task.method.advance(task.problem, state, min(chunk, 600 - state.done))
        runs.append(b"".join(array.tobytes() for array in state.arrays.values()))
    assert runs[0] == runs[1]


def test_same_seed_same_bits_other_seed_others(method, packing):
    assert bits_of(packed(method)) == bits_of(packing)
    assert bits_of(packed(method, seed=2)) != bits_of(packing)


def test_no_grains(method):
    packing = vg.pack(vg.make_shape("sphere"), vg.Box((3, 3, 3)), method=name_of(method), count=0, **quick(method))
    assert packing.count == 0
    assert vg.verify(packing).ok
    assert packing.solid_fraction == 0


def test_a_grain_larger_than_the_container(method):
    with pytest.raises(GrainTooLargeError, match="none can fit"):
        vg.pack(vg.make_shape("sphere"), vg.Box((3, 3, 0.5)), method=name_of(method), count=3, **quick(method))


def test_periodic_grains_wrap(packing):
    """Nothing is lost at a periodic face: seen through the face the packing is as valid as before."""
    lengths = packing.container.bounds[1] - packing.container.bounds[0]
    shifted = packing.position + np.array([lengths[0] / 2, 0.0, 0.0])
    moved = vg.Packing.of(
        packing.shapes,
        packing.container,
        position=shifted,
        scale=packing.scale,
        shape_id=packing.shape_id,
        orientation=packing.orientation,
    )
    assert vg.verify(moved).ok == vg.verify(packing).ok


def contents_of(state):
    """Return all that a checkpoint holds."""
    arrays = {name: (array.dtype, array.shape, array.tobytes()) for name, array in state.arrays.items()}
    return arrays, dict(state.counters), state.done, state.total, state.stop_reason


@pytest.mark.parametrize("which", [*METHODS, *STAGES])
def test_no_attempts_change_nothing(which):
    """What follows from the problem is made in a chunk of none, before signals are noted."""
    task = task_of(which)
    state = task.method.prepare(task.problem)
    before = contents_of(state)
    state = task.method.advance(task.problem, state, 0)
    assert contents_of(state) == before
    assert state.derived
    assert not state.stop_reason


#: what is done between two looks whether to stop, made little
LOOKS = {
    "voxgran.contacts.surface_pairs.AT_ONCE": 3,
    "voxgran.packing.rsa.available_boxes.AT_ONCE": 5,
    "voxgran.settling.settle.AT_ONCE": 50,
    "voxgran.packing.digital.feasible_places.JOINED_WORDS": 1,
    "voxgran.packing.digital.feasible_places.FEWEST_RUNS": 7,
    "voxgran.packing.digital.fill_method.SLAB_WORDS": 1,
}


@pytest.mark.parametrize("which", [*METHODS, *STAGES])
def test_stopped_at_any_look_it_goes_on_to_the_same_bits(which, monkeypatch):
    """What was begun is lost and nothing else, be it kept in memory or read from a checkpoint."""
    count = 80 if which == "rsa, saturated" else 10
    task, again = task_of(which, count), task_of(which, count)
    whole, looks, stops = drive(task.method, task.problem, Drive(chunk=200)), [0], 0
    for name, few in LOOKS.items():
        monkeypatch.setattr(name, few)
    state, wait = again.method.prepare(again.problem), 1

    def is_time():
        looks[0] += 1
        return stops < 40 and looks[0] % wait == 0

    while not state.stop_reason:
        before = state.done
        try:
            with stopping_when(is_time):
                state = again.method.advance(again.problem, state, 200)
        except Stopped:
            stops += 1
            if stops % 10 == 0:
                state.derived = {}
        # so long as nothing comes of it, later and later
        wait = wait + 1 if state.done == before else max(1, wait // 2)
    assert contents_of(state) == contents_of(whole)
    assert stops or which not in ("digital_fill", *STAGES) or which == "advancing_front, dense"


KILLED = """
import os, signal, sys, time
sys.path.insert(0, {folder!r})
from test_conformance import task_of, drive, Drive
import voxgran.packing.driver as run
run.CHECKPOINT_SECONDS = 0.0
# the first run loads all kernels, so that no kill is spent on that
for _ in range(2):
    began = time.monotonic()
    task = task_of({method!r}, count={count})
    drive(task.method, task.problem, Drive())
    seconds = time.monotonic() - began
for share in {shares}:
    child = os.fork()
    if not child:
        task = task_of({method!r}, count={count})
        drive(task.method, task.problem, Drive(checkpoint={path!r}, resume=True, chunk={chunk}))
        os._exit(0)
    time.sleep(share * seconds)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
task = task_of({method!r}, count={count})
drive(task.method, task.problem, Drive(checkpoint={path!r}, resume=True, chunk={chunk}))
"""


def killed_and_resumed(method, path, shares, *, count=10, chunk=200):
    """Return the packing of a run that is killed after some shares of its whole time, and then comes through."""
    names = {"method": method, "path": str(path), "shares": list(shares), "count": count, "chunk": chunk}
    code = KILLED.format(folder=os.path.dirname(__file__), **names)
    subprocess.run([sys.executable, "-c", code], check=True, timeout=1200)
    task = task_of(method, count=count)
    state = drive(task.method, task.problem, Drive(checkpoint=path, resume=True, chunk=chunk))
    return task.method.finish(task.problem, state)


def test_killed_and_resumed_to_the_same_bits(method, packing, tmp_path):
    """SIGKILL at random moments, also while a checkpoint is being written, until it comes through."""
    shares = np.random.Generator(np.random.Philox(3)).uniform(0.05, 0.6, 4).tolist()
    assert bits_of(killed_and_resumed(method, tmp_path / "checkpoint", shares)) == bits_of(packing)
    # what was killed holds no lock, and what came through removed its own
    assert [file.name for file in tmp_path.iterdir()] == ["checkpoint"]


@pytest.mark.slow
@pytest.mark.parametrize("which", [*METHODS, *STAGES])
def test_killed_at_twenty_moments_and_resumed_to_the_same_bits(which, tmp_path):
    """SIGKILL over the whole length of a run, while it prepares, walks, parts, shakes, settles and writes."""
    whole = packed(which, count=30)
    shares = np.random.Generator(np.random.Philox([4, zlib.crc32(which.encode())])).uniform(0, 0.4, 20).tolist()
    again = killed_and_resumed(which, tmp_path / "run", shares, count=30, chunk=None)
    assert bits_of(again) == bits_of(whole)
    assert again.stop_reason == whole.stop_reason


def test_a_start_stays_in_order_and_goes_on(method, packing, tmp_path):
    """A packing of another program: spheres on a lattice that touch; then a packing of the method itself."""
    ticks = np.arange(3) + 0.5
    lattice = np.array(np.meshgrid(ticks, ticks, ticks[:2])).reshape(3, -1).T
    (tmp_path / "spheres.txt").write_text("\n".join(f"{x} {y} {z} 0.45" for x, y, z in lattice))
    foreign = vg.load(tmp_path / "spheres.txt")
    box = vg.Box((3.5, 3.5, 6), "x")
    found = vg.pack([], box, method=name_of(method), start=foreign, seed=3, **quick(method))
    assert found.count == len(lattice)
    assert found.diameters == pytest.approx(0.9)
    assert vg.verify(found).ok
    again = vg.pack([], box, method=name_of(method), start=foreign, seed=3, **quick(method))
    assert bits_of(again) == bits_of(found)
    more = vg.pack(vg.make_shape("cone"), box, method=name_of(method), start=found, count=2, seed=3, **quick(method))
    assert more.count == len(lattice) + 2
    assert more.shape_id[-2:].tolist() == [1, 1]
    assert vg.verify(more).ok
    assert more.provenance["asked"]["start"]["count"] == len(lattice)


def test_a_start_that_has_no_place_is_refused(method):
    spheres = vg.Packing.of([vg.make_shape("sphere")], vg.Box((9, 9, 9)), position=[(1, 1, k + 0.5) for k in range(4)])
    with pytest.raises(InputError, match=r"grain 3 of start finds no place"):
        vg.pack([], vg.Box((1.6, 1.6, 3.95)), method=name_of(method), start=spheres, **quick(method))
    flat = vg.Packing.of([vg.make_shape("disk")], vg.Rectangle((9, 9)), position=[(1, 1, 0)])
    with pytest.raises(InputError, match="start has dimension 2"):
        vg.pack([], vg.Box((3, 3, 3)), method=name_of(method), start=flat, **quick(method))
