"""Groups of packings and their differences: in numbers with standard errors, and in distributions over grains."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from voxgran._base.arrays import Floats, check_type
from voxgran._base.errors import InputError, warn
from voxgran._base.lazy import DataTree
from voxgran._base.scalars import plain_text
from voxgran._base.units import NO_UNIT
from voxgran.measures.model import measure
from voxgran.measures.registered.coordination import coordination_number, usual_gap
from voxgran.packing.model import Packing, check_packing
from voxgran.report.significance import (
    EQUAL,
    all_equal,
    distance_of,
    permutation_p_value,
    standard_error,
    verdict_of,
    welch_p_value,
)


@dataclass(frozen=True, slots=True)
class Group:
    """Group of packings in a comparison."""

    name: str
    #: one packing, or several independent ones, such as those of several seeds
    packings: tuple[Packing, ...]
    trees: "tuple[DataTree, ...]"
    #: coordination numbers of the grains of each packing, up to the same gap in all groups; empty if not requested
    neighbours: tuple[Floats, ...]
    #: this gap, in mean diameters
    gap: float

    def numbers(self) -> dict[str, Floats]:
        """Return each scalar (k,) that all packings have; NaN for unknown values."""
        names = [
            str(name)
            for name, value in self.trees[0].data_vars.items()
            if not value.ndim and value.dtype.kind in "biuf" and all(name in tree for tree in self.trees)
        ]
        return {name: np.array([float(tree[name]) for tree in self.trees]) for name in names}

    def distributions(self) -> dict[str, tuple[Floats, ...]]:
        """Return the values per grain of each packing, by quantity; only quantities that all packings have."""
        if not all(packing.count for packing in self.packings):
            return {}
        sizes = {"equivalent diameter": tuple(packing.diameters for packing in self.packings)}
        return {**sizes, "coordination number": self.neighbours} if self.neighbours else sizes


def groups_of(packings: Mapping[str, Packing | Sequence[Packing]], which: Sequence[str] | None) -> list[Group]:
    """Measure the packings of at least two groups by the measures of these names, or by all that apply.

    Raises
    ------
    InputError
        If there are fewer than two groups, one of them is empty, contains the same packing twice or another object, or
        only some packings have a unit.
    UnknownNameError
        If there is no measure of that name.
    """
    check_type(packings, Mapping, "packings", 'a mapping of names to packings, such as {"loose": bed, "dense": other}')
    if len(packings) < 2:
        raise InputError(f"packings has {len(packings)} entries: a comparison needs at least two; add another")
    chosen = {name: tuple(given) if isinstance(given, Sequence) else (given,) for name, given in packings.items()}
    for name, group in chosen.items():
        if not group:
            raise InputError(f"packings {name!r} is empty: give at least one packing")
        for packing in group:
            check_packing(packing, f"packings {name!r}")
        places = [packing.position.tobytes() + packing.scale.tobytes() for packing in group if packing.count]
        if len(set(places)) < len(places):
            raise InputError(
                f"packings {name!r} holds the same packing twice: those of a group must be independent of each other, "
                "such as those of several seeds; leave one out"
            )
    unit = next(iter(chosen.values()))[0].unit
    chosen = {name: tuple(_in_unit(packing, unit, name) for packing in group) for name, group in chosen.items()}
    gap = max(usual_gap(packing) for group in chosen.values() for packing in group)
    return [_group(name, group, which, gap=gap) for name, group in chosen.items()]


def _in_unit(packing: Packing, unit: str, name: str) -> Packing:
    """Return a packing in the unit of the first one."""
    if packing.unit != unit and NO_UNIT in (packing.unit, unit):
        has, first = (f"in {known}" if known != NO_UNIT else "without a unit" for known in (packing.unit, unit))
        raise InputError(f"packings {name!r} has lengths {has}, the first one {first}: give both a unit, or neither")
    return packing.to_unit(unit)


def _group(name: str, packings: tuple[Packing, ...], which: Sequence[str] | None, *, gap: float) -> Group:
    """Measure the packings of a group."""
    trees = tuple(_measured(packing, _label(name, packings, k), which) for k, packing in enumerate(packings))
    neighbours: tuple[Floats, ...] = ()
    if all("/grains" in tree.groups and "coordination_number" in tree["/grains"] for tree in trees):
        # counted up to a common gap, since methods leave different gaps between grains in contact
        found = (coordination_number(packing, [gap], reference_gap=gap).of_grain for packing in packings)
        neighbours = tuple(values.astype(np.float64) for values in found)
    return Group(plain_text(name), packings, trees, neighbours, gap)


def _label(name: str, group: tuple[Packing, ...], index: int) -> str:
    """Return the name of a packing of a group for warnings."""
    seed = group[index].provenance.get("seed")
    which = f"packing {index + 1}" if seed is None else f"seed {seed}"
    return name if len(group) == 1 else f"{name}, {which}"


def _measured(packing: Packing, label: str, which: Sequence[str] | None) -> "DataTree":
    """Measure a packing; warnings name it."""
    with warnings.catch_warnings(record=True, action="always") as caught:
        tree = measure(packing, which=which)
    for one in caught:
        warn(f"{label}: {one.message}", one.category)
    return tree


def compared(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """Return each number of all groups, its difference from the first group, and the p-value of the difference.

    Each entry has ``name``, ``long_name``, ``unit`` and, by group, ``known`` (packings that have the number), ``mean``
    (None if none has it), ``standard_error`` (None for one packing), ``difference`` (0 if means differ by rounding
    only), ``p_value`` (Welch's t-test; None if a group has fewer than two packings, or neither has any scatter) and
    ``verdict``: ``"equal"``, ``"significant"``, ``"not significant"`` or ``"not tested"``.
    """
    all_numbers = [group.numbers() for group in groups]
    meaning = {name: groups[0].trees[0][name].attrs for name in all_numbers[0]}
    if all(group.neighbours for group in groups):
        # the mean at the contact gap of each packing cannot be compared where these gaps differ
        meaning.pop("mean_coordination_number", None)
        meaning["coordination_number"] = {
            "long_name": f"mean coordination number, at a gap of at most {groups[0].gap:.3g} mean diameters"
        }
        for numbers, group in zip(all_numbers, groups, strict=True):
            means = [values.mean() if len(values) else np.nan for values in group.neighbours]
            numbers["coordination_number"] = np.array(means)
    beds = any(packing.gravity is not None for group in groups for packing in group.packings)
    rows = []
    for name, attrs in meaning.items():
        first = all_numbers[0][name]
        entries = {groups[0].name: _entry(first, None)}
        for group, numbers in zip(groups[1:], all_numbers[1:], strict=True):
            if name in numbers:
                entries[group.name] = _entry(numbers[name], first)
        if len(entries) < 2:
            continue
        long_name, unit = str(attrs.get("long_name", name)), str(attrs.get("units", "1"))
        # of beds the numbers of the container are named after it, as on other pages
        told = f"container_{name}" if beds and name in ("solid_fraction", "porosity") else name
        rows.append({"name": told, "long_name": long_name, "unit": unit, "groups": entries})
    return rows


def _entry(given: Floats, reference: Floats | None) -> dict[str, Any]:
    """Return mean and standard error of the values of a group, and their difference from the reference."""
    values = given[np.isfinite(given)]
    entry: dict[str, Any] = {
        "known": len(values),
        "mean": float(values.mean()) if len(values) else None,
        "standard_error": standard_error(values) if len(values) > 1 else None,
    }
    if reference is None:
        return entry
    known = reference[np.isfinite(reference)]
    p_value = None
    if not len(values) or not len(known):
        difference, verdict = None, "not tested"
    elif all_equal(np.array([values.mean(), known.mean()])):
        difference, verdict = 0.0, "equal"
    else:
        difference, p_value = float(values.mean() - known.mean()), welch_p_value(values, known)
        verdict = verdict_of(p_value)
    return {**entry, "difference": difference, "p_value": p_value, "verdict": verdict}


def distributions(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """Compare the sizes and coordination numbers of the grains with those of the first group.

    Each entry has ``what``, ``group``, the Kolmogorov-Smirnov ``distance`` by number, its ``p_value`` (a permutation of
    packings; None if there are too few) and ``verdict``, as in :func:`compared`.
    """
    found = []
    first = groups[0].distributions()
    for what, reference in first.items():
        for group in groups[1:]:
            values = group.distributions().get(what)
            if values is None:
                continue
            distance = distance_of(reference, values)
            p_value = permutation_p_value(reference, values) if distance > EQUAL else None
            verdict = verdict_of(p_value) if distance > EQUAL else "equal"
            found.append(
                {"what": what, "group": group.name, "distance": distance, "p_value": p_value, "verdict": verdict}
            )
    return found
