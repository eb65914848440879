"""Points and triangles of mesh files, read and written.

STL, OBJ, OFF and PLY are read by :mod:`voxgran.shapes.formats.mesh_formats`, VTK files by VTK and Gmsh files by meshio,
in a process of its own.
"""

import os
import struct
from codecs import BOM_UTF8
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers, check_coordinates
from voxgran._base.errors import FileFormatError, InputError
from voxgran._base.files import existing_file
from voxgran._base.guarded import Content, read_guarded
from voxgran._base.lazy import load
from voxgran._base.vtk_data import poly_data, write_data
from voxgran._base.vtk_readers import vtk_triangles
from voxgran.shapes.formats.mesh_formats import Polygons, gmsh_polygons, read_obj, read_off, read_ply, read_stl
from voxgran.shapes.images.image_files import READERS as IMAGES

#: largest number of corners of a polygon that is clipped: the time grows with its square and the recursion is deep
MOST_CORNERS = 5000


def read_surface(path: str | os.PathLike[str]) -> tuple[Floats, Integers]:
    """Return points (n, 3) and triangles (m, 3) of a surface file in one of the formats of `READERS`, closed or not.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is not known, or the file is empty, truncated or damaged.
    """
    found = existing_file(path)
    reader = READERS.get(found.suffix.lower())
    if reader is None:
        image = found.suffix.lower() in IMAGES
        remedy = (
            "it is that of an image, of which load_labels makes shapes, or 'voxgran labels' at the prompt; use that"
            if image
            else f"known are {', '.join(sorted(READERS))}; convert it"
        )
        raise FileFormatError(f"{found} has the suffix {found.suffix!r}: {remedy}")
    if found.stat().st_size == 0:
        raise FileFormatError(f"{found} is empty: it must hold a closed surface; write it again")
    points, corners, counts = reader(found)
    faces = _triangles(points, corners, counts, found)
    _refuse_damaged(points, faces, found)
    return points, faces


def _refuse_damaged(points: Floats, faces: Integers, path: Path) -> None:
    """Refuse what is no mesh at all."""
    if not len(faces):
        raise FileFormatError(f"{path} holds no faces: it must hold a closed surface; write it again")
    if faces.min() < 0 or faces.max() >= len(points):
        worst = int(faces.max() if faces.min() >= 0 else faces.min())
        raise FileFormatError(
            f"{path} has a face with vertex {worst} of {len(points)} (counted from 0): it is cut or damaged; "
            "write it again"
        )
    bad = int((~np.isfinite(points)).sum())
    if bad:
        raise FileFormatError(
            f"{path} has {bad} coordinates that are not finite: every one must be a number; mend the file"
        )
    try:
        check_coordinates(points, "coordinate")
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error


def _triangles(points: Floats, corners: Integers, counts: Integers, path: Path) -> Integers:
    """Cut polygons into triangles: fans where they are convex, else by clipping ears."""
    if len(counts) and counts.min() < 3:
        raise FileFormatError(f"{path} has a face of {counts.min()} corners: each needs 3 or more; mend it")
    first, parts, places = np.cumsum(counts) - counts, [], []
    for count in np.unique(counts):
        chosen = np.flatnonzero(counts == count)
        rings = corners[first[chosen][:, None] + np.arange(count)]
        if count > 3:
            _refuse_damaged(points, rings, path)
        fans = np.stack([rings[:, [0, k, k + 1]] for k in range(1, count - 1)], axis=1)
        bent = np.flatnonzero(~_convex(points[rings])) if count > 3 else np.zeros(0, dtype=np.int64)
        if len(bent) and count > MOST_CORNERS:
            raise FileFormatError(
                f"{path} has a face of {count} corners that is not convex: at most {MOST_CORNERS} can be cut into "
                "triangles; triangulate it first"
            )
        for k in bent:
            fans[k] = rings[k][_clipped(points[rings[k]])]
        parts.append(fans.reshape(-1, 3))
        places.append(np.repeat(chosen, count - 2))
    if len(parts) < 2:
        return parts[0] if parts else np.zeros((0, 3), dtype=np.int64)
    faces: Integers = np.concatenate(parts)[np.argsort(np.concatenate(places), kind="stable")]
    return faces


