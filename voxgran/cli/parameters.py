"""Flags made of the parameters of classes: those of families, of clump methods, of settling and of materials."""

import argparse
import dataclasses
import typing
from collections.abc import Sequence
from dataclasses import MISSING

from voxgran._base.config import Parameter, parameters_of
from voxgran.cli.flags import as_value


def add_parameters(sub: argparse.ArgumentParser, command: str, words: Sequence[str]) -> None:
    """Add the flags of a command of a line of words, on which those of `shape` and of `clump` depend."""
    if command == "shape":
        _add_family(sub, words)
    elif command == "clump":
        if command in words:
            _add_class(sub, _clump_parameters(words))
    elif command in ("export", "relax"):
        from voxgran.settling.material import Material

        _add_class(sub, Material)
    else:
        from voxgran.settling.parameters import Compression, Settling

        _add_class(sub, Settling if command == "settle" else Compression)


def _add_family(sub: argparse.ArgumentParser, words: Sequence[str]) -> None:
    """Add the family, its parameters as flags, the seed and the output."""
    from voxgran.shapes.family import families

    named = [word for word in words if not word.startswith("-")]
    sub.add_argument("family", help=", ".join(families().names()))
    sub.add_argument("--seed", type=int, default=0, help="seed of a random family")
    sub.add_argument("-o", "--output", help="mesh file: STL, OBJ, PLY, OFF or VTP; with --count, a folder")
    sub.add_argument("--count", type=int, help="make so many shapes, each with random numbers of its own")
    kinds = ("stl", "obj", "ply", "off", "vtp")
    sub.add_argument("--format", choices=kinds, help="kind of the files of many shapes; default: stl")
    sub.add_argument("--gallery", help="picture of the shapes in rows (.png)")
    if len(named) > 1 and named[0] == "shape":
        for item in parameters_of(families().get(named[1]).parameters):
            text = parameter_text(item).replace("%", "%%")
            sub.add_argument("--" + item.name.replace("_", "-"), dest=item.name, type=as_value, help=text)


def _clump_parameters(words: Sequence[str]) -> type:
    """Return the parameter class of the clump method that the words name, or of the default."""
    from voxgran.clumps.method import clump_registry

    method = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    method.add_argument("--method", default="optimal")
    return clump_registry().get(method.parse_known_args(list(words))[0].method).parameters


def _add_class(sub: argparse.ArgumentParser, cls: type) -> None:
    """Add the parameters of a class as flags; those of a group that is one of them begin with its name."""
    for item in parameters_of(cls):
        group = nested_class(item)
        entries = {item.name: item} if group is None else {f"{item.name}_{e.name}": e for e in parameters_of(group)}
        for name, entry in entries.items():
            text = parameter_text(entry).replace("%", "%%")
            sub.add_argument("--" + name.replace("_", "-"), dest=name, type=as_value, help=text)


def nested_class(item: Parameter) -> type | None:
    """Return the class of a parameter that is a group of parameters; None for others."""
    kinds = (item.type, *typing.get_args(item.type))
    if float in kinds:
        # a number or a table: flags give the number
        return None
    return next((kind for kind in kinds if isinstance(kind, type) and dataclasses.is_dataclass(kind)), None)


def parameter_text(item: Parameter) -> str:
    """Return the meaning of a parameter, its type or allowed values, and its default in one line."""
    if item.default is MISSING:
        rest = "must be given"
    else:
        rest = "optional" if item.default is None else f"default {item.default!r}"
    unit = "" if item.unit in ("", "length") or item.unit in item.doc else f" {item.unit}"
    return f"{item.doc} ({item.type_text}{unit}; {rest})"
