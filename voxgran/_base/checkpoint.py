"""The checkpoint file: named arrays and a small header, written whole, proven by a hash when read.

Layout: one line of text ``voxgran checkpoint 1 <sha256 of the rest> <length of the rest>``, then a NumPy .npz
archive whose member ``header`` is JSON.
"""

import contextlib
import hashlib
import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.errors import CheckpointError, FileFormatError
from voxgran._base.files import existing_file, written_whole
from voxgran._base.guarded import refused

_MAGIC = b"voxgran checkpoint 1"


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
