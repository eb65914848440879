"""Flags made of the parameters of classes: those of families, of clump methods, of settling and of materials.

Their names and texts stand in `parameter_flags.json`, which `make stubs` writes, so that a help imports no class.
"""

import argparse
import dataclasses
import json
import typing
from collections.abc import Iterable, Sequence
from dataclasses import MISSING
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from voxgran.cli.flags import as_value

if typing.TYPE_CHECKING:
    from voxgran._base.config import Parameter

#: names of the flags of each command, and of each family and clump method, with their help
Table: typing.TypeAlias = dict[str, Any]


def add_parameters(sub: argparse.ArgumentParser, command: str, words: Sequence[str]) -> None:
    """Add the flags of a command of a line of words, on which those of `shape` and of `clump` depend."""
    table = _table()
    if command == "shape":
        _add_family(sub, table["shape"], words)
    elif command == "clump":
        if command in words:
            _add_flags(sub, _of_clump(table["clump"], words))
    else:
        _add_flags(sub, table[command])


def _table() -> Table:
    """Return the flags of all commands."""
    table: Table = json.loads(Path(__file__).with_name("parameter_flags.json").read_bytes())
    return table


def _with_foreign(names: Iterable[str], group: str) -> list[str]:
    """Return names and those of the entry points of third parties, in alphabetical order."""
    return sorted({*names, *(point.name for point in entry_points(group=group))})


def _add_family(sub: argparse.ArgumentParser, table: Table, words: Sequence[str]) -> None:
    """Add the family, its parameters as flags, the seed and the output."""
    named = [word for word in words if not word.startswith("-")]
    sub.add_argument("family", help=", ".join(_with_foreign(table, "voxgran.shape_families")))
    sub.add_argument("--seed", type=int, default=0, help="seed of a random family")
    sub.add_argument("-o", "--output", help="mesh file: STL, OBJ, PLY, OFF or VTP; with --count, a folder")
    sub.add_argument("--count", type=int, help="make so many shapes, each with random numbers of its own")
    kinds = ("stl", "obj", "ply", "off", "vtp")
    sub.add_argument("--format", choices=kinds, help="kind of the files of many shapes; default: stl")
    sub.add_argument("--gallery", help="picture of the shapes in rows (.png)")
    if len(named) > 1 and named[0] == "shape":
        if named[1] not in table:
            from voxgran.shapes.family import families

            table = {named[1]: class_flags(families().get(named[1]).parameters, groups=False)}
        _add_flags(sub, table[named[1]])


def _of_clump(table: Table, words: Sequence[str]) -> Iterable[tuple[str, str]]:
    """Return the flags of the clump method that the words name, or of the default."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--method", default="optimal")
    method = parser.parse_known_args(list(words))[0].method
    if method in table:
        found: list[tuple[str, str]] = table[method]
        return found
    from voxgran.clumps.method import clump_registry

    return class_flags(clump_registry().get(method).parameters)


def _add_flags(sub: argparse.ArgumentParser, flags: Iterable[tuple[str, str]]) -> None:
    """Add flags, each a name and its help."""
    for name, text in flags:
        sub.add_argument("--" + name.replace("_", "-"), dest=name, type=as_value, help=text)


def flag_table() -> Table:
    """Return what `parameter_flags.json` holds."""
    from voxgran.clumps.method import clump_registry
    from voxgran.settling.material import Material
    from voxgran.settling.parameters import Compression, Settling
    from voxgran.shapes.family import families

    commands = {"settle": Settling, "compress": Compression, "export": Material, "relax": Material}
    return {
        **{name: class_flags(cls) for name, cls in commands.items()},
        "clump": {name: class_flags(clump_registry().get(name).parameters) for name in clump_registry().names()},
        "shape": {name: class_flags(families().get(name).parameters, groups=False) for name in families().names()},
    }


def class_flags(cls: type, *, groups: bool = True) -> list[tuple[str, str]]:
    """Return the parameters of a class as flags with their help; with `groups`, those of a group that is one of them
    begin with its name.
    """
    from voxgran._base.config import parameters_of

    found: list[tuple[str, str]] = []
    for item in parameters_of(cls):
        group = nested_class(item) if groups else None
        entries = {item.name: item} if group is None else {f"{item.name}_{e.name}": e for e in parameters_of(group)}
        found += [(name, parameter_text(entry).replace("%", "%%")) for name, entry in entries.items()]
    return found


def nested_class(item: "Parameter") -> type | None:
    """Return the class of a parameter that is a group of parameters; None for others."""
    kinds = (item.type, *typing.get_args(item.type))
    if float in kinds:
        # a number or a table: flags give the number
        return None
    return next((kind for kind in kinds if isinstance(kind, type) and dataclasses.is_dataclass(kind)), None)


def parameter_text(item: "Parameter") -> str:
    """Return the meaning of a parameter, its type or allowed values, and its default in one line."""
    if item.default is MISSING:
        rest = "must be given"
    else:
        rest = "optional" if item.default is None else f"default {item.default!r}"
    unit = "" if item.unit in ("", "length") or item.unit in item.doc else f" {item.unit}"
    return f"{item.doc} ({item.type_text}{unit}; {rest})"