def _normals(rings: Floats) -> Floats:
    """Return the mean normals of (n, k, 3) polygons (Newell's method)."""
    local = rings - rings[:, :1]
    normals: Floats = np.cross(local, np.roll(local, -1, axis=1)).sum(axis=1)
    return normals


def _convex(rings: Floats) -> Any:
    """Tell which of (n, k, 3) polygons are convex seen along their mean normal."""
    ahead = np.roll(rings, -1, axis=1) - rings
    turns = np.cross(np.roll(ahead, 1, axis=1), ahead)
    return (linear.einsum("nki,ni->nk", turns, _normals(rings)) >= 0).all(axis=1)


def _clipped(ring: Floats) -> Integers:
    """Return the triangles of one polygon that is not convex, as (k - 2, 3) places in it."""
    normal = _normals(ring[None])[0]
    keep = [axis for axis in range(3) if axis != int(np.abs(normal).argmax())]
    flat = np.ascontiguousarray(ring[:, keep])
    # leaving out y turns the plane over
    mirrored = (normal[np.abs(normal).argmax()] < 0) != (keep == [0, 2])
    if mirrored:
        flat = flat * np.array([1.0, -1.0])
    triangles: Integers = np.array(load("manifold3d").triangulate([flat]), dtype=np.int64)
    return triangles


def _from_bytes(parse: Callable[[bytes, str], Polygons]) -> Callable[[Path], Polygons]:
    """Return the reader of a file that is parsed as a whole."""
    return lambda path: parse(path.read_bytes().removeprefix(BOM_UTF8), str(path))


def _guarded(read: Callable[[Path], Content]) -> Callable[[Path], Polygons]:
    """Return the reader of a file that a library parses, in a process of its own."""

    def reader(path: Path) -> Polygons:
        _, found = read_guarded(read, path)
        return found["points"], found["corners"], found["counts"]

    return reader


def _write_stl(vertices: Floats, faces: Integers, path: Path) -> None:
    """Write binary STL."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = linear.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("", "<u2")])
    records["normal"] = normals / np.where(length > 0, length, 1.0)
    records["corners"] = corners
    head = b"binary STL written by voxgran".ljust(80)
    path.write_bytes(head + struct.pack("<I", len(faces)) + records.tobytes())


def _write_obj(vertices: Floats, faces: Integers, path: Path) -> None:
    """Write OBJ with all digits."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _write_off(vertices: Floats, faces: Integers, path: Path) -> None:
    """Write OFF with all digits."""
    lines = ["OFF", f"{len(vertices)} {len(faces)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    lines += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    path.write_text("\n".join(lines) + "\n", encoding="ascii")


def _write_ply(vertices: Floats, faces: Integers, path: Path) -> None:
    """Write binary PLY in double precision."""
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    records = np.zeros(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    records["count"], records["corners"] = 3, faces
    text = ("\n".join(head) + "\n").encode("ascii")
    path.write_bytes(text + vertices.astype("<f8").tobytes() + records.tobytes())


READERS: dict[str, Callable[[Path], Polygons]] = {
    ".stl": _from_bytes(read_stl),
    ".obj": _from_bytes(read_obj),
    ".off": _from_bytes(read_off),
    ".ply": _from_bytes(read_ply),
    ".msh": _guarded(gmsh_polygons),
    ".vtk": _guarded(vtk_triangles),
    ".vtp": _guarded(vtk_triangles),
    ".vtu": _guarded(vtk_triangles),
}
WRITERS: dict[str, Callable[[Floats, Integers, Path], None]] = {
    ".stl": _write_stl,
    ".obj": _write_obj,
    ".off": _write_off,
    ".ply": _write_ply,
    ".vtp": lambda vertices, faces, path: write_data("vtkXMLPolyDataWriter", poly_data(vertices, "Polys", faces), path),
}
