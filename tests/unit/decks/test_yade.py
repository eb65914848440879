"""YADE: files that hold the simulation, and runs of the engine with them."""

import dataclasses
import math
import re
import subprocess

import engine_cases
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.engine import engine_registry
from voxgran.decks.write import write_deck
from voxgran.shapes.spheres import Spheres

ENGINE = "yade"
INSTALL = "apt-get install yade"
HERTZ = {"law": "hertz", "young_modulus": 2e7}
#: what a run writes of all grains: mass, centroid, inertia tensor in the frame of the container, and velocities
STATES = """
with open("states.txt", "w") as file:
    for body in grains():
        state = body.state
        turn = state.ori.toRotationMatrix()
        first, second, third = state.inertia
        tensor = turn * Matrix3(first, 0, 0, 0, second, 0, 0, 0, third) * turn.transpose()
        values = [state.mass, *state.pos, *(tensor[k, m] for k in range(3) for m in range(3)), *state.vel]
        file.write(" ".join(map(repr, values)) + "\\n")
with open("members.txt", "w") as file:
    for body in O.bodies:
        if isinstance(body.shape, Sphere) and body.mask == 1:
            values = [*body.state.pos, body.shape.radius, body.state.mass]
            file.write(" ".join(map(repr, values)) + "\\n")
sys.stdout.flush()
os._exit(0)
"""


def files_of(simulation):
    return engine_registry().get(ENGINE).write(simulation)


def row_of_spheres():
    """Return a clump of three spheres on a line along x."""
    return vg.Shape.of(Spheres([[-0.4, 0, 0], [0, 0, 0], [0.4, 0, 0]], [0.3, 0.35, 0.3]), name="row")


def two(shape, reach, scales=(1.0, 1.0)):
    """Return two grains that reach so far along x, with a gap between them."""
    half = (reach * sum(scales) + 0.1) / 2
    centers = [[5 - half, 5, 5], [5 + half, 5, 5]]
    return vg.Packing.of(shape, vg.Box((10, 10, 10)), position=centers, scale=scales, unit="mm", gravity=None)


def sphere_on_the_ground():
    """Return a sphere that lies on the bottom of a long box."""
    sphere, box = vg.make_shape("sphere"), vg.Box((10, 4, 4))
    return engine_cases.falling(vg.Packing.of(sphere, box, position=[[1, 2, 0.5]], unit="mm"))


def run(folder, body=None):
    """Run the script of a folder, with other commands in place of those after its functions; return the states."""
    program = engine_cases.program(ENGINE, INSTALL)
    script = folder / "yade_run.py"
    if body is not None:
        script.write_text(script.read_text().split("\nif len(sys.argv) > 1:")[0] + "\n" + body + STATES)
    command = [program, "-n", "-x", script.name]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    if body is not None:
        return np.loadtxt(folder / "states.txt", ndmin=2)
    return None


def rock_hull():
    """Return a closed mesh of a few flat faces as a container."""
    return vg.ClosedMesh(vg.make_shape("convex_polyhedron", seed=2)).scaled(7)


PACKINGS = {
    "spheres": (engine_cases.spheres, {}),
    "mixed": (engine_cases.mixed, {}),
    "rocks": (engine_cases.rocks, {}),
    "level sets": (engine_cases.rocks, {"grains": "level_set"}),
    "no unit": (lambda: engine_cases.mixed(unit="1"), {}),
    "periodic": (lambda: engine_cases.mixed(periodic="xy"), {}),
    "cylinder": (lambda: engine_cases.mixed(container=vg.Cylinder(2.5, 7)), {}),
    "sphere": (lambda: engine_cases.mixed(container=vg.Sphere(3.5)), {}),
    "mesh": (lambda: engine_cases.mixed(container=rock_hull()), {}),
    "hopper": (lambda: engine_cases.mixed(container=vg.Hopper(3.5, 2.4, 65, bin_height=4)), {}),
}


