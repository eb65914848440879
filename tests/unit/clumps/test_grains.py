"""Clumps as grains: mass properties, replacing shapes, bonds."""

import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning
from voxgran.clumps.bonds import body_bonds
from voxgran.clumps.model import Clump, ClumpErrors
from voxgran.io.spheres import owned_spheres
from voxgran.shapes.model import Shape
from voxgran.shapes.spheres import MassProperties, Spheres

PAIR = np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]), np.array([1.0, 1.0])
TURN = np.array([0.5, 0.5, -0.5, 0.5])
NONE = ClumpErrors(
    **dict.fromkeys(("iou", "iou_uncertainty", "volume", "centroid", "inertia"), 0.0), surface_mean=0, surface_max=0
)


def clump_of(shape, centers, radii):
    return Clump(np.asarray(centers, float), np.asarray(radii, float), shape, NONE)


@pytest.fixture(scope="module")
def cube():
    return vg.shapes.box(lengths=(1, 1, 1))


@pytest.fixture(scope="module")
def eight(cube):
    """Return a clump of a cube that lacks a part of one corner."""
    corners = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (-0.2, 0.2) for z in (-0.2, 0.2)])
    return clump_of(cube, corners, np.linspace(0.25, 0.3, 8))


def test_a_clump_knows_the_mass_properties_of_its_shape_and_of_its_spheres(cube):
    clump = clump_of(cube, *PAIR)
    true, spheres = clump.mass_properties(), clump.mass_properties("spheres")
    assert (true.volume, true.centroid.tolist()) == (1.0, [0, 0, 0])
    assert true.inertia == pytest.approx(np.eye(3) / 6)
    # two unit spheres less their common lens
    assert spheres.volume == pytest.approx(2 * 4 / 3 * math.pi - math.pi * (4 + 1) / 12 * (2 - 1) ** 2)
    assert np.abs(spheres.centroid).max() < 1e-15
    assert clump.to_shape().volume == 1.0
    assert clump.to_shape().inertia == pytest.approx(np.eye(3) / 6)
    assert clump.to_shape(mass_properties="spheres").volume == pytest.approx(spheres.volume)
    with pytest.raises(InputError, match="of is 'both'"):
        clump.mass_properties("both")
    with pytest.raises(InputError, match="mass_properties is 'union'"):
        clump.to_shape(mass_properties="union")


def test_a_shape_of_spheres_is_its_own_clump(eight):
    shape = eight.to_shape(mass_properties="spheres")
    again = vg.fit_clump(shape, max_spheres=8)
    assert again.to_shape() == shape
    assert vg.fit_clump(eight.to_shape(), max_spheres=8).to_shape() == eight.to_shape()
    sphere = vg.shapes.sphere(radius=2.0)
    assert clump_of(sphere, np.zeros((1, 3)), [2.0]).to_shape().is_sphere


def test_only_volume_centroid_and_inertia_are_those_of_the_true_shape(eight, cube):
    solid, union = eight.to_shape(), Shape(Spheres(eight.centers, eight.radii))
    assert solid.diameter == cube.diameter
    assert solid.surface_area == union.surface_area
    assert solid.bounding_radius == union.bounding_radius
    assert np.array_equal(solid.bounds, union.bounds)
    assert np.array_equal(solid.contains(eight.centers + 0.2), union.contains(eight.centers + 0.2))
    assert solid.geometry.union.volume == union.volume


def test_mass_properties_move_turn_and_scale_with_the_spheres():
    mass = MassProperties(2.0, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 1.5, 2.0]))
    spheres = Spheres(*PAIR, mass)
    moved = spheres.moved(np.ones(3)).mass
    assert np.allclose(moved.centroid, [1.1, 1.2, 1.3])
    assert np.array_equal(moved.inertia, mass.inertia)
    big = spheres.scaled(2.0)
    assert (big.volume, big.mass.centroid[1]) == (16.0, 0.4)
    assert np.array_equal(big.inertia, 32 * mass.inertia)
    # a third of a turn about a diagonal permutes the axes
    solid = Shape.of(spheres, name="pair").rotated(TURN)
    assert np.sort(solid.inertia.diagonal()) == pytest.approx([1.0, 1.5, 2.0])
    assert not np.allclose(solid.inertia, mass.inertia)
    assert np.array_equal(solid.inertia, solid.inertia.T)
    mm = Shape.of(spheres, name="pair", unit="m").to_unit("mm")
    assert mm.volume == pytest.approx(2e9)


