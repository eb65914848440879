"""Axes of a study: what the values of an axis change in a scene, and what they are called.

An axis is a path into the scene, such as ``packing.friction``, a section of it, such as ``settle``, or one of the names
`method`, `shape`, `sizes` and `container`, whose values are names or whole tables. The axis ``friction`` is that
with which grains settle: of the method where it settles them itself, otherwise of ``settle``.
"""

import copy
import dataclasses
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from voxgran._base.config import parameters_of, to_mapping
from voxgran._base.errors import InputError, UnknownNameError, nearest, shown, unknown
from voxgran._base.scalars import nested, unwrapped
from voxgran.packing.method import method_registry
from voxgran.scene.description import SECTIONS

#: axes whose values are names or whole tables, and the key that a name stands for
NAMED = {"method": "method", "shape": "family", "sizes": "kind", "container": "kind"}
#: axis of the friction with which grains settle, whichever section has it
FRICTION = "friction"
#: sections that no axis changes: what is measured and written is the same for all cells
FIXED = ("measure", "output")
#: sections that may stand several times
LISTS = ("shape", "obstacle", "layer", "material")
#: axes that change no result, and why
IDLE = {
    "material": "it is the contact law in the input of engines, and changes no result of a study; the friction of "
    'grains that settle is "settle.friction", or "packing.friction" of method gravity, of several materials '
    '"material.0.friction", and their density is "shape.density"',
    "scene.unit": "all cells have one unit of length; set it in the base, and vary sizes",
}
#: what a value is called: text, or a number where all values of an axis are numbers
Label: TypeAlias = str | int | float


@dataclass(frozen=True, slots=True)
class AxisValue:
    """One value of an axis: what it is called, and what the scene gets."""

    label: Label
    given: Any


def axis_values(axis: str, values: Any, *, beside: Iterable[str] = ()) -> tuple[AxisValue, ...]:
    """Return the checked values of an axis.

    Parameters
    ----------
    axis : str
        Name of the axis.
    values : sequence
        Its values; tables may have a `label`.
    beside : iterable of str
        Further axes to suggest for an unknown name.

    Raises
    ------
    UnknownNameError
        If there is no such axis; the message gives the nearest name.
    InputError
        If the values are no list, empty, of a wrong type, or two of them are called the same.
    """
    check_axis(axis, beside)
    if not (isinstance(values, Sequence) or hasattr(values, "tolist")) or isinstance(values, str | bytes):
        raise InputError(f"axis {axis} is {shown(values)}: it must be a list of values; write [{shown(values)}]")
    given = [_given(axis, plain(value)) for value in values]
    if not given:
        raise InputError(f"axis {axis} is empty: it needs at least one value; add one or leave the axis out")
    return tuple(AxisValue(label, value) for label, (_, value) in zip(_labels(axis, given), given, strict=True))


def check_axis(axis: str, beside: Iterable[str] = ()) -> None:
    """Check the name of an axis.

    Raises
    ------
    UnknownNameError
        If a scene has nothing of that name; the message gives the nearest one.
    InputError
        If the study itself says that, such as the seeds, or it changes no result.
    """
    axis = str(axis)
    first, *rest = axis.split(".")
    if axis in ("seed", "seeds", "scene.seed", "scene.seeds"):
        raise InputError(f"axis {axis}: the seeds of a study are no axis; write seeds = 5 or seeds = [1, 2, 3]")
    if first in FIXED:
        raise InputError(f"axis {axis}: what is measured and written is the same for all cells; set it in the base")
    numbered = first == "material" and bool(rest) and rest[0].isdecimal()
    for idle, told in IDLE.items() if not numbered else ():
        if axis == idle or axis.startswith(f"{idle}."):
            raise InputError(f"axis {axis}: {told}")
    if axis == FRICTION or (first in (*NAMED, *SECTIONS) and all(rest) and not (first == "method" and rest)):
        return
    known = (*NAMED, FRICTION, *(f"{name}.KEY" for name in SECTIONS if name not in (*NAMED, *FIXED, *IDLE)))
    paths = {path.rpartition(".")[2]: path for path in beside}
    meant = nearest(axis.rpartition(".")[2], (*known, *paths, "seeds"))
    if meant in paths or meant == "seeds":
        rule = "seeds are no axis; write seeds = 5" if meant == "seeds" else "an axis is a path into the scene"
        raise UnknownNameError(f"axis {shown(axis)} is unknown: did you mean {paths.get(meant, meant)!r}? {rule}")
    raise UnknownNameError(unknown("axis", axis, known, meant=meant))


