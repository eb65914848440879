"""Products and small linear algebra against NumPy's, to rounding, and the same bits on both of their paths."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxgran._base.arithmetic import linear
from voxgran._base.seeds import stream

ROUNDING = 1e-12


def numbers(*shape, seed=0):
    return stream(seed, "linear").normal(size=shape)


def without_numba(monkeypatch):
    monkeypatch.setattr(linear, "numba_is_loaded", lambda: False)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ((3,), (3,)),
        ((3, 3), (3,)),
        ((3,), (3, 5)),
        ((7, 3), (3, 3)),
        ((7, 4), (4, 2)),
        ((6, 3, 3), (3, 2)),
        ((6, 3, 3), (6, 3, 3)),
        ((2, 1, 4, 3), (5, 3, 3)),
        ((4, 300), (300,)),
        ((300,), (300,)),
        ((5, 40), (40, 6)),
        ((0, 3), (3, 3)),
        ((4, 0), (0, 2)),
        ((0, 3), (3,)),
    ],
)
def test_products_are_those_of_numpy_by_both_paths(one, other, monkeypatch):
    a, b = numbers(*one), numbers(*other, seed=1)
    found = linear.matmul(a, b)
    assert np.shape(found) == (a @ b).shape
    assert found == pytest.approx(a @ b, abs=ROUNDING)
    without_numba(monkeypatch)
    assert np.array_equal(linear.matmul(a, b), found)


def test_products_of_whole_numbers_stay_whole():
    many = np.arange(6).reshape(2, 3)
    assert linear.matmul(many, [2, 1, 2**40]).dtype == np.int64
    assert linear.matmul(many, [2, 1, 2**40]).tolist() == [1 + 2 * 2**40, 6 + 4 + 5 * 2**40]


def test_matrices_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="3 columns and 4 rows"):
        linear.matmul(np.ones((2, 3)), np.ones((4, 2)))


def test_products_do_not_depend_on_how_many_are_made_at_once_nor_on_strides():
    a, b = numbers(50, 3), numbers(3, 3, seed=1)
    whole = linear.matmul(a, b)
    assert np.array_equal(whole, np.concatenate([linear.matmul(row[None], b) for row in a]))
    assert np.array_equal(whole, linear.matmul(np.asfortranarray(a), b.T.copy().T))
    stack = numbers(20, 3, 3, seed=2)
    assert np.array_equal(linear.matmul(stack, b), [linear.matmul(one, b) for one in stack])


@pytest.mark.parametrize("axis", [None, 0, 1, -1])
@pytest.mark.parametrize("width", [1, 2, 3, 4, 9])
def test_norms(axis, width):
    values = numbers(5, width)
    assert linear.norm(values, axis) == pytest.approx(np.linalg.norm(values, axis=axis), abs=ROUNDING)
    kept = linear.norm(values, axis, keepdims=True)
    assert kept == pytest.approx(np.linalg.norm(values, axis=axis, keepdims=True), abs=ROUNDING)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_determinants(size):
    matrices = numbers(8, size, size)
    assert linear.determinant(matrices) == pytest.approx(np.linalg.det(matrices), abs=ROUNDING)


@given(st.integers(1, 12), st.integers(0, 1000))
def test_solutions_solve(size, seed):
    matrix, right = numbers(size, size, seed=seed), numbers(size, 2, seed=seed + 1)
    found = linear.solve(matrix, right)
    size_of = np.abs(matrix).max() * np.abs(found).max() + np.abs(right).max()
    assert np.abs(matrix @ found - right).max() < 1e-13 * size * size_of
    assert np.array_equal(linear.solve(matrix, right[:, 0]), linear.solve(matrix, right[:, :1])[:, 0])


def test_solutions_of_stacks_and_inverses():
    matrices = numbers(9, 3, 3)
    assert linear.inverse(matrices) == pytest.approx(np.linalg.inv(matrices), rel=1e-9)
    assert np.array_equal(linear.inverse(matrices)[4], linear.inverse(matrices[4]))
    # a pivot of 0 is no obstacle, and a matrix without an inverse gives no number
    assert linear.inverse([[0.0, 2.0], [1.0, 0.0]]).tolist() == [[0.0, 1.0], [0.5, 0.0]]
    with np.errstate(all="ignore"):
        assert not np.isfinite(linear.inverse(np.zeros((2, 2)))).any()


@given(st.integers(1, 9), st.integers(0, 1000), st.sampled_from([1e-150, 1e-3, 1.0, 1e120]))
def test_eigenvectors_make_a_symmetric_matrix_diagonal(size, seed, scale):
    matrix = numbers(size, size, seed=seed)
    matrix = scale * (matrix + matrix.T)
    values, vectors = linear.eigh(matrix)
    assert (np.diff(values) >= 0).all()
    assert vectors.T @ vectors == pytest.approx(np.eye(size), abs=1e-13)
    assert matrix @ vectors / scale == pytest.approx(vectors * values / scale, abs=1e-13 * size)
    assert (np.take_along_axis(vectors, np.abs(vectors).argmax(axis=0)[None], axis=0) > 0).all()


def test_eigenvalues_of_graded_matrices_keep_their_digits():
    # LAPACK loses the small ones, of the order of rounding of the largest one
    small = np.array([1.0, 1e-8, 1e-16])
    matrix = np.diag(small) + 1e-3 * np.sqrt(small[:, None] * small) * (1 - np.eye(3))
    values = linear.eigh(matrix)[0]
    exact = [9.99999e-17, 1.0e-8, 1.0]
    assert values == pytest.approx(exact, rel=3e-6)


def test_stacks_of_matrices_are_diagonalized_one_by_one(monkeypatch):
    matrices = numbers(6, 3, 3)
    matrices = matrices + matrices.transpose(0, 2, 1)
    values, vectors = linear.eigh(matrices)
    without_numba(monkeypatch)
    for k, matrix in enumerate(matrices):
        one = linear.eigh(matrix)
        assert np.array_equal(one[0], values[k])
        assert np.array_equal(one[1], vectors[k])


@given(st.integers(1, 8), st.integers(1, 8), st.integers(0, 1000))
def test_singular_values_are_those_of_numpy(rows, columns, seed):
    matrix = numbers(rows, columns, seed=seed)
    u, values, v = linear.svd(matrix)
    assert u * values @ v == pytest.approx(matrix, abs=1e-13 * max(rows, columns))
    assert values == pytest.approx(np.linalg.svd(matrix)[1], abs=1e-13)
    assert v @ v.T == pytest.approx(np.eye(len(values)), abs=1e-13)
    assert u.T @ u == pytest.approx(np.eye(len(values)), abs=1e-13)


def test_points_in_a_plane_have_a_singular_value_of_rounding():
    points = numbers(200, 2) @ numbers(2, 3, seed=1)
    _, values, v = linear.svd(points - points.mean(axis=0))
    assert values[2] < 1e-14 * values[0]
    assert np.abs((points - points.mean(axis=0)) @ v[2]).max() < 1e-14 * values[0]


def test_pseudoinverses():
    for matrix in (numbers(5, 3), numbers(3, 5), numbers(4, 1) @ numbers(1, 4, seed=1)):
        assert linear.pseudoinverse(matrix) == pytest.approx(np.linalg.pinv(matrix, rcond=1e-14), abs=1e-12)


@pytest.mark.parametrize("direction", [[1, 0, 0], [0, -1, 0], [0, 0, 1], [0.6, 0, -0.8], [0.36, 0.48, 0.8], [0, 1]])
def test_what_lies_across_a_direction_makes_a_right_handed_frame(direction):
    frame = np.vstack([linear.across(direction), direction])
    assert frame @ frame.T == pytest.approx(np.eye(len(direction)), abs=1e-15)
    assert len(direction) == 2 or np.linalg.det(frame) == pytest.approx(1.0)


def test_nearest_rotations_turn_points_back():
    turn = linear.nearest_rotations(numbers(3, 3, seed=4))
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    for points in (numbers(8, 3), numbers(8, 3) * [1, 1, 0], numbers(8, 3) * [1, 0, 0]):
        moved = points @ turn.T
        found = linear.nearest_rotations(moved.T @ points)
        assert points @ found.T == pytest.approx(moved, abs=1e-13)
        assert np.linalg.det(found) == pytest.approx(1.0)
    # of mirrored points the nearest one is still a rotation
    assert np.linalg.det(linear.nearest_rotations(np.diag([2.0, 1.0, -0.5]))) == pytest.approx(1.0)
    assert linear.nearest_rotations(np.diag([2.0, 1.0, -0.5])) == pytest.approx(np.eye(3))


def test_conjugate_gradients_solve_sparse_equations():
    from scipy import sparse

    n = 60
    matrix = sparse.diags_array(
        [np.full(n - 1, -1.0), np.full(n, 2.1), np.full(n - 1, -1.0)], offsets=[-1, 0, 1]
    ).tocsr()
    right = numbers(n)
    found = linear.conjugate_gradient(matrix, right, relative=1e-10)
    assert np.linalg.norm(matrix @ found - right) < 2e-10 * np.linalg.norm(right)
    coarse = linear.conjugate_gradient(matrix, right, relative=1e-10, most=3)
    assert np.linalg.norm(matrix @ coarse - right) > 1e-6
    assert linear.conjugate_gradient(matrix, right, relative=0.0, absolute=1e3).tolist() == [0.0] * n


@pytest.mark.parametrize("count", [1, 2, 3, 12, 61])
def test_quadratures_are_those_of_numpy(count):
    nodes, weights = linear.gauss_legendre(count)
    expected = np.polynomial.legendre.leggauss(count)
    assert nodes == pytest.approx(expected[0], abs=1e-15)
    assert weights == pytest.approx(expected[1], rel=2e-13)