def test_equality_and_hash_hold_the_mass_properties():
    mass = MassProperties(2.0, np.zeros(3), np.eye(3))
    bare, own = Shape(Spheres(*PAIR)), Shape(Spheres(*PAIR, mass))
    assert own == Shape(Spheres(*PAIR, MassProperties(2.0, -np.zeros(3), np.eye(3))))
    assert bare != own != Shape(Spheres(*PAIR, MassProperties(3.0, np.zeros(3), np.eye(3))))
    assert len({bare, own, Shape(Spheres(*PAIR, mass))}) == 2
    assert len({mass, MassProperties(2.0, np.zeros(3), np.eye(3))}) == 1
    assert mass != 1
    assert repr(mass) == "MassProperties(volume=2, centroid=(0, 0, 0), moments=(1, 1, 1))"
    assert bare.key == Shape(Spheres(*PAIR, None)).key


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((0.0, np.zeros(3), np.eye(3)), "volume is 0"),
        ((1.0, np.zeros(2), np.eye(3)), "centroid"),
        ((1.0, np.zeros(3), np.full((3, 3), np.nan)), "inertia"),
        ((1.0, np.zeros(3), np.eye(3) + np.eye(3, k=1) / 9), "symmetric"),
        ((1.0, np.zeros(3), np.diag([1.0, 1.0, -1.0])), "above 0"),
        ((1.0, np.zeros(3), np.diag([1.0, 1.0, 2.1])), "sum of the other two"),
    ],
)
def test_mass_properties_that_no_solid_has_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        MassProperties(*values)
    with pytest.raises(InputError, match="mass is 3"):
        Spheres(*PAIR, 3)


def test_a_packing_keeps_its_poses_and_solid_fraction_with_clumps(cube, eight, tmp_path):
    box = vg.Box((4, 4, 4), periodic="x")
    sphere = vg.shapes.sphere(radius=0.5)
    packing = vg.Packing.of(
        [cube, sphere],
        box,
        position=[[0.1, 1, 1], [2, 2.5, 1], [3, 1, 3.2]],
        shape_id=[0, 1, 0],
        scale=[1, 1, 0.8],
        orientation=[[1, 0, 0, 0], TURN, TURN],
        stop_reason="settled",
        contact_gap=1e-3,
        unit="m",
        provenance={"method": "given"},
    )
    made = packing.with_clumps([eight, None])
    assert made == packing.with_clumps(eight)
    assert made.shapes == (eight.to_shape(), sphere)
    assert np.array_equal(made.position, packing.position)
    assert np.array_equal(made.orientation, packing.orientation)
    assert made.solid_fraction == packing.solid_fraction
    assert (made.stop_reason, made.contact_gap, made.forces) == ("count", 0.0, None)
    assert made.provenance["clumps"][0]["spheres"] == 8
    assert made.provenance["clumps"][1] is None
    assert made.with_clumps() is made
    # slabs that cut clumps add up to the true volume
    assert vg.window_solid_fraction(made, (0, 0, 0), (4, 4, 4)) == pytest.approx(made.solid_fraction, rel=1e-12)
    halves = [vg.window_solid_fraction(made, (0, a, 0), (4, b, 4)) for a, b in ((0, 1.1), (1.1, 4))]
    assert (halves[0] * 1.1 + halves[1] * 2.9) / 4 == pytest.approx(made.solid_fraction, rel=1e-12)
    made.save(tmp_path / "clumps.vtp")
    again = vg.load(tmp_path / "clumps.vtp")
    assert again == made
    assert again.shapes[0].geometry.mass == eight.mass_properties()
    assert again.solid_fraction == made.solid_fraction
    assert again.to_unit("mm").solid_fraction == pytest.approx(made.solid_fraction)


def test_shapes_are_fitted_once_each(cube):
    packing = vg.Packing.of(cube, vg.Box((4, 4, 4)), position=[[1, 1, 1], [3, 3, 3]])
    made = packing.with_clumps(max_spheres=5, method="inscribed")
    assert len(made.shapes) == 1
    assert len(made.shapes[0].geometry.radii) == 5
    assert made.provenance["clumps"][0]["errors"]["iou"] > 0.5


