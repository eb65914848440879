"""Tables of materials: mixing rules, and rest by the friction of each pair and each wall against closed formulas."""

import dataclasses
import math

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError
from voxgran.settling.materials import FrictionTable, Materials, friction_of, mean_friction


def table(friction, **options):
    """Return materials by their frictions."""
    return Materials({name: {"friction": value} for name, value in friction.items()}, **options)


def test_pairs_follow_the_mixing_rules():
    steel = vg.Material(law="hertz", young_modulus=2e11, poisson_ratio=0.3, friction=0.3, restitution=0.9, cohesion=4.0)
    rubber = vg.Material(law="hertz", young_modulus=1e7, poisson_ratio=0.5, friction=0.9, restitution=0.4, cohesion=1.0)
    found = Materials({"steel": steel, "rubber": rubber}, shapes="steel").between("rubber", "steel")
    assert (found.friction, found.restitution, found.cohesion) == (0.3, pytest.approx(0.6), pytest.approx(2.0))
    # the effective modulus of two elastic solids (Hertz)
    both = 1 / ((1 - 0.3**2) / 2e11 + (1 - 0.5**2) / 1e7)
    assert found.young_modulus / (2 * (1 - found.poisson_ratio**2)) == pytest.approx(both)
    soft, hard = ({"stiffness": value, "rolling_friction": value / 1e4} for value in (1e3, 3e3))
    linear = Materials({"soft": soft, "hard": hard, "any": {}}, shapes="soft")
    assert linear.between("soft", "hard").stiffness == pytest.approx(1.5e3)
    assert linear.between("hard", "any").stiffness == linear.between("any", "hard").stiffness == 3e3
    assert linear.between("soft", "hard").rolling_friction == 0.1
    assert linear.between("hard", "hard") == vg.Material(**hard)


def test_a_pair_is_the_same_from_both_sides_and_a_material_has_one_with_itself():
    pairs = {("b", "a"): {"friction": 0.7}, "a": {"a": {"friction": 0.05, "restitution": 0.8}}}
    found = table({"a": 0.1, "b": 0.2}, pairs=pairs, shapes="a")
    assert found.between("a", "b").friction == found.between("b", "a").friction == 0.7
    assert (found.between("a", "a").friction, found.between("a", "a").restitution) == (0.05, 0.8)
    assert found.between("b", "b").friction == 0.2


@pytest.mark.parametrize("rough", [True, False])
def test_a_cube_on_an_incline_rests_by_the_friction_of_its_own_pair_with_the_floor(rough):
    """It slides where the slope is steeper than the friction: tan(20 degrees) is 0.364."""
    slope = math.radians(20)
    cubes = [vg.make_shape("box", lengths=(1, 1, 1)) for _ in range(2)]
    bed = vg.Packing.of(
        cubes, vg.Box((12, 4, 3)), shape_id=[0, 1], position=[(2, 2, 0.5), (8, 2, 0.5)],
        gravity=(math.sin(slope), 0, -math.cos(slope)),
    )  # fmt: skip
    pairs = {("wood", "floor"): {"friction": 0.37 if rough else 0.35}, ("ice", "floor"): {"friction": 0.1}}
    materials = table({"wood": 0.9, "ice": 0.9, "floor": 0.9}, pairs=pairs, shapes=["wood", "ice"], walls="floor")
    found = vg.equilibrium(bed, materials)
    assert found.rests.values.tolist() == [rough, False]
    # what is left of the weight along the slope
    assert float(found.residual[1]) == pytest.approx(math.sin(slope) - 0.1 * math.cos(slope), abs=2e-3)
    assert found.attrs["friction"] == 0.9


def pyramid():
    """Return two disks on the floor, and a third one of another shape upon them."""
    disk, top = (vg.make_shape("disk", diameter=1.0) for _ in range(2))
    position = [(3.5, 0.5, 0), (4.5, 0.5, 0), (4.0, 0.5 + math.sqrt(0.75), 0)]
    return vg.Packing.of([disk, top], vg.Rectangle((8, 4)), shape_id=[0, 0, 1], position=position, gravity=(0, -1, 0))


