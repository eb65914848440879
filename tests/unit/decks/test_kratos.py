"""Input of Kratos: its files read back, and grains that move in it."""

import json
import math
import os
import subprocess

import engine_cases as cases
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks import facets as triangles
from voxgran.decks import kratos_model
from voxgran.decks.engine import engine_registry
from voxgran.decks.engines import kratos
from voxgran.decks.walls import Walls
from voxgran.geometry.rotation import rotation_matrices
from voxgran.geometry.walls import Plane
from voxgran.shapes.spheres import Spheres

LINEAR = {"law": "linear", "stiffness": 1e4, "shear_stiffness": 3e3, "density": 2650}
HERTZ = {"law": "hertz", "young_modulus": 1e7, "density": 2650}
#: runs the script for some steps, from the state in the file if there is one, and tells what Kratos has loaded
DRIVER = """
import json, os, sys
import kratos_run
import KratosMultiphysics as Kratos
import KratosMultiphysics.DEMApplication as Dem

kratos_run.STEPS = int(sys.argv[1])
bed = kratos_run.bed(*sys.argv[2:])
bed.Initialize()
loaded = {"grains": [], "spheres": []}
for number, node in bed.grains:
    value = node.GetSolutionStepValue
    if number in bed.clusters:
        found = value(Kratos.ORIENTATION)
        turn, moments = [found.W, found.X, found.Y, found.Z], list(value(Dem.PRINCIPAL_MOMENTS_OF_INERTIA))
    else:
        turn, moments = [1, 0, 0, 0], 3 * [value(Dem.PARTICLE_MOMENT_OF_INERTIA)]
    loaded["grains"].append([number, value(Kratos.NODAL_MASS), node.X, node.Y, node.Z, *turn, *moments])
for node in bed.spheres_model_part.Nodes:
    loaded["spheres"].append([node.X, node.Y, node.Z, node.GetSolutionStepValue(Kratos.RADIUS)])
with open("loaded.json", "w") as file:
    json.dump(loaded, file)
bed.RunSolutionLoop()
bed.write_state()
bed.Finalize()
"""


def written(simulation, folder):
    """Write the files into a folder."""
    folder.mkdir(exist_ok=True)
    for name, text in engine_registry().get("kratos").write(simulation).items():
        (folder / name).write_text(text)
    return folder


def state_of(path):
    """Return step, time and kinetic energy of a state, and its rows."""
    step, time, energy = path.read_text().splitlines()[1].split()[1:]
    return int(step), float(time), float(energy), np.loadtxt(path, ndmin=2)


def started(simulation, folder, velocity, spin=None):
    """Write a state with velocities to start from."""
    bodies = simulation.bodies
    spin = np.zeros((bodies.count, 3)) if spin is None else spin
    rows = np.column_stack([bodies.assembly.position, bodies.principal_orientation, velocity, spin]).tolist()
    lines = ["#", "# 0 0.0 0.0", "#"]
    lines += [" ".join([str(grain), *map(repr, row)]) for grain, row in enumerate(rows, 1)]
    (folder / "start.txt").write_text("\n".join(lines) + "\n")
    return "start.txt"


def run(folder, steps, *state):
    """Run Kratos for some steps; return what it has loaded and the last state."""
    (folder / "driver.py").write_text(DRIVER)
    command = [cases.python_of_kratos(), "driver.py", str(steps), *state]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False, timeout=240
    )
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-3000:]
    return json.loads((folder / "loaded.json").read_text()), state_of(max(folder.glob("kratos_state_*.txt")))


def flying(shapes, position, scale=None, shape_id=None):
    """Return grains at given places, without gravity."""
    box = vg.Box((10, 10, 10))
    return vg.Packing.of(shapes, box, position=position, scale=scale, shape_id=shape_id, unit="mm", gravity=None)


