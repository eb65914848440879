"""YADE: polyhedra on request, in files and in the engine."""

import dataclasses
import re
import subprocess

import engine_cases
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.decks.engine import engine_registry
from voxgran.decks.write import write_deck
from voxgran.shapes.mesh import hull_of

ENGINE = "yade"
INSTALL = "apt-get install yade"
#: what a run writes of all grains: mass, centroid, inertia tensor in the frame of the container, velocity, volume and
#: corner on the greatest x, y and z of a polyhedron in the container
STATES = """
with open("states.txt", "w") as file:
    for body in grains():
        state = body.state
        turn = state.ori.toRotationMatrix()
        first, second, third = state.inertia
        tensor = turn * Matrix3(first, 0, 0, 0, second, 0, 0, 0, third) * turn.transpose()
        values = [state.mass, *state.pos, *(tensor[k, m] for k in range(3) for m in range(3)), *state.vel]
        if isinstance(body.shape, Polyhedra):
            points = [state.pos + turn * point for point in body.shape.v]
            values += [body.shape.GetVolume(), *(max(point[k] for point in points) for k in range(3))]
        else:
            values += [0, 0, 0, 0]
        file.write(" ".join(map(repr, values)) + "\\n")
sys.stdout.flush()
os._exit(0)
"""


def stones(count=6, *, unit="mm", container=None, shapes=None):
    """Return a packing of convex solids and spheres of several sizes."""
    some = [
        vg.make_shape("convex_polyhedron", seed=1),
        vg.make_shape("box", aspect=(3, 2, 1)),
        vg.make_shape("box", aspect=(1, 1, 1)),
        vg.make_shape("sphere"),
    ]
    box = container or vg.Box((4, 4, 5))
    sizes = vg.sizes.uniform(low=0.6, high=1.0)
    return engine_cases.falling(vg.pack(shapes or some, box, "rsa", count=count, sizes=sizes, seed=3, unit=unit))


def pair(*shape_id):
    """Return two cubes or spheres on a line along x, in a box without gravity, and a cube away from them."""
    shapes = [vg.make_shape("box", aspect=(1, 1, 1)), vg.make_shape("sphere")]
    width = float(np.ptp(shapes[0].vertices[:, 0]))
    reach = sum((width, 1.0)[number] for number in shape_id) / 2 + 0.1
    places = [[5 - reach / 2, 5, 5], [5 + reach / 2, 5, 5], [5, 5, 8]]
    return vg.Packing.of(
        shapes, vg.Box((10, 10, 10)), position=places, shape_id=[*shape_id, 0], unit="mm", gravity=None
    )


