"""Files of compiled kernels that are damaged, and processes that claim one and do not go on."""

import fcntl
import itertools
import os
import random
import signal
import time
from functools import partial

import pytest
from kit import Forked

from voxgran._base.compiling import kernel_files

KEPT = {"code": bytes(range(256)) * 8}


@pytest.fixture
def files(tmp_path):
    """Return the files of a kernel in an empty cache, and what is said of those that are compiled."""
    missed = []
    return kernel_files._Files(tmp_path, "f", on_miss=partial(missed.append, 1), on_save=list), missed


def test_no_bit_of_a_kernel_can_change(files, tmp_path):
    made, missed = files
    made.save("key", KEPT)
    (path,) = tmp_path.glob("*.kernel")
    whole = path.read_bytes()
    for bit in random.Random(1).sample(range(8 * len(whole)), 400):
        changed = bytearray(whole)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        assert made.load("key") is None, bit
    made.release()
    assert len(missed) == 400
    for length in range(0, len(whole), 97):
        path.write_bytes(whole[:length])
        assert made.load("key") is None
    path.write_bytes(whole)
    assert made.load("key") == KEPT
    made.save("key", KEPT)
    assert path.read_bytes() == whole


def test_kernels_that_were_swapped_are_compiled_anew(files, tmp_path):
    made, missed = files
    made.save("one", "of one")
    made.save("two", "of two")
    one, two = tmp_path.glob("*.kernel")
    one.rename(tmp_path / "x")
    two.rename(one)
    (tmp_path / "x").rename(two)
    assert made.load("one") is made.load("two") is None
    assert len(missed) == 2


def test_a_kernel_is_on_the_disk_before_it_has_its_name(files, tmp_path, monkeypatch):
    made, _ = files
    names = []
    monkeypatch.setattr("os.fsync", lambda number: names.append([path.suffix for path in tmp_path.iterdir()]))
    made.save("key", KEPT)
    assert names == [[".draft"]]
    assert [path.suffix for path in tmp_path.iterdir()] == [".kernel"]


def claimed(tmp_path, made, then):
    """Return a process that has claimed the kernel, and does something then."""
    there, here = os.pipe()

    def work():
        kernel_files._claims.cache_clear()
        byte = int(made._path("key").stem[-15:], 16)
        fcntl.lockf(kernel_files._claims(tmp_path), fcntl.LOCK_EX, 1, byte)
        os.write(here, b"x")
        then()

    process = Forked(work)
    os.read(there, 1)
    os.close(there)
    os.close(here)
    return process


def test_a_process_that_is_suspended_delays_a_kernel_and_is_named(files, tmp_path, monkeypatch):
    made, missed = files
    monkeypatch.setattr(kernel_files, "PATIENCE", 0.3)
    process = claimed(tmp_path, made, lambda: os.kill(os.getpid(), signal.SIGSTOP))
    try:
        with pytest.warns(
            RuntimeWarning, match=rf"process {process.pid} has claimed a kernel of .*: it is compiled here"
        ):
            assert made.load("key") is None
        assert len(missed) == 1
        made.release()
    finally:
        process.kill()
        process.wait()
    assert made.load("key") is None
    made.release()


def test_a_process_that_compiles_is_waited_for(files, tmp_path, monkeypatch):
    made, missed = files
    used = itertools.count()
    monkeypatch.setattr(kernel_files, "PATIENCE", 0.1)
    monkeypatch.setattr(kernel_files, "_time_of", lambda number: next(used))

    def compile_slowly():
        time.sleep(0.4)
        made.save("key", KEPT)

    process = claimed(tmp_path, made, compile_slowly)
    assert made.load("key") == KEPT
    assert not missed
    made.release()
    process.wait()


def test_work_of_a_process_is_seen():
    before = kernel_files._time_of(os.getpid())
    begin = time.process_time()
    while time.process_time() - begin < 0.05:
        pass
    assert kernel_files._time_of(os.getpid()) != before
    assert kernel_files._time_of(2**30) == ""
