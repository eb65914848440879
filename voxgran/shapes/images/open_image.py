"""Images that stay in their files: opened as dask arrays, whose blocks are read when they are computed."""

import math
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.calls import explained
from voxgran._base.cluster import connected
from voxgran._base.errors import FileFormatError, InputError, MissingFileError, shown
from voxgran._base.files import as_path, existing_file
from voxgran._base.guarded import Content, read_guarded, read_part, refused
from voxgran._base.units import known_unit
from voxgran._base.vtk_readers import refuse_elsewhere
from voxgran.lattice.image import Image, as_block, as_edges, lazily, lazy_of
from voxgran.shapes.images.foreign import Parts, hdf5_array, hdf5_part, scales_of, tiff_part, zarr_array, zarr_part
from voxgran.shapes.images.image_files import (
    image_library,
    load_image,
    nrrd_lattice,
    refuse_cut,
    tiff_lattice,
    with_lattice,
)
from voxgran.shapes.images.ome_zarr import ome_image

TIFF, HDF5 = (".tif", ".tiff"), (".h5", ".hdf5", ".hdf", ".nxs")
#: bytes in which the header of a raw file ends
HEADER = 2**14
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

    def __getitem__(self, key: Any) -> NDArray[Any]:
        return np.array(np.memmap(self.path, self.dtype, "r", self.offset, self.shape, self.order)[key])


@explained(hint='open_image("scan.zarr", voxel_size=0.1, unit="mm")')
def open_image(
    source: Any,
    *,
    key: str | None = None,
    voxel_size: Any = None,
    unit: str | None = None,
    block: Any = None,
    dask: Any = None,
) -> Image:
    """Open an image that may be larger than the memory.

    Parameters
    ----------
    source : path-like, dask array or array_like
        A zarr array or group (folder), an HDF5 file (``.h5``, ``.hdf5``, ``.hdf``, ``.nxs``), whose axes are x, y, z;
        a folder of TIFF files, one for each slice across z, in the order of the numbers in their names, or one ``.tif``
        of several pages; ``.npy``; raw values with a header (``.nrrd``, ``.nhdr``, ``.mha``, ``.mhd``), in the same
        file or in one beside it; or an array with axes x, y, z, such as a dask array. Whatever else :func:`load_image`
        reads, and raw values that are compressed, is read into memory.
    key : str, optional
        Which array of an HDF5 file or of a group of zarr; default: the only one, and of OME-Zarr the finest scale.
    voxel_size : float or (3,) array_like of float, optional
        Edges of a voxel; default: as the file says.
    unit : str, optional
        Unit of the voxel size; default: as the file says, where its voxel size is taken.
    block : int or (3,) array_like of int, optional
        Voxels along each edge of a block; default: about 8 million in all, in whole parts of the file.
    dask : str, cluster or client, optional
        Address of the scheduler of a Dask cluster, such as ``"tcp://HOST:8786"``, or an object of a cluster. This
        process is connected to it, as by ``distributed.Client(address)``: from then on its workers compute all blocks,
        also of other images. They need voxgran of the same version, and files under the same paths.

    Returns
    -------
    Image
        Its values are a dask array: nothing is read before it is computed. Functions of images take it block by block,
        on the threads of the machine, or on a cluster.

    Raises
    ------
    MissingFileError
        If there is no such file or folder.
    FileFormatError
        If it is no image, is cut, has slices of several shapes, or holds several arrays or none and no key is given.
    MissingLibraryError
        If the library that reads the format, or distributed for a cluster, is not installed.
    ClusterError
        If there is no scheduler.
    TooLargeError
        If it must be read as a whole or in parts, and these are too large for the memory.
    InputError
        If it has not three axes, an edge of a voxel is not a length, or a block has no whole number of voxels.
    UnknownNameError
        If the unit is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> np.save("large.npy", np.zeros((40, 50, 60), dtype=np.uint8))
    >>> image = vg.open_image("large.npy", voxel_size=0.1, block=20)
    >>> image.values.numblocks
    (2, 3, 3)
    """
    edges = None if block is None else as_block(block)
    if dask is not None:
        connected(dask, default=True)
    if isinstance(source, str | os.PathLike):
        # workers of a cluster may run in another folder
        path = as_path(source).absolute()
        with refused(path):
            image = _image_in(path, key)
        name = str(path)
    else:
        image, name = source if isinstance(source, Image) else Image(source), "the array"
    values: Any = image.values
    if getattr(values, "ndim", None) != 3 or not all(values.shape) or values.dtype.kind not in "biuf":
        told = f"the shape {values.shape} and {values.dtype}" if hasattr(values, "dtype") else shown(values)
        raise InputError(f"{name} has {told}: numbers along three axes are needed; choose a channel, or stack slices")
    lazy = (
        lazily(values, name, edges) if lazy_of(values) is None else values if edges is None else values.rechunk(edges)
    )
    return with_lattice(Image(lazy, image.voxel_size, image.origin, image.unit), voxel_size, unit)


def is_opened(path: Path) -> bool:
    """Return whether a file or folder is one that `open_image` reads and `load_image` does not."""
    if path.is_dir():
        return _is_zarr(path) or any(item.suffix.lower() in TIFF for item in path.iterdir())
    return path.suffix.lower() in (*HDF5, ".nhdr")


def _is_zarr(folder: Path) -> bool:
    """Return whether a folder is one of zarr."""
    return any((folder / name).is_file() for name in ("zarr.json", ".zarray", ".zgroup"))