def run(folder, body):
    """Run commands after the functions of the script of a folder; return the states."""
    program = engine_cases.program(ENGINE, INSTALL)
    script = folder / "yade_run.py"
    script.write_text(script.read_text().split("\nif len(sys.argv) > 1:")[0] + "\n" + body + STATES)
    done = subprocess.run([program, "-n", "-x", script.name], cwd=folder, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return np.loadtxt(folder / "states.txt", ndmin=2)


def polyhedra(packing, folder, **asked):
    return write_deck(packing, folder, ENGINE, grains="polyhedron", **asked)


def hulls(simulation):
    """Return the number of each polyhedron and the hull of its corners in the container."""
    bodies = simulation.bodies
    for number in bodies.of_kind("polyhedron"):
        grains = bodies.assembly
        points = bodies.templates[grains.shape_id[number]].polyhedron.vertices * grains.scale[number]
        yield number, hull_of(points @ grains.matrices[number].T + grains.position[number])


@pytest.mark.parametrize("unit", ["mm", "m"])
def test_files_hold_the_simulation(tmp_path, unit):
    deck = polyhedra(stones(unit=unit), tmp_path)
    assert deck.simulation.bodies.kinds == {"polyhedron", "sphere"}
    engine_cases.assert_holds(engine_registry().get(ENGINE).read(tmp_path), deck.simulation)
    for path in deck.files:
        assert path.read_text().startswith("# voxgran")
    compile((tmp_path / "yade_run.py").read_text(), "yade_run.py", "exec")


def test_polyhedra_are_never_chosen_unasked(tmp_path):
    deck = write_deck(stones(), tmp_path, ENGINE, clump=5)
    assert deck.simulation.bodies.kinds == {"clump", "sphere"}
    other = write_deck(stones(2), tmp_path, ENGINE, overwrite=True)
    assert "polyhedron" not in other.simulation.bodies.kinds
    assert "polyhedra" not in other.files[0].read_text().split("def rows")[0]


def test_corners_are_those_of_the_shape(tmp_path):
    deck = polyhedra(stones(), tmp_path)
    for template in deck.simulation.bodies.templates:
        if template.kind == "polyhedron":
            found = np.loadtxt(tmp_path / f"yade_{template.name}.txt") @ template.principal.axes.T
            hull = hull_of(found)
            assert float(hull.volume) == pytest.approx(template.shape.volume, rel=1e-9)
            apart = np.linalg.norm(found[:, None] - template.shape.vertices, axis=2).min(axis=1)
            assert apart.max() < 1e-12 * template.shape.diameter


def test_points_in_faces_are_no_corners(tmp_path):
    cube = vg.Shape.from_mesh(*divided_cube(), name="grid")
    packing = vg.Packing.of(cube, vg.Box((4, 4, 4)), position=[[2, 2, 2]], unit="mm")
    polyhedra(packing, tmp_path)
    assert np.loadtxt(next(tmp_path.glob("yade_grid*.txt"))).shape == (8, 3)


def divided_cube():
    """Return a cube with a point in the middle of each triangle, as points and triangles."""
    box = vg.make_shape("box", aspect=(1, 1, 1))
    vertices, faces = [*box.vertices.tolist()], []
    for triangle in box.faces.tolist():
        middle = np.mean([vertices[k] for k in triangle], axis=0)
        vertices.append(middle.tolist())
        last = len(vertices) - 1
        faces += [[triangle[k], triangle[(k + 1) % 3], last] for k in range(3)]
    return np.array(vertices), np.array(faces)


def test_the_header_says_what_contacts_leave_out(tmp_path):
    polyhedra(stones(), tmp_path, material={"stiffness": 500.0, "restitution": 0.5})
    header = [line for line in (tmp_path / "yade_run.py").read_text().splitlines() if line.startswith("# approximated")]
    said = "\n".join(header)
    for words in (
        "times the volume of the overlap",
        "local damping 0.6 =",
        "one tangential force for all contacts",
        "may abort with a memory error",
        "5.5e-6 m",
        "may not come to rest",
    ):
        assert words in said
    script = (tmp_path / "yade_run.py").read_text()
    assert "damping=0.6, dampGravity=False" in script


def test_a_lens_has_the_stiffness_asked_for(tmp_path):
    deck = polyhedra(stones(), tmp_path, material={"stiffness": 500.0, "shear_stiffness": 200.0})
    young, ratio = map(
        float, re.search(r"PolyhedraMat\(young=(.*?), poisson=(.*?),", (tmp_path / "yade_run.py").read_text()).groups()
    )
    diameter = deck.simulation.diameter
    depth = 0.01 * diameter
    # two caps of the height h / 2, volume pi h'^2 (3 r - h') / 3 each
    cap = np.pi * (depth / 2) ** 2 * (1.5 * diameter - depth / 2) / 3
    # two materials in series
    assert young / 2 * 2 * cap == pytest.approx(500.0 * depth, rel=0.01)
    assert young / 2 * ratio == pytest.approx(200.0, rel=1e-12)


def test_what_polyhedra_do_not_have_is_refused(tmp_path):
    box, rounded = vg.make_shape("box", aspect=(1, 1, 1)), vg.make_shape("superquadric")
    hertz = {"law": "hertz", "young_modulus": 2e7}
    flat = vg.Box((4, 4, 4))
    refused = {
        "periodic and grains are polyhedra": (box, vg.Box((4, 4, 4), periodic="xy"), {}),
        "is not flat and grains are polyhedra": (box, vg.Cylinder(3, 6), {}),
        "law is 'hertz' and grains are polyhedra": (box, flat, hertz),
        "cohesion is 0.5 and grains are polyhedra": (box, flat, {**hertz, "cohesion": 0.5}),
        r"has \d+ corners: a polyhedron of YADE has at most 200": (rounded, flat, {}),
    }
    for words, (shape, container, material) in refused.items():
        packing = engine_cases.falling(vg.Packing.of(shape, container, position=[[1, 1, 1]], unit="mm"))
        with pytest.raises(InputError, match=rf"{words}.*give grains='clump'$"):
            polyhedra(packing, tmp_path, material=material)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "shape",
    [vg.shapes.spherocylinder(aspect=3.0), vg.shapes.spherocylinder(), vg.shapes.ellipsoid(aspect=(1, 1, 2))],
    ids=["rod", "short rod", "ellipsoid"],
)
def test_round_solids_are_polyhedra_of_few_corners_and_the_same_volume(shape, tmp_path):
    turned = vg.Packing.of(shape, vg.Box((4, 4, 4)), position=[[2, 2, 2]], orientation=[[0.8, 0.6, 0, 0]], unit="mm")
    deck = polyhedra(engine_cases.falling(turned), tmp_path)
    template = deck.simulation.bodies.templates[0]
    corners = np.loadtxt(tmp_path / f"yade_{template.name}.txt")
    assert len(corners) < 200
    assert hull_of(corners).volume == pytest.approx(float(shape.volume) * 1e-9)
    # the surface, of points on the polyhedron, in the body frame
    points = template.polyhedron.triangles.mean(axis=1)
    unit = template.shape.diameter
    off = np.abs(template.shape.signed_distance(np.concatenate([points, template.polyhedron.vertices]))).max() / unit
    stated = float(re.search(r"off by at most ([\d.e-]+) equivalent diameters; volume", template.approximated)[1])
    assert 0.3 * stated < off <= 1.001 * stated < 0.02


