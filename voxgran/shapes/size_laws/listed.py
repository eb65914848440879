"""Lists of grains, each of which is placed once: their shapes, sizes and densities, row by row."""

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, Integers, check_lengths, check_type
from voxgran._base.errors import FileFormatError, InputError, TooLargeError, UnknownNameError, shown, unknown
from voxgran._base.machine import memory_limit
from voxgran._base.scalars import number_of
from voxgran._base.units import NO_UNIT, unit_factor
from voxgran.shapes.formats.tables import columns_in, length_factor, numbers_in, read_table, told_columns, unit_in
from voxgran.shapes.model import Shape, check_shapes
from voxgran.shapes.size_laws.simple import Discrete

#: names of the columns of lists, in lower case and of letters only
COLUMNS = {
    "diameter": ("diameter", "diameters", "equivalentdiameter", "d", "size", "grainsize"),
    "mass": ("mass", "masses", "weight", "m"),
    "shape": ("shape", "shapes", "kind"),
    "density": ("density", "densities", "rho"),
    "count": ("count", "counts", "number", "n"),
}
#: units of columns in SI, that of masses and that of densities
UNITS = {"mass": {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "t": 1e3}, "density": {"kg/m3": 1.0, "g/cm3": 1e3, "t/m3": 1e3}}
#: most different sizes that are kept as a distribution
MOST_SIZES = 100_000
#: bytes of a grain that every method needs at least
GRAIN_BYTES = 300
EMPTY = "{} is empty: a list has at least one grain; add one, or leave it out"


@dataclass(frozen=True, slots=True)
class ListedGrains:
    """Grains of a list: row, index of the shape, equivalent diameter, and density (None where the list has none) of
    each, all (n,); and the number of rows.
    """

    row: Integers
    shape_id: Integers
    diameter: Floats
    density: Floats | None
    rows: int

    def sizes(self) -> Discrete | None:
        """Return the distribution of the sizes, by number; None of more than 100,000 different ones."""
        diameter, many = np.unique(self.diameter, return_counts=True)
        if len(diameter) > MOST_SIZES:
            return None
        return Discrete(diameters=tuple(diameter.tolist()), weights=tuple(many.astype(float).tolist()))


def with_shapes_of_list(shapes: Any, grains: Any, density: Any) -> tuple[Any, Any, Any]:
    """Return shapes, list and density of a request: of a list of shapes the different ones, and a table of their
    indices, with densities that are given one by one.

    Raises
    ------
    InputError
        If something else than shapes is in the list, it is empty, or there are other shapes beside it.
    """
    if not isinstance(grains, Sequence) or isinstance(grains, str):
        return shapes, grains, density
    if not len(grains):
        raise InputError(EMPTY.format("grains"))
    for k, shape in enumerate(grains):
        check_type(shape, Shape, f"grains[{k}]", "a Shape; for sizes give a table such as {'diameter': [1.0, 2.0]}")
    if check_shapes(shapes):
        raise InputError("shapes are given and grains is a list of shapes: it has its own; leave shapes out")
    place = {shape: k for k, shape in enumerate(dict.fromkeys(grains))}
    table: dict[str, Any] = {"shape": [place[shape] for shape in grains]}
    if hasattr(density, "__len__"):
        return tuple(place), table | {"density": density}, None
    return tuple(place), table, density


def families_in(grains: Any) -> list[str]:
    """Return the names in the column of shapes of a list, each once; none of a list with indices or without the column.

    Raises
    ------
    FileFormatError
        If the file is no table, or two columns have one meaning.
    InputError
        If it is no table.
    MissingFileError
        If there is no such file.
    """
    where = "grains"
    if isinstance(grains, str | os.PathLike):
        where, grains = os.fspath(grains), read_table(os.fspath(grains))
    column = columns_in(grains, COLUMNS, where).get("shape")
    texts = [] if column is None else [entry for entry in grains[column] if number_of(entry) is None]
    return list(dict.fromkeys(str(entry).strip() for entry in texts))


