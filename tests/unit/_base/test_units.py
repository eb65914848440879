"""Units of length: names, factors, and the one unit of what is put together."""

import pytest

from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.units import as_unit, common_unit, known_unit, stated_unit, unit_factor


@pytest.mark.parametrize(
    ("given", "written"),
    [("mm", "mm"), (" km ", "km"), ("in", "inch"), ("inch", "inch"), ("\u00b5m", "um"), ("\u03bcm", "um"), ("um", "um")]
    + [(name, name) for name in ("m", "dm", "cm", "nm", "pm", "angstrom")]
    + [("\u00c5", "angstrom"), ("1", "1"), (None, "1")],
)
def test_known_units_have_one_spelling(given, written):
    assert as_unit(given) == written
    assert stated_unit(given) == (None if written == "1" else written)
    assert known_unit(given) == (None if written == "1" else written)


@pytest.mark.parametrize(("given", "words"), [("milimetre", "did you mean 'mm'"), ("Mm", "did you mean 'mm'|'m'|'pm'")])
def test_the_nearest_unit_is_named(given, words):
    with pytest.raises(UnknownNameError, match=words):
        as_unit(given)


def test_what_is_no_unit_is_refused():
    with pytest.raises(UnknownNameError, match=r"\[scene\] unit 'furlong' is unknown: known are 1, angstrom, cm, .*um"):
        as_unit("furlong", "[scene] unit")
    with pytest.raises(UnknownNameError, match="unit '' is unknown"):
        as_unit("")
    for wrong in (3, 1.0, True, ["mm"]):
        with pytest.raises(InputError, match="must be the name of a unit of length"):
            as_unit(wrong)
    assert known_unit("furlong") is None
    assert known_unit(3) is None


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [
        ("mm", "m", 1e-3),
        ("m", "mm", 1e3),
        ("cm", "um", 1e4),
        ("inch", "mm", 25.4),
        ("km", "nm", 1e12),
        ("angstrom", "nm", 0.1),
        ("dm", "dm", 1.0),
        ("1", "1", 1.0),
    ],
)
def test_factors_are_the_nearest_numbers(source, target, factor):
    assert unit_factor(source, target) == factor


@pytest.mark.parametrize("pair", [("1", "mm"), ("mm", "1")])
def test_nothing_is_converted_to_or_from_no_unit(pair):
    with pytest.raises(InputError, match="lengths without a unit cannot be converted to or from mm"):
        unit_factor(*pair)


def test_the_one_unit_of_several_things():
    assert common_unit(None, [None, "mm", "mm", "1"], "shapes") == "mm"
    assert common_unit("1", [None], "shapes") == "1"
    assert common_unit("\u00b5m", ["mm", "m"], "shapes") == "um"
    with pytest.raises(InputError, match="shapes have lengths in m and mm: give unit"):
        common_unit(None, ["mm", "m"], "shapes")
