"""Blocks for DDA and other codes of polyhedra or polygons: one JSON file with a schema, which people can read too.

Each grain has its own corners and faces in the frame of the container. Faces of polyhedra and convex parts are polygons
into which coplanar triangles are merged; those of meshes are triangles. All run counterclockwise seen from outside.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats, Integers
from voxgran._base.errors import FileFormatError
from voxgran.decks.bodies import Template
from voxgran.decks.convex_parts import convex_parts
from voxgran.decks.engine import Engine, Held
from voxgran.decks.simulation import SETTLING, Simulation
from voxgran.shapes.mesh import Mesh

TITLE = "block codes"
#: name of the file, and what its `format` says
FILE, FORMAT = "blocks.json", "voxgran blocks 1"
#: most that a corner of a face lies off its plane, in lengths of the solid
FLAT = 1e-9
#: fewest faces of a solid
FEWEST_FACES = 4
UNITS = {"length": "m", "mass": "kg", "time": "s", "force": "N", "stress": "Pa", "energy": "J", "angle": "rad"}


def _object(properties: Mapping[str, Any], optional: Sequence[str] = ()) -> dict[str, Any]:
    """Return the schema of an object without other members than these."""
    required = [name for name in properties if name not in optional]
    return {"type": "object", "properties": dict(properties), "required": required, "additionalProperties": False}


def _list(items: Mapping[str, Any], least: int = 0, most: int | None = None) -> dict[str, Any]:
    """Return the schema of a list."""
    return {"type": "array", "items": items, "minItems": least} | ({} if most is None else {"maxItems": most})


TEXT, FLAG, NUMBER, COUNT = ({"type": kind} for kind in ("string", "boolean", "number", "integer"))
POINT = _list(NUMBER, 2, 3)
SOLID = {"vertices": _list(POINT, 3), "faces": _list(_list(COUNT | {"minimum": 0}, 3), 4)}
#: JSON Schema (draft 2020-12) of the file
SCHEMA: Mapping[str, Any] = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": FORMAT} | _object(
    {
        "format": TEXT | {"const": FORMAT},
        "comments": _list(TEXT),
        "units": _object(dict.fromkeys(UNITS, TEXT)),
        "dimension": COUNT | {"enum": [2, 3]},
        "law": _object(
            {
                "name": TEXT | {"enum": ["linear", "hertz"]},
                **dict.fromkeys(
                    (
                        *("density", "stiffness", "shear_stiffness", "young_modulus", "poisson_ratio", "restitution"),
                        *("friction", "cohesion", "damping_ratio"),
                    ),
                    NUMBER,
                ),
            }
        ),
        "gravity": _list(NUMBER, 3, 3),
        "time": _object(dict.fromkeys(("step", "duration", "output", "settling", "rest_energy"), NUMBER)),
        "container": _object(
            {
                "bounds": _list(_list(NUMBER, 3, 3), 2, 2),
                "periodic": _list(FLAG, 3, 3),
                "planes": _list(_object({"name": TEXT, "point": _list(NUMBER, 3, 3), "normal": _list(NUMBER, 3, 3)})),
                "round": _object(
                    {"kind": TEXT | {"enum": ["cylinder", "sphere"]}, "center": _list(NUMBER, 3, 3), "radius": NUMBER}
                ),
                "mesh": _object(SOLID),
            },
            optional=("round", "mesh"),
        ),
        "shapes": _list(
            _object(
                {
                    "name": TEXT,
                    "kind": TEXT | {"enum": ["polyhedron", "mesh", "convex_parts"]},
                    "volume": NUMBER,
                    "approximated": TEXT,
                }
            )
        ),
        "grains": _list(
            _object(
                {
                    "id": COUNT,
                    "shape": TEXT,
                    "scale": NUMBER,
                    "fixed": FLAG,
                    "mass": NUMBER,
                    "centroid": _list(NUMBER, 3, 3),
                    "inertia": _list(_list(NUMBER, 3, 3), 3, 3),
                    "orientation": _list(NUMBER, 4, 4),
                    **SOLID,
                    "parts": _list(_object(SOLID), 1),
                },
                optional=("fixed", "vertices", "faces", "parts"),
            ),
            1,
        ),
    }
)


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the file: one line for each grain."""
    bodies, grains = simulation.bodies, simulation.bodies.assembly
    used = sorted({int(k) for k in grains.shape_id})
    solids = {k: _solids(bodies.templates[k]) for k in used}
    flat = grains.dimension == 2
    lines = []
    for k, shape in enumerate(grains.shape_id.tolist()):
        template = bodies.templates[shape]
        turned = float(grains.scale[k]) * grains.matrices[k].T
        placed = [
            _placed(linear.matmul(points, turned) + grains.position[k], faces, flat) for points, faces in solids[shape]
        ]
        grain = {
            "id": k,
            "shape": template.name,
            "scale": float(grains.scale[k]),
            "mass": float(bodies.mass[k]),
            "centroid": grains.position[k].tolist(),
            "inertia": bodies.inertia[k].tolist(),
            "orientation": grains.orientation[k].tolist(),
            **({} if grains.movable[k] else {"fixed": True}),
        }
        lines.append(json.dumps(grain | ({"parts": placed} if template.kind == "convex_parts" else placed[0])))
    shapes = [_shape(bodies.templates[k]) for k in used]
    head = _head(simulation) | {"shapes": shapes}
    rows = [f'"{name}": {json.dumps(value)}' for name, value in head.items()]
    body = ",\n".join(lines)
    return {FILE: "{\n" + ",\n".join(rows) + ',\n"grains": [\n' + body + "\n]\n}\n"}


