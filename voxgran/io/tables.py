"""Spheres in text tables: ``x y z r``, ``x y z r clumpId`` as YADE writes them, and CSV with a header.

A table is read by NumPy where all of it is numbers, otherwise line by line, and the message names the first bad line.
pandas does not replace this: it fills rows that are too short with NaN and reads no mixture of blanks and commas.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError, MissingLibraryError, VoxgranError
from voxgran._base.guarded import reason_of
from voxgran._base.scalars import values_of_json
from voxgran.containers.model import Container
from voxgran.io.kept import kept_container
from voxgran.io.particles import (
    LARGEST_CLUMP,
    SPHERE_RULE,
    Particles,
    good_spheres,
    order_by_id,
    radii_of,
    refuse_bad_spheres,
)
from voxgran.io.sphere_packs import CELL, cell_of
from voxgran.shapes.formats.columns import columns_of, places_of

#: comments at the top in which :func:`save_spheres` keeps container, unit, and the fields gravity and contact gap
CONTAINER, UNIT = "# container ", "# unit "
FIELDS = ("gravity", "contact_gap")


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of a table."""

    #: place of x, y, z, r or d, clump and id; without z the rows are disks
    columns: dict[str, int]
    #: separator of values; None for blanks
    mark: str | None
    #: lines before the first row
    skipped: int
    #: values a row
    width: int
    #: unit of all lengths, as the names tell it, once columns are multiplied by the factors
    unit: str | None = None
    factors: dict[str, float] = field(default_factory=dict)
    #: whether the file names its columns
    named: bool = False


