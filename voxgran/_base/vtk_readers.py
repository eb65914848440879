"""Readers of VTK files, XML and legacy, to be run by `read_guarded`: VTK crashes on some damaged files.

What VTK complains about is heard by an observer and raised; nothing is printed.
"""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.errors import FileFormatError
from voxgran._base.guarded import Content
from voxgran._base.lazy import load
from voxgran._base.vtk_data import numpy_support, watched

#: types of data sets in files that refer to no other files: polygons and the four kinds of grids
OF_ONE_FILE = (0, 2, 3, 4, 6)
#: bytes at the beginning of a MetaImage in which its header ends
HEADER = 2**14


def vtk_points(path: Path) -> Content:
    """Return the points of a ``.vtp``, ``.vtu`` or ``.vtk`` file, with their arrays and those of the field data.

    Facts: ``texts``, texts of the field data by name. Arrays: ``points`` (n, 3), ``point/NAME`` and ``field/NAME``.
    """
    data = _read(path)
    points = np.zeros((0, 3))
    if data.GetNumberOfPoints():
        points = np.asarray(numpy_support().vtk_to_numpy(data.GetPoints().GetData()), dtype=np.float64)
    arrays, _ = _detached(data.GetPointData(), "point/")
    fields, texts = _detached(data.GetFieldData(), "field/")
    return {"texts": texts}, {"points": points, **arrays, **fields}