def peanut():
    """Return a clump of two equal spheres along x."""
    return vg.Shape.of(Spheres([[-0.3, 0, 0], [0.3, 0, 0]], [0.35, 0.35]), name="peanut")


# files


@pytest.mark.parametrize("packing", [cases.spheres, cases.mixed], ids=["spheres", "mixed"])
def test_files_hold_the_grains(packing, tmp_path):
    """Masses, centroids, inertia and spheres are read back."""
    simulation = cases.simulation_of(packing(), "kratos")
    cases.assert_holds(engine_registry().get("kratos").read(written(simulation, tmp_path)), simulation, 1e-12)


def test_rocks_become_clumps_with_their_true_mass(tmp_path):
    """Fitted clumps keep mass, centroid and inertia of the rocks."""
    packing = cases.rocks()
    simulation = cases.simulation_of(packing, "kratos", clump=5)
    held = engine_registry().get("kratos").read(written(simulation, tmp_path))
    cases.assert_holds(held, simulation, 1e-12)
    np.testing.assert_allclose(held.mass, 2650 * packing.to_unit("m").volumes, rtol=1e-9)
    assert all(f"kratos_{template.name}.clu" in os.listdir(tmp_path) for template in simulation.bodies.templates)
    assert "approximated" in (tmp_path / kratos.CLUMPS).read_text()


def test_every_file_that_permits_comments_begins_with_the_header():
    """Units and contact law are told; names begin with that of the engine."""
    simulation = cases.simulation_of(cases.mixed(), "kratos")
    files = engine_registry().get("kratos").write(simulation)
    for name, text in files.items():
        assert name.startswith("kratos")
        if name.endswith(".json"):
            json.loads(text)
        else:
            assert all(line in text for line in simulation.header("Kratos"))
            assert text.startswith(("# ", "// "))
    compile(files[kratos.SCRIPT], kratos.SCRIPT, "exec")


def test_each_pair_of_materials_has_the_contact_law():
    """Clusters of each template are a material, and all contacts have the same parameters."""
    simulation = cases.simulation_of(cases.rocks(), "kratos", clump=4, material={**LINEAR, "friction": 0.4})
    materials = json.loads(engine_registry().get("kratos").write(simulation)[kratos.MATERIALS])
    numbers = [one["material_id"] for one in materials["materials"]]
    pairs = {tuple(sorted(one["material_ids_list"])) for one in materials["material_relations"]}
    walls = kratos_model.WALLS
    assert pairs == {(a, b) for a in numbers for b in numbers if a <= b} - {(walls, walls)}
    for one in materials["material_relations"]:
        contact = one["Variables"]
        assert contact["K_NORMAL"] == 1e4
        assert contact["K_TANGENTIAL"] == 3e3
        assert contact["DYNAMIC_FRICTION"] == contact["STATIC_FRICTION"] == 0.4


def test_only_shapes_of_grains_are_materials():
    """A shape without grains is no cluster."""
    simulation = cases.simulation_of(flying([peanut(), cases.dumbbell()], [[5, 5, 5]], shape_id=[1]), "kratos")
    names = engine_registry().get("kratos").write(simulation)
    assert [name for name in names if name.endswith(".clu")] == ["kratos_three_spheres_1.clu"]


def test_time_and_gravity():
    """Step, duration and gravity are those of the simulation; without gravity neighbours are sought at each step."""
    simulation = cases.simulation_of(cases.spheres(), "kratos")
    files = engine_registry().get("kratos").write(simulation)
    parameters = json.loads(files[kratos.PARAMETERS])
    assert parameters["MaxTimeStep"] == simulation.time_step
    assert parameters["FinalTime"] == simulation.duration
    assert [parameters[f"Gravity{axis}"] for axis in "XYZ"] == simulation.gravity.tolist()
    fastest = math.sqrt(2 * 9.81 * 6e-3)
    steps = parameters["NeighbourSearchFrequency"]
    assert steps > 1
    assert 2 * fastest * steps * simulation.time_step <= parameters["SearchTolerance"]
    assert f"REST_ENERGY = {simulation.rest_energy!r}\n" in files[kratos.SCRIPT]
    still = cases.simulation_of(cases.two_spheres(), "kratos")
    files = engine_registry().get("kratos").write(still)
    assert json.loads(files[kratos.PARAMETERS])["NeighbourSearchFrequency"] == 1
    assert "REST_ENERGY = 0.0\n" in files[kratos.SCRIPT]


