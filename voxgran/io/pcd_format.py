"""PCD files, the point clouds of PCL: header and points, text or binary."""

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError
from voxgran._base.guarded import reason_of

#: kinds of numbers, by their letter in the file, and how many bytes they take
KINDS = {"F": "f", "I": "i", "U": "u"}
SIZES = {"F": ("4", "8"), "I": ("1", "2", "4", "8"), "U": ("1", "2", "4", "8")}
#: bytes of a header, of which files have some hundreds
LONGEST_HEADER = 2**16


def pcd_columns(raw: bytes, name: str) -> dict[str, Floats]:
    """Return the fields of one number each of the bytes of a file, as columns; messages call it `name`.

    Raises
    ------
    FileFormatError
        If it is cut, compressed, or no PCD file.
    """
    try:
        head, body = _header(raw)
        fields = head["FIELDS"]
        counts = [_whole(count) for count in head.get("COUNT", ["1"] * len(fields))]
        kinds = [_kind(*told) for told in zip(head["TYPE"], head["SIZE"], strict=True)]
        row = np.dtype([(key, "<" + kind, (count,)) for key, kind, count in zip(fields, kinds, counts, strict=True)])
        many = _whole(head["POINTS"][0])
        records = _text(body, row, many) if head["DATA"][0] == "ascii" else _binary(body, row, many)
    except (ValueError, KeyError, IndexError, TypeError, OverflowError) as error:
        raise FileFormatError(
            f"{name} cannot be read as PCD ({reason_of(error)}): it is cut or damaged; write it again"
        ) from None
    # a signalling NaN warns where it is cast
    with np.errstate(invalid="ignore"):
        columns = {key: np.asarray(records[key][:, 0], dtype=np.float64)
                   for key, count in zip(fields, counts, strict=True) if count == 1}  # fmt: skip
    if not {"x", "y", "z"} <= columns.keys():
        raise FileFormatError(f"{name} has the fields {', '.join(fields)[:80]}: x, y and z are needed; write it again")
    return columns


def pcd_bytes(records: np.ndarray[tuple[int], np.dtype[np.void]]) -> bytes:
    """Return the bytes of a binary file of points, whose fields are numbers."""
    kinds = [records.dtype[name] for name in records.dtype.names or ()]
    letters = {kind: letter for letter, kind in KINDS.items()}
    head = {
        "VERSION": ["0.7"],
        "FIELDS": records.dtype.names or (),
        "SIZE": [kind.itemsize for kind in kinds],
        "TYPE": [letters[kind.kind] for kind in kinds],
        "COUNT": [1] * len(kinds),
        "WIDTH": [len(records)],
        "HEIGHT": [1],
        "VIEWPOINT": [0, 0, 0, 1, 0, 0, 0],
        "POINTS": [len(records)],
        "DATA": ["binary"],
    }
    lines = [" ".join(map(str, (key, *words))) for key, words in head.items()]
    return ("\n".join(lines) + "\n").encode("ascii") + records.tobytes()


def _header(raw: bytes) -> tuple[dict[str, list[str]], bytes]:
    """Return the words of each line of the header, and what follows it."""
    head: dict[str, list[str]] = {}
    *lines, _ = raw[:LONGEST_HEADER].split(b"\n")
    end = 0
    for line in lines:
        end += len(line) + 1
        words = line.decode("ascii", errors="replace").split()
        if words == ["DATA", "binary_compressed"]:
            raise ValueError("it is compressed; write it as binary")
        if words and not words[0].startswith("#"):
            head[words[0]] = words[1:]
        if words[:1] == ["DATA"]:
            return head, raw[end:]
    raise ValueError(f"its header does not end within {LONGEST_HEADER} bytes")


def _kind(letter: str, size: str) -> str:
    """Return the type of NumPy of a kind of numbers and its bytes."""
    if size not in SIZES.get(letter, ()):
        raise ValueError(f"numbers of type {letter[:20]!r} and size {size[:20]!r} are not known")
    return KINDS[letter] + size


def _whole(word: str) -> int:
    """Return a whole number of a header."""
    if not (word.isdecimal() and len(word) < 16):
        raise ValueError(f"{word[:20]!r} is no whole number")
    return int(word)


def _text(body: bytes, row: np.dtype[np.void], many: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """Return the records of a text body."""
    lines = [line.split() for line in body.decode("ascii", errors="replace").splitlines() if line.strip()]
    if not 0 <= many <= len(lines):
        raise ValueError(f"it holds {len(lines)} of {many} points")
    table = np.array(lines[:many], dtype=np.float64).reshape(many, -1)
    if many and table.shape[1] != sum(row[key].shape[0] for key in row.names or ()):
        raise ValueError(f"its points have {table.shape[1]} numbers")
    records, place = np.zeros(many, dtype=row), 0
    for key in row.names or ():
        width = records[key].shape[1]
        records[key] = table[:, place : place + width]
        place += width
    return records


def _binary(body: bytes, row: np.dtype[np.void], many: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    """Return the records of a binary body."""
    if not 0 <= many * row.itemsize <= len(body):
        raise ValueError(f"it holds {len(body) // max(row.itemsize, 1)} of {many} points")
    return np.frombuffer(body, dtype=row, count=many)
