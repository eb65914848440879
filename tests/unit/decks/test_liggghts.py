"""LIGGGHTS: files that hold the simulation, and runs of the engine with them."""

import dataclasses
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

ENGINE = "liggghts"
INSTALL = "apt-get install liggghts"
HERTZ = {"law": "hertz", "young_modulus": 2e7}
#: what a dump says of all clumps: frames of the inertia tensor, and moments in it
LOADED = """\
compute m all rigid property masstotal
compute i all rigid property inertia
compute ex all rigid property ex_space
compute ey all rigid property ey_space
compute ez all rigid property ez_space
dump loaded all local 1 loaded.dump c_id c_m {columns}
dump_modify loaded format "%.0f{numbers}"
dump atoms all custom 1 atoms.dump id x y z radius mass
dump_modify atoms sort id format "%d %.17g %.17g %.17g %.17g %.17g"
"""
#: what a dump says at the end
END = 'dump end all {what} {steps} end.dump {columns}\ndump_modify end format "%.0f %.17g %.17g %.17g"\n'
VECTORS = ("i", "ex", "ey", "ez")


def files_of(simulation):
    return engine_registry().get(ENGINE).write(simulation)


def two_clumps(scales):
    """Return two clumps of three spheres on a line along x, with a gap between them."""
    row = vg.Shape.of(Spheres([[-0.4, 0, 0], [0, 0, 0], [0.4, 0, 0]], [0.3, 0.35, 0.3]), name="row")
    reach = sum(0.7 * scale for scale in scales) + 0.1
    centers = [[5 - reach / 2, 5, 5], [5 + reach / 2, 5, 5]]
    return vg.Packing.of(row, vg.Box((10, 10, 10)), position=centers, scale=scales, unit="mm", gravity=None)


def sphere_on_the_ground():
    """Return a sphere that lies on the bottom of a long box."""
    sphere, box = vg.make_shape("sphere"), vg.Box((10, 4, 4))
    return engine_cases.falling(vg.Packing.of(sphere, box, position=[[1, 2, 0.5]], unit="mm"))


