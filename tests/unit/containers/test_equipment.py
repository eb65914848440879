"""Hoppers, funnels, drums, planes and lists of walls: closed formulas, turned walls, and what is refused."""

import math

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError
from voxgran.containers.model import Boundary, boundary_of
from voxgran.geometry.walls import Round, cone, plane

AXES = [(1, 2, 0), (2, 0, 1), (0, 1, 2)]
SPHERE = vg.make_shape("sphere")


def turned(generator):
    """Return a random unit vector."""
    vector = generator.normal(size=3)
    x, y, z = vector / np.linalg.norm(vector)
    return x, y, z


def some_walls(seed):
    """Return walls of all kinds about an axis, some along coordinates."""
    generator = np.random.default_rng(seed)
    axis = [(0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0), turned(generator)][seed % 4]
    center = tuple(generator.normal(size=3))
    slanted = cone(center, 1.0, generator.uniform(0.2, 2.9))._replace(axis=axis)
    return [Round(center, 1.3, axis=axis), slanted, plane(center, axis), Round(center, 1.2, axes=3)]


@pytest.mark.parametrize("seed", range(8))
def test_lines_end_at_walls_about_any_axis(seed):
    generator = np.random.default_rng(seed)
    for wall in some_walls(seed):
        np.testing.assert_allclose(wall.frame @ wall.frame.T, np.eye(3), atol=1e-15)
        np.testing.assert_allclose(wall.frame[2], wall.axis, atol=1e-15)
        points, steps = 2 * generator.normal(size=(100, 3)), 4 * generator.normal(size=(100, 50))
        for axes in AXES:
            low, high = wall.along(points, axes)
            places = points[:, None] + steps[..., None] * np.eye(3)[axes[2]]
            distance = wall.distance(places.reshape(-1, 3)).reshape(steps.shape)
            inside = (steps > low[:, None]) & (steps < high[:, None])
            assert (inside == (distance > 0))[np.abs(distance) > 1e-6].all()


def test_a_tilted_wall_is_an_upright_one_turned():
    generator = np.random.default_rng(1)
    wall = cone((0.0, 0.0, 0.0), 2.0, math.radians(50))
    tilted = wall._replace(axis=turned(generator))
    points = generator.normal(size=(50, 3))
    np.testing.assert_allclose(tilted.distance(points @ tilted.frame), wall.distance(points), atol=1e-13)


def test_volumes_are_those_of_formulas():
    assert vg.Hopper(radius=4, outlet=1, angle=45).volume == pytest.approx(math.pi * 3 / 3 * (16 + 4 + 1), rel=1e-14)
    binned = vg.Hopper(radius=4, outlet=1, angle=45, bin_height=5)
    assert binned.volume == pytest.approx(math.pi * (21 + 16 * 5), rel=1e-14)
    wedge = vg.Hopper(radius=4, outlet=1, angle=45, length=2, bin_height=5, origin=(3, 2, 1))
    assert wedge.volume == pytest.approx(2 * (3 * 5 + 8 * 5), rel=1e-12)
    np.testing.assert_allclose(wedge.bounds, [[-1, 1, 1], [7, 3, 9]], atol=1e-12)
    assert vg.Funnel(radius=2, outlet=1, height=3).volume == pytest.approx(math.pi * 7, rel=1e-14)
    assert vg.Drum(radius=2, length=3, axis="y").volume == pytest.approx(math.pi * 12, rel=1e-14)
    corner = vg.Planes([(-1, 0, 0), (0, -1, 0), (0, 0, -2), (1, 1, 1)], [(0, 0, 0)] * 3 + [(0, 3, 0)])
    assert corner.volume == pytest.approx(4.5, rel=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_volume_of_walls_has_the_error_that_it_states(seed):
    generator = np.random.default_rng(seed)
    radius, half, point, axis = (
        1 + generator.random(),
        1 + generator.random(),
        generator.normal(size=3),
        turned(generator),
    )
    ends = [
        {"kind": "plane", "normal": sign * np.array(axis), "point": point + sign * half * np.array(axis)}
        for sign in (-1, 1)
    ]
    tube = vg.Walls([{"kind": "cylinder", "radius": radius, "axis": axis, "point": point}, *ends])
    assert tube.volume == pytest.approx(2 * half * math.pi * radius**2, rel=tube.volume_error)
    cap = vg.Walls(
        [{"kind": "sphere", "radius": radius, "point": point}, {"kind": "plane", "normal": axis, "point": point}]
    )
    assert cap.volume == pytest.approx(2 / 3 * math.pi * radius**3, rel=cap.volume_error)
    assert max(tube.volume_error, cap.volume_error) < 1e-4
    vertices, _ = cap.mesh()
    assert np.abs(cap.signed_distance(vertices)).max() < 1e-12
    cube = [{"kind": "plane", "normal": sign * row, "point": 2 * sign * row} for sign in (-1, 1) for row in np.eye(3)]
    assert vg.Walls(cube).volume == pytest.approx(64, rel=1e-13)
    assert vg.Walls(cube).volume_error == 0


def test_walls_make_the_container_of_their_name():
    pipe = [{"kind": "cylinder", "radius": 2.0}, {"kind": "plane", "normal": (0, 0, -1)}]
    pipe.append({"kind": "plane", "normal": (0, 0, 3), "point": (5, 5, 4)})
    points = np.random.default_rng(0).uniform(-3, 5, (500, 3))
    inside = vg.Cylinder(2.0, 4.0).signed_distance(points) < 0
    assert ((vg.Walls(pipe).signed_distance(points) < 0) == inside).all()


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: vg.Hopper(radius=1, outlet=2), "radius of the hopper is 1.0: it must be finite and above 2"),
        (lambda: vg.Hopper(radius=1, outlet=0), "outlet of the hopper is 0"),
        (lambda: vg.Hopper(radius=2, outlet=1, angle=90), "angle of the hopper is 90: .* at most 89"),
        (lambda: vg.Hopper(radius=2, outlet=1, length=-1), "length of the hopper is -1"),
        (lambda: vg.Drum(1, 2, "z"), "axis of the drum is 'z'"),
        (lambda: vg.Funnel(1, 2, math.inf), "height of the funnel is inf"),
        (
            lambda: vg.Planes([(1, 0, 0)], [(0, 0, 0)]),
            "planes: what lies within its 1 walls has no end at the low end of x",
        ),
        (lambda: vg.Planes([(1, 0, 0)] * 2, [(0, 0, 0)]), "there are 2 normals and 1 points"),
        (lambda: vg.Planes([(0, 0, 0)], [(0, 0, 0)]), "normal 0 is .* it must have a length"),
        (lambda: vg.Walls([]), "it must be a list of one wall or more"),
        (lambda: vg.Walls([{"kind": "cylinder", "radius": 2}]), "no end at the high end of z; add a wall there"),
        (lambda: vg.Walls([{"kind": "cylinder"}]), "wall 0 has no radius: a cylinder needs it"),
        (
            lambda: vg.Walls(
                [{"kind": "sphere", "radius": 1}, {"kind": "plane", "normal": (0, 0, 1), "point": (0, 0, -2)}]
            ),
            "nothing lies within all of its 2 walls",
        ),
    ],
)
def test_what_is_no_container_is_refused_in_one_sentence(make, match):
    with pytest.raises(InputError, match=match):
        make()


