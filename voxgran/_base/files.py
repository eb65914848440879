"""Files that are written whole or not at all.

Everything is written beside its place first and moved there at the end, so that neither a full disk nor a kill leaves
half a file under the final name, and a file that was there before stays until the new one is complete. Only regular
files are replaced, and folders of which voxgran has written all content; links are followed, and a device or a pipe is
written to.
"""

import contextlib
import ctypes
import errno
import functools
import gzip
import hashlib
import os
import re
import secrets
import shutil
import stat
import tempfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path

from voxgran._base.errors import (
    FileFormatError,
    InputError,
    MissingFileError,
    OutputError,
    OutputExistsError,
    VoxgranError,
    shown,
)
from voxgran._base.stopping import heed, undone_at_end

#: streams of this process: what is written there goes behind what was written before
STREAMS = {"/dev/stdout": 1, "/dev/stderr": 2}
#: bytes of the content of a ``.gz`` file that are unpacked, however small the file is
MOST_UNPACKED = 2**28
#: names of drafts: a hash of the name of the file, and a random number
DRAFTS = r"\.voxgran-[0-9a-f]{8}-[0-9a-f]{8}(\..*)?"
#: bytes that are written to see whether a library can
PROBE = 4096
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


@contextlib.contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """Yield a file as it is, or the content of a ``.gz`` file as a temporary one (context manager).

    Messages of errors that are raised within name the file itself.

    Raises
    ------
    MissingFileError
        If there is no such ``.gz`` file.
    FileFormatError
        If it is damaged, or more than `MOST_UNPACKED` and 100 times as large when it is unpacked.
    """
    if path.suffix.lower() != ".gz":
        yield path
        return
    most = max(MOST_UNPACKED, 100 * existing_file(path).stat().st_size)
    with tempfile.TemporaryDirectory(prefix="voxgran-") as folder:
        target = Path(folder) / path.stem
        try:
            with gzip.open(path) as packed, target.open("wb") as file:
                while (block := packed.read(2**20)) and file.tell() <= most:
                    file.write(block)
                too_large = file.tell() > most
        except (OSError, EOFError, zlib.error) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise FileFormatError(
                f"{path} cannot be unpacked ({reason}): unpack it with gunzip, or write it again"
            ) from None
        if too_large:
            raise FileFormatError(
                f"{path} holds more than {most} bytes, 100 times its size: unpack it with gunzip first"
            )
        try:
            yield target
        except VoxgranError as error:
            error.args = (str(error).replace(str(target), str(path)),)
            raise


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
def written_whole(
    path: str | os.PathLike[str],
    *,
    overwrite: bool = True,
    sync: bool = True,
    is_own: Callable[[Path], bool] | None = None,
) -> Iterator[Path]:
    """Yield a path with the same suffix to write to, and move the result to its place at the end (context manager).

    Links are followed; for a character device or a pipe the result is copied to it. Without `sync` a power cut may
    leave the name without the content, which is for many small files whose content is checked when they are read. A
    folder is replaced only if `is_own` is true of all files in it, by their names and contents.

    Raises
    ------
    OutputExistsError
        If a file or a folder is there and `overwrite` is false, or a folder holds other files than `is_own` knows.
    OutputError
        If it cannot be written: no space, no permission, no such folder, a socket or a disk.
    """
    target = as_path(path)
    if not overwrite:
        refuse_to_replace(target)
    if is_own is not None:
        _refuse_other_files(target, is_own)
    _refuse_dangling(target)
    heed()
    draft, made = None, list[Path]()
    try:
        if _kind(target) in (None, stat.S_IFREG, stat.S_IFDIR):
            place = Path(os.path.realpath(target))
            draft = place.with_name(_draft_name(place, secrets.token_hex(4)))
            made = [folder for folder in place.parents if not folder.exists()]
            place.parent.mkdir(parents=True, exist_ok=True)
            with undone_at_end(functools.partial(_remove, draft)):
                yield draft
            if sync:
                _sync(draft)
            _replace(draft, place, is_own or (lambda _: False))
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
        with contextlib.suppress(OSError):
            # new folders stay where something lies in them
            for parent in made:
                parent.rmdir()


def _refuse_dangling(target: Path) -> None:
    """Refuse a file for which folders would be made at the end of a link that leads nowhere.

    Raises
    ------
    OutputError
        If it is, or lies behind, such a link.
    """
    for path in (target, *target.parents):
        end = Path(os.path.realpath(path))
        if path.is_symlink() and not end.exists() and not (path == target and end.parent.is_dir()):
            raise OutputError(f"{path} is a link to {end}, which is not there: make its folder, or name another place")


def leads_out(path: str | os.PathLike[str], folder: str | os.PathLike[str]) -> bool:
    """Return whether a path in a folder leads to another place, by a link."""
    return not Path(os.path.realpath(path)).is_relative_to(os.path.realpath(folder))


def files_in(folder: Path) -> list[Path]:
    """Return the files of a folder, none of which is a link to another place.

    Raises
    ------
    FileFormatError
        If one is: a folder that comes from others would read what its files name.
    """
    files = [item for item in folder.iterdir() if item.is_file()]
    if strange := next((item for item in files if leads_out(item, folder)), None):
        raise FileFormatError(f"{folder} holds {shown(strange.name)}, a link to another place: copy the file itself")
    return files


