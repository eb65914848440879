"""Values of the cells of a study as rows: one row for each cell, one column for each seed."""

from typing import TYPE_CHECKING, Any

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.errors import InputError, UnknownNameError, shown
from voxgran._base.registry import unknown
from voxgran._base.scalars import unwrapped
from voxgran.study.axes import Label
from voxgran.study.cells import LISTED

if TYPE_CHECKING:
    from xarray import Dataset

#: dimension of the repetitions, and variables of the sentences on failures and of why packings ended
SEED, FAILURE, ENDED = "seed", "failure", "stop_reason"
#: why a packing ended that has fewer grains than asked for, since no other had room, and what a table says of it
FULL = "full"
FULL_NOTE = "full: runs that ended where nothing more had room, before the number or solid fraction that was asked for"


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
    if variable not in known:
        raise UnknownNameError(unknown("variable", variable, known))
    dims = (*dimensions_of_cells(dataset), SEED)
    ordered = dataset[variable].transpose(*dims).values.astype(np.float64)
    values: Floats = ordered.reshape(-1, dataset.sizes[SEED])
    values[~np.isfinite(values)] = np.nan
    return values


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
