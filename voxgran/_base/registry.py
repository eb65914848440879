"""Registries that find what they hold: one file, one entry.

A registry looks in one package: the file ``digital.py`` that holds a module-level `registration` is the entry
``"digital"``. Files are imported when they are asked for, never before. Third parties add entries through an
entry-point group, whose values point at such a registration.
"""

import difflib
import importlib
import importlib.metadata
import pkgutil
from collections.abc import Iterable
from typing import Generic, TypeVar

from voxgran._base.errors import InputError, UnknownNameError, shown

T = TypeVar("T")


class Registry(Generic[T]):
    """The entries of one kind.

    Parameters
    ----------
    kind : str
        What the messages call an entry, such as ``"packing method"``.
    package : str
        Package whose files are the entries.
    entry : type
        Class that each registration must be an instance of.
    group : str
        Entry-point group of third parties.
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
        if name in self._files():
            module = importlib.import_module(f"{self.package}.{name}")
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

    def _files(self) -> tuple[str, ...]:
        """Return the names of the package's public modules."""
        paths = importlib.import_module(self.package).__path__
        return tuple(m.name for m in pkgutil.iter_modules(paths) if not m.name.startswith("_"))

    def _foreign(self) -> dict[str, importlib.metadata.EntryPoint]:
        """Return the entry points of third parties."""
        return {point.name: point for point in importlib.metadata.entry_points(group=self.group)}


def unknown(kind: str, name: object, known: Iterable[str]) -> str:
    """Return the sentence that says a name is unknown, with the nearest known one."""
    names = sorted(known)
    near = difflib.get_close_matches(name if isinstance(name, str) else "", names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return f"{kind} {shown(name)} is unknown: {hint}known are {', '.join(names) or 'none'}"
