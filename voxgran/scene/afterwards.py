"""What becomes of grains after they are packed: the sections [settle], [compress] and [measure] of a scene."""

from collections.abc import Mapping
from typing import Any, Literal

from voxgran._base.arrays import check_type
from voxgran._base.config import from_mapping, parameters_of, to_mapping
from voxgran._base.errors import InputError, check_known, shown
from voxgran.containers.gravity import proposed_axis
from voxgran.containers.model import Container
from voxgran.packing.compress import compress
from voxgran.packing.method import method_registry
from voxgran.packing.model import Packing
from voxgran.scene.keys import Measured, Settled, names_of, refuse_unknown
from voxgran.settling.parameters import Compression, Settling


def settle_section(
    mapping: Mapping[str, Any] | None, method: str, parameters: type, container: Container, friction: Mapping[str, Any]
) -> Settling | Literal[False] | None:
    """Return what the section [settle] says: parameters, False where it is disabled, None where it is left out.

    friction: that of named materials, by its name, which holds where the section says nothing of it.

    Raises
    ------
    InputError
        If a value breaks a rule, or the method packs without gravity or settles its grains itself.
    UnknownNameError
        If a key is unknown.
    """
    if mapping is None:
        # a method that builds beds lets them settle unasked
        builds = friction and not issubclass(parameters, Settling) and method_registry().get(method).builds_bed
        return Settling(**friction) if builds else None
    given = dict(mapping)
    enabled = given.pop("enabled", True)
    if not isinstance(enabled, bool):
        raise InputError(f"[settle] enabled is {shown(enabled)}: it must be true or false; change it")
    if issubclass(parameters, Settling):
        raise InputError(
            f"[settle] and method {method!r}: its grains settle as they are packed; write these keys in [packing]"
        )
    if enabled and not any(item.name == "gravity" for item in parameters_of(parameters)):
        raise InputError(
            f"[settle] and method {method!r}: it packs without gravity; leave this section out, and settle the packing "
            f"with 'voxgran settle out/packing.vtp --gravity {proposed_axis(container)} -o settled.vtp'"
        )
    refuse_unknown(given, "[settle]", Settling, beside=names_of(Settled))
    settling = from_mapping(Settling, {**friction, **given}, "[settle]")
    return settling if enabled else False


def compress_section(
    mapping: Mapping[str, Any] | None, method: str, parameters: type, container: Container, friction: Mapping[str, Any]
) -> Compression | None:
    """Return what the section [compress] says; None where it is left out.

    Raises
    ------
    InputError
        If a value breaks a rule, the walls of the container do not move as it says, or the method compresses its grains
        itself.
    UnknownNameError
        If a key is unknown.
    """
    if mapping is None:
        return None
    if issubclass(parameters, Compression):
        raise InputError(
            f"[compress] and method {method!r}: its grains are compressed as they are packed; write these keys in "
            "[packing]"
        )
    refuse_unknown(mapping, "[compress]", Compression)
    how = from_mapping(Compression, {**friction, **mapping}, "[compress]")
    how.modes_of(container)
    return how


def compressed(how: Compression | None, packing: Packing, **run: Any) -> Packing:
    """Return a packing as it is after the section [compress], with options of the run of :func:`voxgran.compress`."""
    return packing if how is None else compress(packing, **to_mapping(how), **run)


def measure_section(mapping: Mapping[str, Any]) -> tuple[str, ...] | None:
    """Return the names of the measures that are asked for; "all" may be among them.

    Raises
    ------
    InputError
        If they are no list.
    UnknownNameError
        If a key or a measure is unknown.
    """
    from voxgran.measures.model import ALL, measure_registry

    refuse_unknown(mapping, "[measure]", Measured)
    if "which" not in mapping:
        return None
    check_type(mapping["which"], (list, tuple), "[measure] which", "a list of names, such as ['density']")
    names = tuple(str(name) for name in mapping["which"])
    known = (ALL, *measure_registry().names())
    for name in names:
        check_known("[measure] which", name, known)
    return names
