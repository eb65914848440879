"""What YADE and Woo add to text tables of spheres: the periodic cell, and rows that begin with a number and a class.

References
----------
Formats: ``SpherePack::toFile`` of YADE and Woo, ``ShapePack::saveTxt`` of Woo.
"""

import re
from pathlib import Path

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError
from voxgran.containers.kinds.box import Box
from voxgran.io.particles import Particles, box_of, numbers_of, refuse_bad_spheres, text_lines

#: beginning of the line of a periodic cell, whose corner is the origin
CELL = "##PERIODIC::"
_ROW = re.compile(r"\s*\d+u?\s+[A-Za-z]\w*\s+[-+.\d]")


def is_shape_pack(head: str) -> bool:
    """Return whether a text begins as one of a ShapePack does: with a row ``number class x y z r``."""
    first = next((line for line in head.splitlines() if line.partition("#")[0].strip()), "")
    return _ROW.match(first) is not None


def read_shape_pack(path: Path) -> Particles:
    """Read spheres from text of a ShapePack: rows ``number Sphere x y z r``. Rows of one number are a clump, unless
    a ``u`` follows the number.

    Raises
    ------
    FileFormatError
        If a row is no sphere, or the line of the cell is wrong.
    """
    lines = text_lines(path, "text of a ShapePack")
    rows, numbers, clump = list[list[str]](), list[int](), list[int]()
    container = None
    for number, line in enumerate(lines, 1):
        if line.startswith(CELL):
            container = cell_of(line, path, number)
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 6 or words[1] != "Sphere" or not re.fullmatch(r"\d{1,15}u?", words[0]):
            raise FileFormatError(
                f"{path}, line {number}: {line.strip()[:60]!r} is not 'number Sphere x y z r': of a ShapePack only "
                "spheres and clumps of them are read; leave other shapes out"
            )
        rows.append(words[2:])
        numbers.append(number)
        clump.append(-1 if words[0].endswith("u") else int(words[0]))
    table = numbers_of(rows, numbers, path, width=4)
    refuse_bad_spheres(table[:, :3], table[:, 3], path)
    return Particles(
        centers=table[:, :3], radii=table[:, 3], clump=np.array(clump, dtype=np.int64), container=container
    )


def cell_of(line: str, path: Path, number: int) -> Box:
    """Return the periodic cell that a line tells by three lengths.

    Raises
    ------
    FileFormatError
        If they are not three lengths.
    """
    lengths: Floats = numbers_of([line.removeprefix(CELL).split()], [number], path, width=3)[0]
    return box_of(np.column_stack([np.zeros(3), lengths]), "xyz", path)