def _head(simulation: Simulation) -> dict[str, Any]:
    """Return all but shapes and grains."""
    law = simulation.law
    step, output = simulation.time_step, simulation.steps_per_output
    flat = simulation.bodies.assembly.dimension == 2
    return {
        "format": FORMAT,
        "comments": simulation.header(TITLE) + ["flat: masses are those of a metre of thickness"] * flat,
        "units": UNITS,
        "dimension": simulation.bodies.assembly.dimension,
        "law": {name: getattr(law, name) for name in SCHEMA["properties"]["law"]["properties"]},
        "gravity": simulation.gravity.tolist(),
        "time": {
            "step": step,
            "duration": simulation.duration,
            "output": step * output,
            "settling": SETTLING * simulation.time_unit,
            "rest_energy": simulation.rest_energy,
        },
        "container": _container(simulation),
    }


def _container(simulation: Simulation) -> dict[str, Any]:
    """Return the walls; normals of planes point to the grains."""
    walls = simulation.walls
    planes = [
        {"name": one.name, "point": (np.eye(3)[one.axis] * one.level).tolist(), "normal": one.normal.tolist()}
        for one in walls.planes
    ]
    found: dict[str, Any] = {
        "bounds": walls.bounds.tolist(),
        "periodic": [bool(axis) for axis in walls.periodic],
        "planes": planes,
    }
    if walls.round is not None:
        center, radius = list(walls.round.center), float(walls.round.radius)
        found["round"] = {"kind": walls.round.kind, "center": center, "radius": radius}
    if walls.mesh is not None:
        found["mesh"] = {"vertices": walls.mesh[0].tolist(), "faces": walls.mesh[1].tolist()}
    return found


def _shape(template: Template) -> dict[str, Any]:
    """Return a template: its true volume (area of a flat one) at the scale 1."""
    return {
        "name": template.name,
        "kind": template.kind,
        "volume": float(template.shape.volume),
        "approximated": template.approximated,
    }


def _solids(template: Template) -> list[tuple[Floats, list[list[int]]]]:
    """Return corners and faces of the solids that a grain of scale 1 is made of, in its body frame."""
    shape = template.shape
    if template.kind == "convex_parts":
        return [_faceted(part) for part in convex_parts(shape)]
    if template.kind == "polyhedron":
        return [_faceted(template.polyhedron)]
    return [(shape.vertices, shape.faces.tolist())]


