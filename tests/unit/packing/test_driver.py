"""Driving a method: checkpoints that are bounded, written in time, and good when the next one fails."""

import itertools
import shutil
import signal
from dataclasses import replace

import kit
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.checkpoint import load_checkpoint, remove_checkpoint
from voxgran._base.errors import CheckpointError, InputError, Interrupted, InUseError, OutputError
from voxgran._base.files import _draft_name, remove_drafts
from voxgran._base.lock import locked_file
from voxgran._base.stopping import stop_if_asked
from voxgran.packing import driver as run
from voxgran.packing.driver import Drive, drive
from voxgran.packing.method import State, method_registry

METHODS = vg.packing_methods()
QUICK = {"digital": {"voxel_size": 0.2, "sweeps": 30}, "control_point": {"spacing": 0.3, "sweeps": 30}}


def task_of(method="digital", count=20, shape=None, **more):
    shapes, parameters = [shape or vg.make_shape("sphere")], {**QUICK.get(method, {}), **more}
    container = vg.Sphere(3) if method == "apollonian" else vg.Box((5, 5, 8))
    return kit.task_of(method, shapes, container, count=count, seed=1, **parameters)


@pytest.mark.parametrize("method", [slow(name) if name == "multilayer" else name for name in METHODS])
def test_a_checkpoint_takes_some_hundred_bytes_a_grain(method, tmp_path):
    sizes = []
    for count in (20, 60):
        task, path = task_of(method, count), tmp_path / f"{count}.voxgran"
        drive(method_registry().get(method), task.problem, Drive(path))
        sizes.append(path.stat().st_size)
    # grains that settle have contacts, whose forces are kept, and lists of pairs
    most = 1500 if method in ("gravity", "compress") else 400
    assert (sizes[1] - sizes[0]) / 40 < most
    assert sizes[0] < 9000 + 20 * most


def test_the_last_state_is_kept_so_that_a_resume_packs_nothing_again(tmp_path):
    task, path = task_of(), tmp_path / "run.voxgran"
    ended = drive(task.method, task.problem, Drive(path))
    header, arrays = load_checkpoint(path)
    assert header["stop_reason"] == ended.stop_reason
    assert arrays["site"].tobytes() == ended.arrays["site"].tobytes()
    steps = []
    again = drive(task.method, task_of().problem, Drive(path, resume=True, on_step=steps.append))
    assert not steps
    assert again.arrays["site"].tobytes() == ended.arrays["site"].tobytes()


@pytest.mark.parametrize(
    ("method", "share", "more"),
    [("control_point", 1.0, {}), ("control_point", 0.5, {}), ("digital", 0.5, {"orientations": 24 * 60})],
)
def test_a_resumed_run_counts_as_one_that_was_not_interrupted(method, share, more, tmp_path):
    def task():
        return task_of(method, shape=vg.make_shape("box", aspect=(1, 1, 1.5)), **more)

    whole, first, again, path = task(), task(), task(), tmp_path / "run.voxgran"
    ended = drive(whole.method, whole.problem, Drive(chunk=100))
    state = first.method.prepare(first.problem)
    while state.done < share * ended.done and not state.stop_reason:
        state = first.method.advance(first.problem, state, 100)
    run._save(first.problem, state, path, run.fingerprint(first.method, first.problem))
    resumed = drive(again.method, again.problem, Drive(path, resume=True, chunk=100))
    assert resumed.counters == ended.counters
    assert again.problem.counters == whole.problem.counters
    assert sum(whole.problem.counters.values()) >= 1


def test_a_checkpoint_that_fails_names_the_last_good_one(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "CHECKPOINT_SECONDS", 0.0)
    monkeypatch.setattr(run, "CHECKPOINT_SHARE", 1e9)
    folder = tmp_path / "out"
    task, seen = task_of(), []

    def lose(step):
        seen.append(step)
        if len(seen) == 3:
            shutil.rmtree(folder)
            folder.write_text("in the way")

    with pytest.raises(OutputError, match=r"cannot be written .*the checkpoint after .* attempts; that after .* good"):
        drive(task.method, task.problem, Drive(folder / "run.voxgran", chunk=200, on_step=lose))


