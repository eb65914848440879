"""Cells of a study: dimensions, made of axes that are crossed, zipped or listed, and the scene of each combination."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from voxgran._base.config import parameters_of
from voxgran._base.errors import InputError, VoxgranError, check_known, shortened, shown
from voxgran._base.units import NO_UNIT, as_unit
from voxgran.packing.method import method_registry
from voxgran.scene.description import SceneDescription
from voxgran.scene.keys import DENSITIES, names_of
from voxgran.shapes.sizes import KINDS
from voxgran.study.axes import AxisValue, Label, axis_values, changed, check_axis, refuse_equal
from voxgran.study.files import FileHashes, numbers_hash, scene_hash, with_absolute_files

#: dimension of cells that are listed
LISTED = "cell"
#: section [output] of cells: a study itself says what is kept
NOTHING = {"vtk": False, "statistics": False, "report": False}
#: keys of [packing] that are no parameters of a method
BESIDE = ("method", "count", *DENSITIES, "start", "settle")


@dataclass(frozen=True, slots=True)
class Dimension:
    """Axes that vary together: one alone, several that are zipped, or all of the cells that are listed.

    Attributes
    ----------
    name : str
        Name of the dimension.
    labels : dict of str to tuple
        What each place along it is called, by coordinate; empty where a listed cell leaves an axis out.
    choices : tuple of dict
        What each place along it changes: values by axis.
    """

    name: str
    labels: dict[str, tuple[Label, ...]]
    choices: tuple[dict[str, Any], ...]

    def __len__(self) -> int:
        """Return the number of places."""
        return len(self.choices)


@dataclass(frozen=True)
class Cell:
    """One combination of the values of all axes: a scene, packed once for each seed.

    Attributes
    ----------
    place : tuple of int
        Its place along each dimension.
    values : dict of str to str or number
        What its values are called, by coordinate.
    scene : SceneDescription
        The scene; its seed is the first one.
    mapping : dict
        The scene as nested values, with absolute paths.
    hashes : FileHashes
        Hashes of the files that the scene names.
    """

    place: tuple[int, ...]
    values: dict[str, Label]
    scene: SceneDescription
    mapping: dict[str, Any]
    hashes: FileHashes

    @cached_property
    def key(self) -> str:
        """Hash of the scene without its seed."""
        return scene_hash(self.scene, self.hashes)

    @property
    def name(self) -> str:
        """Its values in words, such as ``method rsa, packing.count 30``."""
        return ", ".join(f"{name} {value}" for name, value in self.values.items()) or "the base"


def dimensions_of(
    axes: Mapping[str, Any],
    *,
    combine: str,
    zipped: Sequence[Sequence[str]],
    listed: Sequence[Mapping[str, Any]],
    base_method: str | None,
) -> tuple[Dimension, ...]:
    """Return the dimensions of a study, in the order in which the axes are given; listed cells come last.

    Parameters
    ----------
    axes : mapping
        Lists of values by axis; tables of lists are axes with the path that leads through them.
    combine : {"cross", "zip"}
        Whether axes that are not zipped by name are crossed or zipped.
    zipped : sequence of sequence of str
        Groups of axes that vary together.
    listed : sequence of mapping
        Cells that are listed: values by axis.
    base_method : str or None
        Method of the base, whose parameters are suggested for unknown axes.

    Raises
    ------
    UnknownNameError
        If there is no such axis, or a group names an axis that is not given.
    InputError
        If values break a rule, or axes that are zipped have not the same number of values.
    """
    beside = _parameter_paths(base_method)
    values = {axis: axis_values(axis, given, beside=beside) for axis, given in _flat(axes)}
    groups = _groups(tuple(values), combine, zipped)
    found = [_zipped({axis: values[axis] for axis in group}) for group in groups]
    if listed:
        found.append(_listed(listed, beside))
    names = [name for dimension in found for name in dimension.labels]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"axis {name} is in [axes] and in [[cell]]: each cell has one value of it; drop one")
    return tuple(found)


def _parameter_paths(method: str | None) -> tuple[str, ...]:
    """Return the paths of the parameters of size laws and of a method, and of what all methods take."""
    own = method_registry().get(method).parameters if method in method_registry().names() else None
    found = [("sizes", item) for law in KINDS.values() for item in names_of(law)]
    found += [("packing", item) for item in ("count", *DENSITIES, *(names_of(own) if own else ()))]
    return tuple(f"{section}.{item}" for section, item in found)


def _flat(axes: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield axes by their paths: TOML makes a table of ``packing.friction`` that is not quoted."""
    for key, value in axes.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _groups(axes: tuple[str, ...], combine: str, zipped: Sequence[Sequence[str]]) -> list[tuple[str, ...]]:
    """Return the groups of axes that vary together, in the order of the first axis of each."""
    if combine not in ("cross", "zip"):
        raise InputError(f"combine is {shown(combine)}: it must be 'cross' or 'zip'; change it")
    if combine == "zip":
        return [axes] if axes else []
    of_axis: dict[str, tuple[str, ...]] = {axis: (axis,) for axis in axes}
    for group in zipped:
        if isinstance(group, str) or not hasattr(group, "__len__") or len(group) < 2:
            raise InputError(
                f'zip has the entry {shown(group)}: it must be a list of axes, such as zip = [["method", "shape"]]'
            )
        for axis in group:
            check_known("zip: axis", axis, axes)
            if len(of_axis[axis]) > 1:
                raise InputError(f"zip names axis {axis} twice: an axis is in one group; drop one of them")
            of_axis[axis] = tuple(group)
    return list(dict.fromkeys(of_axis.values()))


