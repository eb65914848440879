"""Files of point clouds: PLY and PCD by Open3D, tables of text by NumPy, LAS by laspy where it is there."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.errors import FileFormatError, InputError, MissingLibraryError
from voxgran._base.files import existing_file, written_whole
from voxgran._base.lazy import load
from voxgran.io.cloud_of_packing import cloud_of_packing
from voxgran.packing.model import Packing
from voxgran.points.cloud import Cloud

BINARY, TEXT, LASER = (".ply", ".pcd"), (".xyz", ".xyzn", ".txt", ".csv"), (".las", ".laz")


def load_cloud(path: str | os.PathLike[str], *, unit: str | None = None) -> Cloud:
    """Read a point cloud.

    Parameters
    ----------
    path : path-like
        File in PLY, PCD, XYZ (rows of x y z, or of x y z and a normal; spaces or commas), or LAS format, by its suffix.
    unit : str, optional
        Unit of its lengths; it is recorded and nothing is converted.

    Returns
    -------
    Cloud
        Named as the file without its suffix, with normals and grains where the file has them.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is not known, or the file is empty, cut, or damaged.
    MissingLibraryError
        If a LAS file is given and laspy is not installed.
    """
    found = existing_file(path)
    suffix = found.suffix.lower()
    if suffix in BINARY:
        columns = _read_open3d(found)
    elif suffix in TEXT:
        columns = _read_text(found)
    elif suffix in LASER:
        columns = _read_laser(found)
    else:
        raise FileFormatError(f"{found} ends in {suffix!r}: known are {', '.join(BINARY + TEXT + LASER)}; convert it")
    if not len(columns[0]):
        raise FileFormatError(f"{found} holds no points: it is empty, cut or damaged; write it again")
    try:
        return Cloud.of(*columns, name=found.stem, unit=unit)
    except InputError as error:
        raise FileFormatError(f"{found}: {error}") from error


def save_cloud(
    cloud: Cloud | Packing, path: str | os.PathLike[str], *, spacing: float | None = None, overwrite: bool = True
) -> None:
    """Write a point cloud; of a packing, points on all grains, each with the number of its grain.

    Parameters
    ----------
    cloud : Cloud or Packing
        What to write.
    path : path-like
        File in PLY or PCD format (with the property `grain`), or XYZ (rows of x y z, the normal if there is one, and
        the grain if there is one).
    spacing : float, optional
        Of the points on grains, in the unit of lengths; left out: a tenth of the median diameter. For packings only.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    InputError
        If the suffix is not known, a spacing is given for a cloud, or is not above 0.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in (*BINARY, ".xyz"):
        raise InputError(f"{target} ends in {suffix!r}: clouds are written as .ply, .pcd or .xyz; choose one of these")
    if isinstance(cloud, Packing):
        made = cloud_of_packing(cloud, spacing)
    elif spacing is not None:
        raise InputError(f"spacing is {spacing:g} and a cloud is given: it is for packings; thin the cloud instead")
    else:
        made = cloud
    with written_whole(target, overwrite=overwrite) as draft:
        if suffix == ".xyz":
            _write_text(made, draft)
        else:
            _write_open3d(made, draft)


def _read_open3d(path: Path) -> tuple[Any, Any, Any]:
    """Return points, normals and grains of a file, which keep all digits that it has."""
    open3d = load("open3d")
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        try:
            found = open3d.t.io.read_point_cloud(str(path))
        except RuntimeError as error:
            raise FileFormatError(f"{path} cannot be read as points ({_line(error)}): write it again") from error
    names = set(found.point)
    if "positions" not in names:
        return np.zeros((0, 3)), None, None
    normals = found.point["normals"].numpy() if "normals" in names else None
    grain = found.point["grain"].numpy().ravel() if "grain" in names else None
    return found.point["positions"].numpy().astype(np.float64), normals, grain


def _write_text(cloud: Cloud, path: Path) -> None:
    """Write rows of coordinates, with normal and grain where there are any; all digits are kept."""
    columns, formats = [cloud.points], ["%.17g"] * 3
    if cloud.normals is not None:
        columns, formats = [*columns, cloud.normals], [*formats, *["%.17g"] * 3]
    if cloud.grain is not None:
        columns, formats = [*columns, cloud.grain[:, None].astype(np.float64)], [*formats, "%d"]
    np.savetxt(path, np.hstack(columns), fmt=formats)


def _write_open3d(cloud: Cloud, path: Path) -> None:
    """Write points, normals and grains."""
    open3d = load("open3d")
    tensor = open3d.core.Tensor
    made = open3d.t.geometry.PointCloud(tensor(np.array(cloud.points)))
    if cloud.normals is not None:
        made.point["normals"] = tensor(np.array(cloud.normals))
    if cloud.grain is not None:
        made.point["grain"] = tensor(cloud.grain.astype(np.int32)[:, None])
    if not open3d.t.io.write_point_cloud(str(path), made):
        raise OSError(f"Open3D did not write {len(cloud)} points")


def _read_text(path: Path) -> tuple[Any, Any, Any]:
    """Return points, and normals where rows have six numbers or more; a last single column numbers the grains."""
    try:
        text = path.read_text(encoding="utf-8").replace(",", " ")
        rows = [
            line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith(("#", "//"))
        ]
        if rows and not _is_number(rows[0][0]):
            rows = rows[1:]
        table = np.array(rows, dtype=np.float64)
    except (UnicodeDecodeError, ValueError) as error:
        raise FileFormatError(f"{path} is no table of numbers ({_line(error)}): each row is x y z") from error
    if not len(rows):
        return np.zeros((0, 3)), None, None
    width = table.shape[1]
    if width not in (3, 4, 6, 7):
        raise FileFormatError(f"{path} has {width} columns: rows are x y z, a normal and a grain; cut the others off")
    return table[:, :3], table[:, 3:6] if width >= 6 else None, table[:, -1] if width in (4, 7) else None


def _is_number(text: str) -> bool:
    """Tell whether a text is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_laser(path: Path) -> tuple[Any, Any, Any]:
    """Return the points of a LAS file."""
    try:
        reader = load("laspy")
    except MissingLibraryError as error:
        raise MissingLibraryError(f"{path} needs laspy to be read: install it with 'pip install laspy'") from error
    try:
        found = reader.read(str(path))
    except Exception as error:  # laspy raises many kinds, its own and those of its parsers
        raise FileFormatError(f"{path} cannot be read as points ({_line(error)}): write it again") from error
    return np.column_stack([found.x, found.y, found.z]).astype(np.float64), None, None


def _line(error: BaseException) -> str:
    """Return the first line of what a library says."""
    return str(error).strip().split("\n", 1)[0][:200]