@pytest.mark.parametrize("name", [slow(name) if name == "rocks" else name for name in PACKINGS])
def test_files_hold_the_simulation(tmp_path, name):
    make, asked = PACKINGS[name]
    deck = write_deck(make(), tmp_path, ENGINE, **asked)
    engine_cases.assert_holds(engine_registry().get(ENGINE).read(tmp_path), deck.simulation)
    for path in deck.files:
        assert path.name.startswith("yade_")
        assert path.read_text().startswith("# voxgran")


def test_the_script_is_python(tmp_path):
    for make, asked in PACKINGS.values():
        deck = write_deck(make(), tmp_path, ENGINE, overwrite=True, **asked)
        compile((deck.folder / "yade_run.py").read_text(), "yade_run.py", "exec")


def test_walls_are_those_of_the_container():
    flat = files_of(engine_cases.simulation_of(engine_cases.mixed(), ENGINE))
    planes = re.search(r"PLANES = (.*)", flat["yade_run.py"])[1]
    assert planes.count("(") == 6
    assert "yade_facets.txt" not in flat
    # infinite planes stop YADE in a periodic cell
    cell = files_of(engine_cases.simulation_of(engine_cases.mixed(periodic="xy"), ENGINE))
    assert "PLANES = []" in cell["yade_run.py"]
    edges = re.search(r"O.cell.hSize = Matrix3\((.*)\)", cell["yade_run.py"])[1].split(", ")
    assert [float(edge) for edge in edges[:8]] == pytest.approx([0.005, 0, 0, 0, 0.005, 0, 0, 0])
    assert float(edges[8]) > 4 * 0.007
    corners = np.loadtxt(cell["yade_facets.txt"].splitlines())[:, :9].reshape(-1, 3, 3)
    assert corners.shape == (2, 3, 3)
    np.testing.assert_allclose(corners[:, :, 2], [[0.0] * 3, [0.007] * 3], atol=1e-12)


def test_a_round_wall_is_triangles_outside_of_it():
    for container in (vg.Cylinder(2.5, 7), vg.Sphere(3.5)):
        simulation = engine_cases.simulation_of(engine_cases.mixed(container=container), ENGINE)
        files = files_of(simulation)
        wall = simulation.walls.round
        corners = np.loadtxt(files["yade_facets.txt"].splitlines())[:, :9].reshape(-1, 3, 3) - wall.center
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        distance = np.abs(np.einsum("ij,ij->i", normals, corners[:, 0])) / np.linalg.norm(normals, axis=1)
        assert distance.min() >= wall.radius * (1 - 1e-9)
        assert distance.max() < wall.radius * 1.01
        assert "triangles outside of the round wall" in files["yade_run.py"]


def test_a_lattice_has_the_distances_of_the_shape(tmp_path):
    deck = write_deck(engine_cases.rocks(), tmp_path, ENGINE, grains="level_set")
    for template in deck.simulation.bodies.templates:
        lines = [line for line in (tmp_path / f"yade_{template.name}.txt").read_text().splitlines() if line[0] != "#"]
        *corner, spacing = map(float, lines[0].split()[:4])
        count = [int(word) for word in lines[0].split()[4:]]
        values = np.array([line.split() for line in lines[1:]], dtype=float).reshape(count)
        at = np.argwhere(values < values.max())[::97]
        points = (np.array(corner) + spacing * at) @ template.principal.axes.T
        found = values[tuple(at.T)]
        np.testing.assert_allclose(found, template.shape.signed_distance(points), rtol=1e-8, atol=1e-15)
        assert (values[[0, -1]] > 0).all()
        assert (values[:, [0, -1]] > 0).all()
        assert (values[:, :, [0, -1]] > 0).all()
        assert f"{template.name} is a lattice of distances" in (tmp_path / "yade_run.py").read_text()


