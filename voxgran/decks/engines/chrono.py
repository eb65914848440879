"""DEM-Engine of Project Chrono: spheres and clumps as tables of spheres, with a driver in Python that loads them.

References
----------
https://github.com/projectchrono/DEM-Engine, release 3.0.19 (the Python package ``deme``): docstrings of `DEMSolver`,
`DEMClumpBatch`, `Tracker` and `DEMExternObj`, `DEMCalcForceKernels_Primitive.cu` and `FullHertzianForceModel.cu` for
the names of a force model, and `data/clumps` for the layout of a clump.
"""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError
from voxgran.decks.bodies import Template
from voxgran.decks.engine import Engine, Held, grain_rows, program_part, row_of, text_of
from voxgran.decks.facets import Facets, facets_of
from voxgran.decks.simulation import SETTLING, Simulation
from voxgran.geometry.rotation import rotation_matrices

TITLE = "Chrono DEM-Engine"
#: names of files
RUN, GRAINS, LAW, WALLS = "chrono_run.py", "chrono_grains.csv", "chrono_law.cu", "chrono_walls.obj"
#: columns of a grain after the name of its template; quaternions from the principal frame, as the engine orders them
COLUMNS = (
    *("scale", "mass", "moment_1", "moment_2", "moment_3"),
    *("x", "y", "z", "quaternion_x", "quaternion_y", "quaternion_z", "quaternion_w"),
    *("velocity_x", "velocity_y", "velocity_z", "spin_1", "spin_2", "spin_3"),
)
#: first line of the table of a template
CLUMP_HEADER = "x,y,z,r"
#: Young's modulus in Pa where the linear law is asked for; the engine wants one, the force model does not use it
UNUSED = 1e7
#: a number in a table
NUMBER = r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?"

