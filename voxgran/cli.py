"""The command line.

Each subcommand is one function here and one entry in :data:`COMMANDS`. Errors are one line on the error stream; the
exit status is 2 for bad input, 1 for failure, 130 and 143 after an interrupt.
"""

import argparse
import contextlib
import json
import logging
import os
import shlex
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING
from pathlib import Path
from typing import Any, NoReturn

import voxgran
from voxgran._base.config import Parameter, parameters_of
from voxgran._base.errors import InputError, Interrupted, MissingLibraryError, UnknownNameError, VoxgranError
from voxgran._base.files import write_text
from voxgran._base.lazy import LIBRARIES, load
from voxgran._base.progress import OnStep, Step
from voxgran._base.registry import unknown


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        """Raise the message as bad input.

        Raises
        ------
        InputError
            Always.
        """
        raise InputError(f"{message}; see '{self.prog} --help'")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return the exit status.

    Parameters
    ----------
    arguments : sequence of str, optional
        Words after the program's name; left out: those of this process.

    Returns
    -------
    int
        0, or 2 for bad input, 1 for failure, 130 and 143 after an interrupt.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    with warnings.catch_warnings():
        warnings.showwarning = _warn  # type: ignore[assignment]
        return _run(words)


def _run(words: list[str]) -> int:
    """Run a command; what it raises becomes a line and an exit status."""
    try:
        options = _parser(words).parse_args(words)
        _set_logging(options)
        return int(COMMANDS[options.command][1](options) or 0)
    except Interrupted as stop:
        _complain(f"{stop}")
        _complain(f"to go on: voxgran {_resumed(words)}")
        return 128 + stop.signal_number
    except KeyboardInterrupt:
        _complain("stopped")
        return 130
    except VoxgranError as error:
        _complain(str(error))
        return error.exit_code
    except BrokenPipeError:
        # whoever read the output has gone: there is nobody to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def init(options: argparse.Namespace) -> None:
    """Write a scene file to start from."""
    write_text(options.file, SCENE, overwrite=options.overwrite)
    print(f"{options.file}: edit it, then 'voxgran plan {options.file}' and 'voxgran run {options.file} -o out'")


def plan(options: argparse.Namespace) -> None:
    """Say what a run would compute, skip and cost."""
    made = voxgran.Scene.from_toml(options.file).plan()
    print(json.dumps(made.to_mapping(), indent=2) if options.json else made)


def run(options: argparse.Namespace) -> None:
    """Pack, check, measure and save a scene."""
    scene = voxgran.Scene.from_toml(options.file)
    with _progress(options) as on_step:
        result = scene.run(options.output, resume=options.resume, overwrite=options.overwrite, on_step=on_step)
    _show(result.summary, options, f"results in {result.folder}")


def verify(options: argparse.Namespace) -> int:
    """Check a packing against the true shapes; exit status 1 where it fails."""
    proof = voxgran.verify(voxgran.load(options.file), tolerance=options.tolerance)
    _show(
        {
            "ok": proof.ok,
            "overlapping_pairs": proof.overlapping_pairs,
            "deepest": proof.deepest,
            "escaped": proof.escaped,
            "tolerance": proof.tolerance,
        },
        options,
    )
    return 0 if proof.ok else 1


def measure(options: argparse.Namespace) -> None:
    """Measure a packing."""
    tree = voxgran.measure(voxgran.load(options.file), which=options.which or None)
    if options.output:
        voxgran.save_statistics(tree, options.output, overwrite=options.overwrite)
    _show({name: float(value) for name, value in tree.dataset.data_vars.items() if value.ndim == 0}, options)


def report(options: argparse.Namespace) -> None:
    """Write a page about a packing."""
    target = Path(options.output or Path(options.file).with_suffix(".html"))
    packing = voxgran.load(options.file)
    voxgran.write_report(
        packing,
        target,
        statistics=voxgran.measure(packing),
        verification=voxgran.verify(packing),
        overwrite=options.overwrite,
    )
    print(target)


