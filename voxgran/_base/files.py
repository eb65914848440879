"""Files that are written whole or not at all.

Everything is written beside its place first and moved there at the end, so that neither a full disk nor a kill leaves
half a file under the final name, and a file that was there before stays until the new one is complete. Only regular
files and folders are replaced; links are followed, and a device or a pipe is written to.
"""

import contextlib
import errno
import glob
import hashlib
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path

from voxgran._base.errors import FileFormatError, InputError, MissingFileError, OutputError, OutputExistsError, shown

#: streams of this process: what is written there goes behind what was written before
STREAMS = {"/dev/stdout": 1, "/dev/stderr": 2}
#: longest suffix that a draft takes over, in bytes; those of known formats are shorter
LONGEST_SUFFIX = 32


def as_path(path: str | os.PathLike[str]) -> Path:
    """Return a text or path object as a path.

    Raises
    ------
    InputError
        If it is neither, contains a NUL, is ``"-"``, or is too long for the file system.
    OutputError
        If it leads through a folder without access, or through links in a circle.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"path is {shown(path)}: it must be the path of a file, as text or a Path; change it")
    if os.fspath(path) == "-":
        raise InputError("path is '-': streams are called /dev/stdin and /dev/stdout; write that, or name a file")
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except ValueError as error:
        raise InputError(f"path is {shown(path)}: that is no name of a file ({error}); change it") from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(f"path is {shown(path)}: it is too long for the file system; shorten it") from None
        raise OutputError(f"path is {shown(path)}: it cannot be reached ({error.strerror}); change it") from error
    return Path(path)


def existing_file(path: str | os.PathLike[str]) -> Path:
    """Return the path of a file that is there and can be read.

    Raises
    ------
    InputError
        If it is no path.
    MissingFileError
        If there is no such file.
    OutputError
        If it is there but cannot be opened.
    """
    found = as_path(path)
    if not found.is_file():
        kind = "is a folder" if found.is_dir() else "is no regular file" if found.exists() else "is not there"
        raise MissingFileError(f"{found} {kind}: a file is needed; check the path")
    try:
        with found.open("rb") as file:
            # some are opened that cannot be read, such as the memory of a process
            file.read(1)
        return found
    except OSError as error:
        raise OutputError(f"{found} cannot be read ({error.strerror}): change its permissions") from error


def output_suffix(path: str | os.PathLike[str], known: Collection[str], kept: str, *, overwrite: bool = True) -> str:
    """Return the suffix of a file that is to be written, in small letters; refuse one of another format.

    Parameters
    ----------
    path : path-like
        The file.
    known : collection of str
        Suffixes that are allowed, in small letters.
    kept : str
        What is written, with its verb, for the message: such as ``"packings are kept"``.
    overwrite : bool
        Whether a file that is there may be replaced; where it is written at once, writing checks that itself.

    Raises
    ------
    FileFormatError
        If the suffix is none of these.
    InputError
        If it is no path.
    OutputExistsError
        If the file is there and may not be replaced.
    """
    suffix = as_path(path).suffix.lower()
    if suffix not in known:
        choice = "choose one of these" if len(known) > 1 else "choose that"
        raise FileFormatError(f"{path} has the suffix {suffix!r}: {kept} as {', '.join(known)}; {choice}")
    if not overwrite:
        refuse_to_replace(path)
    return suffix


def refuse_to_replace(*paths: str | os.PathLike[str]) -> None:
    """Check, before anything is written, that there are no files or folders at these paths; devices and pipes are
    allowed.

    Raises
    ------
    OutputExistsError
        If there is a file or a folder.
    """
    for path in paths:
        if _kind(as_path(path)) in (stat.S_IFREG, stat.S_IFDIR):
            raise OutputExistsError(
                f"{path} is there already: it is not replaced unasked; give overwrite=True, at the prompt --overwrite, "
                "or another name"
            )


@contextlib.contextmanager
def written_whole(path: str | os.PathLike[str], *, overwrite: bool = True, sync: bool = True) -> Iterator[Path]:
    """Yield a path with the same suffix to write to, and move the result to its place at the end (context manager).

    Links are followed; for a character device or a pipe the result is copied to it. Without `sync` a power cut may
    leave the name without the content, which is for many small files whose content is checked when they are read.

    Raises
    ------
    OutputExistsError
        If a file or a folder is there and `overwrite` is false.
    OutputError
        If it cannot be written: no space, no permission, no such folder, a socket or a disk.
    """
    target = as_path(path)
    if not overwrite:
        refuse_to_replace(target)
    draft = None
    try:
        if _kind(target) in (None, stat.S_IFREG, stat.S_IFDIR):
            place = Path(os.path.realpath(target))
            draft = place.with_name(_draft_name(place, secrets.token_hex(4)))
            place.parent.mkdir(parents=True, exist_ok=True)
            yield draft
            if sync:
                _sync(draft)
            _replace(draft, place)
        else:
            with tempfile.TemporaryDirectory() as folder:
                whole = Path(folder) / f"draft{target.suffix}"
                yield whole
                _send(whole, target)
    except OSError as error:
        if isinstance(error, OutputError | OutputExistsError):
            raise
        reason = error.strerror or str(error)
        raise OutputError(f"{target} cannot be written ({reason}): free space or choose another place") from error
    finally:
        if draft is not None:
            _remove(draft)


def write_text(path: str | os.PathLike[str], text: str, *, overwrite: bool = True, sync: bool = True) -> None:
    """Write a text file completely or not at all; `sync` is that of :func:`written_whole`."""
    with written_whole(path, overwrite=overwrite, sync=sync) as draft:
        draft.write_text(text, encoding="utf-8")


def remove_drafts(path: str | os.PathLike[str]) -> None:
    """Remove drafts that killed processes left beside a file; no other process may be writing it."""
    place = Path(os.path.realpath(as_path(path)))
    for draft in place.parent.glob(glob.escape(_draft_name(place, "TOKEN")).replace("TOKEN", "?" * 8, 1)):
        _remove(draft)


def _kind(path: Path) -> int | None:
    """Return the ``stat.S_IF`` number of the file at a path, links followed; None if there is none."""
    if str(path) in STREAMS:
        return stat.S_IFCHR
    try:
        return stat.S_IFMT(path.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return None


def _draft_name(place: Path, token: str) -> str:
    """Return the name of a draft: short for any name of the file, and unique to it."""
    mark = hashlib.sha256(os.fsencode(place.name)).hexdigest()[:8]
    suffix = place.suffix if len(os.fsencode(place.suffix)) <= LONGEST_SUFFIX else ""
    return f".{mark}.{token}{suffix}"


def _sync(draft: Path) -> None:
    """Push a finished file to the disk, so that a power cut cannot leave the name without the content."""
    if draft.is_file():
        with draft.open("rb+") as file:
            os.fsync(file.fileno())


def _replace(draft: Path, place: Path) -> None:
    """Move the draft to its place."""
    if draft.is_dir() and place.is_dir():
        old = place.with_name(_draft_name(place, secrets.token_hex(4)))
        os.replace(place, old)
        os.replace(draft, place)
        shutil.rmtree(old, ignore_errors=True)
    else:
        os.replace(draft, place)


def _send(whole: Path, target: Path) -> None:
    """Write a finished file into a stream, a character device or a pipe; nothing else is written to."""
    kind = _kind(target)
    if kind not in (stat.S_IFCHR, stat.S_IFIFO):
        raise OutputError(f"{target} is neither a file nor a stream: it is not written to; name a file")
    stream = STREAMS.get(str(target))
    # opening a pipe without a reader would block for ever; without blocking it is an error
    number = os.dup(stream) if stream else os.open(target, os.O_WRONLY | getattr(os, "O_NONBLOCK", 0))
    with os.fdopen(number, "wb") as out, whole.open("rb") as source:
        os.set_blocking(number, True)
        shutil.copyfileobj(source, out)


def _remove(draft: Path) -> None:
    """Remove what is left of a draft."""
    if draft.is_dir():
        shutil.rmtree(draft, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