def plain(value: Any) -> Any:
    """Return a value as TOML has it: NumPy numbers and arrays, tuples, and objects of voxgran become numbers, lists and
    tables.

    Raises
    ------
    InputError
        If it is nested too deeply.
    """
    try:
        return nested(value, _plain)
    except RecursionError:
        raise InputError(f"value is {shown(value)}: a study takes numbers, texts, lists and tables; give one") from None


def _plain(value: Any) -> Any:
    """Return a single value as TOML has it."""
    if getattr(value, "ndim", 0) and hasattr(value, "tolist"):
        return value.tolist()
    return str(value) if isinstance(value, Path) else unwrapped(value)


def _given(axis: str, value: Any) -> tuple[str, Any]:
    """Return the label that a value asks for, empty for none, and the value without it.

    Raises
    ------
    InputError
        If the value of a named axis is neither a name nor a table.
    """
    label = ""
    if isinstance(value, dict) and "label" in value:
        label = str(value["label"])
        value = {key: item for key, item in value.items() if key != "label"}
    if axis == "method":
        value = _method(value)
    elif axis in ("sizes", "container") and hasattr(value, "to_mapping"):
        value = {key: item for key, item in plain(value.to_mapping()).items() if item is not None}
    elif axis == "shape" and isinstance(value, dict) and set(value) == {"shapes"}:
        value = value["shapes"]
    if axis in NAMED and not isinstance(value, str | dict) and not (axis == "shape" and _is_mixture(value)):
        raise InputError(
            f"axis {axis} has the value {shown(value)}: it must be a name or a table such as "
            f"{{ {NAMED[axis]} = ..., label = ... }}; change it"
        )
    if "." not in axis and axis not in (*NAMED, FRICTION) and not isinstance(value, dict | bool):
        also = ", true or false" if axis == "settle" else ""
        raise InputError(
            f"axis {axis} has the value {shown(value)}: it must be a table of keys of [{axis}]{also}; change it"
        )
    if axis == "scene" and {"seed", "seeds"} & set(value):
        check_axis("seeds")
    return label, value


