"""What a study file or a call says: the base scene, axes, seeds, and how they are combined; checked, not computed."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from voxgran._base.arrays import as_count, check_type
from voxgran._base.errors import InputError, UnknownNameError, check_known, shown, unknown
from voxgran._base.files import existing_file
from voxgran.scene.checked_sections import read_toml
from voxgran.scene.description import SECTIONS, SceneDescription
from voxgran.study.axes import LISTS, plain
from voxgran.study.cell_values import text_of
from voxgran.study.cells import Cell, Dimension, cells_of, dimensions_of
from voxgran.study.experiments import bands_of, check_labels
from voxgran.study.files import with_absolute_files

KEYS = ("scene", "base", "seeds", "axes", "combine", "zip", "cell", "keep", "experiments")
#: most seeds of a study
MOST_SEEDS = 1_000_000
#: what is kept of each run
KEEP = ("numbers", "packings")


@dataclass(frozen=True, slots=True, kw_only=True)
class StudySettings:
    """A study, checked.

    Attributes
    ----------
    base : dict
        The scene that is varied, as nested values with absolute paths, without seeds and output.
    seeds : tuple of int
        Seeds of each cell.
    dimensions : tuple of Dimension
        What is varied.
    keep : {"numbers", "packings"}
        What is kept of each run.
    cells : tuple of Cell
        All cells, the last dimension varying fastest.
    experiments : dict
        Ranges of measured values by label, for the figures.
    """

    base: dict[str, Any]
    seeds: tuple[int, ...]
    dimensions: tuple[Dimension, ...]
    keep: str
    cells: tuple[Cell, ...]
    experiments: dict[str, Any] = field(default_factory=dict)


def settings_of_file(path: str | os.PathLike[str]) -> StudySettings:
    """Return the study of a TOML file; files that it names are relative to it.

    Raises
    ------
    UnknownNameError
        If a key or an axis is unknown; the message gives the nearest name.
    InputError
        If it has both a scene and a base, or neither, or a value breaks a rule.
    """
    found = existing_file(path)
    given = read_toml(found)
    for key, value in given.items():
        if key not in KEYS:
            raise UnknownNameError(unknown("key of a study", key, KEYS) + _hint(key, value))
    if ("scene" in given) == ("base" in given):
        told = "both scene and base" if "scene" in given else "neither scene nor base"
        raise InputError(
            f'{found} has {told}: a study varies one scene; write scene = "scene.toml", or sections [base.*]'
        )
    base: Any = given.pop("base", None)
    if "scene" in given:
        name = given.pop("scene")
        if not isinstance(name, str):
            raise InputError(f'{found}: scene is {shown(name)}: it must be the path of a file, such as "scene.toml"')
        base = found.parent / name
    listed = given.pop("cell", None)
    return make_settings(base, folder=found.parent, cells=listed, **given)


def _hint(key: str, value: Any) -> str:
    """Return what to write in place of an unknown key at the top of a study file; empty where nothing is known."""
    if key == "study":
        return "; the keys of a study are at the top of its file, above all sections: remove the line [study]"
    if key == "seed":
        return f"; seeds is how many, or a list of them: write seeds = [{value}] for this one"
    if isinstance(value, list) and not all(isinstance(item, Mapping) for item in value):
        return f"; if it is an axis, write it below [axes]: {key} = {shown(value)}"
    if key in SECTIONS:
        name = f"[[base.{key}]]" if isinstance(value, list) else f"[base.{key}]"
        return f'; it is a section of the scene that the study varies: write {name}, or scene = "scene.toml"'
    return ""


def make_settings(
    base: Any,
    *,
    folder: str | os.PathLike[str] = ".",
    axes: Mapping[str, Any] | None = None,
    seeds: int | Sequence[int] | None = None,
    combine: str = "cross",
    zip: Sequence[Sequence[str]] | None = None,  # noqa: A002 - the word of the file and of the call
    cells: Sequence[Mapping[str, Any]] | None = None,
    keep: str = "numbers",
    experiments: Mapping[str, Any] | None = None,
) -> StudySettings:
    """Return a checked study; arguments are those of :class:`voxgran.Study`.

    Raises
    ------
    UnknownNameError
        If an axis is unknown, or a shape of the experiments; the message gives the nearest name.
    InputError
        If a value breaks a rule, or the scene of a cell does.
    """
    scene = _base(base, Path(folder))
    general = dict(scene.get("scene", {}))
    first, count = general.pop("seed", 0), general.pop("seeds", 1)
    scene["scene"] = general
    check_type(axes, (Mapping, type(None)), "axes", "a table of lists of values by axis")
    for name, value in (("zip", zip), ("cell", cells)):
        if isinstance(value, str | Mapping) or not isinstance(value, Sequence | None):
            raise InputError(f"{name} is {shown(value)}: it must be a list; write [[cell]], or zip = [[...]]")
    if keep not in KEEP:
        raise InputError(f"keep is {shown(keep)}: it must be 'numbers' or 'packings'; change it")
    packing = scene.get("packing")
    dimensions = dimensions_of(
        axes or {},
        combine=combine,
        zipped=zip or (),
        listed=cells or (),
        base_method=packing.get("method") if isinstance(packing, Mapping) else None,
    )
    _check_experiments(experiments, dimensions)
    known = _seeds(seeds, first, count)
    made = cells_of(scene, dimensions, folder=str(folder), seed=known[0], keep=keep)
    return StudySettings(
        base=scene, seeds=known, dimensions=dimensions, keep=keep, cells=made, experiments=dict(experiments or {})
    )


def _check_experiments(experiments: Any, dimensions: Sequence[Dimension]) -> None:
    """Check ranges of measured values before anything is computed: their labels are shapes where these vary.

    Raises
    ------
    UnknownNameError
        If one is of a shape that the study has not.
    """
    bands = bands_of(experiments)
    shapes = [text_of(label) for dimension in dimensions for label in dimension.labels.get("shape", ())]
    if len(set(shapes)) > 1:
        check_labels(bands, shapes)


def _base(base: Any, folder: Path) -> dict[str, Any]:
    """Return the base scene as nested values with absolute paths.

    Raises
    ------
    InputError
        If it is no scene, mapping or path.
    """
    if isinstance(base, SceneDescription):
        mapping, place = base.to_mapping(), Path()
    elif isinstance(base, Mapping):
        mapping, place = plain(base), folder
    elif isinstance(base, str | os.PathLike):
        found = existing_file(base)
        mapping, place = read_toml(found), found.parent
    else:
        raise InputError(
            f"base is {shown(base)}: it must be a scene, a mapping of its sections or the path of its file"
        )
    for name in mapping:
        check_known("section of the base", name, SECTIONS)
        if name != "shape" and not (name in LISTS and isinstance(mapping[name], list)):
            check_type(
                mapping[name], Mapping, f"[{name}] of the base", f"a section; write [base.{name}] above its keys"
            )
    # a study itself says what is written
    kept = {name: value for name, value in mapping.items() if name != "output"}
    return with_absolute_files(kept, place)


def _seeds(given: Any, first: Any, count: Any) -> tuple[int, ...]:
    """Return the seeds: so many from that of the base on, or as listed.

    Raises
    ------
    InputError
        If they are no whole numbers of at least 0, there are none, or one is given twice.
    """
    first = as_count(first, "[scene] seed", at_most=None)
    if given is None:
        given = as_count(count, "[scene] seeds", at_least=1)
    values = plain(given)
    if not isinstance(values, list):
        values = list(range(first, first + as_count(values, "seeds", at_least=1, at_most=MOST_SEEDS)))
    seeds = tuple(as_count(seed, "seeds", at_most=None) for seed in values)
    if not seeds or len(set(seeds)) < len(seeds):
        raise InputError(f"seeds is {shown(list(seeds))}: it must have at least one seed, and each once; change it")
    return seeds