@pytest.mark.parametrize(
    ("upper", "floor", "rests"), [(0.27, 0.09, True), (0.265, 0.5, False), (0.5, 0.088, False), (0.27, 2.0, True)]
)
def test_three_disks_rest_by_the_friction_within_the_pile_and_that_at_the_floor(upper, floor, rests):
    """Rolling of the lower disks is held by equal tangential forces: tan 15 degrees above, a third of it below."""
    pairs = {("low", "high"): {"friction": upper}, ("low", "base"): {"friction": floor}}
    # the two lower disks touch without force, and the upper one is at no wall
    materials = table({"low": 0.0, "high": 0.0, "base": 0.0}, pairs=pairs, shapes=["low", "high"], walls="base")
    found = vg.equilibrium(pyramid(), materials, tolerance=1e-3)
    assert bool(found.rests.all()) == rests
    assert math.tan(math.radians(15)) == pytest.approx(0.268, abs=1e-3)


def slide(walls):
    """Return a cube that settles on a slope of 20 degrees, from where it rests, on a floor of ice or of rubber."""
    slope = math.radians(20)
    cube = vg.make_shape("box", lengths=(1, 1, 1))
    bed = vg.Packing.of(cube, vg.Box((6, 3, 3)), position=[(2, 1.5, 0.5)])
    materials = table({"cube": 1.0, "ice": 0.1, "rubber": 1.0}, shapes="cube", walls=walls)
    return vg.settle(bed, friction=materials, gravity=(math.sin(slope), 0, -math.cos(slope)))


@pytest.mark.parametrize(
    ("walls", "stays"),
    [
        ("rubber", True),
        ({"z_low": "rubber", "others": "ice"}, True),
        ({"z_low": "ice", "others": "rubber"}, False),
        ({"x_high": "rubber", "others": "ice"}, False),
    ],
)
def test_a_cube_settles_by_the_friction_of_the_wall_that_it_stands_on(walls, stays):
    settled = slide(walls)
    assert settled.stop_reason == "settled"
    # it stays, or slides to the wall
    assert settled.position[0, 0] == pytest.approx(2.0 if stays else 5.5, abs=0.02)


def test_a_layer_of_smooth_grains_on_rough_ones_has_forces_within_the_cone_of_each_pair():
    sphere = vg.make_shape("sphere")
    box = vg.Box((4, 4, 12))
    rough = vg.pack(sphere, box, "gravity", count=60, seed=1, friction=0.9)
    above = rough.position + np.array([0, 0, 5.5])
    layers = vg.Packing.of(
        [sphere, sphere], box, shape_id=np.repeat([0, 1], 60), position=np.vstack([rough.position, above]), gravity="-z"
    )
    walls = {"z_low": "smooth", "lid": "smooth", "others": "rough"}
    materials = table({"rough": 0.9, "smooth": 0.05}, shapes=["rough", "smooth"], walls=walls)
    bed = vg.settle(layers, friction=materials)
    assert bed.stop_reason == "settled"
    # an independent reckoning: by shape, and at walls by the direction of the normal
    forces, smooth = bed.forces, bed.shape_id == 1
    at_wall = forces.j < 0
    partner = np.where(at_wall, forces.normal[:, 2] < -0.9, smooth[np.maximum(forces.j, 0)])
    limit = np.where(smooth[forces.i] | partner, 0.05, 0.9)
    np.testing.assert_array_equal(forces.friction, limit)
    assert np.unique(limit).tolist() == [0.05, 0.9]
    assert np.all(forces.tangential_force <= limit * forces.normal_force + 1e-9)
    # friction of rough pairs is used: the other cone would not hold those forces
    assert (forces.tangential_force[limit == 0.9] > 0.1 * forces.normal_force[limit == 0.9]).any()
    found = vg.equilibrium(bed, materials, 1.001e-3)
    assert found.attrs["share_at_rest"] > 0.95
    assert vg.equilibrium(bed, 0.05, 1.001e-3).attrs["share_at_rest"] < found.attrs["share_at_rest"]