def grains_of(
    grains: Any, shapes: Sequence[Shape], shares: Floats, *, unit: str, densities: Sequence[float] | None, sized: bool
) -> ListedGrains:
    """Return the grains of a list, in its order.

    Parameters
    ----------
    grains : mapping, pandas.DataFrame or path-like
        Table with the columns `diameter` or `mass`, where left out each shape has its own size, `shape`, a name or an
        index, `density` and `count`.
    shapes : sequence of Shape
        Shapes that the list names. Of several of one name, and of all where there is no column `shape`, one is taken
        in turn.
    shares : (len(shapes),) ndarray of float
        In which shares shapes are taken in turn.
    unit : str
        Unit of all lengths.
    densities : sequence of float or None
        Density of each shape, for lists without densities.
    sized : bool
        Whether shapes have sizes of their own, which grains without diameter and mass take.

    Raises
    ------
    InputError
        If it is no table, a number is out of its range, or masses have no density.
    FileFormatError
        If columns are missing, or an entry is no number.
    UnknownNameError
        If there is no such shape.
    TooLargeError
        If there are more grains than the memory can hold.
    MissingFileError
        If there is no such file.
    """
    where = "grains"
    if isinstance(grains, str | os.PathLike):
        where, grains = os.fspath(grains), read_table(os.fspath(grains))
    names = columns_in(grains, COLUMNS, where)
    if not {"diameter", "mass", *(["shape"] if sized else [])} & names.keys():
        needed = "'diameter', 'mass' or 'shape'" if sized else "'diameter' or 'mass'"
        raise FileFormatError(
            f"{where} has the columns {told_columns(grains)}: it must have {needed}; rename one, or add it"
        )
    told = f"{where} (rows from 0 on)"
    values = {
        kind: _positive(grains[name], told, str(name), zero=kind == "count")
        for kind, name in names.items()
        if kind != "shape" and not (kind == "mass" and "diameter" in names)
    }
    texts = grains[names["shape"]] if "shape" in names else None
    lengths = {kind: len(column) for kind, column in {**values, "shape": texts}.items() if column is not None}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{many} of {kind}" for kind, many in lengths.items())
        raise InputError(f"{where} has columns of several lengths ({listed}): give one entry a row")
    row = _repeated(values.pop("count", np.ones(max(lengths.values()))), told, names)
    if not len(row):
        raise InputError(EMPTY.format(where))
    values = {kind: column[row] for kind, column in values.items()}
    shape_id = in_turn(shares, len(row)) if texts is None else _named(texts, shapes, shares, told, row)
    if "density" in values:
        values["density"] *= _in_si("density", names["density"], where)
        if densities is not None:
            raise InputError(f"{where} has densities and density is given too: leave one of them out")
    known = values.get("density") if densities is None else np.array(densities)[shape_id]
    if "diameter" in values:
        lengths_in = None if unit == NO_UNIT else unit
        diameter = values["diameter"] * length_factor(names["diameter"], lengths_in, where=where, what="diameters")
    elif "mass" in values:
        if known is None or any(shapes[k].is_open for k in np.unique(shape_id)):
            why = "a shape is an open surface, which has no mass" if known is not None else "no densities"
            raise InputError(f"{where} has masses and {why}: give density, a column of densities, or diameters")
        dimension = shapes[0].dimension
        with np.errstate(over="ignore"):
            # what is infinite is refused as a diameter below
            volume = values["mass"] / known
        volume *= _unit_volume(names, where, unit, dimension)
        diameter = libm.power(volume * (6.0 if dimension == 3 else 4.0) / math.pi, 1.0 / dimension)
    else:
        diameter = np.array([shape.diameter for shape in shapes])[shape_id]
    check_lengths([diameter.min(), diameter.max()], f"diameter in {where}")
    return ListedGrains(row, shape_id, diameter, values.get("density"), max(lengths.values()))


def refuse_too_many(count: float, grain_bytes: float = GRAIN_BYTES) -> None:
    """Refuse a number of grains of so many bytes each that is beyond the memory.

    Raises
    ------
    TooLargeError
        If it is.
    """
    available = memory_limit()
    if count * grain_bytes > available:
        raise TooLargeError(
            f"count is {count:.9g}: these grains need at least {count * grain_bytes / 2**30:.1f} GiB, and this machine "
            f"has {available / 2**30:.1f} GiB; ask for fewer"
        )


