"""Calls whose arguments do not fit the signature, explained in one sentence."""

import inspect
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from voxgran._base.deprecation import warn_former
from voxgran._base.errors import CallError
from voxgran._base.registry import unknown

P = ParamSpec("P")
R = TypeVar("R")


def explained(*, hint: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Raise a `CallError` in place of Python's bare TypeError where a call does not fit the signature (decorator).

    Parameters
    ----------
    hint : str
        A call that is right, such as ``"Box((4, 4, 6))"``.

    Raises
    ------
    CallError
        Later, by the decorated function.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def call(*arguments: P.args, **keywords: P.kwargs) -> R:
            try:
                return function(*arguments, **keywords)
            except TypeError:
                rule = _broken_rule(function, arguments, keywords)
                if rule is None:
                    raise
                raise CallError(f"{rule}; write {hint}") from None

        return call

    return decorate


def renamed(**former: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Accept former names of keyword arguments, with a DeprecationWarning (decorator).

    Parameters
    ----------
    **former
        The present name for each former one, such as ``largest_hole="max_hole"``.

    Raises
    ------
    CallError
        Later, by the decorated function, where both names are given.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        name = function.__qualname__.removesuffix(".__init__")

        @wraps(function)
        def call(*arguments: P.args, **keywords: P.kwargs) -> R:
            for old, new in former.items():
                if old in keywords:
                    if new in keywords:
                        raise CallError(f"{name} was given {new} twice, also by its former name {old}; leave that out")
                    warn_former(f"argument {old} of {name} is now {new}; write that name")
                    keywords[new] = keywords.pop(old)
            return function(*arguments, **keywords)

        return call

    return decorate


def _broken_rule(
    function: Callable[..., Any], arguments: tuple[object, ...], keywords: Mapping[str, object]
) -> str | None:
    """Return which rule of the signature a call breaks; None where it breaks none."""
    name = function.__qualname__.removesuffix(".__init__")
    entries = [entry for entry in inspect.signature(function).parameters.values() if entry.name != "self"]
    given = arguments[1:] if function.__name__ == "__init__" else arguments
    known = [entry.name for entry in entries if entry.kind is not entry.VAR_KEYWORD]
    by_position = [entry.name for entry in entries if entry.kind is entry.POSITIONAL_OR_KEYWORD]
    if len(given) > len(by_position):
        listed = ", ".join(by_position)
        return f"{name} takes {len(by_position)} arguments by position ({listed}) and was given {len(given)}"
    if len(known) == len(entries):
        for key in keywords:
            if key not in known:
                return unknown(f"argument of {name}", key, known)
    for key in by_position[: len(given)]:
        if key in keywords:
            return f"{name} was given {key} twice, by position and by name"
    there = {*by_position[: len(given)], *keywords}
    missing = [entry.name for entry in entries if entry.name in known and entry.default is entry.empty]
    missing = [key for key in missing if key not in there]
    return f"{name} needs {' and '.join(missing)}" if missing else None
