"""KD-trees as flat arrays: the same answers as SciPy's, and the layout that the kernels rely on."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from voxgran._base.errors import InputError
from voxgran._base.seeds import stream
from voxgran.geometry.rotation import random_rotations, rotation_matrices
from voxgran.packing.control_point.point_trees import LEAF, list_near, make_trees, stack_room

SIZES = (1, 2, 7, 8, 9, 17, 64, 100, 333, 1000)


def cloud(count, *index):
    """Return random points near a unit sphere, as control points are."""
    draw = stream(5, "cloud", count, *index)
    points = draw.standard_normal((count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * (0.8 + 0.2 * draw.random((count, 1)))


def node_points(trees, tree, level, k):
    """Return the points of a node."""
    n = trees.start[tree + 1] - trees.start[tree]
    return trees.points[trees.start[tree] + ((k * n) >> level) : trees.start[tree] + (((k + 1) * n) >> level)]


@pytest.mark.parametrize("count", SIZES)
def test_each_tree_holds_its_points_once(count):
    sets = [cloud(count), cloud(3, 1), cloud(count, 2)]
    trees = make_trees(sets)
    for k, points in enumerate(sets):
        held = trees.points[trees.start[k] : trees.start[k + 1]]
        assert np.array_equal(held[np.lexsort(held.T)], points[np.lexsort(points.T)])


@pytest.mark.parametrize("count", SIZES)
def test_children_share_the_points_of_their_node_and_spheres_hold_them(count):
    trees = make_trees([cloud(4), cloud(count)])
    for level in range(trees.depth[1] + 1):
        for k in range(2**level):
            part = node_points(trees, 1, level, k)
            sphere = trees.spheres[trees.first[1] + 2**level - 1 + k]
            assert np.linalg.norm(part - sphere[:3], axis=1).max() <= sphere[3]
            if level < trees.depth[1]:
                halves = [node_points(trees, 1, level + 1, 2 * k + side) for side in range(2)]
                assert np.array_equal(np.concatenate(halves), part)
    leaves = [len(node_points(trees, 1, trees.depth[1], k)) for k in range(2 ** trees.depth[1])]
    assert 1 <= min(leaves) <= max(leaves) <= LEAF


def test_a_node_is_cut_at_the_median_of_its_longest_axis():
    trees = make_trees([cloud(500)])
    for level in range(trees.depth[0]):
        for k in range(2**level):
            part = node_points(trees, 0, level, k)
            left, right = (node_points(trees, 0, level + 1, 2 * k + side) for side in range(2))
            axis = int((part.max(axis=0) - part.min(axis=0)).argmax())
            assert left[:, axis].max() <= right[:, axis].min()
            assert abs(len(left) - len(right)) <= 1


def near_rows(trees, turn, shift, scale, *, low, high, room=4000):
    """Return the pairs of points of trees 0 and 1 that the kernel lists, and up to where they are complete."""
    stack = np.zeros((stack_room(trees), 2), dtype=np.int64)
    found = np.zeros((room, 2), dtype=np.int64)
    count, complete = list_near(trees, 0, 1, (turn, shift, scale), low, high, stack, found)
    return count, complete, found[: max(count, 1)]


def poses(*index):
    draw = stream(2, "poses", *index)
    for matrix in rotation_matrices(random_rotations(draw, 100)):
        scale = 0.2 + 2 * draw.random()
        yield scale * matrix, 2 * (1 + scale) * (draw.random(3) - 0.5), scale


@pytest.mark.parametrize(("first", "second"), [(1, 1), (5, 300), (300, 5), (200, 333)])
def test_near_pairs_are_those_of_scipy(first, second):
    trees = make_trees([cloud(first), cloud(second, 1)])
    one, other = (trees.points[trees.start[k] : trees.start[k + 1]] for k in range(2))
    twin, answers = cKDTree(other), []
    for turn, shift, scale in poses(first, second):
        placed = one @ turn.T + shift
        nearest = twin.query(placed)[0].min()
        for high in (0.1, nearest * (1 - 1e-9), nearest * (1 + 1e-9)):
            count, complete, rows = near_rows(trees, turn, shift, scale, low=0.0, high=high)
            expected = {
                (i, first + j)
                for i, near in enumerate(twin.query_ball_point(placed, high))
                for j in near
                if np.linalg.norm(placed[i] - other[j]) < high
            }
            assert complete == high
            assert {tuple(row) for row in rows[:count].tolist()} == expected
            answers.append(count > 0)
    assert 0 < sum(answers) < len(answers)


def test_a_pair_that_is_too_near_ends_the_walk():
    trees = make_trees([cloud(200), cloud(333, 1)])
    one, other = (trees.points[trees.start[k] : trees.start[k + 1]] for k in range(2))
    twin, ended = cKDTree(other), 0
    for turn, shift, scale in poses(7):
        placed = one @ turn.T + shift
        nearest = twin.query(placed)[0].min()
        count, _, rows = near_rows(trees, turn, shift, scale, low=0.1, high=0.2)
        assert (count == -1) == (nearest < 0.1)
        if count == -1:
            i, j = rows[0]
            assert np.linalg.norm(placed[i] - other[j - 200]) < 0.1
            ended += 1
    assert ended > 10


def test_a_full_list_says_up_to_where_it_is_complete():
    trees = make_trees([cloud(200), cloud(333, 1)])
    one, other = (trees.points[trees.start[k] : trees.start[k + 1]] for k in range(2))
    turn, shift = np.eye(3), np.array([1.6, 0.0, 0.0])
    count, complete, rows = near_rows(trees, turn, shift, 1.0, low=0.0, high=1.0, room=20)
    apart = np.linalg.norm((one + shift)[:, None] - other[None], axis=2)
    assert complete < 1.0
    assert 0 < count <= 20
    expected = {(int(i), 200 + int(j)) for i, j in np.argwhere(apart < complete)}
    assert {tuple(row) for row in rows[:count].tolist()} >= expected


def test_an_empty_set_is_refused():
    with pytest.raises(InputError, match="set 1 has 0 points: a tree needs at least 1"):
        make_trees([cloud(3), np.zeros((0, 3))])
