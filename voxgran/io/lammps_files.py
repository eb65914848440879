"""LAMMPS data files and dump files with spheres, in.

References
----------
Formats: the pages `read_data` and `dump` of the LAMMPS manual, docs.lammps.org.
"""

import re
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError
from voxgran.contacts.assembly import NOT_STATED
from voxgran.io.particles import (
    Particles,
    box_of,
    frame_of,
    numbers_of,
    order_by_id,
    radii_of,
    refuse_bad_spheres,
    text_lines,
    tilt_of_edges,
)

#: names of tilts, and of the edges of a box that may lie in any direction
TILTS, EDGES = ("xy", "xz", "yz"), ("avec", "bvec", "cvec")
#: place of diameter, density and x in a row of the section Atoms, by atom style
STYLES = {"sphere": (2, 3, 4), "bpm/sphere": (3, 4, 5)}
#: lines that are looked at to recognize a data file
HEAD_LINES = 40
#: different densities that are taken for those of materials: a shape is made for each
MOST_DENSITIES = 20
#: lengths of the units that a dump file may name
UNITS = {"si": "m", "cgs": "cm", "micro": "um", "nano": "nm", "real": "angstrom", "metal": "angstrom"}


def is_dump(head: str) -> bool:
    """Return whether a text begins as a dump file does."""
    return head.lstrip().startswith("ITEM:")


def is_data(head: str) -> bool:
    """Return whether a text begins as a data file does: a free line, then counts of atoms."""
    lines = head.splitlines()[1:HEAD_LINES]
    return any(re.match(r"\s*\d+\s+atoms\b", line) for line in lines)


def read_lammps_data(path: Path) -> Particles:
    """Read spheres from a LAMMPS data file with a section ``Atoms`` of the style sphere or bpm/sphere; the file does
    not say whether its box is periodic, which it is along axes along which it is tilted.

    Raises
    ------
    FileFormatError
        If the edges of the box are not in the order of the axes, the style has no diameters, a line is wrong, or there
        are more or fewer atoms than the head says.
    """
    lines = text_lines(path, "a text file of LAMMPS")
    bounds, tilt, count = _data_head(lines, path)
    start = next((k for k, line in enumerate(lines) if re.match(r"\s*Atoms\b", line)), None)
    if start is None:
        raise FileFormatError(f"{path} has no section Atoms: spheres stand there; write the file with write_data")
    hint = lines[start].partition("#")[2].strip()
    rows, numbers = _section(lines, start + 1)
    if len(rows) != count:
        raise FileFormatError(
            f"{path} has {len(rows)} lines of atoms where its head says {count:g}: it is cut off or changed; write it "
            "again"
        )
    wraps = "".join(axis for axis in "xyz" if any(axis in name for name, t in zip(TILTS, tilt, strict=True) if t))
    style, assumed = hint, {"periodic": f"{f'along {wraps} only' if wraps else 'nowhere'}: a data file does not say"}
    if not hint:
        style = {7: "sphere", 10: "sphere", 8: "bpm/sphere", 11: "bpm/sphere"}.get(len(rows[0]) if rows else 7, "")
        assumed["atom style"] = f"{style}, by the number of values"
    if style not in STYLES:
        raise FileFormatError(
            f"{path}, line {start + 1}: the atom style is {style[:40] or 'not known'}; only {' and '.join(STYLES)} "
            "have diameters: write the file with one of these"
        )
    diameter, density, x = STYLES[style]
    table = numbers_of(rows, numbers, path, width=max(len(rows[0]) if rows else 0, x + 3))
    table = table[order_by_id(table[:, 0], numbers, path)]
    centers, radii = table[:, x : x + 3], table[:, diameter] / 2
    refuse_bad_spheres(centers, radii, path, row="atom")
    density_of = _densities(table[:, density], assumed)
    return Particles(
        centers=centers, radii=radii, container=box_of(bounds, wraps, path, tilt), density=density_of, assumed=assumed
    )


