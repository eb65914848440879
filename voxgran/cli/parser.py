"""Words and flags of the command line, the help of each command with an example, and shell completion."""

import argparse
import contextlib
import dataclasses
import json
import re
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING
from typing import Any, NoReturn

import voxgran
from voxgran._base.config import Parameter, parameters_of
from voxgran._base.errors import InputError, UnknownNameError, shown
from voxgran._base.lazy import load
from voxgran._base.names import nearest, unknown
from voxgran._base.warning import warn_former
from voxgran.cli.examples import EXAMPLES
from voxgran.decks.material import Material
from voxgran.decks.simulation import LONGEST, REST
from voxgran.decks.write import KINDS
from voxgran.packing.grains import ColorBy
from voxgran.settling.parameters import Settling


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, and whose flags are written out: parts of names are ambiguous."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**{"allow_abbrev": False, **keywords})
        self.register("action", None, _Once)

    def error(self, message: str) -> NoReturn:
        """Raise the message as bad input.

        Raises
        ------
        InputError
            Always.
        """
        short = re.sub(r"(\S{57})\S{4,}", r"\1...", message)
        raise InputError(f"{short}; see '{self.prog} --help'")

    def _get_values(self, action: argparse.Action, arg_strings: list[str]) -> Any:
        """Convert the values of a flag; argparse makes an empty list of ``--``, which no flag takes."""
        if action.option_strings and "--" in arg_strings:
            self.error(f"argument {action.option_strings[-1]}: expected a value, not '--'")
        return super()._get_values(action, arg_strings)

    def _print_message(self, message: str, file: Any = None) -> None:
        """Print help or version; argparse itself passes over an output that takes nothing."""
        print(message, end="", file=file)


Flag = tuple[tuple[str, ...], dict[str, Any]]


def _flag(*names: str, **keywords: Any) -> Flag:
    """Return the arguments of :meth:`argparse.ArgumentParser.add_argument`."""
    return names, keywords


def _refuse_again(namespace: argparse.Namespace, dest: str, flag: str | None) -> None:
    """Note that a flag sets `dest`, and refuse it where one has set it before, whose value would be lost silently."""
    given = vars(namespace).setdefault("given", {})
    if flag and dest in given:
        former = "twice" if given[dest] == flag else f"beside {given[dest]}"
        raise InputError(f"{flag} is given {former}: it takes effect once; leave one of them out")
    given[dest] = flag


class _Once(argparse.Action):
    """A flag whose value is stored, and which may be given once."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        """Store the value."""
        _refuse_again(namespace, self.dest, option_string)
        setattr(namespace, self.dest, values)


class _Former(_Once):
    """A former flag: stores its value under the present one, named by `dest`, and what to say of it in `former`."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        """Store the value."""
        super().__call__(parser, namespace, values, option_string)
        present = f"--{self.dest.replace('_', '-')}"
        namespace.former = f"flag {option_string} is now {present}; write that name"


class _Switch(argparse.BooleanOptionalAction):
    """A flag with its opposite, of which one may be given once."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        """Store True or False."""
        _refuse_again(namespace, self.dest, option_string)
        super().__call__(parser, namespace, values, option_string)


def _former(flag: str, present: str, kind: Callable[[str], Any]) -> Flag:
    """Return the arguments of a former flag, which the help does not show."""
    dest = present.removeprefix("--").replace("-", "_")
    return _flag(flag, dest=dest, action=_Former, type=kind, default=argparse.SUPPRESS, help=argparse.SUPPRESS)


def _value(text: str) -> Any:
    """Read a flag's value as TOML would, lists with or without brackets; anything else is text."""
    for candidate in (text, f"[{text}]" if "," in text else text):
        # a number of more than 4300 digits is a ValueError too, and deep brackets recurse too far
        with contextlib.suppress(ValueError, RecursionError):
            return json.loads(candidate)
    return text.split(",") if "," in text else text


