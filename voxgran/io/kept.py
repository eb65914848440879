"""What files of grains keep as plain values: types of the entries, and containers and sizes that name no other file."""

from collections.abc import Mapping
from types import NoneType
from typing import Any

from voxgran._base.errors import InputError, shown
from voxgran.containers.model import Container, make_container
from voxgran.shapes.sizes import SizeDistribution, make_sizes

#: types of the entries of a shape, by :func:`voxgran._base.scalars.check_types`
SHAPE: dict[str, Any] = {
    **dict.fromkeys(("name", "key", "geometry", "kind"), str),
    **{name: [float] for name in ("offset", "step", "first", "dimensions", "rotation", "center")},
    # rows of the joined arrays
    **{name: [int] for name in ("points", "faces", "radii", "steps", "corners")},
    "unit": (str, NoneType),
    "radius": float,
    "record": dict,
    "mass": dict,
}
#: the same of what programs look for in a provenance, of which all else is only shown
PROVENANCE: dict[str, Any] = {
    **dict.fromkeys(("assumed", "compression", "settling", "tiled"), dict),
    "asked": (dict, NoneType),
}


def kept_container(told: Any) -> Container:
    """Return the container that a file keeps.

    Raises
    ------
    InputError
        If it names another file, or as :func:`voxgran.make_container`.
    """
    _refuse_files(told, "container")
    return make_container(told)


def kept_sizes(told: Any) -> SizeDistribution:
    """Return the distribution of sizes that a file keeps.

    Raises
    ------
    InputError
        If it names another file, or as :func:`voxgran.sizes.make_sizes`.
    """
    _refuse_files(told, "asked_sizes")
    return make_sizes(told)


def _refuse_files(told: Any, name: str) -> None:
    """Refuse the key `file` in any of the values in each other, which a stranger may have written there."""
    if isinstance(told, Mapping) and "file" in told:
        raise InputError(
            f"{name} has the key file, {shown(told['file'])}: a file of grains names no other file; write its values "
            "into it"
        )
    for one in told.values() if isinstance(told, Mapping) else told if isinstance(told, list) else ():
        _refuse_files(one, name)
