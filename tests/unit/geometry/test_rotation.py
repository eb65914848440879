"""Quaternions, matrices and uniform sets, against SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

from voxgran._base.seeds import stream
from voxgran.geometry.rotation import lattice_rotations, product, quaternions_of, random_rotations, rotation_matrices


def scipy_rotations(q):
    return Rotation.from_quat(q[:, [1, 2, 3, 0]])


def test_matrices_and_products_are_scipys():
    a, b = random_rotations(stream(0, "a"), 50), random_rotations(stream(0, "b"), 50)
    assert np.allclose(rotation_matrices(a), scipy_rotations(a).as_matrix(), atol=1e-15)
    both = scipy_rotations(a) * scipy_rotations(b)
    assert np.allclose(rotation_matrices(product(a, b)), both.as_matrix(), atol=1e-15)
    assert np.allclose(quaternions_of(rotation_matrices(a)), a, atol=1e-15)


def test_random_rotations_are_uniform():
    # on SO(3) the mean matrix is 0 and the mean square of each entry is 1/3
    matrices = rotation_matrices(random_rotations(stream(5, "uniform"), 20000))
    assert np.abs(matrices.mean(axis=0)).max() < 0.02
    assert np.abs((matrices**2).mean(axis=0) - 1 / 3).max() < 0.02


def test_lattice_rotations_are_the_group_of_the_cube():
    group = lattice_rotations()
    assert group.shape == (24, 3, 3)
    assert np.array_equal(group[0], np.eye(3))
    products = {tuple((a @ b).ravel()) for a in group for b in group}
    assert products == {tuple(a.ravel()) for a in group}