#: whether a page has a view beside its pictures
INTERACTIVE = _flag("--interactive", action=_Switch, default=True, help="a view to turn and cut in a browser")
#: directions that begin like a flag
DIRECTION = re.compile(r"-[xyz]|-[\d.][^,]*,.*")
#: what a command line holds beside flags of its command
NO_FLAGS = ("command", "family", "file", "name", "print_completion")
#: a packing, and what may be said of a file of another program
PACKING: tuple[Flag, ...] = (
    _flag("file", help="a saved packing, or spheres of another program: text, CSV, LAMMPS, VTK points"),
    _flag("--periodic", help="axes along which the box of such spheres is periodic, such as xy"),
    _flag("--unit", help="unit of lengths of such spheres"),
)
#: engine, and what a simulation needs beside its material
ENGINE = _flag("--engine", default="lammps", help="engine; 'voxgran engines' lists them")
DECK: tuple[Flag, ...] = (
    _flag("--clump", type=int, help="spheres of a clump in place of each shape that is no sphere"),
    _flag("--time-step", type=float, help="time step in s; default: by the contact law"),
)
TARGETS = ("iou", "volume", "inertia", "surface")
COLORED = _flag(
    "--color-by", choices=typing.get_args(ColorBy), default="diameter", help="what the grains are coloured by"
)

