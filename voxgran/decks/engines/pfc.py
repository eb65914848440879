"""PFC of Itasca: spheres, clumps by templates, and convex polyhedra as rigid blocks, as command files.

The commands are those that versions 6, 7 and 9 have in common; a size is given as `diameter`, since the keyword of a
volume differs between the versions.

References
----------
docs.itascacg.com/pfc700, pages of the commands `model domain`, `model mechanical`, `contact cmat default`,
`ball create`, `clump template`, `clump replicate`, `rblock create`, `wall create`, of `linear`, `hysteretic` and FISH.
"""

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.bodies import Template
from voxgran.decks.engine import Engine, Held
from voxgran.decks.facets import facets_of
from voxgran.decks.simulation import SETTLING, Simulation
from voxgran.decks.text import row_of, text_of
from voxgran.geometry.rotation import rotation_matrices
from voxgran.shapes.mesh import hull_of

TITLE = "PFC"
#: names of files
RUN, TEMPLATES, GRAINS, WALLS = "pfc_run.dat", "pfc_clumps.dat", "pfc_grains.dat", "pfc_walls.dat"
#: room between the walls and the bounds of the domain, in median diameters
MARGIN = 2.0
#: largest radius of a sphere, in least extents of the domain
LARGEST_SPHERE = 0.25

