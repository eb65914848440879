"""Compiled kernels on disk, each under a name that all its code decides.

numba's own cache knows neither the kernels that a kernel calls nor two processes that write at once, and forgets all
kernels of a file that is edited. Here the name of a file is a hash of the code of a kernel and of all that it calls, of
the types of its arguments, of the processor and of the versions: what is there is right, and never written twice.

Kernels are looked for in the cache of the user, then among those that `make dist` has compiled into the package. A file
states the hash of its name and content: a kernel that was damaged on the disk would end the program, and is compiled
anew.

A file is a pickle, which is a program: in the cache it is read only if this user has written it and nobody else may
change it; one in the package is as much to be trusted as the modules beside it.

This file is loaded when a kernel is compiled, never before: it imports numba.
"""

import contextlib
import hashlib
import logging
import os
import pickle
import re
import secrets
import struct
import sys
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.registry import cpu_target
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

from voxgran._base.compiling.linking import codegen_of
from voxgran._base.errors import warn
from voxgran._base.files import is_private

log = logging.getLogger(__name__)

#: number of the way in which kernels are compiled and linked; kernels of other ways are compiled again
LAYOUT = 5
VERSIONS = (
    f"{LAYOUT} {sys.version_info[0]}.{sys.version_info[1]} {numba.__version__} {llvmlite.__version__} "
    # whether code calls Intel's vector functions, which another machine may lack
    f"{numba.config.USING_SVML}"
)
#: kernels that came with the package
PACKAGED = Path(__file__).with_name("kernels")
#: how each file begins, also a draft; a hash and `END` follow: for the unpickler, a text that it drops
MARK, END = b"Vvoxgran kernel", b"\n0"
#: names of kernels and of drafts
_NAME = re.compile(r"\w+-[0-9a-f]{16}-[0-9a-f]{16}\.kernel|\.[0-9a-f]{16}\.draft")
#: seconds for which the process that compiles a kernel may do nothing until another one compiles it too, and between
#: two looks at it
PATIENCE, GLANCE = 2.0, 0.02
#: the lock of one byte, as the system takes and returns it: kind, from where counted, place, length, process
LOCK = "hhqqi"
#: files that were not used for so long are removed
FORGOTTEN_SECONDS = 60 * 24 * 3600.0
#: the time of last use is noted at most so often
NOTED_SECONDS = 24 * 3600.0


class KernelCache(FunctionCache):
    """The cache of one kernel, as numba's dispatchers ask for one.

    Parameters
    ----------
    function : callable
        The function that is compiled.
    code : str
        Hash of its code and of all that it calls.
    folder : Path
        Where compiled kernels are kept.
    on_miss, on_save : callable
        Called before and after each compilation.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        code: str,
        folder: Path,
        *,
        on_miss: Callable[[], None],
        on_save: Callable[[], None],
    ) -> None:
        self._name, self._py_func = repr(function), function
        self._impl, self._cache_path = _Results(folder), str(folder)
        self._cache_file = _Files(folder, f"{function.__name__.strip('_')}-{code}", on_miss, on_save)
        self.enable()

    def release(self) -> None:
        """Let other processes look for a kernel that was claimed for this one to compile."""
        self._cache_file.release()

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return a kernel that is kept, or None.

        numba first imports the definitions of all functions that it can compile, which takes as long as its own import.
        It does so where it compiles, and only the memory of arrays has to be there for what is compiled.
        """
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return what decides the code: the types and the processor for which kernels are compiled."""
        del codegen
        return super()._index_key(sig, codegen_of(cpu_target.target_context))


class _Results(CompileResultCacheImpl):
    """numba's conversion of compiled code to what can be written, without its search for a folder."""

    def __init__(self, folder: Path) -> None:
        self._locator = _Locator(folder)

    def reduce(self, data: Any) -> Any:
        """Return machine code and how it is called. The report of the types and the intermediate code, which only
        callers link, are left out: three quarters of a file. numba takes from that code which functions there are.
        """
        (name, kind, (code, _)), *call, _types, init, environments = super().reduce(data)
        found = llvm.parse_assembly(f'define void @"{data.fndesc.llvm_cpython_wrapper_name}"() {{ ret void }}')
        return (name, kind, (code, found.as_bitcode())), *call, "", init, environments


