"""Tables as laboratories write them: a mapping, a `pandas.DataFrame` or a CSV file, whose columns are known by their
names, with units in brackets behind them.
"""

import io
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError, InputError, shown
from voxgran._base.files import existing_file
from voxgran._base.guarded import refused
from voxgran._base.lazy import load
from voxgran._base.units import as_unit, known_unit, unit_factor
from voxgran.shapes.formats.columns import SEPARATORS, cells_in, table_text

#: most columns that a message lists, and characters of a row
MOST_TOLD, LONGEST_ROW = 8, 10_000
#: entries that a table may lack: an entry has one character at least, and pandas fills in what is missing
FEW_ENTRIES = 100_000


def read_table(path: str) -> Any:
    """Return the table of a CSV file, whose numbers may have decimal commas where no commas separate the columns.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is no table, or empty.
    """
    found = existing_file(Path(path))
    with refused(found):
        text = table_text(found)
        head, *rows = [row for line in text.splitlines() if (row := line.partition("#")[0].strip())] or [""]
        if (longest := max(map(len, [head, *rows]))) > LONGEST_ROW:
            raise FileFormatError(
                f"{path} has a row of {longest} characters: at most {LONGEST_ROW} may be one row; correct it"
            )
        names = cells_in(head)
        if not rows or all(_number(name) is not None for name in names):
            told = f"begins with the row {shown(head)}" if rows else f"has only the row {shown(head)}" if head else ""
            raise FileFormatError(
                f"{path} {told or 'is empty'}: a table has the names of its columns in the first row, and entries "
                "below; add them"
            )
        if len(rows) * len(names) > max(len(text), FEW_ENTRIES):
            raise FileFormatError(
                f"{path} has {len(rows)} rows and {len(names)} columns, and fewer entries than that: fill each row, or "
                "remove columns"
            )
        # a single column may have blanks in its name, and decimal commas
        blanks = any(re.search(r"\s", row) for row in rows)
        mark = next((mark for mark in SEPARATORS if mark in head), r"\s+" if blanks else ";")
        pandas = load("pandas")
        how = {"comment": "#", "engine": "python", "skipinitialspace": True}
        table = pandas.read_csv(io.StringIO(text, None), sep=mark, decimal="." if mark == "," else ",", **how)
        # entries before the columns that have names have become an index
        if not table.index.equals(pandas.RangeIndex(len(table))):
            raise FileFormatError(
                f"{path} has rows of more entries than its first row has names; give one name to each column"
            )
        return table


def rows_in(text: str) -> list[Any] | None:
    """Return the numbers of a column or a row, or the rows of several columns, that were copied from a spreadsheet.

    Columns are separated by tabs, blanks or semicolons. Commas are decimal signs, but where there are points, or
    several of them in a word: there they separate numbers. The first row may name the columns, and percent signs are
    left out. None where something is no number, and of one number that is written as everywhere.
    """
    rows = [_numbers(row.replace(",", " ") if "." in text else row) for row in text.splitlines() if row.strip()]
    if len(rows) > 1 and rows[0] is None:
        del rows[0]
    numbers = [row for row in rows if row is not None]
    if len(numbers) < len(rows) or sum(map(len, numbers)) < (1 if "," in text else 2):
        return None
    single = len(numbers) == 1 or all(len(row) == 1 for row in numbers)
    return [value for row in numbers for value in row] if single else numbers


def _numbers(row: str) -> list[float] | None:
    """Return the numbers of a row, with points or commas as decimal signs; None where a word is no number."""
    words = row.replace(";", " ").replace("%", " ").split()
    words = words[0].split(",") if len(words) == 1 and words[0].count(",") > 1 else words
    try:
        return [float(word.replace(",", ".")) for word in words]
    except ValueError:
        return None