def refuse_links(folder: Path, *paths: Path) -> None:
    """Refuse a folder for results in which a link leads out of it: anywhere, or at some paths that may be written.

    Raises
    ------
    OutputError
        If one does.
    """
    for path in paths or folder.rglob("*"):
        # nothing is written into hidden folders, such as environments of Python
        is_hidden = any(place.name.startswith(".") for place in path.relative_to(folder).parents)
        if path.is_symlink() and leads_out(path, folder) and not is_hidden:
            told = f"{folder} holds {path.relative_to(folder)}, a link to another place, where nothing may be written"
            raise OutputError(f"{told}: remove it, or name another folder")


def write_files(contents: Mapping[Path, str | bytes], *, overwrite: bool = True) -> None:
    """Write several files of text or bytes, all or none of them; `overwrite` is that of :func:`written_whole`.

    Raises
    ------
    OutputError
        If one of several is a link to another place.
    """
    # most of them have names that the caller did not choose
    for path in contents if len(contents) > 1 else ():
        refuse_links(path.parent, path)
    with contextlib.ExitStack() as stack:
        for path, content in contents.items():
            draft = stack.enter_context(written_whole(path, overwrite=overwrite))
            draft.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8", "backslashreplace"))


def made_folder(path: Path) -> Path:
    """Return a folder, made if needed.

    Raises
    ------
    OutputError
        If it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path} cannot be made ({error.strerror}): free space or choose another place") from error
    return path


def write_text(path: str | os.PathLike[str], text: str, *, overwrite: bool = True, sync: bool = True) -> None:
    """Write a text file completely or not at all; `sync` is that of :func:`written_whole`."""
    with written_whole(path, overwrite=overwrite, sync=sync) as draft:
        draft.write_text(text, encoding="utf-8", errors="backslashreplace")


def remove_drafts(path: str | os.PathLike[str]) -> None:
    """Remove drafts that killed processes left beside a file; no other process may be writing it."""
    place = Path(os.path.realpath(as_path(path)))
    mine = _draft_name(place, "TOKEN").split("TOKEN")
    for draft in _drafts_in(place.parent):
        if draft.name.startswith(mine[0]) and draft.name.endswith(mine[1]):
            _remove(draft)


def remove_drafts_in(*folders: Path) -> None:
    """Remove drafts that killed processes left in folders; no other process may be writing there."""
    for folder in folders:
        for draft in _drafts_in(folder):
            _remove(draft)


def _drafts_in(folder: Path) -> list[Path]:
    """Return the drafts of all files in a folder, known by their names."""
    return [path for path in folder.glob(".voxgran-*") if re.fullmatch(DRAFTS, path.name)]


def is_private(about: os.stat_result) -> bool:
    """Return whether a file or a folder belongs to this user and nobody else may write it; always true on a system
    without users.
    """
    return not hasattr(os, "getuid") or (about.st_uid == os.getuid() and not about.st_mode & 0o022)


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
    return f".voxgran-{mark}-{token}{suffix}"


def _sync(draft: Path) -> None:
    """Push a finished file to the disk, so that a power cut cannot leave the name without the content."""
    if draft.is_file():
        with draft.open("rb+") as file:
            os.fsync(file.fileno())


def _refuse_other_files(folder: Path, is_own: Callable[[Path], bool]) -> None:
    """Refuse to replace a folder that holds files, links or devices which voxgran has not written.

    Raises
    ------
    OutputExistsError
        If it does.
    """
    for path in folder.rglob("*") if folder.is_dir() else ():
        if path.is_symlink() or not (path.is_dir() or (path.is_file() and is_own(path))):
            raise OutputExistsError(
                f"{folder} holds {path.relative_to(folder)}, which voxgran did not write there: the folder is not "
                "replaced; give another name, or move that file"
            )


def _replace(draft: Path, place: Path, is_own: Callable[[Path], bool]) -> None:
    """Move the draft to its place; an earlier folder is under one of its names at any time."""
    if draft.is_dir() and place.is_dir():
        _refuse_other_files(place, is_own)
        with contextlib.suppress(OSError, AttributeError):
            # Linux exchanges both in one step (RENAME_EXCHANGE is 2); paths are not relative to an open folder (-100)
            if ctypes.CDLL(None).renameat2(-100, os.fsencode(draft), -100, os.fsencode(place), 2) == 0:
                return
        # no draft, which the next run would remove
        old = place.with_name(f"{place.name}.earlier-{secrets.token_hex(4)}")
        os.replace(place, old)
        try:
            os.replace(draft, place)
        except OSError:
            os.replace(old, place)
            raise
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
    # voxgran makes no draft that is a link: what a link leads to is of others
    is_folder = draft.is_dir() and not draft.is_symlink()
    with contextlib.suppress(OSError):
        # a library that failed may keep a file open, which would hold its space until the process ends
        for file in (draft, *(draft.rglob("*") if is_folder else ())):
            if file.is_file() and not file.is_symlink():
                os.truncate(file, 0)
    if is_folder:
        shutil.rmtree(draft, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
