"""Readers of files that other programs wrote, run in a process of their own.

On a damaged file a library may crash, compute without end, ask for more memory than there is, or print. In a process of
its own that costs the caller one exception. The process is started as a plain Python program, and not by
`multiprocessing`, so that scripts need no ``__main__`` guard; it imports only the reader, has limits of memory and of
CPU time that grow with the file, and sends numbers and arrays through a pipe. Parts of a large image are read by
processes that are kept, since each part takes less time than a start.
"""

import atexit
import contextlib
import ctypes
import importlib
import importlib.util
import json
import math
import os
import queue
import re
import resource
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base import errors
from voxgran._base.errors import FileFormatError, MissingLibraryError, TooLargeError, VoxgranError, shown
from voxgran._base.lazy import load
from voxgran._base.machine import memory_limit
from voxgran._base.stopping import undone_at_end

#: what a reader returns: JSON-able facts, and arrays of numbers
Content: TypeAlias = tuple[dict[str, Any], dict[str, NDArray[Any]]]

#: CPU seconds that a reader may take: for any file, and for each byte of it
SECONDS, SECONDS_PER_BYTE = 2.5, 5e-6
#: memory in bytes that a reader may take: for any file, and for each byte of it (DEFLATE makes at most 1032 of one)
MEMORY, MEMORY_PER_BYTE = 2**31, 4000
#: the same for each byte of a part, which is counted as it is unpacked
MEMORY_PER_PART = 16
#: how many times its CPU time a reader may take on a clock, since other processes run too
PATIENCE = 20.0

#: what tifffile, numcodecs and HDF5 say where they lack a library of codecs, and its name; "" for that in the message
NEEDS = (
    (r"requires the '(\w+)' package", ""),
    (r"codec not available: '+(\w+)", ""),
    (r"can't open directory \(.*plugin\)|required filter", "hdf5plugin"),
)

#: how netCDF says that values lie in the file: in chunks, one after another, or in the header
STORED = (0, 1, 2)

_START = (
    "import sys; request = sys.argv[1]; sys.path[:] = sys.argv[2:]; "
    "from voxgran._base.guarded import serve; serve(request)"
)
#: one thread is enough, and the stacks of many count as memory
_ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "VTK_SMP_BACKEND_IN_USE": "Sequential"}
_READY = b"ready\n"


def read_guarded(reader: Callable[..., Content], path: Path, **options: Any) -> Content:
    """Return the facts and arrays that a reader, a public function of path and options, finds, run in its own process.

    Its errors that are not VoxgranErrors are raised as FileFormatError, as is an end without an answer, or more time or
    memory than the size of the file explains. Options are JSON-able. MissingLibraryError: the process cannot be
    started.

    Raises
    ------
    FileFormatError
        If the file is damaged.
    """
    size = sum(item.stat().st_size for item in (path.iterdir() if path.is_dir() else (path,)))
    memory = MEMORY + MEMORY_PER_BYTE * size
    request = _request(reader, path, options, size, memory)
    with _process(request) as process:
        _await_reader(process, path)
        return _timed(process, path, request, f"{path} of {size} bytes", memory)


def read_part(reader: Callable[..., Content], path: Path, *, size: int, **options: Any) -> Content:
    """Return what a reader finds, as `read_guarded` does, in a process that is kept for further calls.

    The limits of time and memory grow with `size`, the bytes of the part as numbers, and of what is unpacked for it.

    Raises
    ------
    FileFormatError
        If the file is damaged, or unpacks to much more than `size`.
    """
    memory = MEMORY + MEMORY_PER_PART * size
    # the folder of this process may have changed since a kept one was started
    request, idle = _request(reader, path.absolute(), options, size, memory), _idle(os.getpid())
    process = _waiting(idle, request, path)
    is_kept = False
    try:
        with undone_at_end(process.kill):
            answer = _timed(process, path, request, f"{path}, of which {size} bytes are read,", memory)
        is_kept = True
        return answer
    except VoxgranError:
        is_kept = process.poll() is None
        raise
    finally:
        if is_kept:
            idle.put(process)
        else:
            _end(process)


