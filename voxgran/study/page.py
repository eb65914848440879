"""Page of a study: figures, cells and comparisons in one self-contained HTML file, and the same numbers as csv.

Its table has one row for each cell, with means, errors and intervals of all numbers.
"""

import csv
import io
import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from voxgran import __version__
from voxgran._base.arrays import as_choice, as_number
from voxgran._base.errors import check_known
from voxgran._base.files import as_path, write_files
from voxgran._base.lazy import Dataset
from voxgran.report import facts
from voxgran.report.facts import Fact
from voxgran.report.figures import Figure
from voxgran.report.page import page_template
from voxgran.report.significance import LEVEL, p_text
from voxgran.study.cell_values import (
    DENSITIES,
    FAILURE,
    FULL,
    FULL_NOTE,
    OF_CONTAINER,
    WARNED,
    WARNINGS,
    axes_of,
    is_full,
    is_own,
    labels_of,
    main_variable,
    numbers_of,
    text_of,
    texts_of,
    title_of,
    values_of,
    varied_axes,
    varies,
    warnings_of,
)
from voxgran.study.comparisons import compare, compared_axis
from voxgran.study.experiments import bands_of
from voxgran.study.figures import figures_of
from voxgran.study.statistics import LEAST_FOR_BOOTSTRAP, Interval, summary

PAGE, CELLS_TABLE, COMPARISONS_TABLE = "study.html", "cells.csv", "comparisons.csv"
#: numbers that are compared and listed, where a study has them; of the densities there are figures
LISTED_NUMBERS = (*DENSITIES, "mean_coordination_number", "seconds", "memory")
#: numbers that are not compared: what the machine did
MACHINE = ("seconds", "memory")
#: most rows of a table on the page; all are in the csv files
MOST_ROWS = 400
MEBIBYTE = 2.0**20


@dataclass(frozen=True, slots=True)
class Table:
    """Table of the page as texts; `wraps` is whether its cells may take several lines."""

    name: str
    title: str
    head: list[str]
    rows: list[list[str]]
    notes: list[str]
    wraps: bool = False


def write_study_page(
    dataset: "Dataset",
    folder: str | os.PathLike[str],
    *,
    experiments: Mapping[str, Any] | None = None,
    title: str = "Study",
    over: str | None = None,
    variables: Sequence[str] | None = None,
    confidence: float = 0.95,
    interval: Interval = "auto",
    overwrite: bool = False,
) -> Path:
    """Write the page of a study with its figures, and its tables as csv files.

    Parameters
    ----------
    dataset : xarray.Dataset
        That of a study, with the dimension ``seed``.
    folder : path-like
        Folder for ``study.html``, ``cells.csv``, ``comparisons.csv`` and each figure as a ``.svg`` file.
    experiments : mapping, optional
        Ranges of measured values, drawn as bands: by value of the axis `shape`, or of the axis that is drawn in its
        place, a table with `low`, `high` and `source`, or a tuple of these.
    title : str
        Title of the page.
    over : str, optional
        Axis whose values are compared and told apart by colours. Default: `method` where it varies, otherwise the first
        that does.
    variables : sequence of str, optional
        Densities, or other numbers, that are drawn and compared. Default: the solid fractions of the study that vary
        are drawn, that of the bulk first, and compared, as is the mean coordination number.
    confidence, interval : float, str
        Those of :func:`voxgran.study.statistics.summary`.
    overwrite : bool
        Whether existing files may be replaced.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        If it is no dataset of a study, the axis has one value, or another value breaks a rule.
    UnknownNameError
        If the study has no such axis or variable, or `experiments` names a value that it has not.
    OutputExistsError
        If a file exists and `overwrite` is false.
    OutputError
        If a file cannot be written.

    Examples
    --------
    >>> import xarray as xr
    >>> from voxgran.study.page import write_study_page
    >>> data = xr.Dataset({"solid_fraction": (("method", "seed"), [[0.5, 0.52]])}, {"method": ["rsa"]})
    >>> write_study_page(data, "out", overwrite=True).name
    'study.html'
    """
    level = as_number(confidence, "confidence", above=0, at_most=0.9999)
    as_choice(interval, "interval", get_args(Interval))
    known = numbers_of(dataset)
    for name in variables or ():
        check_known("variable", name, known)
    axis = over or compared_axis(dataset)
    chosen = list(variables) if variables is not None else _chosen(dataset)
    compared = [name for name in chosen if name not in MACHINE]
    drawn = chosen if variables is not None else [name for name in chosen if name in DENSITIES]
    bands = bands_of(experiments)
    rows = cell_rows(dataset, confidence=level, interval=interval)
    tests = [row for name in compared if axis for row in compare(dataset, name, axis, confidence=level)]
    figures = [
        figure
        for name in drawn
        for figure in figures_of(dataset, name, over=axis, bands=bands, confidence=level, interval=interval)
    ]
    place = as_path(folder)
    files = _files(place, _html(dataset, rows, tests, title=title, figures=figures, level=level), rows, tests, figures)
    write_files(files, overwrite=overwrite)
    return place / PAGE


