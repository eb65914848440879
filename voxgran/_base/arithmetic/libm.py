"""Elementary functions of arrays as the C library computes them: with the same bits on every processor.

On processors that have AVX-512 NumPy computes them by other instructions, with other last digits.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import Floats
from voxgran._base.kernels import bare_kernel, numba_is_loaded

#: numbers up to which a function is called for each by Python: in 0.1 ms, for which numba is not loaded
FEW = 1000
#: the same where numba is loaded: a call of a kernel takes as long
FEWEST = 16
#: exponents up to which a power is a product
PRODUCTS = 8

#: functions of one number, as kernels call them by their place
_OF_ONE: tuple[Callable[[float], float], ...] = (
    *(math.sin, math.cos, math.exp, math.log, math.acos, math.asin, math.atan),
    *(math.expm1, math.log1p, math.log2, math.log10, math.sinh, math.cosh, math.tanh),
)
SIN, COS, EXP, LOG, ARCCOS, ARCSIN, ARCTAN, EXPM1, LOG1P, LOG2, LOG10, SINH, COSH, TANH = range(len(_OF_ONE))


def sin(x: ArrayLike) -> Any:
    """Return the sine of angles."""
    return _of_one(SIN, x)


def cos(x: ArrayLike) -> Any:
    """Return the cosine of angles."""
    return _of_one(COS, x)


def arcsin(x: ArrayLike) -> Any:
    """Return the inverse sine."""
    return _of_one(ARCSIN, x)


def arccos(x: ArrayLike) -> Any:
    """Return the inverse cosine."""
    return _of_one(ARCCOS, x)


def arctan(x: ArrayLike) -> Any:
    """Return the inverse tangent."""
    return _of_one(ARCTAN, x)


def arctan2(y: ArrayLike, x: ArrayLike) -> Any:
    """Return the angles of points (x, y)."""
    return _of_two(math.atan2, _angles, y, x)


def exp(x: ArrayLike) -> Any:
    """Return the exponential."""
    return _of_one(EXP, x)


def expm1(x: ArrayLike) -> Any:
    """Return the exponential less 1."""
    return _of_one(EXPM1, x)


def log(x: ArrayLike) -> Any:
    """Return the natural logarithm: -inf of 0, NaN of negative numbers, without a warning."""
    return _of_one(LOG, x)


def log1p(x: ArrayLike) -> Any:
    """Return the natural logarithm of 1 + x."""
    return _of_one(LOG1P, x)


def log2(x: ArrayLike) -> Any:
    """Return the logarithm to the base 2."""
    return _of_one(LOG2, x)


def log10(x: ArrayLike) -> Any:
    """Return the logarithm to the base 10."""
    return _of_one(LOG10, x)


def sinh(x: ArrayLike) -> Any:
    """Return the hyperbolic sine."""
    return _of_one(SINH, x)


def cosh(x: ArrayLike) -> Any:
    """Return the hyperbolic cosine."""
    return _of_one(COSH, x)


def tanh(x: ArrayLike) -> Any:
    """Return the hyperbolic tangent."""
    return _of_one(TANH, x)


def power(base: ArrayLike, exponent: float | Floats) -> Any:
    """Return powers; multiples of a half up to 8 are products, and roots, so that scaling by 4 changes no bit but the
    exponent.
    """
    if isinstance(exponent, int | float) and abs(exponent) <= PRODUCTS and 2 * exponent == int(2 * exponent):
        factor = np.asarray(base)
        product = np.ones_like(factor) if abs(exponent) % 1 == 0 else np.sqrt(factor)
        for _ in range(int(abs(exponent))):
            product = product * factor
        return product if exponent >= 0 else 1.0 / product
    return _of_two(math.pow, _powers, base, exponent)


def _are_few(values: Floats) -> bool:
    """Return whether calls of Python's functions take less time than a kernel."""
    return values.size <= (FEWEST if numba_is_loaded() else FEW)


def _of_one(which: int, x: ArrayLike) -> Any:
    """Return a function of each number; a number for a number."""
    values = np.asarray(x, dtype=np.float64)
    if _are_few(values):
        try:
            found = np.array([_OF_ONE[which](value) for value in values.ravel().tolist()], dtype=np.float64)
            return found.reshape(values.shape)[()]
        except (ValueError, OverflowError):
            # Python refuses what has no finite value
            pass
    out = np.empty(values.size)
    _evaluate(which, np.ascontiguousarray(values).ravel(), out)
    return out.reshape(values.shape)[()]


def _of_two(function: Callable[[float, float], float], kernel: Any, x: ArrayLike, y: ArrayLike) -> Any:
    """Return a function of each two numbers, which broadcast."""
    shape = np.broadcast_shapes(np.shape(x), np.shape(y))
    # copies, since kernels and NumPy do not take views of one number for arrays that may be written
    one, other = (np.array(np.broadcast_to(part, shape), dtype=np.float64, order="C") for part in (x, y))
    if _are_few(one):
        try:
            found = list(map(function, one.ravel().tolist(), other.ravel().tolist()))
            return np.array(found, dtype=np.float64).reshape(one.shape)[()]
        except (ValueError, OverflowError):
            # Python refuses what has no finite value
            pass
    out = np.empty(one.size)
    kernel(one.ravel(), other.ravel(), out)
    return out.reshape(one.shape)[()]


@bare_kernel
def _angles(y: Floats, x: Floats, out: Floats) -> None:
    """Write the angles of points."""
    for k in range(len(out)):
        out[k] = math.atan2(y[k], x[k])


@bare_kernel
def _powers(base: Floats, exponent: Floats, out: Floats) -> None:
    """Write powers."""
    for k in range(len(out)):
        out[k] = base[k] ** exponent[k]


@bare_kernel
def _evaluate(which: int, x: Floats, out: Floats) -> None:
    """Write a function of each number."""
    for k in range(len(out)):
        value = x[k]
        if which == SIN:
            out[k] = math.sin(value)
        elif which == COS:
            out[k] = math.cos(value)
        elif which == EXP:
            out[k] = math.exp(value)
        elif which == LOG:
            out[k] = math.log(value)
        elif which == ARCCOS:
            out[k] = math.acos(value)
        elif which == ARCSIN:
            out[k] = math.asin(value)
        elif which == ARCTAN:
            out[k] = math.atan(value)
        elif which == EXPM1:
            out[k] = math.expm1(value)
        elif which == LOG1P:
            out[k] = math.log1p(value)
        elif which == LOG2:
            out[k] = math.log2(value)
        elif which == LOG10:
            out[k] = math.log10(value)
        elif which == SINH:
            out[k] = math.sinh(value)
        elif which == COSH:
            out[k] = math.cosh(value)
        else:
            out[k] = math.tanh(value)