def test_what_yade_does_not_hold_is_refused(tmp_path):
    box, sphere = vg.make_shape("box", aspect=(1, 1, 1)), vg.make_shape("sphere")
    refused = {
        "periodic and grains are level sets": ([box], vg.Box((4, 4, 4), periodic="xy")),
        "is not flat and grains are level sets": ([box], vg.Cylinder(3, 6)),
        "are level sets and others": ([box, sphere], vg.Box((4, 4, 4))),
    }
    for words, (shapes, container) in refused.items():
        places = [[1.0, 1.0, 1.0], [2.0, 2.0, 2.5]][: len(shapes)]
        numbers = list(range(len(shapes)))
        packing = vg.Packing.of(shapes, container, position=places, shape_id=numbers, unit="mm")
        with pytest.raises(InputError, match=words):
            write_deck(packing, tmp_path, ENGINE, grains="level_set")
    narrow = vg.Packing.of(sphere, vg.Box((1.5, 4, 4), periodic="x"), position=[[1, 1, 1]], unit="mm")
    with pytest.raises(InputError, match=r"has a period of 0\.0015 m: YADE needs"):
        write_deck(narrow, tmp_path, ENGINE)
    assert not list(tmp_path.iterdir())


def test_an_unused_shape_does_not_count(tmp_path):
    shapes = [vg.make_shape("box", aspect=(1, 1, 1)), vg.make_shape("sphere")]
    packing = vg.Packing.of(shapes, vg.Box((4, 4, 4)), position=[[1, 1, 1]], shape_id=[0], unit="mm")
    deck = write_deck(packing, tmp_path, ENGINE, grains="level_set")
    assert "SPHERES = False" in (tmp_path / "yade_run.py").read_text()
    assert "yade_spheres.txt" not in {path.name for path in deck.files}


def test_a_damaged_table_is_refused(tmp_path):
    write_deck(engine_cases.mixed(), tmp_path, ENGINE)
    path = tmp_path / "yade_grains.txt"
    path.write_text(path.read_text().rsplit(" ", 1)[0])
    with pytest.raises(FileFormatError, match="without 14 columns"):
        engine_registry().get(ENGINE).read(tmp_path)


@pytest.mark.engine
@pytest.mark.parametrize("name", [slow("mixed"), slow("rocks"), "periodic", slow("level sets")])
def test_bodies_are_loaded_as_they_are(tmp_path, name):
    make, asked = PACKINGS[name]
    deck = write_deck(make(), tmp_path, ENGINE, **asked)
    # a step of no length, after which YADE has put the members of clumps in their places itself
    states = run(tmp_path, "load()\noutput()\nO.dt = 1e-30\nO.step()\n")
    bodies, size = deck.simulation.bodies, deck.simulation.diameter
    assert len(states) == bodies.count
    np.testing.assert_allclose(states[:, 0], bodies.mass, rtol=1e-9)
    np.testing.assert_allclose(states[:, 1:4], bodies.assembly.position, atol=1e-9 * size)
    scale = np.abs(bodies.inertia).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(states[:, 4:13].reshape(-1, 3, 3) / scale, bodies.inertia / scale, atol=1e-9)
    poses = np.loadtxt(tmp_path / "yade_poses.txt", ndmin=2)
    np.testing.assert_allclose(poses[:, 3:7], bodies.principal_orientation, atol=1e-9)
    centers, radii, grain = bodies.spheres
    if len(radii):
        members = np.loadtxt(tmp_path / "members.txt", ndmin=2)
        np.testing.assert_allclose(members[:, :3], centers, atol=1e-9 * size)
        np.testing.assert_allclose(members[:, 3], radii, rtol=1e-12)
        # the damping of a contact follows from these
        np.testing.assert_allclose(members[:, 4], bodies.mass[grain], rtol=1e-9)


