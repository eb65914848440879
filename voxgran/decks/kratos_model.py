"""Model files of Kratos: grains, clusters of spheres and walls as .mdpa and .clu text, written and read."""

import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.bodies import Bodies, Template
from voxgran.decks.facets import facets_of
from voxgran.decks.simulation import Simulation

#: identification numbers of materials: grains that are spheres, walls, and the first template that is a clump
SPHERES, WALLS, FIRST_CLUMP = 1, 2, 3
#: most shapes that are clumps
MOST_CLUMPS = 200


def clumps_of(bodies: Bodies) -> dict[int, int]:
    """Return the identification number of the material of each template that grains are clumps of, by its number.

    Raises
    ------
    InputError
        If there are too many of them.
    """
    used = np.unique(bodies.assembly.shape_id[bodies.of_kind("clump")]).tolist()
    if len(used) > MOST_CLUMPS:
        raise InputError(
            f"packing has clumps of {len(used)} shapes: each is a material of Kratos, and the file of all pairs of "
            f"materials is written for at most {MOST_CLUMPS}; use fewer shapes, or engine 'lammps'"
        )
    return {number: FIRST_CLUMP + place for place, number in enumerate(used)}


def spheres_of(simulation: Simulation) -> list[tuple[int, str, int, float, Integers]]:
    """Return the materials of grains that are spheres: identification number, name, number of the material in the table
    of laws, density in kg/m^3, and the grains.

    There is one for each material and density; the numbers of those after the first follow those of clumps.
    """
    bodies, of_shapes = simulation.bodies, np.array(simulation.laws.of_shapes)
    mine = bodies.of_kind("sphere")
    kinds, densities = of_shapes[bodies.assembly.shape_id[mine]], bodies.assembly.densities[mine]
    every = dict.fromkeys(zip(of_shapes.tolist(), bodies.densities, strict=True))
    found = [one for one in every if ((kinds == one[0]) & (densities == one[1])).any()]
    if not found:
        # the material of spheres is there without any
        return [(SPHERES, "spheres", 0, bodies.densities[0], mine)]
    after = FIRST_CLUMP + len(clumps_of(bodies)) - 1
    return [
        (
            after + k if k else SPHERES,
            f"spheres_{k + 1}" if k else "spheres",
            kind,
            density,
            mine[(kinds == kind) & (densities == density)],
        )
        for k, (kind, density) in enumerate(found)
    ]


def sphere_text(simulation: Simulation, comments: Sequence[str]) -> str:
    """Return the .mdpa file of the grains that are spheres; their ids are those of the grains, counted from 1."""
    bodies = simulation.bodies
    centers, radii, grain = bodies.spheres
    mine = np.isin(grain, bodies.of_kind("sphere"))
    ids = (grain[mine] + 1).tolist()
    materials, material = spheres_of(simulation), np.zeros(bodies.count, dtype=np.int64)
    for number, *_, grains in materials:
        material[grains] = number
    elements = [f"{number} {material[number - 1]} {number}" for number in ids]
    parts = [(name.title(), (grains + 1).tolist()) for _, name, *_, grains in materials]
    lines = [
        *_comments(comments),
        *_block("ModelPartData", []),
        *(line for number, *_ in materials for line in _block(f"Properties {number}", [])),
        *_block("Nodes", _rows(ids, centers[mine])),
        *_block("Elements SphericParticle3D", elements),
        *_block("NodalData RADIUS", _rows(ids, radii[mine, None], "0 ")),
        *(line for name, own in parts for line in _part(name, [], Nodes=own, Elements=own)),
    ]
    return _text(lines)


