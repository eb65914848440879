"""`relax`: history, rest, and the way back into a packing, in LAMMPS where it is installed."""

import dataclasses
import math

import engine_cases as cases
import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError, OutputExistsError
from voxgran.decks.engine import Engine, Frame, engine_registry
from voxgran.decks.relax import relax, remove_state, save_history
from voxgran.measures.model import measure_registry
from voxgran.settling.relaxation import Relaxation

REMEDY = "make test-engines"
NAMES = [
    "kinetic_energy", "mean_sinking", "mean_displacement", "largest_displacement", "coordination_number",
    "share_of_rattlers", "solid_fraction",
]  # fmt: skip


@pytest.fixture
def lammps(monkeypatch):
    monkeypatch.setenv("VOXGRAN_LAMMPS", cases.program("lmp", REMEDY))


def sinking_engine(by, energies=(0.0, 1.0, 0.0)):
    """Return an engine of our own, whose grains sink and turn by given amounts."""

    def run(folder, simulation):
        del folder
        turn = np.tile([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], (simulation.bodies.count, 1, 1))
        for number, energy in enumerate(energies):
            share = number / (len(energies) - 1)
            position = simulation.bodies.assembly.position - [0, 0, share * by]
            matrices = np.tile(np.eye(3), (len(turn), 1, 1)) if number == 0 else turn
            yield Frame(float(number), position, matrices, energy)

    return dataclasses.replace(engine_registry().get("lammps"), write=lambda _: {}, run=run)


@pytest.fixture
def sinking(monkeypatch):
    def replaced(by, **keywords):
        entry = sinking_engine(by, **keywords)
        monkeypatch.setattr("voxgran.decks.relax.engine_registry", lambda: _Registry(entry))

    return replaced


class _Registry:
    def __init__(self, entry):
        self.entry = entry

    def get(self, name):
        del name
        return self.entry

    def names(self):
        return (self.entry.name,)


def test_poses_and_numbers_of_the_last_state(sinking):
    packing = cases.mixed()
    sinking(2e-4)
    rested, history = relax(packing)
    # 0.2 mm
    np.testing.assert_allclose(rested.position, packing.position - [0, 0, 0.2], atol=1e-12)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(rested.matrices, turn @ packing.matrices, atol=1e-12)
    median = np.median(packing.diameters)
    assert list(history.data_vars) == NAMES
    assert history["mean_sinking"].values == pytest.approx([0, 0.1 / median, 0.2 / median])
    assert history["largest_displacement"].values == pytest.approx([0, 0.1 / median, 0.2 / median])
    assert history.attrs["sinking"] == pytest.approx(0.2 / median)
    assert history.attrs["rests"] == 1
    assert rested.stop_reason == "count"
    assert all(history[name].attrs["long_name"] for name in NAMES)
    assert history["time"].attrs["units"] == "s"


def test_a_run_that_ends_moving_does_not_rest(sinking):
    sinking(1e-4, energies=(0.0, 1.0, 1.0))
    rested, history = relax(cases.spheres())
    assert history.attrs["rests"] == 0
    assert rested.stop_reason == "steps"


def test_energy_is_in_weights_times_diameters(sinking):
    packing = cases.spheres()
    sinking(0.0, energies=(0.0, 3.0))
    _, history = relax(packing)
    volumes, diameters = packing.volumes * 1e-9, packing.diameters * 1e-3
    expected = 3.0 / packing.count / (np.median(volumes) * 2650 * 9.81 * np.median(diameters))
    assert history["kinetic_energy"].values[-1] == pytest.approx(expected)


def test_grains_are_wrapped_into_periodic_containers(sinking):
    packing = dataclasses.replace(cases.spheres(periodic="xyz"), gravity=(0.0, 0.0, -1.0))
    sinking(8e-3)
    rested, _ = relax(packing)
    assert rested.position.min() >= 0
    np.testing.assert_allclose(rested.position[:, 2], (packing.position[:, 2] - 8) % 6, atol=1e-9)


def test_contacts_and_rattlers_of_a_pile(sinking):
    # a tetrahedron of touching spheres on the floor, and one sphere alone in the air
    side, height = 1.0, math.sqrt(2 / 3)
    base = [[2, 2, 0.5], [2 + side, 2, 0.5], [2 + side / 2, 2 + side * math.sqrt(3) / 2, 0.5]]
    top = [2.5, 2 + side * math.sqrt(3) / 6, 0.5 + height]
    packing = vg.Packing.of(vg.make_shape("sphere"), vg.Box((6, 6, 6)), position=[*base, top, [5, 5, 5]], unit="mm")
    sinking(0.0)
    _, history = relax(packing)
    assert history["coordination_number"].values[-1] == pytest.approx(2 * 6 / 5)
    assert history["share_of_rattlers"].values[-1] == pytest.approx(1 / 5)
    _, smooth = relax(packing, material={"friction": 0.0})
    # the grain at the top has three contacts, those below have three and the floor
    assert smooth["share_of_rattlers"].values[-1] == pytest.approx(2 / 5)


