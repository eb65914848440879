"""TIFF files of one or several pages: whether they are whole, the lattice that they tell, and their values."""

import contextlib
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from voxgran._base.errors import FileFormatError
from voxgran._base.guarded import Content, one_file
from voxgran._base.lazy import load_extra
from voxgran._base.units import known_unit


def image_library(name: str) -> Any:
    """Load a library of the extra `images`, which reads and writes a format."""
    return load_extra(name, "images", "it reads and writes such images")


def tiff_pages(path: Path) -> Content:
    """Read the pages of a TIFF file, to be run by `read_guarded`.

    The facts are ``spacing`` and ``unit`` (None if the file does not tell them), and ``offset``, ``dtype`` and
    ``shape`` if the pages can be mapped; otherwise the arrays hold ``pages``.

    Raises
    ------
    FileFormatError
        If it is cut, or has slices in other files.
    """
    with contextlib.ExitStack() as opened:
        # the library would read other files, which OME and Micro-Manager name, where it looks for the series
        with one_file():
            file = opened.enter_context(image_library("tifffile").TiffFile(path))
            refuse_cut(file, path)
            series = file.series
        if any(page is None for one in series for page in one.pages):
            raise FileFormatError(
                f"{path} has slices in other files, which may lie anywhere: write all into it, or give the folder of "
                "all files"
            )
        spacing, unit = tiff_lattice(file)
        # pages that were written one by one may be as many series
        apart = len(series) > 1 and len({(page.shape, page.dtype) for page in file.pages}) == 1
        told = {"spacing": spacing, "unit": unit}
        if apart:
            return told, {"pages": file.asarray(key=slice(None), maxworkers=1)}
        first = series[0]
        if first.dataoffset is None:
            return told, {"pages": file.asarray(maxworkers=1)}
        dtype = f"{file.byteorder}{first.dtype.char}"
        return {"offset": first.dataoffset, "dtype": dtype, "shape": first.shape, **told}, {}


def refuse_cut(file: Any, path: Path) -> None:
    """Refuse a TIFF file that ends within a page, or before pages that it has: the library would leave these out.

    Raises
    ------
    FileFormatError
        If it does.
    """
    whole, last = path.stat().st_size, file.pages[len(file.pages) - 1]
    for k, page in enumerate(file.pages):
        ends = [start + size for start, size in zip(page.dataoffsets, page.databytecounts, strict=False)]
        if max(ends, default=0) > whole:
            raise FileFormatError(f"{path} ends within slice {k} (from 0 on): it is cut; write it again")
    end = last.offset + file.tiff.tagnosize + len(last.tags) * file.tiff.tagsize
    file.filehandle.seek(end)
    following = int.from_bytes(file.filehandle.read(file.tiff.offsetsize), "big" if file.byteorder == ">" else "little")
    if following >= whole:
        # slices that are not packed may all lie behind the first, before what describes them
        packed = last.compression != 1 or not last.nbytes
        many = len(file.pages) - 1 + (1 if packed else (whole - last.dataoffsets[0]) // last.nbytes)
        raise FileFormatError(f"{path} ends within slice {many} (from 0 on): it is cut; write it again")


def tiff_lattice(file: Any) -> tuple[list[float] | None, str | None]:
    """Return the edges of a voxel and their unit, where ImageJ or OME has written them into a TIFF file."""
    if file.ome_metadata:
        found = ET.fromstring(file.ome_metadata)
        pixels = next((item for item in found.iter() if item.tag.rpartition("}")[2] == "Pixels"), None)
        told = {} if pixels is None else pixels.attrib
        sizes = [told.get(f"PhysicalSize{axis}") for axis in "XYZ"]
        units = [known_unit(told.get(f"PhysicalSize{axis}Unit", "um")) for axis in "XYZ"]
        if None in sizes or len(set(units)) > 1:
            return None, None
        return _edges_or_none(float(size) for size in sizes if size is not None), units[0]
    kept = file.imagej_metadata or {}
    tags = file.pages[0].tags
    if "spacing" not in kept or "XResolution" not in tags or "YResolution" not in tags:
        return None, None
    # voxels per unit of length, as two whole numbers
    across = [tags[f"{axis}Resolution"].value for axis in "XY"]
    edges = [below / above if above else math.nan for above, below in across]
    return _edges_or_none([*edges, float(kept["spacing"])]), known_unit(str(kept.get("unit", "")))


def _edges_or_none(values: Iterable[float]) -> list[float] | None:
    """Return edges of a voxel that are lengths; None for others, which files without a lattice hold."""
    edges = [float(value) for value in values]
    return edges if all(math.isfinite(edge) and edge > 0 for edge in edges) else None
