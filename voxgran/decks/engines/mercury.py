"""MercuryDPM: spheres and clumps as tables of pebbles in the layout of MClump, with a driver in C++ that reads them.

References
----------
MercuryDPM, files `Drivers/Clump/ClumpHeaders/ClumpInput.h` (layout of the tables), `Mercury3DClump.h`,
`Kernel/Particles/ClumpParticle.h`, `Kernel/Interactions/NormalForceInteractions/LinearViscoelasticInteraction.cc` and
`HertzianViscoelasticInteraction.cc`; Ostanin et al. 2023 (arXiv:2310.05027).
"""

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import FileFormatError
from voxgran.decks.bodies import Template
from voxgran.decks.engine import Engine, Held
from voxgran.decks.facets import facets_of
from voxgran.decks.simulation import SETTLING, Simulation
from voxgran.decks.text import row_of, text_of
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
#: room between the walls and the bounds of the domain, in median diameters
MARGIN = 2.0
#: walls that are made of triangles
FACETED = ("round", "mesh")
#: a number in a table
NUMBER = r"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?"

#: how to run the driver
HELP = (
    "copy all files to a folder in Drivers/Clump of MercuryDPM, with the CMakeLists.txt of another driver there,",
    "build mercury_run, and run it where the .csv and .txt files are; mercury_run mercury_state.csv goes on from",
    "the last output; the damping is set for each pair of grains, so that it runs on one thread",
)
#: names that the driver uses
INCLUDES = """\
#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <utility>
#include <vector>
#include "Mercury3D.h"
#include "Boundaries/PeriodicBoundary.h"
#include "Particles/ClumpParticle.h"
#include "Species/HertzianViscoelasticMindlinSpecies.h"
#include "Species/LinearViscoelasticSlidingFrictionSpecies.h"
#include "Walls/AxisymmetricIntersectionOfWalls.h"
#include "Walls/InfiniteWall.h"
#include "Walls/TriangleWall.h"
#include "../ClumpHeaders/Mercury3DClump.h"
"""

