"""Foundations that every room may use and that do not depend on grains.

Public names that are imported on first use (PEP 562), and the one door from a room to the rooms above it.

The stub beside an ``__init__.py`` is the only table of its public names: type checkers and editors read it, and so does
:func:`lazy_names`. Each of its imports is one line ``from place import name as name``.
"""

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, Any


class Missing:
    """The message for an attribute that a module, given by its name, or an object of a class does not have.

    What may be written in its place is looked for when the message is shown: ``hasattr`` shows none. To an
    AttributeError with a name and no object, Python adds no suggestion of its own.
    """

    __slots__ = ("name", "owner")

    def __init__(self, owner: str | type, name: str) -> None:
        self.owner, self.name = owner, name

    def __str__(self) -> str:
        from voxgran._base.remedies import remedy_in_module, remedy_of_object

        if isinstance(self.owner, str):
            return f"module {self.owner!r} has no attribute {self.name!r}: {remedy_in_module(self.owner, self.name)}"
        return f"{self.owner.__name__} has no attribute {self.name!r}: {remedy_of_object(self.owner, self.name)}"

    def __repr__(self) -> str:
        return repr(str(self))


def missing_names(module: str) -> Callable[[str], Any]:
    """Return ``__getattr__`` of a module (PEP 562), which raises the error for a name that it does not have.

    Raises
    ------
    AttributeError
        By the returned function.
    """

    def fail(name: str) -> Any:
        raise AttributeError(Missing(module, name), name=name)

    return fail


class ExplainedAttributes:
    """Objects whose error for an unknown attribute says what was most likely meant.

    A public function of voxgran of that name, such as `equilibrium`, is named where it takes them. A class may say in
    its class attribute `_instead`, a mapping of names to expressions, what else to write.
    """

    __slots__ = ()

    # hidden from type checkers, which would otherwise accept any name
    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Raise the error for an attribute that is missing.

            Raises
            ------
            AttributeError
                Always.
            """
            if hasattr(type(self), name):
                # an error within a property, which is raised again
                return object.__getattribute__(self, name)
            raise AttributeError(Missing(type(self), name), name=name)


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
            raise AttributeError(Missing(package, name), name=name)
        place, stored = places[name]
        # a module of a package, such as voxgran.shapes.sizes, is no attribute of it before it is imported
        found = None if place == package else getattr(import_module(place), stored, None)
        if found is None:
            return import_module(f"{place}.{stored}")
        if hasattr(found, "__dataclass_fields__"):
            from voxgran._base.config import document

            document(found)
        return found

    names = sorted(places)
    return find, lambda: names, names


def public(name: str) -> Any:
    """Return the public object of voxgran with this name.

    Only methods of Packing and Shape whose work is done in a room above their own, such as ``Packing.measure``, may use
    it: rooms import only from rooms below them.
    """
    return getattr(import_module("voxgran"), name)
