"""Triangles against cubes, proven by linear programs; distances, by constrained least squares."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog, nnls

from voxgran._base.seeds import stream
from voxgran.lattice.grid import Grid
from voxgran.voxels.touch import near_centers, touched_voxels

UNIT = Grid((0.0, 0.0, 0.0), 1.0, (4, 4, 4))
ONE = np.array([[0, 1, 2]])


def depth(triangle, low):
    """Return by how much a triangle and the cube at `low` may shrink or must grow to touch: a linear program.

    Weights of the corners w >= 0 with sum 1, and the least g with low - g <= sum w_i p_i <= low + 1 + g.
    """
    upper = np.column_stack([triangle.T, -np.ones(3)])
    lower = np.column_stack([-triangle.T, -np.ones(3)])
    found = linprog(
        [0, 0, 0, 1],
        A_ub=np.concatenate([upper, lower]),
        b_ub=np.concatenate([low + 1, -low]),
        A_eq=[[1, 1, 1, 0]],
        b_eq=[1],
        bounds=[(0, None)] * 3 + [(None, None)],
    )
    return found.fun


def check(triangle, grid=UNIT):
    mask = touched_voxels(triangle, ONE, grid).unpacked()
    for voxel in np.argwhere(np.ones(grid.shape)):
        gap = depth(triangle, voxel)
        if abs(gap) > 1e-6:
            assert mask[tuple(voxel)] == (gap < 0), (triangle.tolist(), voxel, gap)
    return mask


@pytest.mark.parametrize("index", range(8))
def test_random_triangles(index):
    check(stream(3, "triangles", index).uniform(-1, 5, (3, 3)))


@pytest.mark.parametrize("index", range(4))
def test_slivers_and_segments(index):
    generator = stream(4, "slivers", index)
    a, b = generator.uniform(-1, 5, (2, 3))
    middle = a + (b - a) * generator.random() + generator.normal(size=3) * 10.0 ** (-4 * index)
    check(np.array([a, b, middle if index < 3 else (a + b) / 2]))


def test_a_face_between_voxels_touches_both_sides():
    triangle = np.array([[0.25, 0.25, 2.0], [0.75, 0.25, 2.0], [0.25, 0.75, 2.0]])
    assert np.argwhere(touched_voxels(triangle, ONE, UNIT).unpacked()).tolist() == [[0, 0, 1], [0, 0, 2]]


def test_a_corner_on_a_lattice_point_touches_eight_voxels():
    point = np.array([[2.0, 2.0, 2.0]] * 3)
    assert touched_voxels(point, ONE, UNIT).count() == 8
    assert touched_voxels(point, ONE, UNIT).unpacked()[1:3, 1:3, 1:3].all()


def test_large_faces_take_the_cubes_near_their_plane():
    # the same plane once in two large faces, once in many small ones
    corners = np.array([[-3.0, -2.0, 1.3], [20.0, -4.0, 14.1], [21.0, 19.0, 3.2], [-2.0, 21.0, -9.6]])
    corners[3] = corners[0] + corners[2] - corners[1]
    grid = Grid((0.0, 0.0, 0.0), 1.0, (17, 16, 15))
    large = touched_voxels(corners, np.array([[0, 1, 2], [0, 2, 3]]), grid).unpacked()
    steps = np.linspace(0, 1, 65)
    u, v = np.meshgrid(steps, steps, indexing="ij")
    net = corners[0] + u[..., None] * (corners[1] - corners[0]) + v[..., None] * (corners[3] - corners[0])
    index = np.arange(65 * 65).reshape(65, 65)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    assert large.any()
    assert np.array_equal(large, touched_voxels(net.reshape(-1, 3), faces, grid).unpacked())


@given(st.lists(st.integers(-2, 10), min_size=9, max_size=9))
def test_no_touched_voxel_is_missed_on_whole_and_half_coordinates(numbers):
    triangle = np.array(numbers, dtype=float).reshape(3, 3) / 2
    mask = touched_voxels(triangle, ONE, UNIT).unpacked()
    # every point of the triangle lies in closed cubes, and all of these are touched
    weights = np.array([(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)]) / 6
    for point in weights @ triangle:
        for voxel in np.ndindex(mask.shape):
            low = np.array(voxel)
            if (low <= point).all() and (point <= low + 1).all():
                assert mask[voxel]


def test_distances_of_near_centers():
    generator = stream(5, "near")
    vertices = generator.uniform(0, 6, (12, 3))
    faces = generator.permutation(12).reshape(4, 3)
    grid = Grid((0.0, 0.0, 0.0), 0.5, (12, 12, 12))
    indices, distance = near_centers(vertices, faces, grid, 0.8)
    expected = np.full(grid.shape, np.inf)
    for voxel in np.ndindex(grid.shape):
        center = grid.coordinates(np.array([voxel]))[0]
        for face in faces:
            # least squares over weights that are not negative; the last row holds their sum at 1
            rows = np.vstack([vertices[face].T, np.full(3, 1e4)])
            expected[voxel] = min(expected[voxel], nnls(rows, np.array([*center, 1e4]))[1] / 0.5)
    inside = np.argwhere(expected <= 0.8)
    assert np.array_equal(indices, inside)
    assert np.allclose(distance, expected[tuple(inside.T)], atol=1e-5)
