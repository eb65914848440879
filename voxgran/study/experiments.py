"""Measured values beside which the results of a study are drawn: ranges by label, each with its source."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from voxgran._base.arrays import as_number
from voxgran._base.errors import InputError, check_known, shown

KEYS = ("low", "high", "source")


@dataclass(frozen=True, slots=True)
class Band:
    """Range of measured values.

    Attributes
    ----------
    label : str
        Value of an axis of the study, such as a shape, that it belongs to.
    low, high : float
        Limits of the range.
    source : str
        Where it is from; may be empty.
    """

    label: str
    low: float
    high: float
    source: str = ""


def bands_of(experiments: Any) -> tuple[Band, ...]:
    """Return the checked ranges of measured values.

    Parameters
    ----------
    experiments : mapping or None
        By label a table with `low`, `high` and `source`, or a sequence of these; `high` may be left out of a table for
        a single value.

    Raises
    ------
    InputError
        If it is no such mapping, or a limit is no finite number or above the other.
    UnknownNameError
        If a table has another key; the message gives the nearest one.
    """
    if experiments is None:
        return ()
    if not isinstance(experiments, Mapping):
        raise InputError(
            f"experiments is {shown(experiments)}: it must be a table of ranges by label, such as "
            '{"sphere": {"low": 0.55, "high": 0.64, "source": "..."}}'
        )
    return tuple(_band(str(label), given) for label, given in experiments.items())


def _band(label: str, given: Any) -> Band:
    """Return the range of one label.

    Raises
    ------
    InputError
        If it breaks a rule.
    """
    where = f"[experiments] {label}"
    if isinstance(given, Mapping):
        for key in given:
            check_known(f"key of {where}", key, KEYS)
        table = dict(given)
    elif isinstance(given, Sequence) and not isinstance(given, str) and 2 <= len(given) <= len(KEYS):
        table = dict(zip(KEYS, given, strict=False))
    else:
        table = {}
    if "low" not in table:
        raise InputError(
            f'{where} is {shown(given)}: it must be a table, {{ low = 0.55, high = 0.64, source = "..." }}'
        )
    low = as_number(table["low"], f"{where} low")
    high = as_number(table.get("high", low), f"{where} high")
    if low > high:
        raise InputError(f"{where} has low {low:g} above high {high:g}: exchange them")
    return Band(label, low, high, str(table.get("source", "")))


def check_labels(bands: Iterable[Band], labels: Iterable[str]) -> None:
    """Check that all ranges belong to a value of the axis that they are drawn with.

    Parameters
    ----------
    bands : iterable of Band
        Ranges.
    labels : iterable of str
        Values of the axis.

    Raises
    ------
    UnknownNameError
        If one does not; the message gives the nearest value.
    """
    known = tuple(labels)
    for band in bands:
        check_known("label of [experiments]", band.label, known)
