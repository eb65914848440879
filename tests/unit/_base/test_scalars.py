"""Cube roots that scale without a change of bits, and values that lie in others."""

import math

import numpy as np

from voxgran._base.scalars import cube_root, finite, nested


def test_cube_roots_scale_by_powers_of_two():
    for number in 10.0 ** np.random.default_rng(0).uniform(-12, 12, 300):
        root = cube_root(float(number))
        assert math.isclose(root, math.cbrt(number), rel_tol=1e-15)
        for power in (-7, -1, 1, 5):
            assert cube_root(float(number) * 8.0**power) == root * 2.0**power
    assert cube_root(0.0) == 0.0
    assert cube_root(27.0) == 3.0


def test_a_function_is_applied_to_all_that_lies_in_mappings_and_lists():
    value = {"a": (1, [2, {3: range(2)}]), "b": "text"}
    assert nested(value, lambda one: one) == {"a": [1, [2, {"3": [0, 1]}]], "b": "text"}
    assert nested(value, str) == {"a": ["1", ["2", {"3": ["0", "1"]}]], "b": "text"}


def test_json_gets_none_for_numbers_that_it_does_not_know():
    value = {"a": (math.nan, 1.0, np.float64(math.inf)), "b": np.array([[1.0, -math.inf]]), "c": np.int64(2), "d": True}
    assert finite(value) == {"a": [None, 1.0, None], "b": [[1.0, None]], "c": 2, "d": True}