def _zipped(values: Mapping[str, tuple[AxisValue, ...]]) -> Dimension:
    """Return the dimension of axes that vary together; it has the name of the first of them."""
    counts = {axis: len(entries) for axis, entries in values.items()}
    if len(set(counts.values())) > 1:
        told = ", ".join(f"{axis} {count}" for axis, count in counts.items())
        raise InputError(f"zip: the axes have {told} values: those that are zipped have as many; add or drop some")
    name = next(iter(values))
    labels = {axis: tuple(entry.label for entry in entries) for axis, entries in values.items()}
    refuse_equal(" and ".join(values), list(zip(*labels.values(), strict=True)) if len(labels) > 1 else labels[name])
    rows = zip(*values.values(), strict=True)
    return Dimension(name, labels, tuple({a: e.given for a, e in zip(values, row, strict=True)} for row in rows))


def _listed(listed: Sequence[Mapping[str, Any]], beside: Sequence[str]) -> Dimension:
    """Return the dimension of cells that are listed."""
    choices: list[dict[str, AxisValue]] = [{} for _ in listed]
    for table in listed:
        if not isinstance(table, Mapping):
            raise InputError(f"[[cell]] is {shown(table)}: it must be a table of values by axis; change it")
    axes = list(dict.fromkeys(axis for table in listed for axis in table if axis != "label"))
    for axis in axes:
        check_axis(axis, beside)
        # together, so that different values are called differently
        having = [number for number, table in enumerate(listed) if axis in table]
        found = axis_values(axis, [listed[number][axis] for number in having])
        refuse_equal(axis, [value.label for at, value in enumerate(found) if value not in found[:at]])
        for number, value in zip(having, found, strict=True):
            choices[number][axis] = value
    names = []
    for number, (table, entries) in enumerate(zip(listed, choices, strict=True)):
        told = ", ".join(f"{axis} {entry.label}" for axis, entry in entries.items())
        names.append(str(table.get("label", told or f"{number}")))
    refuse_equal(LISTED, names)
    labels: dict[str, tuple[Label, ...]] = {LISTED: tuple(names)}
    for axis in axes:
        told_as = [entries[axis].label if axis in entries else "" for entries in choices]
        numbers = all(isinstance(label, int | float) for label in told_as)
        labels[axis] = tuple(told_as if numbers else map(str, told_as))
    return Dimension(LISTED, labels, tuple({a: e.given for a, e in entries.items()} for entries in choices))


def cells_of(
    base: Mapping[str, Any], dimensions: Sequence[Dimension], *, folder: str, seed: int, keep: str
) -> tuple[Cell, ...]:
    """Return all cells of a study, each with its checked scene.

    Parameters
    ----------
    base : mapping
        Scene with absolute paths, without seeds and output.
    dimensions : sequence of Dimension
        What is varied.
    folder : str
        Where the files that axes name are looked for.
    seed : int
        The first seed.
    keep : {"numbers", "packings"}
        What is kept of each run.

    Raises
    ------
    InputError
        If a method of a cell has not a parameter that it is given, the scene of a cell breaks a rule, or two values of
        an axis give the same numbers in all cells; the message names the cell or the values. Errors of other classes
        are those of :meth:`voxgran.Scene.from_mapping`.
    """
    hashes = FileHashes()
    made = []
    for place in itertools.product(*(range(len(dimension)) for dimension in dimensions)):
        chosen = list(zip(dimensions, place, strict=True))
        values = {
            name: labels[at]
            for dimension, at in chosen
            for name, labels in dimension.labels.items()
            if labels[at] != ""
        }
        choices = {axis: given for dimension, at in chosen for axis, given in dimension.choices[at].items()}
        mapping = with_absolute_files(changed(base, choices), folder)
        mapping["scene"] = {**mapping.get("scene", {}), "seed": seed}
        mapping["output"] = NOTHING
        made.append((place, values, mapping))
    refuse_foreign([mapping for _, _, mapping in made])
    cells = tuple(Cell(place, values, _scene(mapping, values), mapping, hashes) for place, values, mapping in made)
    _refuse_units(cells)
    refuse_idle(cells, dimensions, numbers=keep == "numbers")
    return cells


