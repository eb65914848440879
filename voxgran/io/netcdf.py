"""Statistics (`xarray.DataTree`) as netCDF4 files.

The engine is always named: without it xarray may fall back on one that turns integers into other integers unasked.

The same statistics are also written as one table of CSV, with a row for each number.
"""

import csv
import io
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from voxgran._base.arrays import check_type
from voxgran._base.calls import explained
from voxgran._base.errors import OutputError
from voxgran._base.files import PROBE, as_path, existing_file, output_suffix, write_files, written_whole
from voxgran._base.guarded import Content, netcdf_file, read_guarded, refuse_growth, refused
from voxgran._base.lazy import DataArray, Dataset, DataTree, load
from voxgran.measures.accessor import register_accessor

#: variables longer than this are compressed
_COMPRESS_ABOVE = 1000
#: attribute of the file that holds the name of the tree
_NAME = "tree_name"


@explained(hint='save_statistics(measure(packing), "bed.nc")')
def save_statistics(tree: "DataTree", path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write statistics to a netCDF4 file, or as a table.

    Parameters
    ----------
    tree : xarray.DataTree
        What :func:`voxgran.measure` returns, or any tree of datasets.
    path : path-like
        File to write: ``.nc``, or ``.csv`` with a row for each number, which is not read again.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    FileFormatError
        If the suffix is neither ``.nc`` nor ``.csv``.
    InputError
        If `tree` is something else.
    OutputExistsError
        If the file is there and `overwrite` is false.
    OutputError
        If it cannot be written; what was there before is untouched.

    Notes
    -----
    netCDF attributes are numbers, texts or lists of these. Flags are kept as 0 and 1, mappings as JSON, and an
    attribute that is None is left out.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> vg.save_statistics(vg.measure(bed, which="coordination"), "statistics.nc")
    """
    check_statistics_path(path, overwrite=overwrite)
    register_accessor()
    xarray = load("xarray")
    check_type(tree, xarray.DataTree, "tree", "a tree of datasets, such as measure(packing)")
    if as_path(path).suffix.lower() == ".csv":
        write_files({as_path(path): statistics_text(tree)}, overwrite=overwrite)
        return
    load("netCDF4")
    safe = {node.path: _with_safe_attributes(node.to_dataset(inherit=False)) for node in tree.subtree}
    encoding = {place: {str(n): _encoding(v) for n, v in data.variables.items()} for place, data in safe.items()}
    if tree.name is not None:
        safe["/"].attrs[_NAME] = str(tree.name)
    with written_whole(path, overwrite=overwrite) as draft:
        try:
            # netCDF takes any error of a new file for a lack of permission
            draft.write_bytes(bytes(PROBE))
            xarray.DataTree.from_dict(safe).to_netcdf(draft, engine="netcdf4", encoding=encoding)
        # a name that is not UTF-8 is refused by the library
        except (RuntimeError, UnicodeEncodeError) as error:
            raise OutputError(f"{path} cannot be written ({error}): free space or choose another place") from error


def check_statistics_path(path: str | os.PathLike[str], *, overwrite: bool) -> None:
    """Refuse a file that statistics cannot be written to, before the work.

    Raises
    ------
    FileFormatError
        If the suffix is neither ``.nc`` nor ``.csv``.
    OutputExistsError
        If the file is there and `overwrite` is false.
    """
    output_suffix(path, [".nc", ".csv"], "statistics are kept", overwrite=overwrite)


@explained(hint='load_statistics("statistics.nc")')
def load_statistics(path: str | os.PathLike[str]) -> "DataTree":
    """Read statistics from a netCDF4 file.

    Parameters
    ----------
    path : path-like
        A file that :func:`save_statistics` wrote.

    Returns
    -------
    xarray.DataTree
        In memory; the file is closed.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is damaged or no netCDF4 file.
    TooLargeError
        If its content takes more memory than its size explains, or more than half of that of the machine.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=10)
    >>> vg.save_statistics(vg.measure(bed, which="coordination"), "statistics.nc")
    >>> vg.load_statistics("statistics.nc")["/grains"].sizes["grain"]
    10
    """
    found = existing_file(path)
    facts, arrays = read_guarded(netcdf_values, found)
    # a scale makes such numbers of bytes
    refuse_growth(found, sum(array.size for array in arrays.values()))
    xarray = load("xarray")
    data = {}
    with refused(found):
        for place, told in facts.items():
            values = {
                name: (one["dims"], arrays.get(f"{place}/{name}", one["texts"]), _decoded(one["attributes"]))
                for name, one in told["variables"].items()
            }
            data[place] = xarray.decode_cf(xarray.Dataset(values, attrs=_decoded(told["attributes"]))).load()
        loaded: DataTree = xarray.DataTree.from_dict(data)
    loaded.name = loaded.attrs.pop(_NAME, None)
    return loaded


def netcdf_values(path: Path) -> Content:
    """Read all of a netCDF4 file, to be run by `read_guarded`: HDF5 crashes on some damaged files, and reads others
    that a file names.

    The facts are ``attributes`` and ``variables`` of each group by its path; the latter with ``dims``, ``attributes``
    and ``texts``, which are None for numbers. These are the arrays, by path and name.
    """
    facts, arrays = dict[str, Any](), dict[str, NDArray[Any]]()
    with netcdf_file(path) as file:
        file.set_auto_maskandscale(False)
        file.set_auto_chartostring(False)
        groups = [file]
        for group in groups:
            groups.extend(group.groups.values())
            told = facts[group.path] = {"attributes": _encoded(group), "variables": {}}
            for name, variable in group.variables.items():
                values, texts = np.asarray(variable[...]), None
                if variable.dtype is str:
                    texts = values.tolist()
                else:
                    arrays[f"{group.path}/{name}"] = values
                told["variables"][name] = {
                    "dims": variable.dimensions,
                    "attributes": _encoded(variable),
                    "texts": texts,
                }
    return facts, arrays


def _encoded(entry: Any) -> dict[str, Any]:
    """Return the attributes of a group or variable as JSON, arrays with their type."""
    found = {name: entry.getncattr(name) for name in entry.ncattrs()}
    return {
        name: {"type": value.dtype.str, "values": value.tolist()}
        if isinstance(value, np.ndarray)
        else value.item()
        if isinstance(value, np.generic)
        else value
        for name, value in found.items()
    }


def _decoded(attributes: dict[str, Any]) -> dict[str, Any]:
    """Return attributes as they were encoded."""
    return {
        name: np.array(value["values"], dtype=value["type"]) if isinstance(value, dict) else value
        for name, value in attributes.items()
    }


def _with_safe_attributes(data: "Dataset") -> "Dataset":
    """Return the dataset with attributes that netCDF can hold, and texts of NumPy: xarray 2024.10 writes no others."""
    texts = {name: values.astype(str) for name, values in data.variables.items() if values.dtype == object}
    clean = data.assign(texts).set_coords(list(data.coords)) if texts else data.copy()
    clean.attrs = _safe(data.attrs)
    for name in clean.variables:
        clean[name].attrs = _safe(data[name].attrs)
        clean[name].encoding = {}
    return clean


def _safe(attributes: Any) -> dict[str, Any]:
    """Turn attributes into numbers, texts or lists of these."""
    found: dict[str, Any] = {}
    for name, value in attributes.items():
        plain = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        if plain is None:
            continue
        if isinstance(plain, bool):
            plain = int(plain)
        flat = isinstance(plain, list | tuple) and all(isinstance(v, int | float) for v in plain)
        if not flat and not isinstance(plain, str | int | float):
            plain = json.dumps(plain, default=str)
        elif isinstance(plain, int) and abs(plain) >= 2**63:
            plain = str(plain)
        found[str(name)] = list(plain) if isinstance(plain, tuple) else plain
    return found


def _encoding(variable: Any) -> dict[str, Any]:
    """Return the compression of a variable; short ones have none."""
    if variable.dtype.kind in "fiub" and variable.size > _COMPRESS_ABOVE:
        return {"zlib": True, "complevel": 4, "fletcher32": True}
    return {}


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
