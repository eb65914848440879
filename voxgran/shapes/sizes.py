"""Distributions of grain sizes, by name: ``vg.sizes.lognormal(median=2.0, sigma=0.3)``.

A size is an equivalent diameter; for a sieve curve it is the intermediate axis by default. The classes are
in :mod:`voxgran.shapes.size_laws`.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from voxgran._base import missing_names
from voxgran._base.arrays import Floats, as_floats, as_number, check_type
from voxgran._base.calls import explained
from voxgran._base.config import from_mapping
from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.names import unknown
from voxgran.shapes.size_laws import Basis, Discrete, Fixed, Lognormal, Sieve, SizeDistribution, Uniform

__all__ = [
    "SizeDistribution",
    "discrete",
    "fixed",
    "lognormal",
    "make_sizes",
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
def uniform(low: float, high: float, *, basis: Basis = "number") -> Uniform:
    """Return the uniform distribution between two sizes.

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
    return Uniform(low=as_number(low, "low"), high=as_number(high, "high"), basis=basis)


@explained(hint="discrete([1.0, 2.0], [3, 1])")
def discrete(diameters: "ArrayLike", weights: "ArrayLike", *, basis: Basis = "number") -> Discrete:
    """Return a discrete distribution: a few sizes, each with its weight.

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
    return Discrete(diameters=_numbers(diameters), weights=_numbers(weights), basis=basis)


@explained(hint="sieve([1.0, 2.0, 4.0], [0.0, 0.4, 1.0])")
def sieve(openings: "ArrayLike", passing: "ArrayLike", *, as_diameter: bool = False, basis: Basis = "volume") -> Sieve:
    """Return the distribution of a sieve analysis.

    Parameters
    ----------
    openings : (n,) array_like of float
        Openings of the sieves, from small to large, in the unit of lengths.
    passing : (n,) array_like of float
        Share that passes each sieve, from 0 to 1; interpolated linearly in the logarithm of the opening.
    as_diameter : bool
        Whether openings are equivalent diameters rather than intermediate axes.
    basis : {"number", "volume"}
        Quantity that the shares refer to.

    Raises
    ------
    InputError
        If openings do not increase or shares do not rise from 0 to 1.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.sizes.sieve(openings=[1.0, 2.0, 4.0], passing=[0.0, 0.4, 1.0]).basis
    'volume'
    """
    return Sieve(openings=_numbers(openings), passing=_numbers(passing), as_diameter=as_diameter, basis=basis)


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
    ('discrete', 'fixed', 'lognormal', 'sieve', 'uniform')
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
    check_type(mapping, Mapping, where, "a mapping with a kind, such as {'kind': 'fixed', 'diameter': 1.0}")
    values = dict(mapping)
    if "kind" not in values:
        raise InputError(f"{where} kind is missing: it must be one of {', '.join(size_kinds())}; add it")
    kind = values.pop("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        raise UnknownNameError(unknown(f"{where} kind", kind, KINDS))
    return from_mapping(KINDS[kind], values, where)


#: classes of distributions by kind
KINDS: dict[str, type[SizeDistribution]] = {law.kind: law for law in (Discrete, Fixed, Lognormal, Sieve, Uniform)}


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