#: the driver between its constants and its walls
CLASS = """\

// Rows of a comma-separated file, each as its first word and its numbers.
struct Row {
    std::string name;
    std::vector<double> values;
};

std::vector<Row> readTable(const std::string& name, bool named) {
    std::ifstream file(name);
    if (!file) logger(ERROR, "cannot read %", name);
    std::vector<Row> rows;
    std::string line, word;
    while (std::getline(file, line)) {
        if (line.empty() || line[0] == '#') continue;
        std::istringstream words(line);
        Row row;
        if (named) std::getline(words, row.name, ',');
        while (std::getline(words, word, ',')) row.values.push_back(std::stod(word));
        rows.push_back(row);
    }
    return rows;
}

// Pebbles and inertia tensor.
typedef std::pair<std::vector<Row>, std::vector<Row>> Template;

class Bed : public Mercury3Dclump {
public:
    void setupInitialConditions() override {
        addGrains();
        addWalls();
    }

    // Pebbles carry the inverse mass of their clump, on which alone gravity acts.
    void computeExternalForces(BaseParticle* p) override {
        if (!p->isPebble()) Mercury3Dclump::computeExternalForces(p);
    }

    void computeInternalForce(BaseParticle* p, BaseParticle* q) override {
        setDamping(1.0 / (p->getInvMass() + q->getInvMass()));
        Mercury3Dclump::computeInternalForce(p, q);
    }

    void computeForcesDueToWalls(BaseParticle* p, BaseWall* w) override {
        setDamping(1.0 / p->getInvMass());
        Mercury3Dclump::computeForcesDueToWalls(p, w);
    }

    void actionsAfterTimeStep() override {
        if (getNumberOfTimeSteps() % STEPS_PER_OUTPUT == 0) writeGrains("mercury_state.csv");
    }

    bool continueSolve() const override {
        if (!SETTLES || getTime() < SETTLING_TIME || getNumberOfTimeSteps() % STEPS_PER_OUTPUT != 0) return true;
        double energy = 0.0;
        for (const ClumpParticle* clump : clumps_) energy += clump->getKineticEnergy() + clump->getRotationalEnergy();
        return energy >= REST_ENERGY;
    }

    SPECIES* species = nullptr;
    std::string grains = "mercury_grains.csv";

private:
    const Template& templateOf(const std::string& name) {
        const std::string stem = "mercury_" + name;
        if (templates_.count(name) == 0)
            templates_[name] = {readTable(stem + "_pebbles.txt", false), readTable(stem + "_toi.txt", false)};
        return templates_[name];
    }

    void addGrains() {
        for (const Row& row : readTable(grains, true)) {
            const Template& shape = templateOf(row.name);
            const std::vector<double>& v = row.values;
            const double fifth = std::pow(v[0], 5);
            const std::vector<Row>& toi = shape.second;
            ClumpParticle clump;
            clump.setSpecies(species);
            clump.setClump();
            double largest = 0.0;
            for (const Row& pebble : shape.first) {
                const std::vector<double>& s = pebble.values;
                clump.addPebble(Vec3D(v[0] * s[0], v[0] * s[1], v[0] * s[2]), v[0] * s[3]);
                largest = std::max(largest, v[0] * s[3]);
            }
            clump.setRadius(largest);
            clump.setClumpMass(v[1]);
            // xx, xy, xz, yy, yz, zz in the principal frame
            clump.setInitInertia(MatrixSymmetric3D(fifth * toi[0].values[0], 0.0, 0.0, fifth * toi[1].values[1], 0.0,
                                                   fifth * toi[2].values[2]));
            clump.setPosition(Vec3D(v[2], v[3], v[4]));
            clump.setPrincipalDirections(Matrix3D(v[5], v[6], v[7], v[8], v[9], v[10], v[11], v[12], v[13]));
            clump.rotateTensorOfInertia();
            clump.setVelocity(Vec3D(v[14], v[15], v[16]));
            clump.setAngularVelocity(Vec3D(v[17], v[18], v[19]));
            clump.setDamping(0.0);
            rows_.push_back(row);
            clumps_.push_back(particleHandler.copyAndAddObject(clump));
        }
    }

    void writeGrains(const std::string& name) const {
        std::ofstream file(name);
        file.precision(17);
        for (std::size_t n = 0; n < clumps_.size(); ++n) {
            const ClumpParticle& clump = *clumps_[n];
            const Vec3D x = clump.getPosition(), u = clump.getVelocity(), w = clump.getAngularVelocity();
            const Vec3D a = clump.getPrincipalDirections_e1(), b = clump.getPrincipalDirections_e2(),
                c = clump.getPrincipalDirections_e3();
            file << rows_[n].name << ',' << rows_[n].values[0] << ',' << rows_[n].values[1];
            for (double value : {x.X, x.Y, x.Z, a.X, b.X, c.X, a.Y, b.Y, c.Y, a.Z, b.Z, c.Z,
                                 u.X, u.Y, u.Z, w.X, w.Y, w.Z}) file << ',' << value;
            file << "\\n";
        }
    }

    void addTriangles(const std::string& name) {
        for (const Row& row : readTable(name, false)) {
            const std::vector<double>& v = row.values;
            TriangleWall wall;
            wall.setSpecies(species);
            wall.setVertices(Vec3D(v[0], v[1], v[2]), Vec3D(v[3], v[4], v[5]), Vec3D(v[6], v[7], v[8]));
            wallHandler.copyAndAddObject(wall);
        }
    }

    void addPlane(Vec3D outward, Vec3D point) {
        InfiniteWall wall;
        wall.setSpecies(species);
        wall.set(outward, point);
        wallHandler.copyAndAddObject(wall);
    }

    void addPeriodic(Vec3D normal, double low, double high) {
        PeriodicBoundary boundary;
        boundary.set(normal, low, high);
        boundaryHandler.copyAndAddObject(boundary);
    }

    std::map<std::string, Template> templates_;
    std::vector<Row> rows_;
    std::vector<ClumpParticle*> clumps_;
"""