def cluster_text(simulation: Simulation, comments: Sequence[str]) -> str:
    """Return the .mdpa file of the grains that are clumps; their ids are those of the grains, counted from 1.

    The frame of a cluster is the principal frame of its template, and the orientation is written as (x, y, z, w).

    Raises
    ------
    InputError
        If there are clumps of too many shapes.
    """
    bodies = simulation.bodies
    shape_id, scale = bodies.assembly.shape_id, bodies.assembly.scale
    materials = clumps_of(bodies)
    mine = bodies.of_kind("clump")
    ids = (mine + 1).tolist()
    lengths = scale[mine] * np.array([template.shape.diameter for template in bodies.templates])[shape_id[mine]]
    turned = np.roll(bodies.principal_orientation[mine], -1, axis=1).tolist()
    lines = [*_comments(comments), *_block("ModelPartData", [])]
    for material in materials.values():
        lines += _block(f"Properties {material}", [])
    elements = [f"{grain + 1} {materials[int(shape_id[grain])]} {grain + 1}" for grain in mine.tolist()]
    orientations = [
        f"{number} 0 [4] ( {' , '.join(map(repr, xyzw))} )" for number, xyzw in zip(ids, turned, strict=True)
    ]
    lines += [
        *_block("Nodes", _rows(ids, bodies.assembly.position[mine])),
        *_block("Elements Cluster3D", elements),
        *_block("NodalData CHARACTERISTIC_LENGTH", _rows(ids, lengths[:, None], "0 ")),
        *_block("NodalData ORIENTATION", orientations),
    ]
    for number in materials:
        own = (np.flatnonzero(shape_id == number) + 1).tolist()
        lines += _part(bodies.templates[number].name, [], Nodes=own, Elements=own)
    return _text(lines)


def walls_of(simulation: Simulation) -> list[tuple[int, str, int, list[str]]]:
    """Return the materials of walls: identification number, name, number of the material in the table of laws, and the
    names of the walls.

    The numbers of those after the first follow those of spheres and clumps.
    """
    of_walls = simulation.laws.of_walls
    found = list(dict.fromkeys(of_walls.values())) or [0]
    used = [SPHERES, WALLS, *clumps_of(simulation.bodies).values(), *(one[0] for one in spheres_of(simulation))]
    return [
        (
            max(used) + k if k else WALLS,
            f"walls_{k + 1}" if k else "walls",
            kind,
            [name for name, own in of_walls.items() if own == kind],
        )
        for k, kind in enumerate(found)
    ]


def wall_text(simulation: Simulation, comments: Sequence[str]) -> str:
    """Return the .mdpa file of walls, as rigid triangles that stand still."""
    walls, materials = facets_of(simulation), walls_of(simulation)
    material = {name: number for number, *_, names in materials for name in names}
    notes = [f"wall {wall.name}: {wall.note}" for wall in walls if wall.note]
    firsts = [0, *itertools.accumulate(len(wall.vertices) for wall in walls)]
    counts = [0, *itertools.accumulate(len(wall.faces) for wall in walls)]
    vertices = np.concatenate([np.zeros((0, 3)), *(wall.vertices for wall in walls)])
    faces = [wall.faces + first + 1 for wall, first in zip(walls, firsts[:-1], strict=True)]
    corners = np.concatenate([np.zeros((0, 3), dtype=np.int64), *faces]).tolist()
    kinds = [material[wall.name] for wall in walls for _ in wall.faces]
    numbered = enumerate(zip(kinds, corners, strict=True), 1)
    triangles = [f"{k} {kind} {a} {b} {c}" for k, (kind, (a, b, c)) in numbered]
    lines = [
        *_comments([*comments, *notes]),
        *_block("ModelPartData", []),
        *(line for number, *_ in materials for line in _block(f"Properties {number}", [])),
        *_block("Nodes", _rows(range(1, len(vertices) + 1), vertices)),
        *_block("Conditions RigidFace3D3N", triangles),
    ]
    for k, wall in enumerate(walls):
        nodes, conditions = (range(ends[k] + 1, ends[k + 1] + 1) for ends in (firsts, counts))
        still = ["FIXED_MESH_OPTION 0", "RIGID_BODY_MOTION 0", "FREE_BODY_MOTION 0", "IS_GHOST 0"]
        data = [*still, f"IDENTIFIER {wall.name}", "FORCE_INTEGRATION_GROUP 0"]
        lines += _part(wall.name, data, Nodes=nodes, Conditions=conditions)
    return _text(lines)


