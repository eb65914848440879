"""Statistics (`xarray.DataTree`) as one table of CSV: a row for each number."""

import csv
import io
from collections.abc import Iterator
from typing import Any

import numpy as np

from voxgran._base.lazy import DataArray, DataTree

#: columns of the table
COLUMNS = ("group", "variable", "place", "value", "units", "long_name")


def statistics_text(tree: "DataTree") -> str:
    """Return all numbers of a tree as CSV; `place` is the values of the coordinates, such as ``z=0.5``."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for node in tree.subtree:
        for name, value in node.to_dataset(inherit=False).data_vars.items():
            told = (value.attrs.get("units", "1"), value.attrs.get("long_name", ""))
            writer.writerows((node.path, name, place, number, *told) for place, number in _numbers(value))
            if "error" in value.attrs:
                writer.writerow((node.path, f"{name}_error", "", value.attrs["error"], *told))
    return out.getvalue()


def _numbers(value: "DataArray") -> Iterator[tuple[str, Any]]:
    """Yield place and value of each entry; NaN is an empty field."""
    ends = [value[name].values.tolist() if name in value.coords else range(value.sizes[name]) for name in value.dims]
    for index in np.ndindex(value.shape):
        place = ";".join(f"{name}={end[at]}" for name, end, at in zip(value.dims, ends, index, strict=True))
        number = value.values[index].item() if value.dtype.kind in "biuf" else value.values[index]
        yield place, "" if number != number else number