class _Locator:
    """Makes the folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def ensure_cache_path(self) -> None:
        """Make the folder where it is not there."""
        self.folder.mkdir(parents=True, exist_ok=True)


class _Files:
    """One file for each combination of argument types."""

    def __init__(self, folder: Path, stem: str, on_miss: Callable[[], None], on_save: Callable[[], None]) -> None:
        self.folder, self.stem, self.on_miss, self.on_save = folder, stem, on_miss, on_save
        self._claimed = -1

    def _path(self, key: object) -> Path:
        """Return the file of a combination of types and a processor."""
        mark = hashlib.sha256(f"{VERSIONS} {key!r}".encode()).hexdigest()[:16]
        return self.folder / f"{self.stem}-{mark}.kernel"

    def load(self, key: object) -> Any:
        """Return what was saved, or came with the package; None where neither is there, or can be read."""
        path = self._path(key)
        data = _kept(path)
        if data is None:
            self._claim(path)
            # another process may have compiled it meanwhile
            data = _kept(path)
        if data is None:
            self.on_miss()
        return data

    def save(self, key: object, data: Any) -> None:
        """Write a compiled kernel, whole or not at all; a full disk only costs its compilation the next time."""
        path = self._path(key)
        draft = path.with_name(f".{secrets.token_hex(8)}.draft")
        try:
            content = dumps(data)
            with draft.open("wb") as file:
                file.write(_head_of(path, content) + END + content)
                file.flush()
                os.fsync(file.fileno())
            draft.replace(path)
        except OSError as error:
            log.info("%s was not kept: %s", path, error)
            with contextlib.suppress(OSError):
                draft.unlink()
        self.on_save()

    def flush(self) -> None:
        """Forget nothing: names decide what is fresh."""

    def _claim(self, path: Path) -> None:
        """Wait as long as another process compiles a kernel, and keep others from it; not where a disk has no locks."""
        import fcntl

        byte, used, since = int(path.stem[-15:], 16), "", time.monotonic()
        with contextlib.suppress(OSError):
            file = _claims(self.folder)
            while time.monotonic() - since < PATIENCE:
                with contextlib.suppress(BlockingIOError, PermissionError):
                    fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
                    self._claimed = byte
                    return
                time.sleep(GLANCE)
                asked = struct.pack(LOCK, fcntl.F_WRLCK, os.SEEK_SET, byte, 1, 0)
                number = struct.unpack(LOCK, fcntl.fcntl(file, fcntl.F_GETLK, asked))[-1]
                if (now := f"{number} {_time_of(number)}") != used:
                    used, since = now, time.monotonic()
            warn(
                f"process {used.split()[0]} has claimed a kernel of {self.folder} and does not go on: it is compiled "
                "here too; end that process, or let it go on",
                RuntimeWarning,
            )

    def release(self) -> None:
        """Let other processes look for the kernel that was claimed."""
        import fcntl

        if self._claimed >= 0:
            with contextlib.suppress(OSError):
                fcntl.lockf(_claims(self.folder), fcntl.LOCK_UN, 1, self._claimed)
            self._claimed = -1


def _time_of(number: int) -> str:
    """Return the processor time that a process has used, as the system counts, or what changes with each call where it
    waits for a processor or a disk; empty where that is not known.
    """
    with contextlib.suppress(OSError, IndexError):
        state, *numbers = Path(f"/proc/{number}/stat").read_text(encoding="latin-1").rpartition(")")[2].split()
        return str(time.monotonic()) if state in ("R", "D") else "+".join(numbers[10:12])
    return ""


@cache
def _claims(folder: Path) -> int:
    """Return the open file of a folder of which each kernel that a process compiles locks one byte."""
    return os.open(folder / ".claims", os.O_RDWR | os.O_CREAT, 0o600)


def _kept(path: Path) -> Any:
    """Return what the cache holds, or the package; None where neither does."""
    data = _read(path, is_private)
    if data is None:
        return _read(PACKAGED / path.name, bool)
    with contextlib.suppress(OSError):
        if time.time() - path.stat().st_mtime > NOTED_SECONDS:
            os.utime(path)
    return data


def _read(path: Path, trusted: Callable[[os.stat_result], bool]) -> Any:
    """Return what a file holds; None where it is not there, damaged or not trusted."""
    try:
        with path.open("rb") as file:
            content = file.read() if trusted(os.fstat(file.fileno())) else b""
        head, _, content = content.partition(END)
        return pickle.loads(content) if head == _head_of(path, content) else None
    except (OSError, pickle.UnpicklingError, EOFError, ImportError, LookupError, AttributeError, TypeError, ValueError):
        return None


def _head_of(path: Path, content: bytes) -> bytes:
    """Return how a file of this name and content begins, with the hash of both."""
    return MARK + b" " + hashlib.sha256(path.name.encode() + b"\n" + content).hexdigest().encode()


def remove_forgotten(folder: Path) -> None:
    """Remove compiled kernels that were not used for two months, and drafts so old; other files stay.

    Parameters
    ----------
    folder : Path
        Where compiled kernels are kept.
    """
    now = time.time()
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if now - path.lstat().st_mtime > FORGOTTEN_SECONDS and _is_ours(path):
                path.unlink()


def _is_ours(path: Path) -> bool:
    """Return whether this cache has written a file, by its name and its first bytes."""
    if not _NAME.fullmatch(path.name) or path.is_symlink() or not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(MARK)) == MARK
