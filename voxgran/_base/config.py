"""Parameter classes as the one source of TOML keys, command-line flags, help texts and provenance.

A parameter class is a frozen keyword-only dataclass whose fields are made by :func:`parameter`; their meanings stand
under "Parameters" in its docstring, after the name alone: :func:`document` adds types and bounds. This module turns
plain mappings (from TOML, JSON or keyword arguments) into such objects and back; an unknown key is an error
that gives the nearest name. A parameter may have bounds, which :func:`check_bounds` enforces and the help prints.
"""

import dataclasses
import inspect
import math
import re
import textwrap
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass
from functools import lru_cache
from types import FunctionType
from typing import Any, TypeVar, dataclass_transform

from voxgran._base.arrays import as_choice, as_count, as_number, check_lengths, check_type
from voxgran._base.calls import explained_methods
from voxgran._base.errors import InputError, UnknownNameError, check_known, shown, unknown
from voxgran._base.scalars import float_of, nested, number_of, unwrapped, whole_number_of

T = TypeVar("T")

#: the section of a docstring on parameters, and an entry of it, with its type or without
_SECTION = re.compile(r"\n\s*Parameters\n *-{10}\n(.*?)(?=\n\n *\w+\n *---|\n *\Z|\Z)", re.DOTALL)
_ENTRY = re.compile(r"^(\w+)(?: : .*)?\n((?: +.*\n?)+)", re.MULTILINE)
#: what dataclasses with slots have for pickle, without docstrings
_PICKLING = {"__getstate__": "Return the values of the fields.", "__setstate__": "Set the values of the fields."}


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One field of a parameter class, as help texts show it."""

    name: str
    doc: str = ""
    unit: str = ""  # "" if there is none
    type: Any  # type annotation, resolved
    default: Any  # `dataclasses.MISSING` if it must be given
    bounds: Mapping[str, float] = dataclasses.field(default_factory=dict)  # some of `above`, `at_least` and `at_most`

    @property
    def type_text(self) -> str:
        """The type and its bounds, such as ``a number in [0, 1]`` or ``one of 'a', 'b'``, without ``left out``."""
        bounds = self.bounds
        text = " or ".join(_describe(kind) for kind in kinds_of(self.type))
        if "at_most" in bounds and len(bounds) == 2:
            low = f"[{bounds['at_least']:g}" if "at_least" in bounds else f"({bounds['above']:g}"
            return f"{text} in {low}, {bounds['at_most']:g}]"
        return " ".join([text, *(f"{rule.replace('_', ' ')} {bound:g}" for rule, bound in bounds.items())])


def parameter(
    default: Any = MISSING,
    *,
    doc: str = "",
    unit: str = "",
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> Any:
    """Return a dataclass field with its unit and bounds; without a default the parameter must be given.

    `doc` is its meaning, where the docstring of the class does not give it.

    The unit is such as ``"length"``, ``"voxels"``, ``"radian"``.
    The bounds, exclusive below, inclusive below and inclusive above, hold for the value or for each entry of a list.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from voxgran._base.config import parameter
    >>> @dataclass(frozen=True, kw_only=True)
    ... class Cubic:
    ...     gap: float = parameter(0.0, doc="least distance", unit="length", at_least=0.0)
    >>> Cubic(gap=0.1)
    Cubic(gap=0.1)
    """
    given = {"above": above, "at_least": at_least, "at_most": at_most}
    bounds = {rule: bound for rule, bound in given.items() if bound is not None}
    return dataclasses.field(default=default, metadata={"doc": doc, "unit": unit, "bounds": bounds})


def parameters_of(cls: type) -> tuple[Parameter, ...]:
    """Return the fields of a parameter class: its own in their order, then those of the groups that it inherits."""
    hashable: Any = cls  # to mypy a class may lack a hash
    return _parameters_of(hashable)


@lru_cache(maxsize=256)
def _parameters_of(cls: type) -> tuple[Parameter, ...]:
    """Return the fields of a parameter class; resolving its annotations takes most of the time of small calls."""
    hints, own = typing.get_type_hints(cls), inspect.get_annotations(cls)
    meanings = {name: text for base in reversed(cls.__mro__) for name, text in _meanings_in(base.__doc__ or "")}
    return tuple(
        Parameter(name=field.name, type=hints[field.name], default=field.default, **_told(field, meanings))
        for field in sorted(dataclasses.fields(cls), key=lambda field: field.name not in own)
        if field.init
    )


def _told(field: "dataclasses.Field[Any]", meanings: Mapping[str, str]) -> dict[str, Any]:
    """Return the metadata of a field, with its meaning from a docstring where it has none."""
    told = dict(field.metadata)
    meaning = meanings.get(field.name, "").removesuffix(_in_unit(told.get("unit", "")))
    return told | {"doc": told.get("doc") or meaning}


def _meanings_in(docstring: str) -> list[tuple[str, str]]:
    """Return names and meanings of the parameters that a docstring lists."""
    section = _SECTION.search(docstring)
    entries = _ENTRY.findall(textwrap.dedent(section[1])) if section else []
    return [(name, " ".join(text.split()).removesuffix(".")) for name, text in entries]


def _in_unit(unit: str) -> str:
    """Return how a meaning ends in help texts; lengths are in any unit."""
    return f", in {unit}" if unit not in ("", "length") else ""


@dataclass_transform(kw_only_default=True, frozen_default=True)
def parameter_class(cls: type[T]) -> type[T]:
    """Make a class a frozen dataclass of keywords with slots, whose constructor explains calls that do not fit, and
    checks the values by :func:`check_bounds` unless the class has a check of its own (decorator).

    Examples
    --------
    >>> from voxgran._base.config import parameter, parameter_class
    >>> @parameter_class
    ... class Cubic:
    ...     gap: float = parameter(0.0, doc="least distance", unit="length", at_least=0.0)
    >>> Cubic(gap=0.1)
    Cubic(gap=0.1)
    """
    if not hasattr(cls, "__post_init__"):
        cls.__post_init__ = check_bounds  # type: ignore[attr-defined]
    return explained_methods(dataclass(frozen=True, slots=True, kw_only=True)(cls))


def is_parameter_class(kind: Any) -> bool:
    """Return whether a type is a parameter class: a dataclass whose fields are made by :func:`parameter`."""
    fields = dataclasses.fields(kind) if isinstance(kind, type) and dataclasses.is_dataclass(kind) else ()
    return any("doc" in field.metadata for field in fields)


def check_bounds(instance: Any, *, of: str = "") -> None:
    """Check the parameters of an object against their bounds and choices, in the ``__post_init__`` of its class.

    `of` is the name of the group in messages, such as ``"lid"``, where the object is a parameter of another one.
    """
    for entry in parameters_of(type(instance)):
        value = getattr(instance, entry.name)
        if value is None:
            continue
        kinds, name = kinds_of(entry.type), f"{of} {entry.name}".lstrip()
        if len(kinds) == 1 and typing.get_origin(kinds[0]) is typing.Literal:
            as_choice(value, name, typing.get_args(kinds[0]))
        lists = [kind for kind in kinds if typing.get_origin(kind) is tuple]
        plain = all(kind in (float, int, str) for kind in kinds if kind not in lists)
        # two numbers in place of one are a range, from which a family draws
        several = isinstance(value, tuple | list) and not (
            len(value) == 2 and all(isinstance(one, int | float) for one in value)
        )
        if plain and (lists or kinds == (str,) or several):
            # numbers alone are checked by their bounds
            _convert(value, entry.type, name)
        if not entry.bounds or is_parameter_class(type(value)):
            continue
        whole = int in kinds and float not in kinds
        for item in value if isinstance(value, tuple | list) else (value,):
            if whole:
                as_count(item, name, **{rule: int(bound) for rule, bound in entry.bounds.items()})
            else:
                as_number(item, name, **entry.bounds)
                if entry.unit == "length":
                    check_lengths(item, name)


def kind_of(
    mapping: Mapping[str, Any], kinds: Mapping[str, type[T]], where: str, *, example: str
) -> tuple[type[T], dict[str, Any]]:
    """Return the class that the key `kind` of a mapping names, and the values beside it.

    `example` is a mapping of a kind, as messages show it.

    Raises
    ------
    UnknownNameError
        If the kind is not known.
    InputError
        If it is no mapping, or the kind is missing.
    """
    check_type(mapping, Mapping, where, f"a mapping with a kind, such as {example}")
    values = dict(mapping)
    if "kind" not in values:
        raise InputError(f"{where} kind is missing: it must be one of {', '.join(sorted(kinds))}; add it")
    kind = values.pop("kind")
    check_known(f"{where} kind", kind, kinds)
    return kinds[kind], values


def from_mapping(cls: type[T], mapping: Mapping[str, Any], where: str, *, beside: Iterable[str] = ()) -> T:
    """Return an object of a parameter class from keys and values, as TOML, JSON or keyword arguments give them.

    `where` is the name of the place in messages, such as ``"[packing]"``; `beside` are other names known there, which
    may be suggested for an unknown key.

    Raises
    ------
    UnknownNameError
        If a key is not a parameter of the class.
    InputError
        If a parameter without default is missing or a value has the wrong type.
    """
    known = {entry.name: entry for entry in parameters_of(cls)}
    for key in mapping:
        if key not in known:
            raise UnknownNameError(unknown(f"{where} key", key, known, beside=beside))
    for entry in known.values():
        if entry.default is MISSING and entry.name not in mapping:
            raise InputError(f"{where} {entry.name} is missing: it must be given ({entry.doc}); add it")
    values = {key: _convert(value, known[key].type, f"{where} {key}") for key, value in mapping.items()}
    return cls(**values)


def to_mapping(instance: Any) -> dict[str, Any]:
    """Return the fields of a parameter object as JSON-able values, in their order."""
    return {field.name: _plain(getattr(instance, field.name)) for field in dataclasses.fields(instance)}


def _plain(value: Any) -> Any:
    """Turn tuples into lists and nested parameter objects into dicts; objects of other classes stay as they are."""
    return nested(value, lambda one: to_mapping(one) if is_parameter_class(type(one)) else one)


def _convert(value: Any, wanted: Any, where: str) -> Any:
    """Return the value converted to the annotated type, or raise."""
    origin, arguments = typing.get_origin(wanted), typing.get_args(wanted)
    value = value.tolist() if getattr(value, "ndim", 0) and hasattr(value, "tolist") else unwrapped(value)
    if wanted is Any or (wanted is type(None) and value is None):
        return value
    if origin in (typing.Union, types.UnionType):
        return _convert_union(value, arguments, where)
    if origin is typing.Literal:
        if value in arguments:
            return value
        raise InputError(f"{where} is {shown(value)}: it must be {_describe(wanted)}; choose one of these")
    if origin is tuple and isinstance(value, list | tuple):
        if arguments[-1] is Ellipsis:
            return tuple(_convert(item, arguments[0], where) for item in value)
        if len(value) == len(arguments):
            return tuple(_convert(item, kind, where) for item, kind in zip(value, arguments, strict=True))
    if is_parameter_class(wanted):
        if isinstance(value, wanted):
            return value
        if isinstance(value, Mapping):
            return from_mapping(wanted, value, where)
    if origin is Mapping and isinstance(value, Mapping):
        return dict(value)
    if origin is None and (found := _plain_value(value, wanted)) is not None:
        return found
    remedy = "correct it"
    if isinstance(value, str) and wanted == tuple[str, ...]:
        remedy = f"write [{shown(value)}]"
    elif isinstance(value, list | tuple) and value and wanted is str and all(isinstance(one, str) for one in value):
        remedy = f"write {shown(''.join(value))}"
    raise InputError(f"{where} is {shown(value)}: it must be {_finite(_describe(wanted), value)}; {remedy}")


def _convert_union(value: Any, kinds: tuple[Any, ...], where: str) -> Any:
    """Return the value as the first kind that takes it; a mapping as the parameter class among them."""
    classes = [kind for kind in kinds if is_parameter_class(kind)]
    if isinstance(value, Mapping) and len(classes) == 1:
        return _convert(value, classes[0], where)
    for kind in kinds:
        try:
            return _convert(value, kind, where)
        except UnknownNameError:
            raise
        except InputError:
            continue
    told = _finite(" or ".join(_describe(kind) for kind in kinds if kind is not type(None)), value)
    raise InputError(
        f"{where} is {shown(value)}: it must be {told}; {'or leave it out' if type(None) in kinds else 'correct it'}"
    )


def _plain_value(value: Any, wanted: Any) -> Any:
    """Return a number, flag or text of the wanted type; None where the value is none of that type."""
    if wanted is int:
        return whole_number_of(value)
    if wanted is float:
        number = number_of(value)
        return None if number is None or not math.isfinite(number := float_of(number)) else number
    return value if isinstance(wanted, type) and isinstance(value, wanted) else None


def kinds_of(wanted: Any) -> tuple[Any, ...]:
    """Return the alternatives of a type annotation, without None."""
    union = typing.get_origin(wanted) in (typing.Union, types.UnionType)
    return tuple(kind for kind in (typing.get_args(wanted) if union else (wanted,)) if kind is not type(None))


def _finite(told: str, value: Any) -> str:
    """Return the words for types, which say that numbers are finite where those of a value are not."""
    several = value if isinstance(value, list | tuple) else [value]
    wild = any(isinstance(one, float) and not math.isfinite(one) for one in several)
    return told.replace("a number", "a finite number") if wild else told


def _describe(wanted: Any) -> str:
    """Write a type as a person would."""
    origin, arguments = typing.get_origin(wanted), typing.get_args(wanted)
    names = {float: "a number", int: "a whole number", bool: "true or false", str: "text", type(None): "left out"}
    if wanted in names:
        return names[wanted]
    if origin is typing.Literal:
        return "one of " + ", ".join(repr(item) for item in arguments)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_describe(item) for item in arguments)
    if origin is tuple:
        if arguments[-1] is Ellipsis:
            return "a list" if arguments[0] is Any else f"a list, each entry {_describe(arguments[0])}"
        return f"a list of {len(arguments)}, each entry {_describe(arguments[0])}"
    if origin is Mapping:
        return "a table"
    if is_parameter_class(wanted):
        entries = dataclasses.fields(wanted)
        example = {field.name: field.default for field in entries if field.default not in (MISSING, None)}
        return f"a table of {' and '.join(field.name for field in entries)}" + (
            f", such as {example}, or {wanted.__name__}({next(iter(example))}=...)" if example else ""
        )
    return getattr(wanted, "__name__", str(wanted))


def document(cls: type) -> None:
    """Write the section ``Parameters`` of the docstring of a parameter class, with types, bounds and defaults."""
    for name, meaning in _PICKLING.items():
        method = vars(cls).get(name)
        if method is not None and method.__doc__ is None:
            # the functions of dataclasses are those of all classes; help shows the comments above them
            own = FunctionType(method.__code__, method.__globals__, name)
            own.__doc__ = meaning
            setattr(cls, name, own)
    text = cls.__doc__ or ""
    section = _SECTION.search(text)
    if section and re.search(r"^ *\w+ : ", section[1], re.MULTILINE):
        return
    lines = ["Parameters", "----------"]
    for item in parameters_of(cls):
        default = "" if item.default in (MISSING, None) else f", default {item.default!r}"
        optional = ", optional" if item.default is None else ""
        lines.append(f"{item.name} : {item.type_text}{optional}{default}")
        meaning = item.doc if item.unit in item.doc else f"{item.doc}{_in_unit(item.unit)}"
        lines += textwrap.wrap(f"{meaning}.", 100, initial_indent="    ", subsequent_indent="    ")
    summary, _, rest = _SECTION.sub("", text).partition("\n\n")
    parts = [summary, "\n    ".join(lines), rest.strip()]
    cls.__doc__ = "\n\n    ".join(part for part in parts if part) + "\n"
