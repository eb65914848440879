#!/usr/bin/env python3
"""Compare the numbers of the pages with what they come from: pages.py [--run] [--write] [PAGE ...]

The source of a number stands beside it in a comment, which no reader of the page sees:

  0.61<!-- = of("front", program="dense", grains=500000).inner_solid_fraction:.2f -->

    The number before the comment is the value of the expression: of(FILE, column=value, ...) is the only row of
    docs/figures/FILE.csv with these values, and column(FILE, name, column=value, ...) the list of a column. Names of
    columns have _ in place of dots.

  <!-- rows of dice.csv by solid where shaken == "true"
  | {solid} | {at(method="gravity").bulk_solid_fraction:.3f} | {published:.2f} |
  -->

    The rows of the table that follows, below its head, are made of these lines, once for each row of the file or, after
    "by", for each group of rows with equal values of some columns. A field has the value of a column, or of an
    expression: at(column=value, ...) is the only row of the group with these values, and each(name, column=value, ...)
    the list of a column of the group. After "values of" the lines are taken once, and the group is the whole file. The
    format .2r is .2g without exponents.

With --run, the Python of a page is run in an empty folder; what it prints is compared with the block "text" that
follows it, and what commands of a block "console" print with the lines below them, where there are some. With --write,
what differs is replaced in the pages. The status is 1 if something differed.
"""