def run(folder, text=None):
    """Run the script of a folder, or another text in its place."""
    program = engine_cases.program(ENGINE, INSTALL)
    script = folder / "liggghts_run.in"
    if text is not None:
        script.write_text(text)
    done = subprocess.run([program, "-in", script.name], cwd=folder, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def frames(path):
    """Return the rows of each frame of a dump, in the order of the first column."""
    tables = []
    for part in path.read_text().split("ITEM: TIMESTEP\n")[1:]:
        rows = re.split(r"ITEM: (?:ATOMS|ENTRIES)[^\n]*\n", part)[1].splitlines()
        table = np.array([row.split() for row in rows], dtype=float)
        tables.append(table[np.argsort(table[:, 0])])
    return tables


def shortened(deck, steps, extra=""):
    """Return the script of a deck for a number of steps, with other commands before the run."""
    text = (deck.folder / "liggghts_run.in").read_text()
    head = re.split(r"\n(?:# at the start|run \d+)", text)[0]
    return f"{head}\n{extra}run {steps}\n"


def rock_hull():
    """Return a closed mesh of a few flat faces as a container."""
    return vg.ClosedMesh(vg.make_shape("convex_polyhedron", seed=2)).scaled(7)


PACKINGS = {
    "spheres": engine_cases.spheres,
    "mixed": engine_cases.mixed,
    "rocks": engine_cases.rocks,
    "no unit": lambda: engine_cases.mixed(unit="1"),
    "periodic": lambda: engine_cases.mixed(periodic="xy"),
    "cylinder": lambda: engine_cases.mixed(container=vg.Cylinder(2.5, 7)),
    "sphere": lambda: engine_cases.mixed(container=vg.Sphere(3.5)),
    "mesh": lambda: engine_cases.mixed(container=rock_hull()),
    "hopper": lambda: engine_cases.mixed(container=vg.Hopper(3.5, 2.4, 65, bin_height=4)),
}


@pytest.mark.parametrize("name", [slow(name) if name == "rocks" else name for name in PACKINGS])
def test_files_hold_the_simulation(tmp_path, name):
    deck = write_deck(PACKINGS[name](), tmp_path, ENGINE)
    held = engine_registry().get(ENGINE).read(tmp_path)
    engine_cases.assert_holds(held, deck.simulation)
    for path in deck.files:
        assert path.name.startswith("liggghts_")
        if path.suffix != ".stl":
            assert path.read_text().startswith("# voxgran")


def test_template_files_are_in_the_frame_of_the_shape(tmp_path):
    packing = engine_cases.mixed()
    write_deck(packing, tmp_path, ENGINE)
    rows = np.loadtxt(tmp_path / "liggghts_three_spheres_1.txt")
    centers, radii = packing.to_unit("m").shapes[1].geometry.centers, packing.to_unit("m").shapes[1].geometry.radii
    np.testing.assert_allclose(rows, np.column_stack([centers, radii]), rtol=1e-12, atol=1e-18)


def test_walls_are_those_of_the_container():
    script = files_of(engine_cases.simulation_of(engine_cases.mixed(periodic="xy"), ENGINE))["liggghts_run.in"]
    assert "boundary p p f" in script
    assert re.findall(r"\n(?:fix (\S+) all wall/gran)", script) == ["z_low", "z_high"]
    files = files_of(engine_cases.simulation_of(engine_cases.mixed(container=vg.Cylinder(2.5, 7)), ENGINE))
    radius = re.search(r" zcylinder (\S+) ", files["liggghts_run.in"])
    assert float(radius[1]) == pytest.approx(0.0025)
    assert "liggghts_wall.stl" not in files


def test_a_round_container_is_closed_triangles_outside_of_it():
    packing = engine_cases.mixed(container=vg.Sphere(3.5))
    simulation = engine_cases.simulation_of(packing, ENGINE)
    files = files_of(simulation)
    numbers = re.findall(r"vertex (\S+) (\S+) (\S+)", files["liggghts_round.stl"])
    corners = np.array(numbers, dtype=float).reshape(-1, 3, 3) - simulation.walls.round.center
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    distance = np.abs(np.einsum("ij,ij->i", normals, corners[:, 0])) / np.linalg.norm(normals, axis=1)
    assert distance.min() >= 0.0035 * (1 - 1e-9)
    assert np.linalg.norm(corners, axis=2).max() < 0.0035 * 1.02
    assert "# approximated:" in files["liggghts_run.in"]


def test_the_range_of_the_modulus_is_widened():
    soft, hard = (
        files_of(engine_cases.simulation_of(engine_cases.spheres(), ENGINE, material={**HERTZ, "young_modulus": young}))
        for young in (1e6, 7e10)
    )
    assert "\nsoft_particles yes\n" in soft["liggghts_run.in"]
    assert "\nhard_particles yes\n" in hard["liggghts_run.in"]
    assert "youngsModulus peratomtype 70000000000.0\n" in hard["liggghts_run.in"]


def test_what_liggghts_does_not_hold_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"restitution is 0\.01: LIGGGHTS takes 0\.05 to 1"):
        write_deck(engine_cases.spheres(), tmp_path, ENGINE, material={"restitution": 0.01})
    with pytest.raises(InputError, match="is a single sphere"):
        write_deck(engine_cases.rocks(), tmp_path, ENGINE, clump=1)
    with pytest.raises(InputError, match="cohesion is"):
        write_deck(engine_cases.spheres(), tmp_path, ENGINE, material={**HERTZ, "cohesion": 0.1})
    assert not list(tmp_path.iterdir())


def test_damaged_files_are_refused(tmp_path):
    write_deck(engine_cases.mixed(), tmp_path, ENGINE)
    (tmp_path / "liggghts_clumps.in").unlink()
    with pytest.raises(FileFormatError, match="gaps"):
        engine_registry().get(ENGINE).read(tmp_path)


