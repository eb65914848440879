"""The adapter to VTK: arrays into data sets, and data sets into XML files.

Errors of VTK are heard by observers and raised; nothing is printed.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError, OutputError, shown
from voxgran._base.lazy import load


def numpy_support() -> Any:
    """Return the bridge between arrays of NumPy and VTK."""
    return load("vtkmodules.util.numpy_support")


def poly_data(points: Floats, cells: str, corners: NDArray[np.int64]) -> Any:
    """Return points and one kind of cells (Verts, Lines, Polys), all with the same number of corners."""
    bridge, model = numpy_support(), load("vtkmodules.vtkCommonDataModel")
    core = load("vtkmodules.vtkCommonCore")
    data, places = model.vtkPolyData(), core.vtkPoints()
    places.SetData(bridge.numpy_to_vtk(np.array(points, dtype=np.float64), deep=True))
    data.SetPoints(places)
    array = model.vtkCellArray()
    count, size = corners.shape
    starts = bridge.numpy_to_vtkIdTypeArray(np.arange(count + 1, dtype=np.int64) * size, deep=True)
    array.SetData(starts, bridge.numpy_to_vtkIdTypeArray(np.array(corners, dtype=np.int64).ravel(), deep=True))
    getattr(data, f"Set{cells}")(array)
    return data


def attach(place: Any, arrays: Mapping[str, NDArray[Any]], *, deep: bool = True) -> None:
    """Add arrays to the point, cell or field data; those that are not copied must stay as long as the data."""
    for name, values in arrays.items():
        array = numpy_support().numpy_to_vtk(np.ascontiguousarray(values), deep=deep)
        array.SetName(name)
        place.AddArray(array)


def attach_texts(place: Any, texts: Mapping[str, str]) -> None:
    """Add texts to the field data.

    Raises
    ------
    InputError
        If one holds NUL, at which texts of files end: VTK could not read it again.
    """
    for name, text in texts.items():
        if "\0" in text:
            raise InputError(f"{name} is {shown(text)}: files of VTK hold no NUL; leave it out")
        array = load("vtkmodules.vtkCommonCore").vtkStringArray()
        array.SetName(name)
        array.InsertNextValue(text)
        place.AddArray(array)


def image_data(
    image: NDArray[Any], name: str, *, voxel_size: tuple[float, float, float], origin: tuple[float, float, float]
) -> Any:
    """Return an (nx, ny, nz) array as the cells of an image with voxels of these edges."""
    data = load("vtkmodules.vtkCommonDataModel").vtkImageData()
    data.SetDimensions(*(n + 1 for n in image.shape))
    data.SetSpacing(*voxel_size)
    data.SetOrigin(*origin)
    flat = image.ravel(order="F")
    attach(data.GetCellData(), {name: flat.view(np.uint8) if flat.dtype == bool else flat})
    return data


def write_data(writer_name: str, data: Any, path: Path) -> None:
    """Write a data set, compressed, by a class of ``vtkmodules.vtkIOXML``.

    Raises
    ------
    OutputError
        If VTK cannot write it.
    """
    writer = getattr(load("vtkmodules.vtkIOXML"), writer_name)()
    heard = watched(writer, writer.GetExecutive())
    writer.SetFileName(os.fsencode(path))
    writer.SetInputData(data)
    writer.SetDataModeToAppended()
    writer.EncodeAppendedDataOff()
    writer.SetCompressorTypeToZLib()
    writer.SetHeaderTypeToUInt64()
    if writer.Write() != 1 or heard or not path.is_file():
        names = load("vtkmodules.vtkCommonMisc").vtkErrorCode
        reason = names.GetStringFromErrorCode(writer.GetErrorCode())
        raise OutputError(f"{path.parent} cannot be written to ({reason}): free space or choose another place")


def watched(*sources: Any) -> list[str]:
    """Return the list to which errors of readers, filters and writers are added, which these then do not print."""
    heard: list[str] = []

    def hear(caller: object, event: str, message: str | None = None) -> None:
        del caller, event
        text = message or "an error without words"
        heard.append(" ".join((text.partition("): ")[2] or text).split()))

    hear.CallDataType = "string0"  # type: ignore[attr-defined]
    for source in sources:
        source.AddObserver("ErrorEvent", hear)
    return heard