def test_level_sets_do_not_meet_polyhedra():
    packing = stones(shapes=[vg.make_shape("box", aspect=(1, 1, 1)), vg.make_shape("box", aspect=(2, 1, 1))])
    simulation = engine_cases.simulation_of(packing, ENGINE, grains="polyhedron")
    first, second = simulation.bodies.templates
    bodies = dataclasses.replace(simulation.bodies, templates=(first, dataclasses.replace(second, kind="level_set")))
    mixture = dataclasses.replace(simulation, bodies=bodies)
    with pytest.raises(InputError, match=r"polyhedra and level sets.*give grains='clump'$"):
        engine_registry().get(ENGINE).write(mixture)


@pytest.mark.engine
@pytest.mark.parametrize("unit", ["mm", slow("m")])
def test_bodies_are_loaded_as_they_are(tmp_path, unit):
    deck = polyhedra(stones(12, unit=unit), tmp_path)
    # a step of no length, after which YADE has made its polyhedra
    states = run(tmp_path, "load()\nO.dt = 1e-30\nO.step()\n")
    bodies, size = deck.simulation.bodies, deck.simulation.diameter
    assert len(states) == bodies.count
    np.testing.assert_allclose(states[:, 0], bodies.mass, rtol=1e-9)
    np.testing.assert_allclose(states[:, 1:4], bodies.assembly.position, atol=1e-9 * size)
    scale = np.abs(bodies.inertia).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(states[:, 4:13].reshape(-1, 3, 3) / scale, bodies.inertia / scale, atol=1e-9)
    for number, hull in hulls(deck.simulation):
        assert states[number, 16] == pytest.approx(float(hull.volume), rel=1e-9)
        assert states[number, 16] == pytest.approx(float(bodies.assembly.volumes[number]), rel=1e-6)
        # the surface is turned and placed as asked
        np.testing.assert_allclose(states[number, 17:20], hull.vertices.max(axis=0), atol=1e-9 * size)


@pytest.mark.engine
@pytest.mark.parametrize("unit", ["mm", slow("m")])
def test_grains_fall_freely(tmp_path, unit):
    deck = polyhedra(stones(container=vg.Box((4, 4, 500)), unit=unit), tmp_path)
    steps = deck.simulation.steps_per_output
    states = run(tmp_path, f"load()\nO.run({steps}, True)\n")
    fallen = 9.81 * steps * deck.simulation.time_step
    np.testing.assert_allclose(states[:, 13:16], [[0, 0, -fallen]] * len(states), rtol=1e-3, atol=1e-9)


@pytest.mark.engine
@pytest.mark.parametrize("case", [slow((0, 0)), (0, 1), slow((1, 1))], ids=["faces", "face and sphere", "spheres"])
@pytest.mark.parametrize("restitution", [0.4, slow(1.0)])
def test_two_grains_rebound_as_asked(tmp_path, case, restitution):
    packing = pair(*case)
    deck = polyhedra(packing, tmp_path, material={"stiffness": 500.0, "restitution": restitution})
    steps = round(4e-3 / deck.simulation.time_step)
    start = "load()\none, other = grains()[:2]\none.state.vel, other.state.vel = (0.05, 0, 0), (-0.05, 0, 0)\n"
    states = run(tmp_path, f"{start}O.run({steps}, True)\n")
    assert states[1, 13] - states[0, 13] == pytest.approx(0.1 * restitution, rel=0.02)
    assert states[:2, 0] @ states[:2, 13] == pytest.approx(
        0.05 * (states[0, 0] - states[1, 0]), abs=1e-6 * states[:, 0].sum()
    )


@pytest.mark.engine
@pytest.mark.slow
def test_a_polyhedron_rests_on_the_ground_and_goes_on_from_a_checkpoint(tmp_path):
    box = vg.make_shape("box", aspect=(1, 1, 1))
    packing = engine_cases.falling(vg.Packing.of(box, vg.Box((4, 4, 4)), position=[[2, 2, 0.7]], unit="mm"))
    deck = polyhedra(packing, tmp_path)
    program = engine_cases.program(ENGINE, INSTALL)
    command = [program, "-n", "-x", "yade_run.py"]
    assert subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=250).returncode == 0
    rows = np.loadtxt(tmp_path / "yade_energy.txt")
    assert rows[-1, 2] < deck.simulation.rest_energy
    height = float((tmp_path / "yade_poses.txt").read_text().splitlines()[-1].split()[2])
    half = float(np.ptp(box.vertices[:, 2])) / 2 * 1e-3
    assert height == pytest.approx(half, rel=0.01)
    assert list(tmp_path.glob("yade_end*.vtk"))
    again = [*command, "yade_checkpoint.yade.gz"]
    assert subprocess.run(again, cwd=tmp_path, capture_output=True, timeout=100).returncode == 0
    assert np.loadtxt(tmp_path / "yade_energy.txt")[-1, 0] > rows[-1, 0]
