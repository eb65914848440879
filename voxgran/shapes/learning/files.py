"""Distributions of shapes as netCDF4 files: the meshes of the sample one after the other, weights and numbers."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError, OutputError, shown
from voxgran._base.files import PROBE, existing_file, output_suffix, written_whole
from voxgran._base.guarded import Content, netcdf_file, read_guarded
from voxgran._base.lazy import load
from voxgran.shapes.mesh import Mesh, refuse_degenerate
from voxgran.shapes.model import Shape

#: arrays of a file with their dimensions
ARRAYS = {
    "vertices": ("vertex", "axis"),
    "faces": ("face", "corner"),
    "vertex_count": ("grain",),
    "face_count": ("grain",),
    "weights": ("grain",),
    "donors": ("grain",),
}
#: arrays that say how often each grain counts
WEIGHTS = ("weights", "donors")
#: content of a file, which says that it is one of these
KIND = "voxgran shape model 1"
#: how grains are made
METHODS = ("warp", "bend")


def write_model(
    path: str | os.PathLike[str],
    shapes: Sequence[Shape],
    weights: Mapping[str, Floats],
    facts: Mapping[str, Any],
    *,
    overwrite: bool,
) -> None:
    """Write meshes, weights and numbers.

    Raises
    ------
    FileFormatError
        If the suffix is not ``.nc``.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.
    """
    output_suffix(path, [".nc"], "distributions of shapes are kept", overwrite=overwrite)
    load("netCDF4")
    arrays = {
        "vertices": np.concatenate([shape.vertices for shape in shapes]),
        "faces": np.concatenate([shape.faces for shape in shapes]).astype(np.int32),
        "vertex_count": np.array([len(shape.vertices) for shape in shapes]),
        "face_count": np.array([len(shape.faces) for shape in shapes]),
        **weights,
    }
    table = load("xarray").Dataset({name: (ARRAYS[name], array) for name, array in arrays.items()})
    table.attrs = {"kind": KIND, "unit": shapes[0].unit or "1", **facts}
    packed = {name: {"zlib": True, "complevel": 4} for name in ("vertices", "faces")}
    with written_whole(path, overwrite=overwrite) as draft:
        try:
            # netCDF takes any error of a new file for a lack of permission
            draft.write_bytes(bytes(PROBE))
            table.to_netcdf(draft, engine="netcdf4", encoding=packed)
        # a name that is not UTF-8 is refused by the library
        except (RuntimeError, UnicodeEncodeError) as error:
            raise OutputError(f"{path} cannot be written ({error}): free space or choose another place") from error


def read_model(path: str | os.PathLike[str]) -> tuple[tuple[Shape, ...], dict[str, Any]]:
    """Return the meshes of a file, and its weights and numbers.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is damaged, or holds something else.
    DirtyMeshError
        If it holds a grain without volume.
    """
    found = existing_file(path)
    output_suffix(found, [".nc"], "distributions of shapes are kept")
    facts, arrays = read_guarded(model_values, found)
    unit = facts.pop("unit")
    meshes: list[Shape] = []
    vertex, face = 0, 0
    for points, corners in zip(arrays["vertex_count"], arrays["face_count"], strict=True):
        triangles = arrays["faces"][face : face + corners].astype(np.int64)
        mesh = Mesh(arrays["vertices"][vertex : vertex + points], triangles)
        refuse_degenerate(mesh, f"grain {len(meshes)} of {found}")
        meshes.append(Shape(mesh, "grain", unit=None if unit == "1" else unit))
        vertex, face = vertex + points, face + corners
    return tuple(meshes), facts | {name: arrays[name] for name in WEIGHTS}


def model_values(path: Path) -> Content:
    """Read the checked numbers and arrays of a file, to be run by `read_guarded`.

    Raises
    ------
    FileFormatError
        If it holds something else, or its arrays do not fit each other.
    """
    with netcdf_file(path) as file:
        if getattr(file, "kind", "") != KIND or not set(ARRAYS) <= set(file.variables):
            raise FileFormatError(f"{path} holds no distribution of shapes: give a file that ShapeModel.save wrote")
        strength = float(file.strength)
        facts = {"unit": str(file.unit), "method": str(file.method), "strength": strength}
        arrays = {name: np.ma.getdata(file[name][...]) for name in ARRAYS}
    if facts["method"] not in METHODS:
        raise FileFormatError(
            f"{path} makes grains by {shown(facts['method'])}: known are {', '.join(METHODS)}; learn it again"
        )
    points, corners = arrays["vertex_count"], arrays["face_count"]
    sound = all(array.ndim == len(ARRAYS[name]) and array.dtype.kind in "iuf" for name, array in arrays.items())
    whole = sound and all(arrays[name].dtype.kind in "iu" for name in ("faces", "vertex_count", "face_count"))
    if not whole or arrays["vertices"].shape[1] != 3 or arrays["faces"].shape[1] != 3:
        raise FileFormatError(f"{path} holds arrays of other types or shapes: it is damaged; write it again")
    inner = np.repeat(points, corners) if (points > 0).all() and (corners > 0).all() else np.zeros(0)
    right = (
        len(points) == len(corners) == len(arrays["weights"]) == len(arrays["donors"])
        and len(points) > 0
        and points.sum() == len(arrays["vertices"])
        and corners.sum() == len(arrays["faces"]) == len(inner)
        and np.isfinite(arrays["vertices"]).all()
        and (arrays["faces"] >= 0).all()
        and (arrays["faces"] < inner[:, None]).all()
        and all(np.isfinite(arrays[name]).all() and (arrays[name] > 0).all() for name in WEIGHTS)
        and 0 <= strength <= 1
    )
    if not right:
        raise FileFormatError(f"{path} holds grains that do not fit their numbers: it is damaged; write it again")
    return facts, arrays