def _chosen(dataset: "Dataset") -> list[str]:
    """Return the numbers that are drawn or compared by default, the main one first; densities that vary, or one."""
    main = main_variable(dataset)
    # of beds that of the container says how high it is
    known = [n for n in LISTED_NUMBERS if is_own(dataset, n) and (n != OF_CONTAINER or n == main)]
    return [name for name in known if name == main] + [
        name for name in known if name != main and (name not in DENSITIES or varies(dataset, name))
    ]


def _files(
    folder: Path, page: str, rows: Sequence[Any], tests: Sequence[Any], figures: Sequence[Figure]
) -> dict[Path, str]:
    """Return the text of each file."""
    files = {folder / CELLS_TABLE: csv_text(rows), folder / COMPARISONS_TABLE: csv_text(tests)}
    files |= {folder / f"{figure.name}.svg": figure.svg for figure in figures}
    return {**files, folder / PAGE: page}


def _html(
    dataset: "Dataset",
    rows: Sequence[Mapping[str, Any]],
    tests: Sequence[Mapping[str, Any]],
    *,
    title: str,
    figures: Sequence[Figure],
    level: float,
) -> str:
    """Return the page."""
    tables = [_cells(dataset, rows, level), _failures(dataset, rows), _warnings(dataset), *_comparisons(dataset, tests)]
    axes = [f"{name} ({len(set(dataset[name].values.tolist()))})" for name in varied_axes(dataset)]
    text: str = page_template("study.html.j2").render(
        version=__version__,
        title=title,
        subtitle=f"Varied: {', '.join(axes)}." if axes else "One cell.",
        headline=_headline(dataset, rows),
        figures=figures,
        tables=[table for table in tables if table is not None and table.rows],
    )
    return text


def _headline(dataset: "Dataset", rows: Sequence[Mapping[str, Any]]) -> list[Fact]:
    """Return the numbers of cells, runs and failures, and what the study has cost."""
    runs, failed = sum(row["runs"] for row in rows), sum(row["failures"] for row in rows)
    found = [
        Fact("cells", facts.number(len(rows)), f"each with {facts.number(dataset.sizes['seed'])} seeds"),
        Fact("runs", facts.number(runs)),
        Fact(
            "failed", facts.number(failed), "see the table of failures" if failed else "", "bad" if failed else "good"
        ),
    ]
    if warned := sum(row[WARNED] for row in rows):
        found.append(Fact("warned", facts.number(warned), "see the table of warnings"))
    if is_own(dataset, "seconds"):
        found.append(Fact("CPU time", _time_text(float(np.nansum(values_of(dataset, "seconds"))))))
    if is_own(dataset, "memory"):
        largest = float(np.nanmax(values_of(dataset, "memory"))) / MEBIBYTE
        found.append(Fact("memory", f"{facts.number(largest)} MiB", "largest of all runs"))
    return found


def _time_text(seconds: float) -> str:
    """Return a duration as text."""
    if seconds < 100:
        return f"{facts.number(float(seconds))} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