@pytest.mark.parametrize(
    ("clumps", "more", "message"),
    [
        (None, {"max_sphere": 3}, "did you mean 'max_spheres'"),
        ("clump", {"max_spheres": 3}, "max_spheres is given beside clumps"),
        ("two", {}, "2 entries for 1 shapes"),
        ("text", {}, "an entry of clumps"),
        ("number", {}, "clumps is 3"),
        ("other", {}, "volume and inertia must agree"),
    ],
)
def test_wrong_clumps_are_refused(cube, eight, clumps, more, message):
    packing = vg.Packing.of(cube, vg.Box((4, 4, 4)), position=[[1, 1, 1]])
    other = clump_of(cube.scaled(1.1), eight.centers, eight.radii)
    given = {"clump": eight, "two": [eight, eight], "text": ["clump"], "number": 3, "other": other}.get(clumps)
    with pytest.raises(InputError, match=message):
        packing.with_clumps(given, **more)


def test_a_clump_in_another_unit_is_converted_to_that_of_its_shape(cube, eight):
    packing = vg.Packing.of(cube.to_unit("mm"), vg.Box((9, 9, 9)), position=[[4, 4, 4]])
    small = clump_of(cube.to_unit("mm").to_unit("um"), 1000 * eight.centers, 1000 * eight.radii)
    made = packing.with_clumps(small)
    assert made.shapes[0].unit == made.unit == "mm"
    assert made.shapes[0].geometry.radii == pytest.approx(eight.radii)
    with pytest.raises(InputError, match="volume and inertia must agree"):
        packing.with_clumps(clump_of(cube.to_unit("um"), eight.centers, eight.radii))


def test_one_clump_for_two_shapes_is_refused(cube, eight):
    both = cube, cube.scaled(1.5)
    packing = vg.Packing.of(both, vg.Box((4, 4, 4)), position=[[1, 1, 1], [3, 3, 3]], shape_id=[0, 1])
    with pytest.raises(InputError, match="a single Clump for 2 shapes"):
        packing.with_clumps(eight)


def test_the_bond_of_two_spheres_is_their_circle_of_intersection(cube):
    bonds = clump_of(cube.to_unit("mm"), [[0, 0, 0], [2.5, 0, 0]], [2.0, 1.5]).bonds(strength=3.0, shear_strength=2.0)
    x = (2.5**2 + 2.0**2 - 1.5**2) / (2 * 2.5)
    assert bonds["point"].values == pytest.approx(np.array([[x, 0, 0]]))
    assert bonds["normal"].values.tolist() == [[1, 0, 0]]
    assert bonds["area"].values == pytest.approx([math.pi * (4 - x * x)])
    assert bonds["gap"].values == pytest.approx([-1.0])
    assert bonds["normal_strength"].values == pytest.approx(3 * bonds["area"].values)
    assert bonds["shear_strength"].values == pytest.approx(2 * bonds["area"].values)
    assert (int(bonds["first"][0]), int(bonds["second"][0]), int(bonds["grain"][0])) == (0, 1, 0)
    assert [bonds[name].units for name in ("point", "area", "normal_strength")] == ["mm", "mm^2", "force"]


