"""Images in: .npy, .npz, TIFF stacks, .vti and .nrrd, as arrays with axes x, y, z."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import check_lengths, float_array
from voxgran._base.errors import FileFormatError, InputError, MissingLibraryError, TooLargeError, shown
from voxgran._base.files import existing_file
from voxgran._base.lazy import load


@dataclass(frozen=True, slots=True)
class Image:
    """An image and what its file says of its lattice.

    Attributes
    ----------
    values : ndarray
        Axes x, y, z; not read into memory where the file allows that.
    voxel_size : (3,) tuple of float or None
        Edges of a voxel, where the file tells.
    origin : (3,) tuple of float
        Lower corner of voxel (0, 0, 0).
    """

    values: NDArray[Any]
    voxel_size: tuple[float, float, float] | None = None
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)


def read_image(path: str | os.PathLike[str], *, key: str | None = None) -> Image:
    """Read an image of any known format.

    Parameters
    ----------
    path : path-like
        ``.npy`` (not read into memory as a whole), ``.npz``, ``.tif``/``.tiff`` (pages are z, rows y, columns x),
        ``.png`` (one page, as grey values; y upward),
        ``.vti`` or ``.nrrd``, by its suffix.
    key : str, optional
        Which array of an ``.npz`` or ``.vti`` file; left out: the only one.

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
    """
    found = existing_file(path)
    reader = READERS.get(found.suffix.lower())
    if reader is None:
        raise FileFormatError(
            f"{found} has the suffix {found.suffix!r}: images are read from {', '.join(READERS)}; convert it"
        )
    try:
        return reader(found, key)
    except (FileFormatError, MissingLibraryError):
        raise
    except MemoryError as error:
        raise TooLargeError(
            f"{found} does not fit in memory ({found.stat().st_size / 2**30:.1f} GiB in the file): save it as .npy, "
            "which is read piece by piece"
        ) from error
    # each library has errors of its own for what it cannot read
    except Exception as error:
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        raise FileFormatError(f"{found} cannot be read ({reason}): it is cut or damaged; write it again") from error


def _read_npy(path: Path, key: str | None) -> Image:
    """Map a .npy file."""
    del key
    return Image(np.load(path, mmap_mode="r", allow_pickle=False))


def _read_npz(path: Path, key: str | None) -> Image:
    """Read one array of a .npz file."""
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return Image(archive[_chosen(list(archive.files), key, path)])


def _read_tiff(path: Path, key: str | None) -> Image:
    """Read a stack of pages; those that are not compressed are mapped."""
    del key
    tifffile = _extra("tifffile")
    try:
        pages = tifffile.memmap(path, mode="r")
    except ValueError:
        pages = tifffile.imread(path)
    # one page is a picture: y points up
    return Image(np.moveaxis(pages, (0, 1, 2), (2, 1, 0)) if pages.ndim == 3 else pages[::-1].T)


def _read_png(path: Path, key: str | None) -> Image:
    """Read a picture as grey values between 0 and 1; columns are x, and y points up."""
    del key
    pixels = np.asarray(load("matplotlib.image").imread(path), dtype=np.float64)
    grey = pixels[..., :3].mean(axis=2) if pixels.ndim == 3 else pixels
    return Image(np.ascontiguousarray(grey[::-1].T))


def _read_nrrd(path: Path, key: str | None) -> Image:
    """Read a .nrrd file, whose first axis runs fastest: x."""
    del key
    values, header = _extra("nrrd").read(str(path))
    directions = header.get("space directions")
    if directions is not None and np.asarray(directions).shape == (3, 3):
        spacing = np.linalg.norm(np.asarray(directions, dtype=float), axis=1)
    else:
        spacing = np.asarray(header.get("spacings", [np.nan] * 3), dtype=float)
    good = spacing.shape == (3,) and bool(np.isfinite(spacing).all())
    x, y, z = spacing.tolist() if good else (1.0, 1.0, 1.0)
    return Image(np.asarray(values), (x, y, z) if good else None)


def _read_vti(path: Path, key: str | None) -> Image:
    """Read cells, or else points, of a VTK image; a point stands for the voxel about it."""
    with path.open("rb") as file:
        head = file.read(1024)
        file.seek(max(path.stat().st_size - 1024, 0))
        tail = file.read()
    # the readers of VTK end the process on some files that are cut off
    if b"<VTKFile" not in head or b"</VTKFile>" not in tail:
        raise FileFormatError(f"{path} is no whole VTK file: it is cut off or damaged; write it again")
    reader = load("vtkmodules.vtkIOXML").vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    image, support = reader.GetOutput(), load("vtkmodules.util.numpy_support")
    shape = np.array(image.GetDimensions())
    data, cells = image.GetCellData(), True
    if not data.GetNumberOfArrays():
        data, cells = image.GetPointData(), False
    names = [data.GetArrayName(k) for k in range(data.GetNumberOfArrays())]
    values = support.vtk_to_numpy(data.GetArray(_chosen(names, key, path)))
    size = np.array(image.GetSpacing())
    origin = np.array(image.GetOrigin()) - (0.0 if cells else size / 2)
    grid = values.reshape(shape - 1 if cells else shape, order="F")
    x, y, z = size.tolist()
    return Image(grid, (x, y, z), tuple(origin.tolist()))


def _extra(name: str) -> Any:
    """Load a library of the extra `images`."""
    try:
        return load(name)
    except MissingLibraryError as error:
        raise MissingLibraryError(
            f"{name} is not installed: it reads such images; install it with pip install 'voxgran[images]'"
        ) from error


def _chosen(names: list[str], key: str | None, path: Path) -> str:
    """Return the name of the array to read."""
    if key is not None and key not in names:
        raise FileFormatError(f"{path} has no array {key!r}: there are {', '.join(names) or 'none'}; choose one")
    if key is None and len(names) != 1:
        raise FileFormatError(f"{path} has the arrays {', '.join(names) or 'none'}: say which one by its key")
    return names[0] if key is None else key


def voxel_sizes(value: Any, image: Image) -> tuple[float, float, float]:
    """Return the edges of a voxel: those given, or else those of the file.

    Parameters
    ----------
    value : float or (3,) array_like of float or None
        What was given.
    image : Image
        What the file says.

    Raises
    ------
    InputError
        If neither tells, or a length is not between 1e-60 and 1e60.
    """
    if value is None:
        if image.voxel_size is None:
            raise InputError("voxel_size is None: the image does not tell it; give the edge of a voxel")
        value = image.voxel_size
    sizes = float_array(value)
    if sizes is None or sizes.shape not in ((), (3,)) or not (np.isfinite(sizes).all() and (sizes > 0).all()):
        raise InputError(f"voxel_size is {shown(value)}: every edge must be a finite number above 0; give one or three")
    check_lengths(sizes, "voxel_size")
    x, y, z = np.broadcast_to(sizes, (3,)).tolist()
    return x, y, z


READERS: dict[str, Callable[[Path, str | None], Image]] = {
    ".npy": _read_npy,
    ".npz": _read_npz,
    ".png": _read_png,
    ".tif": _read_tiff,
    ".tiff": _read_tiff,
    ".vti": _read_vti,
    ".nrrd": _read_nrrd,
}