def read_table(path: Path) -> Particles:
    """Read spheres from text.

    Each line holds x, y, z, r of a sphere, separated by blanks, tabs, commas or semicolons, in this order or as a line
    of names says; without a column of z they are disks. Blank lines and what follows a ``#`` are skipped. A fifth
    column of whole numbers, if it is the last one or called ``clumpId``, tells the clump of each sphere.

    Raises
    ------
    FileFormatError
        If it is no text, there are clumps of disks, or a line is no sphere or has more or fewer values than the first
        one; the message gives its number.
    """
    try:
        container, unit, fields = _comments(path)
        layout = _layout(path, unit)
        table = np.zeros((0, 4)) if layout is None else _rows(path, layout)
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path} is no text ({error.reason}): give spheres as lines of x y z r") from error
    if layout is None:
        flat = container is not None and container.dimension == 2
        centers, radii = table[:, :3], table[:, 3]
        return Particles(centers=centers, radii=radii, container=container, unit=unit, fields=fields, flat=flat)
    columns, assumed = layout.columns, {}
    clump = None
    if "clump" in columns:
        clump = table[:, columns["clump"]].astype(np.int64)
    elif layout.width == 5 and not layout.named and len(table) and _whole(table[:, 4]):
        clump = table[:, 4].astype(np.int64)
        assumed["clumps"] = "the fifth column tells the clump of each sphere"
    if "id" in columns:
        rows = [(number, _words(text, layout)) for number, text in _lines(path) if number > layout.skipped]
        order_by_id([words[columns["id"]] for _, words in rows], [number for number, _ in rows], path)
    flat = "z" not in columns
    if flat and clump is not None:
        raise FileFormatError(f"{path} has no column of z, and clumps: those of disks are not known; leave out clumpId")
    if flat and container is None:
        assumed["dimension"] = "two: there is no column of z"
    if layout.factors:
        assumed["units"] = f"lengths in several units are converted to {layout.unit}"
        for name, factor in layout.factors.items():
            table[:, columns[name]] *= factor
    places = [columns[name] for name in "xyz" if name in columns]
    centers = np.zeros((len(table), 3))
    centers[:, : len(places)] = table[:, places]
    radii = radii_of(table, columns, path)
    if layout.factors:
        refuse_bad_spheres(centers, radii, path, row="row")
    return Particles(
        centers=centers,
        radii=radii,
        clump=clump,
        container=container,
        unit=unit or layout.unit,
        fields=fields,
        assumed=assumed,
        flat=flat,
    )


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Yield number and content of each line that holds something but a comment."""
    with path.open(encoding="utf-8-sig") as file:
        for number, line in enumerate(file, 1):
            if text := line.partition("#")[0].strip():
                yield number, text


def _layout(path: Path, unit: str | None) -> Layout | None:
    """Return the layout of a table with the unit that a comment states; None for an empty one."""
    lines = _lines(path)
    number, first = next(lines, (0, ""))
    if not first:
        return None
    mark = next((mark for mark in (";", ",") if mark in first), None)
    words = _split(first, mark)
    if not any(_is_number(word, mark) for word in words):
        return _named(words, f"{path}, line {number}", number, mark, unit)
    hint = _hinted(path, len(words))
    if hint is not None:
        return _named(hint[0], f"{path}, line {hint[1]}", 0, mark, unit)
    if len(words) < 4 or not all(_is_number(word, mark) for word in words[:4]):
        raise FileFormatError(f"{path}, line {number}: {first[:60]!r} is not x y z r; mend or remove the line")
    return Layout({"x": 0, "y": 1, "z": 2, "r": 3}, mark, 0, len(words))


def _split(text: str, mark: str | None) -> list[str]:
    """Return the values of a line."""
    words = [word.strip().strip("\"'") for word in text.split(mark)]
    return words[:-1] if mark and words and not words[-1] else words


def _words(text: str, layout: Layout) -> list[str]:
    """Return the values of a line of a table, which may have blanks and commas in one file."""
    words = _split(text, layout.mark)
    return text.replace(",", " ").split() if len(words) != layout.width and layout.mark != ";" else words


def _is_number(word: str, mark: str | None) -> bool:
    """Return whether a value is a number, with a decimal comma where values are parted by something else."""
    try:
        float(word.replace(",", ".") if mark == ";" else word)
    except ValueError:
        return False
    return True


def _named(words: list[str], where: str, skipped: int, mark: str | None, unit: str | None) -> Layout:
    """Return the layout that a line of names gives."""
    found = columns_of(words, where, stated=unit)
    missing = [name for name in "xy" if name not in found.places]
    if missing or not ("r" in found.places or "d" in found.places):
        lacking = missing or ["r or diameter"]
        raise FileFormatError(
            f"{where}: the columns are {' '.join(words)[:80]}; there is no {', '.join(lacking)}: name columns x, y, z "
            "and r"
        )
    return Layout(found.places, mark, skipped, len(words), found.unit, found.factors, named=True)


def _hinted(path: Path, width: int) -> tuple[list[str], int] | None:
    """Return the names of so many columns in a comment at the top, as YADE writes them, and the number of its line."""
    with path.open(encoding="utf-8-sig") as file:
        for number, line in enumerate(file, 1):
            if not line.startswith("#"):
                break
            text = line.lstrip("# ").strip()
            words = text.removeprefix("format").strip().split("_") if text.startswith("format") else text.split()
            found = places_of(words).keys()
            if {"x", "y"} <= found and ("r" in found or "d" in found):
                return (words, number) if len(words) == width else None
    return None


def _rows(path: Path, layout: Layout) -> Floats:
    """Return all values; at once where that works, else line by line, to name the line that is wrong."""
    if layout.mark != ";" and any(number > layout.skipped for number, _ in _lines(path)):
        try:
            rows: Floats = np.loadtxt(
                path, comments="#", delimiter=layout.mark, ndmin=2, skiprows=layout.skipped, encoding="utf-8-sig"
            )
        except ValueError:
            return _slow_rows(path, layout)
        if rows.shape[1] == layout.width and _good(rows, layout):
            return rows
    return _slow_rows(path, layout)


def _good(rows: Floats, layout: Layout) -> bool:
    """Return whether all spheres are good and clumps are whole numbers."""
    centers = rows[:, [layout.columns[name] for name in "xyz" if name in layout.columns]]
    clump = rows[:, layout.columns["clump"]] if "clump" in layout.columns else np.zeros(1)
    return bool(good_spheres(centers, _radii(rows, layout)).all()) and _whole(clump)


def _whole(clump: Floats) -> bool:
    """Return whether values can be numbers of clumps."""
    return bool(((np.abs(clump) <= LARGEST_CLUMP) & (clump == np.rint(clump))).all())


def _radii(rows: Floats, layout: Layout) -> Floats:
    """Return the radii of rows."""
    radii: Floats = rows[:, layout.columns["r"]] if "r" in layout.columns else rows[:, layout.columns["d"]] / 2
    return radii


def _slow_rows(path: Path, layout: Layout) -> Floats:
    """Read line by line and refuse the first bad one; columns that are not needed may hold anything."""
    needed = [layout.columns[name] for name in ("x", "y", "z", "r", "d", "clump") if name in layout.columns]
    rows = []
    for number, text in _lines(path):
        if number <= layout.skipped:
            continue
        words = _words(text, layout)
        if len(words) != layout.width:
            raise FileFormatError(
                f"{path}, line {number}: {text[:60]!r} has {len(words)} values, the first line {layout.width}; mend or "
                "remove the line"
            )
        row = [float("nan")] * layout.width
        for place, word in enumerate(words):
            if _is_number(word, layout.mark):
                row[place] = float(word.replace(",", ".") if layout.mark == ";" else word)
            elif place in needed:
                raise FileFormatError(f"{path}, line {number}: {text[:60]!r} is not x y z r; mend or remove the line")
        if not _good(np.array([row]), layout):
            names = "x y z r clump" if "clump" in layout.columns else "x y z r"
            values = " ".join(f"{row[place]:g}" for place in needed)
            rule = f"{SPHERE_RULE}, and clumps whole numbers" if "clump" in layout.columns else SPHERE_RULE
            raise FileFormatError(f"{path}, line {number}: {names} is {values}; {rule}; mend or remove the line")
        rows.append(row)
    return np.array(rows, dtype=np.float64).reshape(-1, layout.width)


def _comments(path: Path) -> tuple[Container | None, str | None, dict[str, Any]]:
    """Return container, unit and fields of the packing from the comments at the top."""
    container: Container | None = None
    unit, fields = None, {}
    with path.open(encoding="utf-8-sig") as file:
        for number, line in enumerate(file, 1):
            if not line.startswith("#"):
                break
            if line.startswith(UNIT):
                unit = line.removeprefix(UNIT).strip("= \n")
            elif line.startswith(CELL):
                container = cell_of(line, path, number)
            elif line.startswith(CONTAINER):
                container = _container(line.removeprefix(CONTAINER), path, number)
            elif container is not None and (words := line[1:].split(maxsplit=1)) and words[0] in FIELDS:
                try:
                    fields[words[0]] = values_of_json(words[1])
                except (IndexError, ValueError, RecursionError):
                    raise FileFormatError(
                        f"{path}, line {number}: {words[0]} is no JSON; mend or remove the line"
                    ) from None
    return container, unit, fields


def _container(text: str, path: Path, number: int) -> Container:
    """Return the container that a comment holds as JSON."""
    try:
        return kept_container(values_of_json(text))
    except MissingLibraryError:
        raise
    except (VoxgranError, KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise FileFormatError(
            f"{path}, line {number}: the container cannot be read ({reason_of(error, most=300)}); mend or "
            "remove the line"
        ) from error