#: flags of each command beside --json and --overwrite
FLAGS: dict[str, tuple[Flag, ...]] = {
    "init": (_flag("file", nargs="?", default="scene.toml"),),
    "plan": (_flag("file", help="scene file"),),
    "run": (
        _flag("file", help="scene file"),
        _flag("-o", "--output", default="out", help="folder for the results"),
        _flag("--resume", action="store_true", help="go on from the checkpoint in the folder"),
    ),
    "verify": (*PACKING, _flag("--tolerance", type=float, default=1e-9, help="in mean diameters")),
    "settle": (
        *PACKING,
        _flag("-o", "--output", required=True, help="file for the settled packing: .vtp"),
        _flag("--gravity", type=_value, help="its direction: -z or x,y,z; default: as the packing says"),
        _flag("--seed", type=int, default=0, help="seed of the random accelerations of shaking"),
        _flag("--checkpoint", help="file to go on from after an interrupt; default: beside the output"),
        _flag("--resume", action="store_true", help="go on from the checkpoint"),
    ),
    "equilibrium": (
        *PACKING,
        _flag("--friction", type=float, help="coefficient of friction; default: as the packing was settled, or 0.5"),
        _flag("--gap", type=float, default=1e-3, help="up to which grains touch, in median diameters"),
        _flag("--tolerance", type=float, default=0.01, help="net force, in weights, up to which a grain rests"),
        _flag("--rest", type=float, default=0.95, help="share of the grains that must rest for exit status 0"),
        _flag("--gravity", type=_value, help="its direction: -z or x,y,z; default: as the packing says"),
    ),
    "measure": (
        *PACKING,
        _flag("--which", action="append", help="a measure, or all; may be repeated"),
        _flag("-o", "--output", help="netCDF file"),
    ),
    "report": (
        *PACKING,
        _flag("-o", "--output", help="HTML file; the numbers go beside it as JSON"),
        COLORED,
        _flag("--turntable", action="store_true", help="add a picture that turns"),
        INTERACTIVE,
    ),
    "picture": (
        *PACKING,
        _flag("-o", "--output", help="PNG file; default: of the same name"),
        COLORED,
        _flag("--cut", action="store_true", help="leave out the grains in the quarter that faces the viewer"),
        _flag("--window", type=_value, default="900,900", help="width and height, in pixels"),
        _flag("--legend", action=_Switch, default=True, help="say what the colours mean"),
    ),
    "compare": (
        _flag(
            "file",
            nargs="+",
            help="packings, or folders that 'voxgran run' wrote, with one packing or one for each seed; "
            "NAME=PATH names a group, and the same name again adds packings to it",
        ),
        _flag("-o", "--output", default="comparison.html", help="HTML file; the numbers go beside it as JSON"),
        INTERACTIVE,
    ),
    "labels": (
        _flag("file", help="label image: .npy, .npz, .tif, .vti or .nrrd"),
        _flag("--voxel-size", type=float, help="edge of a voxel; default: as the file says"),
        _flag("--segment", action="store_true", help="the image holds grey values, of which labels are made first"),
        _flag("--border", choices=("keep", "drop"), default="keep", help="grains that the image cuts"),
        _flag("--surface", choices=("smooth", "voxel"), default="smooth", help="smooth, or faces of voxels"),
        _flag("--periodic", default="", help="axes along which the image repeats, such as xy"),
        _flag("--gravity", type=_value, help="where gravity acts in the sample: -z or x,y,z; default: nowhere"),
        _flag("--unit", help="unit of the voxel size"),
        _flag("--key", help="which array of an .npz or .vti file"),
        _flag("-o", "--output", help="file for the packing that the sample is: .vtp"),
    ),
    "segment": (
        _flag("file", help="grey image: .npy, .npz, .tif, .vti or .nrrd"),
        _flag("--voxel-size", type=_value, help="edge of a voxel, or three: 0.1,0.1,0.2; default: as the file says"),
        _flag("--threshold", type=_value, default="otsu", help="grey value above which a voxel is solid, or otsu"),
        _flag("--dark-grains", action="store_true", help="grains are darker than the void"),
        _flag("--min-size", type=int, default=64, help="voxels of the smallest grains, bodies and holes"),
        _flag(
            "--separation",
            type=float,
            help="decrease of the distance to the void between two grains; default: a tenth of that in the smaller",
        ),
        _flag("--key", help="which array of an .npz or .vti file"),
        _flag("--picture", help="PNG file: slices with the outlines of the grains, those in doubt marked"),
        _flag("-o", "--output", help="file for the labels: .vti, .tif or .npy"),
    ),
    "repair": (
        _flag("file", help="mesh file: STL, OBJ, PLY, OFF, VTP, VTU, VTK or MSH"),
        _flag("-o", "--output", help="mesh file for the result: STL, OBJ, PLY, OFF or VTP"),
        _flag(
            "--max-hole",
            type=float,
            default=0.25,
            help="widest hole that is closed, in diagonals of the bounding box",
        ),
        _former("--largest-hole", "--max-hole", float),
        _flag(
            "--bodies", choices=("refuse", "largest", "all"), default="refuse", help="what becomes of several solids"
        ),
    ),
    "simplify": (
        _flag("file", help="mesh file: STL, OBJ, PLY, OFF, VTP, VTU, VTK or MSH"),
        _flag("--faces", type=int, required=True, help="largest number of triangles"),
        _flag("--repair", action="store_true", help="mend the surface first, as 'voxgran repair' does"),
        _flag("-o", "--output", help="mesh file for the result: STL, OBJ, PLY, OFF or VTP"),
    ),
    "cloud": (
        _flag("file", help="point cloud: .ply, .pcd, .xyz, .csv or .las"),
        _flag("--method", choices=("poisson", "alpha"), default="poisson", help="smooth, or through the points"),
        _flag("--outliers", type=float, help="drop points this many standard deviations from their neighbours"),
        _flag("--spacing", type=float, help="thin the cloud to one point for each cube of this edge"),
        _flag(
            "--max-gap",
            type=float,
            default=5.0,
            help="how far the surface may be from the nearest point, in spacings",
        ),
        _former("--largest-hole", "--max-gap", float),
        _flag("-o", "--output", help="mesh file for the result: STL, OBJ, PLY, OFF or VTP"),
    ),
    "clump": (
        _flag("file", help="mesh file"),
        _flag(
            "--spheres",
            "--max-spheres",
            dest="max_spheres",
            type=int,
            help="number of spheres, with a target the largest that is tried; default: 50, or 1000 with a target",
        ),
        _flag("--target", choices=TARGETS, help="error that is to be reached with the fewest spheres"),
        _flag("--value", type=float, help="value of the target"),
        _flag("--method", default="optimal", help="clump method; 'voxgran methods' lists them"),
        _flag("--seed", type=int, default=0, help="random seed"),
        _flag("-o", "--output", help="file for the spheres: .csv (x,y,z,r), .txt (YADE) or .mol (LAMMPS molecule)"),
        _flag("--picture", help="PNG file: the shape beside its clump, coloured by the distance from the true surface"),
    ),
    "export": (
        *PACKING,
        ENGINE,
        _flag("-o", "--output", required=True, help="folder for the files"),
        _flag("--grains", choices=KINDS, help="what grains that are no spheres become; default: what the engine has"),
        *DECK,
    ),
    "relax": (
        *PACKING,
        ENGINE,
        _flag("-o", "--output", required=True, help="file for the relaxed packing: .vtp"),
        _flag("--history", help="netCDF file for the course of the run"),
        _flag("--folder", help="folder where the files of the engine stay"),
        _flag("--until", type=float, default=REST, help="mean kinetic energy of a grain at rest, in m g d"),
        _flag("--longest", type=float, default=LONGEST, help="longest time in the engine, in sqrt(d / g)"),
        *DECK,
    ),
    "methods": (_flag("name", nargs="?", help="one method, family or measure; default: all of them"),),
    "study": (
        _flag("file", help="study file"),
        _flag("-o", "--output", default="out", help="folder for the results; what is finished there is kept"),
        _flag("--dry-run", action="store_true", help="say what would be computed, and what is done"),
        _flag("--workers", type=int, help="processes, one thread each; default: one for each processor"),
        _flag("--memory", help="memory that they may take, such as 8GB or 50%%; default: 80%%"),
        _flag("--dask", help="address of a Dask scheduler, such as tcp://127.0.0.1:8786, to compute there"),
        _flag("--resume", action="store_true", help="accepted: a study goes on where it was, also without this flag"),
        _flag("--retry", action="store_true", help="compute runs that failed again"),
        _flag("--zarr", action="store_true", help="write the dataset as zarr, too"),
    ),
    "bench": (_flag("name", help="trade-off"), _flag("-o", "--output", default="bench", help="folder")),
    "doctor": (_flag("--warm", action="store_true", help="compile the kernels of usual scenes, which takes minutes"),),
    "data": (
        _flag("name", nargs="?", help="such as eros.obj or itokawa_lp.obj; default: the files are listed"),
        _flag("-o", "--output", help="file; default: of the same name, in this folder"),
    ),
    "demo": (_flag("-o", "--output", default="out/demo", help="folder for the results"),),
}


