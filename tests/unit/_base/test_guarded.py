"""What a reader in a process of its own may do to itself, and what the caller then gets."""

import contextlib
import importlib
import io
import os
import pathlib
import signal
import subprocess
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest

from voxgran._base import guarded
from voxgran._base.errors import FileFormatError, InputError, MissingLibraryError, TooLargeError, UnknownNameError
from voxgran._base.guarded import read_guarded, read_part, reason_of, refused

READERS = """
import ctypes, os, signal, sys, time, warnings
import numpy as np
from voxgran._base.errors import UnknownNameError

def arrays(path, *, many):
    return {"text": path.read_text(), "none": None, "nan": float("nan")}, {
        "floats": np.arange(many) / 3, "ints": np.arange(6, dtype=">i2").reshape(2, 3), "empty": np.zeros((0, 3)),
        "flags": np.array([True, False]), "fortran": np.arange(6).reshape(2, 3, order="F"), "one": np.array(2.5)}

def crash(path):
    ctypes.string_at(0)

def aborts(path):
    os.abort()

def hangs(path):
    while True:
        pass

def sleeps(path):
    time.sleep(1000)

def greedy(path):
    return {}, {"a": np.zeros(4 * 10**8)}

def prints(path):
    print("to the output"); print("to the errors", file=sys.stderr)
    os.write(1, b"to the output\\n"); os.write(2, b"to the errors\\n")
    warnings.warn("a warning of a library")
    return {}, {}

def refuses(path):
    raise UnknownNameError(f"{path} is refused")

def fails(path):
    raise IndexError("list index\\nout of range")

def leaves(path):
    sys.exit("I leave")

def objects(path):
    return {}, {"a": np.array([{}])}
"""


@pytest.fixture
def readers(tmp_path, monkeypatch):
    """Return a module of readers that only the search path knows."""
    (tmp_path / "readers_of_a_test.py").write_text(READERS)
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("readers_of_a_test")
    del sys.modules["readers_of_a_test"]


@pytest.fixture
def path(tmp_path):
    (tmp_path / "file.dat").write_text("content")
    return tmp_path / "file.dat"


