"""Input for PFC: command files, read back by the grammar of its documentation."""

import dataclasses
import math
import re

import numpy as np
import pytest
from engine_cases import assert_holds, falling, mixed, rocks, sand_and_steel, spheres, two_spheres

import voxgran as vg
from voxgran._base.errors import FileFormatError, InputError
from voxgran.decks.engines import pfc
from voxgran.decks.pfc_reader import statements

HERTZ = {"law": "hertz", "young_modulus": 1e8, "restitution": 0.6}


def deck(folder, packing, **asked):
    """Write a deck and return it with what its files hold."""
    made = vg.write_deck(packing, folder, "pfc", **asked)
    return made, pfc.registration.read(folder)


def given(folder, command):
    """Return the arguments of all statements of a command."""
    return [one.given for one in statements(folder, pfc.RUN) if one.command == command]


@pytest.mark.parametrize(
    "packing",
    [spheres(), mixed(), mixed(periodic=True), mixed(unit=None), rocks(), mixed(container=vg.Cylinder(3, 7))],
    ids=["spheres", "clumps", "periodic", "no unit", "rocks", "cylinder"],
)
def test_files_hold_the_simulation(tmp_path, packing):
    made, held = deck(tmp_path, packing)
    assert_holds(held, made.simulation)


def test_convex_rocks_are_rigid_blocks_and_others_clumps(tmp_path):
    made, _ = deck(tmp_path, rocks(8))
    kinds = {one.name: one.kind for one in made.simulation.bodies.templates}
    assert sorted(kinds.values()) == ["clump", "polyhedron"]
    assert len(given(tmp_path, "rblock create")) == len(made.simulation.bodies.of_kind("polyhedron"))
    assert len(given(tmp_path, "clump replicate")) == len(made.simulation.bodies.of_kind("clump"))
    assert "intersection over union" in (tmp_path / pfc.RUN).read_text()


def test_blocks_in_place_of_smooth_grains_have_the_true_mass_and_name_the_error_of_the_inertia(tmp_path):
    shape = vg.make_shape("ellipsoid", semi_axes=(0.5, 0.4, 0.3))
    packing = falling(vg.pack(shape, vg.Box((4, 4, 5)), "rsa", count=3, seed=1, unit="mm"))
    assert deck(tmp_path / "usual", packing)[0].simulation.bodies.kinds == {"clump"}
    made, held = deck(tmp_path, packing, grains="polyhedron")
    bodies = made.simulation.bodies
    assert bodies.kinds == {"polyhedron"}
    np.testing.assert_allclose(held.mass, bodies.mass, rtol=1e-12)
    np.testing.assert_allclose(held.position, bodies.assembly.position, atol=1e-9 * made.simulation.diameter)
    error = np.linalg.norm(held.inertia - bodies.inertia, axis=(1, 2)) / np.linalg.norm(bodies.inertia, axis=(1, 2))
    stated = float(re.search(r"off by ([\d.e-]+) of the true one", (tmp_path / pfc.RUN).read_text())[1])
    assert error.max() == pytest.approx(stated, rel=0.1)
    assert 0 < error.max() < 0.02


def test_templates_are_at_unit_density_in_their_principal_frame(tmp_path):
    made, _ = deck(tmp_path, mixed())
    template = next(one for one in made.simulation.bodies.templates if one.kind == "clump")
    (held,) = given(tmp_path, "clump template create")
    assert held["name"] == [template.name]
    assert held["volume"] == [pytest.approx(template.shape.volume)]
    np.testing.assert_allclose(held["inertia"], [*template.principal.moments, 0, 0, 0])
    assert np.array(held["pebbles"]).reshape(-1, 4).shape == (3, 4)


def test_the_size_of_a_clump_is_that_of_the_sphere_of_its_volume(tmp_path):
    made, _ = deck(tmp_path, mixed())
    bodies = made.simulation.bodies
    mine = bodies.of_kind("clump")
    diameters = [one["diameter"][0] for one in given(tmp_path, "clump replicate")]
    np.testing.assert_allclose(diameters, np.cbrt(6 * bodies.mass[mine] / bodies.assembly.density / math.pi))
    assert all(set(one) == {"id", "name", "position", "axis", "angle", "diameter", "density"}
               for one in given(tmp_path, "clump replicate"))  # fmt: skip


def test_files_begin_with_the_header(tmp_path):
    made, _ = deck(tmp_path, mixed())
    first = made.simulation.header("PFC")[0]
    assert {path.name for path in made.files} == {pfc.RUN, pfc.GRAINS, pfc.WALLS, pfc.TEMPLATES}
    for path in made.files:
        assert path.read_text().startswith(f"; {first}\n")