@pytest.mark.parametrize("shape", ["sphere", "box", slow("solid_union")])
def test_a_table_of_one_friction_gives_the_bits_of_the_number(shape):
    grain = vg.make_shape(shape, seed=1)
    same = table({"a": 0.4, "b": 0.4}, shapes=["a", "b"], walls={"z_low": "b", "others": "a"})
    runs = [
        vg.pack([grain, grain], vg.Box((3, 3, 8)), "gravity", count=4, seed=2, friction=friction)
        for friction in (0.4, same)
    ]
    np.testing.assert_array_equal(runs[0].position, runs[1].position)
    np.testing.assert_array_equal(runs[0].forces.force, runs[1].forces.force)
    np.testing.assert_array_equal(runs[1].forces.friction, np.full(runs[1].forces.count, 0.4))
    found = [vg.equilibrium(runs[0], friction) for friction in (0.4, same)]
    np.testing.assert_array_equal(found[0].force, found[1].force)


def test_compression_uses_the_friction_of_each_pair():
    sphere = vg.make_shape("sphere")
    loose = vg.pack([sphere, sphere], vg.Box((5, 5, 5), periodic="xyz"), "rsa", count=60, seed=3)
    runs = [
        vg.compress(loose, friction=friction)
        for friction in (
            0.3,
            table({"a": 0.3, "b": 0.3}, shapes=["a", "b"]),
            table({"a": 0.5, "b": 0.1}, shapes=["a", "b"]),
        )
    ]
    np.testing.assert_array_equal(runs[0].position, runs[1].position)
    mixed = runs[2].forces
    one, other = (loose.shape_id[index] for index in (mixed.i, mixed.j))
    np.testing.assert_array_equal(mixed.friction, np.where((one == 0) & (other == 0), 0.5, 0.1))
    assert runs[2].stop_reason == "compressed"
    assert np.all(mixed.tangential_force <= mixed.friction * mixed.normal_force * (1 + 1e-9))
    assert (mixed.tangential_force > 0.2 * mixed.normal_force).any()


def test_walls_are_told_apart_at_edges_and_the_lid_is_one():
    sphere = vg.make_shape("sphere")
    can = vg.Cylinder(2.0, 6.0)
    bed = vg.pack(sphere, can, "gravity", count=30, seed=1, lid={"weight": 1.0})
    names = ("sand", "floor", "side", "top")
    walls = {"z_low": "floor", "round": "side", "lid": "top", "z_high": "sand"}
    pairs = {("sand", name): {"friction": 0.1 * k} for k, name in enumerate(names, 1)}
    materials = table(dict.fromkeys(names, 0.9), pairs=pairs, shapes="sand", walls=walls)
    held = vg.settle(bed, friction=materials, lid={"weight": 1.0}).forces
    expected = np.where(held.j == -2, 0.4, np.where(held.normal[:, 2] < -0.9, 0.2, 0.3))
    np.testing.assert_allclose(held.friction, np.where(held.j >= 0, 0.1, expected))
    assert set(np.round(held.friction, 6)) == {0.1, 0.2, 0.3, 0.4}


def test_a_polygon_is_one_wall_beside_the_lid():
    disk, place = vg.make_shape("disk", diameter=0.8), vg.Polygon(2.0 * np.array([(0, 0), (2, 0), (2, 3), (0, 3)]))
    names = ("sand", "side", "top")
    pairs = {("sand", name): {"friction": 0.1 * k} for k, name in enumerate(names, 1)}
    walls = {"mesh": "side", "lid": "top"}
    materials = table(dict.fromkeys(names, 0.9), pairs=pairs, shapes="sand", walls=walls)
    bed = vg.pack(disk, place, "gravity", count=20, seed=1, friction=materials, lid={"weight": 1.0})
    held = bed.forces
    np.testing.assert_allclose(held.friction, np.where(held.j == -2, 0.3, np.where(held.j == -1, 0.2, 0.1)))
    assert {-2, -1} <= set(held.j.tolist())


