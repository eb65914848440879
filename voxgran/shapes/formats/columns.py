"""Text of tables and the entries of its rows; names of columns of spheres, with units of length in brackets."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from voxgran._base.errors import FileFormatError, shown
from voxgran._base.units import NO_UNIT, known_unit, unit_factor

#: names of columns, in lower case and without unit, blanks and separators
NAMES: dict[str, tuple[str, ...]] = {
    axis: (
        *(f"{axis}{tail}" for tail in ("", "coord", "coordinate")),
        *(f"{head}{axis}" for head in ("pos", "position", "p", "c", "center")),
        *(f"{head}{place}" for head in ("points", "coordinates", "center")),
    )
    for place, axis in enumerate("xyz")
} | {
    "r": ("r", "radius", "radii", "rad"),
    "d": ("d", "diameter", "dia", "diam"),
    "clump": ("clumpid", "clump", "idclump"),
    "id": ("id",),
}
#: columns that hold lengths
LENGTHS = ("x", "y", "z", "r", "d")
#: characters of a name of a column that are looked at
LONGEST_NAME = 100
#: what separates entries, the first of which that a row holds; blanks if none
SEPARATORS = (";", "\t", ",")
#: first bytes of workbooks, and of texts in UTF-16
WORKBOOKS, WIDE = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0"), (b"\xff\xfe", b"\xfe\xff")
#: characters that no text has
_BINARY = re.compile(r"[\x00-\x08\x0e-\x1f]")
#: a name and its unit in brackets
_BRACKET = re.compile(r"([^\[(]*)[\[(]([^\])]*)[\])]\s*")


def table_text(path: Path) -> str:
    """Return the text of a table, in UTF-8, in UTF-16 where its first bytes say so, or as older spreadsheets write it.

    Raises
    ------
    FileFormatError
        If it is no text.
    """
    raw = path.read_bytes()
    if raw.startswith(WORKBOOKS):
        raise FileFormatError(f"{path} is a workbook: a table is text; save the sheet as CSV")
    for code in ("utf-16",) if raw.startswith(WIDE) else ("utf-8-sig", "cp1252"):
        try:
            text = raw.decode(code)
        except UnicodeDecodeError:
            continue
        if not _BINARY.search(text):
            return text
    raise FileFormatError(f"{path} is no text: a table has rows of numbers; write it as CSV")


def cells_in(row: str) -> list[str]:
    """Return the entries of a row, whose numbers may have decimal commas where something else separates them."""
    mark = next((mark for mark in SEPARATORS if mark in row), None)
    cells = [cell.strip().strip("\"'") for cell in row.split(mark)]
    return cells if mark in (",", None) else [cell.replace(",", ".") for cell in cells]


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns of a table, by what they hold: x, y, z, r, d, clump and id."""

    places: dict[str, int]
    #: unit of all lengths once they are multiplied by the factors; text that is no unit where only such is stated
    unit: str | None = None
    #: factor of each column of lengths that has another unit
    factors: dict[str, float] = field(default_factory=dict)


def places_of(words: Sequence[str]) -> dict[str, list[int]]:
    """Return the places of the columns with a known name."""
    found: dict[str, list[int]] = {}
    for place, word in enumerate(words):
        plain = re.sub(r"[^a-z0-9]", "", _parts(word)[0].lower())
        for name, known in NAMES.items():
            if plain in known:
                found.setdefault(name, []).append(place)
    return found


def columns_of(words: Sequence[str], where: str, *, stated: str | None = None) -> Columns:
    """Return the columns that a line of names tells, with all lengths in one unit.

    Parameters
    ----------
    words : sequence of str
        Names, with a unit in brackets or without.
    where : str
        File and line, for messages.
    stated : str, optional
        Unit that the file states elsewhere: that of the columns without one of their own.

    Raises
    ------
    FileFormatError
        If two columns have one meaning, or units differ and one is unknown or missing.
    """
    found = places_of(words)
    for name, places in found.items():
        if len(places) > 1:
            one, other = (shown(words[place]) for place in places[:2])
            raise FileFormatError(
                f"{where}: {one} and {other} are both columns of {name}: which one holds is not certain; rename one"
            )
    columns = {name: place for name, (place,) in found.items()}
    stated = None if stated == NO_UNIT else stated
    own = {name: _parts(words[place])[1] for name, place in columns.items() if name in LENGTHS}
    told = dict.fromkeys(known_unit(unit) or unit for unit in (stated, *own.values()) if unit is not None)
    if len(told) < 2:
        return Columns(columns, next(iter(told), None))
    units = {name: known_unit(stated if unit is None else unit) for name, unit in own.items()}
    if None in units.values() or (stated is not None and known_unit(stated) is None):
        raise FileFormatError(
            f"{where}: the columns have lengths in {' and '.join(map(shown, list(told)[:3]))}, and not each has a "
            "known unit; give each its unit in brackets, such as [mm]"
        )
    target = known_unit(stated) or next(iter(units.values()))
    factors = {name: unit_factor(str(unit), str(target)) for name, unit in units.items() if unit != target}
    return Columns(columns, target, factors)


def _parts(word: str) -> tuple[str, str | None]:
    """Return the name of a column and the unit in brackets behind it; None without one."""
    bracket = _BRACKET.fullmatch(word[:LONGEST_NAME])
    return (bracket[1], bracket[2].strip() or None) if bracket else (word[:LONGEST_NAME], None)
