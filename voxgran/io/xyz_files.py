"""Extended XYZ files, as OVITO and ASE write them, and the binary ``.xyzd`` files of PackingGeneration, in.

References
----------
Formats: github.com/libAtoms/extxyz; the page `XYZ file reader` of the OVITO manual; the README of
github.com/VasiliBaranov/packing-generation.
"""

import itertools
import re
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError
from voxgran._base.files import leads_out
from voxgran._base.scalars import cube_root
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

#: names of the properties that hold sizes and ids, in lower case
NAMES = {"radius": "r", "radii": "r", "diameter": "d", "diameters": "d", "id": "id"}
#: what PackingGeneration calls the number of spheres and the box in generation.conf and, here, in .nfo files
FACTS = {"particles count": "n", "packing size": "dimensions"}
#: characters of the second line that are looked at
LONGEST_HEAD = 10_000
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?")
_PAIR = re.compile(r"""(\w+)\s*=\s*("[^"]*"|'[^']*'|\[[^\]]*\]|\{[^}]*\}|\S+)""")


def is_xyz(head: str) -> bool:
    """Return whether a text begins as an XYZ file does: with a line that holds a number of atoms only."""
    return re.match(r"[ \t]*\d+[ \t]*\r?\n", head) is not None


def read_xyz(path: Path, *, frame: int = -1) -> Particles:
    """Read spheres from one frame of an extended XYZ file, whose second line names the columns, ``pos`` and ``radius``
    or ``diameter`` among them, and may give the box.

    Raises
    ------
    FileFormatError
        If there is no such frame, it is cut off, the box is tilted, a column is missing, or a line is wrong.
    """
    lines = text_lines(path, "an extended XYZ file")
    starts, begin = [], 0
    while begin < len(lines):
        count = numbers_of([lines[begin].split()], [begin + 1], path, width=1)[0, 0]
        if not (0 <= count == np.rint(count) and begin + 2 + count <= len(lines)):
            raise FileFormatError(
                f"{path} has {max(len(lines) - begin - 2, 0)} lines of spheres in the frame of line {begin + 1}, which "
                f"says {count:g}: it is cut off; write it again"
            )
        starts.append(begin)
        begin += 2 + int(count)
    start = starts[frame_of(len(starts), frame, path)]
    count = int(float(lines[start]))
    where = f"{path}, line {start + 2}"
    told = {key.lower(): text.strip("\"'[]{}") for key, text in _PAIR.findall(lines[start + 1][:LONGEST_HEAD])}
    places, width = _properties(told.get("properties", ""), where)
    rows, numbers = [line.split() for line in lines[start + 2 : start + 2 + count]], range(start + 3, start + 3 + count)
    texts = sorted(set(range(width)) - {place for name, place in places.items() if name != "id"})
    table = numbers_of(rows, list(numbers), path, width=width, text=texts)
    if "id" in places:
        order_by_id([row[places["id"]] for row in rows], numbers, path)
    centers, radii = table[:, [places[axis] for axis in "xyz"]], radii_of(table, places, path)
    refuse_bad_spheres(centers, radii, path, row="sphere")
    assumed = {"frame": f"the one of line {start + 1}, one of {len(starts)}"} if len(starts) > 1 else {}
    if "lattice" not in told:
        return Particles(centers=centers, radii=radii, assumed=assumed)
    wraps = re.findall(r"true|false|[tf01]", told["pbc"].lower()) if "pbc" in told else ["t"] * 3
    if len(wraps) != 3:
        raise FileFormatError(f"{where}: pbc is {told['pbc'][:40]!r}: three of T and F are needed; mend the line")
    if "pbc" not in told:
        assumed["periodic"] = "everywhere: a file with a lattice that says nothing repeats"
    periodic = "".join(axis for axis, flag in zip("xyz", wraps, strict=True) if flag[0] in "t1")
    bounds, tilt = _bounds(told, path, start + 2)
    container = box_of(bounds, periodic, path, tilt)
    return Particles(centers=centers, radii=radii, container=container, assumed=assumed)


def _properties(text: str, where: str) -> tuple[dict[str, int], int]:
    """Return the places of x, y, z, r, d and id among the columns, and how many there are."""
    words, places, width = text.split(":"), dict[str, int](), 0
    for name, kind, many in zip(words[::3], words[1::3], words[2::3], strict=False):
        size = int(many) if re.fullmatch(r"[1-9]\d{0,2}", many) else 0
        if not size or kind not in tuple("SRIL"):
            raise FileFormatError(
                f"{where}: Properties has {f'{name}:{kind}:{many}'[:40]!r}, which is no column; mend it"
            )
        meant = ["x", "y", "z"] if (name.lower(), size) == ("pos", 3) else [NAMES.get(name.lower(), "")][:size]
        for k, short in enumerate(meant):
            if short in places:
                raise FileFormatError(f"{where}: Properties names {name[:40]} twice: which one holds is not certain")
            if short:
                places[short] = width + k
        width += size
    if not ("z" in places and {"r", "d"} & places.keys()):
        raise FileFormatError(
            f"{where}: the columns are {text[:80] or 'not named'}; pos and radius or diameter are needed, such as "
            "Properties=pos:R:3:radius:R:1"
        )
    return places, width


