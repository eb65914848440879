"""A program that is told to stop ends within a second, with its status and one line, and leaves no process behind."""

import contextlib
import os
import signal
import subprocess
import sys
import textwrap
import time
from functools import partial

import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import Interrupted, TooLargeError
from voxgran.scene.processes import Process, compute, start

#: a command that is told to do something in the middle of its work
PROGRAM = """
import os, signal, sys, time
# tests may run below nohup
signal.signal(signal.SIGHUP, signal.SIG_DFL)
from voxgran.cli import main
from voxgran.cli.commands import COMMANDS

def command(options):
{body}

COMMANDS["methods"] = (*COMMANDS["methods"][:1], command, *COMMANDS["methods"][2:])
sys.argv[1:] = ["methods"]
sys.exit(main())
"""
COMPUTES = """
    from voxgran._base.kernels import kernel
    def endless(n):
        total = 0.0
        while n:
            total += n
        return total
    endless = kernel(endless)
    print("begun", flush=True)
    endless(1)
"""
READS = """
    from voxgran._base.files import written_whole
    from voxgran._base.lock import locked_folder
    from voxgran.scene.processes import Process, compute, start
    with locked_folder("out"), written_whole("out/a.txt") as draft, start(compute, Process) as other:
        draft.write_text("half")
        print(other.process.pid, flush=True)
        while True:
            time.sleep(0.01)
"""
LOOKS = """
    from voxgran._base.stopping import heed
    print("begun", flush=True)
    while True:
        heed()
"""
ENDS_WELL = """
    from voxgran._base.stopping import Signals
    with Signals() as signals:
        signals.patient = True
        print("begun", flush=True)
        while not signals.number:
            time.sleep(0.01)
        time.sleep(1.0)
    print("good place", flush=True)
"""
SWALLOWS = """
    import numpy as np
    class Array:
        def __array__(self, *_, **__):
            print("begun", flush=True)
            while True:
                try:
                    time.sleep(0.01)
                except KeyboardInterrupt:
                    raise TypeError from None
    np.add(Array(), 1)
"""


def begun(body, folder):
    """Start a program, and return it with the first line that it writes."""
    words = [sys.executable, "-c", PROGRAM.format(body=body)]
    pipe = subprocess.PIPE
    program = subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True, cwd=folder)
    return program, program.stdout.readline().strip()


