"""Factors of the frontal method, against dense matrices."""

import numpy as np
import pytest

from voxgran.settling import interior_point


@pytest.mark.parametrize("d", [1, 3, 6])
@pytest.mark.parametrize("group", [1, 40, 10_000])
def test_solutions_are_those_of_the_dense_matrix(monkeypatch, d, group):
    """Rows that couple bodies at random, a body to itself or to none; any order of elimination."""
    monkeypatch.setattr(interior_point, "GROUP", group)
    generator = np.random.default_rng(d)
    count, many = 50, 160
    i, j = generator.integers(0, count, many), generator.integers(-1, count, many)
    j[:3] = i[:3]
    values = generator.normal(size=(many, 2, d))
    jacobian = np.zeros((many, count, d))
    for k in range(many):
        jacobian[k, i[k]] += values[k, 0]
        if j[k] >= 0:
            jacobian[k, j[k]] += values[k, 1]
    jacobian = jacobian.reshape(many, -1)
    matrix = interior_point.FrontalMatrix(i, j, values, generator.permutation(count))
    right = generator.normal(size=count * d)
    for scale in (1.0, 1e3):
        weights = scale * generator.random(many)
        assert matrix.factorize(weights)
        dense = np.eye(count * d) + jacobian.T @ (weights[:, None] * jacobian)
        np.testing.assert_allclose(matrix.solve(right), np.linalg.solve(dense, right), rtol=1e-8, atol=1e-10)


def test_weights_without_a_factor_are_told():
    one = np.zeros(1, dtype=np.int64)
    matrix = interior_point.FrontalMatrix(one, one - 1, np.ones((1, 2, 1)), one)
    assert not matrix.factorize(np.array([-2.0]))
