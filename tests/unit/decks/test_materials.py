"""Several materials in the input of engines: tables of pairs, walls, rolling friction, and what is refused."""

import ast
import json
import math
import re
import subprocess

import engine_cases as cases
import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.decks.engine import engine_registry
from voxgran.decks.engines.kratos import MATERIALS
from voxgran.settling.materials import friction_of
from voxgran.shapes.spheres import Spheres

NAMES = engine_registry().names()
SEVERAL = tuple(name for name in NAMES if engine_registry().get(name).materials)


def table(**options):
    """Return two materials with all that pairs may have."""
    materials = {
        "sand": {"friction": 0.6, "restitution": 0.2, "stiffness": 1e3, "density": 2600.0},
        "steel": {"friction": 0.3, "restitution": 0.8, "stiffness": 3e3, "density": 7800.0},
    }
    pairs = {("sand", "steel"): {"friction": 0.15}}
    walls = {"z_low": "steel", "others": "sand"}
    return vg.Materials(materials, **{"pairs": pairs, "shapes": ["sand", "steel"], "walls": walls, **options})


def deck(tmp_path, engine, material, packing=None):
    made = vg.write_deck(packing or cases.mixed(), tmp_path, engine, material=material)
    return made, "\n".join(path.read_text() for path in made.files)


@pytest.mark.parametrize("engine", SEVERAL)
def test_grains_of_several_materials_have_their_masses(engine, tmp_path):
    made, _ = deck(tmp_path, engine, table(walls="steel"), cases.mixed(periodic=False))
    held = engine_registry().get(engine).read(tmp_path)
    packing = made.packing
    own = np.array([2600.0, 7800.0])[packing.shape_id]
    np.testing.assert_allclose(held.mass, 1e-9 * packing.volumes * own, rtol=1e-6)
    # the shortest step of all pairs: two of the lightest grains, with the stiffest springs
    shortest = math.pi * math.sqrt(made.simulation.bodies.mass.min() / 2 / 3e3) / 50
    assert made.simulation.law.stable_step == pytest.approx(shortest)


@pytest.mark.parametrize("engine", SEVERAL)
def test_a_table_of_one_material_is_that_material(engine, tmp_path):
    alone = {"friction": 0.3, "restitution": 0.6, "stiffness": 2e3}
    _, one = deck(tmp_path / "one", engine, alone)
    _, other = deck(tmp_path / "other", engine, vg.Materials({"sand": alone}))
    assert one == other


def test_pairs_and_walls_of_lammps(tmp_path):
    _, text = deck(tmp_path, "lammps", table())
    pairs = dict(re.findall(r"pair_coeff (\S+ \S+) hooke (.*)", text))
    shown = {key: [float(word) for word in words.split() if word[0].isdigit()] for key, words in pairs.items()}
    # stiffness, restitution, shear stiffness, its damping, friction
    shear = 2 / 7
    assert shown["1*2 1*2"] == pytest.approx([1e3, 0.2, shear * 1e3, 1, 0.6])
    assert shown["1*2 3*4"] == pytest.approx([1.5e3, 0.4, shear * 1.5e3, 1, 0.15])
    assert shown["3*4 3*4"] == pytest.approx([3e3, 0.8, shear * 3e3, 1, 0.3])
    walls = dict(
        re.findall(r"fix (\w+) material_\d wall/gran granular hooke \S+ \S+ tangential \S+ \S+ 1.0 (\S+)", text)
    )
    assert {name: float(value) for name, value in walls.items() if name[0] == "z"} == {
        "z_low_1": 0.15, "z_low_2": 0.3, "z_high_1": 0.6, "z_high_2": 0.15,
    }  # fmt: skip
    assert "4 atom types" in text
    assert "group clumps type 2 4" in text
    assert "materials: 1 sand, 2 steel" in text


def test_the_properties_of_pairs_of_liggghts_are_matrices(tmp_path):
    _, text = deck(tmp_path, "liggghts", table())
    found = dict(re.findall(r"property/global (\w+) peratomtypepair 2 (.*)", text))
    assert [float(word) for word in found["coefficientFriction"].split()] == [0.6, 0.15, 0.15, 0.3]
    assert [float(word) for word in found["coefficientRestitution"].split()] == pytest.approx([0.2, 0.4, 0.4, 0.8])
    assert [float(word) for word in found["LoadingStiffness"].split()] == pytest.approx([1e3, 1.5e3, 1.5e3, 3e3])
    assert "primitive type 2 zplane 0.0" in text
    assert "primitive type 1 xplane 0.0" in text
    assert set(re.findall(r"atom_type (\d)", text)) == {"2"}
    assert "group spheres type 1 2" in text


