"""The one door that validates arrays and numbers.

Everything that enters voxgran from outside passes here once; behind the door arrays are contiguous, finite,
of the stated shape and of type float64 (int64 for indices), and nobody checks again.
"""

import math
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.errors import InputError, shown
from voxgran._base.scalars import float_of, number_of, unwrapped, whole_number_of

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]
#: words of bits
Words: TypeAlias = NDArray[np.uint64]
#: a quotient of lengths within this of a whole number is that number
WHOLE = 1e-9

#: lengths whose fifth powers, of which second moments are made, are numbers
SHORTEST, LONGEST = 1e-60, 1e60
#: largest number that arrays count with
MOST = 2**63 - 1
#: rows of an array that are looked at together where each takes as much memory again
ROWS = 2**16


def float_array(value: Any) -> Floats | None:
    """Return array-like numbers as a contiguous float64 array of any shape, possibly not finite; None if a value is no
    number.
    """
    try:
        if isinstance(value, np.ma.MaskedArray):
            # below a mask there may be anything
            value = np.ma.filled(value.astype(np.float64), np.nan)
        # a list may hold what NumPy would take for a number: text, True, None
        array = np.asarray(value) if hasattr(value, "__array__") else np.asarray(value, dtype=object)
        if array.dtype.kind == "O":
            flat = array.ravel().tolist()
            if not set(map(type, flat)) <= {float, int}:
                flat = [number_of(item) for item in flat]
                if None in flat:
                    return None
            try:
                array = np.array(flat, dtype=np.float64).reshape(array.shape)
            except OverflowError:
                array = np.array([float_of(item) for item in flat]).reshape(array.shape)
    except (TypeError, ValueError):
        return None
    if array.dtype.kind not in "iuf":
        return None
    with np.errstate(over="ignore"):
        return np.asarray(array, dtype=np.float64, order="C")


def as_floats(value: "ArrayLike", name: str, *, shape: tuple[int | None, ...]) -> Floats:
    """Return `value` as a contiguous finite float64 array of the given shape, in which None stands for any length.

    Raises
    ------
    InputError
        If a value is not a number, such as text or True, or not finite, or the shape differs.
    """
    array = float_array(value)
    if array is None or (array.ndim == 0 and len(shape) > 0):
        raise InputError(f"{name} is {shown(value)}: it must be an array of numbers of shape {_text(shape)}; give one")
    if array.ndim != len(shape) or any(
        want is not None and want != got for want, got in zip(shape, array.shape, strict=True)
    ):
        raise InputError(f"{name} has shape {array.shape}: it must have shape {_text(shape)}")
    finite = np.isfinite(array)
    if not finite.all():
        where = tuple(int(k) for k in np.argwhere(~finite)[0])
        raise InputError(f"{name} is {array[where]} at index {where}: every value must be finite; remove or mend it")
    return array


def as_array(value: Any, name: str) -> NDArray[Any]:
    """Return array-like values of any type and shape as an array.

    Raises
    ------
    InputError
        If they do not fit in one, such as rows of different lengths, or some are masked.
    """
    if np.ma.is_masked(value):
        raise InputError(f"{name} is {shown(value)}: some values are masked; fill them")
    try:
        return np.asarray(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} is {shown(value)}: it must be an array; give rows of one length") from None


def as_points(value: "ArrayLike", name: str = "points", *, dimension: int = 3) -> Floats:
    """Return `value` as (n, dimension) finite float64 points with coordinates of at most 1e60."""
    points = as_floats(value, name, shape=(None, dimension))
    check_coordinates(points, name)
    return points


def as_vector(value: "ArrayLike", name: str, *, length: int = 3) -> Floats:
    """Return `value` as a finite float64 vector of the given length."""
    return as_floats(value, name, shape=(length,))


