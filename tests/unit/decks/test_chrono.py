"""Input for Chrono DEM-Engine: tables, force model and driver."""

import ast
import math
import shutil
import subprocess

import numpy as np
import pytest
from engine_cases import assert_holds, dumbbell, falling, mixed, rocks, simulation_of, spheres

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.engines import chrono

HERTZ = {"law": "hertz", "young_modulus": 1e8, "restitution": 0.6}

#: a head-on collision under a force model, with the names that DEM-Engine gives it
COLLISION = """
#include <cmath>
#include <cstdio>
#include <cstdlib>
struct float3 { float x, y, z; };
struct float4 { float x, y, z, w; };
float3 make_float3(float x, float y, float z) { return {x, y, z}; }
float dot(float3 a, float3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
float length(float3 a) { return sqrtf(dot(a, a)); }
float3 cross(float3 a, float3 b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
float3 operator+(float3 a, float3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
float3 operator-(float3 a, float3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
float3 operator*(float s, float3 a) { return {s * a.x, s * a.y, s * a.z}; }
void operator+=(float3& a, float3 b) { a = a + b; }
void operator-=(float3& a, float3 b) { a = a - b; }
void applyOriQToVector3(float3&, const float4&) {}
int main(int argc, char** argv) {
    const double massA = atof(argv[1]), massB = atof(argv[2]), dt = atof(argv[5]);
    const float ARadius = atof(argv[3]), BRadius = atof(argv[4]), AOwnerMass = massA, BOwnerMass = massB, ts = dt;
    const float3 ARotVel{}, BRotVel{}, locCPA{}, locCPB{}, B2A{-1, 0, 0};
    const float4 AOriQ{0, 0, 0, 1}, BOriQ{0, 0, 0, 1};
    double xA = 0, xB = double(ARadius) + BRadius, vA = 0.1, vB = 0, sideA = atof(argv[6]), largest = 0;
    float slid_x = 0, slid_y = 0, slid_z = 0;
    for (int n = 0; n < 10000000; ++n) {
        const double overlapDepth = double(ARadius) + BRadius - (xB - xA);
        if (overlapDepth < 0) break;
        float3 force{};
        const float3 ALinVel{float(vA), float(sideA), 0}, BLinVel{float(vB), 0, 0};
        {
            MODEL
        }
        largest = fmax(largest, fabs(force.y / force.x));
        vA += force.x / massA * dt; vB -= force.x / massB * dt; sideA += force.y / massA * dt;
        xA += vA * dt; xB += vB * dt;
    }
    printf("%.9g %.9g\\n", (vB - vA) / 0.1, largest);
}
"""


def deck(folder, packing, **asked):
    """Write a deck and return it with what its files hold."""
    made = vg.write_deck(packing, folder, "chrono", **asked)
    return made, chrono.registration.read(folder)


@pytest.mark.parametrize(
    "packing",
    [spheres(), mixed(), mixed(unit=None), mixed(container=vg.Cylinder(3, 7)), mixed(container=vg.Sphere(3.5))],
    ids=["spheres", "clumps", "no unit", "cylinder", "sphere"],
)
def test_files_hold_the_simulation(tmp_path, packing):
    made, held = deck(tmp_path, packing)
    assert_holds(held, made.simulation)


def test_rocks_become_clumps_with_their_true_mass_and_inertia(tmp_path):
    made, held = deck(tmp_path, rocks(), clump=5)
    assert_holds(held, made.simulation)
    assert "intersection over union" in (tmp_path / chrono.RUN).read_text()


def test_tables_are_in_the_principal_frame_as_the_engine_has_them(tmp_path):
    made, _ = deck(tmp_path, mixed())
    (name,) = (one.name for one in made.simulation.bodies.templates if one.kind == "clump")
    header, *rows = (tmp_path / f"chrono_{name}.csv").read_text().splitlines()
    assert header == "x,y,z,r"
    table = np.array([row.split(",") for row in rows], dtype=float)
    np.testing.assert_allclose(sorted(table[:, 3]), np.array([0.25, 0.3, 0.4]) * 1e-3, rtol=1e-12)
    axes = np.linalg.eigh(dumbbell().inertia).eigenvectors
    shape = dumbbell().geometry
    np.testing.assert_allclose(
        np.linalg.norm(table[:, :3], axis=1), 1e-3 * np.linalg.norm(shape.centers, axis=1), rtol=1e-9
    )
    own = 1e-3 * shape.centers @ axes
    np.testing.assert_allclose(np.abs(table[:, :3]), np.abs(own), atol=1e-12)
    grain = (tmp_path / chrono.GRAINS).read_text().splitlines()[-1].split(",")
    assert float(grain[3]) <= float(grain[4]) <= float(grain[5])


def test_every_file_that_permits_comments_begins_with_the_header(tmp_path):
    made, _ = deck(tmp_path, mixed(container=vg.Sphere(3.5)))
    first = made.simulation.header("Chrono DEM-Engine")[0]
    marks = {chrono.RUN: "#", chrono.GRAINS: "#", chrono.WALLS: "#", chrono.LAW: "//"}
    for name, mark in marks.items():
        assert (tmp_path / name).read_text().startswith(f"{mark} {first}\n")
    assert all(path.name.startswith("chrono_") for path in made.files)