def _write(simulation: Simulation) -> Mapping[str, str]:
    """Return the files."""
    bodies = simulation.bodies
    used = {int(k) for k in bodies.assembly.shape_id}
    files = {RUN: _driver(simulation), GRAINS: _grains(simulation)}
    if simulation.walls.needs_triangles:
        triangles = [wall.vertices[wall.faces].reshape(-1, 9) for wall in facets_of(simulation) if wall.name in FACETED]
        notes = [wall.note for wall in facets_of(simulation) if wall.note]
        files[WALLS] = text_of(
            [*simulation.comments(TITLE, *notes), *(row_of(row, ",") for row in np.concatenate(triangles))]
        )
    for k, template in enumerate(bodies.templates):
        if k in used:
            for table, rows in _tables(template, bodies.densities[k]).items():
                files[f"mercury_{template.name}_{table}.txt"] = text_of(row_of(row, ",") for row in rows)
    return files


def _tables(template: Template, density: float) -> dict[str, Floats]:
    """Return pebbles, mass, inertia tensor and principal directions of a template, in its principal frame."""
    centers, radii = template.spheres
    return {
        "pebbles": np.column_stack([centers @ template.principal.axes, radii]),
        "mass": np.array([[density * template.shape.volume]]),
        "toi": density * np.diag(template.principal.moments),
        "pd": np.eye(3),
    }


def _grains(simulation: Simulation) -> str:
    """Return the table of the grains."""
    bodies, grains = simulation.bodies, simulation.bodies.assembly
    axes = rotation_matrices(bodies.principal_orientation).reshape(-1, 9)
    rows = np.column_stack([grains.scale, bodies.mass, grains.position, axes, np.zeros((grains.count, 6))])
    lines = [*simulation.comments(TITLE), f"# template,{','.join(COLUMNS)}"]
    for shape, row in zip(grains.shape_id.tolist(), rows, strict=True):
        lines.append(f"{bodies.templates[shape].name},{row_of(row, ',')}")
    return text_of(lines)


def _vector(values: Iterable[float]) -> str:
    """Return a vector in C++."""
    return f"Vec3D({', '.join(repr(float(value)) for value in values)})"


def _driver(simulation: Simulation) -> str:
    """Return the driver: grains, walls, contact law, and a run until the bed rests."""
    law = simulation.law
    kind = "LinearViscoelasticSlidingFriction" if law.name == "linear" else "HertzianViscoelasticMindlin"
    lines = [
        *simulation.comments(TITLE, *HELP, mark="//"),
        INCLUDES,
        f"typedef {kind}Species SPECIES;",
        f"const unsigned STEPS_PER_OUTPUT = {simulation.steps_per_output};",
        f"const bool SETTLES = {str(bool(simulation.gravity.any())).lower()};",
        f"const double SETTLING_TIME = {SETTLING * simulation.time_unit!r};",
        f"const double REST_ENERGY = {simulation.rest_energy!r};",
        CLASS,
        *_damping(simulation),
        "",
        *_walls(simulation),
        "};",
        "",
        *_main(simulation),
    ]
    return text_of(lines)


def _damping(simulation: Simulation) -> list[str]:
    """Return the function that sets the damping for two grains of an effective mass."""
    law = simulation.law
    if law.name == "linear":
        factor = 2 * law.damping_ratio * math.sqrt(law.stiffness)
        body = [f"        species->setDissipation({factor!r} * std::sqrt(mass));"]
    else:
        # the restitution of the law of Hertz does not depend on the mass
        body = ["        (void)mass;"]
    return ["    void setDamping(double mass)", "    {", *body, "    }"]


