#!/usr/bin/env python3
"""Write the stubs that follow from the parameter classes: ``stubs.py [--check]``.

They are `voxgran/typed_calls.pyi` (functions that take a name with keywords), `voxgran/shapes/__init__.pyi` (one
function for each family) and `voxgran/cli/parameter_flags.json` (flags of commands that take parameters). With
``--check`` nothing is written, and the status is 1 if one of them is not up to date.
"""

import argparse
import ast
import inspect
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import voxgran
from voxgran._base.config import parameters_of
from voxgran.cli.parameters import flag_table
from voxgran.clumps.fit import fit_clump
from voxgran.clumps.method import clump_registry
from voxgran.packing.method import method_registry
from voxgran.packing.pack import pack
from voxgran.shapes.family import families, make_shape

PACKAGE = Path(voxgran.__file__).parent
SHAPES_HEAD = '''# fmt: off
# ruff: noqa: E501
"""Functions that make shapes, one for each family of `voxgran.shapes.families`. Written by tools/stubs.py."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from numpy.typing import NDArray

from voxgran.shapes.families.random.polyhedron import Solid
from voxgran.shapes.families.random.solid_union import Kind
from voxgran.shapes.generating.regular_solids import PlatonicSolid
from voxgran.shapes.learning.model import ShapeModel
from voxgran.shapes.model import Shape as Shape
from voxgran.typed_calls import Number, NumberRange, Whole, WholeRange

'''
CALLS_HEAD = '''# fmt: off
# ruff: noqa: E501
"""Types of the functions that take a name with keywords: one overload for each name. Written by tools/stubs.py.

An overload for names that are not known here takes no parameters, since it would accept misspelt ones: methods of
others are given as parameter objects.
"""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from voxgran._base.progress import OnStep
from voxgran._base.registry import Parameters
from voxgran.clumps.model import Clump
from voxgran.containers.model import Container
from voxgran.geometry.orientation_laws.law import OrientationLaw
from voxgran.packing.beds.inlet import Inlet
from voxgran.packing.driver import Recorder
from voxgran.packing.model import Packing
from voxgran.settling.materials import Materials
from voxgran.settling.parameters import Lid, Settling, Shaking
from voxgran.shapes.families.random.polyhedron import Solid
from voxgran.shapes.families.random.solid_union import Kind
from voxgran.shapes.generating.regular_solids import PlatonicSolid
from voxgran.shapes.learning.model import ShapeModel
from voxgran.shapes.model import Shape
from voxgran.shapes.size_laws.distribution import SizeDistribution
from voxgran.voxels.model import Voxels

Whole = int | np.integer[Any]
Number = float | np.floating[Any] | np.integer[Any]
WholeRange = Whole | Sequence[Whole]
NumberRange = Number | Sequence[Number]

'''
#: function, registry, and what its overloads are: a place for the choice, and one for the keywords
CALLS: tuple[tuple[Callable[..., Any], Any, tuple[str, ...]], ...] = (
    (
        pack,
        method_registry(),
        (
            "pack(shapes: Sequence[Shape] | Shape, container: Container, method: {}, **keywords: {}) -> Packing",
            # with a list of grains in place of shapes
            "pack(*, container: Container, method: {}, **keywords: {}) -> Packing",
        ),
    ),
    (
        make_shape,
        families(),
        (
            "make_shape(family: {}, **keywords: {}) -> Shape",
            "make_shapes(family: {}, *, count: Whole, **keywords: {}) -> list[Shape]",
        ),
    ),
    (
        fit_clump,
        clump_registry(),
        ("fit_clump(shape_or_voxels: Shape | Voxels, *, method: {} = ..., **keywords: {}) -> Clump",),
    ),
)


class WhatIsAccepted(ast.NodeTransformer):
    """Turns the type that a parameter has into that which a call accepts: also NumPy's numbers, lists and arrays."""

    def visit_Name(self, node: ast.Name) -> ast.AST:
        """Accept numbers of NumPy."""
        return ast.Name({"int": "Whole", "float": "Number"}.get(node.id, node.id))

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        """Accept lists and arrays in place of tuples."""
        if ast.unparse(node.value) != "tuple" or not isinstance(node.slice, ast.Tuple):
            return node
        entry = ast.unparse(self.visit(node.slice.elts[0]))
        return ast.parse(f"Sequence[{entry}] | NDArray[Any]", mode="eval").body