def _cells(dataset: "Dataset", rows: Sequence[Mapping[str, Any]], level: float) -> Table:
    """Return the table of the cells."""
    axes = varied_axes(dataset) or tuple(axes_of(dataset))[:1]
    shown = [name for name in LISTED_NUMBERS if is_own(dataset, name)]
    heads = {"seconds": "CPU seconds", "memory": "memory (MiB)"}
    units = {name: str(dataset[name].attrs.get("units", "1")) for name in shown}
    names = [
        heads.get(name, title_of(dataset, name) + ("" if units[name] in ("", "1") else f" ({units[name]})"))
        for name in shown
    ]
    note = (
        f"Means over the seeds of each cell, with their {100 * level:g} % confidence intervals: of fewer than "
        f"{LEAST_FOR_BOOTSTRAP} values Student\u2019s, otherwise by the bootstrap (bias-corrected and accelerated), "
        "unless another kind was asked for. A single value has no interval."
    )
    counts = [name for name in (FULL, WARNED) if any(row[name] for row in rows)]
    notes = [note] + [f"{FULL_NOTE[0].upper()}{FULL_NOTE[1:]}."] * (FULL in counts)
    texts = [
        [
            *([text_of(row[axis]) for axis in axes] or ["the base"]),
            f"{row['runs'] - row['failures']} of {row['runs']}",
            *(text_of(row[name]) for name in counts),
            *(_cell_text(row, name) for name in shown),
        ]
        for row in rows
    ]
    head = [*(axes or ("cell",)), "runs", *counts, *names]
    return Table("cells", "Cells", head, _short(texts, notes, CELLS_TABLE), notes)


def _cell_text(row: Mapping[str, Any], name: str) -> str:
    """Return a mean as text, with its confidence interval where it says something of the packings."""
    if name not in MACHINE:
        return _mean_text(row, name)
    return facts.number(row[name] / (MEBIBYTE if name == "memory" else 1.0))


def _mean_text(row: Mapping[str, Any], name: str) -> str:
    """Return a mean with its confidence interval as text."""
    mean, low, high = (row[f"{name}{ending}"] for ending in ("", "_low", "_high"))
    if math.isnan(mean):
        return "not known"
    half = (high - low) / 2
    digits = facts.decimals_of(half)
    if math.isnan(half) or half == 0:
        return facts.number(mean)
    parts = [facts.number(v) if digits is None else f"{v:.{digits}f}".replace("-", "\u2212") for v in (mean, low, high)]
    return f"{parts[0]} [{parts[1]}, {parts[2]}]"


def _failures(dataset: "Dataset", rows: Sequence[Mapping[str, Any]]) -> Table | None:
    """Return the table of the runs that failed."""
    axes, texts = varied_axes(dataset), []
    seeds = [text_of(value) for value in dataset["seed"].values.tolist()]
    for row, sentences in zip(rows, texts_of(dataset, FAILURE), strict=True):
        for sentence in dict.fromkeys(text for text in sentences if text):
            of_it = [seed for seed, text in zip(seeds, sentences, strict=True) if text == sentence]
            cell = [text_of(row[axis]) for axis in axes] or ["the base"]
            texts.append([*cell, ", ".join(of_it), sentence])
    notes: list[str] = []
    head = [*(axes or ("cell",)), "seeds", "why"]
    return Table("failures", "Failures", head, _short(texts, notes, CELLS_TABLE), notes, wraps=True)


def _warnings(dataset: "Dataset") -> Table:
    """Return the table of what runs warned of."""
    told = warnings_of(text for texts in texts_of(dataset, WARNINGS) for text in texts)
    notes = [
        "Warnings that differ in their numbers only are one row, with those of one run. Those of all are in table.csv."
    ]
    texts = [[text_of(count), sentence] for count, sentence in told]
    return Table("warnings", "Warnings", ["runs", "such as"], _short(texts, notes, CELLS_TABLE), notes, wraps=True)


def _comparisons(dataset: "Dataset", tests: Sequence[Mapping[str, Any]]) -> list[Table]:
    """Return a table of comparisons for each variable."""
    tables = []
    for variable in dict.fromkeys(row["variable"] for row in tests):
        # first those that are pooled over several combinations
        of_it = sorted((row for row in tests if row["variable"] == variable), key=lambda row: row["blocks"] < 2)
        over = of_it[0]["over"]
        others = [name for name in axes_of(dataset) if name in of_it[0] and name != over]
        what = (
            f"Differences of {over}: Welch\u2019s t-test of each pair, with Hedges\u2019 g; the test of Kruskal and "
            "Wallis of all, with epsilon squared. Rows with \u201call\u201d are pooled over the combinations of the "
            "other axes."
        )
        how = (
            "The probability p is corrected for the number of tests of its kind by the procedure of Holm; a difference "
            f"with p below {LEVEL:g} is called significant. The runs of a cell are its independent samples. What has "
            "fewer than two runs, or no scatter, is not tested."
        )
        notes = [what, how]
        head = [*others, "compared", "runs", "difference", "effect size", "verdict"]
        texts = [[*(text_of(row[name]) for name in others), *_test_texts(row)] for row in of_it]
        title = f"Comparison of {title_of(dataset, variable)}"
        name = f"comparison-{variable.replace('_', '-')}"
        tables.append(Table(name, title, head, _short(texts, notes, COMPARISONS_TABLE), notes))
    return tables


