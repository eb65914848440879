"""Points in text tables, with columns identified by their names or, without names, by their number.

The reader is not that of pandas, which fills rows that are too short with NaN instead of refusing a file that is cut.
"""

from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError
from voxgran.shapes.formats.columns import cells_in, table_text

#: largest difference from 1 of the length of a normal in columns without names
UNIT = 1e-3
#: names of the columns
PLACE, NORMAL, GRAIN = ("x", "y", "z"), ("nx", "ny", "nz"), ("grain", "label")


def read_point_table(path: Path) -> tuple[Any, Any, Any]:
    """Return points, and normals and grains where there are any, of rows of numbers with spaces, commas or semicolons
    between, and names of the columns in a first row if it has one.

    Raises
    ------
    FileFormatError
        If it is no such table, or says too little about its columns.
    """
    lines = [line.strip() for line in table_text(path).splitlines()]
    rows = [cells_in(line) for line in lines if line and not line.startswith(("#", "//"))]
    if not rows:
        return np.zeros((0, 3)), None, None
    names = [cell.lower() for cell in rows[0]]
    if set(PLACE) <= set(names):
        return _by_name(_numbers(rows[1:], len(names), path), names)
    return _by_place(_numbers(rows, len(names), path), path)


def _numbers(rows: list[list[str]], width: int, path: Path) -> Floats:
    """Return rows as numbers."""
    table = []
    for k, row in enumerate(rows):
        try:
            table.append([float(cell) for cell in row])
            if len(row) != width:
                raise ValueError
        except ValueError:
            raise FileFormatError(
                f"{path} is no table of numbers: row {k + 1} is {' | '.join(row)[:60]!r}, and {width} numbers are "
                "needed; mend it, or name the columns x, y, z in the first row"
            ) from None
    return np.array(table, dtype=np.float64).reshape(len(rows), width)


def _by_name(table: Floats, names: list[str]) -> tuple[Any, Any, Any]:
    """Return the columns that have names."""
    points = table[:, [names.index(name) for name in PLACE]]
    normals = table[:, [names.index(name) for name in NORMAL]] if set(NORMAL) <= set(names) else None
    label = next((name for name in GRAIN if name in names), None)
    return points, normals, None if label is None else table[:, names.index(label)]


def _by_place(table: Floats, path: Path) -> tuple[Any, Any, Any]:
    """Return the columns of a table without names, where their numbers leave no doubt."""
    width = table.shape[1]
    normals = table[:, 3:6] if width in (6, 7) else None
    grain = table[:, -1] if width in (4, 7) else None
    doubt = width not in (3, 4, 6, 7)
    doubt |= normals is not None and bool((np.abs(np.linalg.norm(normals, axis=1) - 1.0) > UNIT).any())
    doubt |= grain is not None and bool((grain != np.rint(grain)).any())
    if doubt:
        raise FileFormatError(
            f"{path} has {width} columns without names: after x y z only a normal of length 1 and the whole number of "
            "a grain are known; name the columns in a first row, such as x,y,z,intensity"
        )
    return table[:, :3], normals, grain
