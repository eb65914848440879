"""MercuryDPM: spheres and clumps as tables of pebbles in the layout of MClump, with a driver in C++ that reads them.

References
----------
MercuryDPM, files `Drivers/Clump/ClumpHeaders/ClumpInput.h` (layout of the tables), `Mercury3DClump.h`,
`Kernel/Particles/ClumpParticle.h`, `Kernel/SpeciesHandler.h`, `Kernel/Walls/BaseWall.cc` (`setForceControl`),
in `Kernel/Interactions` `LinearViscoelasticInteraction.cc`, `HertzianViscoelasticInteraction.cc`,
`FrictionInteraction.cc` and `MindlinRollingTorsionInteraction.cc`; Ostanin et al. 2023 (arXiv:2310.05027).
"""

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from voxgran._base.arithmetic import linear
from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.bodies import Template
from voxgran.decks.contact_law import ContactLaw
from voxgran.decks.engine import Engine, Held, grain_rows, program_part, row_of, text_of
from voxgran.decks.facets import facets_of
from voxgran.decks.simulation import SETTLING, STRESS_MET, Simulation
from voxgran.geometry.rotation import rotation_matrices

TITLE = "MercuryDPM"
#: names of files
RUN, GRAINS, WALLS = "mercury_run.cpp", "mercury_grains.csv", "mercury_walls.csv"
#: tables of a template, each with the file of MClump that has its layout
TABLES = {"pebbles": "Clump/Clump.txt", "mass": "Inertia/Mass.txt", "toi": "Inertia/TOI.txt", "pd": "Inertia/PD.txt"}
#: columns of a grain after the name of its template: principal axes in columns, row by row
COLUMNS = (
    *("scale", "mass", "x", "y", "z"),
    *(f"axis_{row}{column}" for row in "xyz" for column in "123"),
    *("velocity_x", "velocity_y", "velocity_z", "spin_x", "spin_y", "spin_z"),
)
#: species of each law, without and with rolling friction
SPECIES = {
    "linear": ("LinearViscoelasticSlidingFriction", "LinearViscoelasticFriction"),
    "hertz": ("HertzianViscoelasticMindlin", "HertzianViscoelasticMindlinRollingTorsion"),
}
#: a number in a table
NUMBER = r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?"

