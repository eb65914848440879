"""Elementary functions: those of the C library, for one number and for many."""

import math

import numpy as np
import pytest

from voxgran._base.arithmetic import libm
from voxgran._base.seeds import stream

OF_ONE = {
    "sin": math.sin,
    "cos": math.cos,
    "arcsin": math.asin,
    "arccos": math.acos,
    "arctan": math.atan,
    "exp": math.exp,
    "expm1": math.expm1,
    "log": math.log,
    "log1p": math.log1p,
    "log2": math.log2,
    "log10": math.log10,
    "sinh": math.sinh,
    "cosh": math.cosh,
    "tanh": math.tanh,
}


@pytest.mark.parametrize("name", OF_ONE)
@pytest.mark.parametrize("count", [1, 5, 3000])
def test_functions_have_the_bits_of_the_c_library(name, count):
    values = stream(1, "libm").random(count)
    found = getattr(libm, name)(values.reshape(1, -1, 1))
    assert found.shape == (1, count, 1)
    assert found.ravel().tolist() == [OF_ONE[name](value) for value in values.tolist()]
    assert found == pytest.approx(getattr(np, name)(values).reshape(1, -1, 1), rel=1e-14)


@pytest.mark.parametrize("count", [1, 3000])
def test_functions_of_two_numbers(count):
    x, y = stream(2, "libm").normal(size=(2, count))
    assert libm.arctan2(y, x).tolist() == list(map(math.atan2, y.tolist(), x.tolist()))
    assert libm.power(np.abs(y), 1.7).tolist() == [abs(value) ** 1.7 for value in y.tolist()]
    assert libm.power(2.0, x).tolist() == [2.0**value for value in x.tolist()]


def test_powers_of_halves_are_products():
    x = stream(3, "libm").normal(size=50)
    for exponent in (-2, -1.5, -0.5, 0.5, 1, 2.5):
        assert libm.power(np.abs(x), exponent) == pytest.approx(np.abs(x) ** exponent, rel=1e-15)
        assert np.array_equal(libm.power(16.0 * np.abs(x), exponent), 16.0**exponent * libm.power(np.abs(x), exponent))
    assert np.array_equal(libm.power(x, 3), x * x * x)
    assert libm.power(x, 0).tolist() == [1.0] * 50
    assert np.array_equal(libm.power(1024.0 * x, 5), 2.0**50 * libm.power(x, 5))


@pytest.mark.parametrize("count", [1, 3000])
def test_what_has_no_finite_value_is_what_numpy_gives(count):
    ones = np.ones(count)
    assert libm.log(0 * ones).tolist() == [-math.inf] * count
    assert np.isnan(libm.log(-ones)).all()
    assert libm.exp(1e4 * ones).tolist() == [math.inf] * count
    assert np.isnan(libm.arccos(2 * ones)).all()
    assert libm.power(0 * ones, -1.7).tolist() == [math.inf] * count
    assert np.isnan(libm.power(-ones, 0.3)).all()


def test_a_number_gives_a_number():
    assert libm.sin(0.5) == math.sin(0.5)
    assert np.ndim(libm.exp(np.float64(1.0))) == 0
    assert libm.log(np.zeros((0, 3))).shape == (0, 3)