def _method(value: Any) -> Any:
    """Return a method given as an object of its parameters, or by the key `name`, as a table with the key `method`."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        name, _, settings = method_registry().chosen(value, {}, where="method")
        defaults = {item.name: item.default for item in parameters_of(type(value))}
        given = {key: item for key, item in to_mapping(settings).items() if item != plain(defaults[key])}
        return {"method": name, **plain(given)}
    if isinstance(value, dict) and "name" in value and "method" not in value:
        return {"method": value["name"]} | {key: item for key, item in value.items() if key != "name"}
    return value


def _is_mixture(value: Any) -> bool:
    """Return whether a value is a list of shapes."""
    return isinstance(value, list) and bool(value) and all(isinstance(item, str | dict) for item in value)


def _labels(axis: str, given: Sequence[tuple[str, Any]]) -> list[Label]:
    """Return what the values of an axis are called, numbers only where all of them are.

    Raises
    ------
    InputError
        If two values are called the same.
    """
    values = [value for _, value in given]
    names = [label or _name(axis, value) for label, value in given]
    full = [label or _text(value) for label, value in given]
    # a short name stands for one value, which listed cells may share
    called = {name: {_text(value) for its, value in zip(names, values, strict=True) if its == name} for name in names}
    labels: list[Label] = [
        name if name and len(called[name]) == 1 else text for name, text in zip(names, full, strict=True)
    ]
    if all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        labels = list(values)
    return labels


def refuse_equal(axis: str, labels: Sequence[Any]) -> None:
    """Refuse values of an axis that are called the same.

    Raises
    ------
    InputError
        If two are.
    """
    for label in labels:
        if labels.count(label) > 1:
            raise InputError(
                f"axis {axis} has two values {shown(label)}: values of an axis differ; drop one, or give each a label"
            )


def _name(axis: str, value: Any) -> str:
    """Return the short name of a value of a named axis; empty where it has none."""
    if axis not in NAMED:
        return ""
    if isinstance(value, list):
        return " + ".join(_name(axis, item) for item in value)
    name = value if isinstance(value, str) else value.get(NAMED[axis], value.get("file", ""))
    return Path(name).stem if axis == "shape" and Path(name).suffix else str(name)


def _text(value: Any) -> str:
    """Return a value as a label: its keys and values where it is a table."""
    if isinstance(value, dict):
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items())
    return value if isinstance(value, str) else json.dumps(value, default=str)


def changed(base: Mapping[str, Any], choices: Mapping[str, Any]) -> dict[str, Any]:
    """Return the mapping of a scene with what the axes choose: whole tables first, then single keys.

    Parameters
    ----------
    base : mapping
        Sections by name.
    choices : mapping
        Value by axis.

    Raises
    ------
    InputError
        If a path leads through something that is no table.
    """
    made = copy.deepcopy(dict(base))
    for axis in sorted(choices, key=lambda name: (name not in NAMED, name.count(".") + (name == FRICTION))):
        value = copy.deepcopy(choices[axis])
        if axis == "method":
            _set_method(made, value)
        elif axis == "shape":
            made["shape"] = [_shape(item) for item in (value if isinstance(value, list) else [value])]
        elif axis in ("sizes", "container"):
            table: dict[str, Any] = {"kind": value} if isinstance(value, str) else dict(value)
            # a table without kind changes keys of the base; another kind has other keys
            kept = made.get(axis, {}) if "kind" not in table else {}
            share = {key: made[axis][key] for key in ("share_by",) if key in made.get(axis, {})}
            made[axis] = {**share, **kept, **table}
        elif axis == FRICTION:
            method = made.get("packing", {}).get("method")
            entries = method_registry()
            own = parameters_of(entries.get(method).parameters) if method in entries.names() else ()
            _set(made, "packing.friction" if FRICTION in {item.name for item in own} else "settle.friction", value)
        elif "." not in axis:
            given: dict[str, Any] = {"enabled": value} if isinstance(value, bool) else dict(value)
            made[axis] = {**made.get(axis, {}), **given}
        else:
            _set(made, axis, value)
    return made


def _set_method(scene: dict[str, Any], value: Any) -> None:
    """Set the method of a scene, with parameters, and how its grains settle where its table has a key `settle`."""
    table: dict[str, Any] = {"method": value} if isinstance(value, str) else dict(value)
    if "settle" in table:
        settle: Any = table.pop("settle")
        scene["settle"] = {"enabled": settle} if isinstance(settle, bool) else {**scene.get("settle", {}), **settle}
    scene["packing"] = {**scene.get("packing", {}), **table}


def _shape(value: Any) -> dict[str, Any]:
    """Return the [[shape]] of a name, which is that of a file where it has a suffix."""
    if isinstance(value, dict):
        return value
    return {"file": value} if Path(value).suffix else {"family": value}


def _set(scene: dict[str, Any], axis: str, value: Any) -> None:
    """Set the value at a path; ``shape.KEY`` is that of each [[shape]], ``shape.0.KEY`` that of the first one, as
    ``material.0.KEY``, ``obstacle.0.KEY`` and ``layer.0.KEY`` are those of the first entry of these sections.

    Raises
    ------
    InputError
        If the path leads through something that is no table, or to an entry that is not there.
    """
    first, *rest = axis.split(".")
    places: list[Any] = [scene.setdefault(first, {})]
    if first in LISTS:
        entries = scene[first] if isinstance(scene[first], list) else []
        places = entries
        if rest[0].isdecimal():
            places = entries[int(rest.pop(0)) :][:1]
        if not places or not rest:
            raise InputError(
                f"axis {axis}: the scene has {len(entries)} [[{first}]], counted from 0; write {first}.0.KEY"
            )
    for place in places:
        at = place
        for key in rest[:-1]:
            at = at.setdefault(key, {}) if isinstance(at, dict) else at
        if not isinstance(at, dict):
            raise InputError(f"axis {axis}: what it leads through is {shown(at)} and no table; shorten the path")
        at[rest[-1]] = value