def vtk_triangles(path: Path) -> Content:
    """Return points (n, 3), corners (3 m,) of triangles and how many each has (m,) of a ``.vtk``, ``.vtp`` or ``.vtu``
    file; of a volume mesh its outer faces.

    Raises
    ------
    FileFormatError
        If VTK cannot read it.
    """
    output = _read(path)
    if not output.IsA("vtkPointSet") or not output.GetNumberOfPoints():
        raise FileFormatError(f"{path} holds no surface that VTK can read: it is cut or damaged; write it again")
    if not output.IsA("vtkPolyData"):
        output = _filtered(load("vtkmodules.vtkFiltersGeometry").vtkGeometryFilter(), output, path)
    cutter = load("vtkmodules.vtkFiltersCore").vtkTriangleFilter()
    cutter.PassVertsOff()
    cutter.PassLinesOff()
    cut = _filtered(cutter, output, path)
    none = np.zeros(0, dtype=np.int64)
    if not cut.GetNumberOfPolys():
        return {}, {"points": np.zeros((0, 3)), "corners": none, "counts": none}
    points = numpy_support().vtk_to_numpy(cut.GetPoints().GetData()).astype(np.float64)
    cells = numpy_support().vtk_to_numpy(cut.GetPolys().GetConnectivityArray()).astype(np.int64)
    return {}, {"points": points, "corners": cells, "counts": np.full(len(cells) // 3, 3)}


def vtk_image(path: Path, *, key: str | None) -> Content:
    """Return one array of the cells, or else of the points, of a ``.vti`` file; a point stands for the voxel about it.

    `key` is the name of the array, None for the only one. Facts: ``shape``, ``spacing`` and ``origin`` of the voxels,
    and ``texts`` of the field data by name. Arrays: ``values``, flat, x running fastest.

    Raises
    ------
    FileFormatError
        If VTK cannot read it, or it holds several arrays or none and no key is given.
    """
    image = _read(path)
    shape, spacing = np.array(image.GetDimensions()), np.array(image.GetSpacing())
    data, cells = image.GetCellData(), True
    if not data.GetNumberOfArrays():
        data, cells = image.GetPointData(), False
    names = [data.GetArrayName(k) for k in range(data.GetNumberOfArrays())]
    values = numpy_support().vtk_to_numpy(data.GetArray(chosen_name(names, key, path)))
    shape = shape - 1 if cells else shape
    if values.shape != (shape.prod(),):
        raise FileFormatError(
            f"{path} holds an array of shape {values.shape} for {shape.prod()} voxels: one number a voxel is needed; "
            "write it again"
        )
    origin = np.array(image.GetOrigin()) - (0.0 if cells else spacing / 2)
    _, texts = _detached(image.GetFieldData(), "field/")
    facts = {"shape": shape.tolist(), "spacing": spacing.tolist(), "origin": origin.tolist(), "texts": texts}
    return facts, {"values": values}


def meta_image(path: Path) -> Content:
    """Return the values of a MetaImage, ``.mha``, or ``.mhd`` with its values in a file of the same folder.

    Facts and arrays are those of `vtk_image`.

    Raises
    ------
    FileFormatError
        If VTK cannot read it, or its values lie in several files or in another folder.
    """
    _, name, _ = meta_values(path)
    if name != "LOCAL":
        refuse_elsewhere(path, name)
    return _image_by("vtkMetaImageReader", path, "SetFileName")


def meta_values(path: Path) -> tuple[str, str, int]:
    """Return the header of a MetaImage, the name of the file of its values, and where the header ends, in bytes.

    Raises
    ------
    FileFormatError
        If it names such a file elsewhere than in one line of its own, or several.
    """
    with path.open("rb") as file:
        text = file.read(HEADER)
    found = re.search(rb"^[ \t]*ElementDataFile[ \t]*=([^\r\n]*)\r?\n?", text, re.MULTILINE)
    name = b"" if found is None else found[1].strip()
    # a name may stand for several, in a list or by the numbers of slices
    if found is None or text.count(b"ElementDataFile") > 1 or name.startswith(b"LIST") or b"%" in name:
        raise FileFormatError(
            f"{path} does not say in one line where its values are: they must lie in it or in one file beside it; "
            "write it again"
        )
    return text[: found.start()].decode("latin-1"), name.decode("latin-1"), found.end()


def refuse_elsewhere(path: Path, name: str) -> None:
    """Refuse a header whose values lie in another folder than it, also by a link.

    Raises
    ------
    FileFormatError
        If they do.
    """
    data = path.parent / name
    if name != Path(name).name or not data.is_file() or data.resolve().parent != path.resolve().parent:
        raise FileFormatError(
            f"{path} has its values in {name[:80]!r}: they must lie in it or in one file beside it; copy them"
        )


def dicom_series(path: Path) -> Content:
    """Return the values of the slices in a folder, one DICOM series, with y and z against their order in the files.

    Facts and arrays are those of `vtk_image`.

    Raises
    ------
    FileFormatError
        If VTK cannot read it.
    """
    return _image_by("vtkDICOMImageReader", path, "SetDirectoryName")


def _image_by(name: str, path: Path, setter: str) -> Content:
    """Return what a reader of ``vtkmodules.vtkIOImage`` finds in a file or folder; its points are voxels."""
    reader = getattr(load("vtkmodules.vtkIOImage"), name)()
    heard = watched(reader, reader.GetExecutive(), load("vtkmodules.vtkCommonCore").vtkOutputWindow.GetInstance())
    getattr(reader, setter)(os.fsencode(path))
    image = _output(reader, heard, path)
    scalars, spacing = image.GetPointData().GetScalars(), np.array(image.GetSpacing())
    shape = np.array(image.GetDimensions())
    if scalars is None or scalars.GetNumberOfTuples() != shape.prod() or scalars.GetNumberOfComponents() != 1:
        raise FileFormatError(f"{path} holds no image of one number a voxel: it is cut, or in colours; write it again")
    facts = {"shape": shape.tolist(), "spacing": np.abs(spacing).tolist()}
    facts["origin"] = (np.array(image.GetOrigin()) - spacing / 2).tolist()
    return facts, {"values": np.array(numpy_support().vtk_to_numpy(scalars))}


def chosen_name(names: list[str], key: str | None, path: Path) -> str:
    """Return the name of the array to read.

    Raises
    ------
    FileFormatError
        If there is none of that name, or no name is given and there is not exactly one array.
    """
    if key is not None and key not in names:
        raise FileFormatError(f"{path} has no array {key!r}: there are {', '.join(names) or 'none'}; choose one")
    if key is None and len(names) != 1:
        raise FileFormatError(f"{path} has the arrays {', '.join(names) or 'none'}: say which one by its key")
    return names[0] if key is None else key


def _read(path: Path) -> Any:
    """Return the data set of a file; refuse one whose data stand in other files that it names."""
    core = load("vtkmodules.vtkCommonCore")
    if path.suffix.lower() == ".vtk":
        reader = load("vtkmodules.vtkIOLegacy").vtkGenericDataObjectReader()
        # the reader of the type that it finds has no other observer; such files are never read in the caller's process
        heard = watched(reader, core.vtkOutputWindow.GetInstance())
    else:
        reader, forward = load("vtkmodules.vtkIOXML").vtkXMLGenericDataObjectReader(), core.vtkEventForwarderCommand()
        forward.SetTarget(reader)
        reader.SetReaderErrorObserver(forward)
        reader.SetParserErrorObserver(forward)
        heard = watched(reader, reader.GetExecutive())
        parts = core.reference(False)
        kind = reader.ReadOutputType(os.fsencode(path), parts)
        if parts or (kind >= 0 and kind not in OF_ONE_FILE):
            raise FileFormatError(f"{path} only names other files, which may lie anywhere: give one of these")
    reader.SetFileName(os.fsencode(path))
    return _output(reader, heard, path)


def _filtered(algorithm: Any, data: Any, path: Path) -> Any:
    """Return what a filter makes of a data set."""
    algorithm.SetInputData(data)
    return _output(algorithm, watched(algorithm, algorithm.GetExecutive()), path)


def _output(algorithm: Any, heard: list[str], path: Path) -> Any:
    """Run a reader or filter and return its output; what it complains about is raised."""
    algorithm.Update()
    output = algorithm.GetOutput()
    if heard or output is None:
        reason = heard[0][:100] if heard else "it holds no data set"
        raise FileFormatError(f"{path} cannot be read by VTK ({reason}): it is cut or damaged; write it again")
    return output


def _detached(place: Any, prefix: str) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Return arrays and texts of the point or field data, by name."""
    arrays, texts = {}, {}
    for index in range(place.GetNumberOfArrays()):
        array = place.GetAbstractArray(index)
        name = str(array.GetName())
        if array.IsA("vtkStringArray"):
            texts[name] = str(array.GetValue(0)) if array.GetNumberOfValues() else ""
        else:
            arrays[prefix + name] = np.array(numpy_support().vtk_to_numpy(array))
    return arrays, texts