def test_the_solid_fraction_is_that_of_the_slab(sinking):
    grid = np.stack(np.meshgrid(*[np.arange(n) + 0.5 for n in (5, 5, 20)], indexing="ij"), axis=-1).reshape(-1, 3)
    packing = vg.Packing.of(vg.make_shape("sphere"), vg.Box((5, 5, 30)), position=grid, unit="mm")
    sinking(0.0)
    _, history = relax(packing)
    # between 1.5 and 16.5 or 17.5: whole layers of a simple cubic lattice
    assert history["solid_fraction"].values[-1] == pytest.approx(math.pi / 6, rel=0.03)


def test_the_result_carries_what_has_changed_through_files(sinking, tmp_path):
    sinking(2e-4)
    rested, history = relax(cases.mixed())
    assert isinstance(rested.relaxation, Relaxation)
    rested.save(tmp_path / "rested.vtp")
    again = vg.load(tmp_path / "rested.vtp")
    assert again.relaxation == rested.relaxation
    tree = vg.measure(again, "relaxation")
    assert float(tree["sinking"]) == pytest.approx(history.attrs["sinking"])
    assert float(tree["change_of_coordination"]) == pytest.approx(history.attrs["change_of_coordination"])
    assert not measure_registry().get("relaxation").applies(cases.mixed())
    assert again[again.diameter > 0].relaxation is None
    save_history(history, tmp_path / "history.nc")
    import xarray as xr

    with xr.open_dataset(tmp_path / "history.nc", engine="netcdf4") as read:
        np.testing.assert_array_equal(read["mean_sinking"], history["mean_sinking"])


def test_an_interrupt_leaves_the_last_state(monkeypatch, tmp_path):
    def run(folder, simulation):
        yield from sinking_engine(2e-4).run(folder, simulation)
        raise KeyboardInterrupt

    entry = dataclasses.replace(sinking_engine(0.0), run=run)
    monkeypatch.setattr("voxgran.decks.relax.engine_registry", lambda: _Registry(entry))
    packing = cases.spheres()
    with pytest.raises(KeyboardInterrupt):
        relax(packing, checkpoint=tmp_path / "state.vtp")
    state = vg.load(tmp_path / "state.vtp")
    np.testing.assert_allclose(state.position, packing.position - [0, 0, 0.2], atol=1e-9)


def test_files_of_a_user_are_not_overwritten_unasked(monkeypatch, tmp_path):
    (tmp_path / "mine.txt").write_text("kept")
    entry = dataclasses.replace(sinking_engine(1e-4), write=lambda _: {"mine.txt": "new"})
    monkeypatch.setattr("voxgran.decks.relax.engine_registry", lambda: _Registry(entry))
    with pytest.raises(OutputExistsError):
        relax(cases.spheres(), folder=tmp_path)
    assert (tmp_path / "mine.txt").read_text() == "kept"
    relax(cases.spheres(), folder=tmp_path, overwrite=True)
    assert (tmp_path / "mine.txt").read_text() == "new"


def test_a_file_that_is_no_state_of_a_run_is_neither_replaced_nor_removed(monkeypatch, tmp_path):
    state, bed = tmp_path / "state.vtp", cases.spheres()
    vg.save(bed, state)
    before = state.read_bytes()
    with pytest.raises(OutputExistsError):
        relax(bed, checkpoint=state)
    remove_state(state)
    assert state.read_bytes() == before
    test_an_interrupt_leaves_the_last_state(monkeypatch, tmp_path / "run")
    left = tmp_path / "run" / "state.vtp"
    # a state of a run is replaced by the next one, and removed
    test_an_interrupt_leaves_the_last_state(monkeypatch, tmp_path / "run")
    remove_state(left)
    assert not left.exists()
    remove_state(left)


def test_outputs_of_an_engine_are_not_overwritten_unasked(sinking, tmp_path):
    sinking(1e-4)
    (tmp_path / "lammps_spheres.dump").write_text("kept")
    with pytest.raises(OutputExistsError, match=r"lammps_spheres\.dump"):
        relax(cases.spheres(), folder=tmp_path)