#: how to run the driver
HELP = (
    "copy all files to a folder in Drivers/Clump of MercuryDPM, with the CMakeLists.txt of another driver there,",
    "build mercury_run, and run it where the .csv and .txt files are; mercury_run mercury_state.csv goes on from",
    "the last output; the damping is set for each pair of grains, so that it runs on one thread",
)


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the files.

    Raises
    ------
    InputError
        If a periodic cell is tilted so far that MercuryDPM would not make all copies of grains.
    """
    bodies = simulation.bodies
    used = {int(k) for k in bodies.assembly.shape_id}
    files = {RUN: _driver(simulation), GRAINS: _grains(simulation)}
    if simulation.walls.needs_triangles and not len(simulation.walls.slopes):
        found, of_walls = facets_of(simulation, planes=False), simulation.laws.of_walls
        triangles = [f"{row_of(row, ',')},{of_walls[wall.name]}"
                     for wall in found for row in wall.vertices[wall.faces].reshape(-1, 9)]  # fmt: skip
        notes = [wall.note for wall in found if wall.note]
        files[WALLS] = text_of([*simulation.comments(TITLE, *notes), *triangles])
    for k, template in enumerate(bodies.templates):
        if k in used:
            for table, rows in _tables(template, bodies.densities[k]).items():
                files[f"mercury_{template.name}_{table}.txt"] = text_of(row_of(row, ",") for row in rows)
    return files


def _tables(template: Template, density: float) -> dict[str, Floats]:
    """Return pebbles, mass, inertia tensor and principal directions of a template, in its principal frame."""
    centers, radii = template.spheres
    return {
        "pebbles": np.column_stack([linear.matmul(centers, template.principal.axes), radii]),
        "mass": np.array([[density * template.shape.volume]]),
        "toi": density * np.diag(template.principal.moments),
        "pd": np.eye(3),
    }


def _grains(simulation: Simulation) -> str:
    """Return the table of the grains."""
    bodies, grains = simulation.bodies, simulation.bodies.assembly
    axes = rotation_matrices(bodies.principal_orientation).reshape(-1, 9)
    walls, places = simulation.walls, grains.position.copy()
    # copies are made of grains within the upright bounds
    for axis in np.flatnonzero(walls.periods.diagonal())[::-1]:
        turns = np.floor((places[:, axis] - walls.bounds[0, axis]) / walls.periods[axis, axis])
        places -= turns[:, None] * walls.periods[axis]
    rows = np.column_stack([grains.scale, bodies.mass, places, axes, np.zeros((grains.count, 6))])
    lines = [*simulation.comments(TITLE), f"# template,{','.join(COLUMNS)}"]
    for shape, row in zip(grains.shape_id.tolist(), rows, strict=True):
        lines.append(f"{bodies.templates[shape].name},{row_of(row, ',')}")
    return text_of(lines)


def _vector(values: Iterable[float]) -> str:
    """Return a vector in C++."""
    return f"Vec3D({', '.join(repr(float(value)) for value in values)})"


def _driver(simulation: Simulation) -> str:
    """Return the driver: grains, walls, contact law, and a run until the bed rests."""
    templates, laws = simulation.bodies.templates, simulation.laws
    kind = SPECIES[simulation.law.name][laws.rolls]
    materials = ", ".join(f'{{"{one.name}", {k}}}' for one, k in zip(templates, laws.of_shapes, strict=True))
    fixed = ", ".join(f"{{{first}, {last}}}" for first, last in simulation.fixed)
    lines = [
        *simulation.comments(TITLE, *HELP, mark="//"),
        program_part("mercury_includes.cpp"),
        f"typedef {kind}Species SPECIES;",
        f"const unsigned STEPS_PER_OUTPUT = {simulation.steps_per_output};",
        f"const bool SETTLES = {str(bool(simulation.gravity.any() or simulation.platens)).lower()};",
        "// time in which a drag stops grains that bear nothing, s; 0 without",
        f"const double DRAG_TIME = {simulation.time_unit if simulation.platens else 0.0!r};",
        f"const double STRESS_MET = {STRESS_MET!r};",
        "// number of the material of each template; first and last number of each row of fixed grains, from 1",
        f"const std::map<std::string, unsigned> MATERIALS = {{{materials}}};",
        f"const std::vector<std::pair<unsigned, unsigned>> FIXED = {{{fixed}}};",
        f"const double SETTLING_TIME = {SETTLING * simulation.time_unit!r};",
        f"const double REST_ENERGY = {simulation.rest_energy!r};",
        program_part("mercury_bed.cpp"),
        *_damping(simulation),
        "",
        *_walls(simulation),
        "};",
        "",
        *_main(simulation),
    ]
    return text_of(lines)


def _damping(simulation: Simulation) -> list[str]:
    """Return the function that sets the damping of two materials for two grains of an effective mass."""
    if simulation.law.name == "linear":
        laws = simulation.laws.laws
        rows = (", ".join(repr(2 * law.damping_ratio * math.sqrt(law.stiffness)) for law in row) for row in laws)
        body = [
            f"        static const double factors[{len(laws)}][{len(laws)}] = {{{{{'}, {'.join(rows)}}}}};",
            "        BaseSpecies* pair = speciesHandler.getMixedObject(first, second);",
            "        dynamic_cast<LinearViscoelasticNormalSpecies*>(pair)->setDissipation(",
            "            factors[first][second] * std::sqrt(mass));",
        ]
    else:
        # the restitution of the law of Hertz does not depend on the mass
        body = ["        (void)first;", "        (void)second;", "        (void)mass;"]
    return ["    void setDamping(unsigned first, unsigned second, double mass)", "    {", *body, "    }"]


def _least_sides(simulation: Simulation) -> Floats:
    """Return the parts of periods (3, 3) across their own axes, at most half of the lengths that they are along.

    All sums of the periods are the same with them.

    Raises
    ------
    InputError
        If copies across two tilted sides would need a second copy along x, of which MercuryDPM makes one.
    """
    found, reach = simulation.walls.periods.copy(), 2.0 * float(simulation.bodies.assembly.bounding_radii.max())
    for k, along in ((1, 0), (2, 1), (2, 0)):
        if length := found[along, along]:
            found[k] -= np.rint(found[k, along] / length) * found[along]
    tilts = np.tril(found, -1)
    if tilts.any() and np.abs(tilts[:, 0]).sum() > found[0, 0] - reach:
        raise InputError(
            f"tilt: xy and xz are {tilts[1, 0]:.4g} and {tilts[2, 0]:.4g} m, more together than the length along x of "
            f"{found[0, 0]:.4g} m less a grain of {reach:.4g} m, and MercuryDPM copies grains once across each side; "
            "choose engine 'lammps' or 'yade'"
        )
    return np.asarray(tilts)


def _walls(simulation: Simulation) -> list[str]:
    """Return the function that adds the walls."""
    walls, kind = simulation.walls, simulation.laws.of_walls
    lines, moving = ["    void addWalls()", "    {"], {platen.plane.name: platen for platen in simulation.platens}
    for plane in walls.planes:
        at = f"{_vector(-plane.normal)}, {_vector(np.eye(3)[plane.axis] * plane.level)}, {kind[plane.name]}"
        platen = moving.get(plane.name)
        made = f"addPlane({at})" if platen is None else f"addPlaten({at}, {platen.force!r}, {platen.speed!r})"
        lines.append(f"        {made};")
    side = _least_sides(simulation)
    # what the shift along z or y takes beyond the sides across x is brought back by these, which come last
    for axis in (2, 1, 0):
        if walls.periodic[axis]:
            low, high = walls.bounds[:, axis].tolist()
            across = f"{_vector(np.eye(3)[axis])}, {low!r}, {high!r}, {_vector(side[axis])}"
            lines.append(f"        addPeriodic({across});")
    if walls.round is not None and walls.round.kind == "cylinder":
        lines += [
            "        AxisymmetricIntersectionOfWalls cylinder;",
            f"        cylinder.setSpecies(species[{kind['round']}]);",
            f"        cylinder.setPosition({_vector(walls.round.center)});",
            "        cylinder.setAxis(Vec3D(0.0, 0.0, 1.0));",
            f"        cylinder.addObject(Vec3D(1.0, 0.0, 0.0), {_vector([walls.round.radius, 0, 0])});",
            "        wallHandler.copyAndAddObject(cylinder);",
        ]
    for point, inward in walls.slopes:
        lines.append(f"        addPlane({_vector(-inward)}, {_vector(point)}, {kind['mesh']});")
    if walls.needs_triangles and not len(walls.slopes):
        lines.append(f'        addTriangles("{WALLS}");')
    return [*lines, "    }"]


def _species(simulation: Simulation) -> list[str]:
    """Return the lines that make the materials and the laws between them."""
    laws, lines = simulation.laws, list[str]()
    for k in range(laws.count):
        lines.append("    bed.species.push_back(bed.speciesHandler.copyAndAddObject(SPECIES()));")
        lines.append(f"    bed.species.back()->setDensity({laws.laws[k][k].density!r});")
    for a, b, law in laws.pairs():
        both = f"bed.species[{a}], bed.species[{b}]"
        pair = f"bed.species[{a}]" if a == b else f"bed.speciesHandler.getMixedObject({both})"
        lines += ["    {", f"        auto* law = {pair};"]
        lines += [f"        law->{name}({arguments});" for name, arguments in _numbers(simulation, law).items()]
        lines.append("    }")
    return lines


def _numbers(simulation: Simulation, law: ContactLaw) -> dict[str, str]:
    """Return the arguments of the functions that set the numbers of a law."""
    found = {"setSlidingFrictionCoefficient": repr(law.friction)}
    if law.name == "linear":
        found |= {"setStiffness": repr(law.stiffness), "setSlidingStiffness": repr(law.shear_stiffness)}
    else:
        shear = law.young_modulus / (2 * (1 + law.poisson_ratio))
        found["setEffectiveShearModulus"] = repr(shear / (2 * (2 - law.poisson_ratio)))
        given = f"{law.effective_modulus!r}, {law.restitution!r}"
        found["setEffectiveElasticModulusAndRestitutionCoefficient"] = given
    if simulation.laws.rolls:
        # MercuryDPM takes twice the effective radius for the arm of rolling, both of the motion and of the force
        spring, dashpot = simulation.rolling(law)
        found |= {"setRollingStiffness": repr(spring / 4)} if law.name == "linear" else {}
        found["setRollingDissipation"] = repr(dashpot / 4)
        found["setRollingFrictionCoefficient"] = repr(law.rolling_friction / 2)
    return found


def _main(simulation: Simulation) -> list[str]:
    """Return the main function."""
    low, high = simulation.domain(float(simulation.bodies.assembly.bounding_radii.max()))
    return [
        "int main(int argc, char* argv[])",
        "{",
        "    Bed bed;",
        '    bed.setName("mercury_run");',
        f"    bed.setGravity({_vector(simulation.gravity)});",
        f"    bed.setMin({_vector(low)});",
        f"    bed.setMax({_vector(high)});",
        *_species(simulation),
        "    if (argc > 1) bed.grains = argv[1];",
        f"    bed.setTimeStep({simulation.time_step!r});",
        f"    bed.setTimeMax({simulation.duration!r});",
        "    bed.setSaveCount(STEPS_PER_OUTPUT);",
        "    bed.solve();",
        "    return 0;",
        "}",
    ]


def _read(folder: Path) -> Held:
    """Return what the files hold.

    Raises
    ------
    FileFormatError
        If a table is not in the layout of MClump, or a row has too few columns.
    """
    names, values = grain_rows(folder / GRAINS, len(COLUMNS))
    tables = {name: _template(folder, name) for name in sorted(set(names))}
    axes = values[:, 5:14].reshape(-1, 3, 3)
    inertia, centers, radii = [], [], []
    for name, value, frame in zip(names, values, axes, strict=True):
        table = tables[name]
        inertia.append(linear.matmul(linear.matmul(frame, value[0] ** 5 * table["toi"]), frame.T))
        centers.append(linear.matmul(value[0] * table["pebbles"][:, :3], frame.T) + value[2:5])
        radii.append(value[0] * table["pebbles"][:, 3])
    return Held(values[:, 1], values[:, 2:5], np.array(inertia), np.concatenate(centers), np.concatenate(radii))


def _template(folder: Path, name: str) -> dict[str, Floats]:
    """Return the tables of a template; each line is as the reader of MClump's tables takes it.

    Raises
    ------
    FileFormatError
        If a line is something else than numbers between commas, or their number is wrong.
    """
    shapes = {"pebbles": (None, 4), "mass": (1, 1), "toi": (3, 3), "pd": (3, 3)}
    found = {}
    for table, (count, width) in shapes.items():
        path = folder / f"mercury_{name}_{table}.txt"
        lines = path.read_text().splitlines()
        good = all(re.fullmatch(",".join([NUMBER] * width), line) for line in lines)
        if not good or not lines or count not in (None, len(lines)):
            raise FileFormatError(f"{path} is not as MClump has {TABLES[table]}: write the deck again")
        found[table] = np.array([[float(word) for word in line.split(",")] for line in lines])
    return found


registration = Engine(
    title=TITLE,
    summary="tables of pebbles in the layout of MClump, table of grains, and a driver in C++ that runs until rest",
    source="MercuryDPM, Drivers/Clump and tools/MClump",
    kinds=("sphere", "clump"),
    tilted=True,
    fixed=True,
    platens=True,
    materials=True,
    rolling=("linear", "hertz"),
    verified="not run; driver compiled against the declarations of its headers",
    write=_write,
    read=_read,
)
