"""Fixed grains in decks: what is written, and what becomes of them in engines."""

import dataclasses
import os
import subprocess

import engine_cases as cases
import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.decks.engine import engine_registry

REMEDY = "make test-engines"
#: two spheres, a clump, and what moves
MASK = np.array([True, True, False, False, False, True, False, False])
FIXED = tuple(name for name in engine_registry().names() if engine_registry().get(name).fixed)


def bed():
    """Return spheres and clumps of which some are fixed in mid-air."""
    return dataclasses.replace(cases.mixed(8), fixed=MASK)


def test_numbers_of_fixed_grains_are_told_in_rows():
    made = cases.simulation_of(bed(), "lammps")
    assert made.fixed == [(1, 2), (6, 6)]
    assert cases.simulation_of(cases.mixed(8), "lammps").fixed == []
    assert "3 grains are fixed" in made.header("LAMMPS")
    # those that move decide when the bed rests
    free = cases.simulation_of(cases.mixed(8), "lammps")
    assert made.rest_energy == pytest.approx(free.rest_energy * 5 / 8)


@pytest.mark.parametrize("engine", FIXED)
def test_masses_of_fixed_grains_are_true(engine, tmp_path):
    entry = engine_registry().get(engine)
    packing = bed() if "sphere" in entry.kinds else dataclasses.replace(cases.rocks(8), fixed=MASK)
    deck = vg.write_deck(packing, tmp_path, engine)
    np.testing.assert_allclose(entry.read(tmp_path).mass, deck.simulation.bodies.mass, rtol=1e-6)


def test_packings_without_a_grain_that_moves_are_refused(tmp_path):
    still = dataclasses.replace(cases.mixed(8), fixed=np.ones(8, dtype=bool))
    with pytest.raises(InputError, match=r"8 grains are fixed: .* and grains that move"):
        vg.write_deck(still, tmp_path, "liggghts")


def poses(engine, folder, count):
    """Return the centroids at the start and at the end of a run, by grain."""
    if engine == "yade":
        rows = [line.split() for line in (folder / "yade_poses.txt").read_text().splitlines() if line[0] != "#"]
        table = np.array(rows, dtype=float)[:, :3]
        return table[:count], table[-count:]
    files = sorted(folder.glob("kratos_state_*.txt"))
    return [np.loadtxt(path)[:, 1:4] for path in (files[0], files[-1])]


@pytest.mark.engine
@pytest.mark.parametrize("engine", ["yade", "kratos"])
def test_fixed_grains_stay_and_others_fall(engine, tmp_path):
    packing = bed()
    deck = vg.write_deck(packing, tmp_path, engine)
    program = cases.python_of_kratos() if engine == "kratos" else cases.program(engine, REMEDY)
    command = [program, "kratos_run.py"] if engine == "kratos" else [program, "-n", "-x", "yade_run.py"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    short(tmp_path, engine, deck)
    subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=200, check=True, env=environment)
    start, end = poses(engine, tmp_path, packing.count)
    np.testing.assert_allclose(start, deck.simulation.bodies.assembly.position, atol=1e-9)
    np.testing.assert_array_equal(end[MASK], start[MASK])
    assert (end[~MASK, 2] < start[~MASK, 2]).all()


def short(folder, engine, deck):
    """Let a script run for two outputs only."""
    path = folder / f"{engine}_run.py"
    steps, every = deck.simulation.steps, deck.simulation.steps_per_output
    old = {"yade": f"STEPS, EVERY, START = {steps}", "kratos": f"STEPS = {steps}"}[engine]
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, old.replace(str(steps), str(2 * every))))


@pytest.mark.engine
def test_a_fixed_clump_of_liggghts_deflects_what_falls_on_it(tmp_path):
    """A sphere falls on a fixed clump, and one beside it on the floor."""
    shapes, places = [vg.make_shape("sphere"), cases.dumbbell()], [(2, 2, 3), (4, 4, 3), (2, 2, 1.5)]
    packing = vg.Packing.of(shapes, vg.Box((5, 5, 5)), position=places, shape_id=[0, 0, 1], unit="mm")
    packing = dataclasses.replace(cases.falling(packing), fixed=np.array([False, False, True]))
    deck = vg.write_deck(packing, tmp_path, "liggghts")
    text = (tmp_path / "liggghts_run.in").read_text().splitlines()
    end = next(k for k, line in enumerate(text) if line.startswith("variable output loop"))
    (tmp_path / "liggghts_run.in").write_text("\n".join(text[:end]) + "\n")
    program = cases.program("liggghts", REMEDY)
    subprocess.run([program, "-in", "liggghts_run.in"], cwd=tmp_path, capture_output=True, timeout=200, check=True)
    rows = (tmp_path / "liggghts_spheres.dump").read_text().splitlines()[-2:]
    found = {int(row.split()[0]): np.array(row.split()[1:4], dtype=float) for row in rows}
    radius = 0.5e-3
    # the first one was deflected by the clump, the other fell straight down
    assert np.linalg.norm(found[1][:2] - 2e-3) > 0.1 * radius
    assert found[2][:2] == pytest.approx([4e-3, 4e-3], abs=1e-9)
    assert found[2][2] == pytest.approx(radius, rel=0.01)
    assert deck.simulation.fixed == [(3, 3)]