@pytest.mark.engine
@pytest.mark.parametrize("name", ["mixed", slow("rocks"), "periodic"])
def test_bodies_are_loaded_as_they_are(tmp_path, name):
    deck = write_deck(PACKINGS[name](), tmp_path, ENGINE)
    columns = [f"c_{name}[{k + 1}]" for name in VECTORS for k in range(3)]
    extra = LOADED.format(columns=" ".join(columns), numbers=" %.17g" * 13)
    # a step of no length
    text = re.sub(r"\ntimestep \S+(?=\ncompute)", "\ntimestep 1e-30", shortened(deck, 1, extra))
    run(tmp_path, text)
    bodies = deck.simulation.bodies
    size, walls = deck.simulation.diameter, deck.simulation.walls
    period = np.where(walls.periodic, np.ptp(walls.bounds, axis=0), np.inf)

    def assert_near(points, expected):
        """Check positions, apart from whole periods."""
        away = points - expected
        away -= np.where(
            np.isfinite(period), np.round(away / np.where(np.isfinite(period), period, 1.0)), 0.0
        ) * np.where(np.isfinite(period), period, 0.0)
        np.testing.assert_allclose(away, 0, atol=1e-6 * size)

    clumps = bodies.of_kind("clump")
    loaded, poses = frames(tmp_path / "loaded.dump")[-1], frames(tmp_path / "liggghts_clumps.dump")[-1]
    assert len(loaded) == len(clumps)
    np.testing.assert_allclose(loaded[:, 1], bodies.mass[clumps], rtol=1e-12)
    assert_near(poses[:, 1:4], bodies.assembly.position[clumps])
    moments, axes = loaded[:, 2:5], loaded[:, 5:].reshape(-1, 3, 3)
    tensors = np.einsum("ni,nij,nik->njk", moments, axes, axes)
    scale = np.abs(bodies.inertia[clumps]).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(tensors / scale, bodies.inertia[clumps] / scale, atol=1e-9)
    centers, radii, grain = bodies.spheres
    atoms = frames(tmp_path / "atoms.dump")[-1]
    of_clump = np.isin(grain, clumps)
    order = np.concatenate([np.flatnonzero(~of_clump), np.flatnonzero(of_clump)])
    assert_near(atoms[:, 1:4], centers[order])
    np.testing.assert_allclose(atoms[:, 4], radii[order], rtol=1e-12)
    # an atom of a clump has the mass of the clump, which the damping of its contacts follows
    np.testing.assert_allclose(atoms[:, 5], bodies.mass[grain[order]], rtol=1e-9)


@pytest.mark.engine
def test_grains_fall_freely(tmp_path):
    deck = write_deck(engine_cases.mixed(container=vg.Box((5, 5, 500))), tmp_path, ENGINE)
    steps = deck.simulation.steps_per_output
    run(tmp_path, shortened(deck, steps))
    # clumps were put in at one step before
    fallen = 9.81 * (steps - 1) * deck.simulation.time_step
    np.testing.assert_allclose(frames(tmp_path / "liggghts_clumps.dump")[-1][:, 8:11], [[0, 0, -fallen]] * 4, rtol=1e-3)
    np.testing.assert_allclose(
        frames(tmp_path / "liggghts_spheres.dump")[-1][:, 8:11], [[0, 0, -fallen]] * 4, rtol=1e-3
    )


MATERIALS = {
    "linear": {"stiffness": 500.0, "restitution": 0.4},
    "elastic": {"stiffness": 500.0, "restitution": 1.0},
    "hertz": {**HERTZ, "restitution": 0.4},
}


@pytest.mark.engine
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("radii", [(0.5, 0.5), (0.5, 0.25), (0.9, 0.15)])
def test_two_spheres_rebound_as_asked(tmp_path, material, radii):
    deck = write_deck(engine_cases.two_spheres(radii=radii), tmp_path, ENGINE, material=MATERIALS[material])
    extra = "group left id 1\ngroup right id 2\nvelocity left set 0.05 0 0\nvelocity right set -0.05 0 0\n"
    steps = round(4e-3 / deck.simulation.time_step)
    run(tmp_path, shortened(deck, steps, extra + END.format(steps=steps, what="custom", columns="id vx vy vz")))
    velocity = frames(tmp_path / "end.dump")[-1][:, 1:]
    assert velocity[1, 0] - velocity[0, 0] == pytest.approx(0.1 * MATERIALS[material]["restitution"], rel=0.02)
    mass = deck.simulation.bodies.mass
    assert mass @ velocity[:, 0] == pytest.approx(0.05 * (mass[0] - mass[1]), abs=1e-9 * mass.sum())


