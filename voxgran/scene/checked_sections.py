"""Sections of a scene, checked, and the file that has them.

The sections [settle], [compress] and [measure] of a scene say what becomes of grains after they are packed.
"""

import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from voxgran._base.arrays import as_count, as_positive, check_type
from voxgran._base.config import from_mapping, parameters_of, to_mapping
from voxgran._base.errors import FileFormatError, InputError, check_known, shown
from voxgran._base.files import existing_file
from voxgran._base.guarded import reason_of
from voxgran._base.scalars import plain_values
from voxgran._base.units import as_unit
from voxgran.containers.gravity import proposed_axis
from voxgran.containers.model import Container, make_container
from voxgran.decks.engine import engine_registry
from voxgran.decks.write import refuse_unheld
from voxgran.packing.compress import compress
from voxgran.packing.method import method_registry
from voxgran.packing.model import Packing
from voxgran.scene.keys import Measured, Mistakes, Settled, names_of, refuse_unknown
from voxgran.scene.sections import General, Output
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials
from voxgran.settling.parameters import Compression, Settling
from voxgran.shapes.sizes import SizeDistribution, make_sizes

T = TypeVar("T")

#: bytes of a scene: twenty thousand rows of a list of grains, which are read within some seconds
LONGEST_SCENE = 2**22
#: parts of a name, of which scenes have two or three: the time to read one grows with their square or cube
DEEPEST = 32
#: texts of TOML to their ends, or as far as they go, and comments: no dot within parts a name
QUOTED = re.compile(
    r"""\"\"\"(?:[^"\\]|\\.|"(?!""))*+(?:\"\"\")?|\'\'\'(?:[^']|'(?!''))*+(?:\'\'\')?"""
    r"""|"(?:[^"\\\n]|\\[^\n])*+"?|'[^'\n]*+'?|\#[^\n]*+""",
    re.DOTALL,
)
#: names of more parts
DEEP = re.compile(rf"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){{{DEEPEST}}}[\w-]")


def section_of(cls: type[T], mapping: Mapping[str, Any], place: str) -> T:
    """Return a section that holds the parameters of a class and nothing else."""
    refuse_unknown(mapping, place, cls)
    return from_mapping(cls, mapping, place)


def general_section(mapping: Mapping[str, Any]) -> General:
    """Return the checked section [scene]."""
    made = section_of(General, mapping, "[scene]")
    as_count(made.seed, "[scene] seed", at_most=None)
    as_count(made.seeds, "[scene] seeds", at_least=1)
    as_positive(made.density, "[scene] density")
    return replace(made, unit=as_unit(made.unit, "[scene] unit"))


def share_by_of(value: Any) -> str:
    """Return the checked share_by.

    Raises
    ------
    InputError
        If it is neither ``"number"`` nor ``"volume"``.
    """
    if value not in ("number", "volume"):
        raise InputError(f"[sizes] share_by is {shown(value)}: it must be 'number' or 'volume'; change it")
    return str(value)


