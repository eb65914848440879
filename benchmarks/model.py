"""The list of benchmarks, the clock and the figure that they share, and the other programs that some start."""

import argparse
import contextlib
import csv
import io
import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from voxgran._base.arrays import Floats
from voxgran._base.files import write_text, written_whole
from voxgran._base.lazy import load
from voxgran._base.seeds import stream

if TYPE_CHECKING:
    from voxgran.shapes.model import Shape

LOG = logging.getLogger(__name__)
P = ParamSpec("P")
T = TypeVar("T")
#: column of the yardstick, and ending of columns of seconds in units of it
YARDSTICK, OVER = "calibration_seconds", "_over_calibration"
#: folder of the programs that are compared with voxgran
PEERS = Path(__file__).with_name("peers")
#: folder of the scanned bodies
DATA = PEERS.parents[1] / "data"


def benchmarks() -> dict[str, str]:
    """Return the module of each benchmark by its name, which is that of its file.

    Its function ``run`` writes rows and a figure into a folder and returns the files.
    """
    files = (path for path in Path(__file__).parent.glob("*/[!_]*.py") if path.parent != PEERS)
    return {
        path.stem: f"benchmarks.{path.parent.name}.{path.stem}" for path in sorted(files, key=lambda path: path.stem)
    }


def peer_arrays(
    script: Path, name: str, write: Callable[[Path], object], *words: str, longest: float
) -> tuple[dict[str, Floats], float] | None:
    """Run the program of a peer, and return the arrays that it makes and its seconds; None where it fails.

    The program gets the path of a file of this name, which `write` has written, words, and the path of the file of
    arrays that it writes. It is run by the interpreter that the environment variable ``VOXGRAN_PEERS`` names, and is
    stopped after `longest` seconds.
    """
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / name, Path(folder) / "made.npz"
        write(given)
        command = [os.environ.get("VOXGRAN_PEERS", sys.executable), *map(str, (script, given, *words, made))]
        try:
            ended = subprocess.run(command, capture_output=True, text=True, timeout=longest, check=True)
        except (OSError, subprocess.SubprocessError):
            return None
        with np.load(made, allow_pickle=False) as arrays:
            return dict(arrays), float(ended.stdout.split()[-1])


def timed(work: Callable[P, T], *arguments: P.args, **keywords: P.kwargs) -> tuple[T, float]:
    """Return what a call returns, and its CPU seconds, summed over threads."""
    began = time.process_time()
    found = work(*arguments, **keywords)
    return found, time.process_time() - began


def least_seconds(work: Callable[[], object], *, repeats: int = 3, processor: bool = False) -> float:
    """Return the least wall time, or CPU time summed over threads, of some calls after one that is not counted
    (it compiles and loads).
    """
    clock = time.process_time if processor else time.perf_counter
    work()
    times = []
    for _ in range(repeats):
        began = clock()
        work()
        times.append(clock() - began)
    return min(times)


def calibration() -> float:
    """Return the yardstick by which rows from different machines compare: the least CPU time of
    `scipy.ndimage.distance_transform_edt` of 128^3 voxels, half of them solid at random.
    """
    solid = stream(0, "yardstick").random((128, 128, 128)) < 0.5
    return least_seconds(lambda: load("scipy.ndimage").distance_transform_edt(solid), processor=True)


def best_rate(
    work: Callable[..., Any], attempts: int, *, least_time: float, draw: Callable[[], Iterable[Any]] = tuple
) -> tuple[float, list[Any]]:
    """Return the highest number of attempts per CPU second of two or more calls, and what the calls returned.

    Each call makes the same number of attempts, with arguments that are drawn before its time is taken; calls are
    repeated for at least `least_time` seconds.
    """
    best, began = 0.0, time.perf_counter()
    found: list[Any] = []
    while len(found) < 2 or time.perf_counter() - began < least_time:
        drawn = draw()
        start = time.process_time()
        found.append(work(*drawn))
        best = max(best, attempts / (time.process_time() - start))
    return best, found


