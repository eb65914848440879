"""Registries that find what they hold: one file, one entry.

A registry looks in one package and in the packages inside it: the file ``digital.py`` that holds a module-level
`registration` is the entry ``"digital"``. Files are imported when they are asked for, never before. Third parties add
entries through an entry-point group, whose values point at such a registration.

The messages for names that are unknown are made beside it: of entries and keys in ``names``, of modules and attributes
in ``attributes``.
"""

import importlib
import importlib.metadata
import pkgutil
import sys
from functools import cache, lru_cache
from typing import Generic, TypeVar

from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.registry.attributes import ExplainedAttributes
from voxgran._base.registry.names import nearest, unknown

__all__ = ["ExplainedAttributes", "Registry", "nearest", "unknown"]

T = TypeVar("T")


class Registry(Generic[T]):
    """Entries of one kind: of the files of a package and of an entry-point group; each is an instance of `entry`.

    In messages an entry is called `kind`, such as ``"packing method"``.
    """

    def __init__(self, kind: str, package: str, entry: type[T], *, group: str) -> None:
        self.kind = kind
        self.package = package
        self.entry = entry
        self.group = group

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
        return found

    def package_of(self, name: str) -> str:
        """Return the package that registers an entry by an entry point; ``""`` for a file of the registry's package."""
        point = None if name in self._files() else self._foreign().get(name)
        if point is None:
            return ""
        return point.dist.name if point.dist else point.module.partition(".")[0]

    def _files(self) -> dict[str, str]:
        """Return the public modules of the package and of those inside it: names of files, and of modules."""
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