import argparse
import contextlib
import csv
import difflib
import functools
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures"
COMMENT = r"<!--\s*{}\s*-->"
#: a number, and the expression and the format in the comment that follows it
VALUE = re.compile(r"(?P<old>[-+]?\d[\d,.]*(?:e[-+]?\d+)?)<!-- = (?P<expression>.+?)(?::(?P<form>[-+,.\w%]+))? -->")
#: a comment, and the head and the rows of the table that follows it
TABLE = re.compile(
    r"^<!-- (?P<kind>rows|values) of (?P<file>\w+)\.csv(?: by (?P<keys>[\w., ]+?))?(?: where (?P<where>.+?))?\n"
    r"(?P<lines>(?:\|.*\n)+)-->\n(?P<head>\n*(?:\|.*\n){2})(?P<body>(?:\|.*\n)*)",
    re.MULTILINE,
)
FIELD = re.compile(r"\{(?P<expression>[^{}]+?)(?::(?P<form>[-+,.\w%]+))?\}")
BLOCK = re.compile(r"^```(?P<kind>\w+)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)
#: blocks of Python that need files of the reader or a cluster, and the call that opens a window
NOT_RUN = ("scene.toml", "study.toml", "dask_jobqueue", "labels.tif")
WINDOW = re.compile(r"^packing\.plot\(.*$", re.MULTILINE)


class Row(dict[str, Any]):
    """A row of a file, whose values are also attributes."""

    def __getattr__(self, name: str) -> Any:
        """Return the value of a column."""
        if name not in self:
            raise KeyError(f"no column {name}; there are {', '.join(self)}")
        return self[name]


def pages() -> list[Path]:
    """Return the pages whose numbers are compared."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs").glob("[gsv]*/*.md"))]


@functools.cache
def table(name: str) -> list[Row]:
    """Return the rows of a file of docs/figures."""
    with (FIGURES / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        return [
            Row({re.sub(r"\W", "_", key): _number(text) for key, text in row.items()}) for row in csv.DictReader(file)
        ]


def _number(text: str) -> Any:
    """Return a cell as a number where it is one; that of NaN is empty."""
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return "" if text == "nan" else kind(text)
    return text


def chosen(rows: Iterable[Row], conditions: dict[str, Any]) -> list[Row]:
    """Return the rows with these values."""
    return [row for row in rows if all(getattr(row, name) == value for name, value in conditions.items())]


def only(rows: Iterable[Row], **conditions: Any) -> Row:
    """Return the only row with these values."""
    found = chosen(rows, conditions)
    if len(found) != 1:
        raise ValueError(f"{len(found)} rows have {conditions}")
    return found[0]


def listed(rows: Iterable[Row], name: str, **conditions: Any) -> list[Any]:
    """Return a column of the rows with these values."""
    return [getattr(row, name) for row in chosen(rows, conditions)]


#: what expressions may call
CALLS = {
    "of": lambda name, **conditions: only(table(name), **conditions),
    "column": lambda file, name, **conditions: listed(table(file), name, **conditions),
    "mean": lambda values: sum(values) / len(values),
    # root mean square of the difference of two columns
    "rms": lambda first, second: (sum((a - b) ** 2 for a, b in zip(first, second, strict=True)) / len(first)) ** 0.5,
    **{call.__name__: call for call in (abs, len, max, min, round, sum)},
}


def value_of(expression: str, names: dict[str, Any]) -> Any:
    """Return the value of an expression; an error names it."""
    try:
        return eval(expression, {"__builtins__": {}, **CALLS}, names)
    except Exception as error:
        error.add_note(f"in {expression}")
        raise


def told(expression: str, form: str | None, names: dict[str, Any]) -> str:
    """Return the value of an expression as text; nothing of an empty cell."""
    value = value_of(expression, names)
    if value == "":
        return ""
    if form and form.endswith("r"):
        return f"{float(format(value, f'{form[:-1]}g')):,.10g}"
    return format(value, form or "")


def line_of(template: str, names: dict[str, Any]) -> str:
    """Return a line whose fields have their values."""
    return FIELD.sub(lambda field: told(field["expression"], field["form"], names), template)


def body_of(match: re.Match[str]) -> str:
    """Return a table with the rows that its comment describes."""
    rows = table(match["file"])
    if match["where"]:
        rows = [row for row in rows if value_of(match["where"], {**row, "row": row})]
    groups: dict[Any, list[Row]] = {}
    for number, row in enumerate(rows):
        keys = tuple(row[key] for key in match["keys"].split(", ")) if match["keys"] else number
        groups.setdefault(None if match["kind"] == "values" else keys, []).append(row)
    body = ""
    for group in groups.values():
        same = {key: value for key, value in group[0].items() if all(row[key] == value for row in group)}
        calls = {"at": functools.partial(only, group), "each": functools.partial(listed, group), "row": group[0]}
        body += line_of(match["lines"], {**same, **calls})
    return match.group()[: match.start("body") - match.start()] + body


def filled(text: str) -> str:
    """Return the text of a page with the numbers of the files of docs/figures."""
    text = TABLE.sub(body_of, text)
    return VALUE.sub(
        lambda found: told(found["expression"], found["form"], {}) + found.group()[len(found["old"]) :], text
    )


def blocks_of(text: str) -> list[str]:
    """Return the blocks of Python of a page that can be run."""
    blocks = [block["body"] for block in BLOCK.finditer(text) if block["kind"] == "python"]
    return [block for block in blocks if not any(word in block for word in NOT_RUN)]


def printed(text: str) -> str:
    """Return the text of a page with what its Python and its commands print, run in the current folder."""
    names: dict[str, Any] = {}
    runnable, said = blocks_of(text), ""

    def ran(block: re.Match[str]) -> str:
        nonlocal said
        body, before, said = block["body"], said, ""
        if block["kind"] == "python" and body in runnable:
            output = io.StringIO()
            with contextlib.redirect_stdout(output):
                exec(compile(WINDOW.sub("", body), "page", "exec"), names)
            said = output.getvalue()
        elif block["kind"] == "text" and text[: block.start()].endswith("```\n\n") and before:
            body = before
        elif block["kind"] == "console" and re.search(r"^[^$\n]", body, re.MULTILINE):
            lines = re.findall(r"^\$ .*", body, flags=re.MULTILINE)
            body = "".join(f"{line}\n{output_of(line[2:])}" for line in lines)
        return f"```{block['kind']}\n{body}```"

    return BLOCK.sub(ran, text)


def output_of(command: str) -> str:
    """Return what a command prints."""
    words = [str(ROOT / word) if word.startswith(("examples/", "tools/")) else word for word in shlex.split(command)]
    program = {"python": [sys.executable], "voxgran": [sys.executable, "-m", "voxgran"]}[words[0]]
    where = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    ended = subprocess.run(
        [*program, *words[1:]], stdout=subprocess.PIPE, text=True, check=True, env={**os.environ, "PYTHONPATH": where}
    )
    return ended.stdout


def differences(page: Path, made: Callable[[str], str], *, write: bool = False) -> list[str]:
    """Return the lines of a page that differ from what is made of it; the page is replaced where this is asked."""
    old = page.read_text(encoding="utf-8")
    new = made(old)
    if write and new != old:
        page.write_text(new, encoding="utf-8")
    name = str(page.relative_to(ROOT)) if page.is_relative_to(ROOT) else page.name
    return list(difflib.unified_diff(old.splitlines(), new.splitlines(), name, "made", n=0, lineterm=""))


def main() -> int:
    """Compare the pages that are named, or all, and return the status."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw, allow_abbrev=False)
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE", help="default: all")
    parser.add_argument("--run", action="store_true", help="run the Python and the commands of the pages, too")
    parser.add_argument("--write", action="store_true", help="replace what differs")
    asked = parser.parse_args()
    found = []
    for page in [path.resolve() for path in asked.pages] or pages():
        found += differences(page, filled, write=asked.write)
        if asked.run:
            with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
                found += differences(page, printed, write=asked.write)
    sys.stdout.write("".join(f"{line}\n" for line in found))
    return int(bool(found) and not asked.write)


if __name__ == "__main__":
    sys.exit(main())
