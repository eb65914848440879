"""The command `study`."""

import argparse
import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import voxgran
from voxgran.cli.terminal import complain, progress, show, table
from voxgran.study.cell_values import FULL, FULL_NOTE, WARNED, WARNINGS, is_full, title_of, warnings_of

if TYPE_CHECKING:
    from voxgran.study.result import StudyResult

#: numbers of the table that is printed, where they were measured
SHOWN = ("count", "bulk_solid_fraction", "bed_solid_fraction", "solid_fraction", "mean_coordination_number", "seconds")
#: most rows of that table, and most sentences of failures
MOST_ROWS, MOST_SENTENCES = 40, 5


def study(options: argparse.Namespace) -> int:
    """Run a study, or say what it would compute; exit status 1 where a run failed."""
    made = voxgran.Study(options.file)
    if options.dry_run:
        plan = made.plan(options.output)
        print(json.dumps(plan.to_mapping(), indent=2) if options.json else plan)
        return 0
    names = ("workers", "memory", "dask", "retry", "overwrite", "zarr")
    with progress(options, timed=False) as on_step:
        result = made.run(options.output, on_step=on_step, **{name: getattr(options, name) for name in names})
    failed = result.failures
    name = Path(options.file).stem
    result.write_page(title="Study" if name == "study" else f"Study {name}", overwrite=True)
    if not options.json:
        rows = _means(result)
        table(rows[:MOST_ROWS])
        if len(rows) > MOST_ROWS:
            print(f"... and {len(rows) - MOST_ROWS} cells more")
        if FULL in rows[0]:
            print(FULL_NOTE)
        _print_warnings(result.rows)
    # what failed has NaN there
    overlaps = sum(any(row.get(name, 0) > 0 for name in ("overlapping_pairs", "escaped_grains")) for row in result.rows)
    full = sum(is_full(row[WARNINGS]) for row in result.rows)
    numbers = {"runs": len(result.rows), "computed": result.computed, "failed": len(failed), "ended_full": full}
    numbers |= {"not_verified": overlaps, WARNED: sum(bool(row[WARNINGS]) for row in result.rows)}
    show(numbers, options, f"results in {result.folder}: study.html, study.nc, table.csv, cells.csv, comparisons.csv")
    sentences = Counter(row["failure"] for row in failed)
    for sentence, count in sentences.most_common(MOST_SENTENCES):
        complain(f"{count} of {len(result.rows)} runs failed: {sentence}")
    if len(sentences) > MOST_SENTENCES:
        complain(f"{len(sentences) - MOST_SENTENCES} other sentences on failures are in table.csv")
    return 1 if failed else 0


def _print_warnings(rows: Sequence[Mapping[str, Any]]) -> None:
    """Print how many runs have warned of what, with the sentence of one of them."""
    kinds = warnings_of(row[WARNINGS] for row in rows)
    for count, sentence in kinds[:MOST_SENTENCES]:
        print(f"{WARNED}: {count} of {len(rows)} runs, such as: {sentence}")
    if len(kinds) > MOST_SENTENCES:
        print(f"{WARNED}: {len(kinds) - MOST_SENTENCES} other kinds of warnings are in table.csv")


def _means(result: "StudyResult") -> list[dict[str, Any]]:
    """Return a row for each cell: its values, the number of its seeds with results, and means over them.

    What no run has, such as the bulk of small packings, is left out; so is how many runs ended full, or
    with a warning, where none did.
    """
    rows = result.rows
    names = list(rows[0])
    axes = names[: names.index("seed")]
    shown = [name for name in SHOWN if name in names and any(math.isfinite(row[name]) for row in rows)]
    titles = {name: title_of(result.dataset, name).replace(" ", "_") for name in shown}
    counted = {FULL: lambda row: is_full(row[WARNINGS]), WARNED: lambda row: bool(row[WARNINGS])}
    counts = {name: of for name, of in counted.items() if any(map(of, rows))}
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(tuple(row[axis] for axis in axes), []).append(row)
    made = []
    for values, group in groups.items():
        good = [row for row in group if not row["failure"]]
        means = {titles[name]: _mean([row[name] for row in good]) for name in shown}
        told: dict[str, Any] = {"seeds": f"{len(good)}/{len(group)}"}
        told |= {name: sum(map(of, group)) for name, of in counts.items()}
        made.append(dict(zip(axes, values, strict=True)) | told | means)
    return made


def _mean(values: Sequence[float]) -> float:
    """Return the mean of the numbers that are known; NaN where there are none."""
    known = [value for value in values if math.isfinite(value)]
    return math.fsum(known) / len(known) if known else math.nan
