"""Clumps in files, one set of spheres each: tables ``x,y,z,r``, lines ``x y z r clumpId`` of YADE, molecules of LAMMPS.

Mass properties of unit density stand in comments ``# volume =``, ``# centroid =`` and ``# inertia =`` (xx, yy, zz, xy,
xz, yz, about the centroid), which are used where all three are there. Other comments are skipped, also those of Chrono
with moments of inertia, whose scale they do not tell. A molecule file without the three comments states a mass of
unknown density: its center of mass and the ratio of inertia and mass are used, with the volume of the union of the
spheres.

References
----------
Formats: docs.lammps.org, page `molecule`; `ymport.textClumps` of YADE; ``data/clumps`` of Chrono DEM-Engine.
"""

import logging
import os
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import LONGEST, SHORTEST, Floats, as_positive
from voxgran._base.errors import FileFormatError, InputError, with_article
from voxgran._base.files import as_path, existing_file, output_suffix, written_whole
from voxgran._base.units import known_unit
from voxgran.shapes.formats.columns import cells_in, columns_of, places_of, table_text
from voxgran.shapes.formats.mesh_files import READERS as MESHES
from voxgran.shapes.images.image_files import READERS as IMAGES
from voxgran.shapes.model import Shape
from voxgran.shapes.primitive import Primitive
from voxgran.shapes.spheres import MassProperties, Spheres

log = logging.getLogger(__name__)

#: suffixes of tables, of lines for YADE, and of molecules
TABLES, LINES, MOLECULES = (".csv",), (".txt", ".xyzr"), (".mol", ".molecule")
SUFFIXES = (*TABLES, *LINES, *MOLECULES)
#: suffixes of point clouds, whose rows of four numbers are no spheres
CLOUDS = (".xyz", ".xyzn")
#: bytes that are looked at to recognize a file
HEAD = 4096
#: largest number of spheres of a clump in a file
MOST_SPHERES = 20_000
#: distance of the centroid from the origin, in bounding radii, up to which a file is centered
CENTERED = 1e-13
#: places of xx, yy, zz, xy, xz, yz in a tensor
PLACES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
#: place of what a named column holds, -3 for a diameter
COLUMNS = {"x": 0, "y": 1, "z": 2, "r": 3, "d": -3, "clump": 4}
#: comment of a molecule file whose mass properties are those of the union of its spheres
OF_UNION = "# mass properties of the union"
_COMMENT = re.compile(r"#\s*(?:(volume|centroid|inertia|unit)\s*=|(unit)\s)\s*(.*)")
_NUMBER = re.compile(r"[-+.0-9]")


@dataclass(slots=True)
class _Found:
    """What a file holds."""

    path: Path
    rows: list[list[float]] = field(default_factory=list)  # x, y, z, r
    clumps: set[float] = field(default_factory=set)
    #: mass properties and unit by their names
    told: dict[str, list[float]] = field(default_factory=dict)
    unit: str | None = None
    of_union: bool = False

    def refused(self, number: int, what: str, rule: str) -> FileFormatError:
        """Return the error of a line."""
        return FileFormatError(f"{self.path}, line {number}: {what[:60]!r} {rule}; mend or remove the line")

    def numbers(self, words: Iterable[str], number: int, rule: str) -> list[float]:
        """Return the numbers of a line."""
        given = list(words)
        try:
            values = [float(word) for word in given]
        except ValueError:
            raise self.refused(number, " ".join(given), rule) from None
        if not np.isfinite(values).all():
            raise self.refused(number, " ".join(given), f"{rule}, all finite")
        return values

    def comment(self, line: str, number: int) -> None:
        """Take over what a comment tells."""
        found = _COMMENT.match(line.strip())
        self.of_union = self.of_union or line.strip() == OF_UNION
        if found is None:
            return
        name, text = found[1] or found[2], found[3].strip()
        if name == "unit":
            self.unit = known_unit(text)
            return
        count = {"volume": 1, "centroid": 3, "inertia": 6}[name]
        values = self.numbers(text.replace(",", " ").split(), number, f"is no {name} of {count} numbers")
        if len(values) != count:
            raise self.refused(number, text, f"is no {name} of {count} numbers")
        self.told[name] = values

    def sphere(self, values: list[float], number: int) -> None:
        """Take over one sphere, x, y, z, r."""
        good = max(map(abs, values)) <= LONGEST and values[3] >= SHORTEST
        if not good:
            text = " ".join(f"{value:g}" for value in values)
            raise self.refused(
                number,
                text,
                f"is no x y z r: coordinates are at most {LONGEST:g}, radii from {SHORTEST:g} to {LONGEST:g}",
            )
        if len(self.rows) == MOST_SPHERES:
            raise FileFormatError(
                f"{self.path} holds more than {MOST_SPHERES} spheres: a clump has fewer; read a packing of "
                "spheres with vg.load"
            )
        self.rows.append(values)


