"""Reader of the command files of PFC, by the grammar of its documentation."""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError
from voxgran.decks.engine import Held
from voxgran.geometry.rotation import rotation_matrices
from voxgran.shapes.mesh import hull_of

#: names of the file that calls the others, and of that of the grains
RUN, GRAINS = "pfc_run.dat", "pfc_grains.dat"
#: keywords of a contact law
_LAW = {
    "model": "w", "property": "", "kn": "f", "ks": "f", "fric": "f", "dp_nratio": "f", "hz_shear": "f",
    "hz_poiss": "f", "dp_en": "f", "rr_fric": "f",
}  # fmt: skip
#: arguments of each keyword of a command: f number, i whole number, s text in quotes, b on or off, w word, f* numbers,
#: p pebbles, r a range, the last one; "" is what follows the command itself
COMMANDS: Mapping[str, Mapping[str, str]] = {
    "model new": {},
    "model large-strain": {"": "b"},
    "model orientation-tracking": {"": "b"},
    "model energy": {"mechanical": "b"},
    "model domain": {"extent": "ffffff", "condition": "www"},
    "model gravity": {"": "fff"},
    "model mechanical timestep": {"fix": "f"},
    "model cycle": {"": "i"},
    "model save": {"": "s"},
    "program call": {"": "s"},
    "contact cmat default": _LAW,
    "contact cmat add": {"": "i", **_LAW, "range": "r"},
    "ball create": {"id": "i", "radius": "f", "position": "fff", "group": "s"},
    "ball attribute": {"density": "f", "damp": "f", "range": "r"},
    "clump attribute": {"damp": "f"},
    "rblock attribute": {"damp": "f"},
    **{f"{kind} fix": {"velocity": "", "spin": "", "range": "r"} for kind in ("ball", "clump", "rblock")},
    **{f"{kind} group": {"": "s", "range": "r"} for kind in ("ball", "clump", "rblock", "wall")},
    "clump template create": {"name": "s", "pebbles": "p", "volume": "f", "inertia": "ffffff"},
    "clump replicate": {
        "id": "i", "name": "s", "position": "fff", "axis": "fff", "angle": "f", "diameter": "f", "density": "f"
    },
    "rblock create": {"id": "i", "density": "f", "vertices": "f*"},
    "wall create": {"id": "i", "name": "s", "vertices": "f*"},
    "wall servo": {
        "activate": "b", "force-x": "f", "force-y": "f", "force-z": "f", "velocity-max": "f", "range": "r"
    },
}  # fmt: skip
#: words that a `w` may be
WORDS = {"linear", "rrlinear", "hysteretic", "periodic", "stop"}
#: a range: of an id, of several, or of one group or two
RANGE = r"id \d+( \d+)?|group '\w+'( matches 2| group '\w+')?"
NUMBER = r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?"
#: what each kind of argument is
ARGUMENTS = {
    "f": NUMBER,
    "i": r"\d+",
    "s": r"'[\w.]+'|\['\w+' \+ string\(frame\)\]",
    "b": "on|off",
    "w": "|".join(WORDS),
}
#: lines within a FISH function; commands stand between `command` and `endcommand`
FISH = (
    r"(frame|kinetic_energy|missed_stress) = .+",
    rf"loop while frame < {NUMBER}",
    r"endloop",
    rf"if (frame >= \d+|(kinetic_energy|missed_stress) < {NUMBER}) then",
    r"endif",
)


class Statement(NamedTuple):
    """A command with the arguments of each of its keywords."""

    command: str
    given: dict[str, list[Any]]


def read_deck(folder: Path) -> Held:
    """Return what the files of a folder hold.

    Raises
    ------
    FileFormatError
        If a line is not as the documentation of PFC has it, or a template is missing.
    """
    found = list(statements(folder, RUN))
    # by group; that of spheres without a group is under the empty name
    attributes = [one.given for one in found if one.command == "ball attribute"]
    densities = {given.get("range", [""])[-1]: given["density"][0] for given in attributes if "density" in given}
    templates = {one.given["name"][0]: one.given for one in found if one.command == "clump template create"}
    rows: dict[int, tuple[float, Floats, Floats, Floats, Floats]] = {}
    for statement in found:
        given = statement.given
        if statement.command == "ball create":
            row = _sphere(given, densities.get(given.get("group", [""])[0], 0.0))
        elif statement.command == "clump replicate":
            if given["name"][0] not in templates:
                raise FileFormatError(f"{folder / GRAINS} names no template {given['name'][0]!r}: write the deck again")
            row = _clump(given, templates[given["name"][0]])
        elif statement.command == "rblock create":
            row = _block(given)
        else:
            continue
        rows[given["id"][0]] = row
    ordered = [rows[number] for number in sorted(rows)]
    return Held(
        mass=np.array([row[0] for row in ordered]),
        position=np.array([row[1] for row in ordered]).reshape(-1, 3),
        inertia=np.array([row[2] for row in ordered]).reshape(-1, 3, 3),
        centers=np.concatenate([np.zeros((0, 3)), *(row[3] for row in ordered)]),
        radii=np.concatenate([np.zeros(0), *(row[4] for row in ordered)]),
    )


