"""Machine-readable contents of a page: all its numbers as JSON."""

import csv
import dataclasses
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from voxgran import __version__
from voxgran._base.lazy import DataTree
from voxgran._base.scalars import finite
from voxgran.contacts.verify import Verification
from voxgran.measures.registered.density import main_numbers
from voxgran.packing.model import Packing
from voxgran.report import facts
from voxgran.report.figures import Figure


def page_numbers(
    packing: Packing, statistics: "DataTree | None", verification: "Verification | None", *, figures: Sequence[Figure]
) -> dict[str, Any]:
    """Return every number of a page, JSON-able."""
    scalars = {}
    if statistics is not None:
        for name, value in statistics.data_vars.items():
            if not value.ndim and value.dtype.kind in "biuf":
                scalars[str(name)] = {"value": value.item(), **{k: str(v) for k, v in value.attrs.items()}}
    return {
        "voxgran": __version__,
        "count": packing.count,
        **main_numbers(packing, statistics),
        "stop_reason": packing.stop_reason,
        "unit": packing.unit,
        "density": packing.density,
        "diameter": _spread(packing),
        "statistics": scalars,
        "verification": None if verification is None else dataclasses.asdict(verification),
        "figures": {figure.name: figure.numbers for figure in figures},
        "shapes": [
            {"name": name, "geometry": kind, "grains": grains, "share": share}
            for name, kind, grains, share in facts.shape_rows(packing)
        ],
        "provenance": dict(packing.provenance),
    }


def json_text(value: Any) -> str:
    """Return a value as JSON text; numbers that are not finite become null, as JSON cannot represent them."""
    return json.dumps(finite(value), indent=1, default=str, allow_nan=False, ensure_ascii=False) + "\n"


def _spread(packing: Packing) -> dict[str, float | None]:
    """Return smallest, median and largest equivalent diameter."""
    if not packing.count:
        return {"least": None, "median": None, "largest": None}
    low, middle, high = (float(value) for value in np.quantile(packing.diameters, [0.0, 0.5, 1.0]))
    return {"least": low, "median": middle, "largest": high}


def table_files(page: Path, tables: Mapping[str, Iterable[Sequence[str]]]) -> dict[Path, str]:
    """Return tables by their names as CSV files beside a page, ``page_NAME.csv``; empty tables have none.

    Numbers are those of the page, with the minus sign and without the spaces of thousands that programs read.
    """
    files = {}
    for name, rows in tables.items():
        out = io.StringIO()
        plain = [[text.replace("\u2212", "-").replace("\u202f", "") for text in row] for row in rows]
        csv.writer(out, lineterminator="\n").writerows(plain)
        if plain:
            files[page.with_name(f"{page.stem}_{name}.csv")] = out.getvalue()
    return files
