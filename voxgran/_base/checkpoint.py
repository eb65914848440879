"""The checkpoint file: named arrays and a small header, written whole, proven by a hash when read.

Layout: one line of text ``voxgran checkpoint 1 <sha256 of the rest> <length of the rest>``, then a NumPy .npz
archive whose member ``header`` is JSON.
"""

import contextlib
import hashlib
import io
import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from voxgran._base.errors import CheckpointError, FileFormatError
from voxgran._base.files import existing_file, written_whole
from voxgran._base.guarded import refused

_MAGIC = b"voxgran checkpoint 1"
#: largest magnitude of numbers of which nothing is declared: far beyond all lengths, and safe to be squared
FAR = 1e15
#: largest magnitude of whole numbers of which nothing is declared
MOST = 2**62


@dataclass(frozen=True, slots=True)
class Held:
    """What an array, or a whole number, of a checkpoint may hold.

    low, high: range of its values, or of each column; NaN is in no range.  rows: name of the arrays that have as many
    rows as each other, whatever these are; without it there are as many as in a new state.  like: an array of that type
    and with such rows, of any length where theirs is 0, where a new state may have none.  where: only those rows count
    whose number in the array of that name is above 0.  any: whether it may hold all values, NaN included.
    """

    low: Any = None
    high: Any = None
    rows: str = ""
    like: NDArray[Any] | None = None
    where: str = ""
    any: bool = False


#: what is declared of a kind of checkpoint: its arrays and whole numbers by name, and a rule for all of them together
Declared: TypeAlias = Mapping[str, Held]
Rule: TypeAlias = Callable[[Mapping[str, NDArray[Any]], Mapping[str, Any]], bool]


def check_held(
    new: tuple[Mapping[str, NDArray[Any]], Mapping[str, Any]],
    arrays: Mapping[str, NDArray[Any]],
    counters: Mapping[str, Any],
    declared: Declared,
    rule: Rule | None = None,
) -> None:
    """Check what a checkpoint holds before anything is computed from it.

    new: arrays and whole numbers of a new state of the same run, which has the same names.

    Raises
    ------
    CheckpointError
        If an array has another type or shape than one of such a run, or a value is out of its range.
    """
    lengths: dict[str, int] = {}
    optional = {name: held.like for name, held in declared.items() if held.like is not None}
    unknown = arrays.keys() - new[0].keys() - optional.keys() | counters.keys() - new[1].keys() - declared.keys()
    for name in sorted(unknown):
        raise CheckpointError(_wrong(name, "a name that no such run has"))
    for name, like in {**new[0], **optional}.items():
        if name not in arrays and name in optional:
            continue
        array, held, shape = _found(arrays, name), declared.get(name, Held()), like.shape
        if held.rows and array.ndim:
            shape = (lengths.setdefault(held.rows, len(array)), *shape[1:])
        if shape[1:] == (0,):
            shape = (*shape[:1], *array.shape[1:])
        if array.dtype != like.dtype or array.shape != shape:
            raise CheckpointError(_wrong(name, "another type or shape"))
    # where all have their shapes, one may tell which rows of another count
    for name, array in arrays.items():
        held = declared.get(name, Held())
        own = array[arrays[held.where] > 0] if held.where else array
        if not held.any and array.dtype.kind in "iuf" and not _within(own, held):
            raise CheckpointError(_wrong(name, "values out of range"))
    # counters that are declared and not of a new state are of what a run has made before
    for name in (*new[1], *(counters.keys() & declared.keys() - new[1].keys())):
        count = _found(counters, name)
        if not (new[1].get(name, 0) is count is None) and not _within(count, declared.get(name, Held())):
            raise CheckpointError(_wrong(name, "a value out of range"))
    if rule is not None and not rule(arrays, counters):
        raise CheckpointError(_wrong("the arrays together", "values that contradict each other"))


def _found(held: Mapping[str, Any], name: str) -> Any:
    """Return what a checkpoint holds under a name.

    Raises
    ------
    CheckpointError
        If that is nothing.
    """
    if name not in held:
        raise CheckpointError(_wrong(name, "nothing, which this version of voxgran keeps"))
    return held[name]


def _wrong(name: str, what: str) -> str:
    """Return the message for a name."""
    return f"{name!r} of the checkpoint has {what}: no run leaves it so; start anew without it"


def _within(values: Any, held: Held) -> bool:
    """Return whether all values are in their range."""
    if values is None:
        return False
    whole = not isinstance(values, np.ndarray) or values.dtype.kind != "f"
    most = MOST if whole else FAR
    low, high = (-most if held.low is None else held.low), (most if held.high is None else held.high)
    return bool(np.all((values >= low) & (values <= high)))


def save_checkpoint(
    path: str | os.PathLike[str], header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write a checkpoint of JSON-able values and arrays (bit for bit), which replaces the previous one once it is
    complete.
    """
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(dict(header), sort_keys=True).encode(), dtype=np.uint8)
    members: dict[str, Any] = {"header": text, **{f"array_{name}": array for name, array in arrays.items()}}
    np.savez(buffer, **members)
    body = buffer.getvalue()
    line = f"{hashlib.sha256(body).hexdigest()} {len(body)}\n".encode()
    with written_whole(path) as draft:
        draft.write_bytes(_MAGIC + b" " + line + body)


def refuse_other_file(path: str | os.PathLike[str]) -> None:
    """Refuse a regular file that is no checkpoint as the place of one, before it is replaced.

    Raises
    ------
    CheckpointError
        If there is such a file.
    """
    if os.path.isfile(path) and not _is_checkpoint(path):
        raise CheckpointError(f"{path} is there and no checkpoint of voxgran: it is not replaced; name another file")


def remove_checkpoint(path: str | os.PathLike[str]) -> None:
    """Remove a checkpoint, if it is there; any other file stays."""
    if _is_checkpoint(path):
        Path(path).unlink(missing_ok=True)


def _is_checkpoint(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is there, can be read, and begins as a checkpoint does."""
    with contextlib.suppress(OSError), open(path, "rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC
    return False


def load_checkpoint(path: str | os.PathLike[str]) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return header and arrays of a checkpoint.

    Raises
    ------
    CheckpointError
        If it is damaged or not a checkpoint.
    """
    found = existing_file(path)
    raw = found.read_bytes()
    line, _, body = raw.partition(b"\n")
    words = line.removeprefix(_MAGIC).split()
    if not line.startswith(_MAGIC) or len(words) != 2:
        raise CheckpointError(f"{path} is not a checkpoint of voxgran: name the right file or start anew")
    if hashlib.sha256(body).hexdigest().encode() != words[0]:
        raise CheckpointError(
            f"{path} is damaged ({len(body)} bytes of {words[1].decode(errors='replace')}, wrong hash): "
            "start anew without it"
        )
    try:
        with refused(found), np.load(io.BytesIO(body), allow_pickle=False) as archive:
            if sum(member.file_size for member in archive.zip.infolist()) > len(body):
                raise CheckpointError(f"{path} holds packed arrays: another program wrote it; start anew without it")
            members = {name: archive[name] for name in archive.files}
            header = dict(json.loads(members.pop("header").tobytes().decode()))
    except FileFormatError as error:
        raise CheckpointError(
            f"{path} holds no archive of arrays with a header: another program wrote it; start anew without it"
        ) from error
    return header, {name.removeprefix("array_"): array for name, array in members.items()}
