"""Images in: .npy, .npz, TIFF stacks, .vti, .nrrd, MetaImage, MATLAB, values without a header, and folders of slices,
as arrays with axes x, y, z.
"""

import os
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.calls import explained
from voxgran._base.errors import FileFormatError, InputError, TooLargeError, shown
from voxgran._base.files import as_path, existing_file, files_in
from voxgran._base.guarded import Content, read_guarded, refused
from voxgran._base.lazy import load
from voxgran._base.machine import memory_limit
from voxgran._base.units import as_unit, known_unit, stated_unit
from voxgran._base.vtk_readers import chosen_name, dicom_series, meta_image, vtk_image
from voxgran.lattice.image import Image as Image
from voxgran.lattice.image import as_edges
from voxgran.lattice.image import voxel_sizes as voxel_sizes
from voxgran.shapes.images.sliced import MATLAB, is_kept_in_parts, nrrd_lattice, raw_image, sliced_image
from voxgran.shapes.images.tiff_files import image_library, tiff_pages

#: classes of arrays of numbers of MATLAB
NUMBERS = {"double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64))}


@explained(hint='load_image("scan.npy", voxel_size=0.1, unit="mm")')
def load_image(
    path: str | os.PathLike[str],
    *,
    key: str | None = None,
    voxel_size: Any = None,
    unit: str | None = None,
    shape: Sequence[int] | None = None,
    dtype: Any = None,
) -> Image:
    """Read an image of any known format.

    Parameters
    ----------
    path : path-like
        ``.npy`` (not read into memory as a whole), ``.npz``, ``.tif``/``.tiff`` (pages are z, rows y, columns x),
        ``.png`` (one page, as grey values; y upward), ``.vti``, ``.nrrd``, ``.mha``, ``.mhd`` or ``.mat`` of MATLAB
        (its first axis is x), by its suffix; values without a header (``.raw``), whose `shape` and `dtype` are given;
        a folder with TIFF or PNG files, in the order of the numbers in their names, whose pages or pictures are slices
        across z (rows are y); a folder with the slices of one DICOM series (rows are y, and z rises with the position
        of the slices); or whatever else :func:`open_image` reads. Files of VTK, NRRD, MetaImage and DICOM hold the
        edges of a voxel, and TIFF that ImageJ or OME has written.
    key : str, optional
        Which array of an ``.npz``, ``.vti``, ``.mat`` or HDF5 file; default: the only one.
    voxel_size : float or (3,) array_like of float, optional
        Edges of a voxel; default: as the file says.
    unit : str, optional
        Unit of the voxel size; default: as the file says, where its voxel size is taken.
    shape : (3,) sequence of int, optional
        Voxels along x, y and z of a file without a header, in which x runs fastest.
    dtype : str or dtype, optional
        Type of its numbers, such as ``"uint8"``, or ``">u2"`` with the highest byte first.

    Returns
    -------
    Image

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is unknown, or the file is damaged, or holds several arrays or none and no key is given.
    MissingLibraryError
        If the library that reads the format is not installed.
    TooLargeError
        If it does not fit in memory.
    InputError
        If an edge of a voxel is not a length, the unit is not that of the file, or only one of shape and type is given.
    UnknownNameError
        If the unit is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> np.save("scan.npy", np.zeros((10, 20, 30), dtype=np.uint8))
    >>> vg.load_image("scan.npy").values.shape
    (10, 20, 30)
    """
    if shape is None and dtype is None:
        return with_lattice(_image_in(as_path(path), key), voxel_size, unit)
    values: Any = raw_image(as_path(path), shape, dtype).values
    return with_lattice(Image(values.mapped()), voxel_size, unit)


def with_lattice(image: Image, voxel_size: Any, unit: str | None) -> Image:
    """Return an image with the edges of a voxel and the unit that are given, where they are."""
    if voxel_size is None:
        return replace(image, unit=voxel_unit(unit, None, image))
    return replace(image, voxel_size=as_edges(voxel_size), unit=stated_unit(unit))


def _image_in(path: Path, key: str | None) -> Image:
    """Return the image in a file or folder."""
    if is_kept_in_parts(path) or (path.suffix.lower() == MATLAB and path.is_file()):
        with refused(path):
            image = sliced_image(path, key)
        if image is not None:
            return replace(image, values=image.values[(slice(None),) * image.values.ndim])
    if path.is_dir():
        with refused(path):
            return _read_dicom(path, key)
    found = existing_file(path)
    reader = READERS.get(found.suffix.lower())
    if reader is None:
        raise FileFormatError(
            f"{found} has the suffix {found.suffix!r}: images are read from {', '.join(READERS)}; convert it"
        )
    with refused(found):
        return reader(found, key)


def _read_npy(path: Path, key: str | None) -> Image:
    """Map a .npy file."""
    del key
    _refuse_others(path, b"\x93NUMPY")
    return Image(np.load(path, mmap_mode="r", allow_pickle=False))


def _read_npz(path: Path, key: str | None) -> Image:
    """Read one array of a .npz file."""
    _refuse_others(path, b"PK")
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        name = chosen_name(list(archive.files), key, path)
        _refuse_other_packing(archive.zip, path)
        _refuse_too_large(archive.zip, name, path)
        return Image(archive[name])


def _refuse_other_packing(archive: zipfile.ZipFile, path: Path) -> None:
    """Refuse compression by other than DEFLATE, which alone bounds what a small file can become, and which NumPy uses.

    Raises
    ------
    FileFormatError
        If an array is compressed in another way.
    """
    for member in archive.infolist():
        if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise FileFormatError(
                f"{path} holds {shown(member.filename)} compressed by method {member.compress_type}: NumPy writes by "
                "none or DEFLATE (8); save it again with numpy.savez_compressed"
            )


def _refuse_too_large(archive: zipfile.ZipFile, name: str, path: Path) -> None:
    """Refuse an array that does not fit in memory, which a small file may hold.

    Raises
    ------
    TooLargeError
        If it is larger.
    """
    size = max((one.file_size for one in archive.infolist() if one.filename in (name, f"{name}.npy")), default=0)
    if size > memory_limit():
        raise TooLargeError(
            f"{path} of {path.stat().st_size} bytes holds {shown(name)} of {size} bytes: more than the memory; cut it "
            "into parts"
        )


def _refuse_others(path: Path, begin: bytes) -> None:
    """Refuse a file that does not begin as arrays of NumPy do, which NumPy would take for pickled objects."""
    with path.open("rb") as file:
        found = file.read(len(begin))
    if found != begin:
        raise FileFormatError(f"{path} begins with {found!r}: a {path.suffix} file of NumPy is needed; write it again")


def _read_tiff(path: Path, key: str | None) -> Image:
    """Read a stack of pages; those that are not compressed are mapped."""
    del key
    facts, found = read_guarded(tiff_pages, path)
    size, unit = facts.pop("spacing"), facts.pop("unit")
    pages = found["pages"] if "pages" in found else np.memmap(path, mode="r", **facts)
    # one page is a picture: y points up
    values = np.moveaxis(pages, (0, 1, 2), (2, 1, 0)) if pages.ndim == 3 else pages[::-1].T
    return Image(values, None if size is None else tuple(size), unit=unit)


def _read_png(path: Path, key: str | None) -> Image:
    """Read a picture as grey values between 0 and 1; columns are x, and y points up."""
    del key
    return Image(read_guarded(png_values, path)[1]["values"])


def png_values(path: Path) -> Content:
    """Read the grey ``values`` of a picture, to be run by `read_guarded`."""
    pixels = np.asarray(load("matplotlib.image").imread(path), dtype=np.float64)
    grey = pixels[..., :3].mean(axis=2) if pixels.ndim == 3 else pixels
    return {}, {"values": grey[::-1].T}


def _read_matlab(path: Path, key: str | None) -> Image:
    """Read an array of a file of MATLAB before version 7.3."""
    return Image(read_guarded(matlab_values, path, key=key)[1]["values"])


def matlab_values(path: Path, *, key: str | None) -> Content:
    """Read the ``values`` of an array of a file of MATLAB, to be run by `read_guarded`.

    Raises
    ------
    FileFormatError
        If there is no such array of numbers.
    """
    library = load("scipy.io")
    name = chosen_name([name for name, _, kind in library.whosmat(path) if kind in NUMBERS], key, path)
    return {}, {"values": library.loadmat(path, variable_names=[name])[name]}


def _refuse_raw(path: Path, key: str | None) -> Image:
    """Refuse a file without a header."""
    del key
    raise FileFormatError(
        f'{path} has {path.stat().st_size} bytes and no header: give shape=(nx, ny, nz) and dtype="uint16", at the '
        "prompt --shape nx,ny,nz --dtype uint16, with its own numbers of voxels and type"
    )


def _read_nrrd(path: Path, key: str | None) -> Image:
    """Read a .nrrd file, whose first axis runs fastest: x."""
    del key
    facts, found = read_guarded(nrrd_values, path)
    size = facts["spacing"]
    values = found["values"].reshape(facts["shape"], order="F")
    return Image(values, None if size is None else tuple(size), unit=facts["unit"])


def nrrd_values(path: Path) -> Content:
    """Read the values of a .nrrd file, to be run by `read_guarded`.

    The facts are ``shape``, ``spacing`` and ``unit`` (None if unknown); the array is ``values``, flat, the first axis
    running fastest.

    Raises
    ------
    FileFormatError
        If its data stand in other files, or the axes have several units of which not all are known.
    """
    library = image_library("nrrd")
    if {"data file", "datafile"} & library.read_header(str(path)).keys():
        raise FileFormatError(
            f"{path} only names other files, which may lie anywhere: write header and data as one file"
        )
    values, header = library.read(str(path))
    spacing, unit = nrrd_lattice(header, path)
    facts = {"shape": values.shape, "spacing": spacing, "unit": unit}
    return facts, {"values": np.asarray(values).ravel(order="F")}


def _read_meta(path: Path, key: str | None) -> Image:
    """Read a MetaImage, whose values may lie in a file beside it."""
    del key
    facts, found = read_guarded(meta_image, path)
    return Image(found["values"].reshape(facts["shape"], order="F"), tuple(facts["spacing"]), tuple(facts["origin"]))


def _read_dicom(folder: Path, key: str | None) -> Image:
    """Read the slices of a folder of DICOM files."""
    del key
    files = sorted(files_in(folder))
    if not files:
        raise FileFormatError(f"{folder} has no files: slices or a zarr array are needed; check the path")
    try:
        facts, found = read_guarded(dicom_series, folder)
    except FileFormatError as error:
        if any(_is_dicom(item) for item in files):
            raise
        raise FileFormatError(
            f"{folder} holds {files[0].name}, and no slices: files of DICOM, TIFF or PNG are needed, or a "
            "zarr array; check the path"
        ) from error
    # VTK turns the image by half a turn about x; lengths are in millimetres by the standard
    values = found["values"].reshape(facts["shape"], order="F")[:, ::-1, ::-1]
    return Image(values, tuple(facts["spacing"]), unit="mm")


def _is_dicom(path: Path) -> bool:
    """Return whether a file begins as one of DICOM does."""
    with path.open("rb") as file:
        return file.read(132)[128:] == b"DICM"


def _read_vti(path: Path, key: str | None) -> Image:
    """Read a VTK image."""
    facts, found = read_guarded(vtk_image, path, key=key)
    unit = known_unit(facts["texts"].get("unit", ""))
    values = found["values"].reshape(facts["shape"], order="F")
    return Image(values, tuple(facts["spacing"]), tuple(facts["origin"]), unit)


def voxel_unit(unit: str | None, value: Any, image: Image) -> str | None:
    """Return the unit of the edges of a voxel: the one given, or else that of the file whose edges are taken.

    Raises
    ------
    InputError
        If both are known and differ.
    """
    told = image.unit if value is None else None
    if told is None or unit is None:
        return told if unit is None else unit
    if as_unit(unit) != told:
        raise InputError(
            f"unit is {shown(unit)} and the file has its voxels in {told}: leave the unit out, or give voxel_size too"
        )
    return told


READERS: dict[str, Callable[[Path, str | None], Image]] = {
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".png": _read_png,
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".vti": _read_vti,
    ".nrrd": _read_nrrd,
    ".mha": _read_meta,
    ".mhd": _read_meta,
    MATLAB: _read_matlab,
    ".raw": _refuse_raw,
}