def is_spheres(path: Path) -> bool:
    """Return whether a file holds the spheres of a clump, by its suffix or, where no format has that, its content."""
    suffix = path.suffix.lower()
    if suffix in (*SUFFIXES, *MESHES, *IMAGES, *CLOUDS) or not path.is_file():
        return suffix in SUFFIXES
    with existing_file(path).open("rb") as file:
        lines = file.read(HEAD).decode("utf-8", errors="replace").splitlines()
    words = next((re.split(r"[,;\s]+", text) for line in lines if (text := line.partition("#")[0].strip())), [])
    rows = len(words) in (4, 5) and all(_is_number(word) for word in words)
    named = {"x", "y", "z"} <= (names := places_of(words).keys()) and bool({"r", "d"} & names)
    return rows or named or any(re.match(r"\s*Coords\b", line) for line in lines)


def _is_number(word: str) -> bool:
    """Return whether a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def read_spheres(path: str | os.PathLike[str], *, unit: str | None = None) -> Shape:
    """Return the shape of the spheres of a clump file, named as the file without its suffix.

    Parameters
    ----------
    path : path-like
        Table, lines or molecule, recognized by its content.
    unit : str, optional
        Unit of lengths; default: as the file says.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the file is no text, empty, damaged or a packing, or holds several clumps.
    """
    found = _Found(existing_file(path))
    lines = table_text(found.path).splitlines()
    for number, line in enumerate(lines, 1):
        mark = line.find("#")
        if mark >= 0:
            if line.startswith("# container "):
                raise FileFormatError(f"{path}, line {number}: a container makes it a packing: read it with vg.load")
            found.comment(line[mark:], number)
    molecule = any(re.match(r"\s*\d+\s+atoms\b", line) for line in lines[1:40])
    mass = _read_molecule(found, lines) if molecule else _read_table(found, lines)
    if not found.rows:
        raise FileFormatError(f"{path} holds no sphere: a clump has at least one line x y z r; write it again")
    if len(found.clumps) > 1:
        known = ", ".join(f"{value:g}" for value in sorted(found.clumps)[:5])
        known += ", ..." if len(found.clumps) > 5 else ""
        raise FileFormatError(
            f"{path} holds {len(found.clumps)} clumps ({known}): a shape is one; "
            "keep the lines of one, or read a packing of clumps with vg.load"
        )
    table = np.array(found.rows)
    try:
        geometry = Spheres(table[:, :3], table[:, 3])
        geometry = Spheres(geometry.centers, geometry.radii, _mass(found, geometry, mass))
        name, stated = found.path.stem, unit or found.unit
        # what is centered but for rounding keeps its bits
        if float(np.abs(geometry.centroid).max()) <= CENTERED * geometry.bounding_radius:
            return Shape(geometry, name, (0.0, 0.0, 0.0), stated)
        return Shape.of(geometry, name=name, unit=stated)
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error


def _mass(found: _Found, union: Spheres, molecule: dict[str, list[float]]) -> MassProperties | None:
    """Return the mass properties that a file tells in comments, or in the head of a molecule; None if it does not."""
    told = found.told
    if len(told) == 3:
        return MassProperties(told["volume"][0], np.array(told["centroid"]), _tensor(told["inertia"]))
    if told:
        log.info("%s: %s alone is not used: the mass properties are those of the spheres", found.path, ", ".join(told))
    if found.of_union or not {"mass", "com", "inertia"} <= molecule.keys():
        return None
    mass = as_positive(molecule["mass"][0], "mass")
    return MassProperties(union.volume, np.array(molecule["com"]), _tensor(molecule["inertia"]) * (union.volume / mass))


def _tensor(values: list[float]) -> Floats:
    """Return the tensor with the elements xx, yy, zz, xy, xz, yz."""
    made = np.zeros((3, 3))
    for value, (i, j) in zip(values, PLACES, strict=True):
        made[i, j] = made[j, i] = value
    return made


def _read_table(found: _Found, lines: list[str]) -> dict[str, list[float]]:
    """Read the rows of a table with or without names of columns, separated by commas, semicolons or blanks."""
    columns: list[tuple[int, float] | None] | None = None
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].strip()
        if not text:
            continue
        # lines of YADE may hold tabs and blanks
        words = cells_in(text.replace("\t", " "))
        words = words[:-1] if len(words) > 1 and not words[-1] else words
        if columns is None:
            columns = _columns(found, words, number)
            if not _NUMBER.match(words[0]):
                continue
        if len(words) != len(columns):
            raise found.refused(number, text, f"has {len(words)} values, the first line {len(columns)}")
        needed = [(column, word) for column, word in zip(columns, words, strict=True) if column is not None]
        given = found.numbers((word for _, word in needed), number, "is no x y z r")
        values = {place: factor * value for ((place, factor), _), value in zip(needed, given, strict=True)}
        radius = values[3] if 3 in values else values[-3] / 2
        found.sphere([values[0], values[1], values[2], radius], number)
        if 4 in values:
            found.clumps.add(values[4])
    return {}


def _columns(found: _Found, words: list[str], number: int) -> list[tuple[int, float] | None]:
    """Return what each column is: its place in x, y, z, r, clump, -3 for a diameter, with the factor that brings it to
    the unit of the others, or None.
    """
    if _NUMBER.match(words[0]):
        if len(words) not in (4, 5):
            raise found.refused(
                number, " ".join(words), f"has {len(words)} values: a line is x y z r or x y z r clumpId"
            )
        return [(place, 1.0) for place in range(len(words))]
    named = ["clump" if word.lower() == "id" else word for word in words]
    known = columns_of(named, f"{found.path}, line {number}", stated=found.unit)
    if not {"x", "y", "z"} <= known.places.keys() or ("r" in known.places) == ("d" in known.places):
        raise found.refused(number, " ".join(words), "does not name the columns x, y, z and r once each")
    found.unit = found.unit or known_unit(known.unit)
    by_place = {
        known.places[name]: (COLUMNS[name], known.factors.get(name, 1.0)) for name in known.places if name in COLUMNS
    }
    return [by_place.get(place) for place in range(len(words))]


def _read_molecule(found: _Found, lines: list[str]) -> dict[str, list[float]]:
    """Read a molecule file; return mass, com and inertia of its head."""
    head: dict[str, list[float]] = {}
    counts = {"mass": 1, "com": 3, "inertia": 6, "atoms": 1}
    sections: dict[str, dict[int, list[float]]] = {}
    section, wanted = "", {"Coords": 3, "Diameters": 1}
    for number, line in enumerate(lines[1:], 2):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if words[0][0].isalpha():
            section = words[0]
            sections.setdefault(section, {})
        elif not section and words[-1] in counts:
            rule = f"are no {counts[words[-1]]} numbers of {words[-1]}"
            head[words[-1]] = found.numbers(words[:-1], number, rule)
            if len(words) != 1 + counts[words[-1]]:
                raise found.refused(number, " ".join(words), rule)
        elif section in wanted:
            values = found.numbers(words, number, f"is no line of {section}")
            if len(values) != 1 + wanted[section] or values[0] != round(values[0]) or abs(values[0]) > MOST_SPHERES:
                raise found.refused(number, " ".join(words), f"is no line of {section} with the number of an atom")
            if int(values[0]) in sections[section]:
                raise found.refused(number, " ".join(words), f"is the second line of this atom in {section}")
            sections[section][int(values[0])] = values[1:]
    count = head["atoms"][0] if "atoms" in head else -1.0
    for name in wanted:
        given = len(sections.get(name, {}))
        if given != count:
            raise FileFormatError(
                f"{found.path} has {given} lines in the section {name} for {count:g} atoms: a clump has Coords and "
                "Diameters of each; write it again"
            )
    if sections["Coords"].keys() != sections["Diameters"].keys():
        raise FileFormatError(f"{found.path} has Coords and Diameters of different atoms: number them alike")
    for atom in sorted(sections["Coords"]):
        found.sphere([*sections["Coords"][atom], sections["Diameters"][atom][0] / 2], 1)
    return head


def write_spheres(shape: Shape, path: str | os.PathLike[str], *, overwrite: bool = False, density: float = 1.0) -> None:
    """Write a shape of spheres to a clump file.

    Parameters
    ----------
    shape : Shape
        Sphere or union of spheres, in its body frame.
    path : path-like
        File with one of the suffixes `SUFFIXES`.
    overwrite : bool
        Whether a file that is there may be replaced.
    density : float
        Density of the material, for the masses of a molecule file.

    Raises
    ------
    FileFormatError
        If the suffix is unknown.
    InputError
        If the shape has another geometry, or the density is not above 0, or not 1 for a format without masses.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written.
    """
    target, suffix = as_path(path), clump_suffix(path)
    factor = as_positive(density, "density")
    if factor != 1.0 and suffix not in MOLECULES:
        raise InputError(
            f"density is {factor:g} for {target}: only {' and '.join(MOLECULES)} hold masses; leave it out"
        )
    text = text_of_spheres(shape, suffix, density=factor)
    with written_whole(target, overwrite=overwrite) as draft:
        draft.write_text(text, encoding="utf-8")


def text_of_spheres(shape: Shape, suffix: str, *, density: float = 1.0) -> str:
    """Return the text of a clump file.

    Parameters
    ----------
    shape : Shape
        Sphere or union of spheres, in its body frame.
    suffix : str
        One of `SUFFIXES`.
    density : float
        Density of the material, for the masses of a molecule file.

    Raises
    ------
    InputError
        If the shape has another geometry.
    """
    spheres = _spheres_of(shape)
    unit = "" if shape.unit is None else f"# unit = {shape.unit}\n"
    if suffix in TABLES:
        return "x,y,z,r\n" + _rows(spheres, ",") + unit + _told(spheres)
    if suffix in LINES:
        return "# x y z r clumpId\n" + unit + _told(spheres) + _rows(spheres, " ", " 0")
    return _molecule(spheres, shape, unit, density)


def clump_suffix(path: str | os.PathLike[str]) -> str:
    """Return the suffix, in small letters, of a file that spheres can be written to.

    Raises
    ------
    FileFormatError
        If the suffix is unknown.
    """
    return output_suffix(path, SUFFIXES, "clumps are kept")


def _spheres_of(shape: Shape) -> Spheres:
    """Return the spheres of a shape.

    Raises
    ------
    InputError
        If it has another geometry.
    """
    geometry = shape.geometry
    if isinstance(geometry, Spheres):
        return geometry
    if isinstance(geometry, Primitive) and geometry.kind == "sphere":
        return Spheres(np.zeros((1, 3)), np.array(geometry.dimensions))
    kind = geometry.kind if isinstance(geometry, Primitive) else type(geometry).__name__.lower()
    raise InputError(
        f"shape {shape.name!r} is {with_article(kind)}: clump files hold spheres; write the clump of fit_clump instead"
    )


def _rows(spheres: Spheres, mark: str, end: str = "") -> str:
    """Return one line for each sphere."""
    table = np.column_stack([spheres.centers, spheres.radii]).tolist()
    return "".join(mark.join(map(repr, row)) + end + "\n" for row in table)


def _told(spheres: Spheres) -> str:
    """Return the comments with mass properties, where they are not those of the union."""
    if spheres.mass is None:
        return ""
    mass = spheres.mass
    elements = [float(mass.inertia[place]) for place in PLACES]
    lines = {"volume": [mass.volume], "centroid": mass.centroid.tolist(), "inertia": elements}
    return "".join(f"# {name} = {', '.join(map(repr, values))}\n" for name, values in lines.items())


def _molecule(spheres: Spheres, shape: Shape, unit: str, density: float) -> str:
    """Return the molecule file of spheres; the mass of the atoms is shared out by their volumes."""
    mass = density * shape.volume
    elements = [density * float(shape.inertia[place]) for place in PLACES]
    each = mass * libm.power(spheres.radii, 3) / libm.power(spheres.radii, 3).sum()
    com = spheres.centroid if spheres.mass is not None else np.zeros(3)
    told = _told(spheres) or f"{OF_UNION}\n"
    head = f"# clump {' '.join(shape.name.split())}\n{unit}{told}\n{len(each)} atoms\n{mass!r} mass\n"
    head += " ".join(map(repr, com.tolist())) + " com\n" + " ".join(map(repr, elements)) + " inertia\n"
    columns: dict[str, Callable[[int], str]] = {
        "Coords": lambda k: " ".join(map(repr, spheres.centers[k].tolist())),
        "Types": lambda _: "1",
        "Diameters": lambda k: repr(2 * float(spheres.radii[k])),
        "Masses": lambda k: repr(float(each[k])),
    }
    for name, text in columns.items():
        head += f"\n{name}\n\n" + "".join(f"{k + 1} {text(k)}\n" for k in range(len(each)))
    return head
