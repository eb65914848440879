"""Kratos Multiphysics: spheres and rigid clusters of the DEMApplication, with a script that runs them.

References
----------
Kratos DEMApplication 10.4: `DEM_analysis_stage.py`, `sphere_strategy.py`, `cluster_file_reader.py`, `cluster3D.cpp`,
`dem_d_linear_custom_constants_cl.cpp`, `DEM_D_Hertz_viscous_Coulomb_CL.cpp` and `DEM_D_DMT_cohesive_law.cpp` of
https://github.com/KratosMultiphysics/Kratos.
"""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran.decks.engine import Engine, Held
from voxgran.decks.kratos_materials import cluster_file, law_name, materials_of
from voxgran.decks.kratos_model import (
    Cluster,
    clu_text,
    clumps_of,
    cluster_text,
    read_clu,
    read_mdpa,
    sphere_text,
    wall_text,
)
from voxgran.decks.simulation import SETTLING, Simulation
from voxgran.decks.text import program_part
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
    size = float(np.linalg.norm(simulation.gravity))
    if not size:
        return 1
    height = float(np.abs(simulation.gravity / size) @ np.ptp(simulation.walls.bounds, axis=0))
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
        inertia = turn @ np.diag(mass * scale**2 * cluster.inertia) @ turn.T
        found[grain] = mass, center, inertia, center + scale * cluster.centers @ turn.T, scale * cluster.radii
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
