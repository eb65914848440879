"""What counts as a number: the one conversion, whether it stands alone, in others or in a parameter class."""

import contextlib
import math
from collections.abc import Callable, Mapping
from decimal import Decimal
from numbers import Integral, Real
from typing import Any


def number_of(value: Any) -> int | float | None:
    """Return a number of Python or NumPy, array without axes, Decimal or Fraction as an int or float; None for anything
    else.

    Text, True and False are not numbers. A float is infinite if the number is too large for it.
    """
    plain = unwrapped(value)
    if isinstance(plain, bool) or not isinstance(plain, Real | Decimal):
        return None
    return int(plain) if isinstance(plain, Integral) else float_of(plain)


def whole_number_of(value: Any) -> int | None:
    """Return what was given as a whole number; None where it is none."""
    number = number_of(value)
    if number is None or not (isinstance(number, int) or number.is_integer()):
        return None
    return int(number)


def float_of(number: Any) -> float:
    """Return a number as a float, infinite where it is beyond them."""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf
    except ValueError:
        # a signaling NaN of decimal arithmetic
        return math.nan


def cube_root(number: float) -> float:
    """Return the cube root of a number that is at least 0; a factor of 8 to any power changes no bit but the exponent.

    The root of the C library does not promise the latter: glibc takes another rounding for negative exponents.
    """
    if number == 0.0:
        return 0.0
    exponent = math.frexp(number)[1] // 3
    scaled = math.ldexp(number, -3 * exponent)
    root = math.cbrt(scaled)
    # a step of Newton's method, since glibc is wrong by one bit even for 27
    return math.ldexp(root - (root**3 - scaled) / (3.0 * root**2), exponent)


def unwrapped(value: Any) -> Any:
    """Return the number or flag in a NumPy scalar or an array without axes, and any other value unchanged."""
    if getattr(value, "ndim", None) == 0:
        with contextlib.suppress(AttributeError, TypeError, ValueError):
            return value.item()
    return value


def nested(value: Any, leaf: Callable[[Any], Any]) -> Any:
    """Return mappings, lists and tuples in each other as dicts and lists, with a function applied to all in them."""
    if isinstance(value, Mapping):
        return {str(key): nested(item, leaf) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [nested(item, leaf) for item in value]
    return leaf(value)


def finite(value: Any) -> Any:
    """Return nested values for JSON, which has no number for NaN and infinity: None in their place."""

    def leaf(one: Any) -> Any:
        if hasattr(one, "tolist"):
            return finite(one.tolist())
        return None if isinstance(one, float) and not math.isfinite(one) else one

    return nested(value, leaf)
