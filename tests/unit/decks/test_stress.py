"""Stresses of periodic cells in decks: what is written, what is refused, what becomes of a specimen in an engine."""

import dataclasses
import re
import subprocess

import engine_cases as cases
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.decks.engine import Frame, engine_registry

NAN = float("nan")
REMEDY = "make test-engines"
#: a script of YADE that prints stresses and edges of the cell at the end of a run
LOOK = """
import os, sys
O.load("yade_checkpoint.yade.gz")
stress = utils.getStress()
print("STRESS", stress[0, 0], stress[1, 1], stress[2, 2], *O.cell.size)
sys.stdout.flush()
os._exit(0)
"""


def specimen(count=60, **more):
    cube = vg.Box((4, 4, 4), periodic="xyz")
    return vg.pack(vg.shapes.sphere(), cube, "compress", count=count, unit="mm", **more)


def loose(periodic="xyz"):
    return vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4), periodic=periodic), "rsa", count=8, unit="mm")


def drum():
    return vg.pack(vg.shapes.sphere(), vg.Cylinder(3, 4), "rsa", count=8, unit="mm")


def test_units_follow_from_the_stress():
    made = cases.simulation_of(loose(), "lammps", stress=(NAN, 2e3, 5e3))
    mass, d = np.pi / 6 * 1e-9 * 2650, 1e-3
    assert made.pressure == 5e3
    assert made.time_unit == pytest.approx(np.sqrt(mass / (5e3 * d)))
    assert made.rest_energy == pytest.approx(8 * 1e-8 * 5e3 * d**3)
    # a stiffness by which the stress presses grains in by a thousandth of their diameter
    assert made.law.stiffness * 1e-3 * d == pytest.approx(5e3 * d**2)
    none = cases.simulation_of(loose(), "lammps")
    assert (none.pressure, none.stress) == (0.0, None)


def test_lammps_keeps_the_stress_of_each_axis(tmp_path):
    vg.write_deck(loose(), tmp_path, "lammps", stress=(NAN, 2e3, 5e3))
    script = (tmp_path / "lammps_run.in").read_text()
    servo = re.search(
        r"fix servo all press/berendsen y 2000.0 2000.0 (\S+) z 5000.0 5000.0 (\S+) modulus (\S+)", script
    )
    assert servo[1] == servo[2]
    unrest = re.search(r'variable unrest equal "(.*)"', script)[1]
    assert "c_servo_press[2]/2000.0" in unrest
    assert "c_servo_press[1]" not in unrest
    assert "halt" in script
    vg.write_deck(loose(), tmp_path, "lammps", overwrite=True)
    assert "servo" not in (tmp_path / "lammps_run.in").read_text()


def test_yade_keeps_the_stress_of_each_axis(tmp_path):
    big = vg.pack(vg.shapes.sphere(), vg.Box((6, 6, 6), periodic="xyz"), "rsa", count=8, unit="mm")
    vg.write_deck(big, tmp_path, "yade", stress=(NAN, 2e3, 5e3))
    script = (tmp_path / "yade_run.py").read_text()
    assert "PeriTriaxController(goal=(0.0, -2000.0, -5000.0), stressMask=6," in script
    assert "damping=0.2" in script
    assert float(re.search(r"UNBALANCED = (\S+)", script)[1]) > 0
    vg.write_deck(big, tmp_path, "yade", overwrite=True)
    script = (tmp_path / "yade_run.py").read_text()
    assert "PeriTriax" not in script
    assert "UNBALANCED = 0.0" in script


