"""Numbers and lines in the files of engines."""

from collections.abc import Iterable


def row_of(values: Iterable[float], between: str = " ") -> str:
    """Return numbers as a line that reads back to the same numbers."""
    return between.join(repr(float(value)) for value in values)


def text_of(lines: Iterable[str]) -> str:
    """Return lines as the text of a file."""
    return "\n".join(lines) + "\n"