def in_turn(shares: Floats, count: int) -> Integers:
    """Return the indices (count,) of things that are taken in turn, each in its share (m,) of all."""
    # each thing is due at equal intervals; by the time at which all are taken none is due more often than this
    many = np.where(shares > 0.0, np.ceil((count + 0.5 * len(shares)) * shares + 0.5), 0.0).astype(np.int64)
    which = np.repeat(np.arange(len(shares)), many)
    due = (np.arange(len(which)) - np.repeat(np.cumsum(many) - many, many) + 0.5) / shares[which]
    return which[np.argsort(due, kind="stable")[:count]]


def _positive(column: Any, where: str, name: str, *, zero: bool) -> Floats:
    """Return the numbers of a column, which are above 0, or with `zero` at least 0."""
    found = numbers_in(column, where, name, first=0)
    wrong = np.flatnonzero((found < 0.0) | ((found == 0.0) & (not zero)))
    if len(wrong):
        rule = "at least 0" if zero else "above 0"
        raise InputError(
            f"{where}, row {wrong[0]}: {name} is {found[wrong[0]]:g}: it must be {rule}; correct it or remove the row"
        )
    return found


def _repeated(count: Floats, where: str, names: Mapping[str, str]) -> Integers:
    """Return the row of each grain, of the numbers of grains of rows."""
    wrong = np.flatnonzero(count != np.floor(count))
    if len(wrong):
        raise InputError(
            f"{where}, row {wrong[0]}: {names['count']} is {count[wrong[0]]:g}: it must be a whole number; correct it"
        )
    refuse_too_many(float(count.sum()))
    return np.repeat(np.arange(len(count)), count.astype(np.int64))


def _named(column: Any, shapes: Sequence[Shape], shares: Floats, where: str, row: Integers) -> Integers:
    """Return the index of the shape of each grain, by a column of names or indices and the row of each grain."""
    if all(number_of(entry) is not None for entry in column):
        index = numbers_in(column, where, "shape", first=0)
        wrong = np.flatnonzero((index < 0) | (index >= len(shapes)) | (index != np.floor(index)))
        if len(wrong):
            raise InputError(
                f"{where}, row {wrong[0]}: shape is {index[wrong[0]]:g}: it must be the name of a shape, or its index "
                f"from 0 to {len(shapes) - 1}; correct it"
            )
        return index.astype(np.int64)[row]
    called: dict[str, list[int]] = {}
    for k, shape in enumerate(shapes):
        # a clump is called by the name of its shape, too
        for name in {shape.name, shape.name.partition(", ")[0]}:
            called.setdefault(name, []).append(k)
    texts, place = np.unique([str(entry).strip() for entry in column], return_inverse=True)
    for k, text in enumerate(texts):
        if text not in called:
            at = f"{where}, row {int(np.argmax(place == k))}"
            # as tables hold cells that are empty
            if text in ("", "nan", "None", "<NA>"):
                raise InputError(f"{at}: shape is missing; give its name, or remove the row")
            raise UnknownNameError(unknown(f"{at}: shape", str(text), called))
    place = place[row]
    found, ends = np.zeros(len(row), dtype=np.int64), np.cumsum(np.bincount(place, minlength=len(texts)))
    for text, grains in zip(texts, np.split(np.argsort(place, kind="stable"), ends[:-1]), strict=True):
        own = shares[called[text]] if shares[called[text]].any() else np.ones(len(called[text]))
        found[grains] = np.array(called[text])[in_turn(own / own.sum(), len(grains))]
    return found


def _in_si(kind: str, name: str, where: str) -> float:
    """Return the factor to kg, or kg/m3, of a column; 1 for one without unit."""
    told, known = unit_in(name).replace("\u00b3", "3").replace("^", ""), UNITS[kind]
    if told and told not in known:
        raise InputError(f"{where} has {shown(name)}: the unit must be one of {', '.join(known)}; convert the column")
    return known.get(told, 1.0)


def _unit_volume(names: Mapping[str, str], where: str, unit: str, dimension: int) -> float:
    """Return the factor from masses over densities to volumes in the unit of lengths: from m3 where masses have a unit,
    and 1 where neither has.
    """
    if not unit_in(names["mass"]):
        if unit_in(names.get("density", "")):
            raise InputError(
                f"{where} has {shown(names['density'])}, and masses have no unit: write it, such as 'mass [g]'"
            )
        return 1.0
    if unit == NO_UNIT:
        raise InputError(f"{where} has {shown(names['mass'])}, and lengths have no unit: give one, such as unit='mm'")
    return _in_si("mass", names["mass"], where) * unit_factor("m", unit) ** dimension