@pytest.mark.parametrize(
    ("packing", "engine", "stress", "words"),
    [
        (loose(), "lammps", 0.0, "one number of pascals above 0, or three"),
        (loose(), "lammps", (1.0, 2.0), "one number of pascals above 0, or three"),
        (loose(), "lammps", (1.0, -2.0, NAN), "one number of pascals above 0, or three"),
        (loose(), "lammps", (NAN,) * 3, "one number of pascals above 0, or three"),
        (loose(), "lammps", "1e5", "one number of pascals above 0, or three"),
        (loose(), "pfc", 1e5, "input for PFC has no periodic sides that keep one; choose engine 'lammps' or 'yade'"),
        (loose(""), "kratos", 1e5, "input for Kratos has no walls that keep one; choose engine 'lammps'"),
        (loose("xy"), "yade", 1e5, "walls and periodic sides are to keep one; give NaN"),
        (drum(), "liggghts", 1e5, "no two plane walls along x, y; give NaN"),
        (loose("xy"), "yade", (NAN, NAN, 1e5), "YADE has none that move in a periodic cell"),
        (dataclasses.replace(loose("xy"), gravity=(0, 0, -1)), "lammps", (1e5, 1e5, NAN), "both are not held"),
    ],
)
def test_what_no_engine_keeps_is_refused_in_one_sentence(packing, engine, stress, words, tmp_path):
    with pytest.raises(InputError, match=words):
        vg.write_deck(packing, tmp_path, engine, stress=stress)
    assert not list(tmp_path.iterdir())


def test_a_cell_that_strains_is_the_container_of_the_relaxed_packing(monkeypatch):
    packing = loose()

    def run(folder, simulation):
        del folder
        position, turns = simulation.bodies.assembly.position, np.tile(np.eye(3), (8, 1, 1))
        bounds = simulation.walls.bounds
        yield Frame(0.0, position, turns, 0.0, bounds=bounds)
        # shrunk by a tenth about the middle along z, and one grain moves by 0.2 d beside that
        shrunk = bounds.mean(axis=0) + (bounds - bounds.mean(axis=0)) * [1, 1, 0.9]
        moved = shrunk[0] + (position - bounds[0]) * [1, 1, 0.9]
        moved[0, 0] += 2e-4
        yield Frame(1.0, moved, turns, 0.0, bounds=shrunk)

    entry = dataclasses.replace(engine_registry().get("lammps"), write=lambda _: {}, run=run)
    monkeypatch.setattr(
        "voxgran.decks.relax.engine_registry", lambda: type("One", (), {"get": lambda _, name: entry})()
    )
    after, history = vg.relax(packing, stress=1e5)
    assert after.container.lengths == pytest.approx((4, 4, 3.6))
    assert history["largest_displacement"].values[-1] == pytest.approx(0.2)
    assert history["mean_displacement"].values[-1] == pytest.approx(0.2 / 8)
    assert after.relaxation.mean_displacement == pytest.approx(0.2 / 8)
    assert (history.attrs["sinking"], history.attrs["rests"]) == (0.0, 1)
    expected = packing.position * [1, 1, 0.9]
    expected[0, 0] += 0.2
    np.testing.assert_allclose(after.position, expected % [4, 4, 3.6], atol=1e-12)
    assert after.measure("relaxation")["mean_displacement"] == pytest.approx(0.2 / 8)


@pytest.mark.engine
@pytest.mark.parametrize("stress", [1e3, (NAN, NAN, 1e3)])
def test_a_specimen_hardly_moves_when_lammps_gives_it_a_stiffness(monkeypatch, stress):
    monkeypatch.setenv("VOXGRAN_LAMMPS", cases.program("lmp", REMEDY))
    axes = "xyz" if np.ndim(stress) == 0 else "z"
    made = specimen(axes=axes, friction=0.5)
    after, history = vg.relax(made, stress=stress, material={"friction": 0.5})
    assert history.attrs["rests"] == 1
    assert after.relaxation.mean_displacement < 0.01
    assert after.solid_fraction == pytest.approx(made.solid_fraction, abs=0.01)
    still = [k for k in range(3) if "xyz"[k] not in axes]
    assert np.array(after.container.lengths)[still] == pytest.approx(np.array(made.container.lengths)[still], rel=1e-9)


@pytest.mark.engine
def test_clumps_keep_a_stress_in_lammps(monkeypatch):
    monkeypatch.setenv("VOXGRAN_LAMMPS", cases.program("lmp", REMEDY))
    clump = vg.make_shape("sphere_assembly", seed=1)
    made = vg.pack(clump, vg.Box((4, 4, 4), periodic="xyz"), "compress", count=20, unit="mm", friction=0.5)
    after, history = vg.relax(made, stress=1e3, material={"friction": 0.5})
    assert history.attrs["rests"] == 1
    assert after.relaxation.mean_displacement < 0.02


