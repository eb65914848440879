"""Calls that do not fit a signature, in one sentence with what is right."""

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from voxgran._base.arrays import as_flag
from voxgran._base.errors import CallError, nearest, unknown

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")


def explained(*, hint: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Raise a `CallError` in place of Python's TypeError if a call does not fit the signature, and an `InputError` if a
    keyword of type `bool` is neither True nor False (decorator).

    The first message ends with the hint, a correct call such as ``"Box((4, 4, 6))"``.

    Raises
    ------
    CallError, InputError
        By the decorated function.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        flags = [name for name, kind in inspect.get_annotations(function).items() if kind is bool and name != "return"]

        @wraps(function)
        def call(*arguments: P.args, **keywords: P.kwargs) -> R:
            for name in flags:
                if name in keywords:
                    keywords[name] = as_flag(keywords[name], name)
            try:
                return function(*arguments, **keywords)
            except TypeError:
                rule = _broken_rule(function, arguments, keywords)
                if rule is None:
                    raise
                raise CallError(f"{rule}; write {hint}") from None

        return call

    return decorate


def explained_methods(cls: type[T]) -> type[T]:
    """Explain calls of the constructor and of the public methods of a class that do not fit, as :func:`explained` does
    (decorator).
    """
    fields = [field.name for field in dataclasses.fields(cls) if field.init] if dataclasses.is_dataclass(cls) else []
    first = next((name for name in (*inspect.get_annotations(cls), *fields) if name in fields), None)
    for name, member in list(vars(cls).items()):
        function = getattr(member, "__func__", member)
        decorated = name == "__init__" and hasattr(function, "__wrapped__")
        if not inspect.isfunction(function) or decorated or (name.startswith("_") and name != "__init__"):
            continue
        hint = f"help({cls.__name__}.{name}) to see its arguments"
        if name == "__init__":
            hint = f"{cls.__name__}({first}=...)" if first else f"{cls.__name__}()"
        called = explained(hint=hint)(function)
        setattr(cls, name, called if member is function else type(member)(called))
    return cls


def _broken_rule(
    function: Callable[..., Any], arguments: tuple[object, ...], keywords: Mapping[str, object]
) -> str | None:
    """Return which rule of the signature a call breaks; None where it breaks none."""
    name = function.__qualname__.removesuffix(".__init__")
    entries = list(inspect.signature(function).parameters.values())
    bound = len(entries) > 0 and entries[0].name in ("self", "cls")
    owner = type(arguments[0]) if bound else object
    if entries and entries[0].name == "self" and function.__name__ != "__init__":
        # of the class that the caller knows
        name = f"{owner.__name__}.{function.__name__}"
    entries, given = entries[bound:], arguments[bound:]
    known = [entry.name for entry in entries if entry.kind is not entry.VAR_KEYWORD]
    by_position = [entry.name for entry in entries if entry.kind is entry.POSITIONAL_OR_KEYWORD]
    if len(given) > len(by_position):
        if not by_position:
            named = f" by position but by name: {', '.join(known)}" if known else ""
            return f"{name} takes no arguments{named}"
        listed = ", ".join(by_position)
        noun = "argument" if len(by_position) == 1 else "arguments"
        return f"{name} takes {len(by_position)} {noun} by position ({listed}) and was given {len(given)}"
    if len(known) == len(entries):
        for key in keywords:
            if key not in known:
                remedy = " (pack, Packing.of, load and load_shape take the unit)" if key == "unit" else ""
                return unknown(f"argument of {name}", key, known) + remedy
    for key in by_position[: len(given)]:
        if key in keywords:
            return f"{name} was given {key} twice, by position and by name"
    there = {*by_position[: len(given)], *keywords}
    missing = [entry.name for entry in entries if entry.name in known and entry.default is entry.empty]
    missing = [key for key in missing if key not in there]
    if not missing:
        return None
    # of a function that takes any keywords, one that it does not name may be a slip
    others = ((key, nearest(key, [*missing, *known])) for key in keywords if key not in known)
    slips = "".join(f", and {key!r} may stand for {meant!r}" for key, meant in others if meant)
    return f"{name} needs {' and '.join(missing)}{slips}"
