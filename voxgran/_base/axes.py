"""Periodic axes: the accepted notations and their check."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from voxgran._base.errors import InputError, shown

#: a flag for each of the axes x, y and z
Flags = tuple[bool, bool, bool]
#: accepted notations: names of axes, a flag for each axis, or one flag for all of them
Periodic = str | bool | Iterable[str] | Iterable[bool]


def as_periodic(value: Any, dimension: int = 3) -> Flags:
    """Return the flags of the axes x, y and z; those beyond the dimension are not periodic.

    The value is a string or sequence of names of axes, such as ``"xy"`` or ``["x", "y"]``; ``"none"``, ``""`` or ``[]``
    for no axis; a flag for each axis; or one flag for all axes. All other values are refused.
    """
    names = "xyz"[:dimension]
    chosen = [bool(value)] * dimension if isinstance(value, bool | np.bool_) else _flags(value, names)
    chosen += [False] * (3 - dimension)
    return chosen[0], chosen[1], chosen[2]


def axis_names(flags: Flags) -> str:
    """Return the names of the flagged axes, such as ``"xy"``."""
    return "".join(axis for axis, flag in zip("xyz", flags, strict=True) if flag)


def _flags(value: Any, names: str) -> list[bool]:
    """Return a flag for each axis, from names of axes or flags."""
    if isinstance(value, str) and value == "none":
        return [False] * len(names)
    try:
        given = [value] if isinstance(value, Mapping) else list(value)
    except TypeError:
        # what is no list counts as one wrong entry
        given = [value]
    if all(isinstance(item, str) and len(item) == 1 and item in names for item in given):
        if len(set(given)) == len(given):
            return [axis in given for axis in names]
    elif len(given) == len(names) and all(isinstance(item, bool | np.bool_) for item in given):
        return [bool(item) for item in given]
    raise InputError(
        f"periodic is {shown(value)}: it must name axes out of {', '.join(names)}, each once, such as 'xy', or be "
        f"'none', True, False or a list of {len(names)} flags; change it"
    )