def refuse_growth(path: Path, count: int) -> None:
    """Refuse so many values that a reader has found in a file if, as numbers of 8 bytes, they take more than it may.

    Raises
    ------
    TooLargeError
        If they do.
    """
    if 8 * count > min(MEMORY + MEMORY_PER_BYTE * path.stat().st_size, memory_limit() // 2):
        raise TooLargeError(_too_large(path))


@cache
def _idle(number: int) -> "queue.LifoQueue[subprocess.Popen[bytes]]":
    """Return the processes of the process of this number that wait for a part to read."""
    del number
    idle: queue.LifoQueue[subprocess.Popen[bytes]] = queue.LifoQueue()
    atexit.register(lambda: list(map(_end, idle.queue)))
    return idle


def _request(reader: Callable[..., Content], path: Path, options: dict[str, Any], size: int, memory: int) -> str:
    """Return what a process is asked for that reads `size` bytes."""
    return json.dumps(
        {
            "module": reader.__module__,
            "name": reader.__qualname__,
            "path": str(path),
            "options": options,
            "seconds": SECONDS + SECONDS_PER_BYTE * size,
            # what it answers takes as much again here
            "memory": min(memory, memory_limit() // 2),
        }
    )


def _waiting(idle: "queue.LifoQueue[subprocess.Popen[bytes]]", request: str, path: Path) -> "subprocess.Popen[bytes]":
    """Return a process that was waiting and has got a request, or a new one."""
    with contextlib.suppress(queue.Empty):
        while True:
            process = idle.get_nowait()
            # what it had read before may have ended it
            with contextlib.suppress(MissingLibraryError):
                _await_reader(process, path, request)
                return process
            _end(process)
    process = _started(request, subprocess.PIPE)
    try:
        _await_reader(process, path)
    except MissingLibraryError:
        _end(process)
        raise
    return process


def _await_reader(process: "subprocess.Popen[bytes]", path: Path, request: str = "") -> None:
    """Wait until a process has the reader of the request with which it was started, or of another one.

    Raises
    ------
    MissingLibraryError
        If it has ended.
    """
    assert process.stdout is not None
    with contextlib.suppress(OSError):
        if request:
            assert process.stdin is not None
            process.stdin.write(request.encode() + b"\n")
            process.stdin.flush()
        if process.stdout.readline() == _READY:
            return
    raise MissingLibraryError(
        f"{sys.executable} cannot import voxgran in a second process, in which {path} is read: install it for this "
        "Python"
    )


def _timed(process: "subprocess.Popen[bytes]", path: Path, request: str, what: str, memory: int) -> Content:
    """Return what a process answers in time, or raise what it could not do."""
    seconds = json.loads(request)["seconds"]
    clock = threading.Timer(min(PATIENCE * seconds, threading.TIMEOUT_MAX), process.send_signal, [signal.SIGXCPU])
    clock.daemon = True
    clock.start()
    try:
        return _answer(process, path, seconds)
    except TooLargeError as error:
        if memory > memory_limit() // 2:
            raise
        raise FileFormatError(
            f"{what} asks for more than {memory / 2**30:.3g} GiB of memory: it is damaged; write it again"
        ) from error
    finally:
        clock.cancel()


@contextlib.contextmanager
def refused(path: Path) -> Iterator[None]:
    """Raise exceptions of libraries that read a file as FileFormatError, and suppress warnings (context manager).

    Raises
    ------
    FileFormatError
        For any exception that is neither a VoxgranError nor a lack of memory.
    MissingLibraryError
        If a library that unpacks the file is not installed.
    TooLargeError
        If the content does not fit in memory.
    """
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    except VoxgranError:
        raise
    except MemoryError as error:
        raise TooLargeError(_too_large(path)) from error
    # each library has its own exceptions for files that it cannot read; meshio also exits
    except (Exception, SystemExit) as error:
        if (missing := _missing(error)) is not None:
            raise MissingLibraryError(
                f"{path} is packed in a way that needs {missing}, which is not installed: install it with "
                f"'pip install {missing}'"
            ) from error
        raise FileFormatError(
            f"{path} cannot be read as a {path.suffix} file ({reason_of(error)}): it is cut or damaged; write it again"
        ) from error


def _missing(error: BaseException) -> str | None:
    """Return the name of a library without which another one failed, by what that one says; None for other errors."""
    found = str(error.name).partition(".")[0] if isinstance(error, ImportError) and error.name else None
    for said, name in NEEDS:
        if found is None and (match := re.search(said, str(error))) is not None:
            found = name or match[1]
    return None if found is None or importlib.util.find_spec(found) else found


def reason_of(error: BaseException, *, most: int = 100) -> str:
    """Return the message of an exception, or its class if empty, on one line of at most `most` characters."""
    text = " ".join(str(error)[: 10 * most].split()) or type(error).__name__
    return text if len(text) <= most else f"{text[: most - 3]}..."


def serve(request: str) -> None:
    """Read the file of a request of `read_guarded` (JSON: reader, file, options, limits) to the standard output, then
    those of the lines of the standard input.
    """
    # what libraries print goes where the standard error goes, which is nowhere
    channel = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    while request:
        _serve_one(json.loads(request), channel)
        request = sys.stdin.readline()


def _serve_one(asked: dict[str, Any], channel: BinaryIO) -> None:
    """Answer a request."""
    reader = getattr(importlib.import_module(asked["module"]), asked["name"])
    channel.write(_READY)
    channel.flush()
    _limit(asked["seconds"], asked["memory"])
    path, arrays = Path(asked["path"]), dict[str, NDArray[Any]]()
    try:
        with refused(path):
            facts, found = reader(path, **asked["options"])
            arrays = {key: _of_numbers(array, path) for key, array in found.items()}
            answer = {"facts": facts, "arrays": {key: (a.dtype.str, a.shape) for key, a in arrays.items()}}
    except VoxgranError as error:
        answer = {"error": type(error).__name__, "message": str(error)}
    channel.write(json.dumps(answer).encode() + b"\n")
    for array in arrays.values():
        channel.write(array.reshape(-1).view(np.uint8).data)
    channel.flush()


@contextlib.contextmanager
def one_file() -> Iterator[None]:
    """Let this process have one more file open at a time (context manager): a file of HDF5 may name others, whose
    content the library takes for its own.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    free = os.dup(0)
    os.close(free)
    resource.setrlimit(resource.RLIMIT_NOFILE, (free + 1, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@contextlib.contextmanager
def netcdf_file(path: Path) -> Iterator[Any]:
    """Open a netCDF4 file, and no other, with variables in groups (context manager).

    Raises
    ------
    FileFormatError
        If a variable is virtual: HDF5 fills in what it does not find in other files.
    """
    library = load("netCDF4")
    native = ctypes.CDLL(library._netCDF4.__file__)
    with one_file(), library.Dataset(path) as file:
        groups = [file]
        for group in groups:
            groups.extend(group.groups.values())
            for variable in group.variables.values():
                storage = ctypes.c_int()
                native.nc_inq_var_chunking(variable._grpid, variable._varid, ctypes.byref(storage), None)
                if storage.value not in STORED:
                    raise FileFormatError(
                        f"{path} has the values of {shown(variable.name)} in other files: write them into it"
                    )
        yield file


def _of_numbers(array: NDArray[Any], path: Path) -> NDArray[Any]:
    """Return an array in C order; refuse one that does not hold numbers."""
    if array.dtype.kind not in "biufc":
        raise FileFormatError(f"{path} holds values of the type {array.dtype}: numbers are needed; write these")
    return np.asarray(array, order="C")


def _limit(seconds: float, memory: int) -> None:
    """Set the limits of this process, counted from what it has used so far."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    until = math.ceil(used.ru_utime + used.ru_stime + seconds)
    with contextlib.suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        memory += pages * os.sysconf("SC_PAGE_SIZE")
    for kind, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_CPU, until), (resource.RLIMIT_AS, memory)):
        _, hard = resource.getrlimit(kind)
        resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