def test_a_grain_in_a_corner_has_the_friction_of_all_its_walls():
    bed = vg.Packing.of(
        vg.make_shape("box", lengths=(1, 1, 1)), vg.Box((3, 3, 3)), position=[(0.5, 0.5, 0.5)], gravity="-z"
    )
    walls = {"x_low": "a", "y_low": "b", "z_low": "c", "others": "grain"}
    materials = table({"a": 0.1, "b": 0.2, "c": 0.3, "grain": 0.9}, shapes="grain", walls=walls)
    held = vg.settle(bed, friction=materials).forces
    np.testing.assert_allclose(held.friction, np.abs(held.normal) @ [0.1, 0.2, 0.3], atol=1e-12)


def test_forces_with_a_friction_by_contact_are_saved_and_measured(tmp_path):
    # without any friction of b one of four beds does not come to rest
    sphere = vg.make_shape("sphere")
    materials = table({"a": 0.5, "b": 0.1}, shapes=["a", "b"], walls="a")
    bed = vg.pack([sphere, sphere], vg.Box((3, 3, 8)), "gravity", count=30, seed=1, friction=materials)
    vg.save(bed, tmp_path / "bed.vtp")
    again = vg.load(tmp_path / "bed.vtp")
    np.testing.assert_array_equal(again.forces.friction, bed.forces.friction)
    assert 0.0 < float(again.measure("forces")["share_sliding"]) <= 1.0
    # the table is in the provenance, from which it is made again
    assert Materials(**again.provenance["settling"]["parameters"]["friction"]) == materials


def test_the_mean_friction_is_that_of_grains_that_meet_at_random():
    materials = table({"a": 0.8, "b": 0.2}, pairs={("a", "b"): {"friction": 0.4}}, shapes=["a", "b"])
    shape_id = np.array([0, 0, 0, 1])
    assert mean_friction(materials, shape_id, 2) == pytest.approx((9 * 0.8 + 6 * 0.4 + 0.2) / 16)
    assert mean_friction(0.3, shape_id, 2) == 0.3


def test_friction_counts_where_grains_and_walls_have_it():
    materials = table({"a": 0.8, "b": 0.2, "c": 0.0}, shapes=["a", "b", "c"], walls="b")
    found = FrictionTable(materials, np.array([0, 0]), 3, ("z_low",))
    assert (found.least, found.largest, found.walls_differ) == (0.2, 0.8, False)
    bed = vg.Packing.of(vg.make_shape("sphere"), vg.Box((3, 3, 3), periodic="xyz"), position=[(1, 1, 1)])
    assert friction_of(0.4, bed) == 0.4
    assert friction_of(table({"a": 0.8, "b": 0.2}, shapes="a"), bed).least == 0.8