def _densities(values: Floats, assumed: dict[str, str]) -> Floats | float:
    """Return the density of each atom, (n,), or of all; 1 where the file tells none, or too many to be materials."""
    different, place = np.unique(values, return_inverse=True)
    if not len(values) or not (np.isfinite(different) & (different > 0)).all():
        return NOT_STATED
    if len(different) > 1:
        # those of one material, mass over volume, may differ by round-off
        rounded = np.array([float(f"{one:.9g}") for one in different.tolist()])
        values, different = rounded[place.reshape(-1)], np.unique(rounded)
    if len(different) > MOST_DENSITIES:
        assumed["density"] = f"1: the file has more than {MOST_DENSITIES} different ones"
        return NOT_STATED
    return values


def read_lammps_dump(path: Path, *, frame: int = -1) -> Particles:
    """Read spheres from one frame of a LAMMPS dump file, sorted by id where there is one.

    The columns must hold x y z (or xu, xs, xsu ...) and radius or diameter. Frames are counted from 0, negative ones
    from the end.

    Raises
    ------
    FileFormatError
        If there is no such frame, it is cut off, the edges of the box are not in the order of the axes, or it is tilted
        along an axis that is not periodic, a column is missing, or a line is wrong.
    """
    lines = text_lines(path, "a text file of LAMMPS")
    starts = [k for k, line in enumerate(lines) if line.startswith("ITEM: TIMESTEP")]
    begin = starts[frame_of(len(starts), frame, path)]
    end = starts[starts.index(begin) + 1] if begin != starts[-1] else len(lines)
    block = lines[begin:end]
    words = [line.split() for line in block]
    names = {row[1]: place for place, row in enumerate(words) if row[:1] == ["ITEM:"] and len(row) > 1}
    if not {"NUMBER", "BOX", "ATOMS"} <= names.keys() or len(block) < max(names["NUMBER"] + 2, names["BOX"] + 4):
        raise FileFormatError(f"{path}, line {begin + 1}: the frame is cut off; dump it again or choose another one")
    count = numbers_of([words[names["NUMBER"] + 1]], [begin + names["NUMBER"] + 2], path, width=1)[0, 0]
    columns = words[names["ATOMS"]][2:]
    first = names["ATOMS"] + 1
    # what stands before the next frame, such as its time, belongs to that
    words = words[: next((k for k, row in enumerate(words) if k >= first and row[:1] == ["ITEM:"]), len(words))]
    rows = [row for row in words[first:] if row]
    if len(rows) != count:
        raise FileFormatError(
            f"{path} has {len(rows)} lines of atoms in the frame of line {begin + 1}, which says {count:g}: it is cut "
            "off; dump it again or choose another frame"
        )
    box = names["BOX"]
    flags = [word for word in words[box][3:] if len(word) == 2 and word[0] in "pfsm"]
    skewed = "abc" in words[box][3:]
    wide = 3 if {"xy", "xz", "yz"} & set(words[box][3:]) else 4 if skewed else 2
    bounds = numbers_of(words[box + 1 : box + 4], [begin + box + k for k in (2, 3, 4)], path, width=wide)
    if skewed:
        # the vector of each edge, and a coordinate of the corner in which they begin
        tilt = tilt_of_edges(bounds[:, :3], path, begin + box + 1)
        bounds = bounds[:, 3:] + np.outer(np.diag(bounds), (0.0, 1.0))
    else:
        tilt, bounds = bounds[:, 2] if wide == 3 else np.zeros(3), bounds[:, :2]
        # the bounds are those around the tilted box
        (xy, xz, yz), z = tilt, 0.0
        around = np.array([[min(z, xy, xz, xy + xz), max(z, xy, xz, xy + xz)], [min(z, yz), max(z, yz)], [z, z]])
        bounds = bounds - around
    numbers = [begin + k + 1 for k, row in enumerate(words) if k >= first and row]
    texts = [k for k, name in enumerate(columns) if name in ("element", "type", "typelabel")]
    table = numbers_of(rows, numbers, path, width=len(columns), text=texts)
    if "id" in columns:
        table = table[order_by_id(table[:, columns.index("id")], numbers, path)]
    centers, radii = _columns(table, columns, bounds, tilt, path)
    refuse_bad_spheres(centers, radii, path, row="atom")
    # one file may be several, one behind the other
    told = [k for k, line in enumerate(lines[:begin]) if line.startswith("ITEM: UNITS")]
    unit = UNITS.get(lines[told[-1] + 1].strip()) if told else None
    step = block[1].strip()
    periodic = "".join(axis for axis, flag in zip("xyz", flags, strict=False) if flag == "pp")
    assumed = {"frame": f"time step {step}, one of {len(starts)}"} if len(starts) > 1 else {}
    return Particles(
        centers=centers, radii=radii, container=box_of(bounds, periodic, path, tilt), unit=unit, assumed=assumed
    )