def as_faces(value: "ArrayLike", vertex_count: int) -> Integers:
    """Return `value` as (m, 3) int64 vertex indices below `vertex_count`.

    Raises
    ------
    InputError
        If it is not an (m, 3) array of whole numbers, or an index is out of range.
    """
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        raise InputError(f"faces is {shown(value)}: it must be an (m, 3) array of whole numbers; give one") from None
    if array.size == 0:
        return np.zeros((0, 3), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != 3 or not np.issubdtype(array.dtype, np.integer):
        raise InputError(
            f"faces has shape {array.shape} and type {array.dtype}: it must be an (m, 3) array of "
            "whole numbers; triangulate the surface first"
        )
    faces = np.ascontiguousarray(array, dtype=np.int64)
    if faces.min() < 0 or faces.max() >= vertex_count:
        raise InputError(
            f"faces names vertex {int(faces.max() if faces.min() >= 0 else faces.min())}: indices must "
            f"lie in 0 ... {vertex_count - 1}"
        )
    return faces


def as_indices(value: "ArrayLike", name: str, *, length: int, below: int | None = None, at_least: int = 0) -> Integers:
    """Return `value` as (length,) int64 indices below `below`, if that is given, in an array of their own.

    Raises
    ------
    InputError
        As :func:`as_floats`, or if one is no whole number or out of range.
    """
    given = isinstance(value, np.ndarray) and value.dtype.kind in "iu" and value.shape == (length,)
    array = np.asarray(value) if given else as_floats(value, name, shape=(length,))
    beyond = array >= (MOST if below is None else below)
    wrong = np.flatnonzero((array < at_least) | beyond | (array != np.floor(array)))
    if len(wrong):
        rule = f"at least {at_least}" + ("" if below is None else f" and below {below}")
        raise InputError(
            f"{name} is {array[wrong[0]]:g} at index {wrong[0]}: every value must be a whole number, {rule}; correct it"
        )
    return array.astype(np.int64)


def as_quaternions(value: "ArrayLike", name: str = "orientation") -> Floats:
    """Return `value` as (n, 4) unit quaternions (w, x, y, z), normalized to round-off; the same array if all are unit.

    Raises
    ------
    InputError
        If the shape is wrong, a value is not finite or a length differs from 1 by more than 1e-6.
    """
    array = as_floats(value, name, shape=(None, 4))
    # the squares of all rows at once take as much memory as a packing of spheres
    parts = [np.sqrt(np.square(array[k : k + ROWS]).sum(axis=1)) for k in range(0, max(len(array), 1), ROWS)]
    length = np.concatenate(parts)
    if array.size and np.abs(length - 1.0).max() > 1e-6:
        worst = int(np.abs(length - 1.0).argmax())
        raise InputError(
            f"{name} has length {length[worst]:.6g} at row {worst}: quaternions (w, x, y, z) must have "
            "length 1; divide by the length"
        )
    exact = np.abs(length - 1.0) <= 4e-16
    if exact.all():
        return array
    return np.where(exact[:, None], array, array / np.where(exact, 1.0, length)[:, None])


def as_number(
    value: Any, name: str, *, above: float = -math.inf, at_least: float = -math.inf, at_most: float = math.inf
) -> float:
    """Return `value` as a finite float within bounds: exclusive below, inclusive below, inclusive above.

    Raises
    ------
    InputError
        If it is not a number, not finite, or out of bounds.

    Examples
    --------
    >>> from voxgran._base.arrays import as_number
    >>> as_number(2, "gap", at_least=0.0)
    2.0
    """
    given = number_of(value)
    if given is None:
        raise InputError(f"{name} is {shown(value)}: it must be a number")
    number = float_of(given)
    if math.isfinite(number) and number > above and at_least <= number <= at_most:
        return number
    rules = ["finite"]
    if above > -math.inf:
        rules.append(f"above {above:g}")
    if at_least > -math.inf:
        rules.append(f"at least {at_least:g}")
    if at_most < math.inf:
        rules.append(f"at most {at_most:g}")
    raise InputError(f"{name} is {shown(value)}: it must be {' and '.join(rules)}; change it")


def as_share(value: Any, name: str, *, zero: bool = False) -> float:
    """Return `value` as a share of a whole: a float above 0, or from 0 on with `zero`, and at most 1."""
    if zero:
        return as_number(value, name, at_least=0.0, at_most=1.0)
    return as_number(value, name, above=0.0, at_most=1.0)


def as_flag(value: Any, name: str) -> bool:
    """Return `value` as True or False.

    Raises
    ------
    InputError
        If it is neither of Python nor of NumPy; text and numbers are not flags.
    """
    plain = unwrapped(value)
    if not isinstance(plain, bool):
        raise InputError(f"{name} is {shown(value)}: it must be True or False")
    return plain


def as_positive(value: Any, name: str) -> float:
    """Return `value` as a finite float above zero."""
    return as_number(value, name, above=0.0)


def as_length(value: Any, name: str) -> float:
    """Return `value` as a length between 1e-60 and 1e60, so that volumes and second moments are finite."""
    length = as_positive(value, name)
    check_lengths(length, name)
    return length


def as_place(value: "ArrayLike", name: str, *, length: int = 3) -> Floats:
    """Return `value` as a vector of coordinates of at most 1e60."""
    place = as_vector(value, name, length=length)
    check_lengths(np.maximum(np.abs(place), SHORTEST), name)
    return place


def check_lengths(values: "ArrayLike", name: str) -> None:
    """Check that lengths are between 1e-60 and 1e60, so that volumes and second moments are finite; 0 is allowed.

    Raises
    ------
    InputError
        If a value is not a number, or not between these bounds.
    """
    numbers = float_array(values)
    if numbers is None:
        raise InputError(f"{name} is {shown(values)}: it must be a number")
    lengths = np.abs(numbers).reshape(-1)
    wrong = lengths[(lengths != 0) & ~((lengths >= SHORTEST) & (lengths <= LONGEST))]
    if len(wrong):
        raise InputError(
            f"{name} is {wrong[0]:g}: it must be between {SHORTEST:g} and {LONGEST:g}; choose another unit of lengths"
        )


def box_of(points: Floats) -> tuple[Floats, Floats]:
    """Return the lower and upper corner of the box around points (n, 3); by columns it takes an eighth of the time."""
    return np.array([along.min() for along in points.T]), np.array([along.max() for along in points.T])


def check_coordinates(points: Floats, name: str) -> None:
    """Check that finite coordinates are at most 1e60, so that volumes and second moments are finite.

    Raises
    ------
    InputError
        If one is beyond 1e60.
    """
    if points.size and max(float(points.max()), -float(points.min())) > LONGEST:
        row, axis = (int(k) for k in np.argwhere(np.abs(points) > LONGEST)[0])
        raise InputError(
            f"{name} is {points[row, axis]:g} at index ({row}, {axis}): coordinates must be at most {LONGEST:g} in "
            "magnitude; mend it or choose another unit of lengths"
        )


def as_count(value: Any, name: str, *, at_least: int = 0, at_most: int | None = MOST) -> int:
    """Return `value` as an int from `at_least` to `at_most`; None for no upper bound.

    Raises
    ------
    InputError
        If it is not a whole number, too small or too large.
    """
    number = whole_number_of(value)
    if number is None or number < at_least:
        raise InputError(f"{name} is {shown(value)}: it must be a whole number, at least {at_least}")
    if at_most is not None and number > at_most:
        raise InputError(f"{name} is {shown(value)}: it must be at most {at_most}; give less")
    return number


def as_choice(value: Any, name: str, choices: Sequence[str]) -> str:
    """Return `value` if it is one of `choices`.

    Raises
    ------
    InputError
        If it is none of them.
    """
    if not isinstance(value, str) or value not in choices:
        raise InputError(f"{name} is {shown(value)}: it must be one of {', '.join(choices)}")
    return str(value)


def check_type(value: object, wanted: type | tuple[type, ...], name: str, rule: str) -> None:
    """Check the type of a value; `rule` completes the message, such as ``"a Shape; make_shape and load_shape make
    one"``.

    Raises
    ------
    InputError
        If it is of another type.
    """
    if not isinstance(value, wanted):
        raise InputError(f"{name} is {shown(value)}: it must be {rule}{_remedy_within(value, wanted)}")


def _remedy_within(value: Any, wanted: type | tuple[type, ...]) -> str:
    """Return what may be written behind a value that is not of the wanted type but holds such an object, as the result
    of a repair holds a shape; an empty text for others.
    """
    kinds = wanted if isinstance(wanted, tuple) else (wanted,)
    for kind in (one for one in kinds if one is not type(None)):
        noun = kind.__name__.lower()
        # the shape of a clump is that which it stands for
        if not isinstance(value, type) and callable(getattr(value, f"to_{noun}", None)):
            return f"; write .to_{noun}() behind it"
        if isinstance(getattr(value, noun, None), kind):
            return f"; write .{noun} behind it{getattr(value, '_without_place', '')}"
        if isinstance(value, tuple) and value and isinstance(value[0], kind):
            return "; write [0] behind it"
    return ""


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array with its write flag off."""
    array.setflags(write=False)
    return array


def _text(shape: tuple[int | None, ...]) -> str:
    """Return a shape as text, such as ``(n, 3)``."""
    inner = ", ".join("n" if length is None else str(length) for length in shape)
    return f"({inner},)" if len(shape) == 1 else f"({inner})"