#: stiffness and damping of the laws in a force model, in terms of its constants
LAWS = {
    "linear": """\
    const float normal_stiffness = stiffness;
    const float damping = 2.f * damping_ratio * sqrtf(stiffness * mass);
    const float drag_stiffness = shear_stiffness;
""",
    "hertz": """\
    const float contact = sqrtf(overlapDepth / (1.f / ARadius + 1.f / BRadius));
    const float normal_stiffness = 4.f / 3.f * young_modulus * contact;
    const float damping = 2.f * damping_ratio * sqrtf(5.f / 3.f * young_modulus * contact * mass);
    const float drag_stiffness = 8.f * shear_modulus * contact;
""",
}


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the files."""
    bodies = simulation.bodies
    used = {int(k) for k in bodies.assembly.shape_id}
    files = {RUN: _driver(simulation), GRAINS: _grains(simulation)}
    for k, template in enumerate(bodies.templates):
        if k in used:
            # a table of the engine has no comments
            files[f"chrono_{template.name}.csv"] = text_of([CLUMP_HEADER, *map(_row, _spheres(template))])
    files[LAW] = _force(simulation)
    faceted = _faceted(simulation)
    if faceted is not None:
        files[WALLS] = _mesh(simulation, faceted)
    return files


def _row(values: Iterable[float]) -> str:
    """Return numbers with all their digits, between commas."""
    return row_of(values, ",")


def _comments(simulation: Simulation, mark: str) -> list[str]:
    """Return the header as comments."""
    return simulation.comments(TITLE, "the engine computes with numbers of 32 bits", mark=mark)


def _spheres(template: Template) -> Floats:
    """Return centers and radii of the spheres of a template, in its principal frame about its centroid."""
    centers, radii = template.spheres
    return np.column_stack([linear.matmul(centers, template.principal.axes), radii])


def _grains(simulation: Simulation) -> str:
    """Return the table of the grains."""
    bodies, grains = simulation.bodies, simulation.bodies.assembly
    turns = np.roll(bodies.principal_orientation, -1, axis=1)
    rest = np.zeros((grains.count, 6))
    rows = np.column_stack([grains.scale, bodies.mass, bodies.moments, grains.position, turns, rest])
    lines = [*_comments(simulation, "#"), f"# template,{','.join(COLUMNS)}"]
    for shape, row in zip(grains.shape_id.tolist(), rows, strict=True):
        lines.append(f"{bodies.templates[shape].name},{_row(row)}")
    return text_of(lines)


def _force(simulation: Simulation) -> str:
    """Return the contact law as a force model of the engine.

    That of Hertz is not the engine's own, which in release 3.0.19 takes the radius of one sphere for that of the pair.
    """
    law = simulation.law
    numbers = {"damping_ratio": law.damping_ratio, "friction": law.friction}
    if law.name == "linear":
        numbers |= {"stiffness": law.stiffness, "shear_stiffness": law.shear_stiffness}
    else:
        young, ratio = law.young_modulus, law.poisson_ratio
        # those of two equal materials in contact
        shear = young / (2 * (1 + ratio)) / (2 * (2 - ratio))
        numbers |= {"young_modulus": young / (2 * (1 - ratio**2)), "shear_modulus": shear}
    constants = [f"const float {name} = {float(np.float32(value))!r}f;" for name, value in numbers.items()]
    return text_of([*_comments(simulation, "//"), *constants]) + program_part("chrono_force.cu").format(
        law=LAWS[law.name]
    )


def _faceted(simulation: Simulation) -> Facets | None:
    """Return the walls that are made of triangles: a mesh, or a sphere; planes and cylinders are exact."""
    walls = simulation.walls
    if len(walls.slopes):
        return None
    if walls.mesh is None and (walls.round is None or walls.round.kind == "cylinder"):
        return None
    found = facets_of(simulation, planes=False)
    firsts = np.cumsum([0, *(len(wall.vertices) for wall in found)])
    return Facets(
        "mesh",
        np.concatenate([wall.vertices for wall in found]),
        np.concatenate([wall.faces + first for wall, first in zip(found, firsts[:-1], strict=True)]),
        "; ".join(wall.note for wall in found if wall.note),
    )


def _mesh(simulation: Simulation, wall: Facets) -> str:
    """Return the triangles of a wall as a Wavefront file; their normals point to the grains."""
    lines = _comments(simulation, "#")
    lines += [f"# {wall.note}"] if wall.note else []
    lines += [f"v {' '.join(map(repr, point))}" for point in wall.vertices.tolist()]
    return text_of([*lines, *(f"f {c + 1} {b + 1} {a + 1}" for a, b, c in wall.faces.tolist())])


def _driver(simulation: Simulation) -> str:
    """Return the driver: grains, walls, contact law, and a run until the bed rests."""
    law, steps = simulation.law, simulation.steps_per_output
    material = {"E": law.young_modulus or UNUSED, "nu": law.poisson_ratio, "CoR": law.restitution, "mu": law.friction}
    frames = -(-simulation.steps // steps)
    settling = int(np.ceil(SETTLING * simulation.time_unit / (steps * simulation.time_step)))
    lines = [
        *_comments(simulation, "#"),
        '"""Run the grains of chrono_grains.csv, or of another table that is named, until they rest."""',
        "",
        "import os",
        "import sys",
        "",
        "import deme",
        "import numpy as np",
        "",
        "FOLDER = os.path.dirname(os.path.abspath(__file__))",
        f"MATERIAL = {material | {'Crr': 0.0}!r}",
        "HEAVY = 1e6  # mass of a wall of triangles, kg: that of the engine's planes",
        f"GRAVITY = {simulation.gravity.tolist()!r}",
        f"TIME_STEP = {simulation.time_step!r}",
        f"STEPS_PER_OUTPUT, FRAMES, SETTLING_FRAMES = {steps}, {frames}, {settling}",
        f"FIXED = {simulation.fixed!r}  # first and last number of each row of fixed grains, from 1",
        f"SETTLES, REST_ENERGY = {bool(simulation.gravity.any())}, {simulation.rest_energy!r}",
        program_part("chrono_grains.py.in"),
        *_walls(simulation),
    ]
    return text_of(lines) + program_part("chrono_run.py.in")


def _walls(simulation: Simulation) -> list[str]:
    """Return the lines that add the walls and the bounds of the domain."""
    walls = simulation.walls
    ends = simulation.domain(float(simulation.bodies.assembly.bounding_radii.max())).T.tolist()
    lines = [f"solver.InstructBoxDomainDimension({', '.join(str(tuple(pair)) for pair in ends)})"]
    lines.append('solver.InstructBoxDomainBoundingBC("none", material)')
    for plane in walls.planes:
        point = np.where(np.arange(3) == plane.axis, plane.level, walls.bounds.mean(axis=0))
        lines.append(f"solver.AddBCPlane({point.tolist()}, {plane.normal.tolist()}, material)  # {plane.name}")
    lines += [f"solver.AddBCPlane({point}, {inward}, material)" for point, inward in walls.slopes.tolist()]
    if walls.round is not None and walls.round.kind == "cylinder":
        center = list(walls.round.center)
        lines.append("cylinder = solver.AddExternalObject()")
        lines.append(f"cylinder.AddCylinder({center}, [0.0, 0.0, 1.0], {walls.round.radius!r}, material)")
    if _faceted(simulation) is not None:
        lines.append(f'mesh = solver.AddWavefrontMeshObject(os.path.join(FOLDER, "{WALLS}"), material)')
        lines += ["mesh.SetMass(HEAVY)", "mesh.SetFamily(10)", "solver.SetFamilyFixed(10)"]
    return lines


def _read(folder: Path) -> Held:
    """Return what the files hold.

    Raises
    ------
    FileFormatError
        If a row has too few columns, or the table of a template is not as the engine has it.
    """
    names, values = grain_rows(folder / GRAINS, len(COLUMNS))
    templates = {name: _template(folder / f"chrono_{name}.csv") for name in sorted(set(names))}
    frames = rotation_matrices(np.roll(values[:, 8:12], 1, axis=1))
    centers, radii = [], []
    for name, value, frame in zip(names, values, frames, strict=True):
        table = value[0] * templates[name]
        centers.append(linear.matmul(table[:, :3], frame.T) + value[5:8])
        radii.append(table[:, 3])
    inertia = linear.einsum("nij,nj,nkj->nik", frames, values[:, 2:5], frames)
    return Held(values[:, 1], values[:, 5:8], inertia, np.concatenate(centers), np.concatenate(radii))


def _template(path: Path) -> Floats:
    """Return the spheres of a template: a header, then four numbers a line.

    Raises
    ------
    FileFormatError
        If a line is something else.
    """
    header, *lines = path.read_text().splitlines()
    if header != CLUMP_HEADER or not lines or not all(re.fullmatch(",".join([NUMBER] * 4), line) for line in lines):
        raise FileFormatError(f"{path} is no table of spheres of {TITLE}: write the deck again")
    return np.array([[float(word) for word in line.split(",")] for line in lines])


registration = Engine(
    title=TITLE,
    summary="tables of spheres, table of grains, force model, and a driver in Python that runs until rest on a GPU",
    source="https://github.com/projectchrono/DEM-Engine, release 3.0.19",
    kinds=("sphere", "clump"),
    periodic=False,
    fixed=True,
    install="pip install 'deme[cuda12]'",
    verified="loaded by deme 3.0.19, which took the force model; not run, since that needs a GPU",
    command=f"python {RUN}",
    write=_write,
    read=_read,
)