@pytest.mark.engine
def test_yade_meets_the_stress_and_comes_to_rest(tmp_path):
    program = cases.program("yade", REMEDY)
    made = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4), periodic="xyz"), "compress", count=50, unit="mm")
    deck = vg.write_deck(made, tmp_path, "yade", stress=1e3, material={"friction": 0.5})
    subprocess.run([program, "-n", "-x", "yade_run.py"], cwd=tmp_path, capture_output=True, timeout=300, check=True)
    lines = (tmp_path / "yade_energy.txt").read_text().splitlines()
    # it has not run for the longest time
    assert int(lines[-1].split()[0]) < deck.simulation.steps / 2
    (tmp_path / "look.py").write_text(LOOK)
    told = subprocess.run([program, "-n", "-x", "look.py"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
    found = np.array(re.search(r"STRESS (.*)", told.stdout)[1].split(), dtype=float)
    assert found[:3] == pytest.approx([-1e3] * 3, rel=0.01)
    assert found[3:] == pytest.approx(np.array(made.container.lengths) * 1e-3, rel=0.01)


def walled(count=60, container=None, **more):
    """Return a specimen that is compressed between walls."""
    box = container or vg.Box((4, 4, 4))
    return vg.pack(vg.shapes.sphere(), box, "compress", count=count, unit="mm", friction=0.5, **more)


def test_the_upper_wall_of_each_axis_moves_with_the_force_of_the_stress():
    packing = loose("")
    made = cases.simulation_of(packing, "liggghts", stress=(NAN, 2e3, 5e3))
    assert [one.plane.name for one in made.platens] == ["y_high", "z_high"]
    assert [one.force for one in made.platens] == pytest.approx([2e3 * 16e-6, 5e3 * 16e-6])
    # as a damper with the impedance of the grains, the root of density times modulus
    impedance = 16e-6 * np.sqrt(2650 * made.law.stiffness / 1e-3)
    assert [one.speed for one in made.platens] == pytest.approx([one.force / impedance for one in made.platens])
    told = [line for line in made.header("LIGGGHTS") if "moves so that" in line]
    assert len(told) == 2
    assert "z_high" in told[1]
    round_one = cases.simulation_of(drum(), "liggghts", stress=(NAN, NAN, 1e3))
    assert round_one.platens[0].force == pytest.approx(1e3 * np.pi * 9e-6)
    assert cases.simulation_of(packing, "liggghts").platens == ()


def test_the_impedance_of_elastic_spheres_is_that_under_the_stress():
    hertz = {"law": "hertz", "young_modulus": 1e8}
    made = cases.simulation_of(loose(""), "liggghts", stress=1e3, material=hertz)
    law, d, load = made.law, 1e-3, 1e3 * 1e-6
    overlap = law.overlap_under(load, d)
    # Hertz: F = 4/3 E* sqrt(R) overlap^(3/2), with half the radius of equal spheres
    assert 4 / 3 * 1e8 / (2 * (1 - 0.25**2)) * np.sqrt(d / 4) * overlap**1.5 == pytest.approx(load)
    assert law.stiffness_at(overlap, d) == pytest.approx(1.5 * load / overlap)
    impedance = 16e-6 * np.sqrt(2650 * 1.5 * load / overlap / d)
    assert made.platens[0].speed == pytest.approx(1e3 * 16e-6 / impedance)


def moved(engine, folder, deck, columns):
    """Run a deck of spheres and return the lines of the energy, and how far grains have moved, in m."""
    arguments = {"liggghts": ["-in", "liggghts_run.in"], "yade": ["-n", "-x", "yade_run.py"]}[engine]
    command = [cases.program(engine, REMEDY), *arguments]
    subprocess.run(command, cwd=folder, capture_output=True, timeout=300, check=True)
    bodies = deck.simulation.bodies
    places = {"liggghts": "liggghts_spheres.dump", "yade": "yade_poses.txt"}[engine]
    rows = (folder / places).read_text().splitlines()[-bodies.count :]
    table = np.array([row.split() for row in rows], dtype=float)[:, columns]
    energy = (folder / f"{engine}_energy.txt").read_text().splitlines()
    return energy, np.linalg.norm(table - bodies.assembly.position, axis=1)


@pytest.mark.engine
@pytest.mark.parametrize(("engine", "first"), [("liggghts", 1), slow("yade", 0)])
@pytest.mark.parametrize("container", [None, slow(vg.Cylinder(2.2, 5))], ids=["box", "cylinder"])
def test_a_specimen_between_walls_hardly_moves_when_an_engine_gives_it_a_stiffness(engine, first, container, tmp_path):
    flat = container is None
    made = walled(container=container, **({} if flat else {"axes": "z"}))
    stress = 1e3 if flat else (NAN, NAN, 1e3)
    deck = vg.write_deck(made, tmp_path, engine, stress=stress, material={"friction": 0.5})
    energy, distance = moved(engine, tmp_path, deck, slice(first, first + 3))
    # it is at rest before the longest time, which the force on each wall and the energy decide
    assert int(energy[-1].split()[0]) < deck.simulation.steps / 2
    # the strain of elastic contacts, of which each overlaps by a thousandth of a diameter, is part of that
    assert np.median(distance) < 0.06 * deck.simulation.diameter


@pytest.fixture
def lammps(monkeypatch):
    monkeypatch.setenv("VOXGRAN_LAMMPS", cases.program("lmp", REMEDY))


@pytest.mark.engine
def test_a_platen_of_lammps_moves_up_to_a_sphere_and_presses_it_with_its_force(lammps):
    sphere = {"position": [(2, 2, 0.5)], "gravity": None, "unit": "mm"}
    packing = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 4, 1.05)), **sphere)
    after, history = vg.relax(packing, stress=(NAN, NAN, 10.0), material={"stiffness": 1e3})
    # a force of 10 Pa on 16 mm^2 presses the sphere into floor and platen, each over the stiffness, in mm
    depth = 10.0 * 16e-6 / 1e3 * 1e3
    assert after.stop_reason == "count"
    assert after.position[0] == pytest.approx([2, 2, 0.5 - depth], abs=0.01 * depth)
    assert after.container.lengths == pytest.approx((4, 4, 1 - 2 * depth), abs=0.01 * depth)
    assert float(history.mean_displacement[-1]) == pytest.approx(0.5 * 0.05 / 1.05, rel=0.01)