def _test_texts(row: Mapping[str, Any]) -> list[str]:
    """Return what was compared, the runs, the difference, the effect size and the verdict of a test as texts."""
    verdict = row["verdict"] + ("" if math.isnan(row["p_holm"]) else f", {p_text(row['p_holm'])}")
    size = "" if math.isnan(row["effect_size"]) else facts.number(row["effect_size"])
    if row["test"] != "Welch":
        return ["all", str(row["count_one"]), "", f"\u03b5\u00b2 = {size}" if size else "", verdict]
    difference = _mean_text(row, "difference")
    g = f"g = {size} [{facts.number(row['effect_low'])}, {facts.number(row['effect_high'])}]" if size else ""
    return [f"{row['other']} \u2212 {row['one']}", f"{row['count_other']}, {row['count_one']}", difference, g, verdict]


def _short(rows: list[list[str]], notes: list[str], file: str) -> list[list[str]]:
    """Return the rows that the page shows, with a note on the others."""
    if len(rows) > MOST_ROWS:
        notes.append(f"The first {MOST_ROWS} of {len(rows)} rows; all are in {file}.")
    return rows[:MOST_ROWS]


def cell_rows(dataset: "Dataset", *, confidence: float = 0.95, interval: Interval = "auto") -> list[dict[str, Any]]:
    """Return one row for each cell of a study.

    Parameters
    ----------
    dataset : xarray.Dataset
        That of a study, with the dimension ``seed``.
    confidence, interval : float, str
        Those of :func:`voxgran.study.statistics.summary`.

    Returns
    -------
    list of dict
        The values of the axes; `runs`, `failures` and the sentences on these, `failure`; how many runs ended `full`,
        with fewer grains than asked for since no other had room; how many runs `warned`; and
        for each number of the study its mean under its own name, and with the endings ``_standard_error``, ``_low``,
        ``_high`` (limits of the confidence interval) and ``_count`` (number of values).

    Raises
    ------
    InputError
        If it is no dataset of a study, or `confidence` or `interval` breaks a rule.
    """
    rows: list[dict[str, Any]] = []
    texts = [texts_of(dataset, name) for name in (FAILURE, WARNINGS)]
    for labels, sentences, warned in zip(labels_of(dataset), *texts, strict=True):
        told = Counter(text for text in sentences if text)
        failure = "; ".join(text if count == 1 else f"{count} times: {text}" for text, count in told.items())
        counts = {FULL: sum(map(is_full, warned)), WARNED: sum(map(bool, warned))}
        rows.append({**labels, "runs": len(sentences), "failures": told.total(), "failure": failure, **counts})
    endings = {
        "": "mean",
        "_standard_error": "standard_error",
        "_low": "confidence_low",
        "_high": "confidence_high",
        "_count": "count",
    }
    for name in numbers_of(dataset):
        found = summary(dataset, name, confidence=confidence, interval=interval)
        for ending, column in endings.items():
            for row, value in zip(rows, found[column].values.ravel(), strict=True):
                row[f"{name}{ending}"] = value.item()
    return rows


def csv_text(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return rows as the text of a csv file: all columns of all rows, numbers with all digits, NaN as
    an empty field.
    """
    out = io.StringIO()
    writer = csv.DictWriter(out, list(dict.fromkeys(name for row in rows for name in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: "" if _unknown(value) else value for name, value in row.items()} for row in rows)
    return out.getvalue()


def _unknown(value: Any) -> bool:
    """Return whether a value is NaN."""
    return isinstance(value, float) and math.isnan(value)