def make_parser(words: Sequence[str], commands: Mapping[str, tuple[str, Callable[..., Any]]]) -> Parser:
    """Return the parser of the commands, each with its help and function; `shape` gets the flags of the family that the
    words name.

    Raises
    ------
    UnknownNameError
        If the first word is no command; the message gives the nearest one.
    """
    top = Parser(
        prog="voxgran",
        description="Packed assemblies of grains of true shape, checked and measured.",
        epilog="'voxgran COMMAND --help' shows the flags of a command and an example. "
        "Completion in bash: source <(voxgran --print-completion bash); zsh and tcsh likewise.",
    )
    top.add_argument("--version", action="version", version=f"voxgran {voxgran.__version__}")
    load("shtab").add_argument_to(top, ["--print-completion"], help="print a completion script for a shell and end")
    named = [word for word in words if not word.startswith("-")]
    if named and named[0] not in commands and "--print-completion" not in words:
        raise UnknownNameError(unknown("command", named[0], commands))
    subparsers = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (text, _) in commands.items():
        sub = subparsers.add_parser(
            name,
            help=text,
            description=text[0].upper() + text[1:] + ".",
            epilog=f"example:\n  {EXAMPLES[name]}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        for flags, keywords in FLAGS.get(name, ()):
            added = sub.add_argument(*flags, **keywords)
            if flags[0] in ("file", "-o"):
                added.complete = load("shtab").FILE  # type: ignore[attr-defined]
        if name == "shape":
            _add_family(sub, named)
        if name == "settle":
            _add_parameters(sub, Settling)
        if name in ("export", "relax"):
            _add_parameters(sub, Material)
        if name == "clump" and named[:1] == ["clump"]:
            _add_parameters(sub, _clump_parameters(words))
        sub.add_argument("--json", action="store_true", help="print JSON")
        again = "compute all runs anew, also those that are finished" if name == "study" else "replace what is there"
        sub.add_argument("--overwrite", action="store_true", help=again)
        sub.add_argument("-v", "--verbose", action="store_true", help="say more on the error stream")
        sub.add_argument("-q", "--quiet", action="store_true", help="no progress")
    return top


def parse(words: Sequence[str], commands: Mapping[str, tuple[str, Callable[..., Any]]]) -> argparse.Namespace:
    """Return the options of a command line.

    Raises
    ------
    UnknownNameError
        If the command or a flag is unknown; the message gives the nearest one.
    InputError
        If something is missing, superfluous or cannot be read.
    """
    options, rest = make_parser(words, commands).parse_known_args(_joined(words))
    vars(options).pop("given", None)
    if hasattr(options, "former"):
        warn_former(vars(options).pop("former"))
    for word in rest:
        if (flag := word.partition("=")[0]).startswith("-"):
            raise UnknownNameError(_unknown_flag(flag, options))
        remedy = f"write --which {word}" if hasattr(options, "which") else f"see 'voxgran {options.command} --help'"
        raise InputError(f"{shown(word)} is one argument too many; {remedy}")
    return options


def _unknown_flag(flag: str, options: argparse.Namespace) -> str:
    """Return the message for an unknown flag; names are compared without the dashes, which all flags share."""
    names = [name for name in vars(options) if name not in NO_FLAGS]
    meant = nearest(flag.strip("-").replace("-", "_"), names)
    known = sorted(f"--{name.replace('_', '-')}" for name in names)
    hint = f"did you mean '--{meant.replace('_', '-')}'? " if meant else ""
    return f"flag of {options.command} {shown(flag)} is unknown: {hint}known are {', '.join(known)}"


def _joined(words: Sequence[str]) -> list[str]:
    """Return the words with each flag joined to the direction such as ``-z`` or ``-1,0,0`` that follows it."""
    found: list[str] = []
    for word in words:
        if found and DIRECTION.fullmatch(word) and found[-1].startswith("--") and "=" not in found[-1]:
            found[-1] += f"={word}"
        else:
            found.append(word)
    return found


def name_flags(sentence: str, options: argparse.Namespace) -> str:
    """Return a sentence with the names of arguments, as Python has them, replaced by the flags of the command."""
    for name in vars(options):
        flag = f"--{name.replace('_', '-')}"
        sentence = re.sub(rf"(?<![\w\[-]){name}=True\b", flag, sentence)
        sentence = re.sub(rf"(?<![\w\[-]){name}='([^']*)'", rf"{flag} \1", sentence)
        sentence = sentence.replace(f"{flag}, at the prompt {flag}", flag)
        if "_" in name:
            sentence = re.sub(rf"(?<![\w-]){name}\b", flag, sentence).replace(f"{flag} is None", f"{flag} is missing")
    return sentence


def _add_family(sub: argparse.ArgumentParser, named: Sequence[str]) -> None:
    """Add the family, its parameters as flags, the seed and the output."""
    from voxgran.shapes.family import families

    sub.add_argument("family", help=", ".join(families().names()))
    sub.add_argument("--seed", type=int, default=0, help="seed of a random family")
    sub.add_argument("-o", "--output", help="mesh file: STL, OBJ, PLY, OFF or VTP; with --count, a folder")
    sub.add_argument("--count", type=int, help="make so many shapes, each with random numbers of its own")
    kinds = ("stl", "obj", "ply", "off", "vtp")
    sub.add_argument("--format", choices=kinds, help="kind of the files of many shapes; default: stl")
    sub.add_argument("--gallery", help="picture of the shapes in rows (.png)")
    if len(named) > 1 and named[0] == "shape":
        for item in parameters_of(families().get(named[1]).parameters):
            for name in item.names:
                text = parameter_text(item).replace("%", "%%") if name == item.name else argparse.SUPPRESS
                sub.add_argument("--" + name.replace("_", "-"), dest=name, type=_value, help=text)


def _clump_parameters(words: Sequence[str]) -> type:
    """Return the parameter class of the clump method that the words name, or of the default."""
    from voxgran.clumps.method import clump_registry

    method = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    method.add_argument("--method", default="optimal")
    return clump_registry().get(method.parse_known_args(list(words))[0].method).parameters


def _add_parameters(sub: argparse.ArgumentParser, cls: type) -> None:
    """Add the parameters of a class as flags; those of a group that is one of them begin with its name."""
    for item in parameters_of(cls):
        group = nested_class(item)
        entries = {item.name: item} if group is None else {f"{item.name}_{e.name}": e for e in parameters_of(group)}
        for name, entry in entries.items():
            text = parameter_text(entry).replace("%", "%%")
            sub.add_argument("--" + name.replace("_", "-"), dest=name, type=_value, help=text)


def nested_class(item: Parameter) -> type | None:
    """Return the class of a parameter that is a group of parameters; None for others."""
    kinds = (item.type, *typing.get_args(item.type))
    return next((kind for kind in kinds if isinstance(kind, type) and dataclasses.is_dataclass(kind)), None)


def parameter_text(item: Parameter) -> str:
    """Return the meaning of a parameter, its type or allowed values, and its default in one line."""
    if item.default is MISSING:
        rest = "must be given"
    else:
        rest = "optional" if item.default is None else f"default {item.default!r}"
    unit = "" if item.unit in ("", "length") or item.unit in item.doc else f" {item.unit}"
    return f"{item.doc} ({item.type_text}{unit}; {rest})"
