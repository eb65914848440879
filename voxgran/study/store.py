"""The folder of a study: one file for each run that is finished, under the hash of its scene, written whole."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from voxgran._base.errors import OutputExistsError
from voxgran._base.files import write_text, written_whole
from voxgran._base.lock import FOLDER_LOCK
from voxgran.study.runs import Record, Run, from_text, to_text

#: folder of the finished runs
CELLS = "cells"
#: folder of the checkpoints of runs that are not finished
CHECKPOINTS = "checkpoints"


@dataclass(frozen=True, slots=True)
class Store:
    """The finished runs in a folder; `packings` is whether their packings are kept too."""

    folder: Path
    packings: bool = False

    def path(self, key: str) -> Path:
        """Return the file of a run."""
        return self.folder / CELLS / f"{key}.json"

    def packing(self, key: str) -> Path:
        """Return the file of the packing of a run."""
        return self.folder / CELLS / f"{key}.vtp"

    def checkpoint(self, key: str) -> Path:
        """Return the file of the checkpoint of a run."""
        return self.folder / CHECKPOINTS / f"{key}.voxgran"

    def read(self, key: str) -> Record | None:
        """Return what a run has left; None where it is not finished, its file is damaged or its packing is missing."""
        try:
            seal, _, text = self.path(key).read_text(encoding="utf-8").partition("\n")
            record = from_text(text) if seal == _seal(text) else None
        except (OSError, ValueError, KeyError, TypeError):
            return None
        if record is None or (self.packings and not record.failure and not self.packing(key).is_file()):
            return None
        return record

    def write(self, run: Run, record: Record, values: Mapping[str, Any], packing: bytes = b"") -> None:
        """Write what a run has left, with what its values are called, and its packing where it is given as bytes.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        if packing:
            with written_whole(self.packing(run.key)) as draft:
                draft.write_bytes(packing)
        text = to_text(record, {"values": dict(values), "seed": run.seed, "scene": run.mapping})
        # a file that a power cut has damaged is found by its seal, and the run computed again
        write_text(self.path(run.key), f"{_seal(text)}\n{text}", sync=False)

    def refuse_other(self) -> None:
        """Refuse a folder that holds something and no study.

        Raises
        ------
        OutputExistsError
            If it does.
        """
        if self.folder.exists() and not self.folder.is_dir():
            raise OutputExistsError(f"{self.folder} is a file: a study needs a folder; name another")
        if not self.folder.is_dir() or (self.folder / CELLS).is_dir():
            return
        if any(entry.name != FOLDER_LOCK for entry in self.folder.iterdir()):
            raise OutputExistsError(f"{self.folder} holds something else than a study: name another folder")


def _seal(text: str) -> str:
    """Return the first line of a file, by which damage is found; it is JSON, too."""
    return json.dumps({"sha256": hashlib.sha256(text.encode()).hexdigest()})
