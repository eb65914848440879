"""Units of length: which are known, how they are written, and how many of one make another."""

from collections.abc import Iterable
from fractions import Fraction

from voxgran._base.errors import InputError, UnknownNameError, shown
from voxgran._base.registry import unknown

#: no unit is known
NO_UNIT = "1"
#: powers of ten of the prefixes of SI that grains are measured in; "Mm" is more likely a mistyped "mm"
_PREFIXES = {"k": 3, "": 0, "d": -1, "c": -2, "m": -3, "u": -6, "n": -9, "p": -12}
#: lengths in metres
_METRES = {
    **{f"{prefix}m": Fraction(10) ** power for prefix, power in _PREFIXES.items()},
    "inch": Fraction(254, 10000),
    "angstrom": Fraction(1, 10**10),
}
#: other spellings
_SPELLINGS = {"in": "inch", "\u00b5m": "um", "\u03bcm": "um", "\u00c5": "angstrom", "\u212b": "angstrom"}


def as_unit(value: object, name: str = "unit") -> str:
    """Return a unit of length as it is written throughout, ``"1"`` where none is given.

    Parameters
    ----------
    value : str or None
        ``"km"``, ``"m"``, ``"dm"``, ``"cm"``, ``"mm"``, ``"um"`` or ``"µm"``, ``"nm"``, ``"pm"``, ``"inch"`` or
        ``"in"``, ``"angstrom"``; ``"1"`` or None for none.
    name : str
        What the message calls it.

    Returns
    -------
    str

    Raises
    ------
    InputError
        If it is no text.
    UnknownNameError
        If the unit is unknown; the message gives the nearest one.
    """
    if value is None:
        return NO_UNIT
    if not isinstance(value, str):
        raise InputError(f"{name} is {shown(value)}: it must be the name of a unit of length, such as 'mm'")
    found = known_unit(value)
    if found is None and value.strip() != NO_UNIT:
        raise UnknownNameError(unknown(name, value, (NO_UNIT, *_METRES)))
    return found or NO_UNIT


def stated_unit(value: object, name: str = "unit") -> str | None:
    """Return a unit of length as :func:`as_unit` does, but None where none is given.

    Raises
    ------
    InputError
        If it is no text.
    UnknownNameError
        If the unit is unknown; the message gives the nearest one.
    """
    unit = as_unit(value, name)
    return None if unit == NO_UNIT else unit


def known_unit(told: object) -> str | None:
    """Return the unit of length that a file tells, as it is written throughout; None where it tells no known one."""
    text = told.strip() if isinstance(told, str) else NO_UNIT
    found = _SPELLINGS.get(text, text)
    return found if found in _METRES else None


def unit_factor(source: str, target: str) -> float:
    """Return by what lengths in one unit are multiplied to be lengths in another.

    Parameters
    ----------
    source, target : str
        As :func:`as_unit` returns them.

    Raises
    ------
    InputError
        If one of them has no unit and the other has.

    Examples
    --------
    >>> unit_factor("m", "mm"), unit_factor("inch", "mm")
    (1000.0, 25.4)
    """
    if source == target:
        return 1.0
    if NO_UNIT in (source, target):
        known = target if source == NO_UNIT else source
        raise InputError(f"lengths without a unit cannot be converted to or from {known}: give both the same unit")
    return float(_METRES[source] / _METRES[target])


def common_unit(asked: str | None, units: Iterable[str | None], what: str) -> str:
    """Return the unit that is asked for, or else the only one that is known, ``"1"`` where there is none.

    Parameters
    ----------
    asked : str or None
        As :func:`as_unit` takes it.
    units : iterable of str or None
        Units of what is put together.
    what : str
        What the message calls that.

    Raises
    ------
    InputError
        If none is asked for and there are several.
    """
    chosen = as_unit(asked)
    known = sorted({unit for unit in units if unit is not None} - {NO_UNIT})
    if chosen != NO_UNIT or not known:
        return chosen
    if len(known) > 1:
        raise InputError(f"{what} have lengths in {' and '.join(known)}: give unit, that of all other lengths")
    return known[0]
