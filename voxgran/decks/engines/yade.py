"""YADE: spheres, clumps, level sets and polyhedra, as a Python script and tables.

Polyhedra are those of `voxgran.decks.yade_polyhedra`; as their contacts lack much, they are never chosen unasked.

References
----------
YADE 2023.02a, reference of classes (yade-dem.org/doc/yade.wrapper.html) and source (gitlab.com/yade-dev/trunk):
`FrictViscoPM.cpp`, `HertzMindlin.cpp`, `Clump.cpp`, `LevelSet.cpp`, `Ig2_LevelSet_LevelSet_ScGeom`, `Polyhedra.cpp`,
`InsertionSortCollider`, `ymport.textClumps`. Level sets: Duriez & Bonelli 2021 (doi:10.1016/j.compgeo.2021.104033).
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.errors import FileFormatError, InputError
from voxgran._base.lazy import load
from voxgran.decks.bodies import Kind, Template
from voxgran.decks.engine import Engine, Held, program_part, row_of, text_of
from voxgran.decks.simulation import SETTLING, STRESS_MET, Simulation
from voxgran.decks.yade_polyhedra import contacts_of_polyhedra, corners, damping, notes_of_polyhedra, refuse_polyhedra
from voxgran.decks.yade_walls import cell_lines, facet_lines
from voxgran.geometry.periods import face_distances
from voxgran.geometry.rotation import rotation_matrices

TITLE, INSTALL = "YADE", "apt-get install yade"
#: shapes of YADE by the kinds of grains that have them
SHAPES = {"Sphere": {"sphere", "clump"}, "LevelSet": {"level_set"}, "Polyhedra": {"polyhedron"}}
#: names of files
SCRIPT, GRAINS, SPHERES, FACETS = "yade_run.py", "yade_grains.txt", "yade_spheres.txt", "yade_facets.txt"
#: cells of the lattice of a level set across an equivalent diameter, and cells around the shape
CELLS, AROUND = 24, 2
#: nodes on the surface of a level set
NODES = 1000
#: largest strain rate of a cell that keeps a stress s, times sqrt(m / (s d))
RATE = 0.01
#: numerical damping in such a cell, a share of the force on a grain, and the mean net force at rest, in contact forces
DAMPING, UNBALANCED = 0.2, 1e-4
#: how far grains move until pairs are looked for again, in least radii
VERLET = 0.2


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the files.

    Raises
    ------
    InputError
        If YADE does not have contacts of these grains with each other, with the walls or under the law.
    """
    _refuse(simulation)
    bodies = simulation.bodies
    notes: list[str] = []
    files: dict[str, list[str]] = {}
    for template in bodies.templates:
        if template.kind == "sphere" or not len(bodies.of_kind(template.kind)):
            continue
        if template.kind == "level_set":
            table, error = _lattice(template)
            notes.append(
                f"approximated: {template.name} is a lattice of distances, surface off by at most {error:.3g} m"
            )
        else:
            table = corners(template) if template.kind == "polyhedron" else _clump(template)
        files[f"yade_{template.name}.txt"] = table
    if _kinds(simulation) & {"sphere", "clump"}:
        files[SPHERES] = _spheres(simulation)
    files[GRAINS] = _grains(simulation)
    facets, said = facet_lines(simulation)
    if facets:
        files[FACETS] = facets
    script = [*_constants(simulation, bool(facets)), *_engines(simulation)]
    header = simulation.comments(TITLE, *notes, *said, *_notes(simulation))
    made = {SCRIPT: "\n".join([*header, *script]) + program_part("yade_run.py.in")}
    return made | {name: text_of([*header, *lines]) for name, lines in files.items()}


