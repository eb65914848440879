"""Images whose values lie in files so that a part of them can be read: what they are, and such parts."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import as_count
from voxgran._base.errors import FileFormatError, InputError, MissingFileError, shown
from voxgran._base.files import existing_file
from voxgran._base.guarded import Content, read_guarded, read_part
from voxgran._base.units import known_unit, unit_factor
from voxgran._base.vtk_readers import meta_values, refuse_elsewhere
from voxgran.lattice.image import Image, as_edges
from voxgran.shapes.images.foreign import Parts, hdf5_array, hdf5_part, is_hdf5, scales_of, zarr_array, zarr_part
from voxgran.shapes.images.ome_zarr import ome_image
from voxgran.shapes.images.slices import PNG, TIFF, png_part, png_stack, slices_in, tiff_part, tiff_stack
from voxgran.shapes.images.tiff_files import image_library

HDF5, MATLAB = (".h5", ".hdf5", ".hdf", ".nxs"), ".mat"
#: types of numbers of MetaImage
META = {"UCHAR": "u1", "CHAR": "i1", "USHORT": "u2", "SHORT": "i2", "UINT": "u4", "INT": "i4", "FLOAT": "f4"}
META = {f"MET_{name}": code for name, code in (META | {"DOUBLE": "f8"}).items()}
#: types of numbers of NRRD, without sign
NRRD = {"char": "i1", "short": "i2", "int": "i4", "longlong": "i8", "long long": "i8", "float": "f4", "double": "f8"}
NRRD |= {f"int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)}


@dataclass(frozen=True, slots=True)
class Mapped:
    """Numbers that lie in a file one after another; a slice is read when it is asked for."""

    path: Path
    offset: int
    dtype: Any
    shape: tuple[int, ...]
    order: Any = "C"
    ndim: int = 3

    def mapped(self) -> NDArray[Any]:
        """Return the whole array, which is read where it is used."""
        return np.memmap(self.path, self.dtype, "r", self.offset, self.shape, self.order)

    def __getitem__(self, key: Any) -> NDArray[Any]:
        return np.array(self.mapped()[key])


@dataclass(frozen=True, slots=True)
class Turned:
    """An array with its axes in reverse order, as MATLAB writes them to HDF5."""

    parts: Parts
    ndim: int = 3

    @property
    def dtype(self) -> Any:
        """Type of the numbers."""
        return self.parts.dtype

    @property
    def shape(self) -> tuple[int, ...]:
        """Numbers along each axis."""
        return self.parts.shape[::-1]

    @property
    def chunks(self) -> tuple[int, ...] | None:
        """Numbers along each axis that are unpacked together."""
        return None if self.parts.chunks is None else self.parts.chunks[::-1]

    def __getitem__(self, key: Any) -> NDArray[Any]:
        return self.parts[key[::-1]].transpose()


def is_kept_in_parts(path: Path) -> bool:
    """Return whether a file or folder holds an image that may be larger than the memory: in parts, or one slice in each
    file.
    """
    if path.is_dir():
        return _is_zarr(path) or any(slices_in(path, kind) for kind in (TIFF, PNG))
    return path.suffix.lower() in (*HDF5, ".nhdr")


def raw_image(path: Path, shape: Any, dtype: Any) -> Image:
    """Return values without a header that lie in a file one after another, x fastest.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it has another size.
    InputError
        If the shape is not three whole numbers, or the type is none of numbers.
    """
    found = existing_file(path)
    given = list(shape) if isinstance(shape, list | tuple) else []
    if len(given) != 3:
        raise InputError(f"shape is {shown(shape)}: three numbers of voxels are needed, along x, y and z; give them")
    x, y, z = (as_count(n, "shape", at_least=1) for n in given)
    try:
        kind = np.dtype("O" if dtype is None else dtype)
    except (TypeError, ValueError):
        kind = np.dtype("O")
    if kind.kind not in "biuf":
        raise InputError(f"dtype is {shown(dtype)}: a type of numbers is needed; give one, such as 'uint16' or '>u2'")
    needed, there = x * y * z * kind.itemsize, found.stat().st_size
    if needed != there:
        raise FileFormatError(
            f"{found} has {there} bytes, and {x} x {y} x {z} voxels of {kind} have {needed}: give the shape and the "
            "type of all that it holds"
        )
    return Image(Mapped(found, 0, kind, (x, y, z), "F"))  # type: ignore[arg-type]


def _is_zarr(folder: Path) -> bool:
    """Return whether a folder is one of zarr."""
    return any((folder / name).is_file() for name in ("zarr.json", ".zarray", ".zgroup"))


def sliced_image(path: Path, key: str | None) -> Image | None:
    """Return the image in a file or folder, with values that are sliced when they are read; None if it is one that is
    read as a whole.

    Raises
    ------
    MissingFileError
        If there is no such file or folder.
    FileFormatError
        If it is damaged, or holds several arrays or none and no key is given.
    MissingLibraryError
        If the library that reads the format is not installed.
    """
    if not path.exists():
        raise MissingFileError(f"{path} is not there: a file or a folder is needed; check the path")
    suffix = path.suffix.lower()
    if path.is_dir():
        if _is_zarr(path):
            return _open_zarr(path, key)
        return _stack(path) if any(slices_in(path, kind) for kind in (TIFF, PNG)) else None
    existing_file(path)
    if suffix in HDF5:
        return Image(_parts(hdf5_part, path, read_part(hdf5_array, path, size=0, key=key)[0]))
    if suffix == MATLAB and is_hdf5(path):
        facts = read_part(hdf5_array, path, size=0, key=key)[0]
        return Image(Turned(_parts(hdf5_part, path, facts)))  # type: ignore[arg-type]
    if suffix in (".nrrd", ".nhdr"):
        return _of_header(path, read_guarded(nrrd_header, path)[0])
    if suffix in (".mha", ".mhd"):
        return _of_header(path, meta_header(path))
    return _stack(path) if suffix in TIFF else None


def _open_zarr(path: Path, key: str | None) -> Image:
    """Return an array of zarr, and what voxgran has written beside it."""
    facts, _ = read_part(zarr_array, path, size=0, key=key)
    told, values = facts["told"], _parts(zarr_part, path, facts)
    if scales_of(told):
        return ome_image(told, facts["name"], values, path)
    size, (x, y, z) = told.get("voxel_size"), map(float, told.get("origin", (0.0, 0.0, 0.0)))
    return Image(values, None if size is None else as_edges(size), (x, y, z), known_unit(str(told.get("unit", ""))))


def _parts(reader: Callable[..., Content], path: Path, facts: dict[str, Any]) -> Any:
    """Return the array that facts describe, of which parts are read when they are asked for."""
    chunks = None if facts["chunks"] is None else tuple(facts["chunks"])
    about = {"name": facts["name"], "dtype": np.dtype(facts["dtype"]), "shape": tuple(facts["shape"])}
    return Parts(reader=reader, path=path, chunks=chunks, **about)


def _stack(path: Path) -> Image:
    """Return the pages of a TIFF file, or of the TIFF or else PNG files of a folder."""
    is_tiff = not path.is_dir() or bool(slices_in(path, TIFF))
    facts, _ = read_guarded(tiff_stack if is_tiff else png_stack, path)
    dtype, shape, spacing = np.dtype(facts["dtype"]), tuple(facts["shape"]), facts["spacing"]
    pages = tuple((name, k) for name, k in facts["pages"])
    values: Any = Parts(
        reader=tiff_part if is_tiff else png_part,
        path=path,
        name="",
        dtype=dtype,
        shape=shape,
        chunks=None,
        pages=pages,
    )
    if facts["offset"] is not None:
        # values that lie one after another
        values = Mapped(Path(pages[0][0]), facts["offset"], dtype, shape, "F")
    return Image(values, None if spacing is None else tuple(spacing), unit=facts["unit"])


def nrrd_header(path: Path) -> Content:
    """Return where the values of a NRRD file lie, to be run by `read_guarded`; the facts are those of `meta_header`,
    and ``unit``.
    """
    with path.open("rb") as opened:
        header = image_library("nrrd").read_header(opened)
        begin = opened.tell()
    spacing, unit = nrrd_lattice(header, path)
    name, kind = header.get("data file", header.get("datafile")), re.sub("_t$| int$", "", header["type"])
    kind = kind.replace("unsigned ", "u").replace("signed ", "")
    code = NRRD.get(kind.removeprefix("u"))
    skips = int(header.get("byte skip", 0)), int(header.get("line skip", 0))
    raw = header["encoding"] == "raw" and code is not None and skips[0] >= 0 and not skips[1]
    code = str(code).replace("i", "u") if kind.startswith("u") else code
    order = ">" if header.get("endian") == "big" else "<"
    shape, origin = [int(n) for n in header["sizes"]], (0.0, 0.0, 0.0)
    offset = (0 if name else begin) + skips[0]
    facts = {"file": name, "raw": raw, "dtype": f"{order}{code}", "shape": shape, "offset": offset, "unit": unit}
    return {**facts, "spacing": spacing, "origin": origin}, {}


def nrrd_lattice(header: Any, path: Path) -> tuple[list[float] | None, str | None]:
    """Return the edges of a voxel and their unit, where the header of a NRRD file tells them.

    Raises
    ------
    FileFormatError
        If the axes have several units of which not all are known.
    """
    directions = header.get("space directions")
    if directions is not None and np.asarray(directions).shape == (3, 3):
        spacing = linear.norm(np.asarray(directions, dtype=float), axis=1)
    else:
        spacing = np.asarray(header.get("spacings", [np.nan] * 3), dtype=float)
    good = spacing.shape == (3,) and bool(np.isfinite(spacing).all())
    told = [str(unit).strip() for unit in header.get("space units") or header.get("units") or [] if str(unit).strip()]
    known = [known_unit(unit) for unit in told]
    if good and len(set(told)) > 1:
        if len(told) < 3 or None in known:
            raise FileFormatError(
                f"{path} has axes in {' and '.join(told)[:80]}: where units differ each must be known; write it again"
            )
        spacing *= [unit_factor(str(unit), str(known[0])) for unit in known]
    return spacing.tolist() if good else None, known[0] if known else None


def meta_header(path: Path) -> dict[str, Any]:
    """Return where the values of a MetaImage lie.

    The facts are ``file`` (None for the same), ``raw`` (whether they lie there as they are), ``dtype``, ``shape``,
    ``offset``, ``spacing`` and ``origin``, and the ``unit``, which is unknown.
    """
    head, name, begin = meta_values(path)
    told = {key.strip(): text.strip() for key, _, text in (line.partition("=") for line in head.splitlines())}
    code = META.get(told.get("ElementType", ""))
    true, skip = ("true", "1"), int(told.get("HeaderSize", 0))
    plain = told.get("CompressedData", "").lower() not in true and told.get("ElementNumberOfChannels", "1") == "1"
    msb = told.get("ElementByteOrderMSB", told.get("BinaryDataByteOrderMSB", "")).lower() in true
    shape = [int(n) for n in told.get("DimSize", "").split()]
    spacing = [abs(float(edge)) for edge in told.get("ElementSpacing", told.get("ElementSize", "1 1 1")).split()]
    corner = told.get("Offset", told.get("Position", told.get("Origin", "0 0 0"))).split()
    origin = [float(place) - edge / 2 for place, edge in zip(corner, spacing, strict=True)]
    facts = {"raw": plain and code is not None and skip >= 0, "dtype": f"{'>' if msb else '<'}{code}", "shape": shape}
    offset, file = (begin, None) if name == "LOCAL" else (skip, name)
    return {**facts, "file": file, "offset": offset, "spacing": spacing, "origin": origin, "unit": None}


def _of_header(path: Path, facts: dict[str, Any]) -> Image | None:
    """Return values that a header describes; None if they are packed.

    Raises
    ------
    FileFormatError
        If they lie in another folder or are cut.
    """
    name = facts["file"]
    data = path if name is None else path.parent / str(name)
    if name is not None:
        refuse_elsewhere(path, str(name))
    if not facts["raw"]:
        return None
    dtype, shape, spacing = np.dtype(facts["dtype"]), tuple(facts["shape"]), facts["spacing"]
    needed, there = facts["offset"] + math.prod(shape) * dtype.itemsize, data.stat().st_size
    if needed > there or min(shape, default=0) < 0:
        raise FileFormatError(f"{data} has {there} bytes and {path} describes {needed}: it is cut; write it again")
    values: Any = Mapped(data, facts["offset"], dtype, shape, "F", len(shape))
    return Image(values, None if spacing is None else tuple(spacing), tuple(facts["origin"]), facts["unit"])
