"""Slices across z in files of TIFF and PNG, one or several in each: described, and read part by part.

Rows are y and columns x. All is done in processes of their own, as in :mod:`voxgran.shapes.images.foreign`.
"""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.errors import FileFormatError
from voxgran._base.files import files_in
from voxgran._base.guarded import Content, one_file, refused
from voxgran._base.lazy import load
from voxgran.shapes.images.tiff_files import image_library, refuse_cut, tiff_lattice

TIFF, PNG = (".tif", ".tiff"), (".png",)
#: type of the numbers of a picture, by the mode that Pillow gives it
MODES = {"1": "b1", "I;16": "<u2", "I;16B": ">u2", "I": "<i4", "F": "<f4"} | dict.fromkeys(
    ("L", "LA", "P", "RGB", "RGBA"), "u1"
)


def slices_in(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """Return the files of a folder with some suffixes, in the order of the numbers in their names: 10 follows 9.

    Raises
    ------
    FileFormatError
        If one of its files is a link to another place.
    """
    files = [item for item in files_in(folder) if item.suffix.lower() in suffixes]
    return sorted(files, key=lambda file: [int(s) if s.isdigit() else s for s in re.split(r"(\d+)", file.name)])


def tiff_stack(path: Path) -> Content:
    """Return what is known of the pages of a TIFF file or of a folder of such files, to be run by `read_guarded`.

    The facts are ``pages`` (file and number of each), ``shape``, ``dtype``, ``offset`` (None if pages do not lie one
    after another), ``spacing`` and ``unit`` (None if unknown).

    Raises
    ------
    FileFormatError
        If a file is cut, or slices differ in shape or type.
    """
    library, files = image_library("tifffile"), slices_in(path, TIFF) if path.is_dir() else [path]
    pages, kinds, lattice, offset, count = [], list[Any](), None, None, 0
    for file in files:
        with refused(file), one_file(), library.TiffFile(file) as opened:
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
            first = opened.series[0] if len(files) == 1 else None
            if first is not None and first.dataoffset is not None and first.shape[1:] == kinds[0][0]:
                # ImageJ describes more pages than it lists
                offset, count = first.dataoffset, first.shape[0]
    (rows, columns), dtype = kinds[0]
    spacing, unit = lattice or (None, None)
    shape = (columns, rows, count or len(pages))
    told = {"shape": shape, "dtype": dtype, "offset": offset, "spacing": spacing, "unit": unit}
    return {"pages": pages, **told}, {}


def png_stack(path: Path) -> Content:
    """Return what is known of the PNG files of a folder, to be run by `read_guarded`; the facts are those of
    `tiff_stack`.

    Raises
    ------
    FileFormatError
        If slices differ in shape or type.
    """
    files = slices_in(path, PNG)
    kinds = []
    for k, file in enumerate(files):
        with refused(file), _picture(file) as picture:
            kinds.append((picture.size, MODES.get(picture.mode)))
        if kinds[-1] != kinds[0] or None in kinds[0]:
            raise FileFormatError(
                f"{file} is slice {k} (from 0 on), of {kinds[-1][0]} pixels and the type {kinds[-1][1]}, and the first "
                f"is of {kinds[0][0]} and {kinds[0][1]}: all need grey pixels, as many and of one type; take it away, "
                "or write it again"
            )
    (columns, rows), dtype = kinds[0]
    told = {"shape": (columns, rows, len(files)), "dtype": dtype, "offset": None, "spacing": None, "unit": None}
    return {"pages": [(str(file), 0) for file in files], **told}, {}


def tiff_part(path: Path, *, pages: list[tuple[str, int]], low: list[int], high: list[int]) -> Content:
    """Return a box of slices that are pages, rows y and columns x, as ``values``, to be run by `read_part`."""
    del path
    values = []
    for name, page in pages:
        with refused(Path(name)):
            values.append(
                image_library("tifffile").imread(name, key=page, maxworkers=1).T[box_of_slices(low[:2], high[:2])]
            )
    return {}, {"values": np.stack(values, axis=-1)}


def png_part(path: Path, *, pages: list[tuple[str, int]], low: list[int], high: list[int]) -> Content:
    """Return a box of slices that are pictures as ``values``, to be run by `read_part`.

    Raises
    ------
    FileFormatError
        If one has colors.
    """
    del path
    values = []
    for name, _ in pages:
        with refused(Path(name)), _picture(Path(name)) as picture:
            values.append(_grey(picture, name).T[box_of_slices(low[:2], high[:2])])
    return {}, {"values": np.stack(values, axis=-1)}


def _picture(path: Path) -> Any:
    """Open a picture; how large it may be is a matter of the memory of this process."""
    library = load("PIL.Image")
    library.MAX_IMAGE_PIXELS = None
    return library.open(path)


def _grey(picture: Any, name: str) -> NDArray[Any]:
    """Return the numbers of a picture, whose colors, if it has any, are all grey."""
    values = np.asarray(picture.convert("RGB") if picture.mode == "P" else picture)
    if values.ndim < 3:
        return values
    colors = values[..., :3] if values.shape[2] > 2 else values[..., :1]
    if (colors != colors[..., :1]).any():
        raise FileFormatError(f"{name} has colors: slices of grey values or labels are needed; write it again")
    return np.asarray(colors[..., 0])


def box_of_slices(low: list[int], high: list[int]) -> tuple[slice, ...]:
    """Return the slices of a box."""
    return tuple(map(slice, low, high))
