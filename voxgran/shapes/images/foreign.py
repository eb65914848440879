"""Arrays in files of zarr and HDF5 that other programs wrote: described, and read part by part.

All is done in processes of their own (`read_part`): a chunk of a few kilobytes may unpack to more than the memory, and
HDF5 crashes on some damaged files. Neither code that a file names is run, nor files are read that it leads to: zarr has
a filter that is a pickle, files of HDF5 may keep values in any other file, and folders may hold links.
"""

import contextlib
import importlib
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.errors import FileFormatError, shown
from voxgran._base.files import leads_out
from voxgran._base.guarded import Content, one_file, read_part
from voxgran._base.vtk_readers import chosen_name
from voxgran.lattice.image import block_library
from voxgran.shapes.images.slices import box_of_slices

#: codecs of zarr, by the names of its formats 2 and 3, that turn bytes into numbers and do nothing else
CODECS = {"adler32", "astype", "bitround", "blosc", "bytes", "bz2", "crc32", "crc32c", "delta", "endian"}
CODECS |= {"fixedscaleoffset", "fletcher32", "gzip", "jenkins_lookup3", "lz4", "lzma", "packbits", "pcodec", "quantize"}
CODECS |= {"sharding_indexed", "shuffle", "transpose", "zfpy", "zlib", "zstd"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """An array of a file or folder; a slice is read when it is asked for.

    Attributes
    ----------
    reader : callable
        One of the readers of parts below.
    path : Path
        The file or folder.
    name : str
        The array in it.
    dtype, shape
        Of the array.
    chunks : tuple of int or None
        Numbers along each axis that are unpacked together.
    pages : tuple or None
        File and number of the page of each slice across z; None where there are no pages.
    """

    reader: Callable[..., Content]
    path: Path
    name: str
    dtype: Any
    shape: tuple[int, ...]
    chunks: tuple[int, ...] | None
    pages: tuple[tuple[str, int], ...] | None = None

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def _rows(self) -> tuple[int, ...]:
        """Numbers along each axis that are read together where there are no chunks, at least one."""
        return (*(max(n, 1) for n in self.shape[:2]), *(1,) * (self.ndim - 2))

    def __getitem__(self, key: Any) -> NDArray[Any]:
        low, high, inner = [], [], []
        for one, n in zip(key, self.shape, strict=True):
            at = np.arange(n)[one]
            low.append(int(at.min()) if at.size else 0)
            high.append(int(at.max()) + 1 if at.size else 0)
            inner.append(0 if not at.ndim else slice(None, None, one.step) if isinstance(one, slice) else at - low[-1])
        unpacked = [
            (math.ceil(end / part) - begin // part) * part
            for begin, end, part in zip(low, high, self.chunks or self._rows, strict=True)
        ]
        size = math.prod(unpacked) * np.dtype(self.dtype).itemsize
        more = {"name": self.name} if self.pages is None else {"pages": self.pages[low[2] : high[2]]}
        _, found = read_part(self.reader, self.path, size=size, low=low, high=high, **more)
        values = found["values"]
        for axis in reversed(range(self.ndim)):
            values = values[(slice(None),) * axis + (inner[axis],)]
        return values


class _Folder(type(Path())):  # type: ignore[misc]
    """A folder, out of which no link in it leads."""

    def __truediv__(self, key: Any) -> Path:
        place, folder = Path(self) / key, Path(self)
        if leads_out(place, folder):
            raise FileFormatError(f"{folder} holds {shown(str(key))}, a link to another place: copy the file itself")
        return place


def zarr_array(path: Path, *, key: str | None) -> Content:
    """Describe an array of a folder of zarr, to be run by `read_part`.

    The facts are ``told``, the attributes of the array, or of a group of OME-Zarr; ``name`` in the group, ``dtype``,
    ``shape`` and ``chunks``.

    Raises
    ------
    FileFormatError
        If there is no such array, or its chunks are unpacked by a codec that is not known.
    """
    found = _opened(path)
    told, name = dict(found.attrs), ""
    if hasattr(found, "arrays"):
        scales = scales_of(told)
        names = [level["path"] for level in scales[0]["datasets"]] if scales else sorted(n for n, _ in found.arrays())
        if not scales and key is not None and key in found:
            names = [key]
        name = chosen_name(names[:1] if scales and key is None else names, key, path)
        found = found[name]
        told = told if scales else dict(found.attrs)
    _refuse_codecs(found, path)
    facts = {"told": told, "name": name, "dtype": found.dtype.str, "shape": found.shape, "chunks": found.chunks}
    return facts, {}


def scales_of(told: dict[str, Any]) -> Any:
    """Return what the attributes of a group of OME-Zarr tell of its scales; nothing of others."""
    return told.get("multiscales") or told.get("ome", {}).get("multiscales")


def zarr_part(path: Path, *, name: str, low: list[int], high: list[int]) -> Content:
    """Return a box of an array of zarr as ``values``, to be run by `read_part`.

    Raises
    ------
    FileFormatError
        As :func:`zarr_array`.
    """
    found = _opened(path)
    found = found[name] if name else found
    _refuse_codecs(found, path)
    return {}, {"values": np.asarray(found[box_of_slices(low, high)])}


def _opened(path: Path) -> Any:
    """Return the array or group of a folder."""
    zarr = block_library("zarr")
    # each thread takes memory, of which this process may have little
    zarr.config.set({"threading.max_workers": 1, "async.concurrency": 1})
    return zarr.open(block_library("zarr.storage").LocalStore(_Folder(path), read_only=True), mode="r")


def _refuse_codecs(array: Any, path: Path) -> None:
    """Refuse an array whose chunks are unpacked by other codecs than those known, before one is read.

    Raises
    ------
    FileFormatError
        If it is.
    """
    about = array.metadata
    codecs = getattr(about, "codecs", None) or (getattr(about, "compressor", None), *(about.filters or ()))
    strange = [shown(name) for name in _names_of(codecs) if name.removeprefix("numcodecs.") not in CODECS]
    if strange or array.dtype.kind not in "biufc":
        raise FileFormatError(
            f"{path} has chunks of {array.dtype}, packed by {', '.join(strange) or 'codecs that are known'}: numbers, "
            "packed by gzip, blosc, zstd or the like, are needed; write it again"
        )


def _names_of(codecs: Iterable[Any]) -> Iterator[str]:
    """Yield the names of codecs, also of those within the chunks of a shard."""
    for codec in codecs:
        if codec is not None:
            yield str(getattr(codec, "codec_id", None) or codec.to_dict()["name"])
            yield from _names_of(getattr(codec, "codecs", ()))
            yield from _names_of(getattr(codec, "index_codecs", ()))


def hdf5_array(path: Path, *, key: str | None) -> Content:
    """Describe an array of an HDF5 file, to be run by `read_part`; links are not followed.

    The facts are ``name``, ``dtype``, ``shape`` and ``chunks``.

    Raises
    ------
    FileFormatError
        If there is no such array, or its values lie in other files.
    """
    names = list[str]()
    with _hdf5(path) as file:
        kind = block_library("h5py").Dataset
        # MATLAB keeps what cells refer to in a group of its own
        file.visititems(
            lambda name, item: names.append(name) if isinstance(item, kind) and not name.startswith("#") else None
        )
        name = chosen_name(names, key.strip("/") if key is not None else None, path)
        found = file[name]
        _refuse_other_files(found, path)
        facts = {"name": name, "dtype": found.dtype.str, "shape": found.shape, "chunks": found.chunks}
    return facts, {}


def hdf5_part(path: Path, *, name: str, low: list[int], high: list[int]) -> Content:
    """Return a box of an array of an HDF5 file as ``values``, to be run by `read_part`.

    Raises
    ------
    FileFormatError
        As :func:`hdf5_array`.
    """
    with _hdf5(path) as file:
        _refuse_other_files(file[name], path)
        return {}, {"values": np.asarray(file[name][box_of_slices(low, high)])}


def is_hdf5(path: Path) -> bool:
    """Return whether a file is one of HDF5, also behind the header of MATLAB."""
    with path.open("rb") as file:
        head = file.read(520)
    return b"\x89HDF\r\n\x1a\n" in (head[:8], head[512:])


@contextlib.contextmanager
def _hdf5(path: Path) -> Iterator[Any]:
    """Open an HDF5 file, and no other (context manager)."""
    library = block_library("h5py")
    with contextlib.suppress(ImportError):
        # more filters, where its user has installed them
        importlib.import_module("hdf5plugin")
    with one_file(), library.File(path, "r") as file:
        yield file


def _refuse_other_files(dataset: Any, path: Path) -> None:
    """Refuse an array whose values lie in other files, which may be any.

    Raises
    ------
    FileFormatError
        If they do.
    """
    if dataset.external or dataset.is_virtual:
        raise FileFormatError(f"{path} has the values of {shown(dataset.name)} in other files: write them into it")
