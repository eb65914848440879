"""Values of the cells of a study as rows: one row for each cell, one column for each seed."""

import re
from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError, check_known, shown
from voxgran._base.lazy import Dataset
from voxgran._base.scalars import unwrapped
from voxgran.packing.missed import STOPPED
from voxgran.report.significance import EQUAL, all_equal
from voxgran.study.axes import Label
from voxgran.study.cells import LISTED

#: dimension of the repetitions, and variable of the sentences on failures
SEED, FAILURE = "seed", "failure"
#: what a warning says where no other grain had room, the column of runs that so have fewer than asked for, and its note
NO_ROOM, FULL = tuple(map(STOPPED.format, ("full", "saturated"))), "full"
FULL_NOTE = "full: runs that ended where nothing more had room, before the number or solid fraction that was asked for"
#: variable of the sentences of warnings, and the column of how many runs have any
WARNINGS, WARNED = "warnings", "warned"
#: solid fraction of the whole container, and all solid fractions: those that say more of a packing come first
OF_CONTAINER = "solid_fraction"
DENSITIES: tuple[str, ...] = ("bulk_solid_fraction", "bed_solid_fraction", OF_CONTAINER)


def is_full(warning: str) -> bool:
    """Return whether a run was warned that nothing more had room before as much as was asked for was packed."""
    return any(text in warning for text in NO_ROOM)


def dimensions_of_cells(dataset: "Dataset") -> tuple[str, ...]:
    """Return the dimensions of a study without that of the seeds.

    Raises
    ------
    InputError
        If it is no dataset of a study.
    """
    sizes = getattr(dataset, "sizes", {})
    if SEED not in sizes or not hasattr(dataset, "data_vars"):
        raise InputError(
            f"dataset is {shown(type(dataset).__name__)} with the dimensions {shown(list(sizes))}: that of a study has "
            "the dimension 'seed'; give that of Study.run, or xarray.open_dataset(\"study.nc\")"
        )
    return tuple(str(name) for name in sizes if name != SEED)


def numbers_of(dataset: "Dataset") -> tuple[str, ...]:
    """Return the names of the variables that are numbers of each run."""
    dims = {*dimensions_of_cells(dataset), SEED}
    return tuple(
        str(name)
        for name, value in dataset.data_vars.items()
        if value.dtype.kind in "biuf" and {str(dim) for dim in value.dims} == dims
    )


def values_of(dataset: "Dataset", variable: str) -> Floats:
    """Return the values (cells, seeds) of a variable, NaN where a run has none; the last dimension varies fastest.

    Raises
    ------
    UnknownNameError
        If the study has no numbers of that name; the message gives the nearest one.
    """
    known = numbers_of(dataset)
    check_known("variable", variable, known)
    dims = (*dimensions_of_cells(dataset), SEED)
    ordered = dataset[variable].transpose(*dims).values.astype(np.float64)
    values: Floats = ordered.reshape(-1, dataset.sizes[SEED])
    values[~np.isfinite(values)] = np.nan
    return values


def is_own(dataset: "Dataset", name: str) -> bool:
    """Return whether a study has a number that is known in at least one run, and is not that of the whole container."""
    known = numbers_of(dataset)
    if name not in known:
        return False
    values = values_of(dataset, name)
    if name not in DENSITIES or name == OF_CONTAINER or OF_CONTAINER not in known:
        return bool(np.isfinite(values).any())
    # without walls and a free surface the bulk and the bed are the whole container
    return bool((np.abs(values - values_of(dataset, OF_CONTAINER)) > EQUAL).any())


def varies(dataset: "Dataset", name: str) -> bool:
    """Return whether a number differs between cells with the same seed; in a study of one cell, between seeds.

    Where count and container are the same in all cells, the solid fraction of the container is so, too: it says nothing
    of what is varied.
    """
    values = values_of(dataset, name)
    columns = values if len(values) == 1 else values.T
    return not all(all_equal(column[np.isfinite(column)]) for column in columns)


