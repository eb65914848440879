"""Foundations that every room may use and that do not depend on grains.

Public names that are imported on first use (PEP 562), and the one door from a room to the rooms above it.

The stub beside an ``__init__.py`` is the only table of its public names: type checkers and editors read it, and so does
:func:`lazy_names`. Each of its imports is one line ``from place import name as name``.
"""

import sys
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any


class ExplainedModule(ModuleType):
    """A module of voxgran, and all modules in it, that explains a call of it and an attribute that it has not.

    Modules such as ``voxgran.methods.rsa`` and ``voxgran.contacts`` are there once something in them was imported, and
    are taken for functions.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        # Python sets each module that it imports on the package that it is in
        if type(value) is ModuleType and value.__name__ == f"{self.__name__}.{name}":
            value.__class__ = ExplainedModule
        super().__setattr__(name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        # libraries that send functions to other processes know the class of plain modules only
        return import_module, (self.__name__,)

    # hidden from type checkers, which would otherwise accept any name and any call
    if not TYPE_CHECKING:

        def __call__(self, *arguments: object, **keywords: object) -> None:
            """Explain the call.

            Raises
            ------
            CallError
                Always.
            """
            from voxgran._base.errors import CallError
            from voxgran._base.registry.attributes import called_module

            raise CallError(called_module(self.__name__))

        def __getattr__(self, name: str) -> Any:
            """Explain an attribute that is missing.

            Raises
            ------
            AttributeError
                Always, but for a package that imports its public names on first use.
            """
            find = vars(self).get("__getattr__")
            if find is not None:
                # its error, which is raised again
                return find(name)
            known = vars(self).get("__all__", ())
            # packages are asked for the modules that are imported from them
            if name.startswith("_") or (hasattr(self, "__path__") and name not in sys.modules["voxgran"].__all__):
                raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}", name=name)
            from voxgran._base.registry.attributes import missing_name

            raise AttributeError(missing_name(self.__name__, name, known), name=name)


def lazy_names(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package with this ``__name__`` and ``__file__`` by its
    stub.

    Raises
    ------
    AttributeError
        By the returned ``__getattr__``, for a name that is not in the stub.
    """
    with open(file.removesuffix(".py") + ".pyi", encoding="utf-8") as stub:
        lines = [line.split() for line in stub if line.startswith("from voxgran")]
    # where a name has its types in another stub, a comment says where it is
    places = {words[5]: (words[1] if len(words) == 6 else words[-1], words[3]) for words in lines if len(words) > 5}

    def find(name: str) -> Any:
        """Import a public name on first use."""
        if name not in places:
            from voxgran._base.registry.attributes import missing_name

            # with its name and no object, Python adds no suggestion of its own
            raise AttributeError(missing_name(package, name, names), name=name)
        place, stored = places[name]
        # a module of a package, such as voxgran.shapes.sizes, is no attribute of it before it is imported
        found = None if place == package else getattr(import_module(place), stored, None)
        if found is None:
            return import_module(f"{place}.{stored}")
        if hasattr(found, "__dataclass_fields__"):
            from voxgran._base.calls import document

            document(found)
        return found

    sys.modules[package].__class__ = ExplainedModule
    names = sorted(places)
    return find, lambda: names, names


def public(name: str) -> Any:
    """Return the public object of voxgran with this name.

    Only methods of Packing and Shape whose work is done in a room above their own, such as ``Packing.measure``, may use
    it: rooms import only from rooms below them.
    """
    return getattr(import_module("voxgran"), name)
