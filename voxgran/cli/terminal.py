"""What the command line shows: numbers, tables, progress, warnings."""

import argparse
import contextlib
import json
import shutil
import sys
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from datetime import timedelta
from typing import Any

import voxgran
from voxgran._base.lazy import load
from voxgran._base.progress import OnStep, ProgressLines, Step, silent
from voxgran._base.scalars import finite

#: blanks and ends of lines that voxgran writes
SPACES = "\n\u00a0\u202f"
#: steps of a stage from which on their pace tells how long it takes
MANY = 20


class _Stream:
    """The error stream, which drops what its terminal does not take: one that is closed ends no work."""

    def __init__(self) -> None:
        self._stream = sys.stderr

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text."""
        with contextlib.suppress(OSError):
            self._stream.write(text)
        return len(text)

    def flush(self) -> None:
        """Pass on what was written."""
        with contextlib.suppress(OSError):
            self._stream.flush()


@contextlib.contextmanager
def progress(options: argparse.Namespace, *, timed: bool = True) -> Iterator[OnStep | None]:
    """Show the bar of the present stage on a terminal, and a line every ten seconds in a log (context manager).

    Parameters
    ----------
    options : argparse.Namespace
        Those of the command.
    timed : bool
        Whether rate and remaining time are shown, which follow from the steps; false where their texts tell the time.
    """
    if options.quiet or options.json:
        yield silent
        return
    if not sys.stderr.isatty():
        # the compilation of kernels gets no line of its own in a log
        yield ProgressLines(compiling=True)
        return
    rich = load("rich.progress")
    columns = (
        rich.TextColumn("{task.description:14}"),
        rich.BarColumn(),
        rich.TaskProgressColumn(),
        *((rich.TextColumn("{task.fields[rate]}"), rich.TextColumn("{task.fields[left]}")) * timed),
        rich.TextColumn("{task.fields[text]}"),
    )
    console = load("rich.console").Console(file=_Stream())
    # what is printed meanwhile stands above the bar, but goes to its own place where that is no terminal
    with rich.Progress(*columns, console=console, transient=True, redirect_stdout=sys.stdout.isatty()) as bar:
        stages: dict[str, Any] = {}
        present: list[Any] = []

        def show(step: Step) -> None:
            if step.stage not in stages:
                stages[step.stage] = bar.add_task(step.stage, total=step.total or None, text="", rate="", left="")
            task = stages[step.stage]
            if present != [task]:
                # another stage has ended, or waits for this one, at whatever share it was told last
                for other in present:
                    bar.update(other, visible=False)
                present[:] = [task]
                bar.update(task, visible=True)
            bar.update(task, completed=step.done, total=step.total or None, text=step.text)
            one = next(one for one in bar.tasks if one.id == task)
            # a few steps, such as those of finishing a scene, take times of their own
            left = one.time_remaining if step.total >= MANY else None
            bar.update(
                task,
                rate=f"{one.speed:,.0f}/s" if one.speed and step.total >= MANY else "",
                left="" if left is None else f"up to about {timedelta(seconds=int(left))}",
            )

        yield show


#: units of the depths of a verification, and what shares are of
UNITS = {
    **dict.fromkeys(("deepest", "tolerance"), "mean diameters"),
    **dict.fromkeys(("share_at_rest", "share_of_rattlers", "share_undecided"), "of all grains"),
    "share_at_rest_without_rattlers": "of the grains that are no rattlers",
}


def show(
    numbers: Mapping[str, Any], options: argparse.Namespace, last: str = "", units: Mapping[str, str] | None = None
) -> None:
    """Print numbers by name, or as JSON.

    Parameters
    ----------
    numbers : mapping
        The numbers.
    options : argparse.Namespace
        Those of the command.
    last : str
        A line behind them, not in JSON.
    units : mapping, optional
        What is written behind numbers besides `UNITS`, by name; not in JSON.
    """
    if options.json:
        print(json.dumps(finite(numbers), indent=2, default=str))
        return
    known = {**UNITS, **(units or {})}
    for name, value in numbers.items():
        print(f"{name.replace('_', ' '):24} {_with_unit(name, value, known)}")
    if last:
        print(last)


def _with_unit(name: str, value: Any, units: Mapping[str, str]) -> str:
    """Write a value with its unit; values in it have their own."""
    plain, unit = _plain(value, units), units.get(name, "1")
    return plain if unit == "1" or isinstance(value, Mapping) else f"{plain} {unit}"


def _plain(value: Any, units: Mapping[str, str]) -> str:
    """Write a value on one line, as a person would."""
    if isinstance(value, Mapping):
        items = (f"{str(key).replace('_', ' ')} {_with_unit(str(key), item, units)}" for key, item in value.items())
        return ", ".join(items) or "none"
    if isinstance(value, list | tuple):
        rows = any(isinstance(item, list | tuple) for item in value)
        return ("; " if rows else ", ").join(_plain(item, units) for item in value) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else printable(str(value))


def entry_line(name: str, text: str) -> None:
    """Print a name and, beside it, its text, wrapped to the width of the terminal; nothing where there is no text."""
    width = max(60, min(shutil.get_terminal_size(fallback=(120, 24)).columns, 120))
    start = f"{name:21} "
    if text:
        print(
            textwrap.fill(
                text,
                width,
                initial_indent=start,
                subsequent_indent=" " * len(start),
                break_long_words=False,
                break_on_hyphens=False,
            )
        )


def table(rows: Sequence[Mapping[str, Any]], *, head: bool = True, least: int = 0) -> None:
    """Print rows as a table, with their heads or as further rows of one; columns are at least so wide."""
    heads = list(rows[0])
    cells = [[f"{row[h]:.4g}" if isinstance(row[h], float) else printable(str(row[h])) for h in heads] for row in rows]
    wide = [max(least, *map(len, column)) for column in zip(heads, *cells, strict=True)]
    for line in (heads, *cells)[not head :]:
        print("  ".join(text.rjust(width) for text, width in zip(line, wide, strict=True)), flush=True)


def warn(message: Warning | str, *_: Any) -> None:
    """Show a warning in one line."""
    complain(f"warning: {message}")


def printable(text: str) -> str:
    """Return a text with what is no character of a text written as in Python: names in files, and of files, may hold
    bytes that are no text, or commands of a terminal.
    """
    return "".join(
        one if one.isprintable() or one in SPACES else one.encode("unicode_escape").decode("ascii") for one in text
    )


def complain(sentence: str) -> None:
    """Write one line to the error stream."""
    text = printable(" ".join(sentence.split()))
    # where the error stream takes nothing there is nobody to tell
    with contextlib.suppress(OSError):
        print(f"voxgran: {text}", file=sys.stderr)


def loaded(options: argparse.Namespace) -> Any:
    """Load a packing; say on the error stream what was assumed."""
    packing = voxgran.load(options.file, unit=options.unit, periodic=options.periodic, shrink=options.shrink)
    say_assumed(packing)
    return packing


def say_assumed(packing: Any, of_what: str = "") -> None:
    """Say what was assumed of spheres of another program."""
    for subject, sentence in packing.provenance.get("assumed", {}).items():
        complain(f"{of_what}assumed {subject}: {sentence}")