def _refuse(simulation: Simulation) -> None:
    """Refuse what YADE does not have.

    Raises
    ------
    InputError
        If there are contacts that it does not have.
    """
    kinds, walls = _kinds(simulation), simulation.walls
    if "polyhedron" in kinds:
        refuse_polyhedra(simulation)
    if any(walls.periodic):
        _refuse_narrow(simulation)
        if simulation.platens:
            raise InputError(
                "container is periodic, and walls are to keep a stress: YADE has none that move in a periodic cell; "
                "choose engine 'liggghts'"
            )
    found = {law.cohesion for _, _, law in simulation.laws.pairs()}
    if len(found) > 1:
        raise InputError(
            f"material cohesion differs between pairs, {min(found):g} to {max(found):g}: YADE has one of all contacts; "
            "give all materials the same"
        )
    if "level_set" not in kinds:
        return
    if len(kinds) > 1:
        raise InputError(
            "grains are level sets and others: level sets meet no other grains in YADE; give grains='clump'"
        )
    if simulation.laws.rolls:
        raise InputError("material rolling_friction is given: level sets of YADE have none; leave it out")
    if any(walls.periodic):
        raise InputError("container is periodic and grains are level sets: YADE has wrong torques; give grains='clump'")
    if walls.round is not None or walls.mesh is not None:
        raise InputError(
            "container is not flat and grains are level sets: YADE has planes for them; give grains='clump'"
        )


def _refuse_narrow(simulation: Simulation) -> None:
    """Refuse periods in which a sphere takes up more than half, as YADE loses contacts then.

    Raises
    ------
    InputError
        If a period is too short.
    """
    walls = simulation.walls
    period = float(face_distances(walls.periods).min())
    bodies = simulation.bodies
    widest = 2 * (float(bodies.spheres[1].max(initial=0.0)) + VERLET * bodies.least_radius)
    if widest > period / 2:
        raise InputError(
            f"container has a period of {period:.4g} m: YADE needs {2 * widest:.4g} m, twice its widest sphere and the "
            "distance in which it looks for pairs; use a larger container"
        )


def _kinds(simulation: Simulation) -> set[Kind]:
    """Return the kinds that there are grains of."""
    return {kind for kind in simulation.bodies.kinds if len(simulation.bodies.of_kind(kind))}


def _notes(simulation: Simulation) -> list[str]:
    """Return what is not exact, as sentences."""
    kinds, laws, lines = _kinds(simulation), simulation.laws, []
    own = np.diag(np.array(laws.matrix("damping_ratio")))
    mean = (own[:, None] + own) / 2
    if simulation.law.name == "linear" and not np.allclose(mean, laws.matrix("damping_ratio")):
        lines.append("approximated: the damping of a pair is the mean share of the critical one of its two materials")
    if laws.rolls and len(set(np.ravel(laws.matrix("rolling_friction")))) == 1:
        lines.append("approximated: rolling friction of spheres takes their mean radius over 2 for the effective one")
    if "polyhedron" in kinds:
        lines += notes_of_polyhedra(simulation)
    if "level_set" in kinds:
        lines.append(
            f"approximated: two level sets have one contact, at the deepest of {NODES} nodes on rays from the centroid"
        )
        if simulation.law.name == "hertz":
            lines.append("approximated: radius of curvature of level sets is the distance of contact and centroid")
    return lines


