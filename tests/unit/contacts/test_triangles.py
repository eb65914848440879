"""Nearest points of two surfaces are those of all pairs of their triangles."""

import math

import numpy as np
import pytest
from kit import slow

from voxgran._base.seeds import stream
from voxgran.contacts.triangles import nearest_points, turned_bound
from voxgran.containers.kinds.box import Box
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.geometry.tree import grow_tree
from voxgran.geometry.triangles import plane_gap, triangle_distance
from voxgran.packing.model import Packing
from voxgran.shapes.family import make_shape


def poses(count):
    """Return matrices that turn and stretch, and directions, in pairs."""
    draw = stream(3, "poses")
    turns = rotation_matrices(random_rotations(draw, 2 * count))
    return [(turns[k] * factor, turns[count + k, 0]) for k, factor in enumerate(draw.uniform(0.5, 2.0, count))]


def tree_of(family, seed=0):
    """Return the box tree of a random solid."""
    return make_shape(family, seed=seed).geometry.tree


@pytest.mark.slow
@pytest.mark.parametrize("reach", [slow(0.02), 0.5, slow(math.inf)])
def test_no_triangles_of_random_solids_are_nearer_than_the_nearest_points(reach, monkeypatch):
    one, other, points = tree_of("solid_union"), tree_of("solid_union", 1), np.zeros(6)
    some = np.linspace(0, len(one.corners) - 1, 20, dtype=int)
    for number, (matrix, way) in enumerate(poses(6)):
        # half of the searches are by boxes that are turned
        monkeypatch.setattr("voxgran.geometry.tree.TURNED", 1 if number % 2 else 16)
        for distance in (0.2, 0.3, 0.45):
            offset = distance * (one.size + other.size) * way
            turned = np.ascontiguousarray(other.corners @ matrix.T + offset)
            found, mine, theirs = nearest_points(one, other, matrix=matrix, offset=offset, reach=reach)
            every = min(triangle_distance(one.corners, i, turned, j, points) for i in some for j in range(len(turned)))
            assert found <= math.sqrt(every) * (1 + 1e-12) or math.sqrt(every) > reach
            if math.isfinite(found):
                assert found <= reach
                assert found == pytest.approx(float(np.linalg.norm(mine - theirs)), abs=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_distance_of_polyhedra_is_the_smallest_of_all_pairs(seed, monkeypatch):
    one, other, points = tree_of("polyhedron", seed), tree_of("polyhedron", seed + 10), np.zeros(6)
    for matrix, way in poses(5):
        offset = 0.55 * (one.size + other.size) * way
        turned = np.ascontiguousarray(other.corners @ matrix.T + offset)
        pairs = [(i, j) for i in range(len(one.corners)) for j in range(len(turned))]
        square = min(triangle_distance(one.corners, i, turned, j, points) for i, j in pairs)
        for turned_from in (1, 16):
            monkeypatch.setattr("voxgran.geometry.tree.TURNED", turned_from)
            found = nearest_points(one, other, matrix=matrix, offset=offset)[0]
            assert found == pytest.approx(math.sqrt(square), rel=1e-12)
        # a plane bounds the distance from below
        for i, j in pairs[:: len(pairs) // 40]:
            assert plane_gap(one.corners, i, turned, j) <= triangle_distance(one.corners, i, turned, j, points) + 1e-14


def test_the_plane_of_a_sliver_bounds_nothing():
    sliver = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 1e-4, 0]]])
    above = np.array([0.0, 0.0, 2.0])
    assert plane_gap(sliver, 0, sliver + above, 0) == 0.0
    sliver[0, 2] = [0, 1, 0]
    assert plane_gap(sliver, 0, sliver + above, 0) == pytest.approx(4.0)


@pytest.mark.parametrize("family", ["polyhedron", "solid_union", "box"])
def test_turned_boxes_hold_their_triangles_and_are_no_larger_than_straight_ones(family):
    shape = make_shape(family, seed=0)
    tree = grow_tree(shape.vertices, shape.faces)
    for (first, last), (middle, *axes, half) in zip(tree.start, tree.boxes, strict=True):
        points = tree.corners[first:last].reshape(-1, 3)
        assert np.asarray(axes) @ np.transpose(axes) == pytest.approx(np.eye(3), abs=1e-14)
        assert (np.abs((points - middle) @ np.transpose(axes)) <= half + 1e-14).all()
        edges = [2 * half, np.ptp(points, axis=0)]
        turned, straight = (float((edge * np.roll(edge, 1)).sum()) for edge in edges)
        assert turned <= straight * (1 + 1e-12)


def test_turned_boxes_bound_the_distance_of_what_they_hold():
    one, other, draw, close = tree_of("solid_union"), tree_of("solid_union", 1), stream(9, "nodes"), []
    for matrix, way in poses(40):
        offset, factor = 0.3 * (one.size + other.size) * way, float(np.linalg.norm(matrix[:, 0]))
        for a, b in draw.integers(1, len(one.start) // 4, (20, 2)):
            mine = one.corners[slice(*one.start[a])].reshape(-1, 3)
            theirs = other.corners[slice(*other.start[b])].reshape(-1, 3) @ matrix.T + offset
            bound, apart = turned_bound(one.boxes, a, other.boxes, b, matrix, factor, offset)
            square = np.square(mine[:, None] - theirs).sum(axis=2).min()
            assert bound <= square * (1 + 1e-12)
            close.append(bound / square)
            middle = matrix @ other.boxes[b, 0] + offset - one.boxes[a, 0]
            assert apart == pytest.approx(float(middle @ middle))
    assert np.quantile(close, 0.75) > 0.7


@pytest.mark.parametrize("family", ["sphere", slow("polyhedron")])
def test_contacts_of_a_smaller_gap_are_taken_from_those_of_a_larger_one(family):
    place = stream(1, "places").uniform(0.0, 4.0, (60, 3))
    grains = [make_shape(family, seed=0)], Box((4, 4, 4), periodic="xyz")
    one, other = (Packing.of(*grains, position=place) for _ in range(2))
    many = one.contacts(0.3).count
    found, wanted = one.contacts(0.05), other.contacts(0.05)
    assert 0 < found.count < many
    for name in ("i", "j", "image", "gap", "normal"):
        assert getattr(found, name) == pytest.approx(getattr(wanted, name), abs=1e-12)


def test_boxes_do_not_depend_on_former_searches():
    tree = make_shape("solid_union", seed=3).geometry.tree
    few = tree.boxes_for(1)
    assert tree.boxes_for(100) is tree.boxes
    assert tree.boxes_for(1) is few is not tree.boxes
