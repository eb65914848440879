"""The command line: its words, the help of each command with an example, and shell completion.

The examples stand in a table, one for each command.
"""

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any, NoReturn

import voxgran
from voxgran._base.errors import InputError, UnknownNameError, nearest, shown, unknown, warn_former
from voxgran._base.lazy import load
from voxgran.cli.flags import FLAGS, Once


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, and whose flags are written out: parts of names are ambiguous."""

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**{"allow_abbrev": False, **keywords})
        self.register("action", None, Once)

    def error(self, message: str) -> NoReturn:
        """Raise the message as bad input.

        Raises
        ------
        InputError
            Always.
        """
        number = re.fullmatch(r"argument (?:\S+/)?(--\S+): invalid (int|float) value: (.*)", message, re.DOTALL)
        if number:
            message = f"{number[1]} is {number[3]}: it must be a {'whole ' * (number[2] == 'int')}number"
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


#: directions that begin like a flag
DIRECTION = re.compile(r"-[xyz]|-[\d.][^,]*,.*")
#: what a command line holds beside flags of its command
NO_FLAGS = ("command", "family", "file", "name", "print_completion")
#: shells for which `shtab` writes scripts; importing it takes longer than all else that the help needs
SHELLS = ("bash", "zsh", "tcsh")
COMPLETION = "print a completion script for a shell and end"
#: commands that have the parameters of classes as flags
WITH_PARAMETERS = ("shape", "settle", "compress", "export", "relax", "clump")


def make_parser(words: Sequence[str], commands: Mapping[str, tuple[str, Callable[..., Any]]]) -> Parser:
    """Return the parser of the commands, each with its help and function.

    Where words are given, only the command that they name gets its flags, and `shape` those of the family in them.

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
    completing = any(word.startswith("--print-completion") for word in words)
    if completing:
        load("shtab").add_argument_to(top, ["--print-completion"], help=COMPLETION)
    else:
        top.add_argument("--print-completion", choices=SHELLS, default=argparse.SUPPRESS, help=COMPLETION)
    named = [word for word in words if not word.startswith("-")]
    if named and named[0] not in commands and not completing:
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
        if words and not completing and name not in named[:1]:
            # no word of the line is a flag of it
            continue
        for flags, keywords in FLAGS.get(name, ()):
            added = sub.add_argument(*flags, **keywords)
            if completing and flags[0] in ("file", "-o"):
                added.complete = load("shtab").FILE  # type: ignore[attr-defined]
        if name == "bench" and named[:1] == ["bench"]:
            names = import_module(f"{__package__}.parameters").trade_off_names()
            sub.epilog = f"trade-offs:\n  {', '.join(names)}\n\n{sub.epilog}"
        if name in WITH_PARAMETERS:
            import_module(f"{__package__}.parameters").add_parameters(sub, name, words)
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
    """Return a sentence with the names of arguments, as Python has them, replaced by the flags of the command.

    Names and numbers that are parts of a path, a file name or an equation stay as they are.
    """
    before, after = r"(?<![\w\[/\\.-])", r"(?![\w/\\*+^-]|\.\w)"
    sentence = re.sub(rf"{before}packing\.(gravity|unit) is None", r"the packing has no \1", sentence)
    sentence = re.sub(rf"{before}packing\.(gravity|unit) is\b", r"\1 of the packing is", sentence)
    for name in vars(options):
        flag = f"--{name.replace('_', '-')}"
        sentence = re.sub(rf"{before}{name}=True{after}", flag, sentence)
        sentence = re.sub(rf"{before}{name}='([^']*)'", rf"{flag} \1", sentence)
        sentence = re.sub(rf"{before}{name}=(-?[\d.]+(?:e[+-]?\d+)?)(?!'){after}", rf"{flag} \1", sentence)
        sentence = sentence.replace(f"{flag}, at the prompt {flag}", flag)
        if "_" in name:
            sentence = re.sub(rf"{before}{name}{after}", flag, sentence).replace(
                f"{flag} is None", f"{flag} is missing"
            )
    return sentence


#: an example of each command, shown at the end of its help
EXAMPLES: dict[str, str] = {
    "init": "voxgran init scene.toml",
    "plan": "voxgran plan scene.toml",
    "run": "voxgran run scene.toml -o out\n  voxgran run scene.toml -o out --resume",
    "verify": "voxgran verify out/packing.vtp",
    "settle": "voxgran settle loose.vtp -o bed.vtp --friction 0.3\n"
    "  voxgran settle spheres.txt --periodic xy --gravity -z -o bed.vtp --shaking-duration 20",
    "compress": "voxgran compress loose.vtp -o specimen.vtp --friction 0.3\n"
    "  voxgran compress loose.vtp -o oedometer.vtp --axes z --solid-fraction 0.6",
    "tile": "voxgran tile bed.vtp --repeats 4,4,1 -o large.vtp",
    "equilibrium": "voxgran equilibrium bed.vtp --friction 0.5",
    "measure": "voxgran measure out/packing.vtp --which density --which coordination -o statistics.nc",
    "report": "voxgran report out/packing.vtp -o report.html",
    "picture": "voxgran picture out/packing.vtp -o bed.png --color-by height --cut",
    "compare": "voxgran compare digital=out/digital points=out/points -o comparison.html",
    "image": "voxgran image info scan.tif",
    "segment": "voxgran segment grey.tif --voxel-size 0.1,0.1,0.2 -o labels.vti --picture slices.png",
    "labels": "voxgran labels scan.tif --voxel-size 0.02,0.02,0.05 --unit mm -o scan.vtp\n"
    "  voxgran labels grey.tif --segment --voxel-size 0.02 -o scan.vtp",
    "twin": "voxgran twin scan.vtp --count 2000 -o out/",
    "learn": "voxgran learn scan.vtp -o shapes.nc --picture pairs.png\n"
    "  voxgran shape learned --model shapes.nc --count 100 -o grains",
    "shape": "voxgran shape solid_union --seed 7 --solids 3,5 -o grain.stl\n"
    "  voxgran shape convex_polyhedron --count 300 --points 8,20 -o grains --gallery grains.png",
    "repair": "voxgran repair scan.ply -o rock.ply\n  voxgran repair scan.ply --bodies largest --max-hole 0.1",
    "simplify": "voxgran simplify scan.stl --faces 500 -o small.stl",
    "cloud": "voxgran cloud scan.ply --outliers 2 -o rock.stl",
    "clump": "voxgran clump rock.stl --spheres 50 -o rock.csv --picture rock.png\n"
    "  voxgran clump rock.stl --target iou --value 0.95 --mode balanced -o rock.mol",
    "export": "voxgran export bed.vtp --engine lammps -o run\n"
    "  voxgran export bed.vtp --engine yade --clump 50 --density 2650 --friction 0.4 -o run",
    "relax": "voxgran relax bed.vtp -o rested.vtp --history rested.nc",
    "engines": "voxgran engines",
    "methods": "voxgran methods\n  voxgran methods digital",
    "study": "voxgran study study.toml --dry-run\n  voxgran study study.toml -o out --workers 4\n"
    "  voxgran study study.toml -o out --dask tcp://127.0.0.1:8786",
    "bench": "voxgran bench voxelize -o figures",
    "doctor": "voxgran doctor\n  voxgran doctor --warm",
    "data": "voxgran data itokawa_lp.obj -o rock.obj",
    "demo": "voxgran demo -o out/demo",
    "app": "voxgran app\n  voxgran app scene.toml -o runs",
}
