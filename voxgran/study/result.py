"""Results of a study: one dataset over all dimensions and seeds, and one row for each run."""

import csv
import io
import json
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from voxgran import __version__
from voxgran._base import ExplainedAttributes
from voxgran._base.calls import explained_methods
from voxgran._base.files import written_whole
from voxgran._base.lazy import Dataset, load
from voxgran.io.netcdf import save_statistics
from voxgran.study.cells import Cell, Dimension
from voxgran.study.comparisons import compare
from voxgran.study.page import write_study_page
from voxgran.study.runs import Record
from voxgran.study.statistics import Interval, summary

DATASET, TABLE, ZARR = "study.nc", "table.csv", "study.zarr"
#: variables that say what the machine did, and differ each time
MACHINE = {"seconds": ("s", "CPU time"), "memory": ("byte", "memory of the process at the peak")}
#: variables that are texts
TEXTS = {
    "stop_reason": "why the packing ended",
    "warnings": "what was warned of",
    "failure": "why there are no numbers; empty where there are",
}


@explained_methods
@dataclass(frozen=True, slots=True, kw_only=True)
class StudyResult(ExplainedAttributes):
    """What a study has left.

    Attributes
    ----------
    dataset : xarray.Dataset
        All numbers over the dimensions of the study and ``seed``: those of the verification and of the measures, NaN
        where a run failed; `seconds` of CPU time and `memory` in bytes, which differ each time; the texts
        `stop_reason`, `warnings` and `failure`.
    rows : list of dict
        The same, one row for each run.
    folder : Path
        Where the files are.
    computed : int
        How many runs were computed by this call; the others were there before.
    experiments : dict
        Ranges of measured values beside which the results are drawn.

    Examples
    --------
    >>> import xarray as xr
    >>> from pathlib import Path
    >>> from voxgran.study.result import StudyResult
    >>> data = xr.Dataset({"solid_fraction": (("method", "seed"), [[0.5, 0.52, 0.54]])}, {"method": ["rsa"]})
    >>> StudyResult(dataset=data, rows=[], folder=Path("study"), computed=3).failures
    []
    """

    dataset: "Dataset"
    rows: list[dict[str, Any]]
    folder: Path
    computed: int
    experiments: dict[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Numbers of runs, dimensions and folder."""
        sizes = self.dataset.sizes
        sides = " x ".join(f"{name} {count}" for name, count in sizes.items())
        failed = len(self.failures)
        runs = f"{len(self.rows)} runs, {len(self.rows) - failed} finished, {failed} failed"
        return f"StudyResult({runs}; {sides}; in {str(self.folder)!r})"

    @property
    def failures(self) -> list[dict[str, Any]]:
        """Rows of the runs that failed."""
        return [row for row in self.rows if row["failure"]]

    def summary(
        self, variable: str | None = None, *, confidence: float = 0.95, interval: Interval = "auto"
    ) -> "Dataset":
        """Return the mean of a variable over the seeds of each cell, with its standard error and confidence interval;
        as :func:`voxgran.study.statistics.summary`.

        Examples
        --------
        >>> import xarray as xr
        >>> from pathlib import Path
        >>> from voxgran.study.result import StudyResult
        >>> data = xr.Dataset({"solid_fraction": (("method", "seed"), [[0.5, 0.52, 0.54]])}, {"method": ["rsa"]})
        >>> result = StudyResult(dataset=data, rows=[], folder=Path("study"), computed=3)
        >>> float(result.summary().standard_error.round(4).item())
        0.0115
        """
        return summary(self.dataset, variable, confidence=confidence, interval=interval)

    def compare(self, variable: str | None = None, over: str | None = None, *, confidence: float = 0.95) -> Any:
        """Return a pandas.DataFrame with the comparisons of the values of one axis: differences, the tests of Welch and
        of Kruskal and Wallis, and effect sizes; its columns are those of :func:`voxgran.study.comparisons.compare`.

        Examples
        --------
        >>> import xarray as xr
        >>> from pathlib import Path
        >>> from voxgran.study.result import StudyResult
        >>> values = [[0.50, 0.52, 0.54], [0.60, 0.61, 0.62]]
        >>> data = xr.Dataset({"solid_fraction": (("method", "seed"), values)}, {"method": ["rsa", "jam"]})
        >>> result = StudyResult(dataset=data, rows=[], folder=Path("study"), computed=6)
        >>> result.compare()[["test", "verdict"]].values.tolist()
        [['Welch', 'significant'], ['Kruskal-Wallis', 'not significant']]
        """
        return load("pandas").DataFrame(compare(self.dataset, variable, over, confidence=confidence))

    def write_page(
        self,
        folder: str | os.PathLike[str] | None = None,
        *,
        title: str = "Study",
        over: str | None = None,
        variables: Sequence[str] | None = None,
        confidence: float = 0.95,
        interval: Interval = "auto",
        overwrite: bool = False,
    ) -> Path:
        """Write a page with figures and tables, and csv files; as :func:`voxgran.study.page.write_study_page`, by
        default into the folder of the study, with its experiments.

        Examples
        --------
        >>> import xarray as xr
        >>> from pathlib import Path
        >>> from voxgran.study.result import StudyResult
        >>> data = xr.Dataset({"solid_fraction": (("method", "seed"), [[0.5, 0.52]])}, {"method": ["rsa"]})
        >>> StudyResult(dataset=data, rows=[], folder=Path("study"), computed=2).write_page().as_posix()
        'study/study.html'
        """
        return write_study_page(
            self.dataset,
            self.folder if folder is None else folder,
            experiments=self.experiments,
            title=title,
            over=over,
            variables=variables,
            confidence=confidence,
            interval=interval,
            overwrite=overwrite,
        )

    def table(self) -> Any:
        """Return a pandas.DataFrame with one row for each run: coordinates, seed, numbers and texts.

        Examples
        --------
        >>> import xarray as xr
        >>> from pathlib import Path
        >>> from voxgran.study.result import StudyResult
        >>> rows = [{"method": "rsa", "seed": 0, "solid_fraction": 0.31, "failure": ""}]
        >>> result = StudyResult(dataset=xr.Dataset(), rows=rows, folder=Path("study"), computed=1)
        >>> result.table().solid_fraction.tolist()
        [0.31]
        """
        return load("pandas").DataFrame(self.rows)


def rows_of(cells: Sequence[Cell], seeds: Sequence[int], records: Mapping[tuple[int, int], Record]) -> list[Any]:
    """Return one row for each run.

    Parameters
    ----------
    cells : sequence of Cell
        All cells.
    seeds : sequence of int
        Seeds of each.
    records : mapping
        What each run has left, by the numbers of its cell and of its seed.
    """
    coordinates = dict.fromkeys(name for cell in cells for name in cell.values)
    numbers = list(dict.fromkeys(name for record in records.values() for name in record.numbers))
    rows = []
    for (at, number), record in sorted(records.items(), key=lambda item: item[0]):
        row: dict[str, Any] = {name: cells[at].values.get(name, "") for name in coordinates}
        row["seed"] = seeds[number]
        row |= {_named(name, coordinates): record.numbers.get(name, [math.nan])[0] for name in numbers}
        row |= {"seconds": record.seconds, "memory": record.memory, "stop_reason": record.stop_reason}
        rows.append(row | {"warnings": "; ".join(record.warnings), "failure": record.failure})
    return rows


def _named(name: str, coordinates: Mapping[str, Any]) -> str:
    """Return the name of a number, which is another one where an axis has it."""
    return f"measured_{name}" if name in coordinates or name == "seed" else name


def dataset_of(
    dimensions: Sequence[Dimension],
    cells: Sequence[Cell],
    seeds: Sequence[int],
    records: Mapping[tuple[int, int], Record],
) -> "Dataset":
    """Return all results along the dimensions of a study and ``seed``.

    Parameters
    ----------
    dimensions : sequence of Dimension
        What is varied.
    cells : sequence of Cell
        All cells, the last dimension varying fastest.
    seeds : sequence of int
        Seeds of each.
    records : mapping
        What each run has left, by the numbers of its cell and of its seed.
    """
    dims = (*(dimension.name for dimension in dimensions), "seed")
    shape = (*(len(dimension) for dimension in dimensions), len(seeds))
    coordinates: dict[str, Any] = {
        name: (dimension.name, _array(labels)) for dimension in dimensions for name, labels in dimension.labels.items()
    }
    coordinates["seed"] = ("seed", np.array(seeds, dtype=np.int64))
    order = [records[at, number] for at in range(len(cells)) for number in range(len(seeds))]
    variables: dict[str, Any] = {}
    for name in dict.fromkeys(name for record in order for name in record.numbers):
        values = np.array([record.numbers.get(name, [math.nan])[0] for record in order]).reshape(shape)
        told = {tuple(record.numbers[name][1:]) for record in order if name in record.numbers}
        units = {unit for unit, _ in told}
        attributes = {"units": " or ".join(sorted(units)), "long_name": min(told)[1]}
        variables[_named(name, coordinates)] = (dims, values, attributes)
    for name, (unit, text) in MACHINE.items():
        values = np.array([float(getattr(record, name)) for record in order]).reshape(shape)
        variables[name] = (dims, values, {"units": unit, "long_name": text})
    for name, text in TEXTS.items():
        values = np.array([_text(getattr(record, name)) for record in order], dtype=object).reshape(shape)
        variables[name] = (dims, values, {"long_name": text})
    made: Dataset = load("xarray").Dataset(variables, coords=coordinates, attrs={"voxgran": __version__})
    return made


def _array(labels: Sequence[Any]) -> Any:
    """Return labels as an array: numbers, or texts."""
    return np.array(labels) if all(isinstance(v, int | float) for v in labels) else np.array(labels, dtype=object)


def _text(value: Any) -> str:
    """Return texts as one."""
    return "; ".join(value) if isinstance(value, list) else str(value)


def _is_zarr(path: Path, root: Path) -> bool:
    """Return whether a file is named as one of zarr, in the folder of a dataset that voxgran has written."""
    try:
        about = json.loads((root / ".zattrs").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return "voxgran" in about and re.fullmatch(r"\.z\w+|\d+(\.\d+)*", path.name) is not None


def save_results(dataset: "Dataset", rows: Sequence[Mapping[str, Any]], folder: Path, *, zarr: bool) -> None:
    """Write the dataset and the table.

    Parameters
    ----------
    dataset : xarray.Dataset
        All results.
    rows : sequence of mapping
        One for each run.
    folder : Path
        Folder of the study.
    zarr : bool
        Whether the dataset is written as zarr, too.

    Raises
    ------
    OutputError
        If something cannot be written.
    OutputExistsError
        If the folder of the dataset as zarr holds something else.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    with written_whole(folder / TABLE) as table:
        table.write_text(text.getvalue(), encoding="utf-8")
        save_statistics(load("xarray").DataTree(dataset, name="study"), folder / DATASET, overwrite=True)
        if zarr:
            place = folder / ZARR
            with written_whole(place, is_own=lambda path: _is_zarr(path, place)) as draft:
                # the specification of format 3 has no texts yet
                dataset.to_zarr(draft, mode="w", zarr_format=2)
