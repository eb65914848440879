"""Readers of the mesh formats STL, OBJ, OFF and PLY, from bytes to corner points and polygons; and of Gmsh files.

The four are implemented here instead of using meshio or VTK, because these read coordinates as float32, do not support
mixed polygons or additional properties, or silently return a part of a truncated file.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from struct import Struct, calcsize
from struct import error as struct_error
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import FileFormatError
from voxgran._base.guarded import Content, reason_of
from voxgran._base.lazy import load
from voxgran.shapes.formats.number_text import line_at, numbers_of

#: vertices (n, 3), the vertex indices of all polygons one after the other, and the number of those of each
Polygons = tuple[Floats, Integers, Integers]
#: values of a property of each record; of a list those of all records one after the other, and how many each has
Column = NDArray[Any] | tuple[NDArray[Any], Integers]

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
    return _loose(points)


def _loose(points: Floats) -> Polygons:
    """Return triangles that have each its own three corners."""
    return points, np.arange(len(points)), np.full(len(points) // 3, 3)


def _read_text_stl(raw: bytes, name: str) -> Polygons:
    """Return the triangles of a text STL file."""
    text = raw.lower()
    ends = text.count(b"endfacet"), text.count(b"endsolid")
    try:
        numbers, first, _ = numbers_of(text, b"vertex", most=3)
        if len(first) <= 3 * ends[0]:
            # several corners stand in one line; the names of solids lie before and behind
            body = text[text.find(b"facet") : text.rfind(b"endfacet")].replace(b"vertex", b"\nvertex")
            numbers, first, _ = numbers_of(body, b"vertex", most=3)
    except ValueError as error:
        raise FileFormatError(f"{name} is no STL file ({reason_of(error)}): write it again") from None
    many = len(first) - 1
    if many != 3 * ends[0]:
        # names of solids may hold such words
        text = re.sub(rb"(?m)^([ \t]*(?:end)?solid)\b.*", rb"\1", text)
        ends = text.count(b"endfacet"), text.count(b"endsolid")
    if many != 3 * ends[0] or not ends[1] or len(numbers) != 3 * many:
        raise FileFormatError(
            f"{name} holds {many} vertices for {ends[0]} complete triangles: it is cut; write it again"
        )
    return _loose(numbers.reshape(-1, 3))


def read_obj(raw: bytes, name: str) -> Polygons:
    """Return the polygons of an OBJ file; colors, normals, textures, lines and groups are ignored.

    Raises
    ------
    FileFormatError
        If a line cannot be read or a polygon refers to a missing vertex.
    """
    # lines that go on
    text = re.sub(rb"\\(?:\r\n|\r|\n)", b" ", raw) if b"\\" in raw else raw
    try:
        points, first, begin = numbers_of(text, b"v", most=3)
        numbers, start, at = numbers_of(text, b"f")
        places, counts = _whole(numbers), np.diff(start)
        # -1 is the last vertex before the face
        last = np.repeat(np.searchsorted(begin, at), counts)
        corners = np.where(places < 0, places + last, places - 1)
        wrong = np.concatenate([begin[np.diff(first) < 3], np.repeat(at, counts)[corners < 0]])
        reason = f"{line_at(text, int(wrong.min()))} is no vertex or face" if len(wrong) else ""
    except ValueError as error:
        reason = reason_of(error)
    if reason:
        raise FileFormatError(f"{name} cannot be read as OBJ ({reason}): it is cut or damaged; write it again")
    return points.reshape(-1, 3), corners, counts


def read_off(raw: bytes, name: str) -> Polygons:
    """Return the polygons of an OFF file.

    Raises
    ------
    FileFormatError
        If the file is truncated or not an OFF file.
    """
    # the counts may follow without a blank
    head = re.match(rb"(?>\s|#.*)*+(?i:[a-z]{0,4}\d?[a-z]{0,4}off)(?=[\s#\d]|$)", raw)
    if head is None:
        raise FileFormatError(f"{name} does not begin with OFF: it is no OFF file; check its format")
    try:
        vertex_count, face_count = _counts(numbers_of(raw, start=head.end(), lines=1, most=2)[0])
        numbers, first, _ = numbers_of(raw, start=head.end(), lines=1 + vertex_count + face_count)
        many = np.diff(first)[1:]
        rows, faces = first[1 : 1 + vertex_count], first[1 + vertex_count : -1]
        counts = _whole(numbers[faces])
        points_whole = many[:vertex_count] >= 3
        faces_whole = (counts >= 0) & (counts < many[vertex_count:])
        whole = bool(points_whole.all() and faces_whole.all())
        skipped = np.repeat(faces + 1 - np.cumsum(counts) + counts, counts) if whole else faces[:0]
        corners = _whole(numbers[skipped + np.arange(len(skipped))])
    except (ValueError, IndexError, OverflowError) as error:
        raise FileFormatError(f"{name} cannot be read as OFF ({reason_of(error)}): write it again") from None
    if points_whole.sum() < vertex_count or faces_whole.sum() < face_count:
        raise FileFormatError(
            f"{name} holds {points_whole.sum()} of {vertex_count} vertices and {faces_whole.sum()} of {face_count} "
            "faces: it is cut; write it again"
        )
    return numbers[rows[:, None] + np.arange(3)], corners, counts


def _whole(corners: NDArray[Any]) -> Integers:
    """Return vertex indices, or how many there are, as whole numbers.

    Raises
    ------
    ValueError
        If one is none, or so large that digits are lost.
    """
    with np.errstate(invalid="ignore"):
        bad = ~((np.abs(corners) < 2.0**53) & (corners == np.floor(corners)))
    if bad.any():
        raise ValueError(f"it has a face with a vertex or a count {corners[bad][0]:g}")
    return corners.astype(np.int64)


def _counts(numbers: Floats) -> list[int]:
    """Return the numbers of vertices and faces; negative ones are invalid."""
    if len(numbers) < 2:
        raise ValueError("it lacks the numbers of vertices and faces")
    for number in numbers:
        if not (number >= 0.0 and number.is_integer()):
            raise ValueError(f"it counts {number:g} of something")
    return [int(number) for number in numbers]


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
    none = np.zeros(0, dtype=np.int64)
    lists = next((face[key] for key in ("vertex_indices", "vertex_index") if key in face), (none, none))
    if not isinstance(lists, tuple):
        raise FileFormatError(f"{name} gives one corner for each face: a list is needed; write it again")
    try:
        corners = _whole(lists[0])
    except ValueError as error:
        raise FileFormatError(f"{name} cannot be read as PLY ({error}): it is cut or damaged; write it again") from None
    return ply_columns(found, "xyz", name), corners, lists[1]


def ply_elements(raw: bytes, name: str) -> dict[str, dict[str, Column]]:
    """Return the columns of each element of a PLY file, text or binary.

    Raises
    ------
    FileFormatError
        If the file is truncated or not a PLY file.
    """
    try:
        order, elements, body = _ply_header(raw)
        if not order:
            # words of a text are records of float64
            numbers, first, _ = numbers_of(raw, start=len(raw) - len(body))
            body, order = _ply_words(numbers, first, elements).tobytes(), "="
            for element in elements:
                element.properties = [(key, ("f8",) * len(types)) for key, types in element.properties]
        walk = _ply_records(body, elements, order)
        return {element.name: columns for element, columns in zip(elements, walk, strict=True)}
    except (ValueError, KeyError, IndexError, TypeError, OverflowError, struct_error) as error:
        raise FileFormatError(
            f"{name} cannot be read as PLY ({reason_of(error)}): it is cut or damaged; write it again"
        ) from None


def ply_columns(found: dict[str, dict[str, Column]], keys: Sequence[str], name: str) -> Floats:
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
    # comments may hold the word too
    mark = re.search(rb"[\r\n]end_header[ \t]*(\r\n|[\r\n]|$)", raw)
    head, body = (raw[: mark.start()], raw[mark.end() :]) if mark else (raw, b"")
    lines = head.decode("ascii", errors="replace").splitlines()
    if mark is None or not lines or lines[0].strip() != "ply":
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
    return order, elements, body


def _ply_words(numbers: Floats, first: Integers, elements: list[_Element]) -> Floats:
    """Return the words of a text without those at the ends of lines that the header does not tell, where each record
    has a line.

    `first` is the number of each line at which its words begin, and the number of words.
    """
    if len(first) - 1 != sum(element.count for element in elements):
        return numbers
    end, line = first[:-1].copy(), 0
    for element in elements:
        rows = slice(line, line + element.count)
        for _, types in element.properties:
            if len(types) == 2:
                told = numbers[np.minimum(end[rows], len(numbers) - 1)]
                if not ((told >= 0) & (told < len(numbers))).all():
                    return numbers
                end[rows] += told.astype(np.int64)
            end[rows] += 1
        line += element.count
    if (end > first[1:]).any():
        return numbers
    # the words of each line up to its end
    step = np.zeros(len(numbers) + 1, dtype=np.int64)
    np.add.at(step, first[:-1], 1)
    np.add.at(step, end, -1)
    return numbers[np.cumsum(step)[:-1] > 0]


def _ply_records(body: bytes, elements: list[_Element], order: str) -> Iterator[dict[str, Column]]:
    """Yield the columns of each element."""
    place = 0
    for element in elements:
        if len(body) - place < element.count * sum(np.dtype(types[0]).itemsize for _, types in element.properties):
            raise ValueError(f"it ends within {element.name[:40]} records")
        _, numbers, _ = _ply_places(body, place, element, order, min(element.count, 1))
        row = np.dtype(
            [
                field
                for (key, types), many in zip(element.properties, numbers, strict=True)
                for field in (
                    [(key, order + types[0])]
                    if len(types) == 1
                    else [(f"# {key}", order + types[0]), (key, order + types[1], many)]
                )
            ]
        )
        if element.count and len(body) - place >= row.itemsize * element.count:
            # most often all lists are as long as those of the first record
            records = np.frombuffer(body, dtype=row, count=element.count, offset=place)
            if all((records[key] == records[key][0]).all() for key in row.names or () if key.startswith("# ")):
                place += row.itemsize * element.count
                yield {
                    key: records[key]
                    if len(types) == 1
                    else (records[key].ravel(), records[f"# {key}"].astype(np.int64))
                    for key, types in element.properties
                }
                continue
        starts, numbers, place = _ply_places(body, place, element, order, element.count)
        columns: dict[str, Column] = {}
        for (key, types), first, many in zip(element.properties, starts, numbers, strict=True):
            kind = np.dtype(order + types[-1])
            within = np.arange(many.sum()) - np.repeat(np.cumsum(many) - many, many)
            at = (np.repeat(first, many) + kind.itemsize * within)[:, None] + np.arange(kind.itemsize)
            items = np.frombuffer(body, np.uint8)[at].view(kind).ravel()
            columns[key] = items if len(types) == 1 else (items, many)
        yield columns


def _ply_places(
    body: bytes, place: int, element: _Element, order: str, count: int
) -> tuple[list[Integers], list[Integers], int]:
    """Return where the items of each property begin in the first records, how many they are, and the end of these."""
    codes = [
        [np.dtype(code).char.replace("l", "q").replace("L", "Q") for code in types] for _, types in element.properties
    ]
    sizes = [(Struct(order + code[0]) if len(code) == 2 else None, calcsize("=" + code[-1])) for code in codes]
    starts: list[list[int]] = [[] for _ in sizes]
    numbers: list[list[int]] = [[] for _ in sizes]
    for _ in range(count):
        for k, (head, size) in enumerate(sizes):
            many = 1
            if head is not None:
                (told,) = head.unpack_from(body, place)
                many = int(told)
                if many < 0 or many != told:
                    raise ValueError(f"it has a list of {told} items")
                place += head.size
            starts[k].append(place)
            numbers[k].append(many)
            place += many * size
            if place > len(body):
                raise ValueError(f"it ends within {element.name[:40]} records")
    return [np.array(s, dtype=np.int64) for s in starts], [np.array(n, dtype=np.int64) for n in numbers], place


def gmsh_polygons(path: Path) -> Content:
    """Read the triangles and quadrangles of a Gmsh file, to be run by `read_guarded`.

    The arrays are those of `Polygons`: ``points``, ``corners`` and ``counts``.
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
