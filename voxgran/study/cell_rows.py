"""Table of the cells of a study: one row for each cell, with means, errors and intervals of all its numbers."""

import csv
import io
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from voxgran._base.lazy import Dataset
from voxgran.study.cell_values import FAILURE, FULL, WARNED, WARNINGS, is_full, labels_of, numbers_of, texts_of
from voxgran.study.statistics import Interval, summary


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