@pytest.mark.engine
@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("scales", [(1.0, 1.0), (1.0, 0.4)])
def test_two_clumps_rebound_as_asked(tmp_path, material, scales):
    deck = write_deck(two_clumps(scales), tmp_path, ENGINE, material=MATERIALS[material])
    path = tmp_path / "liggghts_clumps.in"
    first, second = path.read_text().split("vel constant 0 0 0", 1)
    second = second.replace("vel constant 0 0 0", "vel constant -0.05 0 0")
    path.write_text(f"{first}vel constant 0.05 0 0{second}")
    steps = round(4e-3 / deck.simulation.time_step)
    run(tmp_path, shortened(deck, steps, END.format(steps=steps, what="local", columns="c_id c_v[1] c_v[2] c_v[3]")))
    velocity = frames(tmp_path / "end.dump")[-1][:, 1:]
    assert velocity[1, 0] - velocity[0, 0] == pytest.approx(0.1 * MATERIALS[material]["restitution"], rel=0.02)


@pytest.mark.engine
@pytest.mark.parametrize("law", ["linear", slow("hertz")])
@pytest.mark.parametrize("name", ["mixed", slow("cylinder"), slow("sphere"), "mesh", slow("hopper"), "periodic"])
def test_walls_hold_the_grains(tmp_path, name, law):
    material = {"stiffness": 200.0} if law == "linear" else HERTZ
    deck = write_deck(PACKINGS[name](), tmp_path, ENGINE, material=material)
    steps = round(12 * deck.simulation.time_unit / deck.simulation.time_step)
    extra = f"dump end all custom {steps // 5} end.dump id x y z radius\n"
    run(tmp_path, shortened(deck, steps, extra))
    rows = frames(tmp_path / "end.dump")[-1]
    depth = deck.packing.to_unit("m").container.signed_distance(rows[:, 1:4]) + rows[:, 4]
    assert depth.max() < 0.02 * deck.simulation.diameter
    # they lie on the ground, and do not hover
    assert rows[:, 3].min() - deck.simulation.walls.bounds[0, 2] < 1.0 * deck.simulation.diameter
    assert np.isfinite(rows).all()


@pytest.mark.engine
@pytest.mark.parametrize("material", ["linear", "hertz"])
def test_a_sphere_slides_and_then_rolls(tmp_path, material):
    deck = write_deck(sphere_on_the_ground(), tmp_path, ENGINE, material={**MATERIALS[material], "friction": 0.3})
    sliding, rolling = (round(time / deck.simulation.time_step) for time in (4e-3, 20e-3))
    extra = "velocity all set 0.1 0 0\n" + END.format(steps=sliding, what="custom", columns="id vx vy vz")
    run(tmp_path, shortened(deck, rolling, extra))
    velocity = [rows[0, 1] for rows in frames(tmp_path / "end.dump")]
    assert velocity[1] == pytest.approx(0.1 - 0.3 * 9.81 * 4e-3, rel=0.01)
    assert velocity[-1] == pytest.approx(5 / 7 * 0.1, rel=0.01)


@pytest.mark.engine
def test_a_bed_comes_to_rest_and_the_script_ends(tmp_path):
    # clumps cannot spin on one point for ever
    packing = engine_cases.mixed(count=4)
    packing = dataclasses.replace(packing, shape_id=np.ones(4, dtype=np.int64))
    deck = write_deck(packing, tmp_path, ENGINE, material={"stiffness": 100.0})
    run(tmp_path)
    rows = np.loadtxt(tmp_path / "liggghts_energy.txt")
    assert rows[-1, 0] < 0.9 * deck.simulation.steps
    assert rows[-1, 1] < 2 * deck.simulation.rest_energy
    assert (tmp_path / "liggghts_end.restart").is_file()