def main_variable(dataset: "Dataset") -> str:
    """Return the variable that a study is about by default: of the solid fractions of the bulk, of the bed and of the
    container the first that varies, and is known in each cell that has that of the container; where none varies, the
    first that is known there.
    """
    whole = OF_CONTAINER in numbers_of(dataset)
    found = []
    for name in filter(partial(is_own, dataset), DENSITIES):
        missing = ~np.isfinite(values_of(dataset, name)).any(axis=1)
        if not (whole and np.isfinite(values_of(dataset, OF_CONTAINER)[missing]).any()):
            found.append(name)
    return next((name for name in found if varies(dataset, name)), next(iter(found), OF_CONTAINER))


def title_of(dataset: "Dataset", name: str) -> str:
    """Return what a number is called: the solid fraction of the whole container is named after it where that of the
    bulk or of the bed is another one.
    """
    parts = any(is_own(dataset, part) for part in DENSITIES if part != OF_CONTAINER)
    return ("container " if name == OF_CONTAINER and parts else "") + name.replace("_", " ")


def warnings_of(texts: Iterable[str]) -> list[tuple[int, str]]:
    """Return how many runs have warnings that differ in their numbers only, with those of one of them, the most
    frequent ones first.

    Parameters
    ----------
    texts : iterable of str
        Sentences of each run; empty where it has none.
    """
    kinds: dict[str, list[str]] = {}
    for text in filter(None, texts):
        kinds.setdefault(re.sub(r"\d[\d.,e+-]*", "0", text), []).append(text)
    return sorted(((len(alike), alike[0]) for alike in kinds.values()), key=lambda kind: -kind[0])


def texts_of(dataset: "Dataset", name: str) -> list[list[str]]:
    """Return the texts of a variable of each cell, one for each seed: such as the sentences on failures, empty where a
    run has numbers. All are empty where the study has none.
    """
    dims = (*dimensions_of_cells(dataset), SEED)
    if name not in dataset:
        return [[""] * dataset.sizes[SEED]] * int(np.prod([dataset.sizes[dim] for dim in dims[:-1]], dtype=int))
    ordered = dataset[name].transpose(*dims).values
    return [[str(text) for text in row] for row in ordered.reshape(-1, dataset.sizes[SEED])]


def axes_of(dataset: "Dataset") -> dict[str, str]:
    """Return the dimension of each axis of a study, by name; axes that vary together have the same one."""
    found = {}
    for dimension in dimensions_of_cells(dataset):
        found[dimension] = dimension
        of_it = [name for name, value in dataset.coords.items() if value.dims == (dimension,)]
        found |= {str(name): dimension for name in of_it}
    return found


def labels_of(dataset: "Dataset") -> list[dict[str, Label]]:
    """Return what the values of each cell are called, by axis; empty where a listed cell leaves an axis out."""
    dims = dimensions_of_cells(dataset)
    axes = {name: [_label(value) for value in dataset[name].values] for name in axes_of(dataset)}
    places = np.ndindex(*(dataset.sizes[name] for name in dims))
    of_axis = axes_of(dataset)
    return [
        {name: labels[place[dims.index(of_axis[name])]] for name, labels in axes.items()}
        for place in map(tuple, places)
    ]


def _label(value: Any) -> Label:
    """Return a label: a number or a text."""
    plain = unwrapped(value)
    return plain if isinstance(plain, int | float) else str(plain)


def varied_axes(dataset: "Dataset") -> tuple[str, ...]:
    """Return the axes with at least two values; the names of listed cells come last."""
    found = [name for name in axes_of(dataset) if len(np.unique(dataset[name].values.astype(str))) > 1]
    return tuple(sorted(found, key=lambda name: name == LISTED))


def text_of(label: Label) -> str:
    """Return a label as text; whole numbers without decimals, an axis that a cell leaves out as a dash."""
    if isinstance(label, float):
        return f"{label:.12g}"
    return str(label) if label != "" else "\u2013"
