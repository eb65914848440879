"""Distributions of grain sizes, by name: ``vg.sizes.lognormal(median=2.0, sigma=0.3)``.

A size is an equivalent diameter; for a sieve curve it is the intermediate axis by default. The classes are
in :mod:`voxgran.shapes.size_laws`. By default N grains get the sizes of N strata, which follow the distribution as
nearly as N grains can; with ``independent=True`` each size is drawn independently, as in a sample of a population.
"""

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import missing_names
from voxgran._base.arrays import Floats, as_floats, as_number, check_type
from voxgran._base.calls import explained
from voxgran._base.config import from_mapping, kind_of
from voxgran.shapes.size_laws.distribution import Basis, SizeDistribution
from voxgran.shapes.size_laws.mixture import Mixture
from voxgran.shapes.size_laws.openings import openings
from voxgran.shapes.size_laws.rosin_rammler import RosinRammler
from voxgran.shapes.size_laws.sieve import Sieve, curve_in_table
from voxgran.shapes.size_laws.simple import Discrete, Fixed, Fuller, Lognormal, Uniform

__all__ = [
    "SizeDistribution",
    "discrete",
    "fixed",
    "fuller",
    "lognormal",
    "make_sizes",
    "mixture",
    "openings",
    "rosin_rammler",
    "sieve",
    "size_kinds",
    "uniform",
]

if not TYPE_CHECKING:
    __getattr__ = missing_names(__name__)


@explained(hint="lognormal(median=1.0, sigma=0.2)")
def lognormal(
    median: float,
    sigma: float,
    *,
    basis: Basis = "number",
    low: float | None = None,
    high: float | None = None,
    independent: bool = False,
) -> Lognormal:
    """Return a log-normal distribution.

    Parameters
    ----------
    median : float
        Median, in the unit of lengths, in the given basis and before truncation.
    sigma : float
        Standard deviation of the natural logarithm.
    basis : {"number", "volume"}
        Quantity that the shares refer to.
    low, high : float, optional
        Lower and upper truncation, in the unit of lengths. Default: none.
    independent : bool
        Whether each size is drawn independently of the others.

    Raises
    ------
    CallError
        If there are other arguments than these.
    InputError
        If a number is not above 0, `sigma` is above 5, or the cuts leave nothing.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> sizes = vg.sizes.lognormal(median=2.0, sigma=0.3)
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((20, 20, 20)), "rsa", count=100, sizes=sizes)
    >>> round(float(np.median(bed.diameters)), 1)
    2.0
    """
    return Lognormal(
        median=as_number(median, "median"),
        sigma=as_number(sigma, "sigma"),
        basis=basis,
        low=None if low is None else as_number(low, "low"),
        high=None if high is None else as_number(high, "high"),
        independent=independent,
    )


@explained(hint="fixed(1.0)")
def fixed(diameter: float = 1.0) -> Fixed:
    """Return the distribution of grains of one size.

    Raises
    ------
    InputError
        If the size is not above 0.

    Examples
    --------
    >>> import voxgran as vg
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((9, 9, 9)), "rsa", count=5, sizes=vg.sizes.fixed(2.0))
    >>> bed.diameters.tolist()
    [2.0, 2.0, 2.0, 2.0, 2.0]
    """
    return Fixed(diameter=as_number(diameter, "diameter"))


@explained(hint="uniform(0.8, 1.2)")
def uniform(low: float, high: float, *, basis: Basis = "number", independent: bool = False) -> Uniform:
    """Return the uniform distribution between two sizes; `basis` and `independent` as in :func:`lognormal`.

    Raises
    ------
    InputError
        If a size is not above 0, or the largest not above the smallest.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.sizes.uniform(0.8, 1.2, basis="volume").basis
    'volume'
    """
    return Uniform(low=as_number(low, "low"), high=as_number(high, "high"), basis=basis, independent=independent)


@explained(hint="fuller(0.1, 32.0)")
def fuller(
    low: float, high: float, exponent: float = 0.5, *, basis: Basis = "volume", independent: bool = False
) -> Fuller:
    """Return the power law of concrete and asphalt, with a limit of fines.

    Parameters
    ----------
    low, high : float
        Smallest and largest size, in the unit of lengths.
    exponent : float
        Exponent n of the share (d^n - low^n) / (high^n - low^n) below the size d: 0.5 after Fuller, 0.45 for asphalt.
    basis : {"number", "volume"}
        Quantity that the shares refer to.
    independent : bool
        Whether each size is drawn independently of the others.

    Raises
    ------
    InputError
        If a number is not above 0, or the largest size not above the smallest.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(float(vg.sizes.fuller(0.1, 32.0).quantile(0.5)), 2)
    8.92
    """
    low, high, exponent = as_number(low, "low"), as_number(high, "high"), as_number(exponent, "exponent")
    return Fuller(low=low, high=high, exponent=exponent, basis=basis, independent=independent)