def faces_of(simulation):
    """Return the corners (f, 3, 3) of the triangles of walls, and the names of walls, as the file has them."""
    text = kratos_model.wall_text(simulation, [])
    blocks, names = {}, []
    for block in text.split("\nBegin ")[1:]:
        head, *lines = block.splitlines()
        blocks[head] = [line.split() for line in lines if line.startswith("  ") and line.split()[0].isdigit()]
        if head.startswith("SubModelPart "):
            names.append(head.split()[1])
    points = {words[0]: np.array(words[1:], dtype=float) for words in blocks["Nodes"]}
    corners = [[points[k] for k in words[2:]] for words in blocks["Conditions RigidFace3D3N"]]
    return np.array(corners), names


def area(corners):
    """Return the area of triangles."""
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2


def test_walls_of_a_box_with_a_lid():
    """Each plane is a rectangle; the lid is one more."""
    packing = cases.spheres()
    simulation = cases.simulation_of(packing, "kratos")
    corners, names = faces_of(simulation)
    assert names == ["x_low", "x_high", "y_low", "y_high", "z_low", "z_high"]
    assert area(corners) == pytest.approx(128e-6)
    lid = Plane("lid", 2, 4e-3, -1)
    facets = triangles._rectangle(lid, simulation.walls.bounds)
    assert np.all(facets.vertices[:, 2] == 4e-3)
    assert area(facets.vertices[facets.faces]) == pytest.approx(16e-6)


@pytest.mark.parametrize("container", [vg.Cylinder(2.5, 6), vg.Sphere(3.0)], ids=["cylinder", "sphere"])
def test_round_walls_are_touched_from_outside(container):
    """No triangle is within the round wall, and none is farther out than the file says."""
    packing = cases.mixed(container=container)
    simulation = cases.simulation_of(packing, "kratos")
    facets = next(one for one in triangles.facets_of(simulation) if one.name == "round")
    wall = simulation.walls.round
    axes = 2 if wall.kind == "cylinder" else 3
    corners = (facets.vertices[facets.faces] - wall.center)[:, :, :axes]
    weights = np.random.default_rng(1).dirichlet(np.ones(3), size=50)
    distance = np.linalg.norm(np.einsum("wc,fca->fwa", weights, corners), axis=2)
    assert distance.min() >= wall.radius * (1 - 1e-12)
    told = float(facets.note.split("at most ")[1].split()[0])
    farthest = np.linalg.norm(corners, axis=2).max() - wall.radius
    assert farthest <= told * 1.01
    assert told <= triangles.SPHERE_ERROR * simulation.diameter
    assert facets.note in engine_registry().get("kratos").write(simulation)[kratos.FACES]


def test_a_mesh_is_written_as_it_is():
    """Triangles of a closed mesh are the wall."""
    solid = vg.make_shape("convex_polyhedron", seed=1).scaled(5)
    simulation = cases.simulation_of(cases.mixed(container=vg.ClosedMesh(solid)), "kratos")
    corners, names = faces_of(simulation)
    assert names == ["mesh"]
    vertices, faces = Walls.of(simulation.bodies.assembly).mesh
    np.testing.assert_array_equal(corners, vertices[faces])