def test_contact_laws(tmp_path):
    made, _ = deck(tmp_path / "linear", mixed(), material={"restitution": 0.4, "friction": 0.3})
    (linear,) = given(tmp_path / "linear", "contact cmat default")
    law = made.simulation.law
    assert linear["model"] == ["linear"]
    assert (linear["kn"], linear["ks"], linear["fric"]) == ([law.stiffness], [law.shear_stiffness], [0.3])
    ratio = linear["dp_nratio"][0]
    assert math.exp(-math.pi * ratio / math.sqrt(1 - ratio**2)) == pytest.approx(0.4)
    deck(tmp_path / "hertz", mixed(), material=HERTZ)
    (hertz,) = given(tmp_path / "hertz", "contact cmat default")
    assert hertz["model"] == ["hysteretic"]
    assert (hertz["hz_shear"], hertz["hz_poiss"], hertz["dp_en"]) == ([1e8 / 2.5], [0.25], [0.6])


def test_walls_of_a_box_lie_within_the_domain(tmp_path):
    made, _ = deck(tmp_path, mixed())
    walls = given(tmp_path, "wall create")
    assert [wall["name"][0] for wall in walls] == [plane.name for plane in made.simulation.walls.planes]
    extent, condition = given(tmp_path, "model domain")
    low, high = np.array(extent["extent"]).reshape(3, 2).T
    for wall, plane in zip(walls, made.simulation.walls.planes, strict=True):
        corners = np.array(wall["vertices"]).reshape(-1, 3)
        np.testing.assert_allclose(corners[:, plane.axis], plane.level)
        assert (corners > low).all()
        assert (corners < high).all()
    assert condition["condition"] == ["stop"] * 3


def test_periodic_axes_are_those_of_the_domain_and_grains_lie_within(tmp_path):
    made, held = deck(tmp_path, mixed(periodic=True))
    extent, condition = given(tmp_path, "model domain")
    bounds = made.simulation.walls.bounds
    np.testing.assert_array_equal(np.array(extent["extent"]).reshape(3, 2).T, bounds)
    assert condition["condition"] == ["periodic"] * 3
    assert not given(tmp_path, "wall create")
    assert ((held.position >= bounds[0]) & (held.position <= bounds[1])).all()


def test_round_walls_touch_the_true_wall_from_outside(tmp_path):
    made, _ = deck(tmp_path, mixed(container=vg.Cylinder(3, 7)))
    wall = given(tmp_path, "wall create")[-1]
    corners = np.array(wall["vertices"]).reshape(-1, 3, 3) - made.simulation.walls.round.center
    middles = np.linalg.norm(corners[:, :, :2].mean(axis=1), axis=1)
    assert np.linalg.norm(corners[..., :2], axis=2).min() > 3e-3
    assert middles.min() >= 3e-3 * (1 - 1e-12)


def test_gravity_time_and_rest(tmp_path):
    made, _ = deck(tmp_path / "settling", mixed())
    simulation = made.simulation
    assert given(tmp_path / "settling", "model gravity")[0][""] == [0, 0, -9.81]
    assert given(tmp_path / "settling", "model mechanical timestep")[0]["fix"] == [simulation.time_step]
    assert given(tmp_path / "settling", "model cycle")[0][""] == [simulation.steps_per_output]
    text = (tmp_path / "settling" / pfc.RUN).read_text()
    assert f"if kinetic_energy < {simulation.rest_energy!r} then" in text
    assert "ball.energy('energy-kinetic')" in text
    assert "clump.energy('energy-kinetic')" in text
    deck(tmp_path / "free", two_spheres())
    assert "if kinetic_energy" not in (tmp_path / "free" / pfc.RUN).read_text()


def test_refusals(tmp_path):
    with pytest.raises(InputError, match="radius of curvature"):
        vg.write_deck(rocks(), tmp_path, "pfc", material=HERTZ)
    tight = falling(vg.pack(vg.make_shape("sphere"), vg.Box((1.8, 4, 4), periodic=True), "rsa", count=1, unit="mm"))
    with pytest.raises(InputError, match="below a quarter"):
        vg.write_deck(tight, tmp_path, "pfc")
    with pytest.raises(InputError, match="cohesion"):
        vg.write_deck(mixed(), tmp_path, "pfc", material=HERTZ | {"cohesion": 0.1})


