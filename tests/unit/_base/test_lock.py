"""Locks: another process is named, a dead one is taken over, and nothing is left behind."""

import errno
import fcntl
import json
import os
import socket
import subprocess
import sys

import pytest

from voxgran._base.errors import InUseError, OutputError
from voxgran._base.lock import FOLDER_LOCK, locked_file, locked_folder

HOLD = """
import sys
from voxgran._base.lock import locked_file, locked_folder
with {which}({path!r}):
    print("held", flush=True)
    sys.stdin.read()
"""


def holder(which, path):
    """Start a process that holds a lock."""
    code = HOLD.format(which=which.__name__, path=str(path))
    other = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert other.stdout.readline() == "held\n"
    return other


@pytest.fixture
def no_flock(monkeypatch):
    """A file system without such locks."""

    def refuse(file, operation):
        raise OSError(errno.ENOTSUP, "not supported")

    monkeypatch.setattr(fcntl, "flock", refuse)


@pytest.mark.parametrize("which", [locked_folder, locked_file])
def test_another_process_is_named_and_taken_over_once_it_is_dead(which, tmp_path):
    path = tmp_path / "out"
    other = holder(which, path)
    with (
        pytest.raises(InUseError, match=f"process {other.pid} on {socket.gethostname()} since 20") as stop,
        which(path),
    ):
        pass
    assert stop.value.exit_code == 2
    assert str(path) in str(stop.value)
    other.kill()
    other.communicate(timeout=60)
    left = list(tmp_path.rglob("*.lock"))
    assert len(left) == 1
    with which(path):
        assert json.loads(left[0].read_text())["pid"] == os.getpid()
    assert not list(tmp_path.rglob("*.lock"))


def test_a_lock_is_gone_after_an_end_with_and_without_an_error(tmp_path):
    with locked_folder(tmp_path):
        assert (tmp_path / FOLDER_LOCK).exists()
    with pytest.raises(KeyboardInterrupt), locked_folder(tmp_path):
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("no_flock")
def test_without_locks_of_the_system_the_living_are_told_from_the_dead(tmp_path):
    other = holder(locked_folder, tmp_path)
    with pytest.raises(InUseError, match=f"process {other.pid} .* remove"), locked_folder(tmp_path):
        pass
    known = json.loads((tmp_path / FOLDER_LOCK).read_text())
    # the number was given to a later process
    (tmp_path / FOLDER_LOCK).write_text(json.dumps({**known, "began": "1"}))
    with locked_folder(tmp_path):
        pass
    # nobody can tell of a process on another machine
    (tmp_path / FOLDER_LOCK).write_text(json.dumps({**known, "host": "elsewhere"}))
    with pytest.raises(InUseError, match="on elsewhere"), locked_folder(tmp_path):
        pass
    other.kill()
    other.communicate(timeout=60)
    (tmp_path / FOLDER_LOCK).write_text(json.dumps(known))
    with locked_folder(tmp_path):
        pass
    for damaged in ("", "[1]", "{", json.dumps({**known, "pid": "1"})):
        (tmp_path / FOLDER_LOCK).write_text(damaged)
        with locked_folder(tmp_path):
            pass


def test_a_lock_that_its_holder_removes_in_this_moment_is_made_anew(tmp_path, monkeypatch):
    lock, real, calls = tmp_path / FOLDER_LOCK, fcntl.flock, []

    def slow(file, operation):
        if not calls:
            lock.unlink()
        calls.append(file)
        real(file, operation)

    monkeypatch.setattr(fcntl, "flock", slow)
    with locked_folder(tmp_path):
        assert len(calls) == 2
        with pytest.raises(InUseError), locked_folder(tmp_path):
            pass


def test_names_of_one_file_share_a_lock_and_long_names_have_one(tmp_path):
    file, link, other = tmp_path / ("x" * 255), tmp_path / "link", tmp_path / "other"
    file.touch()
    link.symlink_to(file)
    with locked_file(file), locked_file(other), pytest.raises(InUseError), locked_file(link):
        pass


def test_devices_and_no_path_are_not_locked():
    before = set(os.listdir("/dev"))
    with locked_file("/dev/null"), locked_file(None):
        assert set(os.listdir("/dev")) == before


def test_where_nothing_can_be_written_this_is_said(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="cannot be written"), locked_folder(tmp_path / "file" / "out"):
        pass