def _data_head(lines: list[str], path: Path) -> tuple[Floats, Floats, float]:
    """Return the bounds of the box as if it stood upright, its tilts, and the number of atoms."""
    bounds, tilt, count, edges = np.full((3, 2), np.nan), np.zeros(3), -1.0, np.zeros((3, 3))
    for number, line in enumerate(lines[:HEAD_LINES], 1):
        words = line.partition("#")[0].split()
        if words[-1:] == ["atoms"]:
            count = numbers_of([words[:1]], [number], path, width=1)[0, 0]
        for axis, name in enumerate("xyz"):
            if words[-2:] == [f"{name}lo", f"{name}hi"]:
                bounds[axis] = numbers_of([words[:2]], [number], path, width=2)[0]
        if words[-3:] == list(TILTS):
            tilt = numbers_of([words[:3]], [number], path, width=3)[0]
        for axis, name in enumerate(EDGES):
            if words[-1:] == [name]:
                edges[axis] = numbers_of([words[:3]], [number], path, width=3)[0]
                tilt = tilt_of_edges(edges, path, number)
                bounds[axis, 1] = edges[axis, axis]
        if words[-2:] == ["abc", "origin"]:
            bounds[:, 0] = numbers_of([words[:3]], [number], path, width=3)[0]
    if edges.any():
        bounds[:, 1] += bounds[:, 0]
    if not np.isfinite(bounds).all():
        if any(re.match(r"\s*Coords\b", line) for line in lines):
            raise FileFormatError(f"{path} is a molecule and no packing: read it with vg.load_shape, as a clump")
        raise FileFormatError(f"{path} gives no box (xlo xhi, ylo yhi, zlo zhi): write it with write_data")
    return bounds, tilt, count


def _section(lines: list[str], start: int) -> tuple[list[list[str]], list[int]]:
    """Return the rows of a section and their line numbers: from the first line to the next heading."""
    rows, numbers = [], []
    for number, line in enumerate(lines[start:], start + 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if words[0][0].isalpha():
            break
        rows.append(words)
        numbers.append(number)
    return rows, numbers


def _columns(table: Floats, columns: list[str], bounds: Floats, tilt: Floats, path: Path) -> tuple[Floats, Floats]:
    """Return centers and radii of the columns of a dump."""
    centers = None
    for suffix, scaled in (("", False), ("u", False), ("s", True), ("su", True)):
        names = [axis + suffix for axis in "xyz"]
        if centers is None and set(names) <= set(columns):
            centers = table[:, [columns.index(name) for name in names]]
            if scaled:
                edges = np.diag(bounds[:, 1] - bounds[:, 0])
                edges[np.tril_indices(3, -1)] = tilt
                centers = bounds[:, 0] + linear.matmul(centers, edges)
            for name in (*names, "radius", "diameter", "id"):
                if columns.count(name) > 1:
                    raise FileFormatError(
                        f"{path} has {columns.count(name)} columns {name}: which one holds is not certain; dump one"
                    )
    sizes = {short: columns.index(name) for short, name in (("r", "radius"), ("d", "diameter")) if name in columns}
    if centers is None or not sizes:
        raise FileFormatError(
            f"{path} has the columns {' '.join(columns)[:80]}: x y z and radius or diameter are needed; dump these too"
        )
    return centers, radii_of(table, sizes, path)