def _sphere(given: dict[str, list[Any]], density: float) -> tuple[float, Floats, Floats, Floats, Floats]:
    """Return mass, centroid, inertia, centers and radii of a sphere."""
    radius, place = given["radius"][0], np.array(given["position"])
    mass = density * 4 / 3 * math.pi * radius**3
    return mass, place, 0.4 * mass * radius**2 * np.eye(3), place[None], np.array([radius])


def _clump(given: dict[str, list[Any]], template: dict[str, list[Any]]) -> tuple[float, Floats, Floats, Floats, Floats]:
    """Return mass, centroid, inertia, centers and radii of a clump."""
    pebbles, place = np.array(template["pebbles"]).reshape(-1, 4), np.array(given["position"])
    volume, density = math.pi / 6 * given["diameter"][0] ** 3, given["density"][0]
    scale = (volume / template["volume"][0]) ** (1 / 3)
    xx, yy, zz, xy, xz, yz = template["inertia"]
    half = math.radians(given.get("angle", [0.0])[0]) / 2
    axis = np.array(given.get("axis", [1.0, 0.0, 0.0]))
    matrix = rotation_matrices(np.array([[math.cos(half), *(math.sin(half) * axis)]]))[0]
    moments = density * scale**5 * np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    centers = linear.matmul(scale * pebbles[:, 1:], matrix.T) + place
    return (
        density * volume,
        place,
        linear.matmul(linear.matmul(matrix, moments), matrix.T),
        centers,
        scale * pebbles[:, 0],
    )


def _block(given: dict[str, list[Any]]) -> tuple[float, Floats, Floats, Floats, Floats]:
    """Return mass, centroid and inertia of a rigid block, which has no spheres."""
    hull, density = hull_of(np.array(given["vertices"]).reshape(-1, 3)), given["density"][0]
    return density * hull.volume, hull.centroid, density * hull.inertia, np.zeros((0, 3)), np.zeros(0)


def statements(folder: Path, name: str) -> Iterator[Statement]:
    """Yield the commands of a file, and of the files that it calls.

    Parameters
    ----------
    folder : Path
        Folder of the files.
    name : str
        Name of the file.

    Raises
    ------
    FileFormatError
        If a line is not as the documentation of PFC has it.
    """
    within: list[str] = []  # open FISH statements
    text = re.sub(r"^;.*\n", "", (folder / name).read_text(), flags=re.MULTILINE)
    for line in re.sub(r" \.\.\.\n *", " ", text).splitlines():
        words = line.strip()
        opened = re.fullmatch(r"fish define \w+|command|(loop|if) .+", words)
        if opened:
            within.append({"fish": "end", "comm": "endcommand", "loop": "endloop"}.get(words[:4], "endif"))
        elif within and words == within[-1]:
            within.pop()
        elif within and within[-1] != "endcommand":
            if not any(re.fullmatch(pattern, words) for pattern in FISH):
                raise FileFormatError(
                    f"{folder / name} has the line {words[:80]!r}: no such statement in FISH; write it again"
                )
        elif words != "[settle]":
            statement = _statement(words, folder / name)
            yield statement
            if statement.command == "program call":
                yield from statements(folder, statement.given[""][0])
    if within:
        raise FileFormatError(f"{folder / name} ends before {within[-1]!r}: write the deck again")


def _statement(line: str, path: Path) -> Statement:
    """Return a command with its arguments.

    Raises
    ------
    FileFormatError
        If PFC has no such command, keyword or argument.
    """
    command = next((one for one in COMMANDS if line == one or line.startswith(f"{one} ")), None)
    if command is None:
        raise FileFormatError(f"{path} has the line {line[:80]!r}: PFC has no such command; write the deck again")
    keywords = COMMANDS[command]
    words = re.findall(r"\[[^\]]*\]|\S+", line[len(command) :])
    given: dict[str, list[Any]] = {}
    if "" in keywords:
        words = ["", *words]
    while words:
        keyword = words.pop(0)
        if keyword not in keywords or keyword in given:
            raise FileFormatError(
                f"{path} gives {keyword!r} to {command!r}: PFC does not take it; write the deck again"
            )
        kinds = keywords[keyword]
        if kinds == "r":
            if not re.fullmatch(RANGE, " ".join(words)):
                raise FileFormatError(
                    f"{path} gives the range {' '.join(words)!r} to {command!r}: write the deck again"
                )
            given[keyword] = [word.strip("'") for word in words]
            break
        if kinds == "p":
            kinds = "f" * (4 * int(words.pop(0)))
        elif kinds == "f*":
            kinds = "f" * next((k for k, word in enumerate(words) if word in keywords), len(words))
        values, words = words[: len(kinds)], words[len(kinds) :]
        good = len(values) == len(kinds) and all(
            re.fullmatch(ARGUMENTS[kind], value) for kind, value in zip(kinds, values, strict=True)
        )
        if not good:
            raise FileFormatError(f"{path} gives {values[:9]} as {keyword!r} of {command!r}: write the deck again")
        given[keyword] = [_value(kind, value) for kind, value in zip(kinds, values, strict=True)]
    return Statement(command, given)


def _value(kind: str, word: str) -> Any:
    """Return an argument as a number or text."""
    return float(word) if kind == "f" else int(word) if kind == "i" else word.strip("'")