@explained(hint="rosin_rammler(10.0, 1.5, low=1.0)")
def rosin_rammler(
    size: float,
    spread: float,
    *,
    low: float | None = None,
    high: float | None = None,
    basis: Basis = "volume",
    independent: bool = False,
) -> RosinRammler:
    """Return the distribution of Rosin and Rammler (Weibull), which describes crushed and ground material.

    Parameters
    ----------
    size : float
        Size below which 63.2 % lie before truncation, in the unit of lengths.
    spread : float
        Exponent n of the share 1 - exp(-(d / size)^n) below the size d.
    low, high : float, optional
        Lower and upper truncation, in the unit of lengths. By volume the fines need `low` for a spread below 6.
    basis : {"number", "volume"}
        Quantity that the shares refer to.
    independent : bool
        Whether each size is drawn independently of the others.

    Raises
    ------
    InputError
        If a number is not above 0, the cuts leave nothing, or without `low` the fines are infinitely many.

    Examples
    --------
    >>> import voxgran as vg
    >>> round(float(vg.sizes.rosin_rammler(10.0, 1.5, low=1.0).cumulative(10.0)), 3)
    0.62
    """
    return RosinRammler(
        size=as_number(size, "size"),
        spread=as_number(spread, "spread"),
        low=None if low is None else as_number(low, "low"),
        high=None if high is None else as_number(high, "high"),
        basis=basis,
        independent=independent,
    )


@explained(hint="mixture([uniform(1, 2, basis='volume'), uniform(4, 8, basis='volume')], [0.3, 0.7])")
def mixture(
    parts: Sequence[SizeDistribution], shares: "ArrayLike", *, basis: Basis = "volume", independent: bool = False
) -> Mixture:
    """Return several distributions together, such as a sand and a gravel.

    Parameters
    ----------
    parts : sequence of SizeDistribution
        Distributions of the same basis.
    shares : array_like of float
        Share of each.
    basis : {"number", "volume"}
        Quantity that the shares refer to.
    independent : bool
        Whether each size is drawn independently of the others.

    Raises
    ------
    InputError
        If the numbers of distributions and shares differ, a basis is another one, a share is negative or all are 0.

    Examples
    --------
    >>> import voxgran as vg
    >>> sand = vg.sizes.lognormal(0.5, 0.3, basis="volume")
    >>> gravel = vg.sizes.fuller(4.0, 16.0)
    >>> round(float(vg.sizes.mixture([sand, gravel], [0.3, 0.7]).cumulative(4.0)), 6)
    0.3
    """
    check_type(parts, (list, tuple), "parts", "a list of distributions such as [vg.sizes.fuller(1, 2)]")
    return Mixture(parts=tuple(parts), shares=_numbers(shares), basis=basis, independent=independent)


@explained(hint="discrete([1.0, 2.0], [3, 1])")
def discrete(
    diameters: "ArrayLike", weights: "ArrayLike", *, basis: Basis = "number", independent: bool = False
) -> Discrete:
    """Return a discrete distribution: a few sizes, each with its weight; `basis` and `independent` as in
    :func:`lognormal`.

    Raises
    ------
    InputError
        If the numbers of sizes and weights differ, a size is not above 0, a weight is negative or all are 0.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> sizes = vg.sizes.discrete([1, 2], [3, 1])
    >>> bed = vg.pack(vg.shapes.sphere(), vg.Box((9, 9, 9)), "rsa", count=40, sizes=sizes)
    >>> np.unique(bed.diameters).tolist()
    [1.0, 2.0]
    """
    return Discrete(diameters=_numbers(diameters), weights=_numbers(weights), basis=basis, independent=independent)