def test_a_folder_that_was_removed_is_made_again(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "CHECKPOINT_SECONDS", 0.0)
    folder = tmp_path / "out"
    task, seen = task_of(), []

    def lose(step):
        seen.append(step)
        if len(seen) == 3:
            shutil.rmtree(folder)

    ended = drive(task.method, task.problem, Drive(folder / "run.voxgran", chunk=200, on_step=lose))
    assert ended.stop_reason
    assert (folder / "run.voxgran").is_file()


def test_large_checkpoints_are_written_less_often(tmp_path, monkeypatch):
    clock, written = [0.0], []
    monkeypatch.setattr(run.time, "monotonic", lambda: clock[0])

    def slow(problem, state, path, mark):
        written.append(clock[0])
        clock[0] += 4.0

    monkeypatch.setattr(run, "_save", slow)
    keeper = run._Keeper(None, tmp_path / "run.voxgran", "")
    state = type("S", (), {"done": 1})
    for _ in range(400):
        clock[0] += 1.0
        keeper.keep(state, at_once=False)
    assert written[0] == 11.0
    assert min(b - a for a, b in itertools.pairwise(written)) >= 80.0


def test_what_a_kill_left_half_written_is_removed(tmp_path):
    path = tmp_path / "run.voxgran"
    half, other = (tmp_path / _draft_name(tmp_path / name, "0a1b2c3d") for name in ("run.voxgran", "ran.voxgran"))
    for file in (path, half, other):
        file.write_text("x")
    remove_drafts(path)
    assert path.exists()
    assert other.exists()
    assert not half.exists()
    half.write_text("x")
    path.unlink()
    drive(task_of().method, task_of().problem, Drive(path))
    assert not half.exists()


@pytest.mark.parametrize("resume", [False, True])
def test_a_file_that_is_no_checkpoint_is_not_replaced(tmp_path, resume):
    path = tmp_path / "thesis.txt"
    path.write_text("thesis")
    task = task_of()
    with pytest.raises(CheckpointError, match="is not replaced"):
        drive(task.method, task.problem, Drive(path, resume=resume))
    assert path.read_text() == "thesis"
    path.unlink()
    drive(task.method, task.problem, Drive(path))
    # an older checkpoint is
    drive(task.method, task.problem, Drive(path))
    remove_checkpoint(path)
    assert not path.exists()
    remove_checkpoint(path)
    path.write_text("thesis")
    remove_checkpoint(path)
    assert path.read_text() == "thesis"


@pytest.mark.parametrize("limit", [-1.0, float("nan")])
def test_time_limits_are_checked(limit):
    with pytest.raises(InputError, match="time_limit is"):
        vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 4)), method="rsa", count=2, time_limit=limit)


def counting(total, attempt=lambda state: None):
    """Return a method that counts its attempts, and does something in each."""

    def prepare(problem):
        return State({"made": np.zeros(1)}, {}, 0, total)

    def advance(problem, state, attempts):
        for _ in range(attempts):
            attempt(state)
            state.arrays["made"] += 1
            state.done += 1
            if state.done == total:
                state.stop_reason = "count"
                break
        return state

    return replace(method_registry().get("rsa"), prepare=prepare, advance=advance)


@pytest.mark.parametrize("cost", [1e-5, 1e-3, 0.2, lambda done: 1e-5 if done < 10_000 else 2e-5])
def test_chunks_grow_from_one_attempt_to_a_quarter_of_a_second(cost, monkeypatch):
    clock, steps = [0.0], []
    monkeypatch.setattr(run.time, "monotonic", lambda: clock[0])

    def attempt(state):
        clock[0] += cost(state.done) if callable(cost) else cost

    method = counting(150_000 if callable(cost) else int(4 / cost), attempt)
    drive(method, task_of("rsa").problem, Drive(on_step=lambda step: steps.append((step.done, clock[0]))))
    assert steps[0][0] == 1
    seconds = np.diff([0.0, *(at for _, at in steps)])
    assert seconds.max() <= 0.5
    made = np.diff([0, *(done for done, _ in steps)])
    assert (made[1:] <= 2 * made[:-1]).all()
    # most of the work is done in chunks that are long enough not to cost anything
    assert len(steps) < 30 + clock[0] / 0.2


