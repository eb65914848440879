"""What a generator notes about a shape as JSON-able values, and back, bit for bit."""

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: largest array that is kept, in bytes; a longer one is left out of the file
MOST_BYTES = 2**22


def record_as_json(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return a record as JSON-able values; an entry with an array of more than 4 MiB is left out."""
    return {name: _written(value) for name, value in record.items() if _bytes_of(value) <= MOST_BYTES}


def record_of_json(stated: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of a record that :func:`record_as_json` wrote."""
    return {name: _read(value) for name, value in stated.items()}


def planes_of(parts: list[NDArray[Any]]) -> NDArray[np.uint8]:
    """Return rows (n, 3) of whole numbers as bytes that can be compressed: steps from row to row, the least byte of
    each first, then the next one. Part by part, so that they are the memory that it takes.
    """
    ends = np.cumsum([0] + [len(part) for part in parts])
    planes, last = np.empty((4, 3, ends[-1]), dtype=np.uint8), np.zeros((1, 3), dtype=np.int32)
    for part, start, end in zip(parts, ends, ends[1:], strict=False):
        rows = part.astype(np.int32)
        steps = np.diff(rows, axis=0, prepend=last).T
        # small steps, up or down, are small numbers
        folded = ((steps << 1) ^ (steps >> 31)).view(np.uint32)
        for place, plane in enumerate(planes):
            plane[:, start:end] = folded >> np.uint32(8 * place)
        last = rows[-1:] if len(rows) else last
    return planes.ravel()


def rows_of(planes: NDArray[Any]) -> NDArray[np.int32]:
    """Return the rows whose bytes :func:`planes_of` has parted."""
    folded = np.ascontiguousarray(np.asarray(planes, dtype=np.uint8).reshape(4, -1).T).view(np.uint32).reshape(3, -1).T
    steps = (folded >> 1).astype(np.int32) ^ -(folded & 1).astype(np.int32)
    return np.cumsum(steps, axis=0, dtype=np.int32)


def _bytes_of(value: Any) -> int:
    """Return the size of the largest array in a value, in bytes."""
    if isinstance(value, tuple):
        return max(map(_bytes_of, value), default=0)
    return value.nbytes if isinstance(value, np.ndarray) else 0


def _written(value: Any) -> Any:
    """Return a value as JSON knows it: an array as its type, shape and bytes."""
    if isinstance(value, tuple):
        return [_written(one) for one in value]
    if not isinstance(value, np.ndarray):
        return value
    data = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode("ascii")
    return {"dtype": value.dtype.str, "shape": list(value.shape), "base64": data}


def _read(value: Any) -> Any:
    """Return a value that :func:`_written` wrote."""
    if isinstance(value, list):
        return tuple(_read(one) for one in value)
    return _array(value) if isinstance(value, Mapping) else value


def _array(stated: Mapping[str, Any]) -> NDArray[Any]:
    """Return an array from its type, shape and bytes."""
    shape = tuple(int(length) for length in stated["shape"])
    values = np.frombuffer(base64.b64decode(stated["base64"], validate=True), dtype=np.dtype(stated["dtype"]))
    return values.reshape(shape)
