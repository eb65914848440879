"""Readers of the mesh formats STL, OBJ, OFF and PLY, from bytes to corner points and polygons; and of Gmsh files.

The four are implemented here instead of using meshio or VTK, because these read coordinates as float32, do not support
mixed polygons or additional properties, or silently return a part of a truncated file.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import FileFormatError
from voxgran._base.guarded import Content, reason_of
from voxgran._base.lazy import load

#: vertices (n, 3), and the vertex indices of each polygon
Polygons = tuple[Floats, list[list[int]] | Integers]

PLY_NAMES = {
    "i1": "char int8",
    "u1": "uchar uint8",
    "i2": "short int16",
    "u2": "ushort uint16",
    "i4": "int int32",
    "u4": "uint uint32",
    "f4": "float float32",
    "f8": "double float64",
    "i8": "int64",
    "u8": "uint64",
}
PLY_TYPES = {name: code for code, names in PLY_NAMES.items() for name in names.split()}
PLY_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read_stl(raw: bytes, name: str) -> Polygons:
    """Return the triangles of an STL file, binary or text.

    Raises
    ------
    FileFormatError
        If the file is truncated or not an STL file.
    """
    count = int.from_bytes(raw[80:84], "little")
    exact = len(raw) >= 84 and len(raw) == 84 + 50 * count
    if not exact and raw.lstrip()[:5].lower() == b"solid" and re.search(b"facet|endsolid", raw, re.IGNORECASE):
        return _read_text_stl(raw, name)
    if len(raw) < 84 + 50 * count or len(raw) < 84:
        raise FileFormatError(
            f"{name} holds {max(len(raw) - 84, 0) // 50} of the {count} triangles that its header counts: it is cut "
            "or no STL file; write it again"
        )
    records = np.frombuffer(raw, dtype=[("numbers", "<f4", 12), ("", "<u2")], count=count, offset=84)
    # the cast of a signalling NaN causes a warning
    with np.errstate(invalid="ignore"):
        points = records["numbers"][:, 3:].astype(np.float64).reshape(-1, 3)
    return points, np.arange(len(points)).reshape(-1, 3)


def _read_text_stl(raw: bytes, name: str) -> Polygons:
    """Return the triangles of a text STL file."""
    words = raw.decode("ascii", errors="replace").lower().split()
    marks = [k for k, word in enumerate(words) if word == "vertex"]
    ends = words.count("endfacet"), words.count("endsolid")
    try:
        points = np.array([[float(word) for word in words[k + 1 : k + 4]] for k in marks])
    except ValueError as error:
        raise FileFormatError(f"{name} is no STL file ({reason_of(error)}): write it again") from None
    if len(marks) != 3 * ends[0] or not ends[1] or (len(marks) and points.shape != (len(marks), 3)):
        raise FileFormatError(
            f"{name} holds {len(marks)} vertices for {ends[0]} complete triangles: it is cut; write it again"
        )
    points = points.reshape(-1, 3)
    return points, np.arange(len(points)).reshape(-1, 3)


def read_obj(raw: bytes, name: str) -> Polygons:
    """Return the polygons of an OBJ file; colors, normals, textures, lines and groups are ignored.

    Raises
    ------
    FileFormatError
        If a line cannot be read or a polygon refers to a missing vertex.
    """
    points: list[tuple[float, float, float]] = []
    polygons: list[list[int]] = []
    text = raw.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        try:
            if words[:1] == ["v"]:
                points.append((float(words[1]), float(words[2]), float(words[3])))
            elif words[:1] == ["f"]:
                places = [int(word.partition("/")[0]) for word in words[1:]]
                polygons.append([k - 1 if k > 0 else _from_end(k, len(points)) for k in places])
        except (ValueError, IndexError):
            raise FileFormatError(
                f"{name} has {line.strip()[:40]!r} in line {number}: that is no vertex or face of an OBJ file; "
                "it is cut or damaged, write it again"
            ) from None
    return np.array(points, dtype=np.float64).reshape(-1, 3), polygons


def _from_end(place: int, count: int) -> int:
    """Convert a relative OBJ index (-1 is the last vertex) to an absolute one (0 is the first)."""
    if place == 0 or -place > count:
        raise IndexError
    return count + place


def read_off(raw: bytes, name: str) -> Polygons:
    """Return the polygons of an OFF file.

    Raises
    ------
    FileFormatError
        If the file is truncated or not an OFF file.
    """
    lines = (line.partition("#")[0].split() for line in raw.decode("utf-8", errors="replace").splitlines())
    rows = [words for words in lines if words]
    if not rows or not rows[0][0].upper().endswith("OFF"):
        raise FileFormatError(f"{name} does not begin with OFF: it is no OFF file; check its format")
    head, rows = (rows[0][1:], rows[1:]) if len(rows[0]) > 1 else (rows[1] if len(rows) > 1 else [], rows[2:])
    try:
        vertex_count, face_count = _count(head[0]), _count(head[1])
        body = rows[:vertex_count], rows[vertex_count : vertex_count + face_count]
        points = np.array([[float(w) for w in row[:3]] for row in body[0]]).reshape(-1, 3)
        polygons = [[int(w) for w in row[1 : 1 + int(row[0])]] for row in body[1]]
        whole = all(len(p) == int(row[0]) for p, row in zip(polygons, body[1], strict=True))
    except (ValueError, IndexError) as error:
        raise FileFormatError(f"{name} cannot be read as OFF ({reason_of(error)}): write it again") from None
    if len(points) < vertex_count or len(polygons) < face_count or not whole:
        raise FileFormatError(
            f"{name} holds {len(points)} of {vertex_count} vertices and {len(polygons)} of {face_count} faces: it is "
            "cut; write it again"
        )
    return points, polygons


def _count(word: str) -> int:
    """Return a count; negative numbers are invalid."""
    if (count := int(word)) < 0:
        raise ValueError(f"it counts {count} of something")
    return count


@dataclass(slots=True)
class _Element:
    """Element of a PLY file: names and types of its properties; a list has two types."""

    name: str
    count: int
    properties: list[tuple[str, tuple[str, ...]]] = field(default_factory=list)


def read_ply(raw: bytes, name: str) -> Polygons:
    """Return the polygons of a PLY file, text or binary.

    Raises
    ------
    FileFormatError
        If the file is truncated or not a PLY file.
    """
    found = ply_elements(raw, name)
    face = found.get("face", {})
    lists = next((face[key] for key in ("vertex_indices", "vertex_index") if key in face), [])
    if lists and not isinstance(lists[0], list):
        raise FileFormatError(f"{name} gives one corner for each face: a list is needed; write it again")
    return ply_columns(found, "xyz", name), lists


def ply_elements(raw: bytes, name: str) -> dict[str, dict[str, list[Any]]]:
    """Return the columns of each element of a PLY file, text or binary.

    Raises
    ------
    FileFormatError
        If the file is truncated or not a PLY file.
    """
    try:
        order, elements, body = _ply_header(raw)
        walk = _ply_binary(body, elements, order) if order else _ply_text(body, elements)
        return {element.name: columns for element, columns in zip(elements, walk, strict=True)}
    except (ValueError, KeyError, IndexError, TypeError, OverflowError) as error:
        raise FileFormatError(
            f"{name} cannot be read as PLY ({reason_of(error)}): it is cut or damaged; write it again"
        ) from None


def ply_columns(found: dict[str, dict[str, list[Any]]], keys: Sequence[str], name: str) -> Floats:
    """Return some properties of the vertices of a PLY file as columns.

    Raises
    ------
    FileFormatError
        If there are no vertices, or they lack one of the properties.
    """
    try:
        return np.column_stack([np.asarray(found["vertex"][key], dtype=np.float64) for key in keys])
    except (ValueError, KeyError, TypeError, OverflowError) as error:
        raise FileFormatError(
            f"{name} cannot be read as PLY ({reason_of(error)}): it is cut or damaged; write it again"
        ) from None


def _ply_header(raw: bytes) -> tuple[str, list[_Element], bytes]:
    """Return byte order ("" for text), elements, and the data after the header."""
    head, mark, body = raw.partition(b"end_header")
    lines = head.decode("ascii", errors="replace").splitlines()
    if not mark or not lines or lines[0].strip() != "ply":
        raise ValueError("its header is not whole")
    order, elements = None, []
    for words in (line.split() for line in lines[1:]):
        if words[:1] == ["format"]:
            order = PLY_FORMATS[words[1]]
        elif words[:1] == ["element"]:
            elements.append(_Element(words[1], int(words[2])))
        elif words[:2] == ["property", "list"]:
            elements[-1].properties.append((words[4], (PLY_TYPES[words[2]], PLY_TYPES[words[3]])))
        elif words[:1] == ["property"]:
            elements[-1].properties.append((words[2], (PLY_TYPES[words[1]],)))
    if order is None:
        raise ValueError("its header names no format")
    for element in elements:
        if element.count < 0 or (element.count and not element.properties):
            many = len(element.properties)
            raise ValueError(f"its header counts {element.count} {element.name[:40]} of {many} properties")
    return order, elements, body[2:] if body.startswith(b"\r\n") else body[1:]


def _ply_text(body: bytes, elements: list[_Element]) -> Iterator[dict[str, list[Any]]]:
    """Yield the columns of each element of a text file."""
    words = body.decode("ascii", errors="replace").split()
    place = 0
    for element in elements:
        columns: dict[str, list[Any]] = {key: [] for key, _ in element.properties}
        if len(words) - place < element.count * len(element.properties):
            raise ValueError(f"it ends within {element.name[:40]} records")
        for _ in range(element.count):
            for key, types in element.properties:
                if len(types) == 1:
                    columns[key].append(float(words[place]))
                    place += 1
                    continue
                length = int(words[place])
                items = words[place + 1 : place + 1 + length]
                if length != len(items):
                    raise ValueError(f"it holds {len(items)} of {length} items of a list")
                columns[key].append([int(float(item)) for item in items])
                place += 1 + length
        yield columns


def _ply_binary(body: bytes, elements: list[_Element], order: str) -> Iterator[dict[str, list[Any]]]:
    """Yield the columns of each element of a binary file."""
    place = 0
    for element in elements:
        columns: dict[str, list[Any]] = {key: [] for key, _ in element.properties}
        if all(len(types) == 1 for _, types in element.properties):
            row = np.dtype([(key, order + types[0]) for key, types in element.properties])
            if len(body) - place < row.itemsize * element.count:
                raise ValueError(f"it ends within {element.name[:40]} records")
            records = np.frombuffer(body, dtype=row, count=element.count, offset=place)
            place += row.itemsize * element.count
            yield {key: records[key].tolist() for key in columns}
            continue
        if len(body) - place < element.count * sum(np.dtype(types[0]).itemsize for _, types in element.properties):
            raise ValueError(f"it ends within {element.name[:40]} records")
        for _ in range(element.count):
            for key, types in element.properties:
                length = 1
                if len(types) == 2:
                    length = int(np.frombuffer(body, order + types[0], 1, place)[0])
                    place += np.dtype(types[0]).itemsize
                    if length < 0:
                        raise ValueError(f"it has a list of {length} items")
                items = np.frombuffer(body, order + types[-1], length, place).tolist() if length else []
                place += np.dtype(types[-1]).itemsize * length
                columns[key].append(items[0] if len(types) == 1 else items)
        yield columns


def gmsh_polygons(path: Path) -> Content:
    """Read the triangles and quadrangles of a Gmsh file, to be run by `read_guarded`.

    The arrays are ``points`` (n, 3), the ``corners`` of all polygons one after the other, and their ``counts``.
    """
    mesh = load("meshio").gmsh.read(str(path))
    cells = [np.asarray(block.data) for block in mesh.cells if block.type in ("triangle", "quad")]
    corners = [np.zeros(0, np.int64), *(block.ravel() for block in cells)]
    counts = [np.zeros(0, np.int64), *(np.full(len(block), block.shape[1]) for block in cells)]
    return {}, {
        "points": np.asarray(mesh.points, dtype=np.float64).reshape(-1, 3),
        "corners": np.concatenate(corners).astype(np.int64),
        "counts": np.concatenate(counts),
    }
