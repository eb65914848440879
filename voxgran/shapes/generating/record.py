"""What a generator notes about a shape: plain values and arrays by name."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from voxgran._base.arrays import read_only
from voxgran._base.errors import InputError, shown


class Record(Mapping[str, Any]):
    """Immutable mapping of names to plain values, tuples of them, and read-only arrays."""

    __slots__ = ("_values",)

    def __init__(self, values: Mapping[str, Any] | None = None) -> None:
        """Copy the values; a value that is neither plain nor an array is an error.

        Raises
        ------
        InputError
            If a name is not a string, or a value is neither plain nor an array.
        """
        if isinstance(values, Record):
            self._values: dict[str, Any] = values._values
            return
        self._values = {_named(name): _plain(value, name) for name, value in (values or {}).items()}

    def __getitem__(self, name: str) -> Any:
        """Value of a name."""
        return self._values[name]

    def __iter__(self) -> Iterator[str]:
        """Names, in the order in which they were given."""
        return iter(self._values)

    def __len__(self) -> int:
        """Return the number of names."""
        return len(self._values)

    def __reduce__(self) -> tuple[type["Record"], tuple[dict[str, Any]]]:
        """Make copies and pickles from the values, so that their arrays are read-only too."""
        return Record, (self._values,)

    def __repr__(self) -> str:
        """Names and values."""
        return f"Record({', '.join(f'{name}={shown(value)}' for name, value in self._values.items())})"


def _named(name: Any) -> str:
    """Return a name, which must be a string."""
    if not isinstance(name, str):
        raise InputError(f"the record has the name {shown(name)}: names of a record must be strings; rename it")
    return name


def _plain(value: Any, name: str) -> Any:
    """Return a plain value, a tuple of them or a read-only copy of an array."""
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        return read_only(np.array(value))
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, list | tuple):
        return tuple(_plain(one, name) for one in value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise InputError(
        f"record {name} is {shown(value)}: it must be a number, a string, None, a list of these or an array of numbers"
    )