def calls(folder):
    """Return the arguments of all calls of the driver, by the name of the method."""
    found = {}
    for node in ast.walk(ast.parse((folder / chrono.RUN).read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            found.setdefault(node.func.attr, []).append(node.args)
    return found


def test_planes_point_to_the_grains_and_the_lid_is_one_of_them(tmp_path):
    packing = mixed()
    made, _ = deck(tmp_path, packing)
    planes = calls(tmp_path)["AddBCPlane"]
    assert len(planes) == len(made.simulation.walls.planes) == 6
    middle = made.simulation.walls.bounds.mean(axis=0)
    for arguments in planes:
        point, normal = (np.array(ast.literal_eval(one)) for one in arguments[:2])
        assert np.dot(middle - point, normal) > 0
        assert np.linalg.norm(normal) == 1


def test_round_walls(tmp_path):
    deck(tmp_path / "cylinder", mixed(container=vg.Cylinder(3, 7)))
    (cylinder,) = calls(tmp_path / "cylinder")["AddCylinder"]
    assert ast.literal_eval(cylinder[2]) == pytest.approx(3e-3)
    assert len(calls(tmp_path / "cylinder")["AddBCPlane"]) == 2
    made, _ = deck(tmp_path / "sphere", mixed(container=vg.Sphere(3.5)))
    lines = (tmp_path / "sphere" / chrono.WALLS).read_text().splitlines()
    points = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=float)
    faces = np.array([line.split()[1:] for line in lines if line.startswith("f ")], dtype=int) - 1
    a, b, c = np.moveaxis(points[faces], 1, 0)
    normal = np.cross(b - a, c - a)
    center = made.simulation.walls.round.center
    assert (np.einsum("fi,fi->f", normal, center - a) > 0).all()
    assert np.linalg.norm(points - center, axis=1).min() >= 3.5e-3


def test_gravity_time_and_rest(tmp_path):
    made, _ = deck(tmp_path, mixed())
    simulation = made.simulation
    text = (tmp_path / chrono.RUN).read_text()
    assert "GRAVITY = [0.0, 0.0, -9.81]" in text
    assert f"TIME_STEP = {simulation.time_step!r}" in text
    assert f"SETTLES, REST_ENERGY = True, {simulation.rest_energy!r}" in text
    frames = math.ceil(simulation.steps / simulation.steps_per_output)
    settling = math.ceil(5 * simulation.time_unit / (simulation.steps_per_output * simulation.time_step))
    assert settling in (5, 6)
    assert f"STEPS_PER_OUTPUT, FRAMES, SETTLING_FRAMES = {simulation.steps_per_output}, {frames}, {settling}" in text
    compile(text, chrono.RUN, "exec")


@pytest.mark.parametrize("material", [{"restitution": 0.6}, HERTZ], ids=["linear", "hertz"])
@pytest.mark.parametrize("radii", [(0.5e-3, 0.5e-3), (0.5e-3, 0.2e-3)])
def test_force_model_gives_back_the_restitution(tmp_path, material, radii):
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("g++ is not installed: the force model of the engine is tried by it")
    simulation = deck(tmp_path, falling(spheres()), material=material)[0].simulation
    source = tmp_path / "collision.cpp"
    model = "\n".join(line for line in (tmp_path / chrono.LAW).read_text().splitlines() if not line.startswith("// "))
    source.write_text(COLLISION.replace("MODEL", model))
    subprocess.run([compiler, "-O1", "-w", "-o", str(tmp_path / "collision"), str(source)], check=True)
    masses = [2650 * 4 / 3 * math.pi * radius**3 for radius in radii]
    numbers = [*masses, *radii, simulation.time_step / 20, 0.02]
    done = subprocess.run([str(tmp_path / "collision"), *map(str, numbers)], check=True, capture_output=True, text=True)
    restitution, slope = map(float, done.stdout.split())
    assert restitution == pytest.approx(0.6, rel=0.01)
    assert slope == pytest.approx(simulation.law.friction, rel=1e-3) or slope < simulation.law.friction


def test_refusals(tmp_path):
    with pytest.raises(InputError, match="container is periodic"):
        vg.write_deck(mixed(periodic=True), tmp_path, "chrono")
    with pytest.raises(InputError, match="cohesion"):
        vg.write_deck(mixed(), tmp_path, "chrono", material=HERTZ | {"cohesion": 0.1})
    with pytest.raises(InputError, match="has 'clump'"):
        vg.write_deck(rocks(), tmp_path, "chrono", grains="polyhedron")


def test_the_reader_refuses_what_the_engine_does_not_take(tmp_path):
    deck(tmp_path, mixed())
    path = next(tmp_path.glob("chrono_three*.csv"))
    text = path.read_text()
    path.write_text(f"# {text}")
    with pytest.raises(FileFormatError, match="no table of spheres"):
        chrono.registration.read(tmp_path)
    path.write_text(text)
    grains = tmp_path / chrono.GRAINS
    grains.write_text(grains.read_text() + "three_spheres_1,1.0\n")
    with pytest.raises(FileFormatError, match="2 columns"):
        chrono.registration.read(tmp_path)


def test_the_law_of_hertz_has_the_constants_of_two_equal_materials():
    simulation = simulation_of(spheres(), "chrono", material=HERTZ)
    text = chrono.registration.write(simulation)[chrono.LAW]
    young = 1e8 / (2 * (1 - 0.25**2))
    shear = 1e8 / 2.5 / (2 * 1.75)
    numbers = {
        line.split()[2]: float(line.split()[4].rstrip("f;")) for line in text.splitlines() if "const float" in line[:11]
    }
    assert numbers["young_modulus"] == pytest.approx(young, rel=1e-6)
    assert numbers["shear_modulus"] == pytest.approx(shear, rel=1e-6)
