"""Containers from plain mappings, as in scene files and saved packings, and the registry of their kinds."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from voxgran._base.calls import explained
from voxgran._base.errors import InputError, MissingLibraryError, shown
from voxgran._base.names import check_known, nearest
from voxgran._base.registry import Registry
from voxgran.containers.model import Container

#: key of a mapping that names the package of a kind that is not part of voxgran
PACKAGE = "package"


@dataclass(frozen=True, slots=True, kw_only=True)
class ContainerKind:
    """One registered kind of containers.

    Attributes
    ----------
    name : str
        The `kind` of its containers, which is the name of the file or entry point.
    container : type
        Their class, which may be that of another kind.
    make : callable, optional
        ``make(values, where)`` returns the container of a mapping where its keys beside ``kind`` are not the arguments
        of the class; `where` names the mapping in messages. It checks which keys are required.
    taken : tuple of str
        Keys that `make` takes. Their meanings stand under "Parameters" in its docstring; the meanings of arguments
        stand in the docstring of the class.

    Examples
    --------
    >>> from voxgran.containers.make import container_registry
    >>> container_registry().get("cylinder").keys
    {'radius': True, 'height': True, 'origin': False}
    """

    name: str = ""
    container: type
    make: Callable[[Mapping[str, Any], str], Container] | None = None
    taken: tuple[str, ...] = ()

    @property
    def keys(self) -> dict[str, bool]:
        """Keys of a mapping beside ``kind``, and whether each is required: an argument without a default."""
        if self.make is not None:
            return dict.fromkeys(self.taken, False)
        return {one.name: one.default is one.empty for one in inspect.signature(self.container).parameters.values()}


def container_registry() -> Registry[ContainerKind]:
    """Return the registry of the kinds of containers."""
    return Registry("container", "voxgran.containers.kinds", ContainerKind, group="voxgran.containers")


def package_of(container: Container) -> str:
    """Return the package that registers the class of a container; ``""`` for those of voxgran.

    Raises
    ------
    InputError
        If it is not registered.
    """
    registry, kind = container_registry(), container.kind
    if kind not in registry.names() or registry.get(kind).container is not type(container):
        raise InputError(
            f"container is a {type(container).__name__}, a class that is not registered: load could not make it again; "
            f"register it by an entry point {kind!r} of the group {registry.group!r}, or give the packing a container "
            "of voxgran with dataclasses.replace, such as a ClosedMesh of the same walls"
        )
    return registry.package_of(kind)


def saved_mapping(container: Container) -> dict[str, Any]:
    """Return the mapping from which :func:`make_container` makes a container again, with its package if it has one.

    Raises
    ------
    InputError
        If the container is of a class that is not registered.
    """
    package = package_of(container)
    return container.to_mapping() | ({PACKAGE: package} if package else {})


@explained(hint='make_container({"kind": "box", "lengths": [4, 4, 6]})')
def make_container(mapping: Mapping[str, Any], where: str = "[container]") -> Container:
    """Return a container from kind and parameters.

    Parameters
    ----------
    mapping : mapping
        With the key ``kind``; a mesh has a ``file``, or ``vertices`` and ``faces``, a polygon ``corners`` and
        ``holes``, or the ``file`` of a picture with its ``pixel_size``.
    where : str
        Name of the mapping in messages.

    Returns
    -------
    Container

    Raises
    ------
    UnknownNameError
        If the kind or a key is unknown.
    InputError
        If `mapping` is not a mapping, a key is missing or a value is invalid.
    MissingLibraryError
        If the mapping was saved with a kind of another package, which is not installed.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.make_container({"kind": "box", "lengths": [4, 4, 6], "periodic": "xy"}).volume
    96.0
    """
    if not isinstance(mapping, Mapping):
        raise InputError(f"{where} is {shown(mapping)}: it must be a mapping with the key kind; give one")
    rest, registry = dict(mapping), container_registry()
    kind, package = rest.pop("kind", None), rest.pop(PACKAGE, None)
    names = registry.names()
    if kind is None:
        # another key may have been written in its place
        slip = next((key for key in rest if nearest(key, ("kind",))), None)
        meant = "" if slip is None else f", and {slip!r} may stand for it"
        raise InputError(f"{where} kind is missing{meant}: it must be one of {', '.join(names)}; add it")
    if package is not None and kind not in names:
        raise MissingLibraryError(
            f"{where} kind {kind!r} is of the package {package!r}, which is not installed: install it, such as with "
            f"'pip install {package}'"
        )
    check_known(f"{where} kind", kind, names)
    entry = registry.get(kind)
    for key in rest:
        check_known(f"{where} key", key, entry.keys)
    for key, required in entry.keys.items():
        if required and key not in rest:
            raise InputError(f"{where} {key} is missing: kind {kind!r} needs it; add it")
    container: Container = entry.container(**rest) if entry.make is None else entry.make(rest, where)
    return container