def is_alive(pid):
    """Return whether a process is there, and not a corpse."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize(
    ("body", "number", "status"),
    [
        (COMPUTES, signal.SIGTERM, 143), (LOOKS, signal.SIGINT, 130), (SWALLOWS, signal.SIGINT, 130),
        (LOOKS, signal.SIGHUP, 129), slow(COMPUTES, signal.SIGINT, 130),
        slow(LOOKS, signal.SIGTERM, 143), slow(SWALLOWS, signal.SIGTERM, 143),
    ],
    ids=["computes-15", "looks-2", "swallows-2", "looks-1", "computes-2", "looks-15", "swallows-15"],
)  # fmt: skip
def test_a_program_ends_with_one_line(body, number, status, tmp_path):
    program, line = begun(body, tmp_path)
    assert line == "begun"
    program.send_signal(number)
    _, errors = program.communicate(timeout=30)
    assert program.returncode == status
    told = errors.splitlines()
    assert len(told) == 1
    assert told[0].startswith("voxgran: stopped")


def test_a_program_that_is_ended_leaves_neither_drafts_nor_locks_nor_processes(tmp_path):
    program, other = begun(READS, tmp_path)
    assert is_alive(other)
    assert len(list((tmp_path / "out").iterdir())) == 2
    program.send_signal(signal.SIGTERM)
    program.communicate(timeout=30)
    assert program.returncode == 143
    assert not list((tmp_path / "out").iterdir())
    until = time.monotonic() + 30
    while is_alive(other) and time.monotonic() < until:
        time.sleep(0.01)
    assert not is_alive(other)


def test_work_that_ends_at_a_good_place_has_its_time_and_a_second_signal_ends_it(tmp_path):
    program, _ = begun(ENDS_WELL, tmp_path)
    program.send_signal(signal.SIGINT)
    said, _ = program.communicate(timeout=60)
    assert "good place" in said
    program, _ = begun(ENDS_WELL.replace("1.0", "3600"), tmp_path)
    program.send_signal(signal.SIGINT)
    time.sleep(0.2)
    program.send_signal(signal.SIGINT)
    said, errors = program.communicate(timeout=60)
    assert (said, program.returncode) == ("", 130)
    assert errors == "voxgran: stopped at once: what came after the last checkpoint is lost\n"


def test_a_process_computes_what_is_sent_and_ends_with_the_one_that_started_it():
    with start(compute, Process) as other:
        other.connection.send(os.getpid)
        assert other.receive() == other.process.pid
        other.connection.send(signal.Signals)
        with pytest.raises(TypeError):
            other.receive()
        other.process.kill()
        with pytest.raises(TooLargeError, match="ended by SIGKILL"):
            other.receive()
    with start(compute, Process) as other:
        # what the system does when this process dies
        other.connection.close()
        assert other.process.wait(timeout=30) == -signal.SIGKILL
    assert issubclass(Interrupted, KeyboardInterrupt)


#: work that a signal has stopped, in a process of which a library has a thread
STOPPED_BESIDE_A_THREAD = """
import threading, time
from voxgran._base.errors import Interrupted
threading.Thread(target=time.sleep, args=(30,)).start()
raise Interrupted("stopped", 15)
"""


@pytest.mark.parametrize("work", [partial(signal.raise_signal, 15), partial(exec, STOPPED_BESIDE_A_THREAD)])
def test_a_process_that_a_signal_stops_ends_and_stops_the_one_that_started_it(work):
    with start(compute, Process) as other:
        other.connection.send(work)
        with pytest.raises(Interrupted, match="stopped by SIGTERM") as caught:
            other.receive()
    assert caught.value.exit_code == 143


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["doctor", "--warm"],
        ["doctor"],
        ["study", "study.toml", "-o", "out"],
        ["demo", "-o", "out"],
        ["verify", "b.vtp"],
    ],
    ids=lambda words: words[0],
)
def test_every_verb_ends_at_any_moment_with_all_its_processes(words, tmp_path):
    (tmp_path / "study.toml").write_text(
        textwrap.dedent("""
            seeds = 20
            [[base.shape]]
            family = "solid_union"
            [base.container]
            kind = "box"
            lengths = [4, 4, 6]
            [base.packing]
            method = "digital"
            count = 20
            voxel_size = 0.1
        """)
    )
    if words[0] == "verify":
        bed = vg.pack(vg.make_shape("solid_union"), vg.Box((9, 9, 9)), "digital", count=300, settle=False)
        vg.save(bed, tmp_path / "b.vtp")
    environment = {**os.environ, "VOXGRAN_CACHE": str(tmp_path / "cache"), "MARK_OF_TEST": str(tmp_path)}
    for k in range(20):
        program = subprocess.Popen(
            [sys.executable, "-m", "voxgran", *words], cwd=tmp_path, env=environment, text=True, stderr=subprocess.PIPE
        )
        # later than the start of Python itself
        time.sleep(0.3 + 0.2 * k)
        # to the program alone, or to all its processes, in any order
        all_of_it = processes_with(f"MARK_OF_TEST={tmp_path}")[:: 2 - k % 4] if k % 2 else []
        for pid in all_of_it or [program.pid]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGTERM)
        _, errors = program.communicate(timeout=30)
        assert program.returncode in (143, 0), errors
        assert "Traceback" not in errors
        deadline = time.monotonic() + 10
        while (left := processes_with(f"MARK_OF_TEST={tmp_path}")) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert not left


def processes_with(text):
    """Return the numbers of the processes whose environment has a text."""
    found = []
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{pid}/environ", "rb") as file:
                if text.encode() in file.read() and is_alive(pid):
                    found.append(int(pid))
        except OSError:
            continue
    return found