def clu_text(template: Template, comments: Sequence[str]) -> str:
    """Return the .clu file of a template that is a clump, at its own size, in its principal frame."""
    shape, frame = template.shape, template.principal
    centers, radii = template.spheres
    diameter, volume = float(shape.diameter), float(shape.volume)
    spheres = np.column_stack([linear.matmul(centers, frame.axes), radii]).tolist()
    lines = [
        *_comments(comments),
        "Name",
        template.name,
        "",
        "Begin centers_and_radii",
        *(" ".join(map(repr, row)) for row in spheres),
        "End centers_and_radii",
        "",
        "Particle_center_and_diameter",
        f"0.0 0.0 0.0 {diameter!r}",
        "",
        "Size",
        repr(diameter),
        "",
        "Volume",
        repr(volume),
        "",
        "Inertia per unit mass",
        *(repr(float(moment)) for moment in frame.moments / volume),
    ]
    return _text(lines)


class Cluster(NamedTuple):
    """What a .clu file holds."""

    centers: Floats  # (s, 3), about the centroid, in the principal frame
    radii: Floats  # (s,)
    size: float
    volume: float
    inertia: Floats  # (3,), per unit mass


def read_clu(path: Path) -> Cluster:
    """Return what a .clu file holds.

    Raises
    ------
    FileFormatError
        If a section is missing or holds no numbers.
    """
    lines = [line.strip() for line in path.read_text(encoding="utf-8").splitlines()]
    lines = [line for line in lines if line and not line.startswith("//")]
    try:
        first, last = lines.index("Begin centers_and_radii"), lines.index("End centers_and_radii")
        spheres = np.array([line.split() for line in lines[first + 1 : last]], dtype=float).reshape(-1, 4)
        center = np.array(lines[lines.index("Particle_center_and_diameter") + 1].split()[:3], dtype=float)
        size, volume = (float(lines[lines.index(name) + 1]) for name in ("Size", "Volume"))
        at = lines.index("Inertia per unit mass")
        inertia = np.array(lines[at + 1 : at + 4], dtype=float)
    except (ValueError, IndexError) as error:
        raise FileFormatError(f"{path} is no cluster file of Kratos: {error}; write the deck again") from error
    return Cluster(spheres[:, :3] - center, spheres[:, 3], size, volume, inertia)


def read_mdpa(path: Path, *needed: str) -> list[list[list[str]]]:
    """Return the words of each line of some blocks of an .mdpa file, such as ``"Nodes"``, of which it has one each.

    Raises
    ------
    FileFormatError
        If a block is missing or does not end.
    """
    blocks: dict[str, list[list[str]]] = {}
    open_blocks: list[str] = []
    for line in path.read_text(encoding="utf-8").splitlines():
        words = line.split("//")[0].translate(str.maketrans("(),", "   ")).split()
        if words[:1] == ["Begin"]:
            open_blocks.append(" ".join(words[1:]))
            if len(open_blocks) == 1:
                blocks[open_blocks[0]] = []
        elif words[:1] == ["End"]:
            del open_blocks[-1:]
        elif words and len(open_blocks) == 1:
            blocks[open_blocks[0]].append(words)
    if open_blocks:
        raise FileFormatError(f"{path} ends within its block {open_blocks[-1]!r}: write the deck again")
    missing = [name for name in needed if name not in blocks]
    if missing:
        raise FileFormatError(f"{path} has no block {missing[0]!r}: write the deck again")
    return [blocks[name] for name in needed]


def _comments(lines: Iterable[str]) -> list[str]:
    """Return lines as comments."""
    return [f"// {line}" for line in lines]


def _block(name: str, lines: Iterable[str]) -> list[str]:
    """Return a block of an .mdpa file."""
    return [f"Begin {name}", *(f"  {line}" for line in lines), f"End {name.split()[0]}", ""]


def _part(name: str, data: Iterable[str], **members: Iterable[int]) -> list[str]:
    """Return a sub model part with the ids of its nodes, elements and conditions."""
    lines = _block("SubModelPartData", data)
    for kind in ("Nodes", "Elements", "Conditions"):
        lines += _block(f"SubModelPart{kind}", map(str, members.get(kind, ())))
    return _block(f"SubModelPart {name}", lines)


def _rows(ids: Iterable[int], values: Floats, before: str = "") -> list[str]:
    """Return a line with id and numbers for each row of values."""
    return [f"{number} {before}{' '.join(map(repr, row))}" for number, row in zip(ids, values.tolist(), strict=True)]


def _text(lines: Iterable[str]) -> str:
    """Return lines as the text of a file."""
    return "\n".join(line.rstrip() for line in lines) + "\n"
