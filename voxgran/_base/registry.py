"""Registries that find what they hold: one file, one entry.

A registry looks in one package and in the packages inside it. The module-level `registration` of the file
``digital.py`` is the entry ``"digital"``; the registry gives it this name. Where the files lie apart, a table names
them. Files are imported when they are asked for, never before. Third parties add entries through an entry-point group,
whose values point at such a registration; an entry has the name of its entry point.
"""

import dataclasses
import importlib
import importlib.metadata
import pkgutil
import sys
from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from typing import Any, ClassVar, Generic, Protocol, TypeVar

from voxgran._base.config import from_mapping, to_mapping
from voxgran._base.errors import InputError, UnknownNameError, shown, unknown

T = TypeVar("T")


class Parameters(Protocol):
    """An object of a parameter class, such as ``vg.methods.Digital(voxel_size=0.1)``."""

    __dataclass_fields__: ClassVar[dict[str, Any]]


class Registry(Generic[T]):
    """Entries of one kind: of the files of a package and of an entry-point group; each is an instance of `entry`.

    In messages an entry is called `kind`, such as ``"packing method"``. `files` names the file of each entry in the
    package, such as ``{"digital": "digital.walk_method"}``; without it a file has the name of its entry.
    """

    def __init__(
        self, kind: str, package: str, entry: type[T], *, group: str, files: Mapping[str, str] | None = None
    ) -> None:
        self.kind = kind
        self.package = package
        self.entry = entry
        self.group = group
        self.files = files

    def names(self) -> tuple[str, ...]:
        """Return the names of all entries, in alphabetical order; nothing is imported but the package."""
        return tuple(sorted({*self._files(), *self._foreign()}))

    def get(self, name: str) -> T:
        """Return the entry of that name.

        Raises
        ------
        UnknownNameError
            If there is none; the message gives the nearest name.
        InputError
            If the file or entry point does not hold a registration of the right class.
        """
        if not isinstance(name, str):
            raise UnknownNameError(unknown(self.kind, name, self.names()))
        files = self._files()
        if name in files:
            module = importlib.import_module(files[name])
            found = getattr(module, "registration", None)
        elif name in self._foreign():
            found = self._foreign()[name].load()
        else:
            raise UnknownNameError(unknown(self.kind, name, self.names()))
        if not isinstance(found, self.entry):
            raise InputError(
                f"{self.kind} {name!r} is {found!r}: its file must hold 'registration = "
                f"{self.entry.__name__}(...)'; add that line"
            )
        named: Any = found
        return found if named.name == name else dataclasses.replace(named, name=name)

    def package_of(self, name: str) -> str:
        """Return the package that registers an entry by an entry point; ``""`` for a file of the registry's package."""
        point = None if name in self._files() else self._foreign().get(name)
        if point is None:
            return ""
        return point.dist.name if point.dist else point.module.partition(".")[0]

    def chosen(
        self, given: str | Parameters, keywords: Mapping[str, Any], *, where: str, beside: Iterable[str] = ()
    ) -> tuple[str, T, Any]:
        """Return name, entry and checked parameters of the entry given by name or by an object of its parameters.

        `keywords` are the parameters, only for a name; `where` is the name of the choice in messages, such as
        ``"method"``; `beside` are other names to suggest. Unknown names and parameters of the wrong type are refused.

        Raises
        ------
        InputError
            If keywords are given beside an object, or an object belongs to no entry.
        """
        if not dataclasses.is_dataclass(given):
            entry: Any = self.get(given)  # type: ignore[arg-type]
            label = f"{where} {given!r}" if where else str(given)
            return str(given), entry, from_mapping(entry.parameters, keywords, label, beside=beside)
        if isinstance(given, type):
            raise InputError(
                f"{self.kind} is the class {given.__name__}: an object is needed; write {given.__name__}()"
            )
        if keywords:
            raise InputError(
                f"{self.kind} is {shown(given)} and {', '.join(keywords)} given beside it: the object holds all "
                f"parameters; write {type(given).__name__}({next(iter(keywords))}=...)"
            )
        for name in self.names():
            entry = self.get(name)
            if type(given) is entry.parameters:
                # a constructor does not check types
                return name, entry, from_mapping(entry.parameters, to_mapping(given), type(given).__name__)
        raise InputError(
            f"{self.kind} is {shown(given)}: it is of none of {', '.join(self.names())}; give a name or one of their "
            "objects"
        )

    def _files(self) -> dict[str, str]:
        """Return the module of each entry by its name, from the table, or from the files of the package and of the
        packages inside it.
        """
        if self.files is not None:
            return {name: f"{self.package}.{file}" for name, file in self.files.items()}
        found: dict[str, str] = {}
        for package in (self.package, *_modules_of(self.package, packages=True)):
            names = _modules_of(package, packages=False)
            found |= {name: module for module in names if not (name := module.rpartition(".")[2]).startswith("_")}
        return found

    def _foreign(self) -> dict[str, importlib.metadata.EntryPoint]:
        """Return the entry points of third parties."""
        return {point.name: point for point in _entry_points(self.group, tuple(sys.path))}


@lru_cache(maxsize=16)
def _entry_points(group: str, places: tuple[str, ...]) -> tuple[importlib.metadata.EntryPoint, ...]:
    """Return the entry points of a group, which are looked for once in the places where libraries are found."""
    del places
    return tuple(importlib.metadata.entry_points(group=group))


@cache
def _modules_of(package: str, *, packages: bool) -> tuple[str, ...]:
    """Return the full names of the modules or of the packages in a package, whose folder is read once a process."""
    found = pkgutil.iter_modules(importlib.import_module(package).__path__)
    return tuple(f"{package}.{one.name}" for one in found if one.ispkg == packages)
