"""Files of point clouds.

PLY and PCD are read and written here: Open3D's reader returns memory as it lies of a file that is cut, and dies of some
that mix types; its writer reports success on a full disk. LAS is read by laspy where it is there.

Text tables have columns that are identified by their names or, without names, by their number. They are not read by
pandas, which fills rows that are too short with NaN instead of refusing a file that is cut.

A packing is written as a cloud of points on its grains.
"""

import logging
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, as_length, check_type
from voxgran._base.calls import explained
from voxgran._base.errors import FileFormatError, InputError, MissingLibraryError
from voxgran._base.files import as_path, existing_file, unpacked, written_whole
from voxgran._base.guarded import Content, read_guarded, reason_of
from voxgran._base.lazy import load
from voxgran.geometry.rotation import rotation_matrices
from voxgran.io.pcd_format import pcd_bytes, pcd_columns
from voxgran.packing.model import Packing
from voxgran.points.cloud import Cloud
from voxgran.points.sample import sample_surface
from voxgran.shapes.formats.columns import cells_in, table_text
from voxgran.shapes.formats.mesh_formats import ply_columns, ply_elements

Columns: TypeAlias = tuple[Any, Any, Any]

#: largest number of a grain in files
LARGEST = 2**31 - 1

log = logging.getLogger(__name__)


@explained(hint='load_cloud("rock.ply", unit="mm")')
def load_cloud(path: str | os.PathLike[str], *, unit: str | None = None) -> Cloud:
    """Read a point cloud.

    Parameters
    ----------
    path : path-like
        File in PLY, PCD (not compressed; points that are NaN, rays that met nothing, are left out) or LAS format, or a
        table of text: rows of x y z, with spaces, commas or semicolons between; more columns are taken by their names
        in a first row (nx, ny, nz, grain), without names only a normal of length 1 and a whole number of the grain. It
        may be packed, with ``.gz`` behind its suffix.
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

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> vg.save_cloud(vg.Cloud.of(np.eye(3)), "scan.ply")
    >>> cloud = vg.load_cloud("scan.ply", unit="mm")
    >>> len(cloud), cloud.name, cloud.unit
    (3, 'scan', 'mm')
    """
    found = existing_file(path)
    name = found.with_suffix("") if found.suffix.lower() == ".gz" else found
    suffix = name.suffix.lower()
    if suffix not in READERS:
        raise FileFormatError(f"{found} ends in {suffix!r}: known are {', '.join(READERS)}; convert it")
    with unpacked(found) as plain:
        columns = READERS[suffix](plain)
    if not len(columns[0]):
        raise FileFormatError(f"{found} holds no points: it is empty, cut or damaged; write it again")
    try:
        return Cloud.of(*columns, name=name.stem, unit=unit)
    except InputError as error:
        raise FileFormatError(f"{found}: {reason_of(error, most=300)}") from error