def _constants(simulation: Simulation, facets: bool) -> list[str]:
    """Return the numbers of the simulation as lines of Python."""
    kinds, walls, bodies = _kinds(simulation), simulation.walls, simulation.bodies
    falling = bool(simulation.gravity.any()) or simulation.stress is not None
    start = math.ceil(SETTLING * simulation.time_unit / simulation.time_step)
    kind, of_walls = simulation.laws.of_shapes, simulation.laws.of_walls
    planes = [(plane.level, plane.axis, plane.inward, of_walls[plane.name]) for plane in walls.planes]
    planes = [] if any(walls.periodic) else planes
    moving = [(walls.planes.index(one.plane), one.plane.axis, one.plane.inward, one.force, one.speed)
              for one in simulation.platens]  # fmt: skip
    return [
        "import os",
        "import sys",
        "",
        "from yade import utils",
        "",
        "# steps at the most, between outputs, and before rest is looked for; kinetic energy at rest, J",
        f"STEPS, EVERY, START = {simulation.steps}, {simulation.steps_per_output}, {start}",
        f"REST = {simulation.rest_energy if falling else 0.0!r}",
        "# mean net force on a body at rest under a stress, in mean contact forces; 0 without",
        f"UNBALANCED = {0.0 if simulation.stress is None else UNBALANCED!r}",
        "# material of the grains of each template by its number",
        f"MATERIALS = {{{', '.join(f'{one.name!r}: {k}' for one, k in zip(bodies.templates, kind, strict=True))}}}",
        "# level, axis, side and material of plane walls",
        f"PLANES = {planes!r}",
        "# plane walls that move: number, axis, side, force of the grains in N, and speed in m/s where nothing presses",
        f"PLATENS = {moving!r}",
        "# coefficients of rolling friction of pairs of materials, of which each is three of YADE",
        f"ROLLING = {simulation.laws.matrix('rolling_friction')!r}",
        f"STRESS_MET = {STRESS_MET!r}",
        "# first and last number of each row of grains that are fixed, from 1",
        f"FIXED = {simulation.fixed!r}",
        f"FACETS = {facets}",
        f"SPHERES = {bool(kinds & {'sphere', 'clump'})}",
        f"LEVEL_SETS = {'level_set' in kinds}",
        f"POLYHEDRA = {'polyhedron' in kinds}",
        f"NODES = {NODES}",
    ]


def _materials(simulation: Simulation) -> list[str]:
    """Return the lines that make the materials of grains, of the spheres of clumps, and of walls."""
    if "polyhedron" in _kinds(simulation):
        return contacts_of_polyhedra(simulation).materials
    lines = []
    for k in range(simulation.laws.count):
        law = simulation.laws.laws[k][k]
        if law.name == "hertz":
            made = f"FrictMat(young={law.young_modulus!r}, poisson={law.poisson_ratio!r}"
        else:
            made = f"FrictViscoMat(betan={law.damping_ratio!r}"
        # another member has the mass of a clump
        density = {"grains": law.density, "members": 0.0, "walls": law.density}
        angle = math.atan(law.friction)
        lines += [
            f'O.materials.append({made}, frictionAngle={angle!r}, density={value!r}, label="{name}{k}"))'
            for name, value in density.items()
        ]
    return lines


