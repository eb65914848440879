"""Numbers and lines in the files of engines, and parts of their programs."""

from collections.abc import Iterable
from pathlib import Path


def row_of(values: Iterable[float], between: str = " ") -> str:
    """Return numbers as a line that reads back to the same numbers."""
    return between.join(repr(float(value)) for value in values)


def text_of(lines: Iterable[str]) -> str:
    """Return lines as the text of a file."""
    return "\n".join(lines) + "\n"


def program_part(name: str) -> str:
    """Return a part of a program, in the language of an engine, from the folder ``programs``."""
    return (Path(__file__).parent / "programs" / name).read_text(encoding="utf-8")