def with_file(mapping: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return a section with its file relative to the scene file."""
    made = dict(mapping)
    if "file" in made:
        made["file"] = str(folder / str(made["file"]))
    return made


def located(value: Any, folder: Path) -> Any:
    """Return a scene, or a value in it, with whole paths of the files that it names, so that it holds in any folder."""
    if isinstance(value, Mapping):
        return {name: located(inner, folder) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [located(inner, folder) for inner in value]
    named = isinstance(value, str) and Path(value).suffix and (folder / value).is_file()
    return str((folder / value).resolve()) if named else value


def refuse_engines(output: Output, material: Material | Materials, container: Container) -> None:
    """Refuse a material or a container that an engine does not have for which input is to be written.

    Raises
    ------
    InputError
        If there is one.
    """
    for engine in output.dem:
        refuse_unheld(engine_registry().get(engine), material, container)


def parsed_toml(text: str) -> dict[str, Any]:
    """Return what a text of TOML holds, as nested mappings.

    Raises
    ------
    ValueError
        If it is not TOML, names have more than `DEEPEST` parts, or a whole number is beyond 2**128.
    RecursionError
        If it has values in too many brackets.
    """
    bare = QUOTED.sub(lambda found: "s" + "\n" * found[0].count("\n"), text)
    if deep := DEEP.search(bare):
        line = bare.count("\n", 0, deep.start()) + 1
        raise ValueError(f"a name has more than {DEEPEST} parts at line {line}")
    return dict(plain_values(tomllib.loads(text)))


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what a TOML file holds, as nested mappings.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is not TOML.
    """
    found = existing_file(path)
    if found.suffix.lower() == ".vtp":
        raise FileFormatError(f"{found} is a packing and no scene: give the .toml file, or 'voxgran measure' it")
    if found.stat().st_size > LONGEST_SCENE:
        raise FileFormatError(
            f"{found} has {found.stat().st_size} bytes: scenes have at most {LONGEST_SCENE}; write long lists to files"
        )
    try:
        return parsed_toml(found.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        # a number of too many digits is a bare ValueError, values in too many brackets are a RecursionError
        mend = "mend that line; text is written in quotes, flags are true and false"
        raise FileFormatError(f"{found} is not TOML ({reason_of(error)}): {mend}") from error


def sizes_section(mapping: Mapping[str, Any], place: Path) -> tuple[SizeDistribution | None, str]:
    """Return the distribution of [sizes], whose file is in the unit of [scene] unless it says another, and what shares
    are of.

    Raises
    ------
    InputError
        If a value breaks a rule.
    """
    sizes = dict(mapping.get("sizes", {}))
    share_by = share_by_of(sizes.pop("share_by", "number"))
    if "file" in sizes and (unit := dict(mapping.get("scene", {})).get("unit")) is not None:
        sizes.setdefault("unit", unit)
    return make_sizes(with_file(sizes, place)) if sizes else None, share_by


def container_section(section: Any, place: Path) -> tuple[Container, Any]:
    """Return the container, and its key `material`.

    Raises
    ------
    InputError
        If a value breaks a rule.
    """
    held = with_file(section, place)
    walls = held.pop("material", None)
    return make_container(held), walls


def sections_of_packed(
    mapping: Mapping[str, Any], mistakes: Mistakes, how: tuple[str, type | None, Container | None, Mapping[str, Any]]
) -> tuple[Settling | Literal[False] | None, Compression | None]:
    """Return what [settle] and [compress] say, by method, its parameter class, container and friction; None of the one
    whose mistake is kept.
    """
    settled: Settling | Literal[False] | None = None
    compressed = None
    with mistakes.part("[settle]"):
        settled = settle_section(mapping.get("settle"), *how)
    with mistakes.part("[compress]"):
        compressed = compress_section(mapping.get("compress"), *how)
    return settled, compressed


def settle_section(
    mapping: Mapping[str, Any] | None,
    method: str,
    parameters: type | None,
    container: Container | None,
    friction: Mapping[str, Any],
) -> Settling | Literal[False] | None:
    """Return what the section [settle] says: parameters, False where it is disabled, None where it is left out.

    friction: that of named materials, by its name, which holds where the section says nothing of it. Where the method's
    parameter class or the container cannot be read, they are None, and only the section itself is checked.

    Raises
    ------
    InputError
        If a value breaks a rule, or the method packs without gravity or settles its grains itself.
    UnknownNameError
        If a key is unknown.
    """
    if mapping is None:
        # a method that builds beds lets them settle unasked
        settles = parameters is None or issubclass(parameters, Settling)
        builds = friction and not settles and method_registry().get(method).builds_bed
        return Settling(**friction) if builds else None
    given = dict(mapping)
    enabled = given.pop("enabled", True)
    if not isinstance(enabled, bool):
        raise InputError(f"[settle] enabled is {shown(enabled)}: it must be true or false; change it")
    if parameters is not None and issubclass(parameters, Settling):
        raise InputError(
            f"[settle] and method {method!r}: its grains settle as they are packed; write these keys in [packing]"
        )
    if enabled and parameters and not any(item.name == "gravity" for item in parameters_of(parameters)):
        axis = "-z" if container is None else proposed_axis(container)
        raise InputError(
            f"[settle] and method {method!r}: it packs without gravity; leave this section out, and settle the packing "
            f"with 'voxgran settle out/packing.vtp --gravity {axis} -o settled.vtp'"
        )
    refuse_unknown(given, "[settle]", Settling, beside=names_of(Settled))
    settling = from_mapping(Settling, {**friction, **given}, "[settle]")
    return settling if enabled else False


def compress_section(
    mapping: Mapping[str, Any] | None,
    method: str,
    parameters: type | None,
    container: Container | None,
    friction: Mapping[str, Any],
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
    if parameters is not None and issubclass(parameters, Compression):
        raise InputError(
            f"[compress] and method {method!r}: its grains are compressed as they are packed; write these keys in "
            "[packing]"
        )
    refuse_unknown(mapping, "[compress]", Compression)
    how = from_mapping(Compression, {**friction, **mapping}, "[compress]")
    how.refuse_known_friction()
    if container is not None:
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
