"""Studies in processes: the numbers of single scenes, nothing computed twice, faults and kills cost one run."""

import csv
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray

import voxgran as vg
from voxgran._base.checkpoint import load_checkpoint
from voxgran._base.errors import (
    InputError,
    Interrupted,
    InUseError,
    MissingLibraryError,
    OutputExistsError,
    PackingWarning,
)
from voxgran._base.lock import locked_folder
from voxgran.study import engine, processes, runs
from voxgran.study.engine import Store, memory_bytes
from voxgran.study.processes import FIRST, Processes
from voxgran.study.result import MACHINE
from voxgran.study.runs import Record, Run, compute


def same(one, other):
    """Return whether two results are the same bits, without what the machine did."""
    return one.dataset.drop_vars(list(MACHINE)).identical(other.dataset.drop_vars(list(MACHINE)))


def alive(number):
    """Return whether a process runs."""
    try:
        with open(f"/proc/{number}/stat", encoding="ascii") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.usefixtures("forked_workers")
def test_results_are_those_of_single_scenes(base, tmp_path):
    base |= {"measure": {"which": ["density", "coordination"]}}
    axes = {"method": ["rsa", {"method": "expand", "solid_fraction": 0.2}], "packing.count": [5, 60]}
    made = vg.Study(base=base, axes=axes, seeds=[3, 7], keep="packings")
    result = made.run(tmp_path / "out", workers=2)
    data = result.dataset
    assert dict(data.sizes) == {"method": 2, "packing.count": 2, "seed": 2}
    assert list(data["method"].values) == ["rsa", "expand"]
    assert result.computed == 8
    for cell in made.cells():
        for seed in made.seeds:
            scene = vg.Scene.from_mapping(cell.mapping | {"scene": {"seed": seed}})
            with warnings.catch_warnings(action="ignore", category=PackingWarning):
                packing = vg.pack([vg.make_shape("sphere")], scene.container, **scene.asked(), **scene.parameters)
                tree = vg.measure(packing, which=["density", "coordination"])
            entry = data.sel({**cell.values, "seed": seed})
            assert float(entry["solid_fraction"]) == packing.solid_fraction
            assert float(entry["mean_coordination_number"]) == float(tree["mean_coordination_number"])
            assert str(entry["stop_reason"].item()) == packing.stop_reason
            assert not entry["failure"].item()
            assert float(entry["overlapping_pairs"]) == 0
    assert data["solid_fraction"].attrs["units"] == "1"
    assert data["bulk_solid_fraction"].isnull().any()
    assert "the bulk holds" in data["warnings"].values[0, 0, 0]
    assert (data["seconds"] > 0).all()
    assert ((data["memory"] > 50e6) & (data["memory"] < 4e9)).all()
    files = {path.suffix for path in (tmp_path / "out" / "cells").iterdir()}
    assert files == {".json", ".vtp"}
    again = vg.load_statistics(tmp_path / "out" / "study.nc").to_dataset()
    assert again.equals(data)
    with open(tmp_path / "out" / "table.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8
    assert [float(row["solid_fraction"]) for row in rows] == data["solid_fraction"].values.ravel().tolist()
    assert result.table()["solid_fraction"].tolist() == data["solid_fraction"].values.ravel().tolist()


def test_nothing_is_computed_twice(base, marks, tmp_path, here):
    def run(counts, seeds, **given):
        return vg.Study(base=base, axes={"packing.count": counts}, seeds=seeds).run(tmp_path / "o", **given)

    first = run([5, 6], [1, 2])
    assert first.computed == 4
    assert run([5, 6], [1, 2]).computed == 0
    assert same(run([5, 6], [1, 2]), first)
    # a changed axis, and one more seed
    more = run([6, 7], [1, 2, 3])
    assert more.computed == 4
    assert {seed: len(begun) for seed, begun in marks.begun().items()} == {1: 3, 2: 3, 3: 2}
    assert np.array_equal(more.dataset["mark"], [[10, 20, 30], [10, 20, 30]])
    assert more.dataset["mark"].attrs == {"units": "m", "long_name": "mark of the seed"}
    # labels change nothing
    listed = [{"packing.count": 6, "label": "six"}]
    assert vg.Study(base=base, cells=listed, seeds=[1, 2, 3]).run(tmp_path / "o").computed == 0
    # damaged, cut and foreign files are computed anew
    files = sorted((tmp_path / "o" / "cells").iterdir())
    assert len(files) == 8
    files[0].write_text(files[0].read_text().replace("0.", "1.", 1))
    files[1].write_text(files[1].read_text()[:-40])
    files[2].write_text("[]")
    files[3].write_bytes(b"\xff\xfe")
    assert run([5, 6, 7], [1, 2, 3]).computed == 4 + 1
    assert run([5, 6], [1, 2], overwrite=True).computed == 4
    assert same(run([5, 6], [1, 2]), first)


def test_cells_that_are_the_same_scene_are_computed_once(base, tmp_path, here):
    base |= {"measure": {"which": ["density"]}}
    result = vg.Study(base=base, axes={"packing.count": [5, 6], "packing.tries": [1000]}, seeds=1).run(tmp_path / "o")
    twice = vg.Study(base=base, cells=[{"packing.count": 5}, {"packing": {"count": 5, "tries": 1000}}], seeds=1)
    assert twice.run(tmp_path / "two").rows[0]["solid_fraction"] == result.rows[0]["solid_fraction"]
    equal = vg.Study(base=base, cells=[{"label": "a"}, {"label": "b"}], seeds=1).run(tmp_path / "three")
    assert equal.computed == 1
    assert [row["cell"] for row in equal.rows] == ["a", "b"]
    assert equal.rows[0]["grain_volume"] == equal.rows[1]["grain_volume"]


@pytest.mark.usefixtures("forked_workers")
def test_faults_and_kills_cost_their_run_only(base, marks, tmp_path, request):
    # seed 3 ends its process each time, seed 5 fails
    marks.order(kill={"3": 9}, fail=[5])
    made = vg.Study(base=base, seeds=range(1, 7))
    result = made.run(tmp_path / "o", workers=2)
    data = result.dataset
    assert {seed: len(begun) for seed, begun in marks.begun().items()} == {s: 2 if s == 3 else 1 for s in range(1, 7)}
    assert [bool(text) for text in data["failure"].values] == [seed in (3, 5) for seed in range(1, 7)]
    assert "its process was ended by SIGKILL, 2 times" in data["failure"].values[2]
    assert data["failure"].values[4] == "RuntimeError: a fault of two lines"
    assert np.array_equal(data["mark"].values, [10, 20, np.nan, 40, np.nan, 60], equal_nan=True)
    assert [row["seed"] for row in result.failures] == [3, 5]
    # failures are kept, and tried again where asked
    marks.order()
    assert made.run(tmp_path / "o").computed == 0
    request.getfixturevalue("here")
    again = made.run(tmp_path / "o", retry=True)
    assert again.computed == 2
    assert not again.failures
    assert np.array_equal(again.dataset["mark"].values, np.arange(10, 70, 10))


def test_what_cannot_be_packed_is_a_row_and_no_end(base, tmp_path, here):
    base |= {"measure": {"which": ["density"]}}
    made = vg.Study(base=base, axes={"container.lengths": [[4, 4, 4], [0.5, 0.5, 0.5]]}, seeds=2)
    plan = made.plan(tmp_path / "o")
    assert [bool(cell.refusal) for cell in plan.cells] == [False, True]
    assert [cell.left for cell in plan.cells] == [2, 0]
    result = made.run(tmp_path / "o")
    assert result.computed == 2
    assert [bool(row["failure"]) for row in result.rows] == [False, False, True, True]
    runs = "4 runs, 2 finished, 2 failed; container.lengths 2 x seed 2"
    assert repr(result) == f"StudyResult({runs}; in {str(tmp_path / 'o')!r})"
    assert "cannot be done  container.lengths [0.5, 0.5, 0.5]: " in str(plan)


@pytest.mark.usefixtures("forked_workers")
def test_a_process_ends_with_the_one_that_started_it(base, marks):
    marks.order(wait=60)
    with Processes(1, 10**9) as pool:
        results = pool.results([Run(key="a", cell="a", mapping=base, seed=7)])
        until = time.monotonic() + 60
        while not marks.begun() and time.monotonic() < until:
            next(results)
        (worker,) = pool._workers
        assert marks.begun() == {7: [worker.process.pid]}
        # what the system does when this process dies
        worker.connection.close()
        assert worker.process.wait(timeout=10) == -signal.SIGKILL


class Sent(list):
    """Takes what is sent to a process that is not there."""

    send = list.extend

    def close(self):
        """Close nothing."""


@pytest.mark.parametrize(
    ("mebibytes", "limit", "begun"),
    [
        # idle processes have loaded their libraries, too
        ([300, 300, 300], 900, [[300], [300], [300]]),
        ([300, 300, 300], 850, [[300], [300], []]),
        ([600, 600, 600], 1000, [[600], [], []]),
        # what does not fit beside the longest run lets others pass
        ([600, 500, 100, 90], 1100, [[600], [100], [90]]),
        # alone a run is begun
        ([900, 900], 1000, [[900], [], []]),
    ],
)
def test_what_is_begun_at_once_fits_in_memory(monkeypatch, mebibytes, limit, begun):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    monkeypatch.setattr(processes, "_started", lambda: processes._Worker(ended, Sent()))
    monkeypatch.setattr(processes, "wait", lambda connections, timeout: [])
    runs = [Run(key=str(k), cell="", mapping={}, seed=k, memory=size * 2**20) for k, size in enumerate(mebibytes)]
    with Processes(3, limit * 2**20) as pool:
        next(pool.results(runs))
        assert [[run.memory // 2**20 for run in worker.connection] for worker in pool._workers] == begun


def test_memory_is_a_limit(base, tmp_path, here):
    made = vg.Study(base=base | {"measure": {"which": ["density"]}}, seeds=1)
    refused = made.run(tmp_path / "two", memory="100 MB")
    assert refused.computed == 0
    assert "more than the 95 MiB that memory allows" in refused.rows[0]["failure"]
    # it is asked anew
    assert not made.run(tmp_path / "two").failures


def test_memory_is_given_in_many_ways(monkeypatch):
    monkeypatch.setattr(engine, "memory_limit", lambda: 10**10)
    ways = {None: 8e9, 5_000: 5e3, "6GB": 6e9, "6 gib": 6 * 2**30, "1.5g": 1.5e9, "50%": 5e9, "800 MB": 8e8, "9kB": 9e3}
    assert {given: memory_bytes(given) for given in ways} == ways
    for wrong in ("much", "-3", "0", 0, True, "5 lb", ""):
        with pytest.raises(InputError, match="it must be bytes"):
            memory_bytes(wrong)


class Noting:
    """Computes nothing: notes what it is asked for, and says that each run took so many seconds."""

    running, compiling, loading, under_way = 0, False, False, ()

    def __init__(self, seconds):
        self.seconds, self.order = seconds, []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def results(self, runs):
        for run in runs:
            self.order.append(run)
            yield run, Record(numbers={"x": [0.0, "1", "x"]}, seconds=self.seconds(run)), b""


def test_the_longest_runs_are_begun_first(base, tmp_path, monkeypatch):
    base |= {"measure": {"which": ["density"]}}
    noting = Noting(lambda run: run.attempts * (1e-6 if run.mapping["packing"]["method"] == "rsa" else 1.0))
    monkeypatch.setattr(engine, "_executor", lambda options, runs: noting)

    def order(counts, seeds):
        noting.order.clear()
        axes = {"method": ["rsa", {"method": "expand", "solid_fraction": 0.2}], "packing.count": counts}
        vg.Study(base=base, axes=axes, seeds=seeds).run(tmp_path / "o")
        return [(run.mapping["packing"]["method"], run.mapping["packing"]["count"]) for run in noting.order]

    # the shortest run of each method tells how long others may take, of which nothing is known yet
    first = order([5, 20, 10], 1)
    assert sorted(first[:2]) == [("expand", 5), ("rsa", 5)]
    assert [count for method, count in first[2:] if method == "rsa"] == [20, 10]
    # then the method whose attempts take longer comes first
    second = order([5, 20, 10], 2)
    assert [method for method, _ in second] == ["expand"] * 3 + ["rsa"] * 3


def test_the_dataset_is_written_as_zarr_too(base, tmp_path, monkeypatch):
    zarr = pytest.importorskip("zarr")
    base |= {"measure": {"which": ["density"]}}
    monkeypatch.setattr(engine, "_executor", lambda options, runs: Noting(lambda run: 1.0))
    result = vg.Study(base=base, axes={"packing.count": [4, 5]}, seeds=2).run(tmp_path / "o", zarr=True)
    assert result.dataset["x"].shape == zarr.open(tmp_path / "o" / "study.zarr")["x"].shape == (2, 2)
    vg.Study(base=base, axes={"packing.count": [4, 5, 6]}, seeds=2).run(tmp_path / "o", zarr=True)
    again = xarray.open_zarr(tmp_path / "o" / "study.zarr")
    assert again["packing.count"].values.tolist() == [4, 5, 6]
    assert again["failure"].values.tolist() == [["", ""]] * 3
    assert not [path for path in (tmp_path / "o").iterdir() if path.name.startswith(".")]
    (tmp_path / "o" / "study.zarr" / "thesis.txt").write_text("kept")
    with pytest.raises(OutputExistsError, match=r"holds thesis\.txt"):
        vg.Study(base=base, axes={"packing.count": [4, 5, 6]}, seeds=2).run(tmp_path / "o", zarr=True)
    assert (tmp_path / "o" / "study.zarr" / "thesis.txt").read_text() == "kept"
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(MissingLibraryError, match="pip install zarr"):
        vg.Study(base=base, seeds=1).run(tmp_path / "new", zarr=True)
    assert not (tmp_path / "new").exists()


@pytest.mark.usefixtures("forked_workers")
def test_steps_count_the_runs(base, marks, tmp_path):
    steps = []
    marks.order(fail=[2])
    vg.Study(base=base, seeds=[1, 2, 3]).run(tmp_path / "o", workers=1, on_step=steps.append)
    assert (steps[-1].stage, steps[-1].done, steps[-1].total) == ("runs", 3, 3)
    assert steps[-1].text == "3 of 3, 0 running, 1 failed"
    assert [step.done for step in steps] == sorted(step.done for step in steps)


class Clocked(Noting):
    """Computes runs by a clock of its own, so many at a time, and looks each five seconds; some are killed."""

    #: CPU seconds in a second of a run
    speed = 1.0

    def __init__(self, seconds, workers=1, killed=()):
        super().__init__(seconds)
        self.workers, self.killed, self.given = workers, killed, []

    @property
    def under_way(self):
        """Return the runs that are computed now with the seconds that each has been."""
        return [(run, self.clock - begun) for _, begun, run in self.given]

    def give(self, waiting):
        """Begin as many runs as there are workers."""
        while waiting and len(self.given) < self.workers:
            run = waiting.pop(0)
            self.given.append((self.clock + self.seconds(run) - run.before, self.clock, run))

    def results(self, runs):
        waiting = list(runs)
        while waiting or self.given:
            self.give(waiting)
            ends, begun, run = min(self.given, key=lambda one: one[0])
            while self.clock + 5.0 < ends:
                self.clock += 5.0
                yield None
            self.clock = ends
            self.given.remove((ends, begun, run))
            self.give(waiting)
            if run.seed in self.killed:
                yield run, Record(failure="killed"), b""
                continue
            elapsed = ends - begun
            made = {"elapsed": elapsed, "seconds": run.before + elapsed * self.speed}
            yield run, Record(numbers={"x": [0.0, "1", "x"]}, **made), b""


def seconds_left(base, tmp_path, monkeypatch, work, **study):
    """Return for each step of a study the words before the time that it tells, that time, and the true one."""
    base |= {"measure": {"which": ["density"]}}
    told = []
    work.clock = time.monotonic()
    monkeypatch.setattr(engine, "time", SimpleNamespace(monotonic=lambda: work.clock))
    monkeypatch.setattr(engine, "_executor", lambda options, runs: work)
    vg.Study(base=base, **study).run(tmp_path / "o", on_step=lambda step: told.append((work.clock, step.text)))
    found = []
    for now, text in told[:-1]:
        one = re.search(r"(about|at least) (\d+) (s|min) left|(longer than expected)|$", text)
        seconds = int(one[2]) * (60 if one[3] == "min" else 1) if one[2] else math.nan
        found.append((one[1] or one[4], seconds, told[-1][0] - now))
    return found


METHODS = {"rsa": (8.0, 0.0, 1.0), "deposition": (1.0, 20.0, 0.2), "expand": (30.0, 0.0, 3.0)}


def mixed(run):
    """Return the seconds of a run: a fixed part and one by grains, each by method and shape, with a scatter."""
    fixed, each, slope = METHODS[run.mapping["packing"]["method"]]
    grains = run.mapping["packing"]["count"]
    seconds = fixed + each + slope * grains
    if run.mapping["shape"][0]["family"] == "ellipsoid":
        seconds *= 4.0
    return seconds * (0.8, 1.0, 1.2)[(run.seed + grains + len(run.mapping["packing"]["method"])) % 3]


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("speed", [1.0, 0.4])
def test_the_time_that_is_left_is_told_within_a_factor(base, tmp_path, monkeypatch, workers, speed):
    """Methods and shapes differ, runs have a fixed part: what is told to be about so long is so from the start on."""
    work = Clocked(mixed, workers)
    work.speed = speed
    axes = {
        "method": ["rsa", "deposition", {"method": "expand", "solid_fraction": 0.1}],
        "shape": ["sphere", "ellipsoid"],
        "packing.count": [2, 8, 30],
    }
    found = seconds_left(base, tmp_path, monkeypatch, work, axes=axes, seeds=3)
    whole = found[0][2]
    # at first nothing is known, and all when the shortest and the longest run of each kind are finished
    assert found[0][0] is None
    assert {words for words, _, true in found if 0.1 * whole < true < 0.65 * whole} == {"about"}
    for words, seconds, true in found:
        if words == "about" and true > 0.2 * whole:
            assert true / 1.5 < seconds < true * 1.5
        elif words == "at least":
            assert seconds < 1.1 * true


def test_what_earlier_sessions_computed_is_known(base, tmp_path, monkeypatch):
    """The seconds of finished runs and those before a checkpoint are those of another session."""
    axes = {"packing.count": [2, 30]}
    work = Clocked(mixed)
    seconds_left(base, tmp_path, monkeypatch, work, axes=axes, seeds=2)
    make = Store.checkpoint

    def checkpoint(store, key):
        path = make(store, key)
        if not path.exists():
            path.write_bytes(b"")
            path.with_name(f"{path.name}.seconds").write_text("4.0")
        return path

    monkeypatch.setattr(Store, "checkpoint", checkpoint)
    work = Clocked(mixed)
    found = seconds_left(base, tmp_path, monkeypatch, work, axes=axes, seeds=4)
    for words, seconds, true in found:
        assert words == "about"
        assert seconds == pytest.approx(true, rel=0.4, abs=5)


def test_runs_that_are_killed_are_not_taken_for_slow(base, tmp_path, monkeypatch):
    work = Clocked(lambda run: 20.0 + run.seed % 3, workers=2, killed=range(2, 12))
    found = seconds_left(base, tmp_path, monkeypatch, work, seeds=20)
    assert [words for words, *_ in found].count("about") > 30
    for words, seconds, true in found:
        if words == "about" and true > 0.2 * found[0][2]:
            assert true / 1.5 < seconds < true * 1.5
        assert words != "longer than expected"


def test_a_time_that_may_be_all_fixed_is_a_bound(base, tmp_path, monkeypatch):
    """With all finished runs of one count, those of others may take as long, or by attempts."""
    axes = {"packing.count": [3, 30]}
    work = Clocked(lambda run: 40.0)
    found = seconds_left(base, tmp_path, monkeypatch, work, axes=axes, seeds=2)
    assert [words for words, *_ in found].count("at least") > 3
    assert not [1 for words, seconds, true in found if words and seconds > true + (5 if seconds < 300 else 30)]


def test_a_run_that_takes_longer_than_expected_is_not_about_to_end(base, tmp_path, monkeypatch):
    work = Clocked(lambda run: 150.0 if run.seed == 1 else 10.0)
    found = seconds_left(base, tmp_path, monkeypatch, work, seeds=2)
    assert [words for words, *_ in found].count("longer than expected") > 20


@pytest.mark.usefixtures("forked_workers")
def test_an_interrupted_study_goes_on(base, marks, tmp_path, request):
    marks.order(wait=0.3)
    made = vg.Study(base=base, seeds=range(1, 9))
    sent = []

    def stop(step):
        if step.done >= 3 and not sent:
            sent.append(time.monotonic())
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(Interrupted, match=r"stopped after \d of 8 runs, which are kept") as told:
        made.run(tmp_path / "o", workers=2, on_step=stop)
    assert time.monotonic() - sent[0] < 1.0
    assert told.value.exit_code == 143
    assert not any(alive(number) for begun in marks.begun().values() for number in begun)
    kept = {json.loads(path.read_text())["run"]["seed"] for path in (tmp_path / "o" / "cells").iterdir()}
    assert 3 <= len(kept) < 8
    plan = made.plan(tmp_path / "o")
    assert (plan.total("done"), plan.total("left")) == (len(kept), 8 - len(kept))
    before = marks.begun()
    marks.order()
    # what is left is computed in this process, and all of it once more
    request.getfixturevalue("here")
    result = made.run(tmp_path / "o")
    assert result.computed == 8 - len(kept)
    assert all(marks.begun()[seed] == before[seed] for seed in kept)
    assert same(result, made.run(tmp_path / "two"))


def test_folders_of_others_are_left_alone(base, tmp_path, here):
    made = vg.Study(base=base | {"measure": {"which": ["density"]}}, seeds=1)
    (tmp_path / "notes.txt").write_text("notes")
    with pytest.raises(OutputExistsError, match="holds something else than a study"):
        made.run(tmp_path, overwrite=True)
    with pytest.raises(OutputExistsError, match="is a file"):
        made.run(tmp_path / "notes.txt")
    made.run(tmp_path / "o")
    with locked_folder(tmp_path / "o"), pytest.raises(InUseError):
        made.run(tmp_path / "o")
    for wrong in ({"workers": 0}, {"memory": "much"}, {"dask": 8786}):
        with pytest.raises(InputError, match=next(iter(wrong))):
            made.run(tmp_path / "new", **wrong)
    assert not (tmp_path / "new").exists()


def test_the_hash_is_that_of_values_files_and_version(base, tmp_path, monkeypatch, data_dir):
    def key(folder, **given):
        scene = base | {"shape": [{"file": "rock.obj"}], "measure": {"which": ["density"]}} | given
        monkeypatch.chdir(folder)
        return vg.Study(base=scene, seeds=1).cells()[0].key

    rock = (data_dir / "bennu_lp.obj").read_bytes()
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "rock.obj").write_bytes(rock + (b"# more\n" if name == "c" else b""))
    first = key(tmp_path / "a")
    assert key(tmp_path / "b") == first
    assert key(tmp_path / "c") != first
    assert key(tmp_path / "a", output={"dem": ["lammps"]}, scene={"seed": 5}) == first
    assert key(tmp_path / "a", scene={"unit": "mm"}) != first
    assert key(tmp_path / "a", packing=base["packing"] | {"count": 6}) != first
    assert key(tmp_path / "a", measure={"which": ["density", "coordination"]}) != first
    monkeypatch.setattr("voxgran.study.files.__version__", "9.9")
    assert key(tmp_path / "a") != first


def test_a_file_that_changes_during_a_study_gives_no_numbers(base, tmp_path, data_dir, here):
    """Results are kept under the hash of the file as it was: those of another one would be found for ever."""
    old, new = (data_dir / name for name in ("bennu_lp.obj", "eros.obj"))
    rock = tmp_path / "rock.obj"
    rock.write_bytes(old.read_bytes())
    scene = {
        "shape": [{"file": str(rock)}],
        "sizes": {"kind": "fixed", "diameter": 0.5},
        "measure": {"which": ["density"]},
    }
    study = vg.Study(base=base | scene, seeds=1)
    rock.write_bytes(new.read_bytes())
    changed = study.run(tmp_path / "out")
    assert "rock.obj has changed since the study began" in str(changed.dataset["failure"].values)
    rock.write_bytes(old.read_bytes())
    again = study.run(tmp_path / "out", retry=True)
    assert again.computed == 1
    assert not again.dataset["failure"].values.any()


def test_a_run_goes_on_from_its_checkpoint(tmp_path):
    """Its process is killed when the first checkpoint lies there; numbers are those of a run without an end."""
    scene = {
        "shape": [{"family": "sphere"}],
        "container": {"kind": "box", "lengths": [40, 40, 40]},
        "packing": {"method": "rsa", "count": 20_000},
        "measure": {"which": ["density"]},
    }
    file = tmp_path / "checkpoints" / "a.voxgran"
    run = Run(key="a", cell="c", mapping=scene, seed=3, checkpoint=str(file))
    whole = compute(replace(run, checkpoint=""))
    assert not whole.failure
    script = (
        "import json, os, signal, sys; from voxgran.packing import driver; from voxgran.study.runs import Run, compute;"
        "driver.CHECKPOINT_SECONDS = 0.0; kept = driver._Keeper.keep\n"
        "def keep(self, state, *, at_once):\n"
        "    kept(self, state, at_once=at_once)\n"
        "    keep.times += 1\n"
        "    if keep.times == 3: os.kill(os.getpid(), signal.SIGKILL)\n"
        "keep.times, driver._Keeper.keep = 0, keep\n"
        "compute(Run(**json.loads(sys.argv[1])))"
    )
    asked = json.dumps(asdict(run))
    ended = subprocess.run([sys.executable, "-c", script, asked], check=False, capture_output=True)
    assert ended.returncode == -signal.SIGKILL
    done = load_checkpoint(file)[0]["done"]
    assert 0 < done < 20_000
    before = float((tmp_path / "checkpoints" / "a.voxgran.seconds").read_text())
    assert before > 0
    begun = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runs.Checkpoint, "_note", lambda self, step: begun.append(step.done))
        found = compute(run)
    assert min(step for step in begun if step) > done
    assert (str(found.numbers), found.stop_reason) == (str(whole.numbers), whole.stop_reason)
    assert found.seconds > before
    # a finished run leaves no checkpoint
    assert [path.name for path in file.parent.iterdir() if path.suffix != ".lock"] == []


def test_a_checkpoint_that_belongs_to_another_run_is_left_out(tmp_path, base):
    scene = {**base, "measure": {"which": ["density"]}}
    run = Run(key="a", cell="c", mapping=scene, seed=3, checkpoint=str(tmp_path / "a.voxgran"))
    whole = compute(replace(run, checkpoint=""))
    (tmp_path / "a.voxgran").write_bytes(b"no checkpoint")
    (tmp_path / "a.voxgran.seconds").write_text("1e9")
    found = compute(run)
    assert (found.failure, str(found.numbers)) == ("", str(whole.numbers))
    assert found.seconds < 1e6


@pytest.mark.usefixtures("forked_workers")
def test_a_killed_run_of_a_study_goes_on(tmp_path, base, marks, request):
    """The measure ends the process once: the packing is not made again, and checkpoints of finished runs are gone."""
    marks.order(kill={"1": 1})
    result = vg.Study(base=base, seeds=[1, 2]).run(tmp_path / "o", workers=1)
    assert not any(record.failure for record in [*map(Store(tmp_path / "o").read, keys_in(tmp_path / "o"))])
    assert len(marks.begun()[1]) == 2
    assert not list((tmp_path / "o" / "checkpoints").glob("*.voxgran*"))
    marks.order()
    request.getfixturevalue("here")
    assert same(result, vg.Study(base=base, seeds=[1, 2]).run(tmp_path / "two"))


def keys_in(folder):
    """Return the keys of the runs in the folder of a study."""
    return [path.stem for path in (folder / "cells").glob("*.json")]


def test_what_a_worker_computes_at_first_succeeds():
    assert compute(Run(key="", cell="", mapping=FIRST, seed=0)).failure == ""


def test_drafts_that_a_killed_study_has_left_are_removed(base, tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "_executor", lambda options, runs: Noting(lambda run: 1.0))
    mine, other = ".voxgran-0a1b2c3d-0a1b2c3d", ".voxgran-thesis"
    for folder in ("cells", "checkpoints"):
        (tmp_path / folder).mkdir()
        for name in (f"{mine}.json", f"{mine}.vtp", mine, other):
            (tmp_path / folder / name).write_text("half")
    (tmp_path / f"{mine}.nc").write_text("half")
    vg.Study(base=base | {"measure": {"which": ["density"]}}, seeds=1).run(tmp_path)
    assert [path.name for path in tmp_path.rglob(".voxgran*")] == [other, other]