@pytest.mark.parametrize(
    ("file", "line", "message"),
    [
        (pfc.RUN, "model explode 1", "no such command"),
        (pfc.RUN, "model gravity 0 0", "as '' of 'model gravity'"),
        (pfc.RUN, "model domain extents 0 1 0 1 0 1", "does not take it"),
        (pfc.GRAINS, "ball create id 1 radius big position 0 0 0", "as 'radius'"),
        (pfc.GRAINS, "ball create id 1 radius 1 radius 1", "does not take it"),
        (pfc.GRAINS, "clump replicate id 99 name 'none' position 0 0 0 diameter 1 density 1", "no template 'none'"),
        (pfc.RUN, "fish define more", "ends before 'end'"),
        (pfc.RUN, "fish define more\n  while (1)\nend", "no such statement"),
    ],
)
def test_the_reader_refuses_what_the_documentation_does_not_have(tmp_path, file, line, message):
    deck(tmp_path, mixed())
    path = tmp_path / file
    path.write_text(f"{path.read_text()}{line}\n")
    with pytest.raises(FileFormatError, match=re.escape(message)):
        pfc.registration.read(tmp_path)


def test_contacts_of_two_materials_have_the_law_of_their_pair(tmp_path):
    made, _ = deck(tmp_path, mixed(), material=sand_and_steel())
    laws = {tuple(one["range"]): one for one in given(tmp_path, "contact cmat add")}
    first, second = "material_1", "material_2"
    told = {key: (one["model"][0], one["fric"][0], one["kn"][0]) for key, one in laws.items()}
    assert told == {
        ("group", first, "matches", "2"): ("linear", 0.6, pytest.approx(1e3)),
        ("group", first, "group", second): ("rrlinear", 0.15, pytest.approx(1.5e3)),
        ("group", second, "matches", "2"): ("linear", 0.3, pytest.approx(3e3)),
    }
    assert laws["group", first, "group", second]["rr_fric"] == [0.05]
    members = {first: set(), second: set()}
    for kind in ("ball", "clump"):
        for one in given(tmp_path, f"{kind} group"):
            low, high = map(int, one["range"][1:])
            members[one[""][0]] |= set(range(low, high + 1))
    shapes = made.simulation.bodies.assembly.shape_id
    assert members == {first: set((np.flatnonzero(shapes == 0) + 1).tolist()),
                       second: set((np.flatnonzero(shapes == 1) + 1).tolist())}  # fmt: skip
    walls = {wall["id"][0]: wall["name"][0] for wall in given(tmp_path, "wall create")}
    told = {walls[int(one["range"][1])]: one[""][0] for one in given(tmp_path, "wall group")}
    assert told == {name: second if name == "z_low" else first for name in walls.values()}


def test_fixed_grains_keep_their_velocity_of_zero(tmp_path):
    packing = dataclasses.replace(mixed(8), fixed=np.array([1, 1, 0, 0, 0, 1, 0, 1], dtype=bool))
    deck(tmp_path, packing)
    found = [(kind, list(map(int, one["range"][1:])))
             for kind in ("ball", "clump") for one in given(tmp_path, f"{kind} fix")]  # fmt: skip
    fixed = {(kind, number) for kind, (low, high) in found for number in range(low, high + 1)}
    names = {0: "ball", 1: "clump"}
    assert fixed == {(names[int(packing.shape_id[k])], int(k) + 1) for k in np.flatnonzero(packing.fixed)}


def test_walls_that_keep_a_stress_have_servos(tmp_path):
    packing = dataclasses.replace(mixed(), gravity=None)
    made, _ = deck(tmp_path, packing, stress=(float("nan"), 2e3, 5e3))
    servos = given(tmp_path, "wall servo")
    walls = {wall["id"][0]: wall for wall in given(tmp_path, "wall create")}
    for servo, axis, platen in zip(servos, "yz", made.simulation.platens, strict=True):
        wall = walls[int(servo["range"][1])]
        assert wall["name"] == [f"{axis}_high"]
        # the target points to the grains
        assert servo[f"force-{axis}"] == [-platen.force]
        assert servo["velocity-max"] == [platen.speed]
        # it reaches beyond the other walls, which move too
        bounds = made.simulation.walls.bounds
        corners = np.array(wall["vertices"]).reshape(-1, 3)
        across = [k for k in range(3) if "xyz"[k] != axis]
        assert (corners[:, across].min(axis=0) < bounds[0, across]).all()
        assert (corners[:, across].max(axis=0) > bounds[1, across]).all()
    assert given(tmp_path, "ball attribute")[-1]["damp"] == [0.2]
    text = (tmp_path / pfc.RUN).read_text()
    assert "wall.force.contact(wall.find('y_high'), 2)" in text
    assert "if missed_stress < 0.02 then" in text