def _bounds(told: dict[str, str], path: Path, line: int) -> tuple[Floats, Floats]:
    """Return the bounds (3, 2) of a lattice as if it stood upright, and its tilts (3,)."""
    edges = numbers_of([told["lattice"].replace(",", " ").split()], [line], path, width=9).reshape(3, 3)
    lower = numbers_of([told.get("origin", "0 0 0").replace(",", " ").split()], [line], path, width=3)[0]
    return np.column_stack([lower, lower + np.diag(edges)]), tilt_of_edges(edges, path, line)


def read_xyzd(path: Path, *, place: Path | None = None) -> Particles:
    """Read spheres from a ``.xyzd`` file: x, y, z and the diameter of each, the lowest byte first.

    They are in double precision, or in single precision if the size of the file is then that of the number of spheres
    that a file beside it tells; without such a file double precision is assumed.

    The periodic box is that of ``generation.conf`` beside the file. PackingGeneration writes the diameters that it was
    asked for, to which the final ones are proportional: they are scaled to the final porosity that a file of the same
    name with the suffix ``.nfo`` states. `place` is where the file lay before it was unpacked.

    Raises
    ------
    FileFormatError
        If it is cut off, a sphere is not finite or has no size, or box or porosity beside it are out of range.
    """
    raw, place = path.read_bytes(), path if place is None else place
    beside = {one.name: _facts(one) for one in (place.with_suffix(".nfo"), place.with_name("generation.conf"))}
    is_single = any(found.get("n") == [len(raw) / 16] for found in beside.values())
    if len(raw) % 32 and not is_single:
        raise FileFormatError(
            f"{path} has {len(raw)} bytes: each sphere has 32, or 16 in single precision, for which generation.conf or "
            "an .nfo file beside it must tell the number of spheres; it is cut off or damaged"
        )
    table = np.frombuffer(raw, dtype="<f4" if is_single else "<f8").reshape(-1, 4).astype(np.float64)
    with np.errstate(invalid="ignore"):
        centers, radii = table[:, :3], table[:, 3] / 2
    refuse_bad_spheres(centers, radii, path, row="sphere")
    told, assumed = (
        dict[str, list[float]](),
        {"sizes": "diameters as they stand: no .nfo file tells the final porosity"},
    )
    if is_single:
        assumed["precision"] = "single, by the number of spheres that stands beside the file"
    for name, found in beside.items():
        if found.get("n", [len(radii)]) == [len(radii)]:
            told |= found
        else:
            assumed[name] = "not used: it is of another number of spheres"
    if len(told.get("dimensions", ())) != 3 or told.get("boundaries mode", [1.0]) != [1.0]:
        return Particles(centers=centers, radii=radii, assumed=assumed)
    lengths = np.array(told["dimensions"])
    container = box_of(np.column_stack([np.zeros(3), lengths]), "xyz", place.with_name("generation.conf"))
    assumed["periodic"] = "everywhere, in the box that stands beside the file"
    if "final porosity" in told and len(radii):
        porosity = told["final porosity"][0]
        if not 0.0 < porosity < 1.0:
            raise FileFormatError(
                f"{place.with_suffix('.nfo')}: the final porosity is {porosity:g}, which must be between 0 and 1; "
                "mend the file, or move it away"
            )
        solid = 4.0 / 3.0 * np.pi * float(libm.power(radii, 3).sum())
        factor = cube_root(float((1.0 - porosity) * container.volume / solid))
        radii = radii * factor
        assumed["sizes"] = (
            f"diameters, multiplied by {factor:.9g} to the final porosity {porosity:.9g} of the .nfo file"
        )
    return Particles(centers=centers, radii=radii, container=container, assumed=assumed)


def _facts(path: Path) -> dict[str, list[float]]:
    """Return the numbers that a file of PackingGeneration gives by names, in lower case; none without a file."""
    if not path.is_file():
        return {}
    if leads_out(path, path.parent):
        raise FileFormatError(f"{path} is a link to another place: copy the file itself")
    found = {}
    for line in text_lines(path, "text as PackingGeneration writes it"):
        name, _, rest = line.lower().partition(":")
        numbers = itertools.takewhile(_NUMBER.fullmatch, rest.split())
        found[FACTS.get(name.strip(), name.strip())] = [float(word) for word in numbers]
    return found