def test_refuses_what_it_cannot_hold(monkeypatch):
    """Periodic containers, bonds, and more shapes than it has materials for."""
    with pytest.raises(InputError, match="container is periodic"):
        cases.simulation_of(cases.spheres(periodic=True), "kratos")
    with pytest.raises(InputError, match="no bonds"):
        cases.simulation_of(cases.mixed(), "kratos", material={"bond_strength": 1e6})
    monkeypatch.setattr(kratos_model, "MOST_CLUMPS", 1)
    simulation = cases.simulation_of(cases.rocks(), "kratos", clump=3)
    with pytest.raises(InputError, match=r"clumps of 2 shapes.*at most 1; use fewer shapes"):
        engine_registry().get("kratos").write(simulation)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        (kratos.GRAINS, "NodalData RADIUS", "NodalData DENSITY"),
        (kratos.CLUMPS, "End Nodes", ""),
        ("kratos_three_spheres_1.clu", "Volume", "Volumen"),
        ("kratos_three_spheres_1.clu", "Size", "Size\nten"),
    ],
)
def test_damaged_files_are_told(tmp_path, name, old, new):
    """The file is named, and what is wrong."""
    written(cases.simulation_of(cases.mixed(), "kratos"), tmp_path)
    text = (tmp_path / name).read_text()
    assert old in text
    (tmp_path / name).write_text(text.replace(old, new))
    with pytest.raises(FileFormatError, match=f"{name}.*write the deck again"):
        engine_registry().get("kratos").read(tmp_path)


# the engine itself


@pytest.mark.engine
def test_kratos_loads_the_grains_and_they_fall(tmp_path):
    """Mass, centroid, inertia and spheres of each body are true; v = g t; spheres of a clump do not interact."""
    simulation = cases.simulation_of(cases.mixed(), "kratos", material={"density": 2650, "stiffness": 60.0})
    steps = 2000
    loaded, (step, time, energy, rows) = run(written(simulation, tmp_path), steps)
    bodies = simulation.bodies
    grains = np.array(loaded["grains"])
    assert grains[:, 0].tolist() == list(range(1, bodies.count + 1))
    np.testing.assert_allclose(grains[:, 1], bodies.mass, rtol=1e-12)
    np.testing.assert_allclose(grains[:, 2:5], bodies.assembly.position, rtol=0, atol=1e-12 * simulation.diameter)
    turns = rotation_matrices(grains[:, 5:9])
    inertia = np.einsum("gij,gj,gkj->gik", turns, grains[:, 9:12], turns)
    scale = np.abs(bodies.inertia).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(inertia / scale, bodies.inertia / scale, rtol=0, atol=1e-12)
    centers, radii, _ = bodies.spheres
    spheres = np.array(loaded["spheres"])
    assert len(spheres) == len(radii)
    for center, radius in zip(centers, radii, strict=True):
        apart = np.abs(spheres - [*center, radius]).max(axis=1).min()
        assert apart < 1e-12 * simulation.diameter
    assert step == steps
    assert time == pytest.approx(steps * simulation.time_step)
    np.testing.assert_allclose(rows[:, 8:11], np.tile([0, 0, -9.81 * time], (bodies.count, 1)), rtol=1e-3, atol=1e-12)
    assert not rows[:, 11:14].any()
    assert energy == pytest.approx(0.5 * bodies.mass.sum() * (9.81 * time) ** 2, rel=1e-6)


@pytest.mark.engine
@pytest.mark.parametrize("law", [LINEAR, HERTZ, {**HERTZ, "cohesion": 0.05}], ids=["linear", "hertz", "dmt"])
def test_forces_of_kratos_are_those_of_the_law(law, tmp_path):
    """Equal and unequal spheres that overlap, and a sphere at a wall, are pushed by the force of the contact law."""
    deep = 0.002
    position = [[5, 5, 2], [6 - deep, 5, 2], [5, 5, 5], [5.7 - deep, 5, 5], [0.5 - deep, 5, 8]]
    packing = flying(vg.make_shape("sphere"), position, [1, 1, 1, 0.4, 1])
    simulation = cases.simulation_of(packing, "kratos", material=law)
    _, (_, _, _, rows) = run(written(simulation, tmp_path), 1)
    force = rows[:, 8] * simulation.bodies.mass / simulation.time_step
    depth, radius = deep * 1e-3, np.array([0.25, 1 / 7, 0.5]) * 1e-3
    numbers = simulation.law
    if numbers.name == "linear":
        expected = np.full(3, 1e4 * depth)
    else:
        young = 1e7 / (2 * (1 - numbers.poisson_ratio**2))
        expected = 4 / 3 * young * np.sqrt(radius) * depth**1.5 - 4 * math.pi * numbers.cohesion * radius
    np.testing.assert_allclose(force[[1, 3, 4]], expected, rtol=1e-9)
    np.testing.assert_allclose(force[[0, 2]], -expected[:2], rtol=1e-9)


