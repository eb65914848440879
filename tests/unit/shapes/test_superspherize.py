"""Inflation of volumes toward spheres: limits in closed form, monotony, no crossing."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

import voxgran as vg
from voxgran._base.errors import InputError
from voxgran.shapes.family import make_shape
from voxgran.shapes.generating.inflation import Inflation, inflated
from voxgran.shapes.repairing.diagnose import diagnose

CUBE = vg.shapes.box(lengths=(1, 1, 1))
Z = np.array([0.0, 0.0, 1.0])


def cube_with_bulges(radius, amount):
    """Volume of the unit cube inflated toward a sphere about its center that does not reach its edges."""
    edge = 0.5 / radius

    def grown(cosine):
        distance = 0.5 / cosine
        return ((1 - amount) * distance + amount * radius) ** 3 - distance**3

    return 1 + 6 * 2 * math.pi / 3 * quad(grown, edge, 1)[0]


def test_the_limit_of_full_inflation_is_a_sphere():
    errors = []
    for longest in (0.2, 0.1, 0.05):
        shape = vg.spherize(CUBE, 1.0, longest_edge=longest)
        assert np.linalg.norm(shape.vertices + shape.offset, axis=1) == pytest.approx(1.0, abs=1e-12)
        errors.append(1 - shape.volume / (4 / 3 * math.pi))
    assert errors[2] < 1e-3
    # second order, as facets inscribed in a sphere are
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.2)
    # also of what is not star-shaped about its centroid, in the limit
    rock = vg.spherize(make_shape("solid_union", seed=5), 1.5, longest_edge=0.1)
    assert np.linalg.norm(rock.vertices + rock.offset, axis=1) == pytest.approx(1.5, abs=1e-12)


@pytest.mark.parametrize("amount", [0.3, 0.8, 1.0])
def test_volume_of_inflated_cubes_in_closed_form(amount):
    height = 0.6 - 0.5
    assert cube_with_bulges(0.6, 1.0) == pytest.approx(1 + 6 * math.pi * height**2 * (3 * 0.6 - height) / 3)
    exact = cube_with_bulges(0.6, amount)
    shape = vg.spherize(CUBE, 0.6, amount=amount, longest_edge=0.03)
    assert shape.volume == pytest.approx(exact, abs=2e-3 * (exact - 1))


def test_inflation_is_monotone():
    shape, last = make_shape("convex_polyhedron", seed=2), None
    for amount in (0.1, 0.3, 0.6, 0.9, 1.0):
        grown = vg.spherize(shape, 0.7, center=(0.1, 0.0, -0.1), amount=amount, axis=(1, 1, 0), half_angle=80)
        shift = np.array(grown.offset)
        assert grown.volume > (shape if last is None else last).volume
        # the original lies inside
        assert grown.signed_distance(shape.vertices - shift).max() < 1e-12
        last = grown
    assert vg.spherize(shape, 0.1).volume == pytest.approx(shape.volume, rel=1e-12)


def test_only_the_cone_is_inflated():
    grown = vg.spherize(CUBE, 2.0, axis=(0, 0, 2), half_angle=30, longest_edge=0.05)
    points = grown.vertices + grown.offset
    angle = np.degrees(np.arccos(points[:, 2] / np.linalg.norm(points, axis=1)))
    assert np.abs(points[angle >= 30]).max() <= 0.5 + 1e-12
    # all the way in the inner half of the cone
    assert np.linalg.norm(points[angle <= 14.9], axis=1) == pytest.approx(2.0, abs=1e-12)
    between = np.linalg.norm(points[(angle > 16) & (angle < 29)], axis=1)
    assert ((between > 0.5) & (between < 2)).all()
    assert np.linalg.norm(points[grown.faces] - points[np.roll(grown.faces, 1, axis=1)], axis=-1).max() <= 0.05


@pytest.mark.parametrize("half_angle", [2.5, 0.1])
def test_narrow_cones_are_divided_to_an_end(half_angle):
    """Where bisection of long edges alone does not end; the steep edge of the cone has triangles that are not thin."""
    grown = vg.spherize(CUBE, 1.0, amount=0.5, half_angle=half_angle, longest_edge=0.05)
    points = grown.vertices + grown.offset
    assert points[:, 2].max() == pytest.approx(0.75, abs=1e-3)
    assert np.linalg.norm(points[grown.faces] - points[np.roll(grown.faces, 1, axis=1)], axis=-1).max() <= 0.05
    assert len(grown.faces) < 20_000
    assert grown.volume == pytest.approx(1.0, abs=1e-3)


def test_beyond_the_sphere_nothing_moves():
    points = np.array([[0.0, 0.0, 0.2], [0.0, 3.0, 0.0], [0.5, 0.0, 0.0], [0.3, 0.0, 0.3]])
    moved = Inflation(np.zeros(3), 1.0, 0.5, Z, math.pi).moved(points)
    assert moved[0] == pytest.approx([0, 0, 0.6])
    assert (moved[1] == points[1]).all()
    assert moved[2] == pytest.approx([0.75, 0, 0])
    half = Inflation(np.zeros(3), 1.0, 0.5, Z, math.pi / 2).moved(points)
    assert half[0] == pytest.approx([0, 0, 0.6])
    assert (half[2] == points[2]).all()
    # at the middle of the cone's edge the amount is full, three quarters out it is half
    away = Inflation(np.zeros(3), 1.0, 1.0, Z, math.pi / 3).moved(points[3:])
    assert np.linalg.norm(away) == pytest.approx(0.3 * math.sqrt(2) + 0.5 * (1 - 0.3 * math.sqrt(2)))


def test_where_the_center_does_not_see_the_whole_nothing_crosses():
    """A horseshoe of three boxes: the inflated legs meet, unless the amount is below 1."""
    import manifold3d  # the library of unions

    legs = [((0.2, 0.2, 1.0), (-0.5, 0, 0.4)), ((0.2, 0.2, 1.0), (0.5, 0, 0.4)), ((1.2, 0.2, 0.2), (0, 0, 0))]
    union = sum((manifold3d.Manifold.cube(size, True).translate(at) for size, at in legs), manifold3d.Manifold())
    mesh = union.to_mesh64()
    shape = vg.Shape.from_mesh(mesh.vert_properties[:, :3], mesh.tri_verts)
    inside = np.array([0.0, 0.0, 0.0]) - shape.offset
    for amount in (0.5, 1.0):
        grown = vg.spherize(shape, 0.9, center=inside, amount=amount, longest_edge=0.1)
        found = diagnose(grown)
        assert found.ok, found.sentences()
        assert grown.volume > shape.volume
        assert 0 < grown.record["amount"] <= min(amount, 0.95)


def test_amounts_are_reduced_where_triangles_would_cross(monkeypatch):
    seen = []

    def once_bad(vertices, faces):
        seen.append(vertices)
        return len(seen) == 3

    monkeypatch.setattr("voxgran.shapes.generating.inflation.bounds_solid", once_bad)
    monkeypatch.setattr("voxgran.shapes.generating.inflation.is_star_shaped", lambda *_: False)
    vertices, _, amount = inflated(CUBE.vertices, CUBE.faces, Inflation(np.zeros(3), 2.0, 0.8, Z, 4.0), 0.5)
    assert amount == pytest.approx(0.2)
    assert np.linalg.norm(vertices, axis=1).max() == pytest.approx(0.8 * math.sqrt(0.75) + 0.2 * 2.0)
    seen.extend([None] * 9)
    vertices, faces, amount = inflated(CUBE.vertices, CUBE.faces, Inflation(np.zeros(3), 2.0, 0.8, Z, 4.0), 0.5)
    assert vertices is CUBE.vertices
    assert faces is CUBE.faces
    assert amount == 0.0


@pytest.mark.parametrize("base", ["convex_polyhedron", "box", "ellipsoid", "solid_union"])
def test_random_inflations_are_one_clean_solid(base):
    for seed in range(1 if base == "solid_union" else 5):
        shape = make_shape("superspherize", seed=seed, base=base)
        found = diagnose(shape)
        assert found.ok, (seed, found.sentences())
        assert (found.bodies, found.cavities) == (1, 0)
        assert shape.record["base"] == base
        assert (shape.record["amounts"] > 0).sum() >= 3


@pytest.mark.slow
def test_many_inflations_are_one_clean_solid():
    for seed in range(1000):
        shape = make_shape("superspherize", seed=seed, inflations=(1, 8), spread=(0.0, 1.0))
        found = diagnose(shape)
        assert found.ok, (seed, found.sentences())
        assert (found.bodies, found.cavities) == (1, 0)


def test_inflation_makes_rounder():
    """The sphericity of a cube grows with the number of inflations, up to that of a sphere."""

    def sphericity(shape):
        return math.pi * shape.diameter**2 / shape.surface_area

    def mean(**parameters):
        options = {"base": "box", "longest_edge": 0.12, **parameters}
        return np.mean([sphericity(make_shape("superspherize", seed=s, **options)) for s in range(3)])

    few = mean(inflations=1, spread=0.0, amounts=0.7)
    many = mean(inflations=10, spread=0.0, amounts=0.7, radii=1.0)
    full = mean(inflations=1, spread=0.0, amounts=1.0, radii=1.0, half_angles=180.0)
    assert sphericity(CUBE) == pytest.approx((math.pi / 6) ** (1 / 3))
    assert sphericity(CUBE) < few
    assert few < full
    assert full > 0.995
    assert many > few


BAD = [
    ({"radius": 0.0}, "radius is 0.0"),
    ({"radius": 1.0, "center": (0, 0, 2)}, r"center is \[0.0, 0.0, 2.0\]: it must be at least 0.02 equivalent"),
    ({"radius": 1.0, "amount": 1.5}, "amount is 1.5"),
    ({"radius": 1.0, "amount": 0.0}, "amount is 0.0"),
    ({"radius": 1.0, "half_angle": 200}, "half_angle is 200"),
    ({"radius": 1.0, "axis": (0, 0, 0)}, "axis is 0 along all directions"),
    ({"radius": 1.0, "longest_edge": -1}, "longest_edge is -1"),
    ({"radius": 1.0, "longest_edge": 1e-4}, "more than 2000000 triangles"),
]


@pytest.mark.parametrize(("parameters", "message"), BAD)
def test_bad_spheres_are_refused(parameters, message):
    with pytest.raises((InputError, vg.VoxgranError), match=message):
        vg.spherize(CUBE, **parameters)


def test_only_solids_are_inflated():
    with pytest.raises(InputError, match="is plane"):
        vg.spherize(make_shape("disk"), 1.0)
    with pytest.raises(InputError, match="open surface"):
        vg.spherize(make_shape("sheet"), 1.0)
    with pytest.raises(InputError, match="shape is 3"):
        vg.spherize(3, 1.0)