def accepted(kind: ast.expr, *, ranges: bool = False) -> str:
    """Return the text of the type that calls accept for a parameter; with `ranges`, also pairs in place of numbers."""
    if isinstance(kind, ast.Constant):  # an annotation in quotation marks
        kind = ast.parse(str(kind.value), mode="eval").body
    text = ast.unparse(WhatIsAccepted().visit(kind))
    return re.sub(r"^(Whole|Number)\b", r"\1Range", text) if ranges else text


def source_of(thing: Any) -> Any:
    """Return the syntax tree of a class or function at the top of its file."""
    tree = ast.parse(Path(inspect.getfile(inspect.unwrap(thing))).read_text(encoding="utf-8"))
    return next(node for node in tree.body if getattr(node, "name", "") == thing.__name__)


def fields_of(cls: type) -> dict[str, tuple[ast.expr, ast.expr | None]]:
    """Return name, annotation and default (None where there is none) of each field of a parameter class."""
    found = {}
    for part in reversed(cls.__mro__[:-1]):
        for node in source_of(part).body:
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                default = next(iter(node.value.args), None) if isinstance(node.value, ast.Call) else node.value
                found[node.target.id] = (node.annotation, default)
    return {item.name: found[item.name] for item in parameters_of(cls)}


def keywords_classes(classes: list[type], base: str, shared: set[str], *, ranges: bool) -> tuple[dict[type, str], str]:
    """Return the names of the classes of keywords of parameter classes, and the text of these and of the classes that
    they inherit; where a class adds no keyword, that of its parent serves.
    """
    names: dict[type, str] = {}
    texts: list[str] = []

    def add(cls: type) -> str:
        """Add the text of a class, after that of its parent, and return its name."""
        if cls is object:
            return base
        if cls not in names:
            parent = cls.__bases__[0]
            above = add(parent)
            known = shared | (set(fields_of(parent)) if parent is not object else set())
            own = {key: kind for key, (kind, _) in fields_of(cls).items() if key not in known}
            names[cls] = f"{cls.__name__}Keywords" if own else above
            texts.extend([keywords_class(names[cls], above, own, ranges=ranges)] if own else [])
        return names[cls]

    return {cls: add(cls) for cls in classes}, "".join(texts)


def keywords_class(name: str, parent: str, annotations: dict[str, ast.expr], *, ranges: bool = False) -> str:
    """Return the text of a class of keywords."""
    head = f"class {name}({parent}, total=False):"
    lines = [f"    {key}: {accepted(kind, ranges=ranges)}\n" for key, kind in annotations.items()]
    return f"{head}\n{''.join(lines)}"


def calls_stub() -> str:
    """Return the stub of the functions that take a name with keywords."""
    text = CALLS_HEAD
    for function, registry, heads in CALLS:
        shared = {item.arg: item.annotation for item in source_of(function).args.kwonlyargs if item.arg != "method"}
        base = "".join(word.capitalize() for word in function.__name__.split("_")) + "Keywords"
        classes = {name: registry.get(name).parameters for name in registry.names()}
        text += keywords_class(base, "TypedDict", shared)
        called, added = keywords_classes(list(classes.values()), base, set(shared), ranges=function is make_shape)
        text += added
        takers: dict[str, list[str]] = {}
        for name, cls in classes.items():
            takers.setdefault(called[cls], []).append(f'"{name}"')
        choices = [(f"Literal[{', '.join(names)}]", f"Unpack[{keywords}]") for keywords, names in takers.items()]
        choices.append(("str | Parameters", f"Unpack[{base}]"))
        text += "".join(f"@overload\ndef {head.format(*choice)}: ...\n" for head in heads for choice in choices)
    return text


def shapes_stub() -> str:
    """Return the stub of `voxgran.shapes`."""
    text = SHAPES_HEAD
    for name in families().names():
        entry = families().get(name)
        words = [
            f"{key}: {accepted(kind, ranges=True)}{f' = {ast.unparse(default)}' if default else ''}"
            for key, (kind, default) in fields_of(entry.parameters).items()
        ]
        words += ["seed: Whole = 0"] if entry.random else []
        text += f"def {name}(*, {', '.join(words)}) -> Shape: ...\n"
    return text


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true")
    given, written = parser.parse_args(), {"typed_calls.pyi": calls_stub(), "shapes/__init__.pyi": shapes_stub()}
    written["cli/parameter_flags.json"] = json.dumps(flag_table(), indent=0) + "\n"
    old = [name for name, text in written.items() if (PACKAGE / name).read_text(encoding="utf-8") != text]
    if given.check:
        sys.exit(f"{', '.join(old)}: not up to date; run 'make stubs'" if old else 0)
    for name in old:
        (PACKAGE / name).write_text(written[name], encoding="utf-8")
