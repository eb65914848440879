"""Frictionless forces: against non-negative least squares, the conditions of the optimum, and closed formulas."""

import numpy as np
import pytest
from scipy.optimize import nnls

from voxgran.settling.balance import LoadedContacts
from voxgran.settling.interior_point import frictionless_forces

DOWN = np.array([0.0, 0.0, -1.0])


def heap(seed, *, count=40, round_grains=True, lid=0.0):
    """Return rows, i, j and bodies of grains with random neighbours, floor and lid; see the solvers with friction."""
    generator = np.random.default_rng(seed)
    position = generator.random((count, 3)) * 4.0
    i, j, normal = [], [], []
    for one in range(count):
        for other in np.argsort(np.linalg.norm(position - position[one], axis=1))[1:4].tolist():
            way = position[other] - position[one]
            i, j, normal = [*i, one], [*j, other], [*normal, way / np.linalg.norm(way)]
        if one % 3 == 0:
            i, j, normal = [*i, one], [*j, -1 if one % 2 else count], [*normal, DOWN if one % 2 else -DOWN]
    row, i, j = np.zeros((len(i), 16)), np.array(i), np.array(j)
    row[:, :3] = normal
    row[:, 3:6] = 0.5 * row[:, :3]
    row[:, 6:9] = -0.5 * row[:, :3]
    if not round_grains:
        row[:, 3:9] += 0.2 * generator.normal(size=(len(i), 6))
    row[(j < 0) | (j == count), 6:9] = 0.0
    bodies = np.zeros((count + 1, 8))
    bodies[:-1, 6] = generator.uniform(0.5, 2.0, count)
    bodies[:-1, 7] = bodies[:-1, 6] / 0.1
    bodies[-1, 6] = lid
    return row, i, j, bodies


def normal_jacobian(row, i, j, bodies):
    """Return how fast gaps open, (m, 6 (n + 1)), by the motions of the bodies."""
    many, last = len(row), len(bodies) - 1
    matrix = np.zeros((many, last + 1, 6))
    for k in range(many):
        n = row[k, :3]
        matrix[k, i[k]] -= np.concatenate([n, np.cross(row[k, 3:6], n)])
        if j[k] == last:
            matrix[k, last, :3] += (n @ DOWN) * DOWN
        elif j[k] >= 0:
            matrix[k, j[k]] += np.concatenate([n, np.cross(row[k, 6:9], n)])
    return matrix.reshape(many, -1)


def solve(heap_of, accuracy=1e-7):
    return frictionless_forces(LoadedContacts(*heap_of, DOWN), accuracy=accuracy)


@pytest.mark.parametrize("lid", [0.0, 0.2])
@pytest.mark.parametrize("round_grains", [True, False])
def test_residuals_are_those_of_non_negative_least_squares(round_grains, lid):
    one = heap(1, round_grains=round_grains, lid=lid)
    _, _, _, bodies = one
    force, found, _ = solve(one)
    inverse = np.repeat(bodies[:, 6:8], 3, axis=1).ravel()
    free = np.hstack([np.where(bodies[:, 6:7] > 0, DOWN, 0), np.zeros((len(bodies), 3))]).ravel()
    root, matrix = np.sqrt(inverse), normal_jacobian(*one)
    pull = free / np.where(root > 0, root, np.inf)
    least = nnls((matrix * root).T, -pull, maxiter=10_000)[0]
    expected = free + inverse * (matrix.T @ least)
    np.testing.assert_allclose(found.ravel(), expected, atol=1e-5)
    np.testing.assert_allclose(free + inverse * (matrix.T @ force), expected, atol=1e-5)
    assert np.abs(expected).max() > 0.05


@pytest.mark.parametrize("round_grains", [True, False])
def test_no_contact_approaches_or_pulls(round_grains):
    one = heap(2, round_grains=round_grains, lid=0.5)
    force, found, _ = solve(one)
    room = normal_jacobian(*one) @ found.ravel()
    assert force.min() >= 0.0
    assert room.min() >= -1e-6
    assert (force * room).max() <= 1e-6
    assert (force > 1e-3).any()
    assert (room > 1e-3).any()


def test_a_column_of_a_thousand_grains():
    """Each contact carries all that lies above it."""
    count = 1000
    row, i, j = np.zeros((count, 16)), np.arange(count), np.arange(count) - 1
    row[:, :3] = DOWN
    row[:, 3:6], row[:, 6:9] = 0.5 * DOWN, -0.5 * DOWN
    bodies = np.zeros((count + 1, 8))
    bodies[:-1, 6:] = 1.0, 10.0
    force, found, made = solve((row, i, j, bodies), accuracy=1e-6)
    np.testing.assert_allclose(force, np.arange(count, 0, -1), rtol=1e-4)
    assert np.abs(found).max() < 1e-5
    assert made < 40


def test_without_contacts_all_falls():
    bodies = np.zeros((3, 8))
    bodies[:2, 6:] = 1.0, 10.0
    none = np.zeros(0, dtype=np.int64)
    force, found, made = solve((np.zeros((0, 16)), none, none, bodies))
    assert force.shape == (0,)
    np.testing.assert_array_equal(found[:, :3], [DOWN, DOWN, 0 * DOWN])
    assert made == 0