def test_unknown_walls_and_keys_are_named():
    with pytest.raises(UnknownNameError, match="wall 0 kind 'sphre' is unknown: did you mean 'sphere'"):
        vg.Walls([{"kind": "sphre", "radius": 1}])
    with pytest.raises(UnknownNameError, match="wall 0 key 'raduis' is unknown: did you mean 'radius'"):
        vg.Walls([{"kind": "sphere", "raduis": 1}])


@pytest.mark.parametrize(
    ("outlet", "words"), [(0.3, "is smaller than a grain and will arch"), (1.5, "will arch"), (2.4, "will arch")]
)
def test_packing_warns_of_an_outlet_that_will_arch(outlet, words):
    with pytest.warns(
        vg.PackingWarning, match=f"outlet of the hopper is .* it {words} .* give a radius of 2.5 or more"
    ):
        vg.pack(SPHERE, vg.Hopper(radius=5, outlet=outlet), "rsa", count=3)


def test_packing_is_silent_about_a_wide_outlet():
    assert vg.pack(SPHERE, vg.Hopper(radius=5, outlet=2.5), "rsa", count=3).count == 3
    assert vg.Drum(2, 2).doubt(9.0) == ""


def test_scenes_put_containers_together_from_walls(tmp_path):
    (tmp_path / "scene.toml").write_text("""
[[shape]]
family = "sphere"
[container]
kind = "walls"
[[container.wall]]
kind = "cone"
radius = 2
angle = 60
[[container.wall]]
kind = "plane"
normal = [0, 0, -1]
[[container.wall]]
kind = "plane"
normal = [0, 0, 1]
point = [0, 0, 4]
[packing]
method = "rsa"
count = 5
""")
    container = vg.Scene.from_toml(tmp_path / "scene.toml").container
    wide = 2 + 4 / math.tan(math.radians(60))
    assert container.volume == pytest.approx(math.pi * 4 / 3 * (4 + 2 * wide + wide**2), rel=container.volume_error)


def test_a_boundary_knows_which_walls_all_methods_take():
    """A part of a sphere, a tilted cylinder, and one that is cut along its axis are none of them."""
    bowl = vg.Walls([{"kind": "sphere", "radius": 1}, {"kind": "plane", "normal": (0, 0, 1)}])
    for container in (bowl, vg.Drum(1, 2), vg.Hopper(2, 1)):
        assert not boundary_of(container).is_usual
    assert boundary_of(vg.Cylinder(1, 2)).is_usual
    upright = Round((0.0, 0.0, 0.0), 1.0)
    assert Boundary((*vg.Box((1, 1, 1)).boundary.planes[:2], upright)).cylinder is None
    assert Boundary((*vg.Box((1, 1, 1)).boundary.planes[:2], Round((0.0, 0.0, 0.0), 1.0, axes=3))).sphere is None