def _image_in(path: Path, key: str | None) -> Image:
    """Return the image in a file or folder, with values that are sliced when they are read."""
    if not path.exists():
        raise MissingFileError(f"{path} is not there: a file or a folder is needed; check the path")
    suffix = path.suffix.lower()
    if path.is_dir():
        if not is_opened(path):
            return load_image(path, key=key)
        return _open_zarr(path, key) if _is_zarr(path) else _stack(path)
    existing_file(path)
    if suffix in HDF5:
        return Image(_parts(hdf5_part, path, read_part(hdf5_array, path, size=0, key=key)[0]))
    if suffix in (".nrrd", ".nhdr"):
        return _of_header(path, read_guarded(nrrd_header, path)[0], key)
    if suffix in (".mha", ".mhd"):
        return _of_header(path, meta_header(path), key)
    if suffix in TIFF:
        return _stack(path)
    image = load_image(path, key=key)
    if isinstance(image.values, np.memmap):
        found = image.values
        order = "C" if found.flags.c_contiguous else "F"
        return Image(Mapped(path, found.offset, found.dtype, found.shape, order, found.ndim))  # type: ignore[arg-type]
    return image


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
    """Return the pages of a TIFF file, or of the files of a folder."""
    facts, _ = read_guarded(tiff_stack, path)
    dtype, shape, spacing = np.dtype(facts["dtype"]), tuple(facts["shape"]), facts["spacing"]
    pages = tuple((name, k) for name, k in facts["pages"])
    values: Any = Parts(reader=tiff_part, path=path, name="", dtype=dtype, shape=shape, chunks=None, pages=pages)
    if facts["offset"] is not None:
        # values that lie one after another
        values = Mapped(path, facts["offset"], dtype, shape, "F")
    return Image(values, None if spacing is None else tuple(spacing), unit=facts["unit"])


def tiff_stack(path: Path) -> Content:
    """Return what is known of the pages of a TIFF file or of a folder of such files, to be run by `read_guarded`.

    The facts are ``pages`` (file and number of each), ``shape``, ``dtype``, ``offset`` (None if pages do not lie one
    after another), ``spacing`` and ``unit`` (None if unknown).

    Raises
    ------
    FileFormatError
        If a file is cut, or slices differ in shape or type.
    """
    library = image_library("tifffile")
    files = [item for item in path.iterdir() if item.suffix.lower() in TIFF] if path.is_dir() else [path]
    # slice 10 follows slice 9
    files.sort(key=lambda file: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", file.name)])
    pages, kinds, lattice, offset = [], list[Any](), None, None
    for file in files:
        with refused(file), library.TiffFile(file) as opened:
            refuse_cut(opened, file)
            lattice = tiff_lattice(opened) if lattice is None else lattice
            for k, page in enumerate(opened.pages):
                pages.append((str(file), k))
                kinds.append((page.shape, page.dtype.str))
                if kinds[-1] != kinds[0] or len(page.shape) != 2:
                    raise FileFormatError(
                        f"{file} has slice {len(kinds) - 1} (from 0 on) of the shape {page.shape} and {page.dtype}, "
                        f"and the first is of {kinds[0][0]} and {np.dtype(kinds[0][1])}: all need rows and columns of "
                        "numbers, of one shape and type; take it away, or write it again"
                    )
    (rows, columns), dtype = kinds[0]
    count = len(pages)
    if len(files) == 1:
        try:
            mapped = library.memmap(files[0], mode="r")
            if mapped.shape[1:] == (rows, columns):
                # ImageJ describes more pages than it lists
                offset, count = mapped.offset, len(mapped)
        except ValueError:
            offset = None
    spacing, unit = lattice or (None, None)
    told = {"shape": (columns, rows, count), "dtype": dtype, "offset": offset, "spacing": spacing, "unit": unit}
    return {"pages": pages, **told}, {}


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


def meta_header(path: Path) -> dict[str, Any]:
    """Return where the values of a MetaImage lie.

    The facts are ``file`` (None for the same), ``raw`` (whether they lie there as they are), ``dtype``, ``shape``,
    ``offset``, ``spacing`` and ``origin``, and the ``unit``, which is unknown.
    """
    with path.open("rb") as opened:
        text = opened.read(HEADER)
    head, _, rest = text.partition(b"ElementDataFile")
    line = rest.partition(b"\n")[0]
    begin = len(text) - len(rest) + len(line) + 1
    told: dict[str, str] = dict(re.findall(r"(?m)^\s*(\w+)\s*=\s*(.*?)\s*$", head.decode("latin-1")))
    name, code = line.decode("latin-1").strip(" =\r\t"), META.get(told.get("ElementType", ""))
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


def _of_header(path: Path, facts: dict[str, Any], key: str | None) -> Image:
    """Return values that a header describes.

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
        return load_image(path, key=key)
    dtype, shape, spacing = np.dtype(facts["dtype"]), tuple(facts["shape"]), facts["spacing"]
    needed, there = facts["offset"] + math.prod(shape) * dtype.itemsize, data.stat().st_size
    if needed > there or min(shape, default=0) < 0:
        raise FileFormatError(f"{data} has {there} bytes and {path} describes {needed}: it is cut; write it again")
    values: Any = Mapped(data, facts["offset"], dtype, shape, "F", len(shape))
    return Image(values, None if spacing is None else tuple(spacing), tuple(facts["origin"]), facts["unit"])
