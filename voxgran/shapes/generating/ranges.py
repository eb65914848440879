"""Numbers of a parameter class that are given as ranges and drawn."""

from collections.abc import Mapping
from typing import Any, get_args, get_origin

import numpy as np

from voxgran._base.config import kinds_of, parameters_of
from voxgran._base.errors import InputError, shown
from voxgran._base.scalars import number_of, unwrapped, whole_number_of


def drawn(cls: type, mapping: Mapping[str, Any], generator: np.random.Generator, *, where: str) -> dict[str, Any]:
    """Return the parameters of a class with a value drawn in place of each range; all others are the same objects.

    A range is a pair of numbers where the class has a number, alone or as an entry of a list of fixed length. Whole
    numbers are drawn with equal probabilities, other ones uniformly.

    Raises
    ------
    InputError
        If a range begins above its end.
    """
    kinds = {entry.name: entry.type for entry in parameters_of(cls)}
    return {
        key: _drawn(value, kinds[key], generator, f"{where} {key}") if key in kinds else value
        for key, value in mapping.items()
    }


def _drawn(value: Any, kind: Any, generator: np.random.Generator, name: str) -> Any:
    """Return one value, or each entry of a list of fixed length, with ranges drawn."""
    given, value = value, value.tolist() if getattr(value, "ndim", 0) else value
    if not isinstance(value, list | tuple):
        return given
    kinds = kinds_of(kind)
    lists = [get_args(one) for one in kinds if get_origin(one) is tuple and Ellipsis not in get_args(one)]
    fitting = next((entries for entries in lists if len(entries) == len(value)), None)
    if fitting is not None:
        parts = [_drawn(item, one, generator, name) for item, one in zip(value, fitting, strict=True)]
        return given if all(part is item for part, item in zip(parts, value, strict=True)) else type(value)(parts)
    if len(value) != 2 or not {int, float} & set(kinds):
        return given
    whole = float not in kinds
    low, high = ((whole_number_of if whole else number_of)(unwrapped(end)) for end in value)
    if low is None or high is None:
        return given
    if low > high:
        raise InputError(f"{name} is {shown(value)}: a range goes from the smaller to the larger number; swap them")
    return int(generator.integers(int(low), int(high), endpoint=True)) if whole else float(generator.uniform(low, high))
