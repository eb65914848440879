"""`save` and `load`: packings in and out of files, by suffix."""

import os
from collections.abc import Callable
from pathlib import Path

from voxgran._base.errors import FileFormatError
from voxgran.io.spheres import load_spheres, save_spheres
from voxgran.io.vtk_files import load_packing, save_packing
from voxgran.packing.model import Packing

_TEXT = (save_spheres, load_spheres)
_FORMATS: dict[str, tuple[Callable[..., None], Callable[..., Packing]]] = {
    ".vtp": (save_packing, load_packing),
    ".txt": _TEXT,
    ".xyzr": _TEXT,
    ".csv": _TEXT,
}


def save(packing: Packing, path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """Write a packing to a file.

    Parameters
    ----------
    packing : Packing
        Any packing.
    path : path-like
        ``.vtp`` holds all of it, bit for bit, and opens in ParaView; ``.txt``, ``.xyzr`` and ``.csv`` hold spheres as
        ``x y z r``.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    FileFormatError
        If the suffix is unknown.
    InputError
        If the packing does not fit the format.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _FORMATS:
        raise FileFormatError(_unknown(path))
    _FORMATS[suffix][0](packing, path, overwrite=overwrite)


def load(path: str | os.PathLike[str]) -> Packing:
    """Read a packing from a file.

    Parameters
    ----------
    path : path-like
        A file that :func:`save` wrote, or spheres as text, one ``x y z r`` a line.

    Returns
    -------
    Packing

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is unknown, or the content is damaged or not a packing.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _FORMATS:
        raise FileFormatError(_unknown(path))
    return _FORMATS[suffix][1](path)


def _unknown(path: str | os.PathLike[str]) -> str:
    """Say which suffixes are known."""
    return f"{path} has the suffix {Path(path).suffix!r}: packings are kept as {', '.join(_FORMATS)}; rename it"
