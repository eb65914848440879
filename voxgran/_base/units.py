"""Units of length: which are known, how they are written, and how many of one make another."""

from collections.abc import Iterable
from fractions import Fraction

from voxgran._base.errors import InputError, UnknownNameError, nearest, shown, unknown

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
#: names in full, in the singular
_NAMES = {
    "kilometre": "km",
    "metre": "m",
    "decimetre": "dm",
    "centimetre": "cm",
    "millimetre": "mm",
    "micrometre": "um",
    "micron": "um",
    "nanometre": "nm",
    "picometre": "pm",
    "inche": "inch",
}


def as_unit(value: object, name: str = "unit") -> str:
    """Return a unit of length by its usual name, ``"1"`` for None or ``"1"``.

    Known are ``"km"``, ``"m"``, ``"dm"``, ``"cm"``, ``"mm"``, ``"um"`` or ``"µm"``, ``"nm"``, ``"pm"``, ``"inch"`` or
    ``"in"``, and ``"angstrom"``.

    Raises
    ------
    InputError
        If it is not text.
    UnknownNameError
        If the unit is unknown; the message gives the nearest one.
    """
    if value is None:
        return NO_UNIT
    if not isinstance(value, str):
        raise InputError(f"{name} is {shown(value)}: it must be the name of a unit of length, such as 'mm'")
    found = known_unit(value)
    if found is None and value.strip() != NO_UNIT:
        # names in full are suggested, not accepted: one spelling is written into files
        word = value.strip().casefold().removesuffix("s").replace("meter", "metre")
        raise UnknownNameError(unknown(name, value, (NO_UNIT, *_METRES), meant=_NAMES.get(nearest(word, _NAMES) or "")))
    return found or NO_UNIT


def stated_unit(value: object) -> str | None:
    """Return a unit of length as :func:`as_unit` does, but None if none is given."""
    unit = as_unit(value, "unit")
    return None if unit == NO_UNIT else unit


def known_unit(told: object) -> str | None:
    """Return the usual name of the unit of length stated in a file; None if it is missing or unknown."""
    text = told.strip() if isinstance(told, str) else NO_UNIT
    found = _SPELLINGS.get(text, text)
    return found if found in _METRES else None


def unit_factor(source: str, target: str) -> float:
    """Return the factor that converts lengths between units as :func:`as_unit` returns them: 1000.0 from ``"m"`` to
    ``"mm"``.

    Raises
    ------
    InputError
        If one of them has no unit and the other has.
    """
    if source == target:
        return 1.0
    if NO_UNIT in (source, target):
        known = target if source == NO_UNIT else source
        raise InputError(f"lengths without a unit cannot be converted to or from {known}: give both the same unit")
    return float(_METRES[source] / _METRES[target])


def common_unit(asked: str | None, units: Iterable[str | None], what: str) -> str:
    """Return the requested unit, as :func:`as_unit` takes it, or else the only known one of `units`, ``"1"`` without
    any.

    `what` is the name of the objects with these units in messages.

    Raises
    ------
    InputError
        If none is requested and several are known.
    """
    chosen = as_unit(asked)
    known = sorted({unit for unit in units if unit is not None} - {NO_UNIT})
    if chosen != NO_UNIT or not known:
        return chosen
    if len(known) > 1:
        raise InputError(f"{what} have lengths in {' and '.join(known)}: give unit, that of all other lengths")
    return known[0]