def test_a_checkpoint_that_cannot_be_written_is_refused_before_the_run(tmp_path):
    with pytest.raises(FileFormatError, match="suffix"):
        vg.relax(cases.spheres(), checkpoint=tmp_path / "state.xyz")


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"engine": "pfc"}, "voxgran runs 'lammps' only"),
        ({"until": 0.0}, "until"),
        ({"longest": -1.0}, "longest"),
        ({"material": {"law": "hertz"}}, "young_modulus"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(asked, message):
    with pytest.raises(InputError, match=message):
        vg.relax(cases.spheres(), **asked)


def test_gravity_is_needed():
    with pytest.raises(InputError, match="gravity is None"):
        vg.relax(dataclasses.replace(cases.spheres(), gravity=None))


def test_engines_that_run_say_so():
    assert isinstance(engine_registry().get("lammps"), Engine)
    assert engine_registry().get("lammps").run is not None


@pytest.mark.engine
def test_a_bed_at_rest_hardly_sinks_and_a_loose_one_does(lammps):
    box = vg.Box((5, 5, 9), periodic="xy")
    bed = vg.pack(vg.make_shape("sphere"), box, "gravity", count=100, seed=1)
    rested, history = vg.relax(bed)
    assert rested.stop_reason == "count"
    assert abs(history.attrs["sinking"]) < 0.1
    assert history["share_of_rattlers"].values[-1] < 0.05
    loose = cases.falling(vg.pack(vg.make_shape("sphere"), box, "rsa", count=100, seed=1))
    _, fallen = vg.relax(loose)
    assert fallen.attrs["sinking"] > 0.5
    # an elastic collision with the floor costs at most what the fall gave
    assert fallen["kinetic_energy"].max() < 10
    proof = vg.equilibrium(dataclasses.replace(rested, contact_gap=0.0), gap=2e-3)
    assert proof.attrs["share_at_rest"] > 0.9


@pytest.mark.engine
def test_fixed_grains_stay_or_move_with_the_mean_strain(lammps):
    sphere, box = vg.make_shape("sphere"), vg.Box((5, 5, 7))
    bar = vg.Packing.of(vg.shapes.box(lengths=(1.5, 1.5, 5)), box, position=[(2.5, 2.5, 2.5)])
    rested, history = vg.relax(vg.pack(sphere, box, "gravity", count=20, obstacles=bar, seed=4), clump=20)
    assert history.attrs["rests"] == 1
    assert rested.fixed.sum() == 1
    assert rested.position[0] == pytest.approx(bar.position[0], abs=1e-12)
    # the spheres of the bar do not fill its edges
    assert abs(history.attrs["sinking"]) < 0.15
    cell = vg.Box((5, 5, 5), periodic="xyz")
    insert = vg.Packing.of(vg.shapes.sphere(diameter=2.5), cell, position=[(1, 1, 1)])
    specimen = vg.compress(vg.pack(sphere, cell, "rsa", count=40, obstacles=insert), friction=0.3)
    rested, history = vg.relax(specimen, stress=1e5)
    assert history["mean_displacement"].values[-1] < 0.005
    strained = specimen.position[0] * np.array(rested.container.lengths) / np.array(specimen.container.lengths)
    assert rested.position[0] == pytest.approx(strained, abs=1e-9)


@pytest.mark.engine
def test_clumps_of_rocks_come_to_rest(lammps, tmp_path):
    rocks = [vg.make_shape("convex_polyhedron", seed=seed) for seed in range(3)]
    bed = vg.pack(rocks, vg.Box((4, 4, 5), periodic="xy"), "gravity", count=20, seed=1, unit="mm")
    rested, history = vg.relax(bed, clump=6, folder=tmp_path)
    assert history.attrs["rests"] == 1
    assert rested.unit == "mm"
    # spheres that stick out of the true shapes are parted without throwing grains about
    assert abs(history.attrs["sinking"]) < 0.15
    assert history["mean_sinking"].min() > -0.3
    assert vg.verify(rested, tolerance=0.02).ok


@pytest.mark.engine
def test_the_command_line_relaxes(lammps, tmp_path, capsys):
    from voxgran.cli import main

    bed = vg.pack(vg.make_shape("sphere"), vg.Box((4, 4, 6), periodic="xy"), "gravity", count=40, seed=1)
    bed.save(tmp_path / "bed.vtp")
    words = ["relax", str(tmp_path / "bed.vtp"), "-o", str(tmp_path / "rested.vtp"), "--json"]
    assert main([*words, "--history", str(tmp_path / "rested.nc")]) == 0
    assert '"rests": true' in capsys.readouterr().out
    assert (tmp_path / "rested.nc").is_file()
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err
