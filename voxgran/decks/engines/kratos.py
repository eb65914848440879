"""Kratos Multiphysics: spheres and rigid clusters of the DEMApplication, with a script that runs them.

Spheres, clusters and walls have materials of Kratos, with contact laws between them.

References
----------
Kratos DEMApplication 10.4: `DEM_analysis_stage.py`, `sphere_strategy.py`, `cluster_file_reader.py`, `cluster3D.cpp`,
`dem_d_linear_custom_constants_cl.cpp`, `DEM_D_Hertz_viscous_Coulomb_CL.cpp` and `DEM_D_DMT_cohesive_law.cpp` of
https://github.com/KratosMultiphysics/Kratos.
"""

import itertools
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran.decks.contact_law import ContactLaw
from voxgran.decks.engine import Engine, Held, program_part
from voxgran.decks.kratos_model import (
    Cluster,
    clu_text,
    clumps_of,
    cluster_text,
    read_clu,
    read_mdpa,
    sphere_text,
    spheres_of,
    wall_text,
    walls_of,
)
from voxgran.decks.simulation import SETTLING, Simulation
from voxgran.geometry.rotation import rotation_matrices

TITLE, INSTALL = "Kratos", "pip install KratosMultiphysics KratosDEMApplication"
#: names of files; Kratos adds the ends of those of model parts to the name of the problem itself
PROBLEM, SCRIPT = "kratos", "kratos_run.py"
GRAINS, CLUMPS, FACES = f"{PROBLEM}DEM.mdpa", f"{PROBLEM}DEM_Clusters.mdpa", f"{PROBLEM}DEM_FEM_boundary.mdpa"
PARAMETERS, MATERIALS = f"{PROBLEM}ProjectParametersDEM.json", f"{PROBLEM}MaterialsDEM.json"
#: farthest that neighbours are looked for beyond contact, in median diameters, and most steps between two searches
TOLERANCE, MOST_STEPS = 0.05, 50
AXES = tuple(enumerate("XYZ"))


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the files.

    Raises
    ------
    InputError
        If there are clumps of too many shapes, or with rolling friction.
    """
    if simulation.laws.rolls and len(simulation.bodies.of_kind("clump")):
        raise InputError("material rolling_friction is given: clusters of Kratos have none; choose engine 'liggghts'")
    comments = [*simulation.header(TITLE), *_remarks(simulation)]
    files = {
        SCRIPT: _script(simulation, comments),
        PARAMETERS: _json(_parameters(simulation)),
        MATERIALS: _json(materials_of(simulation)),
        GRAINS: sphere_text(simulation, comments),
        CLUMPS: cluster_text(simulation, comments),
        FACES: wall_text(simulation, comments),
    }
    for number in clumps_of(simulation.bodies):
        template = simulation.bodies.templates[number]
        files[cluster_file(template.name)] = clu_text(template, comments)
    return files


def _json(value: Mapping[str, Any]) -> str:
    """Return the text of a JSON file."""
    return json.dumps(value, indent=2) + "\n"


def _remarks(simulation: Simulation) -> list[str]:
    """Return what the contact law of Kratos has different, as lines."""
    law = simulation.law
    names = sorted({law_name(one) for _, _, one in simulation.laws.pairs()})
    lines = [f"contact law of Kratos: {' and '.join(names)}, the same between grains and at walls"]
    if law.name == "linear":
        lines.append(
            "both stiffnesses hold for every pair; Kratos damps by 2 gamma sqrt(k m), also along the contact, with "
            "the gamma that gives the restitution where a contact ends before it pulls"
        )
    else:
        lines.append("Kratos damps by 2 gamma sqrt(k m) with the stiffness k at the overlap, also along the contact")
    return lines


def _parameters(simulation: Simulation) -> dict[str, Any]:
    """Return the parameters of the problem."""
    tolerance = TOLERANCE * simulation.diameter
    low, high = simulation.walls.bounds.tolist()
    ends = {f"BoundingBox{name}{axis}": end[k] for name, end in (("Min", low), ("Max", high)) for k, axis in AXES}
    gravity = {f"Gravity{axis}": float(simulation.gravity[k]) for k, axis in AXES}
    return {
        "problem_name": PROBLEM,
        "Dimension": 3,
        "solver_settings": {
            "strategy": "sphere_strategy",
            "RemoveBallsInitiallyTouchingWalls": False,
            "model_import_settings": {"input_type": "mdpa", "input_filename": PROBLEM},
            "material_import_settings": {"materials_filename": MATERIALS},
        },
        "ElementType": "SphericPartDEMElement3D",
        "BoundingBoxOption": False,
        **ends,
        **gravity,
        "dem_inlet_option": False,
        "RotationOption": True,
        "RollingFrictionOption": simulation.laws.rolls,
        "TranslationalIntegrationScheme": "Symplectic_Euler",
        "RotationalIntegrationScheme": "Runge_Kutta",
        "MaxTimeStep": simulation.time_step,
        "FinalTime": simulation.duration,
        "DeltaOption": "Absolute",
        "SearchTolerance": tolerance,
        "search_tolerance_against_walls": tolerance,
        "NeighbourSearchFrequency": _steps_per_search(simulation, tolerance),
        "do_print_results_option": False,
        "post_gid_option": False,
        "OutputTimeStep": simulation.steps_per_output * simulation.time_step,
    }


def _steps_per_search(simulation: Simulation, tolerance: float) -> int:
    """Return the time steps after which neighbours are looked for again, so that no grain comes nearer unseen."""
    size = float(linear.norm(simulation.gravity))
    if not size:
        return 1
    height = float(linear.matmul(np.abs(simulation.gravity / size), np.ptp(simulation.walls.bounds, axis=0)))
    # two grains that have fallen through the whole container meet
    fastest = 2 * math.sqrt(2 * size * height)
    return min(max(int(tolerance / (fastest * simulation.time_step)), 1), MOST_STEPS)


def _script(simulation: Simulation, comments: list[str]) -> str:
    """Return the script: until the bed rests, with a state to go on from at every output."""
    rest = simulation.rest_energy if simulation.gravity.any() else 0.0
    constants = {
        "GRAINS": GRAINS,
        "CLUMPS": CLUMPS,
        "PARAMETERS": PARAMETERS,
        "TIME_STEP": simulation.time_step,
        "STEPS": simulation.steps,
        "STEPS_PER_OUTPUT": simulation.steps_per_output,
        "EARLIEST_REST": math.ceil(SETTLING * simulation.time_unit / simulation.time_step),
        "REST_ENERGY": rest,
        "FIXED": simulation.fixed,
    }
    lines = [
        *(f"# {line}" for line in comments),
        "# python kratos_run.py runs from the start, python kratos_run.py kratos_state_000000000.txt from a state;",
        "# a state has all poses and velocities, friction begins at zero",
        "",
        "import os",
        "import sys",
        "",
        "import KratosMultiphysics as Kratos",
        "import KratosMultiphysics.DEMApplication as Dem",
        "from KratosMultiphysics.DEMApplication.DEM_analysis_stage import DEMAnalysisStage",
        "",
        *(f"{name} = {value!r}" for name, value in constants.items()),
    ]
    return "\n".join(lines) + "\n" + program_part("kratos_run.py.in")


def _read(folder: Path) -> Held:
    """Return what the files of grains, clusters and materials hold.

    Raises
    ------
    FileFormatError
        If a file is damaged.
    """
    materials = {
        one["material_id"]: one["Variables"]
        for one in json.loads((folder / MATERIALS).read_text(encoding="utf-8"))["materials"]
    }
    densities = {number: float(variables.get("PARTICLE_DENSITY", 0.0)) for number, variables in materials.items()}
    clusters = {
        number: read_clu(folder / variables["CLUSTER_FILE_NAME"])
        for number, variables in materials.items()
        if "CLUSTER_FILE_NAME" in variables
    }
    bodies = {**_spheres(folder / GRAINS, densities), **_clusters(folder / CLUMPS, densities, clusters)}
    rows = [bodies[grain] for grain in sorted(bodies)]
    mass, position, inertia, centers, radii = zip(*rows, strict=True)
    joined = np.concatenate(centers), np.concatenate(radii)
    return Held(np.array(mass), np.array(position), np.array(inertia), *joined)


#: mass, centroid, inertia tensor, centers and radii of a grain
Body = tuple[float, Floats, Floats, Floats, Floats]


def _spheres(path: Path, densities: Mapping[int, float]) -> dict[int, Body]:
    """Return the grains that are spheres, by their numbers; densities are those of the materials."""
    nodes, elements, sizes = read_mdpa(path, "Nodes", "Elements SphericParticle3D", "NodalData RADIUS")
    radii = {int(words[0]): float(words[2]) for words in sizes}
    material = {int(words[2]): int(words[1]) for words in elements}
    found: dict[int, Body] = {}
    for words in nodes:
        grain, center = int(words[0]), np.array(words[1:], dtype=float)
        radius = radii[grain]
        mass = densities[material[grain]] * 4 / 3 * math.pi * radius**3
        found[grain] = mass, center, 0.4 * mass * radius**2 * np.eye(3), center[None], np.array([radius])
    return found


def _clusters(path: Path, densities: Mapping[int, float], clusters: Mapping[int, Cluster]) -> dict[int, Body]:
    """Return the grains that are clumps, by their numbers; densities and clusters are those of the materials."""
    names = ("Nodes", "Elements Cluster3D", "NodalData CHARACTERISTIC_LENGTH", "NodalData ORIENTATION")
    nodes, elements, sizes, orientations = read_mdpa(path, *names)
    lengths = {int(words[0]): float(words[2]) for words in sizes}
    turns = {int(words[0]): np.array(words[3:], dtype=float) for words in orientations}
    material = {int(words[2]): int(words[1]) for words in elements}
    found: dict[int, Body] = {}
    for words in nodes:
        grain, center = int(words[0]), np.array(words[1:], dtype=float)
        cluster, turn = clusters[material[grain]], rotation_matrices(np.roll(turns[grain], 1)[None])[0]
        scale = lengths[grain] / cluster.size
        mass = densities[material[grain]] * cluster.volume * scale**3
        inertia = linear.matmul(linear.matmul(turn, np.diag(mass * scale**2 * cluster.inertia)), turn.T)
        found[grain] = (
            mass,
            center,
            inertia,
            center + linear.matmul(scale * cluster.centers, turn.T),
            scale * cluster.radii,
        )
    return found


registration = Engine(
    title=TITLE,
    summary="spheres, clusters, walls of triangles, materials and a script of the DEMApplication",
    source="github.com/KratosMultiphysics/Kratos, applications/DEMApplication",
    kinds=("sphere", "clump"),
    periodic=False,
    cohesion=True,
    fixed=True,
    materials=True,
    rolling=("linear", "hertz"),
    install=INSTALL,
    verified="run with KratosDEMApplication 10.4.4",
    command=f"python {SCRIPT}",
    write=_write,
    read=_read,
)


def cluster_file(template: str) -> str:
    """Return the name of the file of a template that is a clump."""
    return f"kratos_{template}.clu"


def law_name(law: ContactLaw) -> str:
    """Return the name of the contact law in Kratos."""
    if law.name == "linear":
        return "DEM_D_Linear_Custom_Constants"
    return "DEM_D_Hertz_viscous_Coulomb" + ("_DMT" if law.cohesion else "")


def materials_of(simulation: Simulation) -> dict[str, Any]:
    """Return the materials: of spheres, of walls, and of each template that is a clump, whose file it names."""
    bodies, laws = simulation.bodies, simulation.laws
    elastic = [
        {"YOUNG_MODULUS": _young_modulus(simulation, laws.laws[k][k]), "POISSON_RATIO": laws.laws[k][k].poisson_ratio}
        for k in range(laws.count)
    ]
    spheres, clumps = spheres_of(simulation), {material: k for k, material in clumps_of(bodies).items()}
    walls = walls_of(simulation)
    several, materials, table = len(spheres) > 1, list[dict[str, Any]](), list[list[str]]()
    names, kinds = dict[int, str](), dict[int, int]()
    for material, name, kind, density, _ in spheres:
        names[material], kinds[material] = name, kind
        materials.append(_material(name, material, {"PARTICLE_DENSITY": density, **elastic[kind]}))
        table.append([f"SpheresPart.{name.title()}" if several else "SpheresPart", name])
    for material, name, kind, parts in walls:
        names[material], kinds[material] = name, kind
        materials.append(_material(name, material, {**elastic[kind], "COMPUTE_WEAR": False}))
        own = [f"RigidFacePart.{part}" for part in parts] if walls[1:] else ["RigidFacePart"]
        table += [[part, name] for part in own]
    for material, k in clumps.items():
        name, kind = bodies.templates[k].name, laws.of_shapes[k]
        names[material], kinds[material] = name, kind
        files = {"CLUSTER_FILE_NAME": cluster_file(name), "BREAKABLE_CLUSTER": False}
        solid_of = {"PARTICLE_DENSITY": bodies.densities[k], **elastic[kind]}
        materials.append(_material(name, material, solid_of | files))
        table.append([f"ClusterPart.{name}", name])
    solid = [material for material, *_ in walls]
    relations = [
        {
            "material_names_list": [names[a], names[b]],
            "material_ids_list": [a, b],
            "Variables": _contact(laws.laws[kinds[a]][kinds[b]], wall=b in solid),
        }
        for a, b in itertools.combinations_with_replacement((*(one[0] for one in spheres), *clumps, *solid), 2)
        if a not in solid
    ]
    return {"materials": materials, "material_relations": relations, "material_assignation_table": table}


def _material(name: str, number: int, variables: Mapping[str, Any]) -> dict[str, Any]:
    """Return one material."""
    return {"material_name": name, "material_id": number, "Variables": dict(variables)}


def _young_modulus(simulation: Simulation, law: ContactLaw) -> float:
    """Return Young's modulus of a material by its law.

    That of the linear law has no effect. It is the one by which DEM_D_Linear_viscous_Coulomb, put in place of the law,
    has the normal stiffness between two spheres of the median diameter: 1.432 pi 0.31225 E / (2 (1 - nu^2)) d / 4.
    """
    if law.name == "hertz":
        return law.young_modulus
    return law.stiffness * 8 * (1 - law.poisson_ratio**2) / (1.432 * math.pi * 0.31225 * simulation.diameter)


def _contact(law: ContactLaw, *, wall: bool) -> dict[str, Any]:
    """Return the parameters of contacts between two materials, or of one with a wall, by their law.

    The moment of rolling friction is at most the coefficient times the normal force and the radius, the smaller one of
    two spheres, of which the effective radius of equal ones is half.
    """
    rolling = law.rolling_friction if wall else law.rolling_friction / 2
    variables: dict[str, Any] = {
        "COEFFICIENT_OF_RESTITUTION": law.restitution,
        "STATIC_FRICTION": law.friction,
        "DYNAMIC_FRICTION": law.friction,
        "FRICTION_DECAY": 500.0,
        "ROLLING_FRICTION": rolling,
        "ROLLING_FRICTION_WITH_WALLS": rolling,
        "DEM_ROLLING_FRICTION_MODEL_NAME": "DEMRollingFrictionModelBounded",
        "DEM_DISCONTINUUM_CONSTITUTIVE_LAW_NAME": law_name(law),
    }
    if law.name == "linear":
        variables |= {"K_NORMAL": law.stiffness, "K_TANGENTIAL": law.shear_stiffness}
    if law.cohesion:
        # Kratos pulls with 2 pi R times this
        variables["PARTICLE_COHESION"] = 2 * law.cohesion
    return variables