#: arguments of each keyword of a command: f number, i whole number, s text in quotes, b on or off, w word, f* numbers,
#: p pebbles; "" is what follows the command itself
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
    "contact cmat default": {
        "model": "w", "property": "", "kn": "f", "ks": "f", "fric": "f", "dp_nratio": "f", "hz_shear": "f",
        "hz_poiss": "f", "dp_en": "f", "rr_fric": "f",
    },
    "ball create": {"id": "i", "radius": "f", "position": "fff", "group": "s"},
    "ball attribute": {"density": "f", "range": "ws"},
    "clump template create": {"name": "s", "pebbles": "p", "volume": "f", "inertia": "ffffff"},
    "clump replicate": {
        "id": "i", "name": "s", "position": "fff", "axis": "fff", "angle": "f", "diameter": "f", "density": "f"
    },
    "rblock create": {"id": "i", "density": "f", "vertices": "f*"},
    "wall create": {"id": "i", "name": "s", "vertices": "f*"},
}  # fmt: skip
#: words that a `w` may be
WORDS = {"linear", "rrlinear", "hysteretic", "periodic", "stop", "group"}
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
    r"(frame|kinetic_energy) = .+",
    rf"loop while frame < {NUMBER}",
    r"endloop",
    rf"if (frame >= \d+|kinetic_energy < {NUMBER}) then",
    r"endif",
)


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the files.

    Raises
    ------
    InputError
        If rigid blocks are to have the law of Hertz or rolling friction, or a sphere is too large for the container.
    """
    law, bodies = simulation.law, simulation.bodies
    curved = "law is 'hertz'" if law.name == "hertz" else "rolling_friction is given" if law.rolling_friction else ""
    if curved and "polyhedron" in bodies.kinds:
        raise InputError(
            f"material {curved} for polyhedra: contacts of PFC's rigid blocks have no radius of curvature, which it "
            "needs; use law='linear' without rolling_friction, or give clump=20"
        )
    low, high = _domain(simulation)
    single = bodies.of_kind("sphere")
    largest = float(bodies.assembly.bounding_radii[single].max(initial=0.0))
    if largest >= LARGEST_SPHERE * float((high - low).min()):
        raise InputError(
            f"container is {float((high - low).min()):g} m wide along a periodic axis, with spheres of the radius "
            f"{largest:g} m: PFC takes radii below a quarter of that; use a larger container"
        )
    files = {RUN: [*_setup(simulation, low, high), *_course(simulation)]}
    if "clump" in bodies.kinds:
        used = {int(k) for k in bodies.assembly.shape_id}
        clumps = [one for k, one in enumerate(bodies.templates) if k in used and one.kind == "clump"]
        files[TEMPLATES] = [line for template in clumps for line in _template(template)]
    files[GRAINS] = _grains(simulation, low, high)
    files[WALLS] = _walls(simulation)
    comments = simulation.comments(TITLE, *_approximations(simulation), mark=";")
    return {name: text_of([*comments, *lines]) for name, lines in files.items()}


def _domain(simulation: Simulation) -> tuple[Floats, Floats]:
    """Return the lower and upper corner of the domain: along periodic axes those of the container."""
    walls = simulation.walls
    reach = 2 * float(simulation.bodies.assembly.bounding_radii.max())
    room = np.where(walls.periodic, 0.0, MARGIN * simulation.diameter + reach)
    return walls.bounds[0] - room, walls.bounds[1] + room


def _setup(simulation: Simulation, low: Floats, high: Floats) -> list[str]:
    """Return the commands that make the model."""
    law, walls, bodies = simulation.law, simulation.walls, simulation.bodies
    if law.name == "linear":
        contact = (
            f"model {'rr' * (law.rolling_friction > 0)}linear property kn {law.stiffness!r} ks {law.shear_stiffness!r} "
            f"fric {law.friction!r} dp_nratio {law.damping_ratio!r}"
            + (f" rr_fric {law.rolling_friction!r}" if law.rolling_friction else "")
        )
    else:
        shear = law.young_modulus / (2 * (1 + law.poisson_ratio))
        contact = (
            f"model hysteretic property hz_shear {shear!r} hz_poiss {law.poisson_ratio!r} fric {law.friction!r} "
            f"dp_en {law.restitution!r}"
        )
    conditions = " ".join("periodic" if axis else "stop" for axis in walls.periodic)
    extent = row_of(np.stack([low, high], axis=1).ravel())
    called = [TEMPLATES] if "clump" in bodies.kinds else []
    return [
        "model new",
        "model large-strain on",
        f"model domain extent {extent}",
        f"model domain condition {conditions}",
        f"contact cmat default {contact}",
        *(f"program call '{name}'" for name in (*called, GRAINS, WALLS)),
        "model energy mechanical on",
        "model orientation-tracking on",
        f"model gravity {row_of(simulation.gravity)}",
        f"model mechanical timestep fix {simulation.time_step!r}",
    ]


def _course(simulation: Simulation) -> list[str]:
    """Return the commands that run until the bed rests, and save the model at each output, from which it goes on."""
    steps = simulation.steps_per_output
    frames = math.ceil(simulation.steps / steps)
    names = {"sphere": "ball", "clump": "clump", "polyhedron": "rblock"}
    parts = [f"{names[kind]}.energy('energy-kinetic')" for kind in sorted(simulation.bodies.kinds)]
    rests = []
    if simulation.gravity.any():
        first = math.ceil(SETTLING * simulation.time_unit / (steps * simulation.time_step))
        rests = [
            f"    if frame >= {first} then",
            f"      if kinetic_energy < {simulation.rest_energy!r} then",
            f"        frame = {frames}",
            "      endif",
            "    endif",
        ]
    return [
        "fish define kinetic_energy",
        f"  kinetic_energy = {' + '.join(parts)}",
        "end",
        "fish define settle",
        "  frame = 0",
        f"  loop while frame < {frames}",
        "    frame = frame + 1",
        "    command",
        f"      model cycle {steps}",
        "      model save ['pfc_frame_' + string(frame)]",
        "    endcommand",
        *rests,
        "  endloop",
        "end",
        "[settle]",
        "model save 'pfc_final'",
    ]


def _template(template: Template) -> list[str]:
    """Return the command that makes the template of a clump, at its own size, in its principal frame."""
    centers, radii = template.spheres
    pebbles = np.column_stack([radii, centers @ template.principal.axes])
    return [
        f"clump template create name '{template.name}' pebbles {len(radii)} ...",
        *(f"  {row_of(pebble)} ..." for pebble in pebbles),
        f"  volume {float(template.shape.volume)!r} inertia {row_of(template.principal.moments)} 0.0 0.0 0.0",
    ]


def _grains(simulation: Simulation, low: Floats, high: Floats) -> list[str]:
    """Return the commands that make all grains; their ids are their numbers, counted from 1."""
    bodies, grains = simulation.bodies, simulation.bodies.assembly
    length = np.where(simulation.walls.periodic, high - low, 1.0)
    places = (
        grains.position - np.where(simulation.walls.periodic, np.floor((grains.position - low) / length), 0) * length
    )
    turns, several = bodies.principal_orientation, isinstance(grains.density, tuple)
    corners = {k: _corners(one) for k, one in enumerate(bodies.templates) if one.kind == "polyhedron"}
    lines = []
    for k, (shape, place) in enumerate(zip(grains.shape_id.tolist(), places, strict=True)):
        template, scale, density = bodies.templates[shape], float(grains.scale[k]), bodies.densities[shape]
        if template.kind == "sphere":
            radius = scale * float(template.spheres[1][0])
            lines.append(f"ball create id {k + 1} radius {radius!r} position {row_of(place)}")
            lines[-1] += f" group '{template.name}'" if several else ""
        elif template.kind == "clump":
            turn = _turn(turns[k])
            diameter = float(grains.diameters[k])
            lines.append(
                f"clump replicate id {k + 1} name '{template.name}' position {row_of(place)}{turn} "
                f"diameter {diameter!r} density {density!r}"
            )
        else:
            points, share = corners[shape]
            lines.append(f"rblock create id {k + 1} density {density * share!r} vertices ...")
            world = (scale * points) @ grains.matrices[k].T + place
            lines += [f"  {row_of(point)} ..." for point in world[:-1]]
            lines.append(f"  {row_of(world[-1])}")
    return [*lines, *_ball_densities(simulation)]


def _ball_densities(simulation: Simulation) -> list[str]:
    """Return the commands that give spheres their density; where densities differ, by the groups of shapes."""
    bodies = simulation.bodies
    used = np.unique(bodies.assembly.shape_id[bodies.of_kind("sphere")])
    if isinstance(bodies.assembly.density, float):
        return [f"ball attribute density {bodies.assembly.density!r}"] if len(used) else []
    return [f"ball attribute density {bodies.densities[k]!r} range group '{bodies.templates[k].name}'" for k in used]


def _turn(quaternion: Floats) -> str:
    """Return a rotation as axis and angle in degrees; empty for none."""
    sine = float(np.linalg.norm(quaternion[1:]))
    if sine == 0.0:
        return ""
    angle = math.degrees(2 * math.atan2(sine, float(quaternion[0])))
    return f" axis {row_of(quaternion[1:] / sine)} angle {angle!r}"


def _corners(template: Template) -> tuple[Floats, float]:
    """Return corners of a polyhedron about its own centroid, and its true volume over that of their convex hull.

    PFC computes mass and centroid from the hull; with this share of the density the mass is the true one.
    """
    shape = template.shape
    points = shape.vertices[np.unique(shape.faces)]
    hull = hull_of(points)
    return points - hull.centroid, float(shape.volume / hull.volume)


def _approximations(simulation: Simulation) -> list[str]:
    """Return what PFC holds only nearly, as sentences."""
    lines = [f"wall {wall.name}: {wall.note}" for wall in facets_of(simulation) if wall.note]
    for template in simulation.bodies.templates:
        if template.kind == "polyhedron":
            points, share = _corners(template)
            true, held = template.shape.inertia, share * hull_of(points).inertia
            error = float(np.linalg.norm(held - true) / np.linalg.norm(true))
            lines.append(
                f"inertia of {template.name}: computed by PFC from the facets, off by {error:.2g} of the true one"
            )
    if simulation.law.name == "hertz":
        lines.append("restitution: the target of PFC's contact model 'hysteretic'")
    return lines


def _walls(simulation: Simulation) -> list[str]:
    """Return the commands that make all walls, of triangles."""
    lines = []
    for number, wall in enumerate(facets_of(simulation), 1):
        triangles = wall.vertices[wall.faces].reshape(-1, 9)
        lines.append(f"wall create id {number} name '{wall.name}' vertices ...")
        lines += [f"  {row_of(triangle)} ..." for triangle in triangles[:-1]]
        lines.append(f"  {row_of(triangles[-1])}")
    return lines


class _Statement(NamedTuple):
    """A command with the arguments of each of its keywords."""

    command: str
    given: dict[str, list[Any]]


def _read(folder: Path) -> Held:
    """Return what the files hold.

    Raises
    ------
    FileFormatError
        If a line is not as the documentation of PFC has it, or a template is missing.
    """
    found = list(_statements(folder, RUN))
    # by group; that of spheres without a group is under the empty name
    attributes = [one.given for one in found if one.command == "ball attribute"]
    densities = {given.get("range", [""])[-1]: given["density"][0] for given in attributes}
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
    centers = scale * pebbles[:, 1:] @ matrix.T + place
    return density * volume, place, matrix @ moments @ matrix.T, centers, scale * pebbles[:, 0]


def _block(given: dict[str, list[Any]]) -> tuple[float, Floats, Floats, Floats, Floats]:
    """Return mass, centroid and inertia of a rigid block, which has no spheres."""
    hull, density = hull_of(np.array(given["vertices"]).reshape(-1, 3)), given["density"][0]
    return density * hull.volume, hull.centroid, density * hull.inertia, np.zeros((0, 3)), np.zeros(0)


def _statements(folder: Path, name: str) -> Iterator[_Statement]:
    """Yield the commands of a file, and of the files that it calls.

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
                yield from _statements(folder, statement.given[""][0])
    if within:
        raise FileFormatError(f"{folder / name} ends before {within[-1]!r}: write the deck again")


def _statement(line: str, path: Path) -> _Statement:
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
    return _Statement(command, given)


def _value(kind: str, word: str) -> Any:
    """Return an argument as a number or text."""
    return float(word) if kind == "f" else int(word) if kind == "i" else word.strip("'")


registration = Engine(
    name="pfc",
    title=TITLE,
    summary="command files: spheres, clumps by templates, rigid blocks, walls of facets, and a run until rest",
    source="docs.itascacg.com/pfc700",
    kinds=("sphere", "polyhedron", "clump"),
    rolling=("linear",),
    verified="not run; read back by the grammar of its documentation",
    command=f"program call '{RUN}' in PFC3D",
    write=_write,
    read=_read,
)