def told_columns(table: Any) -> str:
    """Return the names of the first columns of a table as a message lists them."""
    names = [shown(name) for name in table.keys()]  # noqa: SIM118  (a DataFrame has keys, too)
    return ", ".join(names[:MOST_TOLD] + ["..."] * (len(names) > MOST_TOLD)) or "none"


def columns_in(table: Any, known: Mapping[str, Sequence[str]], where: str) -> dict[str, str]:
    """Return the names of the columns of a table by what they hold.

    Parameters
    ----------
    table : mapping or pandas.DataFrame
        The table.
    known : mapping
        Names of columns, in lower case and of letters only, by what they hold.
    where : str
        What the table is called in messages.

    Raises
    ------
    InputError
        If it is no table.
    FileFormatError
        If two columns hold the same, or one is a single value.
    """
    if not isinstance(table, Mapping) and not hasattr(table, "columns"):
        raise InputError(
            f"{where} is {shown(table)}: it must be a table, which is a DataFrame, a mapping or a CSV file"
        )
    found: dict[str, str] = {}
    for name in table.keys():  # noqa: SIM118  (a DataFrame iterates over its columns only by this)
        kind = column_kind(str(name), known)
        if kind in found:
            raise FileFormatError(
                f"{where}: {shown(found[kind])} and {shown(name)} are both columns of {kind}; rename one"
            )
        if kind and (isinstance(table[name], str) or not hasattr(table[name], "__len__")):
            raise FileFormatError(f"{where}: {name} is {shown(table[name])}, and no column; give one entry a row")
        if kind:
            found[kind] = name
    return found


def column_kind(name: str, known: Mapping[str, Sequence[str]]) -> str:
    """Return what a column holds by its name, without unit; empty where that is not known."""
    plain = re.sub(r"[^a-z]", "", re.sub(r"[\[(].*", "", name.lower().replace("%", "percent")))
    bare = plain.removeprefix("percent").removesuffix("percent")
    return next((kind for kind, names in known.items() if plain in names or bare in names), "")


def unit_in(name: object) -> str:
    """Return what stands in brackets in the name of a column; empty without brackets."""
    found = re.search(r"[\[(]([^\])]*)[\])]", str(name))
    return "" if found is None else found[1].strip()


def length_factor(name: object, unit: str | None, *, where: str, what: str) -> float:
    """Return the factor from the unit of length that the name of a column tells to that of all other lengths.

    Raises
    ------
    InputError
        If the latter is not given.
    """
    told = known_unit(unit_in(name))
    if told is None:
        return 1.0
    if unit is None:
        raise InputError(
            f"{where} has {what} in {told}: give unit, the unit of all other lengths, as unit={told!r}, in a scene in "
            "[scene]"
        )
    return unit_factor(told, as_unit(unit))


def numbers_in(
    column: Any, where: str, name: str, *, words: Mapping[str, float] | None = None, first: int = 1
) -> Floats:
    """Return the numbers (n,) of a column; the message of an entry that is none names its row.

    Parameters
    ----------
    column : iterable
        Entries: numbers, or texts of them, also in percent.
    where, name : str
        What the table and the column are called in messages.
    words : mapping, optional
        Numbers that words stand for.
    first : int
        Number of the first row.

    Raises
    ------
    FileFormatError
        If an entry is no number.
    """
    if getattr(column, "ndim", 0) == 1 and column.dtype.kind in "iuf":
        values = np.array(column, dtype=np.float64)
        if np.isfinite(values).all():
            return values
    found = []
    for row, value in enumerate(column, start=first):
        text = str(value).strip().rstrip("%").strip()
        number = (words or {}).get(text.lower(), _number(text))
        if number is None or not math.isfinite(number):
            raise FileFormatError(
                f"{where}, row {row}: {name} is {shown(value)}, and no number; give it or remove the row"
            )
        found.append(number)
    return np.array(found, dtype=np.float64)


def _number(text: str) -> float | None:
    """Return the number that a text is; None where it is none."""
    try:
        return float(text)
    except ValueError:
        return None