@pytest.mark.engine
@pytest.mark.parametrize(
    ("law", "grains"),
    [(LINEAR, "clumps"), (HERTZ, "wall")]
    + [slow(LINEAR, grains) for grains in ("equal", "unequal", "wall")]
    + [slow(HERTZ, grains) for grains in ("equal", "unequal", "clumps")],
)
def test_restitution(law, grains, tmp_path):
    """Grains rebound from each other, and from a wall, with the restitution asked for."""
    speed, gap = 0.1, 0.01
    packings = {
        "equal": lambda: cases.two_spheres(gap=gap),
        "unequal": lambda: cases.two_spheres(radii=(0.5, 0.2), gap=gap),
        "clumps": lambda: flying(peanut(), [[5 - 0.655, 5, 5], [5 + 0.655, 5, 5]]),
        "wall": lambda: flying(vg.make_shape("sphere"), [[0.5 + gap, 5, 5]]),
    }
    simulation = cases.simulation_of(packings[grains](), "kratos", material={**law, "restitution": 0.7})
    velocity = np.array([[-speed, 0, 0]] if grains == "wall" else [[speed, 0, 0], [-speed, 0, 0]])
    folder = written(simulation, tmp_path)
    steps = math.ceil(gap * 1e-3 / speed / simulation.time_step) + 3000
    _, (_, _, _, rows) = run(folder, steps, started(simulation, folder, velocity))
    after = rows[:, 8]
    rebound = after[0] / speed if grains == "wall" else (after[1] - after[0]) / (2 * speed)
    assert rebound == pytest.approx(0.7, abs=0.007)
    np.testing.assert_allclose(rows[:, 11:14], 0.0, rtol=0, atol=1e-9)
    if grains != "wall":
        assert simulation.bodies.mass @ after == pytest.approx(simulation.bodies.mass @ velocity[:, 0], abs=1e-15)


