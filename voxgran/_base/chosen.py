"""Entries of a registry, chosen by name with keywords, or by an object of their parameter class."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, Protocol, TypeVar

from voxgran._base.config import from_mapping, parameters_of, to_mapping
from voxgran._base.errors import InputError, shown
from voxgran._base.registry import Registry

T = TypeVar("T")


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
    """Return name, entry and checked parameters of what was chosen.

    Parameters
    ----------
    registry : Registry
        Its entries have a parameter class each, ``parameters``.
    given : str or parameter object
        Name of an entry, or an object of its parameter class.
    keywords : mapping
        Parameters, for a name only.
    where : str
        What messages call the choice, such as ``"method"``.
    beside : iterable of str
        Other names that are known at this place.

    Raises
    ------
    UnknownNameError
        If the name, or a parameter, is unknown.
    InputError
        If a parameter has the wrong type, keywords are given beside an object, or an object is of no entry.
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
            # a constructor does not look at types
            return name, entry, from_mapping(entry.parameters, to_mapping(given), type(given).__name__)
    known = ", ".join(registry.names())
    raise InputError(
        f"{registry.kind} is {shown(given)}: it is of none of {known}; give a name or one of their objects"
    )


def document(cls: type) -> None:
    """Append the section ``Parameters`` to the docstring of a parameter class, from its fields, if it is missing."""
    text = cls.__doc__ or ""
    if "Parameters\n" in text:
        return
    lines = ["Parameters", "----------"]
    for item in parameters_of(cls):
        default = "" if item.default in (dataclasses.MISSING, None) else f", default {item.default!r}"
        optional = ", optional" if item.default is None else ""
        unit = f", in {item.unit}" if item.unit and item.unit != "length" else ""
        lines += [f"{item.name} : {item.type_text}{optional}{default}", f"    {item.doc}{unit}."]
    summary, _, rest = text.partition("\n\n")
    parts = [summary, "\n    ".join(lines), rest.strip()]
    cls.__doc__ = "\n\n    ".join(part for part in parts if part) + "\n"
