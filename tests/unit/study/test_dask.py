"""Studies on a Dask cluster: the bits of processes, and one sentence where the scheduler goes away."""

import os
import signal
import sys
import time
import types
from dataclasses import replace

import numpy as np
import pytest
from kit import dask_cluster

import voxgran as vg
from voxgran._base.errors import ClusterError, Interrupted, MissingLibraryError
from voxgran._base.lock import locked_file
from voxgran.study import dask_runs, runs
from voxgran.study.dask_runs import DaskRuns
from voxgran.study.result import MACHINE
from voxgran.study.runs import MARK, Run, compute, compute_with_file, marked


def test_a_missing_library_is_one_sentence(base, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    made = vg.Study(base=base | {"measure": {"which": ["density"]}}, seeds=1)
    with pytest.raises(MissingLibraryError, match=r"pip install voxgran\[dask\]"):
        made.run(tmp_path / "o", dask="tcp://127.0.0.1:1")


@pytest.fixture
def cluster(marks):
    """Start a cluster."""
    with dask_cluster(marks.place.parent) as started:
        yield started


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_processes_and_dask_give_the_same_bits(cluster, base, marks, tmp_path):
    _, address = cluster
    axes = {"method": ["rsa", {"method": "expand", "solid_fraction": 0.3}]}
    # a fault, and a worker that is killed in the middle once
    marks.order(fail=[3], kill={"2": 1})
    made = vg.Study(base=base, axes=axes, seeds=[1, 2, 3], keep="packings")
    steps = []
    there = made.run(tmp_path / "dask", dask=address, on_step=steps.append)
    assert there.computed == 6
    assert steps[-1].done == 6
    assert [row["seed"] for row in there.failures] == [3, 3]
    assert len(marks.begun()[2]) == 3
    here = made.run(tmp_path / "processes", workers=2)
    assert there.dataset.drop_vars(list(MACHINE)).identical(here.dataset.drop_vars(list(MACHINE)))
    names = [{path.name for path in (tmp_path / one / "cells").iterdir()} for one in ("dask", "processes")]
    assert names[0] == names[1]
    for name in names[0]:
        if name.endswith(".vtp"):
            one, other = (vg.load(tmp_path / place / "cells" / name) for place in ("dask", "processes"))
            assert one.position.tobytes() == other.position.tobytes()
    # what one has finished the other does not compute
    assert made.run(tmp_path / "processes", dask=address).computed == 0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_scheduler_that_goes_away_ends_in_one_sentence_and_the_study_goes_on(cluster, base, marks, tmp_path, capfd):
    process, address = cluster
    marks.order(wait=0.3)
    made = vg.Study(base=base, seeds=range(1, 13))
    gone = []

    def stop(step):
        if step.done >= 3 and not gone:
            gone.append(time.monotonic())
            os.killpg(process.pid, signal.SIGKILL)

    with pytest.raises(ClusterError, match=rf"^the Dask scheduler at {address} is gone: what is finished is kept"):
        made.run(tmp_path / "o", dask=address, on_step=stop)
    assert time.monotonic() - gone[0] < 20
    assert capfd.readouterr().err == ""
    kept = made.plan(tmp_path / "o").total("done")
    assert 3 <= kept < 12
    with pytest.raises(ClusterError, match="there is no Dask scheduler"):
        made.run(tmp_path / "o", dask=address)
    marks.order()
    result = made.run(tmp_path / "o", workers=2)
    assert result.computed == 12 - kept
    assert np.array_equal(result.dataset["mark"], np.arange(10, 130, 10))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_an_interrupt_leaves_the_cluster_alone(cluster, base, marks, tmp_path):
    _, address = cluster
    marks.order(wait=0.2)
    made = vg.Study(base=base, seeds=range(1, 25))
    sent = []

    def stop(step):
        if step.done >= 2 and not sent:
            sent.append(step)
            os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(Interrupted) as told:
        made.run(tmp_path / "o", dask=address, on_step=stop)
    assert told.value.exit_code == 130
    marks.order()
    cluster_like = types.SimpleNamespace(scheduler_address=address)
    assert not made.run(tmp_path / "o", dask=cluster_like).failures


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::ResourceWarning")
def test_a_run_goes_on_from_its_checkpoint_where_the_worker_sees_the_folder(cluster, base, marks, tmp_path):
    _, address = cluster
    # killed after packing: the second worker packs nothing, and leaves the checkpoint as it is
    marks.order(kill={"2": 1}, watch=str(tmp_path / "o" / "checkpoints"))
    result = vg.Study(base=base, seeds=[2]).run(tmp_path / "o", dask=address)
    assert not result.failures
    first, second = (marks.place / "stamps").read_text().splitlines()
    assert first
    assert first == second
    assert list((tmp_path / "o" / "checkpoints").glob("*.voxgran")) == []
    assert not (tmp_path / "o" / "checkpoints" / MARK).exists()


def test_a_worker_that_does_not_see_the_folder_begins_anew(base, tmp_path, monkeypatch):
    given = []
    monkeypatch.setattr(runs, "compute", lambda run: given.append(run.checkpoint))
    file = tmp_path / "checkpoints" / "a.voxgran"
    with marked(file.parent) as mark:
        asked = Run(key="a", cell="c", mapping=base, seed=1, checkpoint=str(file), mark=mark)
        compute_with_file(asked)
        compute_with_file(replace(asked, mark="another study"))
        compute_with_file(replace(asked, checkpoint=str(tmp_path / "elsewhere" / "a.voxgran")))
    compute_with_file(asked)
    assert given == [str(file), "", "", ""]


def test_a_checkpoint_that_another_worker_writes_is_left_alone(base, tmp_path):
    scene = {**base, "measure": {"which": ["density"]}}
    file = tmp_path / "a.voxgran"
    with locked_file(file):
        file.write_text("of the other one")
        found = compute(Run(key="a", cell="c", mapping=scene, seed=3, checkpoint=str(file)))
    assert not found.failure
    assert file.read_text() == "of the other one"


def test_a_run_is_given_up_only_where_its_checkpoint_gets_no_further(tmp_path):
    checkpoint = tmp_path / "run.voxgran"
    run, runs = Run(key="a", cell="c", mapping={}, seed=0, checkpoint=str(checkpoint)), DaskRuns("tcp://127.0.0.1:1")
    for second in range(1, 5):
        checkpoint.touch()
        os.utime(checkpoint, (second, second))
        assert runs._goes_on(run)
    assert runs._goes_on(run)
    assert not runs._goes_on(run)


def test_runs_under_way_are_the_first_ones_as_far_as_there_are_threads(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(dask_runs, "time", types.SimpleNamespace(monotonic=lambda: clock[0]))
    submitted = [Run(key=str(k), cell="", mapping={}, seed=k) for k in range(4)]
    work = DaskRuns("tcp://nowhere:1")
    work._left = {run.key: (run, None) for run in submitted}
    work._client = types.SimpleNamespace(nthreads=lambda: {"a": 1, "b": 1})
    assert work.under_way == [(submitted[0], 0.0), (submitted[1], 0.0)]
    clock[0] = 107.0
    del work._left["0"]
    assert work.under_way == [(submitted[1], 7.0), (submitted[2], 0.0)]