def _placed(points: Floats, faces: list[list[int]], flat: bool) -> dict[str, Any]:
    """Return a solid in the frame of the container; of a flat one its outline."""
    return {"vertices": points[:, :2].tolist()} if flat else {"vertices": points.tolist(), "faces": faces}


def _faceted(mesh: Mesh) -> tuple[Floats, list[list[int]]]:
    """Return the corners of a mesh and its faces as polygons; triangles in one plane make one face."""
    faces: list[list[int]] = []
    for group in _planar(mesh):
        ring = _ring(mesh.faces[group])
        faces += [ring] if ring else mesh.faces[group].tolist()
    if len(faces) < FEWEST_FACES:
        # a part thinner than what counts as one plane
        faces = mesh.faces.tolist()
    used = np.unique([corner for face in faces for corner in face])
    number = {int(old): new for new, old in enumerate(used)}
    return mesh.vertices[used], [[number[corner] for corner in face] for face in faces]


def _planar(mesh: Mesh) -> list[Integers]:
    """Return connected triangles of one plane each, which the largest of them has."""
    corners = mesh.triangles
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = linear.norm(normals, axis=1)
    unit = normals / np.where(sizes > 0, sizes, 1.0)[:, None]
    allowed = FLAT * float(np.ptp(mesh.vertices, axis=0).max())
    heights = sizes / linear.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1)
    beside: dict[tuple[int, int], int] = {}
    for face, (a, b, c) in enumerate(mesh.faces.tolist()):
        beside |= {(a, b): face, (b, c): face, (c, a): face}
    free = np.ones(len(sizes), dtype=np.bool_)
    groups = []
    for seed in np.argsort(-sizes, kind="stable").tolist():
        if not free[seed]:
            continue
        normal, level = unit[seed], float(linear.matmul(corners[seed, 0], unit[seed]))
        ahead, group = [seed], []
        free[seed] = False
        while ahead:
            face = ahead.pop()
            group.append(face)
            a, b, c = mesh.faces[face].tolist()
            for edge in ((b, a), (c, b), (a, c)):
                near = beside.get(edge, seed)
                # the back of a thin solid is no part of this face; a triangle without height has no back
                turned = heights[near] > allowed and linear.matmul(unit[near], normal) < 0
                if free[near] and not turned and np.abs(linear.matmul(corners[near], normal) - level).max() <= allowed:
                    free[near] = False
                    ahead.append(near)
        groups.append(np.array(group, dtype=np.int64))
    return groups


def _ring(triangles: Integers) -> list[int]:
    """Return the corners around connected triangles; none if they have no simple boundary."""
    edges = {(a, b) for t in triangles.tolist() for a, b in zip(t, (*t[1:], t[0]), strict=True)}
    after = {a: b for a, b in edges if (b, a) not in edges}
    count = sum((b, a) not in edges for a, b in edges)
    start = min(after)
    ring = [start]
    while after[ring[-1]] != start and len(ring) <= count:
        ring.append(after[ring[-1]])
    return ring if len(ring) == count == len(after) else []


def _read(folder: Path) -> Held:
    """Return what the file holds; blocks have no spheres.

    Raises
    ------
    FileFormatError
        If the file is of another format.
    """
    found = json.loads((folder / FILE).read_text())
    if not isinstance(found, dict) or found.get("format") != FORMAT:
        raise FileFormatError(f"{folder / FILE} has no format {FORMAT!r}: write the deck again")
    columns = {name: np.array([grain[name] for grain in found["grains"]]) for name in ("mass", "centroid", "inertia")}
    return Held(columns["mass"], columns["centroid"], columns["inertia"], np.zeros((0, 3)), np.zeros(0))


registration = Engine(
    title="Blocks",
    summary="one JSON file: corners, faces, mass and inertia of each grain, contact law and walls",
    upright="which has lengths of periodic axes only",
    source="docs/guide/decks_blocks.md",
    kinds=("polyhedron", "mesh", "convex_parts"),
    planar=True,
    fixed=True,
    verified="held against its schema",
    write=_write,
    read=_read,
)
