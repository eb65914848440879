"""Attributes that are missing, of modules, classes and objects: what may be written in their place."""

import inspect
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from voxgran._base import errors
from voxgran._base.errors import VoxgranError
from voxgran._base.registry.names import nearest, nearest_word, synonyms_of


def missing_name(module: str, name: str, known: Iterable[str]) -> str:
    """Return the message for a name that a module does not have, with the one that was most likely meant."""
    return f"module {module!r} has no attribute {name!r}: {_remedy_in_module(module, name, known)}"


def called_module(module: str) -> str:
    """Return the message for a call of a module, with what may be called in its place, of the names beside it."""
    place, _, name = module.rpartition(".")
    beside = sys.modules[place]
    known = [one for one in vars(beside).get("__all__", dir(beside)) if one != name]
    method = place == "voxgran" and inspect.isfunction(getattr(beside.Packing, name, None))
    remedy = f"write packing.{name}()" if method else _remedy_in_module(place, name, known)
    return f"{module} is a module and no function: {remedy}"


def _remedy_in_module(module: str, name: str, known: Iterable[str]) -> str:
    """Return what may be written in place of a name that a module does not have."""
    names = list(known)
    top = sys.modules["voxgran"]
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
        (voxgran.packing_methods(), "vg.pack(shapes, container, {!r}, ...)"),
        (voxgran.clump_methods(), "vg.fit_clump(shape, method={!r})"),
        (voxgran.engines(), "vg.write_deck(packing, folder, {!r})"),
        (_measures(), "vg.measure(packing, {!r})"),
    )
    words = (word, *(() if container else synonyms_of(word)))
    call = next((call.format(one) for one in words for names, call in places if one in names), None)
    return f"{call} for the shape, vg.{container}(...) for the container" if call and container else call


def _measures() -> tuple[str, ...]:
    """Return the names of the measures."""
    names: tuple[str, ...] = sys.modules[sys.modules["voxgran"].measure.__module__].measures()
    return names


def _descriptors() -> tuple[str, ...]:
    """Return the names of the descriptors of form."""
    return tuple(sys.modules[sys.modules["voxgran"].describe.__module__].DESCRIPTORS)


class ExplainedClass(type):
    """Class of classes that answer an unknown attribute of their own, such as ``Scene.from_file``."""

    # hidden from type checkers, which would otherwise accept any name
    if not TYPE_CHECKING:

        def __getattr__(cls, name: str) -> Any:
            """Explain an attribute that is missing.

            Raises
            ------
            AttributeError
                Always.
            """
            # a dataclass in the making is asked for the defaults of its fields
            if name.startswith("_") or name in vars(cls).get("__annotations__", ()):
                raise AttributeError(f"class {cls.__name__!r} has no attribute {name!r}")
            raise AttributeError(f"{cls.__name__} has no attribute {name!r}: {_remedy_of_class(cls, name)}", name=name)


class ExplainedAttributes(metaclass=ExplainedClass):
    """Objects that answer an unknown attribute with the one that was most likely meant.

    A public function of voxgran of that name, such as `equilibrium`, is named where it takes them. A class may say in
    its class attribute `_instead`, a mapping of names to expressions, what else to write.
    """

    __slots__ = ()
    _instead: ClassVar[Mapping[str, str]] = {}

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Explain an attribute that is missing.

            Raises
            ------
            AttributeError
                Always.
            """
            kind = type(self)
            if name.startswith("_") or any(name in vars(base) for base in kind.__mro__):
                # a method that Python or a notebook asks for, or an error within a property, which is raised again
                return object.__getattribute__(self, name)
            # with its name and no object, Python adds no suggestion of its own
            raise AttributeError(f"{kind.__name__} has no attribute {name!r}: {_remedy(kind, name)}", name=name)


def _fields(kind: type) -> list[str]:
    """Return the public attributes of a class, and of its objects where it is a dataclass."""
    own = [entry for entry in dir(kind) if not entry.startswith("_")]
    return [*own, *getattr(kind, "__dataclass_fields__", ())]


def _function(name: str) -> Callable[..., Any] | None:
    """Return the public function of a name; None for a class or a module, such as voxgran.sizes."""
    voxgran = sys.modules["voxgran"]
    found = getattr(voxgran, name) if name in voxgran.__all__ and name.islower() else None
    return found if inspect.isfunction(found) else None


def _remedy(kind: type[ExplainedAttributes], name: str) -> str:
    """Return what may be written in place of an unknown attribute of an object."""
    thing, fields = kind.__name__.lower(), _fields(kind)
    if name in kind._instead:
        return f"write {kind._instead[name]}"
    for word in (name, *synonyms_of(name)):
        if word in fields:
            return f"did you mean {word!r}?"
        if "to_shape" in fields and word in _fields(shape := sys.modules["voxgran"].Shape):
            called = "(...)" if inspect.isfunction(getattr(shape, word, None)) else ""
            return f"write {thing}.to_shape().{word}{called}"
        for function in (word, f"save_{word}", f"write_{word}"):
            if _takes(function, kind):
                return f"write vg.{function}({thing}, ...)"
        if _takes("measure", kind) and word in _measures():
            return f"write vg.measure({thing}, {word!r})"
    first = _first(name)
    if first and first.name in ("image", "mask") and _takes("to_image", kind):
        labels = ", labels=False" if first.name == "mask" else ""
        return f"write vg.{name}(vg.to_image({thing}, voxel_size{labels}), ...)"
    meant = nearest(name, fields)
    if meant:
        return f"did you mean {meant!r}?"
    described = _descriptors() if _takes("describe", kind) else ()
    meant = next((word for word in (name, *synonyms_of(name)) if word in described), None)
    if meant:
        return f"write vg.describe({thing})[{meant!r}]"
    meant = nearest(name, [entry for entry in sys.modules["voxgran"].__all__ if entry.islower()])
    taken = meant is not None and _takes(meant, kind)
    return f"did you mean vg.{meant}({thing}, ...)?" if taken else f"dir({kind.__name__}) lists its attributes"


def _remedy_of_class(cls: type, name: str) -> str:
    """Return what may be written in place of an unknown attribute of a class: one of its own, or a public function that
    returns its objects.
    """
    own = _fields(cls)
    for word in (name, *synonyms_of(name)):
        if word in own:
            return f"did you mean {word!r}?"
        for function in (word, f"{word}_{cls.__name__.lower()}"):
            found = _function(function)
            if found and inspect.signature(found).return_annotation is cls:
                return f"write vg.{function}(...)"
    meant = nearest(name, own)
    return f"did you mean {meant!r}?" if meant else f"dir({cls.__name__}) lists its attributes"


def _first(function: str) -> inspect.Parameter | None:
    """Return the first parameter of a public function; None where there is no such function, or it has none."""
    found = _function(function)
    return next(iter(inspect.signature(found).parameters.values()), None) if found else None


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