def test_rolling_friction_of_pfc_needs_a_radius(tmp_path):
    _, text = deck(tmp_path, "pfc", {"rolling_friction": 0.1, "stiffness": 1e3})
    assert "contact cmat default model rrlinear property kn 1000.0" in text
    with pytest.raises(InputError, match="no radius of curvature"):
        deck(tmp_path / "new", "pfc", {"rolling_friction": 0.1}, cases.falling(rock()))


def rock():
    """Return a convex polyhedron, which PFC has as a rigid block."""
    shape = vg.make_shape("convex_polyhedron", seed=1)
    return vg.Packing.of(shape, vg.Box((4, 4, 5)), position=[(2, 2, 2)], unit="mm")


def test_moduli_of_liggghts_are_those_of_materials(tmp_path):
    own = {"law": "hertz", "young_modulus": 1e7}
    materials = vg.Materials(
        {"sand": own, "steel": {**own, "young_modulus": 1e8, "poisson_ratio": 0.3}},
        shapes=["sand", "steel"],
        walls="steel",
    )
    _, text = deck(tmp_path, "liggghts", materials)
    assert "youngsModulus peratomtype 10000000.0 100000000.0" in text
    assert "poissonsRatio peratomtype 0.25 0.3" in text


def test_the_relations_of_kratos_are_those_of_pairs(tmp_path):
    deck(tmp_path, "kratos", table(walls="steel"))
    found = json.loads((tmp_path / MATERIALS).read_text())
    told = {tuple(one["material_names_list"]): one["Variables"] for one in found["material_relations"]}
    clump = next(name for pair in told for name in pair if name not in ("spheres", "walls"))
    friction = {pair: values["STATIC_FRICTION"] for pair, values in told.items()}
    assert friction == {
        ("spheres", "spheres"): 0.6, ("spheres", clump): 0.15, ("spheres", "walls"): 0.15, (clump, clump): 0.3,
        (clump, "walls"): 0.3,
    }  # fmt: skip
    stiffness = [told["spheres", "spheres"]["K_NORMAL"], told["spheres", clump]["K_NORMAL"]]
    assert stiffness == pytest.approx([1e3, 1.5e3])
    assert told["spheres", clump]["COEFFICIENT_OF_RESTITUTION"] == pytest.approx(0.4)


def test_the_match_makers_of_yade_hold_the_numbers_of_pairs(tmp_path):
    made, text = deck(tmp_path, "yade", table())
    found = {
        name: {(i, j): value for i, j, value in ast.literal_eval(rows)}
        for name, rows in re.findall(r"(\w+)=MatchMaker\(matches=(\[.*?\])\)", text)
    }
    labels = re.findall(r'label="(\w+)"', text)
    assert labels == ["grains0", "members0", "walls0", "grains1", "members1", "walls1"]
    # ids are the places of the labels: a grain of sand on a wall of steel, and a member of steel on a wall of sand
    for i, j, friction, stiffness in ((0, 5, 0.15, 1.5e3), (2, 4, 0.15, 1.5e3), (0, 1, 0.6, 1e3), (3, 5, 0.3, 3e3)):
        assert math.tan(found["frictAngle"][i, j]) == pytest.approx(friction)
        assert found["kn"][i, j] == pytest.approx(stiffness)
        assert found["kRatio"][i, j] == pytest.approx(2 / 7)
    assert len(found["kn"]) == 21
    planes = ast.literal_eval(re.search(r"PLANES = (.*)", text)[1])
    assert {(axis, inward): kind for _, axis, inward, kind in planes} == {
        (0, 1): 0, (0, -1): 0, (1, 1): 0, (1, -1): 0, (2, 1): 1, (2, -1): 0,
    }  # fmt: skip
    names = [template.name for template in made.simulation.bodies.templates]
    assert ast.literal_eval(re.search(r"MATERIALS = (.*)", text)[1]) == dict(zip(names, (0, 1), strict=True))
    assert "the damping of a pair is the mean share" in text