def test_facts_and_arrays_come_back_bit_for_bit(readers, path):
    facts, arrays = read_guarded(readers.arrays, path, many=300_000)
    assert (facts["text"], facts["none"], np.isnan(facts["nan"])) == ("content", None, True)
    _, here = readers.arrays(path, many=300_000)
    assert arrays.keys() == here.keys()
    for name, array in here.items():
        assert (arrays[name].dtype, arrays[name].shape) == (array.dtype, array.shape)
        np.testing.assert_array_equal(arrays[name], array)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("crash", "its reader ended by SIGSEGV"),
        ("aborts", "its reader ended by SIGABRT"),
        ("objects", "holds values of the type object: numbers are needed"),
        ("fails", r"cannot be read as a \.dat file \(list index out of range\)"),
        ("leaves", r"cannot be read as a \.dat file \(I leave\)"),
    ],
)
def test_a_reader_that_ends_is_a_sentence(readers, path, name, words, capfd):
    with pytest.raises(FileFormatError, match=rf"^{path} .*{words}.*; write (it again|these)$") as caught:
        read_guarded(getattr(readers, name), path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")
    assert not list(path.parent.glob("core*"))


def test_an_answer_that_is_cut_off_is_a_sentence(readers, path, monkeypatch):
    @contextlib.contextmanager
    def started(request):
        answer = b'ready\n{"facts": {}, "arrays": {"a": ["<f8", [3]]}}\n12345678'
        yield SimpleNamespace(stdout=io.BytesIO(answer), wait=lambda: -signal.SIGBUS, send_signal=None)

    monkeypatch.setattr(guarded, "_process", started)
    with pytest.raises(FileFormatError, match="its reader ended by SIGBUS"):
        read_guarded(readers.arrays, path)


def test_a_reader_that_computes_without_end_is_a_sentence(readers, path, monkeypatch):
    monkeypatch.setattr(guarded, "SECONDS", 0.5)
    with pytest.raises(FileFormatError, match=r"cannot be read within 0\.5 s of computing: it is damaged"):
        read_guarded(readers.hangs, path)


def test_a_reader_that_waits_without_end_is_a_sentence(readers, path, monkeypatch):
    monkeypatch.setattr(guarded, "PATIENCE", 1.0)
    with pytest.raises(FileFormatError, match=r"cannot be read within 2\.5 s"):
        read_guarded(readers.sleeps, path)


def test_a_reader_that_asks_for_all_memory_is_a_sentence(readers, path, monkeypatch):
    with pytest.raises(FileFormatError, match="of 7 bytes asks for more than 2 GiB of memory: it is damaged"):
        read_guarded(readers.greedy, path)
    monkeypatch.setattr(guarded, "memory_limit", lambda: 2**30)
    with pytest.raises(TooLargeError, match="of 7 bytes does not fit in memory as its header describes it"):
        read_guarded(readers.greedy, path)


def test_what_a_reader_prints_and_warns_of_is_not_heard(readers, path, capfd):
    with warnings.catch_warnings(action="error"):
        assert read_guarded(readers.prints, path) == ({}, {})
    assert capfd.readouterr() == ("", "")


def test_errors_of_voxgran_keep_class_and_sentence(readers, path):
    with pytest.raises(UnknownNameError) as caught:
        read_guarded(readers.refuses, path)
    assert str(caught.value) == f"{path} is refused"


def children():
    """Return the processes that this one has started and not waited for; other tests may have left some."""
    found = set()
    for entry in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            state = entry.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        found |= {entry.parent.name} if int(state[1]) == os.getpid() else set()
    return found


def test_no_process_is_left_behind(readers, path):
    before = children()
    for name in ("arrays", "crash"):
        with pytest.raises((FileFormatError, InputError)):
            read_guarded(getattr(readers, name), path, **({"wrong": 1} if name == "arrays" else {}))
    assert children() <= before


def test_scripts_need_no_guard_and_their_folder_hides_no_library(path, tmp_path):
    (tmp_path / "json.py").write_text("raise ImportError('not the json of Python')\n")
    (tmp_path / "readers_of_a_test.py").write_text(READERS)
    (tmp_path / "script.py").write_text(
        "import sys, pathlib\n"
        "here = sys.path.pop(0)\n"
        "from voxgran._base.guarded import read_guarded\n"
        "sys.path.append(here)\n"
        "import readers_of_a_test as readers\n"
        f"print(read_guarded(readers.arrays, pathlib.Path({str(path)!r}), many=3)[0]['text'])\n"
    )
    done = subprocess.run([sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("content\n", "")


def test_a_python_that_cannot_be_started_is_named(readers, path, monkeypatch):
    monkeypatch.setattr(sys, "executable", str(path.parent / "no_python"))
    with pytest.raises(MissingLibraryError, match=r"no_python cannot be started .*No such file"):
        read_guarded(readers.refuses, path)
    monkeypatch.setattr(sys, "executable", "/bin/true")
    with pytest.raises(MissingLibraryError, match="/bin/true cannot import voxgran"):
        read_guarded(readers.refuses, path)


def test_ctrl_c_ends_the_reader_too(path, tmp_path):
    (tmp_path / "readers_of_a_test.py").write_text(READERS)
    script = (
        "import sys, pathlib, threading, os, signal, time\n"
        f"sys.path.append({str(tmp_path)!r})\n"
        "import readers_of_a_test as readers\n"
        "from voxgran._base.guarded import read_guarded\n"
        # a shell that starts the tests in the background has it ignored
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "threading.Timer(1.0, os.kill, [os.getpid(), signal.SIGINT]).start()\n"
        "try:\n"
        f"    read_guarded(readers.sleeps, pathlib.Path({str(path)!r}))\n"
        "except KeyboardInterrupt:\n"
        "    try:\n"
        "        os.waitpid(-1, os.WNOHANG)\n"
        "    except ChildProcessError:\n"
        "        print('ended')\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr, done.returncode) == ("ended\n", "", 0)


def test_a_lower_limit_of_the_user_stays(readers, path):
    script = f"ulimit -v 1500000; exec {sys.executable} -c 'import sys; sys.path[:] = sys.argv[2:]\nimport pathlib\n"
    script += "import readers_of_a_test as r\nfrom voxgran._base.guarded import read_guarded, read_part\n"
    script += 'print(read_guarded(r.arrays, pathlib.Path(sys.argv[1]), many=3)[0]["text"])\' "$@"'
    command = ["sh", "-c", script, "sh", str(path), *sys.path]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert (done.stdout, done.stderr) == ("content\n", "")


def test_refused_turns_what_libraries_raise_into_one_sentence(path):
    with pytest.raises(FileFormatError, match=r"\(KeyError\): it is cut"), refused(path):
        raise KeyError
    with pytest.raises(TooLargeError), refused(path):
        raise MemoryError
    with warnings.catch_warnings(action="error"), refused(path):
        warnings.warn("of a library", UserWarning, stacklevel=1)
    with pytest.raises(KeyboardInterrupt), refused(path):
        raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("error", "library"),
    [
        (ValueError("<COMPRESSION.LZW: 5> requires the 'imagecodecs' package"), "imagecodecs"),
        (ValueError("codec not available: ''zfpy''"), "zfpy"),
        (OSError("Can't synchronously read data (required filter 'HDF5 zstd' is not registered)"), "hdf5plugin"),
        (OSError("Can't read data (can't open directory (/usr/local/lib/plugin). Please verify"), "hdf5plugin"),
        (ModuleNotFoundError("No module named 'h6py'", name="h6py.low"), "h6py"),
    ],
)
def test_a_library_that_is_missing_is_named_and_the_file_is_not_called_damaged(error, library, tmp_path, monkeypatch):
    path = tmp_path / "scan.tif"
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with (
        pytest.raises(MissingLibraryError, match=f"scan.tif .* needs {library}.*pip install {library}'"),
        refused(path),
    ):
        raise error
    # where it is there, it is not what the other one lacks
    monkeypatch.setattr("importlib.util.find_spec", lambda name: "found")
    with pytest.raises(FileFormatError, match="cut or damaged"), refused(path):
        raise error


def test_reasons_are_short_lines():
    assert reason_of(ValueError("a\n  b")) == "a b"
    assert reason_of(ValueError("x" * 10**6)) == "x" * 97 + "..."
    assert reason_of(KeyError()) == "KeyError"


def test_a_process_is_kept_for_further_parts_and_replaced_when_it_has_ended(readers, path):
    idle = guarded._idle(os.getpid())
    read_part(readers.arrays, path, size=0, many=3)
    (kept,) = idle.queue[-1:]
    for name, error in (("fails", FileFormatError), ("refuses", UnknownNameError)):
        with pytest.raises(error):
            read_part(getattr(readers, name), path, size=0)
    assert idle.queue[-1] is kept
    with pytest.raises(FileFormatError, match="its reader ended by SIGSEGV"):
        read_part(readers.crash, path, size=0)
    assert kept not in idle.queue
    read_part(readers.arrays, path, size=0, many=3)
    idle.queue[-1].kill()
    idle.queue[-1].wait()
    facts, found = read_part(readers.arrays, path, size=0, many=3)
    assert (facts["text"], len(found)) == ("content", len(read_guarded(readers.arrays, path, many=3)[1]))
    with pytest.raises(FileFormatError, match="of which 9 bytes are read, asks for more than 2 GiB"):
        read_part(readers.greedy, path, size=9)


def test_one_file_is_open_at_a_time(path):
    with guarded.one_file():
        for _ in range(3):
            with path.open() as file:
                assert file.read()
                with pytest.raises(OSError, match="Too many open files"):
                    path.open()
    with path.open(), path.open():
        pass