def _scene(mapping: Mapping[str, Any], values: Mapping[str, Label]) -> SceneDescription:
    """Return the checked scene of a cell; errors name the cell.

    Raises
    ------
    VoxgranError
        Of the class that :meth:`SceneDescription.from_mapping` raises.
    """
    try:
        return SceneDescription.from_mapping(mapping)
    except VoxgranError as error:
        if not values:
            raise
        told = shortened(", ".join(f"{name} {value}" for name, value in values.items()))
        raise type(error)(f"cell {told}: {error}") from error


def _refuse_units(cells: Sequence[Cell]) -> None:
    """Refuse cells whose lengths would be in different units: those of their shapes, where the scene has none.

    Raises
    ------
    InputError
        If there are such cells.
    """
    scenes = [cell.scene for cell in cells if cell.scene.general.unit == NO_UNIT]
    given = {entry.parameters.get("unit") for scene in scenes for entry in scene.shapes if entry.source == "file"}
    units = sorted({as_unit(unit) for unit in given} - {NO_UNIT})
    if len(units) > 1:
        raise InputError(
            f"[[shape]] unit is {' and '.join(units)} and [scene] unit is not given: the numbers of all cells must be "
            "in one unit; give [scene] unit"
        )


def refuse_idle(cells: Sequence[Cell], dimensions: Sequence[Dimension], *, numbers: bool) -> None:
    """Refuse values of an axis that give the same results in all cells; `numbers` is whether these are numbers alone.

    Raises
    ------
    InputError
        If two values do: they would be the same numbers under two names.
    """
    keys = {cell.place: numbers_hash(cell.scene, cell.hashes) if numbers else cell.key for cell in cells}
    for at, dimension in enumerate(dimensions):
        found: dict[tuple[str, ...], int] = {}
        # cells that are listed may be the same scene under two names
        for place in range(len(dimension) if dimension.name != LISTED else 0):
            other = found.setdefault(tuple(key for where, key in keys.items() if where[at] == place), place)
            if other != place:
                one, two = (
                    ", ".join(f"{name} {labels[number]}" for name, labels in dimension.labels.items())
                    for number in (other, place)
                )
                raise InputError(
                    f"{one} and {two} give the same numbers in all cells: what differs changes no result; drop one"
                )


def refuse_foreign(mappings: Sequence[Mapping[str, Any]]) -> None:
    """Refuse parameters that some methods of a study have and others have not.

    Raises
    ------
    InputError
        If a method is given a parameter of another method; the message is one for all cells.
    """
    known: dict[str, set[str]] = {}
    for mapping in mappings:
        method = mapping.get("packing", {}).get("method")
        if isinstance(method, str) and method not in known and method in method_registry().names():
            entry = method_registry().get(method).parameters
            known[method] = {item.name for item in parameters_of(entry)} | set(BESIDE)
    foreign: dict[tuple[str, str], int] = {}
    for mapping in mappings:
        packing = mapping.get("packing", {})
        method = packing.get("method")
        for key in packing:
            # what no method of the study knows is a misspelt name, which the scene says
            if method in known and key not in known[method] and any(key in names for names in known.values()):
                foreign[key, method] = foreign.get((key, method), 0) + 1
    if not foreign:
        return
    told = ", ".join(
        f"{key} of {method!r} ({count} of {len(mappings)} cells)" for (key, method), count in foreign.items()
    )
    key = next(iter(foreign))[0]
    owner = next(method for method, names in known.items() if key in names)
    example = next(m["packing"][key] for m in mappings if key in m.get("packing", {}))
    raise InputError(
        f"[packing] has keys that are no parameters of all methods: {told}; give such a key with its method, as in "
        f"method = [{{ method = {owner!r}, {key} = {shown(example)} }}, ...], or list the cells with [[cell]]"
    )