def grains(count=2):
    """Return a bed of grains of two shapes."""
    sphere = vg.make_shape("sphere")
    return vg.Packing.of([sphere] * count, vg.Box((3, 3, 3)), shape_id=[0], position=[(1, 1, 1)], gravity="-z")


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ({"materials": {}}, InputError, "at least one material"),
        ({"materials": ["sand"]}, InputError, "a mapping such as"),
        ({"materials": {"": {}}}, InputError, "it must be text"),
        ({"materials": {"a": 0.5}}, InputError, "material 'a' is 0.5"),
        ({"materials": {"a": {"friction": -1}}}, InputError, "friction is -1"),
        ({"materials": {"a": {"fricton": 1}}}, UnknownNameError, "did you mean 'friction'"),
        ({"materials": {"a": {}, "b": {}}}, InputError, "each shape needs one"),
        ({"materials": {"a": {}, "b": {}}, "shapes": ["a", "c"]}, UnknownNameError, "material of shapes"),
        ({"materials": {"a": {}, "b": {}}, "shapes": 3}, InputError, "shapes is 3"),
        ({"materials": {"sand": {}, "b": {}}, "shapes": "sadn"}, UnknownNameError, "did you mean 'sand'"),
        ({"materials": {"a": {}}, "walls": "glass"}, UnknownNameError, "material of walls"),
        ({"materials": {"a": {}}, "walls": {"z_low": "glass"}}, UnknownNameError, "material of walls"),
        ({"materials": {"a": {}}, "walls": {"z_lo": "a", "others": "a"}}, UnknownNameError, "did you mean 'z_low'"),
        ({"materials": {"a": {}}, "walls": {"round_0": "a"}}, UnknownNameError, "wall of the materials 'round_0'"),
        ({"materials": {"a": {}}, "pairs": {("a", "b"): {"friction": 1}}}, UnknownNameError, "material of a pair"),
        ({"materials": {"a": {}}, "pairs": {("a", "a"): {"fiction": 1}}}, UnknownNameError, "did you mean 'friction'"),
        ({"materials": {"a": {}}, "pairs": {("a", "a"): {"density": 1}}}, UnknownNameError, "property of pair"),
        ({"materials": {"a": {}}, "pairs": {("a", "a"): {"friction": -0.1}}}, InputError, "friction is -0.1"),
        ({"materials": {"a": {}}, "pairs": {("a", "a"): {"friction": "x"}}}, InputError, "friction is 'x'"),
        ({"materials": {"a": {}}, "pairs": {("a", "a"): {"cohesion": 1}}}, InputError, "under the law 'linear'"),
        ({"materials": {"a": {}}, "pairs": {("a",): {}}}, InputError, "contacts are between two"),
        ({"materials": {"a": {}}, "pairs": {"a": 3}}, InputError, "pairs of 'a' is 3"),
        ({"materials": {"a": {}}, "pairs": [("a", "a", 0.3)]}, InputError, "pairs is"),
        (
            {"materials": {"a": {}, "b": {}}, "shapes": "a", "pairs": {("a", "b"): {}, ("b", "a"): {}}},
            InputError,
            "given twice",
        ),
        (
            {"materials": {"a": {}, "b": {"law": "hertz", "young_modulus": 1e7}}, "shapes": "a"},
            InputError,
            "material law is 'linear' and 'hertz'",
        ),
    ],
)  # fmt: skip
def test_bad_tables_are_refused(given, error, said):
    with pytest.raises(error, match=said):
        Materials(**given)


@pytest.mark.parametrize(
    ("materials", "said"),
    [
        (table({"a": 0.1, "b": 0.2}, shapes="a"), "says nothing of the wall 'x_low'"),
        (table({"a": 0.1, "b": 0.2}, shapes="a", walls={"z_low": "a"}), "says nothing of the wall 'x_low'"),
        (table({"a": 0.1}, shapes=["a"]), "the packing has 2 shapes"),
        (table({"a": 2.5}), "friction of 'a' and 'a' is 2.5"),
    ],
)
def test_tables_that_do_not_fit_a_packing_are_refused(materials, said):
    with pytest.raises(InputError, match=said):
        vg.settle(grains(), friction=materials)


@pytest.mark.parametrize("function", [vg.settle, vg.compress])
def test_a_solid_fraction_needs_one_friction(function):
    with pytest.raises(InputError, match="leave one of them out"):
        function(grains(), friction=table({"a": 0.1}), solid_fraction=0.6)


def test_more_friction_than_sweeps_take_is_proven_but_not_settled_with():
    materials = table({"a": 2.5})
    assert bool(vg.equilibrium(dataclasses.replace(grains(), gravity=(0, 0, -1)), materials).rests.any()) is False