@contextlib.contextmanager
def _process(request: str) -> Iterator["subprocess.Popen[bytes]"]:
    """Start the process and see that it ends."""
    process = _started(request, subprocess.DEVNULL)
    try:
        with undone_at_end(process.kill):
            yield process
    finally:
        # after its answer too: the destructors of libraries may crash on what they have read
        _end(process)


def _started(request: str, stdin: int) -> "subprocess.Popen[bytes]":
    """Start a process with its first request."""
    try:
        return subprocess.Popen(
            [sys.executable, "-P", "-c", _START, request, *map(str, sys.path)],
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_ENVIRONMENT},
            start_new_session=True,
        )
    except (OSError, ValueError) as error:
        raise MissingLibraryError(
            f"{sys.executable or 'Python'} cannot be started as a second process ({reason_of(error)}): such files are "
            "read in one; free processes and memory"
        ) from error


def _end(process: "subprocess.Popen[bytes]") -> None:
    """End a process, whatever it does."""
    process.kill()
    with contextlib.suppress(OSError):
        process.communicate()


def _answer(process: "subprocess.Popen[bytes]", path: Path, seconds: float) -> Content:
    """Return what the process answers, or raise what it could not do."""
    assert process.stdout is not None
    stream = process.stdout
    line = stream.readline()
    if not line.endswith(b"\n"):
        raise _ended(process, path, seconds)
    answer = json.loads(line)
    if "error" in answer:
        raise getattr(errors, answer["error"])(answer["message"])
    arrays = {}
    for key, (kind, shape) in answer["arrays"].items():
        try:
            arrays[key] = np.empty(shape, dtype=kind)
        except MemoryError as error:
            raise TooLargeError(_too_large(path)) from error
        octets = arrays[key].reshape(-1).view(np.uint8).data
        if stream.readinto(octets) < len(octets):  # type: ignore[attr-defined]
            raise _ended(process, path, seconds)
    return answer["facts"], arrays


def _ended(process: subprocess.Popen[bytes], path: Path, seconds: float) -> FileFormatError:
    """Return the error for a process that ended without an answer."""
    code = process.wait()
    if code == -signal.SIGXCPU:
        return FileFormatError(
            f"{path} cannot be read within {seconds:.3g} s of computing: it is damaged; write it again"
        )
    name = signal.Signals(-code).name if code < 0 else f"code {code}"
    return FileFormatError(f"{path} cannot be read (its reader ended by {name}): it is damaged; write it again")


def _too_large(path: Path) -> str:
    """Say that the content of a file does not fit in memory."""
    return (
        f"{path} of {path.stat().st_size} bytes does not fit in memory as its header describes it: it is damaged, or "
        "must be cut into parts"
    )
