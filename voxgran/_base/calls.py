"""Arguments of calls: explained where they do not fit, accepted by former names, and choices by name or object."""

import dataclasses
import inspect
import textwrap
from collections.abc import Callable, Iterable, Mapping
from functools import wraps
from types import FunctionType
from typing import Any, ClassVar, ParamSpec, Protocol, TypeVar

from voxgran._base.arrays import as_flag
from voxgran._base.config import from_mapping, parameters_of, removal_of, to_mapping
from voxgran._base.errors import CallError, InputError, shown
from voxgran._base.registry import Registry, nearest, unknown
from voxgran._base.warning import warn_former

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")

#: what dataclasses with slots have for pickle, without docstrings
_PICKLING = {"__getstate__": "Return the values of the fields.", "__setstate__": "Set the values of the fields."}


def explained(*, hint: str, owner: type = object) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Raise a `CallError` in place of Python's TypeError if a call does not fit the signature, and an `InputError` if a
    keyword of type `bool` is neither True nor False (decorator).

    The first message ends with the hint, a correct call such as ``"Box((4, 4, 6))"``. `owner` is the parameter class
    whose constructor is decorated; names that it has lost are explained.

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
                rule = _broken_rule(function, arguments, keywords, owner)
                if rule is None:
                    raise
                raise CallError(f"{rule}; write {hint}") from None

        return call

    return decorate


def explained_methods(cls: type[T]) -> type[T]:
    """Explain calls of the public methods of a class that do not fit, as :func:`explained` does (decorator)."""
    for name, member in list(vars(cls).items()):
        function = getattr(member, "__func__", member)
        if name.startswith("_") or not inspect.isfunction(function):
            continue
        called = explained(hint=f"help({cls.__name__}.{name}) to see its arguments")(function)
        setattr(cls, name, called if member is function else type(member)(called))
    return cls


def renamed(**former: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Accept former names of keyword arguments, as in ``largest_hole="max_hole"``, with a DeprecationWarning
    (decorator).

    Raises
    ------
    CallError
        By the decorated function, if both names are given.
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
    function: Callable[..., Any], arguments: tuple[object, ...], keywords: Mapping[str, object], owner: type
) -> str | None:
    """Return which rule of the signature a call breaks; None where it breaks none."""
    name = function.__qualname__.removesuffix(".__init__")
    entries = list(inspect.signature(function).parameters.values())
    bound = len(entries) > 0 and entries[0].name in ("self", "cls")
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
                return removal_of(owner, key, name) or unknown(f"argument of {name}", key, known)
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


class Parameters(Protocol):
    """An object of a parameter class, such as ``vg.methods.Digital(voxel_size=0.1)``."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


def chosen(
    registry: Registry[T],
    given: str | Parameters,
    keywords: Mapping[str, Any],
    *,
    where: str,
    beside: Iterable[str] = (),
) -> tuple[str, T, Any]:
    """Return name, entry and checked parameters of the entry of a registry given by name or by an object of its
    parameters.

    `keywords` are the parameters, only for a name; `where` is the name of the choice in messages, such as ``"method"``;
    `beside` are other names to suggest. Unknown names and parameters of the wrong type are refused.

    Raises
    ------
    InputError
        If keywords are given beside an object, or an object belongs to no entry.
    """
    if not dataclasses.is_dataclass(given):
        entry: Any = registry.get(given)  # type: ignore[arg-type]
        label = f"{where} {given!r}" if where else str(given)
        return str(given), entry, from_mapping(entry.parameters, keywords, label, beside=beside)
    if isinstance(given, type):
        raise InputError(
            f"{registry.kind} is the class {given.__name__}: an object is needed; write {given.__name__}()"
        )
    if keywords:
        raise InputError(
            f"{registry.kind} is {shown(given)} and {', '.join(keywords)} given beside it: the object holds all "
            f"parameters; write {type(given).__name__}({next(iter(keywords))}=...)"
        )
    for name in registry.names():
        entry = registry.get(name)
        if type(given) is entry.parameters:
            # a constructor does not check types
            return name, entry, from_mapping(entry.parameters, to_mapping(given), type(given).__name__)
    known = ", ".join(registry.names())
    raise InputError(
        f"{registry.kind} is {shown(given)}: it is of none of {known}; give a name or one of their objects"
    )


def document(cls: type) -> None:
    """Append the section ``Parameters`` to the docstring of a parameter class, from its fields, if it is missing, and
    explain calls of its constructor that do not fit.
    """
    constructor: Any = vars(cls)["__init__"]
    if not hasattr(constructor, "__wrapped__"):
        keyword = next((f"{item.name}=..." for item in parameters_of(cls)), "")
        # setattr, since mypy refuses the assignment of a method
        setattr(cls, "__init__", explained(hint=f"{cls.__name__}({keyword})", owner=cls)(constructor))  # noqa: B010
    for name, meaning in _PICKLING.items():
        method = vars(cls).get(name)
        if method is not None and method.__doc__ is None:
            # the functions of dataclasses are those of all classes; help shows the comments above them
            own = FunctionType(method.__code__, method.__globals__, name)
            own.__doc__ = meaning
            setattr(cls, name, own)
    text = cls.__doc__ or ""
    if "Parameters\n" in text:
        return
    lines = ["Parameters", "----------"]
    for item in parameters_of(cls):
        default = "" if item.default in (dataclasses.MISSING, None) else f", default {item.default!r}"
        optional = ", optional" if item.default is None else ""
        unit = f", in {item.unit}" if item.unit and item.unit != "length" else ""
        lines.append(f"{item.name} : {item.type_text}{optional}{default}")
        lines += textwrap.wrap(f"{item.doc}{unit}.", 100, initial_indent="    ", subsequent_indent="    ")
    summary, _, rest = text.partition("\n\n")
    parts = [summary, "\n    ".join(lines), rest.strip()]
    cls.__doc__ = "\n\n    ".join(part for part in parts if part) + "\n"
