"""What a study tells while it runs: that kernels are compiled, how long it takes, and how to go on after a signal."""

import os
import signal
import time
from multiprocessing.connection import Connection, Pipe

import pytest

import voxgran as vg
from voxgran._base.errors import Interrupted
from voxgran.study import engine
from voxgran.study.durations import Durations
from voxgran.study.processes import COMPILED, COMPILING, READY, Processes
from voxgran.study.runs import Run

#: a worker that compiles for a second, and computes each run in no time
COMPILES_FIRST = """
import sys, time
sys.path[:] = sys.argv[2:]
from multiprocessing.connection import Connection
from voxgran.study.runs import Record
from voxgran.study.processes import COMPILED, COMPILING, READY
connection = Connection(int(sys.argv[1]))
connection.send(COMPILING)
time.sleep(1)
connection.send(COMPILED)
connection.send(READY)
while True:
    for run in connection.recv():
        time.sleep(0.02)
        connection.send((Record(numbers={"x": [0.0, "1", "x"]}, seconds=0.02), 0.02))
"""


def test_compilation_is_told_and_not_extrapolated(base, marks, tmp_path, monkeypatch):
    monkeypatch.setattr("voxgran.scene.processes._START", COMPILES_FIRST)
    monkeypatch.setattr(engine, "TELL_SECONDS", 0.0)
    steps = []
    vg.Study(base=base, seeds=range(20)).run(tmp_path / "o", workers=1, on_step=steps.append)
    texts = [step.text for step in steps]
    assert "0 of 20, 1 running, 0 failed, compiling kernels (once per machine)" in texts
    told = [step for step in steps if "left" in step.text]
    assert texts[0] == "0 of 20, 1 running, 0 failed, loading libraries"
    assert told[0].done == 1
    # twenty times the second of compilation would be more
    assert all(float(step.text.split()[-3]) < 5 for step in told), told
    assert "compiling" not in texts[-1]


@pytest.mark.slow
def test_a_worker_tells_that_it_compiles(base, marks, monkeypatch):
    heard = []

    class Noted(Connection):
        def recv(self):
            heard.append(super().recv())
            return heard[-1]

    def noted_pipe():
        here, there = Pipe()
        noted = Noted(os.dup(here.fileno()))
        here.close()
        return noted, there

    module = marks.place.parent / "marking.py"
    kernel = f"""
from voxgran._base.kernels import kernel

@kernel
def shifted(x):
    return x + {time.time()!r}

"""
    text = module.read_text().replace("def compute(packing):", f"{kernel}def compute(packing):\n    shifted(1.0)")
    module.write_text(text)
    monkeypatch.setattr("voxgran.scene.processes.Pipe", noted_pipe)
    run = Run(key="a", cell="a", mapping=base, seed=3)
    with Processes(1, 10**9) as workers:
        (_, record, _), *others = [came for came in workers.results([run]) if came is not None]
    assert (record.numbers["mark"][0], others) == (30, [])
    messages = heard[heard.index(READY) + 1 : -1]
    assert messages
    assert messages == [COMPILING, COMPILED] * (len(messages) // 2)


def test_a_study_that_is_stopped_before_its_first_run_says_so(base, marks, tmp_path):
    marks.order(wait=30)

    def stop(step):
        os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(Interrupted, match="stopped before the first of 3 runs was finished: the same command"):
        vg.Study(base=base, seeds=3).run(tmp_path / "o", workers=1, on_step=stop)


def test_a_time_that_stands_still_for_two_minutes_is_told():
    """Of a run that takes longer than the others of its cell the time that is left no longer falls."""
    known = Durations()
    known.add("a", {"packing": {"method": "rsa"}})
    known.note("a", 1, 1, 600.0)
    for _ in range(20):
        known.expect("a", 1, 1)
    seconds = range(0, 1000, 10)
    told = [known.stands_still(known.remaining([("a", float(now))], 0.0)[0], float(now)) for now in seconds]
    assert [now for now, still in zip(seconds, told, strict=True) if still] == list(range(730, 1000, 10))