def shape(options: argparse.Namespace) -> None:
    """Make a shape of a family and write it."""
    from voxgran.shapes.family import families

    entry = families().get(options.family)
    given = {key: getattr(options, key) for key in _names(entry.parameters) if getattr(options, key) is not None}
    made = voxgran.make_shape(options.family, seed=options.seed, **given)
    if options.output:
        voxgran.save_shape(made, options.output, overwrite=options.overwrite)
    numbers = {"volume": made.volume, "surface_area": made.surface_area, "diameter": made.diameter}
    _show({"name": made.name, **numbers, "faces": len(made.faces)}, options)


def clump(options: argparse.Namespace) -> None:
    """Fit a clump of spheres to a mesh file and write its spheres."""
    made = voxgran.fit_clump(voxgran.load_shape(options.file), max_spheres=options.spheres, method=options.method)
    if options.output:
        rows = [
            "x,y,z,r",
            *(",".join(f"{v:.17g}" for v in (*c, r)) for c, r in zip(made.centers, made.radii, strict=True)),
        ]
        write_text(options.output, "\n".join(rows) + "\n", overwrite=options.overwrite)
    _show({"spheres": made.count, **made.errors.to_mapping()}, options)


def methods(options: argparse.Namespace) -> None:
    """List packing methods, clump methods, shape families and measures with their parameters."""
    from voxgran.clumps.method import clump_registry
    from voxgran.measure.model import measure_registry
    from voxgran.packing.method import method_registry
    from voxgran.shapes.family import families

    groups: dict[str, Any] = {
        "packing methods": method_registry(),
        "clump methods": clump_registry(),
        "shape families": families(),
        "measures": measure_registry(),
    }
    if options.json:
        print(json.dumps({title: list(registry.names()) for title, registry in groups.items()}, indent=2))
        return
    for title, registry in groups.items():
        print(title)
        for name in registry.names():
            entry = registry.get(name)
            print(f"  {name:18} {getattr(entry, 'summary', '')}")
            if source := getattr(entry, "source", ""):
                print(f"  {'':18} {source}")
            for item in parameters_of(entry.parameters) if hasattr(entry, "parameters") else ():
                print(f"      {item.name:20} {item.doc} ({_default(item)})")


def bench(options: argparse.Namespace) -> None:
    """Measure run time against error and write rows and a figure."""
    from voxgran.bench.model import trade_offs

    entry = trade_offs().get(options.name)
    for path in entry.run(Path(options.output)):
        print(path)


def doctor(options: argparse.Namespace) -> int:
    """Say what this machine has and how to mend what is missing."""
    found, good = {}, True
    for name in ("numpy", *LIBRARIES):
        try:
            module = load(name)
            found[name] = str(getattr(module, "__version__", "there"))
        except MissingLibraryError as error:
            found[name], good = str(error), False
    if good:
        window = load("vtkmodules.vtkRenderingCore").vtkRenderWindow
        load("vtkmodules.vtkRenderingOpenGL2")
        found["render window"] = type(window()).__name__
    found["threads"] = str(os.cpu_count())
    space = os.statvfs(".")
    found["free disk"] = f"{space.f_bavail * space.f_frsize / 2**30:.1f} GiB"
    _show({"voxgran": voxgran.__version__, **found, "all_good": good}, options)
    return 0 if good else 1


def demo(options: argparse.Namespace) -> int:
    """Pack scanned rocks and random solids, prove, measure, save and show them."""
    from voxgran.scene.demo import run_demo

    with _progress(options) as on_step:
        rows = run_demo(options.output, overwrite=options.overwrite, on_step=on_step)
    if options.json:
        print(json.dumps(rows, indent=2))
    else:
        _table(rows)
        print(f"results in {options.output}: open report.html, or packing.vtp and scene.vtm in ParaView")
    return 0 if all(row["verify"] == "ok" for row in rows) else 1