def test_spheres_of_two_materials_are_two_materials_of_kratos(tmp_path):
    one = cases.spheres()
    shapes = [vg.shapes.sphere(), vg.shapes.sphere()]
    packing = vg.Packing.of(
        shapes, one.container, position=one.position, scale=one.scale, shape_id=np.arange(one.count) % 2, unit="mm"
    )
    same = {"materials": {"sand": {"friction": 0.6}, "steel": {"friction": 0.3}}, "pairs": None}
    deck(tmp_path, "kratos", vg.Materials(**same, shapes=["sand", "steel"], walls="steel"), packing)
    found = json.loads((tmp_path / MATERIALS).read_text())
    told = {tuple(pair["material_names_list"]): pair["Variables"] for pair in found["material_relations"]}
    assert {pair: values["STATIC_FRICTION"] for pair, values in told.items() if "walls" not in pair} == {
        ("spheres", "spheres"): 0.6, ("spheres", "spheres_2"): 0.3, ("spheres_2", "spheres_2"): 0.3,
    }  # fmt: skip
    deck(tmp_path / "walls", "kratos", table(shapes=["sand", "sand"]), packing)
    found = json.loads((tmp_path / "walls" / MATERIALS).read_text())
    told = {tuple(pair["material_names_list"]): pair["Variables"] for pair in found["material_relations"]}
    friction = {pair[1]: values["STATIC_FRICTION"] for pair, values in told.items()}
    assert friction == {"spheres": 0.6, "walls": 0.6, "walls_2": 0.15}
    assigned = dict(found["material_assignation_table"])
    assert {assigned[f"RigidFacePart.{wall}"] for wall in ("x_low", "z_high")} == {"walls"}
    assert assigned["RigidFacePart.z_low"] == "walls_2"


@pytest.mark.parametrize(
    ("materials", "said"),
    [
        (table(walls="sand", shapes=["sand"]), "2 shapes"),
        (table(walls=None), r"says nothing of the wall 'x_low'.* in a scene as material of \[container\]"),
        (vg.Materials({"sand": {"bond_strength": 1e6}}), "bonds are of one"),
    ],
)
def test_tables_that_do_not_fit_are_refused(materials, said, tmp_path):
    with pytest.raises(InputError, match=said):
        vg.write_deck(cases.mixed(), tmp_path, "lammps", material=materials)


def test_densities_that_the_packing_has_by_shape_hold(tmp_path):
    loose = cases.mixed()
    packing = vg.Packing.of(
        loose.shapes, loose.container, position=loose.position, scale=loose.scale, shape_id=loose.shape_id,
        orientation=loose.orientation, density=(2000.0, 3000.0), unit="mm",
    )  # fmt: skip
    made, _ = deck(tmp_path, "lammps", table(), packing)
    np.testing.assert_allclose(made.simulation.bodies.densities, (2000.0, 3000.0))


def frames_of(packing, tmp_path, material, many=5):
    """Return the first states of a run of LAMMPS."""
    made = vg.write_deck(packing, tmp_path, "lammps", material=material)
    states = engine_registry().get("lammps").run(tmp_path, made.simulation)
    found = [next(states) for _ in range(many + 1)]
    states.close()
    return found


@pytest.fixture
def lammps(monkeypatch):
    monkeypatch.setenv("VOXGRAN_LAMMPS", cases.program("lmp", "make test-engines"))


@pytest.mark.engine
def test_clumps_on_an_incline_of_lammps_slide_by_the_friction_of_their_pair(lammps, tmp_path):
    """They stand on three spheres; where the slope is steeper than the friction, g (sin a - mu cos a) is left."""
    angle, slope = 2 * np.pi * np.arange(3) / 3, math.radians(20)
    clump = vg.Shape.of(
        Spheres(0.7 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]), [0.65] * 3), name="tripod"
    )
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
    found = frames_of(packing, tmp_path, materials)
    moved = found[-1].position[:, 0] - found[0].position[:, 0]
    expected = 0.5 * 9.81 * (math.sin(slope) - 0.2 * math.cos(slope)) * found[-1].time ** 2
    assert moved[1] == pytest.approx(expected, rel=0.03)
    assert abs(moved[0]) < 0.01 * moved[1]