@pytest.mark.engine
@pytest.mark.parametrize("asked", [{}, slow({"grains": "level_set"})], ids=["clumps", "level sets"])
def test_grains_fall_freely(tmp_path, asked):
    packing = engine_cases.rocks() if asked else engine_cases.mixed(container=vg.Box((5, 5, 500)))
    deck = write_deck(packing, tmp_path, ENGINE, **asked)
    steps = deck.simulation.steps_per_output // 5 if asked else deck.simulation.steps_per_output
    states = run(tmp_path, f"load()\nO.run({steps}, True)\n")
    fallen = 9.81 * steps * deck.simulation.time_step
    np.testing.assert_allclose(states[:, 13:16], [[0, 0, -fallen]] * len(states), rtol=1e-3, atol=1e-9)


MATERIALS = {
    "linear": {"stiffness": 500.0, "restitution": 0.4},
    "elastic": {"stiffness": 500.0, "restitution": 1.0},
    "hertz": {**HERTZ, "restitution": 0.4},
}
CASES = {
    "spheres": (lambda: engine_cases.two_spheres(), {}),
    "sizes": (lambda: engine_cases.two_spheres(radii=(0.9, 0.15)), {}),
    "clumps": (lambda: two(row_of_spheres(), 0.7), {}),
    "clumps of sizes": (lambda: two(row_of_spheres(), 0.7, (1.0, 0.4)), {}),
}


@pytest.mark.engine
@pytest.mark.parametrize(
    ("name", "material"),
    [("spheres", "hertz"), slow("clumps of sizes", "linear")]
    + [slow(name, "elastic") for name in CASES]
    + [slow(name, "linear") for name in ("spheres", "sizes", "clumps")]
    + [slow(name, "hertz") for name in ("sizes", "clumps", "clumps of sizes")],
)
def test_two_grains_rebound_as_asked(tmp_path, material, name):
    make, asked = CASES[name]
    deck = write_deck(make(), tmp_path, ENGINE, material=MATERIALS[material], **asked)
    steps = round(4e-3 / deck.simulation.time_step)
    start = "load()\none, other = grains()\none.state.vel, other.state.vel = (0.05, 0, 0), (-0.05, 0, 0)\n"
    states = run(tmp_path, f"{start}O.run({steps}, True)\n")
    velocity = states[1, 13] - states[0, 13]
    assert velocity == pytest.approx(0.1 * MATERIALS[material]["restitution"], rel=0.02)
    assert states[:, 0] @ states[:, 13] == pytest.approx(
        0.05 * (states[0, 0] - states[1, 0]), abs=1e-9 * states[:, 0].sum()
    )


@pytest.mark.engine
@pytest.mark.parametrize("material", ["linear", slow("elastic"), slow("hertz")])
def test_a_level_set_rebounds_from_the_ground_as_asked(tmp_path, material):
    egg = vg.make_shape("ellipsoid")
    packing = vg.Packing.of(egg, vg.Box((4, 4, 4)), position=[[2, 2, 0.8]], unit="mm", gravity=None)
    deck = write_deck(packing, tmp_path, ENGINE, grains="level_set", material=MATERIALS[material])
    steps = round(16e-3 / deck.simulation.time_step)
    states = run(tmp_path, f"load()\ngrains()[0].state.vel = (0, 0, -0.05)\nO.run({steps}, True)\n")
    # the deepest node does not lie exactly below the centroid, so that the body turns a little
    assert states[0, 15] == pytest.approx(0.05 * MATERIALS[material]["restitution"], rel=0.03)


