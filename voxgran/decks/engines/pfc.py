"""PFC of Itasca: spheres, clumps by templates, and convex polyhedra as rigid blocks, as command files.

The commands are those that versions 6, 7 and 9 have in common; a size is given as `diameter`, since the keyword of a
volume differs between the versions.

References
----------
docs.itascacg.com/pfc700, pages of the commands `model domain`, `model mechanical`, `contact cmat default`,
`contact cmat add`, `range`, `ball create`, `ball fix`, `ball group`, `clump template`, `clump replicate`,
`rblock create`, `wall create`, `wall servo`, of `linear`, `rrlinear`, `hysteretic` and FISH.
"""

import functools
import math
from collections.abc import Mapping

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError
from voxgran.decks.bodies import Template
from voxgran.decks.contact_law import ContactLaw
from voxgran.decks.engine import Engine, row_of, text_of
from voxgran.decks.facets import facets_of
from voxgran.decks.pfc_reader import GRAINS, RUN, read_deck
from voxgran.decks.simulation import SETTLING, STRESS_MET, Simulation, rows_of
from voxgran.shapes.mesh import hull_of

TITLE = "PFC"
#: names of files
TEMPLATES, WALLS = "pfc_clumps.dat", "pfc_walls.dat"
#: what PFC calls grains of each kind
NAMES = {"sphere": "ball", "clump": "clump", "polyhedron": "rblock"}
#: local damping of grains between walls that keep a stress, a share of the net force
DAMPING = 0.2
#: largest radius of a sphere, in least extents of the domain
LARGEST_SPHERE = 0.25


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the files.

    Raises
    ------
    InputError
        If rigid blocks are to have the law of Hertz or rolling friction, or a sphere is too large for the container.
    """
    law, bodies = simulation.law, simulation.bodies
    curved = "law is 'hertz'" if law.name == "hertz" else "rolling_friction is given" if simulation.laws.rolls else ""
    if curved and "polyhedron" in bodies.kinds:
        raise InputError(
            f"material {curved} for polyhedra: contacts of PFC's rigid blocks have no radius of curvature, which it "
            "needs; use law='linear' without rolling_friction, or give clump=20"
        )
    low, high = simulation.domain(float(bodies.assembly.bounding_radii.max()))
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


def _contact(law: ContactLaw) -> str:
    """Return a contact law as contact model and properties."""
    if law.name == "linear":
        return (
            f"model {'rr' * (law.rolling_friction > 0)}linear property kn {law.stiffness!r} ks {law.shear_stiffness!r} "
            f"fric {law.friction!r} dp_nratio {law.damping_ratio!r}"
            + (f" rr_fric {law.rolling_friction!r}" if law.rolling_friction else "")
        )
    shear = law.young_modulus / (2 * (1 + law.poisson_ratio))
    return (
        f"model hysteretic property hz_shear {shear!r} hz_poiss {law.poisson_ratio!r} fric {law.friction!r} "
        f"dp_en {law.restitution!r}"
    )


def _pair(number: int, first: int, second: int, law: ContactLaw) -> str:
    """Return the command of the law of contacts between two materials, which are groups."""
    other = "matches 2" if first == second else f"group 'material_{second + 1}'"
    return f"contact cmat add {number} {_contact(law)} range group 'material_{first + 1}' {other}"


def _groups(simulation: Simulation) -> list[str]:
    """Return the commands that put grains into the groups of their materials, and that fix grains."""
    bodies, laws = simulation.bodies, simulation.laws
    material, lines = np.array(laws.of_shapes)[bodies.assembly.shape_id], []
    for kind in sorted(bodies.kinds):
        mine = np.isin(np.arange(bodies.count), bodies.of_kind(kind))
        for k in range(laws.count if laws.count > 1 else 0):
            name = f"{NAMES[kind]} group 'material_{k + 1}'"
            lines += [f"{name} range id {first} {last}" for first, last in rows_of(mine & (material == k))]
        ends = rows_of(mine & ~bodies.assembly.movable)
        lines += [f"{NAMES[kind]} fix velocity spin range id {first} {last}" for first, last in ends]
    return lines


def _platens(simulation: Simulation) -> list[str]:
    """Return the commands of walls that keep a stress, and of what brings grains that bear nothing to rest."""
    names = {wall.name: number for number, wall in enumerate(facets_of(simulation), 1)}
    lines = [
        f"wall servo activate on force-{'xyz'[plane.axis]} {plane.inward * force!r} velocity-max {speed!r} "
        f"range id {names[plane.name]}"
        for plane, force, speed in simulation.platens
    ]
    return lines + (
        [f"{NAMES[kind]} attribute damp {DAMPING!r}" for kind in sorted(simulation.bodies.kinds)] if lines else []
    )


def _setup(simulation: Simulation, low: Floats, high: Floats) -> list[str]:
    """Return the commands that make the model."""
    walls, bodies, laws = simulation.walls, simulation.bodies, simulation.laws
    conditions = " ".join("periodic" if axis else "stop" for axis in walls.periodic)
    extent = row_of(np.stack([low, high], axis=1).ravel())
    called = [TEMPLATES] if "clump" in bodies.kinds else []
    return [
        "model new",
        "model large-strain on",
        f"model domain extent {extent}",
        f"model domain condition {conditions}",
        f"contact cmat default {_contact(simulation.law)}",
        *(_pair(number, a, b, law) for number, (a, b, law) in enumerate(laws.pairs() if laws.count > 1 else (), 1)),
        *(f"program call '{name}'" for name in (*called, GRAINS, WALLS)),
        "model energy mechanical on",
        "model orientation-tracking on",
        f"model gravity {row_of(simulation.gravity)}",
        *_platens(simulation),
        f"model mechanical timestep fix {simulation.time_step!r}",
    ]


def _course(simulation: Simulation) -> list[str]:
    """Return the commands that run until the bed rests, and save the model at each output, from which it goes on."""
    steps = simulation.steps_per_output
    frames = math.ceil(simulation.steps / steps)
    parts = [f"{NAMES[kind]}.energy('energy-kinetic')" for kind in sorted(simulation.bodies.kinds)]
    rests, press = list[str](), list[str]()
    if simulation.platens:
        # the largest relative difference of the force on a wall from the one asked for
        missed = [
            f"math.abs(math.abs(wall.force.contact(wall.find('{plane.name}'), {plane.axis + 1})) / {force!r} - 1.0)"
            for plane, force, _ in simulation.platens
        ]
        worst = functools.reduce(lambda one, other: f"math.max({one}, {other})", missed)
        press = ["fish define missed_stress", f"  missed_stress = {worst}", "end"]
    if simulation.gravity.any() or simulation.platens:
        first = math.ceil(SETTLING * simulation.time_unit / (steps * simulation.time_step))
        rests = [
            f"    if frame >= {first} then",
            f"      if kinetic_energy < {simulation.rest_energy!r} then",
            *([f"        if missed_stress < {STRESS_MET!r} then"] if press else []),
            f"        frame = {frames}",
            *(["        endif"] if press else []),
            "      endif",
            "    endif",
        ]
    return [
        *press,
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
    pebbles = np.column_stack([radii, linear.matmul(centers, template.principal.axes)])
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
            world = linear.matmul(scale * points, grains.matrices[k].T) + place
            lines += [f"  {row_of(point)} ..." for point in world[:-1]]
            lines.append(f"  {row_of(world[-1])}")
    return [*lines, *_ball_densities(simulation), *_groups(simulation)]


def _ball_densities(simulation: Simulation) -> list[str]:
    """Return the commands that give spheres their density; where densities differ, by the groups of shapes."""
    bodies = simulation.bodies
    used = np.unique(bodies.assembly.shape_id[bodies.of_kind("sphere")])
    if isinstance(bodies.assembly.density, float):
        return [f"ball attribute density {bodies.assembly.density!r}"] if len(used) else []
    return [f"ball attribute density {bodies.densities[k]!r} range group '{bodies.templates[k].name}'" for k in used]


def _turn(quaternion: Floats) -> str:
    """Return a rotation as axis and angle in degrees; empty for none."""
    sine = float(linear.norm(quaternion[1:]))
    if sine == 0.0:
        return ""
    angle = math.degrees(2 * math.atan2(sine, float(quaternion[0])))
    return f" axis {row_of(quaternion[1:] / sine)} angle {angle!r}"


def _corners(template: Template) -> tuple[Floats, float]:
    """Return corners of a polyhedron about its own centroid, and its true volume over that of their convex hull.

    PFC computes mass and centroid from the hull; with this share of the density the mass is the true one.
    """
    solid = template.polyhedron
    points = solid.vertices[np.unique(solid.faces)]
    hull = hull_of(points)
    return points - hull.centroid, float(template.shape.volume / hull.volume)


def _approximations(simulation: Simulation) -> list[str]:
    """Return what PFC holds only nearly, as sentences."""
    lines = [f"wall {wall.name}: {wall.note}" for wall in facets_of(simulation) if wall.note]
    for template in simulation.bodies.templates:
        if template.kind == "polyhedron":
            points, share = _corners(template)
            true, held = template.shape.inertia, share * hull_of(points).inertia
            error = float(linear.norm(held - true) / linear.norm(true))
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
        if simulation.laws.count > 1:
            lines.append(f"wall group 'material_{simulation.laws.of_walls[wall.name] + 1}' range id {number}")
    return lines


registration = Engine(
    title=TITLE,
    summary="command files: spheres, clumps by templates, rigid blocks, walls of facets, and a run until rest",
    upright="whose domain lies along the axes",
    source="docs.itascacg.com/pfc700",
    kinds=("sphere", "polyhedron", "clump"),
    fixed=True,
    platens=True,
    materials=True,
    rolling=("linear",),
    verified="not run; read back by the grammar of its documentation",
    command=f"program call '{RUN}' in PFC3D",
    write=_write,
    read=read_deck,
)
