"""Openings of standard series of test sieves, in millimetres.

Sources
-------
ISO 565:1990 (series R 20/3, R 20 and R 40/3 of preferred numbers, ISO 3); ASTM E11-20 (numbers and openings); EN 933-2.
"""

from collections.abc import Callable, Sequence

from voxgran._base.arrays import check_type
from voxgran._base.calls import explained
from voxgran._base.errors import UnknownNameError, check_known

#: numbers of a decade of the series R 20 and R 40, as rounded for sieves
R20 = (1, 1.12, 1.25, 1.4, 1.6, 1.8, 2, 2.24, 2.5, 2.8, 3.15, 3.55, 4, 4.5, 5, 5.6, 6.3, 7.1, 8, 9)
R40 = (
    1, 1.06, 1.12, 1.18, 1.25, 1.32, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9, 2, 2.12, 2.24, 2.36, 2.5, 2.65, 2.8, 3,
    3.15, 3.35, 3.55, 3.75, 4, 4.25, 4.5, 4.75, 5, 5.3, 5.6, 6, 6.3, 6.7, 7.1, 7.5, 8, 8.5, 9, 9.5,
)  # fmt: skip
#: sieves of ASTM E11 by their names: inches above no. 3 1/2
ASTM = {
    "5 in": 125.0, "4.24 in": 106.0, "4 in": 100.0, "3 1/2 in": 90.0, "3 in": 75.0, "2 1/2 in": 63.0, "2.12 in": 53.0,
    "2 in": 50.0, "1 3/4 in": 45.0, "1 1/2 in": 37.5, "1 1/4 in": 31.5, "1.06 in": 26.5, "1 in": 25.0, "7/8 in": 22.4,
    "3/4 in": 19.0, "5/8 in": 16.0, "0.530 in": 13.2, "1/2 in": 12.5, "7/16 in": 11.2, "3/8 in": 9.5, "5/16 in": 8.0,
    "0.265 in": 6.7, "1/4 in": 6.3, "3 1/2": 5.6, "4": 4.75, "5": 4.0, "6": 3.35, "7": 2.8, "8": 2.36, "10": 2.0,
    "12": 1.7, "14": 1.4, "16": 1.18, "18": 1.0, "20": 0.85, "25": 0.71, "30": 0.6, "35": 0.5, "40": 0.425, "45": 0.355,
    "50": 0.3, "60": 0.25, "70": 0.212, "80": 0.18, "100": 0.15, "120": 0.125, "140": 0.106, "170": 0.09, "200": 0.075,
    "230": 0.063, "270": 0.053, "325": 0.045, "400": 0.038, "450": 0.032, "500": 0.025, "635": 0.02,
}  # fmt: skip


def _preferred(decade: Sequence[float], step: int) -> tuple[float, ...]:
    """Return every so many numbers of a series from 0.045 to 125, one of which is 1."""
    numbers = [round(number * 10.0**power, 6) for power in (-2, -1, 0, 1, 2) for number in decade]
    first = numbers.index(1.0) % step
    return tuple(number for number in numbers[first::step] if 0.045 <= number <= 125.0)


#: what makes each series, from the smallest opening to the largest
SERIES: dict[str, Callable[[], tuple[float, ...]]] = {
    "ISO 565": lambda: _preferred(R20, 3),
    "ISO 565 R20": lambda: _preferred(R20, 1),
    "ISO 565 R40/3": lambda: _preferred(R40, 3),
    "ASTM E11": lambda: tuple(sorted(ASTM.values())),
    "EN 933": lambda: (0.063, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 31.5, 63.0, 125.0),
}


@explained(hint='openings("ISO 565")')
def openings(series: str, numbers: "Sequence[int | str] | None" = None) -> tuple[float, ...]:
    """Return the openings of a standard series of test sieves, in millimetres.

    Parameters
    ----------
    series : str
        ``"ISO 565"`` (its main series R 20/3), ``"ISO 565 R20"``, ``"ISO 565 R40/3"``, ``"ASTM E11"`` or ``"EN 933"``.
    numbers : sequence of int or str, optional
        Sieves of ASTM E11 in the order of the result: numbers such as 200, or inches such as ``"3/8 in"``.
        Default: all.

    Returns
    -------
    tuple of float
        From the smallest to the largest; with `numbers` in their order.

    Raises
    ------
    UnknownNameError
        If the series or a sieve is not known.
    InputError
        If the series is no text.

    Examples
    --------
    >>> import voxgran as vg
    >>> vg.sizes.openings("ISO 565")[-5:]
    (31.5, 45.0, 63.0, 90.0, 125.0)
    >>> vg.sizes.openings("ASTM E11", [200, 40, 10, 4, "3/8 in"])
    (0.075, 0.425, 2.0, 4.75, 9.5)
    """
    check_type(series, str, "series", "a name such as 'ISO 565'")
    check_known("series", series, SERIES)
    if numbers is None:
        return SERIES[series]()
    check_type(numbers, (list, tuple, range), "numbers", "a list such as [200, 40, 10]")
    if series != "ASTM E11":
        raise UnknownNameError(
            f"numbers are given for {series}: only the sieves of ASTM E11 have numbers; leave them out"
        )
    for number in numbers:
        check_type(number, (int, str), "sieve of ASTM E11", "a number such as 200, or inches such as '3/8 in'")
    names = [str(number).lower().removeprefix("no.").strip() for number in numbers]
    for name in names:
        check_known("sieve of ASTM E11", name, ASTM)
    return tuple(ASTM[name] for name in names)