@pytest.mark.engine
@pytest.mark.parametrize(("engine", "script"), [("kratos", "kratos_run.py"), slow("yade", "yade_run.py")])
@pytest.mark.parametrize("rolling", [0.05, slow(0.3)])
def test_spheres_on_an_incline_roll_by_the_rolling_friction_of_the_floor(engine, script, rolling, tmp_path):
    """A sphere on a slope rolls with 5/7 g sin a less 5/7 of the rolling friction, or stays."""
    slope = math.radians(10)
    packing = vg.Packing.of(
        vg.shapes.sphere(), vg.Box((40, 6, 4)), position=[(5, 3, 0.5)], unit="mm",
        gravity=(math.sin(slope), 0, -math.cos(slope)),
    )  # fmt: skip
    own = {"friction": 0.9, "rolling_friction": rolling, "law": "hertz", "young_modulus": 1e6}
    # the friction of the other walls does not matter
    materials = vg.Materials(
        {"grains": own, "floor": own, "sides": {**own, "friction": 0.1}},
        shapes="grains", walls={"z_low": "floor", "others": "sides"},
    )  # fmt: skip
    made, _ = deck(tmp_path, engine, materials, packing)
    every, steps = made.simulation.steps_per_output, made.simulation.steps
    path = tmp_path / script
    path.write_text(path.read_text().replace(str(steps), str(5 * every), 1))
    program = cases.python_of_kratos() if engine == "kratos" else cases.program(engine, "make test-engines")
    command = [program, script] if engine == "kratos" else [program, "-n", "-x", script]
    subprocess.run(command, cwd=tmp_path, capture_output=True, timeout=200, check=True)
    if engine == "kratos":
        ends = [np.loadtxt(one)[1] for one in (lambda files: (files[0], files[-1]))(sorted(tmp_path.glob("*state*")))]
    else:
        lines = (tmp_path / "yade_poses.txt").read_text().splitlines()
        ends = [float(lines[k].split()[0]) for k in (1, -1)]
    time = 5 * every * made.simulation.time_step
    expected = max(0.0, 0.5 * 5 / 7 * 9.81 * (math.sin(slope) - rolling * math.cos(slope)) * time**2)
    assert ends[1] - ends[0] == pytest.approx(expected, rel=0.05, abs=2e-2 * made.simulation.diameter)


@pytest.mark.engine
@pytest.mark.parametrize("law", [{}, {"law": "hertz", "young_modulus": 1e7}])
def test_spheres_on_an_incline_of_lammps_roll_by_the_rolling_friction_of_their_pair(lammps, law, tmp_path):
    """A sphere on a slope rolls with 5/7 g sin a less 5/7 of the rolling friction, or stays."""
    slope = math.radians(10)
    packing = vg.Packing.of(
        [vg.shapes.sphere(), vg.shapes.sphere()], vg.Box((40, 6, 4)), shape_id=[0, 1],
        position=[(5, 3, 0.5), (20, 3, 0.5)], unit="mm", gravity=(math.sin(slope), 0, -math.cos(slope)),
    )  # fmt: skip
    own = {"friction": 0.9, "rolling_friction": 0.5, **law}
    materials = vg.Materials(
        {"rough": own, "smooth": {**own, "rolling_friction": 0.05}, "floor": own},
        shapes=["rough", "smooth"],
        walls="floor",
    )
    found = frames_of(packing, tmp_path, materials)
    moved = found[-1].position[:, 0] - found[0].position[:, 0]
    expected = 0.5 * 5 / 7 * 9.81 * (math.sin(slope) - 0.05 * math.cos(slope)) * found[-1].time ** 2
    assert moved[1] == pytest.approx(expected, rel=0.03)
    assert abs(moved[0]) < 0.02 * moved[1]


@pytest.mark.engine
def test_spheres_on_an_incline_of_yade_roll_by_the_rolling_friction_of_their_pair(tmp_path):
    slope = math.radians(10)
    packing = vg.Packing.of(
        [vg.shapes.sphere()] * 3, vg.Box((40, 6, 4)), shape_id=[0, 1, 2],
        position=[(5, 3, 0.5), (16, 3, 0.5), (25, 3, 0.5)], unit="mm", gravity=(math.sin(slope), 0, -math.cos(slope)),
    )  # fmt: skip
    own = {"friction": 0.9, "rolling_friction": 0.5, "law": "hertz", "young_modulus": 1e7}
    materials = vg.Materials(
        {name: {**own, "rolling_friction": value}
         for name, value in (("rough", 0.5), ("smooth", 0.05), ("round", 0.0), ("floor", 0.5))},
        pairs={("smooth", "floor"): {"rolling_friction": 0.05}, ("round", "floor"): {"rolling_friction": 0.0}},
        shapes=["rough", "smooth", "round"],
        walls="floor",
    )  # fmt: skip
    made, text = deck(tmp_path, "yade", materials, packing)
    assert "approximated: rolling" not in text
    every, steps = made.simulation.steps_per_output, made.simulation.steps
    path = tmp_path / "yade_run.py"
    path.write_text(path.read_text().replace(str(steps), str(5 * every), 1))
    program = cases.program("yade", "make test-engines")
    subprocess.run([program, "-n", "-x", path.name], cwd=tmp_path, capture_output=True, timeout=200, check=True)
    places = [line.split()[0] for line in (tmp_path / "yade_poses.txt").read_text().splitlines()]
    moved = np.array(places[-3:], dtype=float) - np.array(places[1:4], dtype=float)
    time = 5 * every * made.simulation.time_step
    expected = 0.5 * 5 / 7 * 9.81 * (math.sin(slope) - np.array([0.05, 0.0]) * math.cos(slope)) * time**2
    assert moved[1:] == pytest.approx(expected, rel=0.05)
    assert abs(moved[0]) < 0.02 * moved[1]