@pytest.mark.parametrize(
    ("distance", "radius", "area", "place"),
    [
        (1.5, 0.5, 0.1 * math.pi / 4, 1.0),  # they touch
        (0.8, 0.5, math.pi / 4, 0.8),  # the center of the smaller one lies beyond the circle
        (0.2, 0.5, math.pi / 4, 0.2),  # one within the other
        (0.0, 0.5, math.pi / 4, 0.0),
        (0.0, 1.0, math.pi, 0.0),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_bonds_of_spheres_that_touch_or_lie_in_another(distance, radius, area, place, turned):
    centers, radii = np.array([[0.0, 0, 0], [0, distance, 0]]), np.array([1.0, radius])
    order = [1, 0] if turned else [0, 1]
    found = body_bonds(centers[order], radii[order])
    assert found.area == pytest.approx([area])
    assert found.point == pytest.approx(np.array([[0, place, 0]]), abs=1e-12)
    assert np.linalg.norm(found.normal) == pytest.approx(1.0)
    assert found.added == 0


def test_the_area_is_continuous_in_the_distance():
    far = np.linspace(0.01, 1.49, 400)
    areas = [body_bonds(np.array([[0.0, 0, 0], [d, 0, 0]]), np.array([1.0, 0.5])).area[0] for d in far]
    assert np.abs(np.diff(areas)).max() < 0.03


def test_bonds_join_all_spheres_of_a_grain(cube):
    row = clump_of(cube, [[0, 0, 0], [3, 0, 0], [3.5, 0, 0], [7, 0, 0]], np.ones(4))
    with pytest.warns(PackingWarning, match="2 bonds join spheres that do not touch"):
        bonds = row.bonds(strength=1.0)
    assert np.column_stack([bonds["first"], bonds["second"]]).tolist() == [[0, 1], [1, 2], [2, 3]]
    assert bonds["gap"].values == pytest.approx([1.0, -1.5, 1.5])
    assert bonds["point"].values[0] == pytest.approx([1.5, 0, 0])
    assert bonds.attrs["bonds_over_gaps"] == 2


def test_bonds_of_a_packing_are_numbered_like_the_saved_spheres(eight, cube):
    sphere = vg.shapes.sphere(radius=0.5)
    packing = vg.Packing.of(
        [sphere, cube],
        vg.Box((4, 4, 4)),
        position=[[1, 1, 1], [2, 2.5, 1], [3, 1, 3.2]],
        shape_id=[1, 0, 1],
        scale=[1, 1, 0.5],
        orientation=[[1, 0, 0, 0], TURN, TURN],
    )
    bonds = packing.with_clumps(eight).bonds(strength=5.0, least_area=0.0)
    centers, radii, owner = owned_spheres(packing.with_clumps(eight))
    i, j = bonds["first"].values, bonds["second"].values
    assert set(bonds["grain"].values.tolist()) == {0, 2}
    assert np.array_equal(owner[i], bonds["grain"])
    assert np.array_equal(owner[j], bonds["grain"])
    apart = centers[j] - centers[i]
    distance = np.linalg.norm(apart, axis=1)
    assert bonds["normal"].values == pytest.approx(apart / distance[:, None])
    assert bonds["gap"].values == pytest.approx(distance - radii[i] - radii[j])
    for one in (i, j):
        rim = np.sqrt(((bonds["point"].values - centers[one]) ** 2).sum(axis=1) + bonds["area"].values / math.pi)
        assert rim == pytest.approx(radii[one])
    with pytest.raises(InputError, match=r"shape 1, 'box', is not made of spheres.*with_clumps"):
        packing.bonds(strength=1.0)
    alone = vg.Packing.of(sphere, vg.Box((4, 4, 4)), position=[[1, 1, 1]])
    assert alone.bonds(strength=1.0).sizes["bond"] == 0


@pytest.mark.parametrize(
    "wrong", [{"strength": -1}, {"strength": 1, "least_area": 2}, {"strength": 1, "tolerance": "a"}]
)
def test_wrong_strengths_are_refused(eight, wrong):
    with pytest.raises(InputError):
        eight.bonds(**wrong)


def test_a_clump_shows_what_it_is(eight):
    assert repr(eight) == "Clump(8 spheres of 'box', given, iou=0.0000)"
    assert "volume, true and of the spheres" in eight._repr_html_()


#: methods and their parameters by which few clumps are packed quickly
METHODS = {"advancing_front": {}, "rsa": {}, "digital": {"voxel_size": 0.1}, "control_point": {}, "gravity": {}}


@pytest.mark.parametrize("method", METHODS)
def test_packing_methods_take_clumps_as_they_are(eight, method):
    solid = eight.to_shape()
    packing = vg.pack(solid, vg.Box((4, 4, 8)), method, count=6, seed=3, **METHODS[method])
    assert packing.count == 6
    assert packing.solid_fraction == pytest.approx(6 / 128)
    if method != "digital":
        assert packing.verify(tolerance=1e-6).ok
    # clumps of another volume take the same room
    assert packing.scale == pytest.approx(np.ones(6))
    centers, radii, owner = owned_spheres(packing)
    gaps = np.linalg.norm(centers[:, None] - centers[None], axis=2) - radii[:, None] - radii[None]
    nearest = gaps[owner[:, None] != owner[None]].min()
    assert packing.contacts(5.0).gap.min() == pytest.approx(nearest, abs=1e-9)