def test_a_signal_in_the_last_chunk_is_not_lost(tmp_path):
    path, problem = tmp_path / "run.voxgran", task_of("rsa").problem

    def attempt(state):
        if state.done == 9:
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(Interrupted, match=r"after all 10 attempts; to finish, resume from .*run.voxgran") as stop:
        drive(counting(10, attempt), problem, Drive(path, chunk=10))
    assert stop.value.exit_code == 143
    steps = []
    ended = drive(counting(10, attempt), problem, Drive(path, resume=True, on_step=steps.append))
    assert (ended.stop_reason, ended.done, steps) == ("count", 10, [])


def test_a_signal_is_looked_for_within_an_attempt(tmp_path):
    path, problem = tmp_path / "run.voxgran", task_of("rsa").problem
    heard = []

    def attempt(state):
        if state.done == 4 and not heard:
            heard.append(True)
            signal.raise_signal(signal.SIGINT)
        stop_if_asked()

    with pytest.raises(Interrupted, match="after 4 of 10 attempts; to go on, resume from") as stop:
        drive(counting(10, attempt), problem, Drive(path, chunk=10))
    assert stop.value.exit_code == 130
    assert drive(counting(10, attempt), problem, Drive(path, resume=True)).arrays["made"] == 10
    heard.clear()
    with pytest.raises(Interrupted, match="after 4 of 10 attempts without a checkpoint"):
        drive(counting(10, attempt), problem, Drive(chunk=10))


def test_a_second_signal_ends_at_once(tmp_path):
    path = tmp_path / "run.voxgran"

    def attempt(state):
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(Interrupted, match="stopped at once"):
        drive(counting(10, attempt), task_of("rsa").problem, Drive(path, chunk=10))
    assert not list(tmp_path.iterdir())


def test_a_signal_before_the_first_attempt_ends_at_once(tmp_path):
    task = task_of("rsa")

    def prepare(problem):
        signal.raise_signal(signal.SIGTERM)

    with pytest.raises(Interrupted, match="before the next attempt"):
        drive(replace(task.method, prepare=prepare), task.problem, Drive(tmp_path / "run.voxgran"))
    assert not list(tmp_path.iterdir())


def test_a_time_limit_leaves_one_attempt_and_ends_others_within(tmp_path):
    looks = []

    def attempt(state):
        looks.append(state.done)
        stop_if_asked()

    for made in (1, 2, 3):
        how = Drive(tmp_path / "run.voxgran", resume=True, time_limit=0.0)
        ended = drive(counting(3, attempt), task_of("rsa").problem, how)
        assert (ended.done, ended.stop_reason) == (made, "count" if made == 3 else "interrupted")
    assert looks == [0, 1, 2]


def test_the_last_snapshot_is_taken_once_also_after_a_stop(tmp_path):
    taken = []

    class Recorder:
        def due(self, done):
            return (done // 4 + 1) * 4

        def record(self, packing, done):
            taken.append(done)

    def attempt(state):
        if state.done == 9:
            signal.raise_signal(signal.SIGTERM)

    path, method = tmp_path / "run.voxgran", replace(counting(10, attempt), finish=lambda problem, state: None)
    with pytest.raises(Interrupted):
        drive(method, task_of("rsa").problem, Drive(path, recorder=Recorder()))
    assert taken == [4, 8]
    drive(method, task_of("rsa").problem, Drive(path, resume=True, recorder=Recorder()))
    assert taken == [4, 8, 10]


def test_a_checkpoint_is_written_by_one_run_at_a_time(tmp_path):
    path = tmp_path / "run.voxgran"
    with locked_file(path), pytest.raises(InUseError, match=r"run.voxgran is in use by process \d+ on"):
        drive(counting(1), task_of("rsa").problem, Drive(path))
    assert not list(tmp_path.iterdir())
    drive(counting(1), task_of("rsa").problem, Drive(path))
    assert [file.name for file in tmp_path.iterdir()] == ["run.voxgran"]
