"""Contact laws and walls in the commands of LIGGGHTS."""

import itertools
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran.decks.engine import row_of, text_of
from voxgran.decks.facets import Facets, facets_of
from voxgran.decks.simulation import Simulation

#: the range of Young's modulus that LIGGGHTS takes without further words
SOFT, HARD = 5e6, 1e9


def models_of(simulation: Simulation) -> tuple[str, str]:
    """Return the contact models, and their settings, which follow the walls in commands of walls."""
    models = "luding tangential tan_luding" if simulation.law.name == "linear" else "hertz tangential history"
    models += " rolling_friction cdt" if simulation.laws.rolls else ""
    return f"model {models}", "tangential_damping on limitForce off"


def property_commands(simulation: Simulation) -> list[str]:
    """Return the parameters of the contact law."""
    laws, many = simulation.laws, simulation.laws.count
    pairs: dict[str, Any] = {
        "coefficientRestitution": laws.matrix("restitution"), "coefficientFriction": laws.matrix("friction")
    }  # fmt: skip
    if laws.rolls:
        pairs["coefficientRollingFriction"] = laws.matrix("rolling_friction")
    lines = []
    if simulation.law.name == "linear":
        pairs |= {
            "LoadingStiffness": laws.matrix("stiffness"),
            # over that of loading, at an overlap of 500 diameters: at usual ones it is equal up to 1e-9
            "UnloadingStiffness": 1.001,
            "coefficientPlasticityDepth": 1.0,
            "coefficientAdhesionStiffness": 0.0,
            "pullOffForce": 0.0,
            "coeffFrictionStiffness": [[law.shear_stiffness / law.stiffness for law in row] for row in laws.laws],
            # tangential over normal damping
            "FrictionViscosity": 1.0,
            # dynamic over static friction: the tangential model `tan_luding` reads it under this name
            "FluidViscosity": 1.0,
        }
    else:
        # the modulus of a pair follows from those of its materials
        own = {"youngsModulus": "young_modulus", "poissonsRatio": "poisson_ratio"}
        each = {name: [getattr(laws.laws[k][k], value) for k in range(many)] for name, value in own.items()}
        if min(each["youngsModulus"]) < SOFT:
            lines.append("soft_particles yes")
        if max(each["youngsModulus"]) > HARD:
            lines.append("hard_particles yes")
        for name, values in each.items():
            lines.append(f"fix {name} all property/global {name} peratomtype {row_of(values)}")
    tables = {name: value if isinstance(value, list) else [[value] * many] * many for name, value in pairs.items()}
    return lines + [
        f"fix {name} all property/global {name} peratomtypepair {many} {row_of(itertools.chain(*rows))}"
        for name, rows in tables.items()
    ]


def wall_commands(simulation: Simulation) -> list[str]:
    """Return the commands of all walls."""
    walls = simulation.walls
    models, settings = models_of(simulation)
    moving = {platen.plane.name: platen for platen in simulation.platens}
    fixed = (plane for plane in walls.planes if plane.name not in moving)
    shapes = {plane.name: f"{'xyz'[plane.axis]}plane {plane.level!r}" for plane in fixed}
    if walls.round is not None and walls.round.kind == "cylinder":
        shapes["round"] = f"zcylinder {walls.round.radius!r} {row_of(np.array(walls.round.center[:2]))}"
    kind = {name: 1 + number for name, number in simulation.laws.of_walls.items()}
    lines = [
        f"fix {name} all wall/gran {models} primitive type {kind[name]} {shape} {settings}"
        for name, shape in shapes.items()
    ]
    meshes = _meshes(simulation)
    for mesh in meshes:
        lines += [f"# approximated: {mesh.note}"] if mesh.note else []
        precision = repr(min(1e-3, 1e-7 * simulation.diameter))
        surface = f"file {_stl_of(mesh)} type {kind[mesh.name]} precision {precision} curvature_tolerant yes"
        servo = ""
        if mesh.name in moving:
            plane, force, speed = moving[mesh.name]
            # without force the wall moves inward with the largest velocity
            servo = (
                f" com {row_of(mesh.vertices.mean(axis=0))} ctrlPV force axis {row_of(plane.normal)} "
                f"target_val {force!r} vel_max {speed!r} kp 1.0"
            )
        lines.append(f"fix {mesh.name} all mesh/surface{'/stress/servo' * bool(servo)} {surface}{servo}")
    if meshes:
        names = " ".join(mesh.name for mesh in meshes)
        lines.append(f"fix wall all wall/gran {models} mesh n_meshes {len(meshes)} meshes {names} {settings}")
    return lines


def wall_files(simulation: Simulation) -> dict[str, str]:
    """Return the text of the STL file of each wall that is made of triangles, by its name."""
    return {_stl_of(wall): _stl(wall.vertices[wall.faces]) for wall in _meshes(simulation)}


def _meshes(simulation: Simulation) -> list[Facets]:
    """Return the walls that are made of triangles: those without a closed form, and planes that move."""
    curved = {wall.name for wall in facets_of(simulation, planes=False)} if simulation.walls.needs_triangles else set()
    moving = {platen.plane.name for platen in simulation.platens}
    return [wall for wall in facets_of(simulation) if wall.name in curved | moving]


def _stl_of(wall: Facets) -> str:
    """Return the name of the file of the triangles of a wall."""
    return f"liggghts_{wall.name}.stl"


def _stl(corners: Floats) -> str:
    """Return triangles (f, 3, 3) as an STL file in ASCII."""
    lines = ["solid wall"]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= linear.norm(normals, axis=1, keepdims=True)
    for normal, triangle in zip(normals, corners, strict=True):
        lines += [f"facet normal {row_of(normal)}", "outer loop"]
        lines += [f"vertex {row_of(point)}" for point in triangle]
        lines += ["endloop", "endfacet"]
    return text_of([*lines, "endsolid wall"])