@pytest.mark.engine
def test_a_free_clump_keeps_its_angular_momentum_and_a_state_goes_on(tmp_path):
    """Without torque angular momentum and energy stay, also where the run is continued from a state."""
    packing = flying([vg.make_shape("sphere"), cases.dumbbell()], [[3, 5, 5], [7, 5, 5]], shape_id=[0, 1])
    simulation = cases.simulation_of(packing, "kratos", material={"density": 2650, "stiffness": 100.0})
    folder = written(simulation, tmp_path)
    spin = np.array([[200.0, -100.0, 50.0], [300.0, 500.0, -200.0]])
    state = started(simulation, folder, np.full((2, 3), 1e-2), spin)
    _, (_, _, _, whole) = run(folder, 4000, state)
    start = state_of(folder / "kratos_state_000000000.txt")
    _, (step, _, _, _) = run(folder, 2000, state)
    for path in folder.glob("kratos_state_*.txt"):
        if int(path.stem.split("_")[-1]) > 2000:
            path.unlink()
    _, (step, _, energy, rows) = run(folder, 4000, "kratos_state_000002000.txt")
    assert step == 4000
    np.testing.assert_allclose(rows, whole, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(rows[0, 11:14], spin[0], rtol=1e-12)
    assert energy == pytest.approx(start[2], rel=1e-6)

    def momentum(row):
        turn = rotation_matrices(row[None, 4:8])[0]
        return turn @ np.diag(simulation.bodies.moments[1]) @ turn.T @ row[11:14]

    moved = momentum(rows[1]) - momentum(start[3][1])
    assert np.linalg.norm(moved) < 1e-9 * np.linalg.norm(momentum(rows[1]))
    assert np.abs(rows[1, 4:8] - start[3][1, 4:8]).max() > 0.5


@pytest.mark.engine
@pytest.mark.parametrize(
    "container",
    [slow(vg.Box((3, 3, 4))), slow(vg.Cylinder(1.8, 4)), slow(vg.Sphere(2.0)), None],
    ids=["box", "cylinder", "sphere", "mesh"],
)
def test_walls_stop_grains_and_the_run_ends_at_rest(container, tmp_path):
    """Clumps fall, stay within the walls, and the script ends when their kinetic energy is gone."""
    if container is None:
        container = vg.ClosedMesh(vg.make_shape("solid_union", seed=2).scaled(4))
    bounds = container.bounds
    grains = cases.falling(vg.pack(cases.dumbbell().scaled(1.2), container, "rsa", count=2, seed=1, unit="mm"))
    usual = cases.simulation_of(grains, "kratos").law.stiffness
    material = {"density": 2650, "stiffness": usual / 8, "restitution": 0.1}
    simulation = cases.simulation_of(grains, "kratos", material=material, rest=1e-4)
    _, (step, _, energy, _) = run(written(simulation, tmp_path), simulation.steps)
    assert energy < simulation.rest_energy
    assert step >= 5 * simulation.time_unit / simulation.time_step
    assert step < simulation.steps
    lines = max(tmp_path.glob("kratos_spheres_*.vtk")).read_text().splitlines()
    count = int(lines[4].split()[1])
    assert count == 6
    points, radii = np.loadtxt(lines[5 : 5 + count]), np.loadtxt(lines[-count:])
    room = -simulation.bodies.assembly.container.signed_distance(points) - radii
    assert room.min() > -0.03 * simulation.diameter
    assert room.min() < 0.01 * simulation.diameter
    assert points[:, 2].min() < 1e-3 * bounds.mean(axis=0)[2]


@pytest.mark.engine
@pytest.mark.slow
def test_clumps_on_an_incline_slide_by_the_friction_of_their_pair_in_kratos(tmp_path):
    """They stand on three spheres; where the slope is steeper than the friction, g (sin a - mu cos a) is left."""
    angle, slope = 2 * np.pi * np.arange(3) / 3, math.radians(20)
    centers = 0.7 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    clump = vg.Shape.of(Spheres(centers, [0.65] * 3), name="tripod")
    packing = vg.Packing.of(
        [clump, clump], vg.Box((40, 6, 4)), shape_id=[0, 1], position=[(5, 3, 0.65), (20, 3, 0.65)], unit="mm",
        gravity=(math.sin(slope), 0, -math.cos(slope)),
    )  # fmt: skip
    materials = vg.Materials(
        {name: {"friction": 0.9} for name in ("rough", "smooth", "floor")},
        pairs={("rough", "floor"): {"friction": 0.5}, ("smooth", "floor"): {"friction": 0.2}},
        shapes=["rough", "smooth"],
        walls="floor",
    )
    simulation = cases.simulation_of(packing, "kratos", material=materials)
    steps = round(4 * simulation.time_unit / simulation.time_step)
    _, state = run(written(simulation, tmp_path), steps)
    moved = state[3][:, 1] - simulation.bodies.assembly.position[:, 0]
    expected = 0.5 * 9.81 * (math.sin(slope) - 0.2 * math.cos(slope)) * state[1] ** 2
    assert moved[1] == pytest.approx(expected, rel=0.03)
    assert abs(moved[0]) < 0.02 * moved[1]
