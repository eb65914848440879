"""Locks, which keep two processes from writing the same output; that of a dead process is taken over.

The operating system holds a lock for as long as its process lives (``flock``). Where a file system has no such locks,
the file tells which process holds it, and that is asked for.
"""

import contextlib
import errno
import json
import logging
import os
import re
import socket
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from voxgran._base.errors import InUseError, OutputError
from voxgran._base.files import DRAFTS
from voxgran._base.stopping import undone_at_end

log = logging.getLogger(__name__)

#: the file that locks a folder
FOLDER_LOCK = ".voxgran.lock"
#: names of files that lock another one beside them
LOCKS = r"\.voxgran-[0-9a-f]{8}\.lock"
#: errors of `flock` on file systems without locks
_UNKNOWN = (errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EINVAL, errno.ENOLCK)


def is_left(path: Path) -> bool:
    """Return whether a file is a lock of voxgran that no process holds, or a draft, as killed processes leave them.

    Parameters
    ----------
    path : Path
        The file; drafts are left only where no process writes into its folder.
    """
    if path.is_symlink() or not path.is_file():
        return False
    if re.fullmatch(DRAFTS, path.name):
        return True
    if path.name != FOLDER_LOCK and not re.fullmatch(LOCKS, path.name):
        return False
    with contextlib.suppress(OSError, InUseError), path.open("r+b") as file:
        # one of no length was not yet signed
        if {"pid", "host"} <= _read(file.fileno()).keys() or not path.stat().st_size:
            _take(file.fileno(), path, path)
            return True
    return False


@contextlib.contextmanager
def locked_folder(folder: str | os.PathLike[str]) -> Iterator[None]:
    """Keep other processes from writing into a folder, which is made if needed (context manager).

    An InUseError is raised if another process holds it, an OutputError if nothing can be written there.
    """
    with _locked(Path(folder) / FOLDER_LOCK, Path(folder)):
        yield


@contextlib.contextmanager
def locked_file(path: str | os.PathLike[str] | None) -> Iterator[None]:
    """Keep other processes from writing a file, which need not exist (context manager); its lock lies beside it.

    Nothing is done for None and for what is not a regular file. Errors are those of :func:`locked_folder`.
    """
    target = None if path is None else Path(os.path.realpath(path))
    if target is None or (os.path.exists(target) and not os.path.isfile(target)):
        yield
        return
    with _locked(target.with_name(f".voxgran-{zlib.crc32(os.fsencode(target.name)):08x}.lock"), target):
        yield


@contextlib.contextmanager
def _locked(path: Path, target: Path) -> Iterator[None]:
    """Hold a lock file (context manager)."""
    made = not path.parent.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = _taken(path, target)
    except InUseError:
        raise
    except OSError as error:
        if made:
            with contextlib.suppress(OSError):
                path.parent.rmdir()
        reason = error.strerror or str(error)
        raise OutputError(f"{target} cannot be written ({reason}): choose another place") from error
    try:
        with undone_at_end(path.unlink):
            yield
    finally:
        # a waiting process then makes a new file
        with contextlib.suppress(OSError):
            path.unlink()
        os.close(file)


def _taken(path: Path, target: Path) -> int:
    """Return the open lock file, with this process written into it."""
    while True:
        # a lock that is a link would be written into another file
        file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        try:
            _take(file, path, target)
            if _is_same(file, path):
                _sign(file, path)
                return file
        except BaseException:
            os.close(file)
            raise
        # its holder removed it in this moment
        os.close(file)


def _take(file: int, path: Path, target: Path) -> None:
    """Lock an open file, or raise an error that names the process that holds it."""
    import fcntl

    known = _read(file)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InUseError(f"{target} is in use by {_named(known)}: wait for it, stop it, or name another") from error
    except OSError as error:
        if error.errno not in _UNKNOWN:
            raise
        if known and _may_live(known):
            raise InUseError(
                f"{target} is in use by {_named(known)}: wait for it, stop it, or, if it is dead, remove {path}"
            ) from error
    if known:
        log.info("%s was left by %s, which is dead: taken over", target, _named(known))


def _sign(file: int, path: Path) -> None:
    """Write this process into a lock that it holds; where the disk is full, nothing is left of the lock."""
    try:
        os.ftruncate(file, 0)
        os.pwrite(file, json.dumps(_this_process()).encode(), 0)
    except OSError:
        with contextlib.suppress(OSError):
            path.unlink()
        raise


def _is_same(file: int, path: Path) -> bool:
    """Return whether a path still leads to an open file."""
    try:
        return os.path.samestat(os.fstat(file), os.stat(path))
    except FileNotFoundError:
        return False


def _this_process() -> dict[str, Any]:
    """Return a record that identifies this process."""
    pid = os.getpid()
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    return {"pid": pid, "host": socket.gethostname(), "since": since, "began": _began(pid)}


def _read(file: int) -> dict[str, Any]:
    """Return who wrote a lock file; nothing where that is not known."""
    try:
        known = json.loads(os.pread(file, 4096, 0).decode())
    except ValueError:
        return {}
    return known if isinstance(known, dict) else {}


def _named(known: dict[str, Any]) -> str:
    """Return a process as text."""
    if not known:
        return "another process"
    return f"process {known.get('pid')} on {known.get('host')} since {known.get('since')}"


def _may_live(known: dict[str, Any]) -> bool:
    """Return whether the process that wrote a lock file may be alive; one on another machine always may."""
    if known.get("host") != socket.gethostname():
        return True
    pid = known.get("pid")
    if not isinstance(pid, int) or pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    # a later process may have the same number
    return _began(pid) == known.get("began")


def _began(pid: int) -> str:
    """Return when a process began, as the system counts; empty where that is not known."""
    try:
        words = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
    except OSError:
        return ""
    return words[19] if len(words) > 19 else ""
