"""Attributes that are missing, of modules and objects: what may be written in their place."""

import inspect
import sys
from collections.abc import Iterable
from typing import Any

from voxgran._base import errors
from voxgran._base.errors import VoxgranError, nearest, nearest_word, synonyms_of


def remedy_in_module(module: str, name: str) -> str:
    """Return what may be written in place of a name that a module does not have."""
    top, here = sys.modules["voxgran"], sys.modules[module]
    names = list(vars(here).get("__all__") or dir(here))
    if not name.startswith("_"):
        if module != "voxgran" and name in top.__all__:
            return f"write vg.{name}"
        if module == "voxgran" and (written := _error_of(name) or _written_elsewhere(name, names)):
            return f"write {written}"
    meant = None if name.startswith("__") else nearest_word(name, names)
    return f"did you mean {meant!r}?" if meant else f"dir({module}) lists its names"


def _error_of(name: str) -> str | None:
    """Return what is caught in place of a class of errors or warnings that is not public; None for other names."""
    found = getattr(errors, name, None)
    if not (isinstance(found, type) and issubclass(found, BaseException)):
        return None
    standard = next(base.__name__ for base in found.__mro__ if base.__module__ == "builtins")
    every = ", or vg.VoxgranError for all errors of voxgran" if issubclass(found, VoxgranError) else ""
    return f"{standard}, of which it is a kind{every}"


def _written_elsewhere(name: str, known: Iterable[str]) -> str | None:
    """Return how a shape, size law, method, engine or measure is written, of which a module was asked for the name."""
    voxgran = sys.modules["voxgran"]
    word = name.casefold().removeprefix("make_")
    # a class of this name, such as a container or Material, is meant rather than a synonym
    container = next((entry for entry in known if entry.casefold() == word.removesuffix("s")), None)
    places = (
        (dir(voxgran.shapes), "vg.shapes.{}()"),
        (voxgran.sizes.__all__, "vg.sizes.{}(...)"),
        (voxgran.orientations.__all__, "vg.orientations.{}(...)"),
        (voxgran.packing_methods(), "vg.pack(shapes, container, {!r}, ...)"),
        (voxgran.clump_methods(), "vg.fit_clump(shape, method={!r})"),
        (voxgran.engines(), "vg.write_deck(packing, folder, {!r})"),
        (_beside("measure").measures(), "vg.measure(packing, {!r})"),
    )
    words = (word, *(() if container else synonyms_of(word)))
    call = next((call.format(one) for one in words for names, call in places if one in names), None)
    return f"{call} for the shape, vg.{container}(...) for the container" if call and container else call


def _beside(function: str) -> Any:
    """Return the module of a public function."""
    return sys.modules[getattr(sys.modules["voxgran"], function).__module__]


def remedy_of_object(kind: type, name: str) -> str:
    """Return what may be written in place of an unknown attribute of an object of a class."""
    thing, fields, instead = kind.__name__.lower(), _fields(kind), getattr(kind, "_instead", {})
    if name in instead:
        return f"write {instead[name]}"
    words = (name, *synonyms_of(name))
    for word in words:
        if word in fields:
            return f"did you mean {word!r}?"
        if "to_shape" in fields and word in _fields(shape := sys.modules["voxgran"].Shape):
            called = "(...)" if inspect.isfunction(getattr(shape, word, None)) else ""
            return f"write {thing}.to_shape().{word}{called}"
        for function in (word, f"save_{word}", f"write_{word}"):
            if _takes(function, kind):
                return f"write vg.{function}({thing}, ...)"
        if _takes("measure", kind) and word in _beside("measure").measures():
            return f"write vg.measure({thing}, {word!r})"
    first = _first(name)
    if first and first.name in ("image", "mask") and _takes("to_image", kind):
        labels = ", labels=False" if first.name == "mask" else ""
        return f"write vg.{name}(vg.to_image({thing}, voxel_size{labels}), ...)"
    if meant := nearest(name, fields):
        return f"did you mean {meant!r}?"
    described = _beside("describe").DESCRIPTORS if _takes("describe", kind) else ()
    if meant := next((word for word in words if word in described), None):
        return f"write vg.describe({thing})[{meant!r}]"
    meant = nearest(name, [entry for entry in sys.modules["voxgran"].__all__ if entry.islower()])
    taken = meant is not None and _takes(meant, kind)
    return f"did you mean vg.{meant}({thing}, ...)?" if taken else f"dir({kind.__name__}) lists its attributes"


def _fields(kind: type) -> list[str]:
    """Return the public attributes of a class, and of its objects where it is a dataclass."""
    own = [entry for entry in dir(kind) if not entry.startswith("_")]
    return [*own, *getattr(kind, "__dataclass_fields__", ())]


def _first(function: str) -> inspect.Parameter | None:
    """Return the first parameter of a public function; None where there is no such function, or it has none."""
    voxgran = sys.modules["voxgran"]
    found = getattr(voxgran, function) if function in voxgran.__all__ and function.islower() else None
    return next(iter(inspect.signature(found).parameters.values()), None) if inspect.isfunction(found) else None


def _takes(function: str, kind: type) -> bool:
    """Return whether there is a public function of a name that takes an object of a class as its first argument, by the
    annotation of that.
    """
    first = _first(function)
    if first and getattr(first.annotation, "_is_protocol", False):
        return {name for name in vars(first.annotation) if not name.startswith("_")} <= set(_fields(kind))
    parts = inspect.formatannotation(first.annotation).strip("'").split(" | ") if first else []
    # what is in brackets are the items of a list or mapping
    names = {part.rpartition(".")[2] for part in parts if "[" not in part}
    return bool(names & {base.__name__ for base in kind.__mro__ if base is not object})