@pytest.mark.engine
@pytest.mark.parametrize(
    ("round_wall", "materials"), [(False, True), (True, False), slow(False, False), slow(True, True)]
)
def test_a_specimen_between_platens_of_lammps_hardly_moves(lammps, round_wall, materials):
    made = walled(container=vg.Cylinder(2.2, 5) if round_wall else None, **({"axes": "z"} if round_wall else {}))
    material = {"friction": 0.5}
    if materials:
        table = {"sand": vg.Material(**material), "steel": vg.Material(**material)}
        material = vg.Materials(table, shapes="sand", walls="steel")
    after, history = vg.relax(made, stress=(NAN, NAN, 1e3) if round_wall else 1e3, material=material)
    assert after.stop_reason == "count"
    # the strain of elastic contacts, of which each overlaps by a thousandth of a diameter, is not part of that
    assert float(history.mean_displacement[-1]) < 0.05
    # the same grains bear the stress afterwards
    assert abs(float(history.coordination_number[-1] - history.coordination_number[0])) < 0.5
    assert float(history.share_of_rattlers[-1]) < 0.2


@pytest.mark.engine
@pytest.mark.parametrize(("engine", "first"), [("liggghts", 1), slow("yade", 0)])
def test_walls_move_up_to_loose_grains(engine, first, tmp_path):
    """One sphere between walls at a gap: the upper wall comes and presses with its force."""
    packing = vg.Packing.of(vg.shapes.sphere(), vg.Box((4, 4, 1.05)), position=[(2, 2, 0.5)], gravity=None, unit="mm")
    material = {"stiffness": 1e3}
    deck = vg.write_deck(packing, tmp_path, engine, stress=(NAN, NAN, 10.0), material=material)
    _, distance = moved(engine, tmp_path, deck, slice(first, first + 3))
    # it is pressed into the floor by the force over the stiffness
    force = 10.0 * 16e-6
    assert distance[0] == pytest.approx(force / 1e3, rel=0.05)
