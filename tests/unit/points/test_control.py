"""Control points: on edges and corners beside the surface."""

import numpy as np
import pytest

import voxgran as vg
from voxgran.contacts.inside import inner_distance
from voxgran.points.control import edge_points, sample_controls
from voxgran.points.sample import sample_surface


def test_a_box_has_its_corners_and_points_along_its_edges():
    box = vg.make_shape("box", lengths=(1.0, 0.6, 0.4))
    half = np.array([0.5, 0.3, 0.2])
    points = edge_points(box.vertices, box.faces, 0.1)
    flush = (np.abs(np.abs(points) - half) < 1e-12).sum(axis=1)
    assert (flush >= 2).all()
    assert (flush == 3).sum() == 8
    # 4 edges of each length, cut into 10, 6 and 4
    assert len(points) == 8 + 4 * (9 + 5 + 3)


@pytest.mark.parametrize("solid", ["tetrahedron", "octahedron", "dodecahedron", "icosahedron"])
def test_edges_of_dice_are_covered(solid):
    die = vg.make_shape("platonic", solid=solid)
    points = edge_points(die.vertices, die.faces, 0.1 * die.diameter)
    near = np.linalg.norm(points[:, None] - die.vertices[None], axis=2).min(axis=0)
    assert near.max() < 1e-12
    depth = np.abs(vg.Shape.from_mesh(die.vertices, die.faces).geometry.tree.signed_distance(points))
    assert depth.max() < 1e-9


def test_a_cone_has_its_rim_and_its_tip():
    cone = vg.make_shape("cone")
    points = edge_points(cone.vertices, cone.faces, 0.1)
    radius, height = cone.geometry.dimensions
    axis = points @ cone.geometry.matrix
    tip = np.linalg.norm(axis - [0, 0, 0.75 * height], axis=1) < 1e-9
    assert tip.sum() == 1
    assert np.allclose(np.hypot(axis[~tip, 0], axis[~tip, 1]), radius, atol=2 * cone.tessellation_error)


def test_smooth_bodies_and_concave_edges_have_none():
    sphere = vg.make_shape("sphere")
    assert len(edge_points(sphere.vertices, sphere.faces, 0.1)) == 0
    # an L: of its 18 edges one is concave
    corners = np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)], dtype=float)
    bottom, top = (np.column_stack([corners, np.full(6, z)]) for z in (0.0, 1.0))
    caps = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    sides = [((k, (k + 1) % 6, 6 + (k + 1) % 6), (k, 6 + (k + 1) % 6, 6 + k)) for k in range(6)]
    faces = (
        [(c, b, a) for a, b, c in caps]
        + [(a + 6, b + 6, c + 6) for a, b, c in caps]
        + [f for pair in sides for f in pair]
    )
    points = edge_points(np.concatenate([bottom, top]), np.array(faces), 0.25)
    inner = (np.abs(points[:, :2] - 1.0) < 1e-9).all(axis=1) & (points[:, 2] > 0.1) & (points[:, 2] < 0.9)
    assert not inner.any()
    assert len(points) > 40


def test_an_ellipsoid_has_its_points_on_its_true_surface():
    body = vg.make_shape("ellipsoid", aspect=(1.4, 1.0, 0.7))
    points = np.asarray(sample_controls(body, spacing=0.2))
    level = (points @ body.geometry.matrix / np.array(body.geometry.dimensions)) ** 2
    assert np.allclose(level.sum(axis=1), 1.0, rtol=0, atol=1e-12)


def test_a_spherocylinder_has_its_points_on_its_true_surface():
    rod = vg.make_shape("spherocylinder", aspect=3)
    points = np.asarray(sample_controls(rod, spacing=0.2))
    assert np.abs(inner_distance(rod.geometry)(points)).max() < 1e-15


def test_sampled_surface_is_part_of_the_control_points():
    box = vg.make_shape("box")
    points, surface = sample_controls(box, spacing=0.2, seed=3), sample_surface(box, spacing=0.2, seed=3)
    assert points.spacing == surface.spacing
    assert np.array_equal(np.asarray(points)[-len(surface) :], np.asarray(surface))