@pytest.mark.engine
@pytest.mark.parametrize("law", ["linear", slow("hertz")])
# thousands of triangles take their time
@pytest.mark.parametrize(
    "name", ["cylinder", *map(slow, ("periodic", "mixed", "mesh", "level sets", "sphere", "hopper"))]
)
def test_walls_hold_the_grains(tmp_path, name, law):
    make, asked = PACKINGS[name]
    material = {} if law == "linear" else {**HERTZ, "young_modulus": 5e6}
    deck = write_deck(make(), tmp_path, ENGINE, material=material, **asked)
    steps = round((5 if name in ("sphere", "hopper") else 12) * deck.simulation.time_unit / deck.simulation.time_step)
    states = run(tmp_path, f"load()\nO.run({steps}, True)\n")
    assert np.isfinite(states).all()
    bodies, walls = deck.simulation.bodies, deck.simulation.walls
    lowest = states[:, 3].min() - walls.bounds[0, 2]
    assert 0 < lowest < 1.0 * deck.simulation.diameter
    container = deck.packing.to_unit("m").container
    if len(bodies.spheres[1]):
        rows = np.loadtxt(tmp_path / "members.txt")
        depth = container.signed_distance(rows[:, :3]) + rows[:, 3]
        assert depth.max() < 0.02 * deck.simulation.diameter
    assert container.signed_distance(states[:, 1:4]).max() < 0


@pytest.mark.engine
@pytest.mark.slow
@pytest.mark.parametrize("material", ["linear", "hertz"])
def test_a_sphere_slides_and_then_rolls(tmp_path, material):
    deck = write_deck(sphere_on_the_ground(), tmp_path, ENGINE, material={**MATERIALS[material], "friction": 0.3})
    sliding, rolling = (round(time / deck.simulation.time_step) for time in (4e-3, 20e-3))
    start = "load()\ngrains()[0].state.vel = (0.1, 0, 0)\n"
    slid = run(tmp_path, f"{start}O.run({sliding}, True)\n")
    assert slid[0, 13] == pytest.approx(0.1 - 0.3 * 9.81 * 4e-3, rel=0.01)
    write_deck(deck.packing, tmp_path, ENGINE, material={**MATERIALS[material], "friction": 0.3}, overwrite=True)
    rolled = run(tmp_path, f"{start}O.run({rolling}, True)\n")
    assert rolled[0, 13] == pytest.approx(5 / 7 * 0.1, rel=0.01)


@pytest.mark.engine
def test_a_bed_comes_to_rest_and_goes_on_from_a_checkpoint(tmp_path):
    packing = engine_cases.mixed(count=4)
    packing = dataclasses.replace(packing, shape_id=np.ones(4, dtype=np.int64))
    deck = write_deck(packing, tmp_path, ENGINE, material={"stiffness": 100.0})
    run(tmp_path)
    rows = np.loadtxt(tmp_path / "yade_energy.txt")
    assert rows[-1, 0] < 0.9 * deck.simulation.steps
    assert rows[-1, 2] < deck.simulation.rest_energy
    poses = (tmp_path / "yade_poses.txt").read_text().split("# step ")[1:]
    assert len(poses) == len(rows)
    assert len(poses[-1].splitlines()) == 5
    assert list(tmp_path.glob("yade_end_spheres.*.vtu"))
    program = engine_cases.program(ENGINE, INSTALL)
    again = [program, "-n", "-x", "yade_run.py", "yade_checkpoint.yade.gz"]
    assert subprocess.run(again, cwd=tmp_path, capture_output=True, timeout=100).returncode == 0
    assert np.loadtxt(tmp_path / "yade_energy.txt")[-1, 0] > rows[-1, 0]


@pytest.mark.engine
def test_adhesion_pulls_as_the_surface_energy_says(tmp_path):
    deck = write_deck(
        engine_cases.two_spheres(gap=1e-9), tmp_path, ENGINE, material={**HERTZ, "cohesion": 0.5, "restitution": 1.0}
    )
    body = "load()\nO.dt = 1e-30\none, other = grains()\none.state.pos += Vector3(2e-12, 0, 0)\nO.step()\nO.step()\n"
    body += "(contact,) = [one for one in O.interactions if one.isReal]\n"
    states = run(tmp_path, body + "grains()[0].state.vel = contact.phys.normalForce\n")
    radius = 0.5e-3 / 2
    assert abs(states[0, 13]) == pytest.approx(4 * math.pi * 0.5 * radius, rel=1e-3)
    assert deck.simulation.law.cohesion == 0.5
