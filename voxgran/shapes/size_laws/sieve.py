"""Sieve curves, as laboratories write them: what passes or what is retained, as shares, percent or masses."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np

from voxgran._base.arithmetic import libm
from voxgran._base.arrays import Floats, as_flag, as_floats, as_length
from voxgran._base.config import parameter, parameter_class
from voxgran._base.errors import FileFormatError, InputError, PackingWarning, shown, warn
from voxgran.shapes.formats.tables import column_kind, columns_in, length_factor, numbers_in, read_table, told_columns
from voxgran.shapes.size_laws.distribution import SizeDistribution, same_length
from voxgran.shapes.size_laws.simple import growth

#: names of the columns of tables, in lower case, of letters only
COLUMNS = {
    "openings": ("opening", "openings", "sieve", "sieves", "sievesize", "sieveopening", "size", "aperture", "mesh",
                 "diameter", "d", "grainsize", "particlesize"),
    "passing": ("passing", "passed", "pass", "percentpassing", "finer", "percentfiner", "cumulativepassing", "p"),
    "retained": ("retained", "retainedmass", "massretained", "percentretained", "mass", "weight"),
}  # fmt: skip
#: rounding of the last value of a curve in shares or percent
ROUNDING = 1e-6


@parameter_class
class Sieve(SizeDistribution):
    """Measured sieve curve, interpolated linearly in the logarithm of the opening.

    Openings may be given in any order, with what passes each, as shares or in percent, or with what each retains, as
    masses, shares or percent; an opening of 0 is the pan. Where the smallest opening lets something pass, these fines
    reach down to `smallest`.

    Parameters
    ----------
    openings
        openings of the sieves.
    passing
        what passes each sieve: shares up to 1, or percent up to 100.
    retained
        instead: what each sieve retains, of which the sum is all.
    file
        instead: table (CSV) with a column of openings and one of the others.
    unit
        unit of all other lengths, where the table names the unit of its openings.
    smallest
        smallest size, where the smallest sieve lets something pass; default: as if one sieve finer, of the same ratio,
        were passed by nothing.
    as_diameter
        whether openings are equivalent diameters rather than intermediate axes.
    basis
        quantity that the shares refer to.

    Raises
    ------
    InputError
        If there are fewer than two sieves, two have one opening, passing falls, or a mass is negative.
    """

    kind: ClassVar[str] = "sieve"

    openings: tuple[float, ...] | None = parameter(None, unit="length")
    passing: tuple[float, ...] | None = parameter(None)
    retained: tuple[float, ...] | None = parameter(None)
    file: str | None = parameter(None)
    unit: str | None = parameter(None)
    smallest: float | None = parameter(None, unit="length")
    as_diameter: bool = parameter(False)
    basis: Literal["number", "volume"] = parameter("volume")

    def __post_init__(self) -> None:
        """Bring the curve into the form of increasing openings with the shares that pass them."""
        SizeDistribution.__post_init__(self)
        as_flag(self.as_diameter, "as_diameter")
        given = {"openings": self.openings, "passing": self.passing, "retained": self.retained}
        if self.file is not None:
            if any(value is not None for value in given.values()):
                raise InputError(f"file is {self.file!r} and a curve is given too: give one of them")
            given = _table_of(read_table(self.file), self.unit, self.file)
        openings, passing = _curve(given, self.smallest)
        plain = {"openings": openings, "passing": passing, "retained": None, "file": None, "unit": None}
        for name, value in (plain | {"smallest": None}).items():
            object.__setattr__(self, name, value)

    @property
    def by_intermediate_axis(self) -> bool:
        """Whether sizes are intermediate axes; the caller turns them into equivalent diameters."""
        return not self.as_diameter

    def _bins(self, power: int) -> tuple[Floats, Floats, Floats]:
        """Return lower openings, ratios to the upper ones, and the integrals of (size / largest)**power."""
        openings, passing = np.array(self.openings), np.array(self.passing)
        low, ratio = openings[:-1], openings[1:] / openings[:-1]
        height = np.diff(passing) / libm.log(ratio)
        return low, ratio, height * libm.power(low / openings[-1], power) * growth(ratio, power)

    def _partial(self, sizes: Floats, power: int) -> Floats:
        """Integrate in closed form, bin by bin."""
        low, ratio, weights = self._bins(power)
        total = np.concatenate([[0.0], np.cumsum(weights)])
        place = np.clip(np.searchsorted(low, sizes, side="right") - 1, 0, len(low) - 1)
        inside = np.clip(sizes / low[place], 1.0, ratio[place])
        part = growth(inside, power) / growth(ratio[place], power)
        return np.asarray((low[-1] * ratio[-1]) ** power * (total[place] + weights[place] * part))

    def _inverse(self, shares: Floats, power: int) -> Floats:
        """Invert in closed form, bin by bin."""
        low, ratio, weights = self._bins(power)
        full = np.flatnonzero(weights)
        low, ratio, weights = low[full], ratio[full], weights[full]
        total = np.cumsum(weights)
        want = shares * total[-1]
        place = np.minimum(np.searchsorted(total, want, side="right"), len(low) - 1)
        part = np.clip(1.0 - (total[place] - want) / weights[place], 0.0, 1.0)
        if power == 0:
            return np.asarray(low[place] * libm.power(ratio[place], part))
        return np.asarray(low[place] * libm.power(1.0 + part * (libm.power(ratio[place], power) - 1.0), 1.0 / power))


def curve_in_table(table: Any, unit: str | None) -> dict[str, tuple[float, ...] | None]:
    """Return the columns of a table: a mapping, a `pandas.DataFrame`, or a `pandas.Series` of what passes or, where its
    name says so, is retained, by the opening.

    Raises
    ------
    InputError
        If columns are missing or not certain, or their unit is not that of all other lengths.
    """
    return _table_of(table, unit, "table")


def _table_of(table: Any, unit: str | None, where: str) -> dict[str, tuple[float, ...] | None]:
    """Return openings, and what passes or is retained, of a table."""
    if getattr(table, "ndim", 0) == 1 and hasattr(table, "index"):
        retained = column_kind(str(table.name), COLUMNS) == "retained" or "retain" in str(table.name).lower()
        table = {str(table.index.name or "opening"): table.index, "retained" if retained else "passing": table}
    places = columns_in(table, COLUMNS, where)
    if "openings" not in places or not ({"passing", "retained"} & places.keys()):
        raise FileFormatError(
            f"{where} has the columns {told_columns(table)}: it must have 'opening', and 'passing' or "
            "'retained'; rename them"
        )
    found: dict[str, tuple[float, ...] | None] = {"openings": None, "passing": None, "retained": None}
    factor = length_factor(places["openings"], unit, where=where, what="openings")
    # what passes is taken where both are there
    for kind in ("openings", "passing") if "passing" in places else ("openings", "retained"):
        # the pan has no opening
        name = str(places[kind])
        values = numbers_in(table[places[kind]], where, name, words={"pan": 0.0})
        in_percent = kind == "passing" and re.search("%|percent", name.lower())
        if in_percent and abs(values.max(initial=0.0) - 1.0) <= ROUNDING:
            warn(f"{where} has {name!r} up to 1: these are taken as shares and not as percent", PackingWarning)
        found[kind] = tuple((factor * values if kind == "openings" else values).tolist())
    return found


def _curve(
    given: Mapping[str, Sequence[float] | None], smallest: float | None
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return increasing openings and the shares that pass them, from 0 to 1."""
    name = "passing" if given["passing"] is not None else "retained"
    if given["openings"] is None or given[name] is None:
        raise InputError("a sieve curve needs openings, and passing or retained: give both, or a file")
    if given["passing"] is not None and given["retained"] is not None:
        raise InputError("passing and retained are given: they are two ways of saying one thing; leave one out")
    opening, value = (as_floats(given[key] or (), key, shape=(None,)) for key in ("openings", name))
    same_length(tuple(opening), tuple(value), ("openings", name))
    order = np.argsort(opening, kind="stable")
    opening, value = opening[order], value[order]
    twice = np.flatnonzero(np.diff(opening) <= 0)
    if len(twice):
        raise InputError(f"openings have {opening[twice[0]]:g} twice: each sieve is given once; remove one")
    if opening[0] < 0 or value.min() < 0:
        worst, of = (opening[0], "openings") if opening[0] < 0 else (value.min(), name)
        raise InputError(f"{of} have {worst:g}: none may be negative; change it")
    if name == "passing" and np.any(np.diff(value) < 0):
        k = int(np.argmax(np.diff(value) < 0))
        raise InputError(
            f"passing falls from {value[k]:g} at {opening[k]:g} to {value[k + 1]:g} at {opening[k + 1]:g}: a larger "
            "opening lets more pass; change it, or give what sieves retain as retained"
        )
    passing = _of_retained(opening, value) if name == "retained" else _as_shares(value)
    return _with_fines(opening, passing, smallest)


