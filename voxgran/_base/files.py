"""Files that are written whole or not at all.

Everything is written beside its place first and moved there at the end, so that neither a full disk nor a kill leaves
half a file under the final name, and a file that was there before stays until the new one is complete.
"""

import contextlib
import glob
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from voxgran._base.errors import InputError, MissingFileError, OutputError, OutputExistsError


def as_path(path: str | os.PathLike[str]) -> Path:
    """Return what was given as a path.

    Raises
    ------
    InputError
        If it is neither text nor a path.
    """
    if not isinstance(path, str | os.PathLike):
        raise InputError(f"path is {path!r}: it must be the path of a file, as text or a Path; change it")
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
        kind = "is a folder" if found.is_dir() else "is not there"
        raise MissingFileError(f"{found} {kind}: a file is needed; check the path")
    try:
        with found.open("rb"):
            return found
    except OSError as error:
        raise OutputError(f"{found} cannot be read ({error.strerror}): change its permissions") from error


@contextlib.contextmanager
def written_whole(path: str | os.PathLike[str], *, overwrite: bool = True) -> Iterator[Path]:
    """Give a path to write to, and move what was written to its place at the end (context manager).

    Parameters
    ----------
    path : path-like
        Where the file (or the folder) shall end up.
    overwrite : bool
        Whether what is there may be replaced.

    Yields
    ------
    Path
        A path beside it, with the same suffix, that does not exist yet.

    Raises
    ------
    OutputExistsError
        If something is there and `overwrite` is false.
    OutputError
        If it cannot be written: no space, no permission, no such folder.
    """
    target = as_path(path)
    if target.exists() and not overwrite:
        raise OutputExistsError(f"{target} is there already: it is not replaced unasked; ask to overwrite or move it")
    draft = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield draft
        _sync(draft)
        _replace(draft, target)
    except OSError as error:
        if isinstance(error, OutputError | OutputExistsError):
            raise
        reason = error.strerror or str(error)
        raise OutputError(f"{target} cannot be written ({reason}): free space or choose another place") from error
    finally:
        _remove(draft)


def write_text(path: str | os.PathLike[str], text: str, *, overwrite: bool = True) -> None:
    """Write a text file whole or not at all.

    Raises
    ------
    OutputExistsError
        If something is there and `overwrite` is false.
    OutputError
        If it cannot be written.
    """
    with written_whole(path, overwrite=overwrite) as draft:
        draft.write_text(text, encoding="utf-8")


def remove_drafts(path: str | os.PathLike[str]) -> None:
    """Remove what a process that was killed while it wrote a file left beside it.

    Parameters
    ----------
    path : path-like
        The file; no other process may be writing it.
    """
    target = Path(path)
    for draft in target.parent.glob(f".{glob.escape(target.stem)}.????????{glob.escape(target.suffix)}"):
        _remove(draft)


def _sync(draft: Path) -> None:
    """Push a finished file to the disk, so that a power cut cannot leave the name without the content."""
    if draft.is_file():
        with draft.open("rb+") as file:
            os.fsync(file.fileno())


def _replace(draft: Path, target: Path) -> None:
    """Move the draft to its place."""
    if draft.is_dir() and target.is_dir():
        old = target.with_name(f".{target.name}.{secrets.token_hex(4)}.old")
        os.replace(target, old)
        os.replace(draft, target)
        shutil.rmtree(old, ignore_errors=True)
    else:
        os.replace(draft, target)


def _remove(draft: Path) -> None:
    """Remove what is left of a draft."""
    if draft.is_dir():
        shutil.rmtree(draft, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)
