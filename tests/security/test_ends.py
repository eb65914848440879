"""Runs that are killed or lose their terminal: what they leave, and what goes on."""

import os
import pty
import signal
import subprocess
import sys
import time

import pytest
from kit import Forked

import voxgran as vg
from voxgran._base.errors import InUseError, OutputExistsError
from voxgran._base.lock import is_left, locked_file, locked_folder
from voxgran._base.stopping import Signals

SCENE = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 4},
    "measure": {"which": []},
    "output": {"report": False, "vtk": False, "statistics": False},
}


def holder(folder):
    """Return a process that holds the locks of a run in a folder, with a draft of its first checkpoint."""
    there, here = os.pipe()

    def hold():
        with locked_folder(folder), locked_file(folder / "checkpoint.voxgran"):
            (folder / ".voxgran-01234567-89abcdef.voxgran").touch()
            os.write(here, b"x")
            time.sleep(600)

    process = Forked(hold)
    os.read(there, 1)
    os.close(there)
    os.close(here)
    return process


def test_a_run_that_was_killed_before_its_first_checkpoint_can_be_made_again(tmp_path):
    scene, place = vg.Scene.from_mapping(SCENE), tmp_path / "out"
    other = holder(place)
    try:
        assert [is_left(path) for path in sorted(place.glob("*.lock"))] == [False, False]
        with pytest.raises(InUseError, match=f"process {other.pid} "):
            scene.run(place)
    finally:
        other.kill()
        other.wait()
    assert len(list(place.iterdir())) == 3
    assert scene.run(place).packing.count == 4
    assert not list(place.glob(".voxgran*"))


@pytest.mark.parametrize("name", ["notes.txt", ".voxgran-01234567.lock", ".voxgran.lock.txt"])
def test_only_locks_of_voxgran_do_not_count(name, tmp_path):
    (tmp_path / name).write_text("a thesis")
    with pytest.raises(OutputExistsError, match="is not empty"):
        vg.Scene.from_mapping(SCENE).run(tmp_path)
    assert (tmp_path / name).read_text() == "a thesis"
    (tmp_path / "link.lock").symlink_to(tmp_path / name)
    assert not is_left(tmp_path / "link.lock")


def test_a_closed_terminal_is_noted_and_nohup_is_heeded():
    # the tests may run below nohup themselves
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        with Signals() as signals:
            os.kill(os.getpid(), signal.SIGHUP)
            assert signals.number == signal.SIGHUP
            signals.patient = True
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        with Signals() as signals:
            os.kill(os.getpid(), signal.SIGHUP)
            assert signals.number == 0
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


#: a command that shows a bar, and after its end writes a file
SHOWS = """
import argparse, pathlib, sys, time
from voxgran._base.progress import Step
from voxgran.cli.terminal import progress
sys.stdin.readline()
with progress(argparse.Namespace(quiet=False, json=False)) as show:
    for k in range(5):
        show(Step(stage="packing", done=k, total=5, text=""))
        time.sleep(0.15)
pathlib.Path(sys.argv[1]).write_text("all")
"""


def test_a_bar_in_a_terminal_that_is_closed_ends_no_work(tmp_path):
    ours, theirs = pty.openpty()
    words = [sys.executable, "-c", SHOWS, str(tmp_path / "made")]
    program = subprocess.Popen(words, stdin=subprocess.PIPE, stderr=theirs)
    os.close(theirs)
    os.close(ours)
    program.communicate(b"\n", timeout=60)
    assert (tmp_path / "made").read_text() == "all"