def _as_shares(passing: Floats) -> Floats:
    """Return what passes as shares."""
    largest = float(passing.max())
    if abs(largest - 1.0) <= ROUNDING:
        return np.minimum(passing / largest, 1.0)
    if abs(largest - 100.0) > 100.0 * ROUNDING:
        raise InputError(
            f"passing reaches {largest:g}: it must reach 1, or 100 in percent; add an opening that all passes"
        )
    others = passing[passing < largest]
    if len(others) > 1 and 0.0 < others.max() <= 1.0:
        raise InputError(
            f"passing is {shown(passing.tolist())}: shares up to 1 and percent up to 100 are mixed; give all in one of "
            "them"
        )
    return np.minimum(passing / largest, 1.0)


def _of_retained(opening: Floats, retained: Floats) -> Floats:
    """Return the shares that pass sieves, of what each retains."""
    if not retained.sum() > 0.0:
        raise InputError("retained are all 0: one must be above 0; give the masses that the sieves retain")
    if retained[-1] > 0.0:
        raise InputError(
            f"the largest sieve, {opening[-1]:g}, retains {retained[-1]:g}: how large these grains are is not known; "
            "add an opening that all passes, with 0 retained"
        )
    return np.concatenate([[0.0], np.cumsum(retained)[:-1]]) / retained.sum()


