"""Cube roots that scale without a change of bits."""

import math

import numpy as np

from voxgran._base.scalars import cube_root


def test_cube_roots_scale_by_powers_of_two():
    for number in 10.0 ** np.random.default_rng(0).uniform(-12, 12, 300):
        root = cube_root(float(number))
        assert math.isclose(root, math.cbrt(number), rel_tol=1e-15)
        for power in (-7, -1, 1, 5):
            assert cube_root(float(number) * 8.0**power) == root * 2.0**power
    assert cube_root(0.0) == 0.0
    assert cube_root(27.0) == 3.0