#: name: help, function, flags
COMMANDS: dict[str, tuple[str, Callable[[argparse.Namespace], int | None]]] = {
    "init": ("write a scene file to start from", init),
    "plan": ("say what a run would compute, skip and cost", plan),
    "run": ("pack, check, measure and save a scene", run),
    "verify": ("check a packing against the true shapes", verify),
    "measure": ("measure a packing", measure),
    "report": ("write a page with pictures about a packing", report),
    "shape": ("make a shape of a family", shape),
    "clump": ("fit a clump of spheres to a mesh file", clump),
    "methods": ("list methods, families and measures with their parameters", methods),
    "bench": ("measure run time against error", bench),
    "doctor": ("say what this machine has and what is missing", doctor),
    "demo": ("pack scanned rocks and random solids in a box", demo),
}

#: flags of each command beside --json and --overwrite
FLAGS: dict[str, tuple[tuple[tuple[str, ...], dict[str, Any]], ...]] = {
    "init": ((("file",), {"nargs": "?", "default": "scene.toml"}),),
    "plan": ((("file",), {}),),
    "run": (
        (("file",), {}),
        (("-o", "--output"), {"default": "out", "help": "folder for the results"}),
        (("--resume",), {"action": "store_true", "help": "go on from the checkpoint in the folder"}),
    ),
    "verify": ((("file",), {}), (("--tolerance",), {"type": float, "default": 1e-9, "help": "in mean diameters"})),
    "measure": (
        (("file",), {}),
        (("--which",), {"action": "append", "help": "a measure; may be repeated"}),
        (("-o", "--output"), {"help": "netCDF file"}),
    ),
    "report": ((("file",), {}), (("-o", "--output"), {"help": "HTML file"})),
    "clump": (
        (("file",), {}),
        (("--spheres",), {"type": int, "default": 50}),
        (("--method",), {}),
        (("-o", "--output"), {"help": "CSV file: x,y,z,r in the frame of the centroid"}),
    ),
    "bench": ((("name",), {}), (("-o", "--output"), {"default": "bench", "help": "folder"})),
    "demo": ((("-o", "--output"), {"default": "out/demo", "help": "folder for the results"}),),
}

SCENE = """\
# A scene of voxgran: 'voxgran plan' says what it costs, 'voxgran run' packs it.
[scene]
seed = 1
unit = "mm"

[[shape]]
family = "solid_union"
share = 1.0
solids = [3, 6]

[sizes]
kind = "lognormal"
median = 1.0
sigma = 0.2

[container]
kind = "box"
lengths = [5, 5, 8]
periodic = ["x", "y"]

[packing]
method = "digital"
count = 100
gravity = "-z"

[output]
vtk = true
statistics = true
report = true
"""


def _parser(words: Sequence[str]) -> Parser:
    """Return the parser; `shape` gets the flags of the family that the words name."""
    top = Parser(prog="voxgran", description="Packed assemblies of grains of true shape, checked and measured.")
    top.add_argument("--version", action="version", version=f"voxgran {voxgran.__version__}")
    named = [word for word in words if not word.startswith("-")]
    if named and named[0] not in COMMANDS:
        raise UnknownNameError(unknown("command", named[0], COMMANDS))
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (text, _) in COMMANDS.items():
        sub = commands.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".")
        for flags, keywords in FLAGS.get(name, ()):
            sub.add_argument(*flags, **keywords)
        if name == "shape":
            _add_family(sub, named)
        sub.add_argument("--json", action="store_true", help="print JSON")
        sub.add_argument("--overwrite", action="store_true", help="replace what is there")
        sub.add_argument("-v", "--verbose", action="store_true", help="say more on the error stream")
        sub.add_argument("-q", "--quiet", action="store_true", help="no progress")
    return top