def _with_fines(
    opening: Floats, passing: Floats, smallest: float | None
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the curve from a share of 0 on: what passes the smallest sieve reaches down to a smallest size."""
    pan = opening == 0.0
    if np.any(pan & (passing > 0.0)):
        raise InputError(f"an opening of 0 lets {passing[pan][0]:g} pass: no grain is smaller than 0; change it")
    opening, passing = opening[~pan], passing[~pan]
    if len(opening) < 2 - (smallest is not None):
        raise InputError(f"openings are {shown(opening.tolist())}: at least two above 0 are needed; add one")
    for value in opening:
        as_length(value, "opening")
    if smallest is not None and not 0.0 < as_length(smallest, "smallest") < opening[0]:
        raise InputError(f"smallest is {smallest:g}: it must be below the smallest opening, {opening[0]:g}; change it")
    if passing[0] > 0.0:
        low = opening[0] ** 2 / opening[1] if smallest is None else smallest
        if smallest is None:
            warn(
                f"{100.0 * passing[0]:.3g} % pass the smallest sieve, {opening[0]:g}: they are taken to be as large as "
                f"{low:.4g} at least; give smallest, the size that nothing is below",
                PackingWarning,
            )
        opening, passing = np.append(low, opening), np.append(0.0, passing)
    return tuple(opening.tolist()), tuple(passing.tolist())