def scans(*names: str) -> dict[str, "Shape"]:
    """Return the scanned bodies of such files by the stem of the name; those that the repository does not have lack."""
    from voxgran.shapes.files import load_shape

    return {Path(name).stem: load_shape(DATA / name) for name in names if (DATA / name).is_file()}


def ratios(rate: float, peers: Iterable[float | None]) -> list[float | None]:
    """Return a rate over those of peers; None for a peer without a rate."""
    return [None if peer is None else rate / peer for peer in peers]


def arguments(about: str | None, *needed: str, **others: Any) -> list[Any]:
    """Return what a program is given by position on its command line; its help shows the text about it.

    needed: names of paths that must be given.  others: names and defaults of the others, which have the types of these;
    a list takes all texts that follow.
    """
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=about, formatter_class=raw, allow_abbrev=False)
    for name in needed:
        parser.add_argument(name, type=Path)
    for name, default in others.items():
        many = isinstance(default, list)
        kind = str if many else type(default)
        parser.add_argument(name, nargs="*" if many else "?", type=kind, default=default, help=f"default: {default}")
    return list(vars(parser.parse_args()).values())


def write_rows(path: Path, head: str, rows: Iterable[str | Sequence[Any]]) -> Path:
    """Write a CSV table and return its path.

    The head names the columns, each with the format of its values after a colon where they have one, such as
    ``"shape,seconds:.3f"``. A row has a value for each column, or is a line of CSV already. Truths are written as
    ``true`` and ``false``; of None and NaN the cell is empty.

    A table with seconds or rates has the column :data:`YARDSTICK`, which is measured where the rows lack it, and these
    columns once more in units of it, such as ``seconds_over_calibration`` and ``attempts_per_calibration``.
    """
    columns = [column.partition(":") for column in head.split(",")]
    names, formats = [name for name, _, _ in columns], [form for _, _, form in columns]
    table = [
        next(csv.reader([row])) if isinstance(row, str) else [_cell(*pair) for pair in zip(row, formats, strict=True)]
        for row in rows
    ]
    timed = [name for name in names if name != YARDSTICK and ("seconds" in name or _is_rate(name))]
    if timed and YARDSTICK not in names:
        loop = f"{calibration():.5f}"
        names, table = [*names, YARDSTICK], [[*row, loop] for row in table]
    for row in table:
        told = dict(zip(names, row, strict=True))
        row += [_in_yardsticks(name, told[name], told[YARDSTICK]) for name in timed]
    names += [name.replace("per_second", "per_calibration") if _is_rate(name) else f"{name}{OVER}" for name in timed]
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([names, *table])
    write_text(path, text.getvalue())
    return path


def _cell(value: Any, form: str) -> str:
    """Return a value as the text of a cell."""
    if value is None or value != value:
        return ""
    return str(value).lower() if isinstance(value, bool | np.bool_) else format(value, form)


def _is_rate(name: str) -> bool:
    """Return whether a column has numbers per second."""
    return name.endswith("per_second")


def _in_yardsticks(name: str, value: str, loop: str) -> str:
    """Return seconds or a rate in units of the yardstick; empty where there is none."""
    if not value or not loop:
        return ""
    if _is_rate(name):
        return f"{float(value) * float(loop):.4g}"
    factor = {"micro": 1e-6, "milli": 1e-3}.get(name[:5], 1.0)
    return f"{float(value) * factor / float(loop):.4g}"


@contextlib.contextmanager
def panels_of(
    path: Path, columns: int, *, width: float, rows: int = 1, height: float = 4.0, legend: int = 8, **shared: bool
) -> Iterator[Any]:
    """Give the panels of a figure in a row, and write it, with grids, as SVG at the end (context manager).

    A panel with labels gets a legend of a font size; with 0 none.
    """
    figure = load("matplotlib.figure").Figure(figsize=(width, height), layout="constrained")
    yield np.atleast_1d(figure.subplots(rows, columns, **shared)).ravel()
    for panel in figure.axes:
        panel.grid(visible=True, alpha=0.3)
        if legend and panel.get_legend_handles_labels()[0]:
            panel.legend(frameon=False, fontsize=legend)
    with written_whole(path) as draft:
        figure.savefig(draft, format="svg")