def _matches(simulation: Simulation, values: list[list[float]]) -> str:
    """Return numbers of pairs of materials as a MatchMaker."""
    if simulation.laws.count == 1:
        return f"MatchMaker(algo='val', val={values[0][0]!r})"
    # each material is three of YADE: of grains, of members of clumps, and of walls
    many = 3 * simulation.laws.count
    pairs = [(i, j, values[i // 3][j // 3]) for i in range(many) for j in range(i, many)]
    return f"MatchMaker(matches={pairs!r})"


def _contacts(simulation: Simulation, shapes: list[str]) -> tuple[list[str], list[str], list[str]]:
    """Return the parts of an engine that make geometry, physics and forces of contacts."""
    law, laws = simulation.law, simulation.laws
    angle = _matches(simulation, [[math.atan(value) for value in row] for row in laws.matrix("friction")])
    rubs = f", frictAngle={angle}" if laws.count > 1 else ""
    if "Polyhedra" in shapes:
        found = contacts_of_polyhedra(simulation)
        return found.geometry, found.physics, found.laws
    hertz = law.name == "hertz"
    geometry = []
    if "Sphere" in shapes:
        ends = f"ScGeom(hertzian={hertz})"
        geometry += ["Ig2_Sphere_Sphere_ScGeom()", f"Ig2_Wall_Sphere_{ends}", f"Ig2_Facet_Sphere_{ends}"]
    if "LevelSet" in shapes:
        geometry += ["Ig2_LevelSet_LevelSet_ScGeom()", "Ig2_Wall_LevelSet_ScGeom()"]
    if hertz:
        bounce = _matches(simulation, laws.matrix("restitution")) if laws.count > 1 else repr(law.restitution)
        rolls, moment = _rolling(simulation)
        physics = [f"Ip2_FrictMat_FrictMat_MindlinPhys(en={bounce}, gamma={law.cohesion!r}{rubs}{rolls})"]
        return geometry, physics, [f"Law2_ScGeom_MindlinPhys_Mindlin(includeAdhesion={law.cohesion > 0}{moment})"]
    normal = _matches(simulation, laws.matrix("stiffness"))
    ratio = _matches(simulation, [[one.shear_stiffness / one.stiffness for one in row] for row in laws.laws])
    physics = [f"Ip2_FrictViscoMat_FrictViscoMat_FrictViscoPhys(kn={normal}, kRatio={ratio}{rubs})"]
    return geometry, physics, ["Law2_ScGeom_FrictViscoPhys_CundallStrackVisco(sphericalBodies=False)"]


def _rolling(simulation: Simulation) -> tuple[str, str]:
    """Return what the parameters of contacts and the law of Hertz say of rolling friction.

    The moment is at most eta times the mean radius of two spheres and the normal force; that of others, the coefficient
    times the effective radius, is half of it between equal spheres. Where pairs differ the script sets the moment of
    each contact.
    """
    if not simulation.laws.rolls:
        return "", ""
    law = max((law for _, _, law in simulation.laws.pairs()), key=lambda law: law.rolling_friction)
    stiffness = simulation.rolling(law)[0] * (simulation.diameter / 4) ** 2
    return f", krot={stiffness!r}, eta={law.rolling_friction / 2!r}", ", includeMoment=True"


def _engines(simulation: Simulation) -> list[str]:
    """Return the lines that make materials, periodic cell and engines."""
    bodies, walls = simulation.bodies, simulation.walls
    shapes = [name for name, kinds in SHAPES.items() if _kinds(simulation) & kinds]
    bounds = ", ".join(f"Bo1_{name}_Aabb()" for name in [*shapes, "Wall", "Facet"])
    verlet = repr(VERLET * bodies.least_radius)
    gravity = ", ".join(repr(float(value)) for value in simulation.gravity)
    # without gravity grains that bear nothing come to rest by damping alone
    usual = "damping=0" if simulation.stress is None else f"damping={DAMPING!r}"
    damped = damping(simulation) if "Polyhedra" in shapes else usual
    lines = cell_lines(simulation) if any(walls.periodic) else []
    return [
        *lines,
        *_materials(simulation),
        "O.engines = [",
        "    ForceResetter(),",
        f"    InsertionSortCollider([{bounds}], verletDist={verlet}, allowBiggerThanPeriod=True),",
        "    InteractionLoop(",
        *(f"        [{', '.join(group)}]," for group in _contacts(simulation, shapes)),
        "    ),",
        *_servo(simulation),
        *(["    PyRunner(command='limit_moments()', iterPeriod=10),"] if simulation.laws.rolls else []),
        f"    NewtonIntegrator({damped}, gravity=({gravity})),",
        "]",
        f"O.dt = {simulation.time_step!r}",
        "",
    ]


def _servo(simulation: Simulation) -> list[str]:
    """Return the engine that keeps the stress of walls, or of a periodic cell, in which compression is below 0."""
    if simulation.stress is None:
        return []
    if simulation.platens:
        return ["    PyRunner(command='move_platens()', iterPeriod=1),"]
    kept = ~np.isnan(simulation.stress)
    goal = ", ".join(repr(float(value)) for value in np.where(kept, -simulation.stress, 0.0))
    mask, rate = int(linear.matmul(kept, np.array([1, 2, 4]))), RATE / simulation.time_unit
    return [
        f"    PeriTriaxController(goal=({goal}), stressMask={mask}, maxStrainRate=({rate!r}, {rate!r}, {rate!r}),",
        "        globUpdate=1, relStressTol=1e-3, maxUnbalanced=0),",
    ]


def _grains(simulation: Simulation) -> list[str]:
    """Return the table of grains."""
    bodies = simulation.bodies
    grains = bodies.assembly
    table = np.column_stack([grains.scale, bodies.mass, grains.position, bodies.principal_orientation, bodies.moments])
    lines = ["# kind, template, scale, mass, centroid x y z, orientation of principal axes w x y z, principal moments"]
    for number, row in zip(grains.shape_id.tolist(), table, strict=True):
        template = bodies.templates[number]
        lines.append(f"{template.kind} {template.name} {row_of(row)}")
    return lines


def _spheres(simulation: Simulation) -> list[str]:
    """Return the table of all spheres, as `ymport.textClumps` takes them."""
    centers, radii, grain = simulation.bodies.spheres
    rows = np.column_stack([centers, radii])
    lines = [f"{row_of(row)} {number}" for row, number in zip(rows, grain.tolist(), strict=True)]
    return ["# x y z r clumpId: the number of the grain, from 0", *lines]


def _clump(template: Template) -> list[str]:
    """Return the spheres of a template as `ymport.textClumps` takes them."""
    lines = [f"{row_of(row)} 0" for row in np.column_stack(template.spheres)]
    return [
        f"# {template.name}: x y z r clumpId at the size of the shape, in its body frame about the centroid",
        *lines,
    ]


def _lattice(template: Template) -> tuple[list[str], float]:
    """Return the distances of the points of a lattice from a surface as lines, and how far off its zero is, m."""
    shape, axes = template.shape, template.principal.axes
    corners = linear.matmul(shape.vertices, axes)
    spacing = shape.diameter / CELLS
    low = np.floor(corners.min(axis=0) / spacing) - AROUND
    count = (np.ceil(corners.max(axis=0) / spacing) + AROUND - low + 1).astype(np.int64)
    places = [(low[k] + np.arange(count[k])) * spacing for k in range(3)]
    points = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1).reshape(-1, 3)
    distances = shape.signed_distance(linear.matmul(points, axes.T)).reshape(count)
    at = (corners / spacing - low).T
    error = float(np.abs(load("scipy.ndimage").map_coordinates(distances, at, order=1)).max())
    lines = [
        f"# {template.name} at its own size, in its principal frame: lower corner x y z, spacing, points along x y z;",
        "# then distances from the surface, below 0 inside, one line along z for each x and y",
        f"{row_of(low * spacing)} {float(spacing)!r} {' '.join(map(str, count.tolist()))}",
    ]
    lines += [" ".join(f"{value:.10g}" for value in line) for line in distances.reshape(-1, int(count[2]))]
    return lines, error


def _read(folder: Path) -> Held:
    """Return what the tables of grains and spheres hold.

    Raises
    ------
    FileFormatError
        If a table is damaged.
    """
    text = (folder / GRAINS).read_text(encoding="utf-8").splitlines()
    rows = [line.split() for line in text if line.strip() and not line.startswith("#")]
    if not rows or any(len(row) != 14 for row in rows):
        raise FileFormatError(f"{folder / GRAINS} has lines without 14 columns: write it again")
    table = np.array([row[3:] for row in rows], dtype=float)
    matrices = rotation_matrices(table[:, 4:8])
    inertia = linear.einsum("nij,nj,nkj->nik", matrices, table[:, 8:], matrices)
    path = folder / SPHERES
    spheres = np.loadtxt(path, ndmin=2) if path.is_file() else np.zeros((0, 5))
    return Held(table[:, 0], table[:, 1:4], inertia, spheres[:, :3], spheres[:, 3])


registration = Engine(
    title=TITLE,
    summary="Python script, with tables of grains, spheres, distances, corners and walls",
    source="YADE 2023.02a, reference of classes and source",
    kinds=("sphere", "clump", "level_set", "polyhedron"),
    tilted=True,
    cohesion=True,
    fixed=True,
    servo=True,
    platens=True,
    materials=True,
    rolling=("hertz",),
    install=INSTALL,
    verified="run with YADE 2023.02a of Debian 12",
    command=f"yade -n -x {SCRIPT}",
    write=_write,
    read=_read,
)