@explained(hint='save_cloud(cloud, "rock.ply")')
def save_cloud(
    cloud: Cloud | Packing, path: str | os.PathLike[str], *, spacing: float | None = None, overwrite: bool = False
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
        Of the points on grains, in the unit of lengths; default: a tenth of the median diameter. For packings only.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    InputError
        If the suffix is not known, there are no points, a grain has a number beyond 2^31 - 1, a spacing is given for a
        cloud, or is not above 0.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((3, 3, 3)), "rsa", count=3)
    >>> vg.save_cloud(bed, "grains.ply", spacing=0.2)
    >>> sorted(set(vg.load_cloud("grains.ply").grain.tolist()))
    [0, 1, 2]
    """
    target = as_path(path)
    suffix = target.suffix.lower()
    if suffix not in (".ply", ".pcd", ".xyz"):
        raise InputError(f"{target} ends in {suffix!r}: clouds are written as .ply, .pcd or .xyz; choose one of these")
    check_type(cloud, (Cloud, Packing), "cloud", "a Cloud or a Packing; Cloud.of and load_cloud make one")
    if isinstance(cloud, Packing):
        made = cloud_of_packing(cloud, spacing)
    elif spacing is not None:
        raise InputError(f"spacing is {spacing:g} and a cloud is given: it is for packings; thin the cloud instead")
    else:
        made = cloud
    if not len(made):
        raise InputError(f"{made.name} has no points: there is nothing to write to {target}; check what was cut away")
    if made.grain is not None and np.abs(made.grain).max() > LARGEST:
        raise InputError(f"grain is {int(np.abs(made.grain).max())}: files hold numbers up to {LARGEST}; number anew")
    with written_whole(target, overwrite=overwrite) as draft:
        {".xyz": _write_text, ".ply": _write_ply, ".pcd": _write_pcd}[suffix](made, draft)


def _read_ply(path: Path) -> Columns:
    """Return the vertices of a PLY file."""
    found = ply_elements(path.read_bytes(), str(path))
    has = found.get("vertex", {})
    normals = ply_columns(found, ("nx", "ny", "nz"), str(path)) if "nx" in has else None
    grain = ply_columns(found, ("grain",), str(path)).ravel() if "grain" in has else None
    return ply_columns(found, "xyz", str(path)), normals, grain


def _read_pcd(path: Path) -> Columns:
    """Return the points of a PCD file; scanners write NaN where a ray met nothing."""
    columns = pcd_columns(path.read_bytes(), str(path))
    points = np.column_stack([columns[axis] for axis in "xyz"])
    met = ~np.isnan(points).any(axis=1, keepdims=True).ravel()
    if not met.all():
        lost, many = int(np.count_nonzero(~met)), len(points)
        log.warning("%s: %d of %d points are NaN, rays that met nothing; they are left out", path, lost, many)
        points, columns = points[met], {name: column[met] for name, column in columns.items()}
    normals = None
    if {"normal_x", "normal_y", "normal_z"} <= columns.keys():
        normals = np.column_stack([columns[f"normal_{axis}"] for axis in "xyz"])
    return points, normals, columns.get("grain")


def _write_text(cloud: Cloud, path: Path) -> None:
    """Write rows of coordinates, with normal and grain where there are any; all digits are kept."""
    columns, formats = [cloud.points], ["%.17g"] * 3
    if cloud.normals is not None:
        columns, formats = [*columns, cloud.normals], [*formats, *["%.17g"] * 3]
    if cloud.grain is not None:
        columns, formats = [*columns, cloud.grain[:, None].astype(np.float64)], [*formats, "%d"]
    np.savetxt(path, np.hstack(columns), fmt=formats)


def _records(cloud: Cloud, normals: Sequence[str]) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """Return points as records of x, y, z, normals under these names and grain, where there are any."""
    columns: dict[str, Any] = dict(zip("xyz", cloud.points.T, strict=True))
    if cloud.normals is not None:
        columns |= dict(zip(normals, cloud.normals.T, strict=True))
    if cloud.grain is not None:
        columns["grain"] = cloud.grain
    row = np.dtype([(name, "<i4" if name == "grain" else "<f8") for name in columns])
    records = np.zeros(len(cloud), dtype=row)
    for name, column in columns.items():
        records[name] = column
    return records


def _write_ply(cloud: Cloud, path: Path) -> None:
    """Write binary PLY in double precision."""
    records = _records(cloud, ("nx", "ny", "nz"))
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(cloud)}"]
    head += [f"property {'int' if name == 'grain' else 'double'} {name}" for name in records.dtype.names or ()]
    path.write_bytes("\n".join([*head, "end_header\n"]).encode("ascii") + records.tobytes())


def _write_pcd(cloud: Cloud, path: Path) -> None:
    """Write binary PCD in double precision."""
    path.write_bytes(pcd_bytes(_records(cloud, ("normal_x", "normal_y", "normal_z"))))


def _read_laser(path: Path) -> Columns:
    """Return the points of a LAS file."""
    _, found = read_guarded(laser_points, path)
    return found["points"], None, None


def laser_points(path: Path) -> Content:
    """Return the points (n, 3) of a LAS file; it has no facts. To be run by `read_guarded`.

    Raises
    ------
    MissingLibraryError
        If laspy is not installed.
    """
    try:
        reader = load("laspy")
    except MissingLibraryError as error:
        raise MissingLibraryError(f"{path} needs laspy to be read: install it with 'pip install laspy'") from error
    found = reader.read(str(path))
    return {}, {"points": np.column_stack([found.x, found.y, found.z]).astype(np.float64)}


#: largest difference from 1 of the length of a normal in columns without names
UNIT = 1e-3
#: names of the columns
PLACE, NORMAL, GRAIN = ("x", "y", "z"), ("nx", "ny", "nz"), ("grain", "label")


def read_point_table(path: Path) -> tuple[Any, Any, Any]:
    """Return points, and normals and grains where there are any, of rows of numbers with spaces, commas or semicolons
    between, and names of the columns in a first row if it has one.

    Raises
    ------
    FileFormatError
        If it is no such table, or says too little about its columns.
    """
    lines = [line.strip() for line in table_text(path).splitlines()]
    rows = [cells_in(line) for line in lines if line and not line.startswith(("#", "//"))]
    if not rows:
        return np.zeros((0, 3)), None, None
    names = [cell.lower() for cell in rows[0]]
    if set(PLACE) <= set(names):
        return _by_name(_numbers(rows[1:], len(names), path), names)
    return _by_place(_numbers(rows, len(names), path), path)


def _numbers(rows: list[list[str]], width: int, path: Path) -> Floats:
    """Return rows as numbers."""
    table = []
    for k, row in enumerate(rows):
        try:
            table.append([float(cell) for cell in row])
            if len(row) != width:
                raise ValueError
        except ValueError:
            raise FileFormatError(
                f"{path} is no table of numbers: row {k + 1} is {' | '.join(row)[:60]!r}, and {width} numbers are "
                "needed; mend it, or name the columns x, y, z in the first row"
            ) from None
    return np.array(table, dtype=np.float64).reshape(len(rows), width)


def _by_name(table: Floats, names: list[str]) -> tuple[Any, Any, Any]:
    """Return the columns that have names."""
    points = table[:, [names.index(name) for name in PLACE]]
    normals = table[:, [names.index(name) for name in NORMAL]] if set(NORMAL) <= set(names) else None
    label = next((name for name in GRAIN if name in names), None)
    return points, normals, None if label is None else table[:, names.index(label)]


def _by_place(table: Floats, path: Path) -> tuple[Any, Any, Any]:
    """Return the columns of a table without names, where their numbers leave no doubt."""
    width = table.shape[1]
    normals = table[:, 3:6] if width in (6, 7) else None
    grain = table[:, -1] if width in (4, 7) else None
    doubt = width not in (3, 4, 6, 7)
    doubt |= normals is not None and bool((np.abs(linear.norm(normals, axis=1) - 1.0) > UNIT).any())
    doubt |= grain is not None and bool((grain != np.rint(grain)).any())
    if doubt:
        raise FileFormatError(
            f"{path} has {width} columns without names: after x y z only a normal of length 1 and the whole number of "
            "a grain are known; name the columns in a first row, such as x,y,z,intensity"
        )
    return table[:, :3], normals, grain


def cloud_of_packing(packing: Packing, spacing: float | None = None) -> Cloud:
    """Return points on the surfaces of all grains in the frame of the container, each with the number of its grain.

    `spacing` is the largest one, in the unit of lengths; default: a tenth of the median diameter. A shape is sampled
    once, for its largest grain, so smaller grains are covered more finely.

    Raises
    ------
    InputError
        If `spacing` is not above 0.
    """
    sizes = np.array([packing.shapes[k].diameter for k in packing.shape_id.tolist()]) * packing.scale
    wanted = 0.1 * float(np.median(sizes)) if spacing is None and len(sizes) else spacing
    edge = as_length(1.0 if wanted is None else wanted, "spacing")
    matrices, points, grains = rotation_matrices(packing.orientation), [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    for k, shape in enumerate(packing.shapes):
        mine = np.flatnonzero(packing.shape_id == k)
        if not len(mine):
            continue
        body = np.asarray(sample_surface(shape, spacing=edge / float(packing.scale[mine].max()), seed=k))
        placed = linear.einsum("gij,pj->gpi", matrices[mine], body) * packing.scale[mine, None, None]
        points.append((placed + packing.position[mine, None]).reshape(-1, 3))
        grains.append(np.repeat(mine, len(body)))
    order = np.argsort(np.concatenate(grains), kind="stable")
    return Cloud.of(
        np.concatenate(points)[order], grain=np.concatenate(grains)[order], name="packing", unit=packing.unit
    )


#: function that returns points, normals and grains of a file, by suffix
READERS: dict[str, Callable[[Path], Columns]] = {
    ".ply": _read_ply,
    ".pcd": _read_pcd,
    **dict.fromkeys((".xyz", ".xyzn", ".txt", ".csv"), read_point_table),
    **dict.fromkeys((".las", ".laz"), _read_laser),
}