def _walls(simulation: Simulation) -> list[str]:
    """Return the function that adds the walls."""
    walls = simulation.walls
    lines = ["    void addWalls()", "    {"]
    lines += [
        f"        addPlane({_vector(-plane.normal)}, {_vector(np.eye(3)[plane.axis] * plane.level)});"
        for plane in walls.planes
    ]
    for axis, (periodic, low, high) in enumerate(zip(walls.periodic, *walls.bounds.tolist(), strict=True)):
        if periodic:
            lines.append(f"        addPeriodic({_vector(np.eye(3)[axis])}, {low!r}, {high!r});")
    if walls.round is not None and walls.round.kind == "cylinder":
        lines += [
            "        AxisymmetricIntersectionOfWalls cylinder;",
            "        cylinder.setSpecies(species);",
            f"        cylinder.setPosition({_vector(walls.round.center)});",
            "        cylinder.setAxis(Vec3D(0.0, 0.0, 1.0));",
            f"        cylinder.addObject(Vec3D(1.0, 0.0, 0.0), {_vector([walls.round.radius, 0, 0])});",
            "        wallHandler.copyAndAddObject(cylinder);",
        ]
    if simulation.walls.needs_triangles:
        lines.append(f'        addTriangles("{WALLS}");')
    return [*lines, "    }"]


def _main(simulation: Simulation) -> list[str]:
    """Return the main function."""
    law, walls = simulation.law, simulation.walls
    reach = 2 * float(simulation.bodies.assembly.bounding_radii.max())
    room = np.where(walls.periodic, 0.0, MARGIN * simulation.diameter + reach)
    if law.name == "linear":
        numbers = {"setStiffness": law.stiffness, "setSlidingStiffness": law.shear_stiffness}
    else:
        ratio = law.poisson_ratio
        shear = law.young_modulus / (2 * (1 + ratio))
        numbers = {"setEffectiveShearModulus": shear / (2 * (2 - ratio))}
    numbers |= {"setSlidingFrictionCoefficient": law.friction, "setDensity": law.density}
    contact = [f"    species->{name}({value!r});" for name, value in numbers.items()]
    if law.name == "hertz":
        effective = law.young_modulus / (2 * (1 - law.poisson_ratio**2))
        given = f"{effective!r}, {law.restitution!r}"
        contact.append(f"    species->setEffectiveElasticModulusAndRestitutionCoefficient({given});")
    return [
        "int main(int argc, char* argv[])",
        "{",
        "    Bed bed;",
        '    bed.setName("mercury_run");',
        f"    bed.setGravity({_vector(simulation.gravity)});",
        f"    bed.setMin({_vector(walls.bounds[0] - room)});",
        f"    bed.setMax({_vector(walls.bounds[1] + room)});",
        "    SPECIES* species = bed.speciesHandler.copyAndAddObject(SPECIES());",
        *contact,
        "    bed.species = species;",
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
    rows = [line.split(",") for line in (folder / GRAINS).read_text().splitlines() if not line.startswith("#")]
    wrong = next((row for row in rows if len(row) != 1 + len(COLUMNS)), None)
    if wrong is not None:
        raise FileFormatError(f"{folder / GRAINS} has a row of {len(wrong)} columns: write the deck again")
    tables = {name: _template(folder, name) for name in sorted({row[0] for row in rows})}
    values = np.array([[float(word) for word in row[1:]] for row in rows])
    axes = values[:, 5:14].reshape(-1, 3, 3)
    inertia, centers, radii = [], [], []
    for row, value, frame in zip(rows, values, axes, strict=True):
        table = tables[row[0]]
        inertia.append(frame @ (value[0] ** 5 * table["toi"]) @ frame.T)
        centers.append(value[0] * table["pebbles"][:, :3] @ frame.T + value[2:5])
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
    name="mercury",
    title=TITLE,
    summary="tables of pebbles in the layout of MClump, table of grains, and a driver in C++ that runs until rest",
    source="MercuryDPM, Drivers/Clump and tools/MClump",
    kinds=("sphere", "clump"),
    verified="not run; driver compiled against the declarations of its headers",
    write=_write,
    read=_read,
)
