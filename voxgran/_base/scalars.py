"""What counts as a number: the one conversion, whether it stands alone, in others or in a parameter class."""

import contextlib
import json
import math
from collections.abc import Callable, Mapping
from decimal import Decimal
from numbers import Integral, Real
from typing import Any

#: magnitude of whole numbers that are read: seeds are the largest, and Python writes none of more than 4300 digits
MOST_WHOLE = 2**128


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
        return {plain_text(str(key)): nested(item, leaf) for key, item in value.items()}
    if isinstance(value, list | tuple | range):
        return [nested(item, leaf) for item in value]
    return leaf(value)


def plain_text(text: str) -> str:
    """Return a text that any file can hold: null characters, and the surrogates that stand for bytes in names of files
    that are no text, are written as in Python.
    """
    return text.encode("utf-8", "backslashreplace").decode("utf-8").replace("\0", "\\x00")


def plain_values(value: Any) -> Any:
    """Return nested values of JSON or TOML with texts that any file can hold.

    Raises
    ------
    ValueError
        If a whole number is beyond 2**128.
    """

    def leaf(one: Any) -> Any:
        if isinstance(one, int) and abs(one) > MOST_WHOLE:
            raise ValueError("a whole number is beyond 2**128")
        return plain_text(one) if isinstance(one, str) else one

    return nested(value, leaf)


def values_of_json(text: str) -> Any:
    """Return the values of a text of JSON, as :func:`plain_values` does."""
    return plain_values(json.loads(text))


def check_types(held: Any, declared: Mapping[str, Any], name: str) -> None:
    """Check the values of a mapping that was read, of which messages speak by `name`.

    declared: type of each value by its key, or a tuple of types; ``float`` is any finite number, and a list with a type
    stands for lists of such values. A key that is not declared is refused, one that is not held is not.

    Raises
    ------
    ValueError
        If one is of another type.
    """
    if not isinstance(held, dict):
        raise ValueError(f"{name} is no mapping")
    for key, value in held.items():
        if key not in declared:
            raise ValueError(f"{name} has the key {key[:60]!r}, which is not known")
        if not _is_of(value, declared[key]):
            raise ValueError(f"{name} has a value of another type for {key!r}")


def _is_of(value: Any, kind: Any) -> bool:
    """Return whether a value is of a declared type."""
    if isinstance(kind, list):
        return isinstance(value, list) and all(_is_of(one, kind[0]) for one in value)
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return isinstance(value, kind) and (kind is bool or not isinstance(value, bool))


def finite(value: Any) -> Any:
    """Return nested values for JSON, which has no number for NaN and infinity: None in their place."""

    def leaf(one: Any) -> Any:
        if hasattr(one, "tolist"):
            return finite(one.tolist())
        return None if isinstance(one, float) and not math.isfinite(one) else one

    return nested(value, leaf)
