"""`measure`: statistics of a packing with units, in one tree.

Each measure is one file of the folder ``registered`` with a line ``registration = Measure(...)``.
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base.arrays import check_type
from voxgran._base.calls import explained
from voxgran._base.compiling.threads import using_threads
from voxgran._base.lazy import Dataset, DataTree, load
from voxgran._base.registry import Registry
from voxgran.containers.model import refuse_tilt, tilt_of
from voxgran.measures.accessor import register_accessor
from voxgran.packing.model import Packing, check_packing
from voxgran.packing.start import around_fixed

#: datasets by group of the tree
Groups: TypeAlias = "Mapping[str, Dataset]"
#: the name of all measures that apply
ALL = "all"
#: always measured, so that numbers keep their provenance
ALWAYS = ("provenance",)


def _always(packing: Packing) -> bool:
    """Return True: the measure applies to every packing."""
    del packing
    return True


@dataclass(frozen=True, slots=True, kw_only=True)
class Measure:
    """One registered measure."""

    name: str = ""  # the name of the file or entry point
    summary: str  # description in one line
    groups: tuple[str, ...]  # groups of the tree that it adds variables to
    compute: Callable[[Packing], Groups]
    applies: Callable[[Packing], bool] = _always  # whether it applies to a packing, where it is not named
    usual: bool = True  # whether it is computed where no measure is named
    tilted: bool = False  # whether it applies to packings in tilted periodic containers
    sees_fixed: bool = False  # whether fixed grains are grains to it; to others they are a part of the container


def measure_registry() -> Registry[Measure]:
    """Return the registry of measures."""
    return Registry("measure", "voxgran.measures.registered", Measure, group="voxgran.measures")


def measures() -> tuple[str, ...]:
    """Return the names of all measures."""
    return measure_registry().names()


@explained(
    hint='measure(packing, ["contacts", "rdf"]), or for each shape or material in turn '
    'measure(packing[packing.shape_id == 0], "profile")'
)
def measure(packing: Packing, which: str | Sequence[str] | None = None, *, threads: int | None = None) -> "DataTree":
    """Measure a packing, or the grains of one shape: ``measure(packing[packing.shape_id == 0], "profile")``.

    Parameters
    ----------
    packing : Packing
        The packing; zero grains are allowed. Fixed grains are no grains here but a part of the container, whose volume
        they reduce; contacts with them are contacts with walls. Only the pore space is measured between them too.
    which : str or sequence of str, optional
        Names of measures; `voxgran methods` lists them. Only these and the provenance are computed. ``"all"`` are
        all that apply to the packing. Default: the usual ones of these, which take a small part of the time of packing.
    threads : int, optional
        Number of threads, by default that of the processors or of ``OMP_NUM_THREADS``; the result is the same.

    Returns
    -------
    xarray.DataTree
        Requested groups, such as ``/``, ``/grains``, ``/contacts``, ``/profiles``, ``/gradation`` and ``/provenance``.
        Every variable has the attributes `units` and `long_name`, and `error` if it is not exact.

    Raises
    ------
    InputError
        If `packing` is not a packing, `which` is neither a name nor a sequence of names, a measure that it names does
        not apply to tilted containers, or `threads` is no whole number above 0.
    UnknownNameError
        If there is no measure of that name.

    Examples
    --------
    >>> import voxgran as vg
    >>> box = vg.Box((2, 2, 2), periodic="xyz")
    >>> packing = vg.Packing.of([vg.make_shape("sphere")], box, position=[[0, 0, 0]])
    >>> tree = vg.measure(packing, which=["coordination"])
    >>> int(tree["/grains"].coordination_number[0])
    0
    """
    check_packing(packing, "packing")
    register_accessor()
    registry, free = measure_registry(), around_fixed(packing)
    check_type(which, (Iterable, type(None)), "which", "a name or a list of names, such as ['density']")
    names = [which] if isinstance(which, str) else which
    names = None if names is None else list(names)
    for name in names or ():
        check_type(name, str, "which", "a name or a list of names, such as ['density']")
    named = [registry.get(name) for name in dict.fromkeys([*(names or ()), *ALWAYS]) if name != ALL]
    if names is None or ALL in names:
        entries = map(registry.get, registry.names())
        chosen = [
            entry
            for entry in entries
            if (entry.usual or names is not None) and entry.applies(packing if entry.sees_fixed else free)
        ]
        chosen = [entry for entry in chosen if entry.tilted or not any(tilt_of(packing.container))]
    else:
        chosen = named
        for entry in chosen:
            if not entry.tilted:
                refuse_tilt(packing.container, f"measure {entry.name!r}", "name others, or leave which out")
    groups: dict[str, Any] = {"/": dataset({"count": variable((), free.count, "1", "number of grains")})}
    if free is not packing:
        groups["/"]["fixed_count"] = variable((), packing.count - free.count, "1", "number of fixed grains")
    told = {"unit": packing.unit, "gravity": packing.gravity or "none", "contact_gap": packing.contact_gap}
    groups["/"].attrs.update(told)
    with using_threads(threads):
        computed = [entry.compute(packing if entry.sees_fixed else free) for entry in chosen]
    for group, found in (item for some in computed for item in some.items()):
        groups[group] = groups[group].merge(found, compat="identical") if group in groups else found
    tree: DataTree = load("xarray").DataTree.from_dict(groups, name="measures")
    return tree


def dataset(variables: Mapping[str, Any], coordinates: Mapping[str, Any] | None = None) -> "Dataset":
    """Return a dataset of variables, and of coordinates along their dimensions."""
    made: Dataset = load("xarray").Dataset(dict(variables), coords=dict(coordinates or {}))
    return made


def variable(
    dims: tuple[str, ...], values: "ArrayLike", units: str, long_name: str, *, error: float | None = None
) -> tuple[tuple[str, ...], Any, dict[str, Any]]:
    """Return dimensions, values and attributes as a variable of xarray; the unit is ``"1"`` if there is none.

    `error` is a bound or the standard deviation; None for no such attribute.
    """
    attributes: dict[str, Any] = {"units": units, "long_name": long_name}
    if error is not None:
        attributes["error"] = float(error)
    return dims, np.asarray(values), attributes


def length_unit(packing: Packing, *, power: int = 1) -> str:
    """Return the unit of a power of length: ``"mm"``, ``"mm^3"``, or ``"1"`` if the unit is not known."""
    return packing.unit if power == 1 or packing.unit == "1" else f"{packing.unit}^{power}"


def json_text(record: Mapping[str, Any]) -> str:
    """Return a record as JSON with sorted keys, so that equal records are equal texts."""
    return json.dumps(record, sort_keys=True, default=_plain)


def _plain(value: Any) -> Any:
    """Return NumPy values and other types as JSON-able values."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)