@explained(hint="sieve([1.0, 2.0, 4.0], [0, 40, 100])")
def sieve(
    openings: Any,
    passing: "ArrayLike | None" = None,
    *,
    retained: "ArrayLike | None" = None,
    smallest: float | None = None,
    unit: str | None = None,
    as_diameter: bool = False,
    basis: Basis = "volume",
    independent: bool = False,
) -> Sieve:
    """Return the distribution of a sieve analysis.

    Parameters
    ----------
    openings : (n,) array_like of float, path-like, pandas.DataFrame, pandas.Series or mapping
        Openings of the sieves, in any order, in the unit of lengths; 0 is the pan. Or a table, or a CSV file of one,
        with a column ``opening`` and a column ``passing`` or ``retained``, or a series of what passes by the opening.
    passing : (n,) array_like of float, optional
        What passes each sieve: shares up to 1, or percent up to 100; interpolated linearly in the logarithm of the
        opening.
    retained : (n,) array_like of float, optional
        Instead of `passing`, what each sieve retains: masses, shares or percent; their sum is all.
    smallest : float, optional
        Smallest size, where the smallest sieve lets something pass. Default: as if one sieve finer, of the same ratio,
        were passed by nothing, with a warning.
    unit : str, optional
        Unit of all other lengths, where a table names the unit of its openings, as ``opening [um]``.
    as_diameter : bool
        Whether openings are equivalent diameters rather than intermediate axes.
    basis : {"number", "volume"}
        Quantity that the shares refer to.
    independent : bool
        Whether each size is drawn independently of the others.

    Raises
    ------
    InputError
        If fewer than two sieves are given, two have one opening, passing falls or does not reach 1 or 100 percent, a
        mass is negative, or a table has openings in a unit and `unit` is missing.
    MissingFileError
        If there is no such file.
    FileFormatError
        If a table lacks a column, or a value is no number; the message names its row.

    Examples
    --------
    >>> import voxgran as vg
    >>> curve = vg.sizes.sieve(openings=[1.0, 2.0, 4.0], passing=[0, 40, 100])
    >>> curve.passing
    (0.0, 0.4, 1.0)
    >>> vg.sizes.sieve([4.0, 2.0, 1.0], retained=[0, 180, 120]) == curve
    True
    """
    curve: dict[str, Any] = {"openings": openings, "passing": passing, "retained": retained}
    if isinstance(openings, str | os.PathLike):
        curve = {"file": os.fspath(openings), "unit": unit}
    elif isinstance(openings, Mapping) or hasattr(openings, "iloc"):
        curve = dict(curve_in_table(openings, unit))
    else:
        curve = {name: None if value is None else _numbers(value) for name, value in curve.items()}
    low = None if smallest is None else as_number(smallest, "smallest")
    return Sieve(**curve, smallest=low, as_diameter=as_diameter, basis=basis, independent=independent)


def _numbers(values: "ArrayLike") -> tuple[float, ...]:
    """Return a list of numbers as a tuple."""
    return tuple(as_floats(values, "list of sizes or shares", shape=(None,)).tolist())


@explained(hint="size_kinds()")
def size_kinds() -> tuple[str, ...]:
    """Return the kinds of distributions, the values of `kind` in scene files.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.sizes.size_kinds()
    ('discrete', 'fixed', 'fuller', 'lognormal', 'mixture', 'rosin_rammler', 'sieve', 'uniform')
    """
    return tuple(sorted(KINDS))


@explained(hint='make_sizes({"kind": "uniform", "low": 0.8, "high": 1.2})')
def make_sizes(mapping: Mapping[str, Any], where: str = "[sizes]") -> SizeDistribution:
    """Make a distribution from kind and parameters, as in scene files.

    Parameters
    ----------
    mapping : mapping
        ``kind`` and the parameters of that kind.
    where : str
        Name of the mapping in messages.

    Returns
    -------
    SizeDistribution

    Raises
    ------
    UnknownNameError
        If the kind or a parameter is not known.
    InputError
        If the kind is missing, or a parameter is missing or invalid.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.sizes.make_sizes({"kind": "uniform", "low": 0.8, "high": 1.2}) == vg.sizes.uniform(0.8, 1.2)
    True
    """
    law, values = kind_of(mapping, KINDS, where, example="{'kind': 'fixed', 'diameter': 1.0}")
    if law is Mixture and isinstance(values.get("parts"), list | tuple):
        values["parts"] = [make_sizes(part, f"{where} parts") for part in values["parts"]]
    return from_mapping(law, values, where)


#: classes of distributions by kind
KINDS: dict[str, type[SizeDistribution]] = {
    law.kind: law for law in (Discrete, Fixed, Fuller, Lognormal, Mixture, RosinRammler, Sieve, Uniform)
}


def size_distance(asked: Floats, placed: Floats) -> float:
    """Return the largest difference of the shares of grains up to a size (Kolmogorov and Smirnov); 0 without grains.

    Examples
    --------
    >>> import numpy as np
    >>> import voxgran as vg
    >>> round(vg.sizes.size_distance(np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, 2.0, 3.0, 3.0])), 6)
    0.25
    """
    if not len(asked) or not len(placed):
        return 0.0
    asked, placed = np.sort(asked), np.sort(placed)
    # sizes that differ by rounding are one size
    sizes = np.unique(asked) * (1 + 1e-9)
    share = np.searchsorted(asked, sizes, side="right") / len(asked)
    share -= np.searchsorted(placed, sizes, side="right") / len(placed)
    return float(np.abs(share).max())