def equipment(oblique=0.0):
    """Return spheres within a cone, a cylinder and two planes, and a material of each wall."""
    wall = [
        {"kind": "cone", "point": (0, 0, 0), "radius": 1.5, "angle": 60.0},
        {"kind": "cylinder", "radius": 3.0, "axis": (oblique, 0, 1)},
        {"kind": "plane", "point": (0, 0, 0), "normal": (0, 0, -1)},
        {"kind": "plane", "point": (0, 0, 5), "normal": (0, 0, 1)},
    ]
    places = [(0, 0, 2), (1.2, 0, 2), (0, 1.2, 2)]
    packing = vg.Packing.of(vg.shapes.sphere(), vg.Walls(wall), position=places, unit="mm")
    frictions = {"sand": 0.6, "cone": 0.1, "tube": 0.2, "floor": 0.3}
    materials = vg.Materials(
        {name: {"friction": value} for name, value in frictions.items()},
        shapes="sand",
        walls={"round_1": "cone", "round_2": "tube", "z_low": "floor", "others": "sand"},
    )
    return packing, materials


@pytest.mark.parametrize("engine", sorted(set(SEVERAL)))
def test_each_wall_of_equipment_has_its_own_law(engine, tmp_path):
    packing, materials = equipment()
    made, _ = deck(tmp_path, engine, materials, packing)
    laws, walls = made.simulation.laws, made.simulation.walls
    assert laws.of_walls == {"z_low": 3, "z_high": 0, "round_1": 1, "round_2": 2}
    assert laws.laws[0][laws.of_walls["round_1"]].friction == 0.1
    # all triangles of the closed surface, each of the wall that it touches
    assert sum(len(faces) for _, faces in walls.surfaces.values()) == len(walls.mesh[1])
    for name, (vertices, faces) in walls.surfaces.items():
        middles = vertices[faces].mean(axis=1)
        assert np.abs(walls.others[name].distance(middles)).max() < 1e-2 * made.simulation.diameter
        assert np.abs(walls.others[name].distance(vertices[np.unique(faces)])).max() < 0.1 * made.simulation.diameter


def test_the_walls_of_equipment_are_regions_and_meshes_of_their_own(tmp_path):
    packing, materials = equipment()
    _, text = deck(tmp_path / "lammps", "lammps", materials, packing)
    found = dict(re.findall(r"fix (\w+)_1 material_1 wall/gran/region granular .* 1.0 (\S+) damping", text))
    assert {name: float(value) for name, value in found.items()} == {
        "z_low": 0.3, "z_high": 0.6, "round_1": 0.1, "round_2": 0.2,
    }  # fmt: skip
    assert "region round_1 cone z" in text
    _, text = deck(tmp_path / "liggghts", "liggghts", materials, packing)
    kinds = dict(re.findall(r"fix (\w+) all mesh/surface file \S+ type (\d)", text))
    assert kinds == {"z_low": "4", "z_high": "1", "round_1": "2", "round_2": "3"}
    assert "n_meshes 4 meshes round_1 round_2 z_low z_high" in text
    # LAMMPS has planes in place of walls about an oblique axis, one region for each wall
    _, text = deck(tmp_path / "oblique", "lammps", materials, equipment(oblique=0.2)[0])
    assert re.search(r"region round_2 intersect \d+ round_2_0 round_2_1", text)
    assert "region z_low plane" in text


def test_walls_of_revolution_have_one_material_by_their_common_name():
    packing, materials = equipment()
    named = vg.Materials(materials.materials, shapes="sand", walls={"round": "tube", "others": "floor"})
    assert [named.of_wall(name) for name in ("round", "round_1", "z_low")] == ["tube", "tube", "floor"]
    # those of settling too
    table = friction_of(materials, packing)
    assert (table.least, table.largest) == (0.1, 0.6)
