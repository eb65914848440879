import itertools

import numpy as np
import pytest

from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.geometry.tree import grow_tree
from voxgran.geometry.triangles import closest_on_triangle
from voxgran.shapes.tessellate import revolved, sphere, unit_box


def shell_with_cavity():
    """A cube of edge 2 with a cubic cavity of edge 1, moved off the middle."""
    vertices, faces, _ = unit_box()
    return np.concatenate([2 * vertices, vertices + 0.1]), np.concatenate([faces, faces[:, ::-1] + 8])


MESHES = {
    "sphere": sphere(2)[:2],
    "box": unit_box()[:2],
    "cone": revolved([(-0.25, 0.5), (0.75, 0.0)], sides=24)[:2],
    "cavity": shell_with_cavity(),
}


def winding_numbers(triangles, points):
    """How often a surface winds around points: the sum of solid angles (van Oosterom & Strackee 1983)."""
    a, b, c = np.moveaxis(triangles[None] - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))
    volume = np.einsum("pfi,pfi->pf", a, np.cross(b, c))
    dots = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return np.arctan2(volume, dots).sum(axis=1) / (2 * np.pi)


def brute_distance(triangles, points):
    """Distance from all triangles: their planes where the foot lies inside, else their edges."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    best = np.full(len(points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        along = q - p
        share = np.clip(((points[:, None] - p) * along).sum(-1) / (along**2).sum(-1), 0, 1)
        best = np.minimum(best, np.linalg.norm(points[:, None] - p - share[..., None] * along, axis=-1).min(axis=1))
    normal = np.cross(b - a, c - a)
    height = ((points[:, None] - a) * normal).sum(-1) / (normal**2).sum(-1)
    foot = points[:, None] - height[..., None] * normal
    inside = np.ones(height.shape, dtype=bool)
    for p, q in ((a, b), (b, c), (c, a)):
        inside &= (np.cross(q - p, foot - p) * normal).sum(-1) >= 0
    level = np.where(inside, np.abs(height) * np.linalg.norm(normal, axis=1), np.inf).min(axis=1)
    return np.minimum(best, level)


@pytest.mark.parametrize("name", MESHES)
def test_signed_distance_equals_all_triangles_and_the_winding_number(name):
    vertices, faces = MESHES[name]
    tree = grow_tree(vertices, faces)
    points = stream(1, "tree").uniform(-1.5, 1.5, (300, 3))
    distance, nearest, triangle = tree.nearest(points)
    triangles = vertices[faces]
    np.testing.assert_allclose(np.abs(distance), brute_distance(triangles, points), atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(points - nearest, axis=1), np.abs(distance), atol=1e-14)
    np.testing.assert_array_equal(distance < 0, winding_numbers(triangles, points) > 0.5)
    np.testing.assert_array_equal(tree.corners[triangle], triangles[tree.face[triangle]])


@pytest.mark.parametrize("name", MESHES)
def test_the_sign_holds_a_hair_from_corners_and_edges(name):
    vertices, faces = MESHES[name]
    generator = stream(2, "tree")
    features = np.concatenate([vertices, vertices[faces[:, :2]].mean(axis=1)])
    points = np.repeat(features, 10, axis=0) + 1e-9 * generator.normal(size=(10 * len(features), 3))
    inside = winding_numbers(vertices[faces], points) > 0.5
    np.testing.assert_array_equal(grow_tree(vertices, faces).signed_distance(points) < 0, inside)


def test_every_triangle_is_in_one_leaf_and_every_box_holds_its_triangles():
    vertices, faces = MESHES["sphere"]
    tree = grow_tree(vertices, faces)
    leaves = tree.start[len(tree.start) // 2 :]
    assert leaves[0, 0] == 0
    assert leaves[-1, 1] == len(faces)
    np.testing.assert_array_equal(leaves[1:, 0], leaves[:-1, 1])
    np.testing.assert_array_equal(np.sort(tree.face), np.arange(len(faces)))
    for (first, last), low, high in zip(tree.start, tree.low, tree.high, strict=True):
        assert (tree.corners[first:last].min(axis=(0, 1)) == low).all()
        assert (tree.corners[first:last].max(axis=(0, 1)) == high).all()


def test_nothing_is_found_beyond_reach():
    tree = grow_tree(*MESHES["box"])
    distance, nearest, triangle = tree.nearest(np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 0.75]]), reach=0.5)
    np.testing.assert_array_equal(distance, [np.inf, 0.25])
    np.testing.assert_array_equal(nearest, [[0, 0, 2], [0, 0, 0.5]])
    assert triangle[0] == -1


def test_scaling_by_a_power_of_two_changes_no_digit():
    vertices, faces = MESHES["cone"]
    points = stream(3, "tree").uniform(-1, 1, (100, 3))
    small, large = grow_tree(vertices, faces), grow_tree(vertices * 2.0**40, faces)
    np.testing.assert_array_equal(small.signed_distance(points) * 2.0**40, large.signed_distance(points * 2.0**40))


def test_closest_point_of_a_triangle_equals_a_fine_sampling():
    generator = stream(4, "tree")
    turns = rotation_matrices(random_rotations(generator, 50))
    u, v = np.meshgrid(np.linspace(0, 1, 201), np.linspace(0, 1, 201))
    share = np.column_stack([1 - u.ravel(), u.ravel() * (1 - v.ravel()), u.ravel() * v.ravel()])
    for turn in turns:
        corners = generator.normal(size=(1, 3, 3)) @ turn
        point = 2 * generator.normal(size=3)
        x, y, z, feature = closest_on_triangle(corners, 0, *point)
        sampled = np.linalg.norm(share @ corners[0] - point, axis=1).min()
        exact = np.linalg.norm(point - [x, y, z])
        assert exact <= sampled + 1e-14
        assert exact >= sampled - 0.05
        assert 0 <= feature <= 6


def numpy_order(middles, depth):
    """Return triangles in the order of the tree: boxes are halved at the median along their longest axis, stably."""
    order, count = np.arange(len(middles)), len(middles)
    for level in range(depth):
        edges = (count * np.arange(2**level + 1)) >> level
        parts = [order[first:last] for first, last in itertools.pairwise(edges)]
        axes = [np.ptp(middles[part], axis=0).argmax() for part in parts]
        order = np.concatenate(
            [part[np.argsort(middles[part, axis], kind="stable")] for part, axis in zip(parts, axes, strict=True)]
        )
    return order


@pytest.mark.parametrize("name", [*MESHES, "lattice"])
def test_the_order_and_the_normals_equal_those_of_numpy(name):
    """Middles on a lattice tie, as those of labels do."""
    vertices, faces = (np.round(4 * MESHES["sphere"][0]), MESHES["sphere"][1]) if name == "lattice" else MESHES[name]
    tree, corners = grow_tree(vertices, faces), vertices[faces]
    np.testing.assert_array_equal(tree.face, numpy_order(corners.mean(axis=1), (len(tree.start)).bit_length() - 1))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    edges, points = {}, np.zeros_like(vertices)
    for face, corner, one in zip(faces, corners, normal, strict=True):
        for k in range(3):
            u, v = corner[(k + 1) % 3] - corner[k], corner[(k + 2) % 3] - corner[k]
            points[face[k]] += one * np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v)
            edges[frozenset(face[[k, (k + 1) % 3]])] = edges.get(frozenset(face[[k, (k + 1) % 3]]), 0) + one
    found = np.empty_like(tree.normals)
    found[tree.face] = tree.normals
    np.testing.assert_allclose(found[:, 0], normal, atol=1e-12)
    np.testing.assert_allclose(
        found[:, 1:4], [[edges[frozenset(f[[k, k - 2]])] for k in range(3)] for f in faces], atol=1e-12
    )
    np.testing.assert_allclose(found[:, 4:], points[faces], atol=1e-12)
