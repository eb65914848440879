"""Numbers and lines in the files of engines, and parts of their programs."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError


def row_of(values: Iterable[float], between: str = " ") -> str:
    """Return numbers as a line that reads back to the same numbers."""
    return between.join(repr(float(value)) for value in values)


def text_of(lines: Iterable[str]) -> str:
    """Return lines as the text of a file."""
    return "\n".join(lines) + "\n"


def program_part(name: str) -> str:
    """Return a part of a program, in the language of an engine, from the folder ``programs``."""
    return (Path(__file__).parent / "programs" / name).read_text(encoding="utf-8")


def grain_rows(path: Path, columns: int) -> tuple[list[str], Floats]:
    """Return the names of templates and the numbers of a table of grains with a name and so many columns.

    Raises
    ------
    FileFormatError
        If a row has another number of columns.
    """
    rows = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")]
    wrong = next((row for row in rows if len(row) != 1 + columns), None)
    if wrong is not None:
        raise FileFormatError(f"{path} has a row of {len(wrong)} columns: write the deck again")
    return [row[0] for row in rows], np.array([[float(word) for word in row[1:]] for row in rows])
