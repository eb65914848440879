"""Sections of a scene, checked, and the file that has them."""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from voxgran._base.arrays import as_count, as_positive
from voxgran._base.config import from_mapping
from voxgran._base.errors import FileFormatError, InputError, shown
from voxgran._base.files import existing_file
from voxgran._base.guarded import reason_of
from voxgran._base.units import as_unit
from voxgran.containers.model import Container
from voxgran.decks.engine import engine_registry
from voxgran.decks.write import refuse_unheld
from voxgran.scene.keys import refuse_unknown
from voxgran.scene.sections import General, Output
from voxgran.settling.material import Material
from voxgran.settling.materials import Materials

T = TypeVar("T")


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
    try:
        return tomllib.loads(found.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        # a number of too many digits is a bare ValueError, values in too many brackets are a RecursionError
        mend = "mend that line; text is written in quotes, flags are true and false"
        raise FileFormatError(f"{found} is not TOML ({reason_of(error)}): {mend}") from error