def _add_family(sub: argparse.ArgumentParser, named: Sequence[str]) -> None:
    """Add the family, its parameters as flags, the seed and the output."""
    from voxgran.shapes.family import families

    sub.add_argument("family", help=", ".join(families().names()))
    sub.add_argument("--seed", type=int, default=0)
    sub.add_argument("-o", "--output", help="mesh file: STL, OBJ, PLY, OFF or VTP")
    if len(named) > 1 and named[0] == "shape":
        for item in parameters_of(families().get(named[1]).parameters):
            flag = "--" + item.name.replace("_", "-")
            text = f"{item.doc}, {item.type_text} ({_default(item)})".replace("%", "%%")
            sub.add_argument(flag, dest=item.name, type=_value, help=text)


def _value(text: str) -> Any:
    """Read a flag's value as TOML would, lists with or without brackets; anything else is text."""
    for candidate in (text, f"[{text}]" if "," in text else text):
        with contextlib.suppress(json.JSONDecodeError):
            return json.loads(candidate)
    return text.split(",") if "," in text else text


def _names(parameters: type) -> tuple[str, ...]:
    """Return the names of the fields of a parameter class."""
    return tuple(item.name for item in parameters_of(parameters))


def _default(item: Parameter) -> str:
    """Say what holds when a parameter is left out."""
    return "must be given" if item.default is MISSING else f"default {item.default!r}"


def _set_logging(options: argparse.Namespace) -> None:
    """Let the libraries' logs reach the error stream where asked."""
    if options.verbose:
        logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(name)s: %(message)s")


@contextlib.contextmanager
def _progress(options: argparse.Namespace) -> Iterator[OnStep | None]:
    """Show a progress bar on a terminal and nothing in a pipe (context manager)."""
    if options.quiet or options.json or not sys.stderr.isatty():
        yield None
        return
    rich = load("rich.progress")
    columns = (
        rich.TextColumn("{task.description:10}"),
        rich.BarColumn(),
        rich.TaskProgressColumn(),
        rich.TimeRemainingColumn(),
        rich.TextColumn("{task.fields[text]}"),
    )
    with rich.Progress(*columns, console=load("rich.console").Console(stderr=True), transient=True) as bar:
        stages: dict[str, Any] = {}

        def show(step: Step) -> None:
            if step.stage not in stages:
                stages[step.stage] = bar.add_task(step.stage, total=step.total or None, text="")
            bar.update(stages[step.stage], completed=step.done, total=step.total or None, text=step.text)

        yield show


def _show(numbers: dict[str, Any], options: argparse.Namespace, last: str = "") -> None:
    """Print numbers by name, or as JSON."""
    if options.json:
        print(json.dumps(numbers, indent=2, default=str))
        return
    for name, value in numbers.items():
        text = f"{value:.6g}" if isinstance(value, float) else str(value)
        print(f"{name.replace('_', ' '):24} {text}")
    if last:
        print(last)


def _table(rows: Sequence[dict[str, Any]]) -> None:
    """Print rows as a table."""
    heads = list(rows[0])
    cells = [[f"{row[h]:.4g}" if isinstance(row[h], float) else str(row[h]) for h in heads] for row in rows]
    wide = [max(len(text) for text in column) for column in zip(heads, *cells, strict=True)]
    for line in (heads, *cells):
        print("  ".join(text.rjust(width) for text, width in zip(line, wide, strict=True)))


def _resumed(words: Sequence[str]) -> str:
    """Return the command that goes on."""
    kept = [word for word in words if word != "--overwrite"]
    return shlex.join(kept if "--resume" in kept else [*kept, "--resume"])


def _warn(message: Warning | str, *_: Any) -> None:
    """Show a warning in one line."""
    _complain(f"warning: {message}")


def _complain(sentence: str) -> None:
    """Write one line to the error stream."""
    print(f"voxgran: {' '.join(sentence.split())}", file=sys.stderr)
