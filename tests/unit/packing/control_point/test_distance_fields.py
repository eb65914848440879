"""Fields of signed distance against the exact distances of the shapes."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.contacts.inside import inner_distance
from voxgran.packing.control_point.distance_fields import (
    BALLS,
    GRID,
    PLANES,
    ROUGH,
    SINGLE,
    STEEP,
    distances,
    make_fields,
)
from voxgran.packing.control_point.point_trees import make_trees, stack_room
from voxgran.packing.control_point.sdf_contact import find_near
from voxgran.points.sample import sample_surface
from voxgran.shapes.spheres import Spheres


def unit(shape):
    return shape.scaled(1 / shape.diameter)


THREE_BALLS = Spheres(np.array([[0.0, 0, 0], [0.6, 0, 0], [0.1, 0.5, 0.1]]), np.array([0.5, 0.4, 0.3]))
SHAPES = {
    "sphere": (unit(vg.make_shape("sphere")), BALLS),
    "clump": (unit(vg.Shape.of(THREE_BALLS, name="clump")), BALLS),
    "box": (unit(vg.make_shape("box", lengths=(1.1, 0.9, 0.7))), PLANES),
    "octahedron": (unit(vg.make_shape("platonic", solid="octahedron")), PLANES),
    "ellipsoid": (unit(vg.make_shape("ellipsoid", aspect=(1.3, 1.0, 0.8))), GRID),
    "union": (unit(vg.make_shape("solid_union", seed=3)), GRID),
    "cone": (unit(vg.make_shape("cone")), GRID),
    "rod": (unit(vg.make_shape("spherocylinder")), GRID),
    "disk": (unit(vg.make_shape("disk")), BALLS),
    "polygon": (unit(vg.make_shape("polygon", seed=1)), PLANES),
}


def exact(shape, points):
    if getattr(shape.geometry, "kind", "") == "cone":
        return vg.Shape.from_mesh(shape.vertices, shape.faces).geometry.tree.signed_distance(points)
    mesh = getattr(shape.geometry, "tree", None)
    return mesh.signed_distance(points) if mesh is not None else -inner_distance(shape.geometry)(points)


def field_of(shape, cell=0.04, **keywords):
    return make_fields([shape], [np.asarray(sample_surface(shape, spacing=0.2))], cell=cell, **keywords)


def places(shape, many, wide, seed=0):
    points = (2 * np.random.Generator(np.random.Philox(seed)).random((many, 3)) - 1) * wide
    if shape.dimension == 2:
        points[:, 2] = 0.0
    return points


@pytest.mark.parametrize("name", SHAPES)
def test_kind_and_sign(name):
    shape, kind = SHAPES[name]
    fields, points = field_of(shape), places(shape, 4000, 0.9)
    told, true = distances(fields, 0, points), exact(shape, points)
    assert fields.head[0, 0] == kind
    sure = np.abs(true) > (0.02 if kind == GRID else 1e-12)
    assert ((told < 0) == (true < 0))[sure].all()
    assert (told <= true + (0.02 if kind == GRID else 1e-12))[true > 0].all()


@pytest.mark.parametrize("name", ["ellipsoid", "union", "cone"])
def test_far_away_it_is_no_more_than_the_distance(name):
    shape, _ = SHAPES[name]
    points = places(shape, 2000, 3.0)
    told, true = distances(field_of(shape), 0, points), exact(shape, points)
    assert (told <= true + 0.02)[true > 0].all()
    assert (told > 0)[np.linalg.norm(points, axis=1) > shape.bounding_radius].all()


def test_interpolation_is_of_second_order_where_the_surface_is_smooth():
    shape, _ = SHAPES["ellipsoid"]
    errors = [float(field_of(shape, cell=cell).error[0]) for cell in (0.16, 0.08, 0.04, 0.02)]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates.mean() > 1.6
    assert errors[2] < 1.5e-3


@pytest.mark.parametrize("name", SHAPES)
def test_values_change_no_faster_than_stated(name):
    """Pairs of near places outside: what a field tells of them differs by the steepest slope times the way at most."""
    shape, _ = SHAPES[name]
    fields, one = field_of(shape), places(shape, 20_000, 0.9)
    other = one + 0.01 * places(shape, 20_000, 1.0, seed=1)
    told = [distances(fields, 0, points) for points in (one, other)]
    outside = (told[0] > 0) & (told[1] > 0)
    way = np.linalg.norm(one - other, axis=1)
    assert 1.0 <= fields.head[0, STEEP] <= np.sqrt(3.0) * 1.001
    assert (np.abs(told[0] - told[1]) <= fields.head[0, STEEP] * way + 1e-9)[outside].all()


@pytest.mark.parametrize("name", ["box", "octahedron"])
def test_distances_that_are_asked_for_are_true_near_edges(name):
    """With a reach, flat bodies are sampled, so that places off edges and corners are as far away as they are."""
    shape, _ = SHAPES[name]
    fields = field_of(shape, cell=0.02, reach=0.2)
    points = places(shape, 4000, 0.8)
    vertices, faces, _ = shape.geometry.tessellation()
    true = vg.Shape.from_mesh(vertices, faces).geometry.tree.signed_distance(points)
    near = (true > 0.02) & (true < 0.2)
    assert fields.head[0, 0] == GRID
    assert np.abs(distances(fields, 0, points) - true)[near].max() < 4e-3


@pytest.mark.parametrize(
    ("name", "cell"), [("sphere", 0.04), ("box", 0.04), ("ellipsoid", 0.04), ("union", 0.04), ("union", 0.3)]
)
def test_search_finds_what_looking_at_all_points_finds(name, cell):
    """200 random poses: whether a point is near, and a slack that is no more than the true one."""
    shape, _ = SHAPES[name]
    points = np.asarray(sample_surface(shape, spacing=0.15))
    fields, trees = make_fields([shape], [points], cell=cell), make_trees([points])
    stack, plane = np.zeros((stack_room(trees), 2), dtype=np.int64), np.array([0.0, 0.0, 0.0, np.inf])
    generator, found = np.random.Generator(np.random.Philox(5)), 0
    for _ in range(200):
        turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn)) * 0.7
        shift = generator.normal(size=3)
        shift *= (0.4 + 0.9 * generator.random()) / np.linalg.norm(shift)
        told = distances(fields, 0, trees.points @ turn.T + shift)
        point, slack = find_near(trees, fields, 0, 0, (turn, shift, 0.7), 0.01, 0.05, plane, stack)
        assert (point >= 0) == bool((told < 0.01).any())
        if point >= 0:
            assert told[point] < 0.01
            found += 1
        else:
            assert slack <= min(told.min() - 0.01, 0.04) + 1e-12
            assert slack * fields.head[0, STEEP] >= min(told.min() - 0.01, 0.04) - 1e-12
    assert 20 < found < 180


@pytest.mark.parametrize("cell", [0.3, 0.1, 0.04])
def test_interpolated_distances_of_meshes_change_by_no_more_than_a_root(cell):
    """Also between places on the lattice and beyond it, where the steepest slope times the way is more."""
    shape, _ = SHAPES["union"]
    fields, one = field_of(shape, cell=cell), places(shape, 40_000, 1.2)
    lengths = 10.0 ** np.random.Generator(np.random.Philox(2)).uniform(-3, 0, len(one))
    other = one + lengths[:, None] * places(shape, len(one), 1.0, seed=1)
    told = [distances(fields, 0, points) for points in (one, other)]
    way = np.linalg.norm(one - other, axis=1)
    outside = (told[0] > 0) & (told[1] > 0)
    assert fields.head[0, ROUGH] == 0.75 * fields.head[0, 6] ** 2
    bound = np.sqrt(way**2 + fields.head[0, ROUGH])
    assert (np.abs(told[0] - told[1]) <= bound + SINGLE)[outside].all()
    assert (bound < fields.head[0, STEEP] * way)[outside].mean() > 0.1


def test_bodies_without_exact_distances_have_no_root():
    for name in ("ellipsoid", "cone"):
        assert field_of(SHAPES[name][0]).head[0, ROUGH] == np.inf
    for name in ("sphere", "box"):
        assert field_of(SHAPES[name][0]).head[0, ROUGH] == 0.0
