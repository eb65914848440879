"""Parameter classes from mappings and back."""

import importlib
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest

import voxgran
import voxgran as vg
from voxgran._base.config import (
    check_bounds,
    document,
    from_mapping,
    is_parameter_class,
    parameter,
    parameter_class,
    parameters_of,
    to_mapping,
)
from voxgran._base.errors import InputError, UnknownNameError


@dataclass(frozen=True, kw_only=True, slots=True)
class Example:
    voxel_size: float | None = parameter(None, doc="edge of a voxel", unit="length")
    cover: Literal["touch", "center"] = parameter("touch", doc="which voxels")
    sweeps: int = parameter(10, doc="attempts per grain")
    range: tuple[float, float] = parameter((1.0, 2.0), doc="from and to")
    name: str = parameter(doc="must be given")


def test_round_trip():
    made = from_mapping(Example, {"name": "a", "voxel_size": 1, "range": [3, 4]}, "[packing]")
    assert made == Example(name="a", voxel_size=1.0, range=(3.0, 4.0))
    assert isinstance(made.voxel_size, float)
    assert from_mapping(Example, to_mapping(made), "[packing]") == made


def test_unknown_key_names_the_nearest():
    with pytest.raises(UnknownNameError, match=r"\[packing\] key 'voxel_sizee' is unknown: did you mean 'voxel_size'"):
        from_mapping(Example, {"name": "a", "voxel_sizee": 1.0}, "[packing]")


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({}, "name is missing"),
        ({"name": 3}, "must be text; correct it"),
        ({"name": ["x", "y"]}, r"is \['x', 'y'\]: it must be text; write 'xy'"),
        ({"name": "a", "sweeps": 1.5}, "whole number"),
        ({"name": "a", "sweeps": True}, "whole number"),
        ({"name": "a", "cover": "touchh"}, "'touch', 'center'"),
        ({"name": "a", "range": [1.0]}, "list of 2"),
        ({"name": "a", "voxel_size": "big"}, "a number; or leave it out"),
    ],
)
def test_wrong_values_are_named(mapping, words):
    with pytest.raises(InputError, match=words):
        from_mapping(Example, mapping, "[packing]")


def test_parameters_carry_their_help():
    first = parameters_of(Example)[0]
    assert (first.name, first.doc, first.unit, first.default) == ("voxel_size", "edge of a voxel", "length", None)
    assert first.type_text == "a number"
    assert parameters_of(Example)[1].type_text == "one of 'touch', 'center'"


@parameter_class
class Told:
    """What has meanings in its docstring.

    Parameters
    ----------
    edge
        edge of a voxel; if omitted,
        a tenth.
    step
        length of a step.

    Raises
    ------
    InputError
        Never.
    """

    edge: float | None = parameter(None, unit="length", above=0.0)
    step: int = parameter(1, unit="voxels")
    #: where the docstring gives none
    cover: bool = parameter(False, doc="whether it covers")


@parameter_class
class ToldAndMore(Told):
    """What inherits meanings.

    Parameters
    ----------
    more
        one more.
    """

    more: int = parameter(3)


def test_meanings_stand_in_the_docstring_and_get_their_types_there():
    meanings = {
        "edge": "edge of a voxel; if omitted, a tenth",
        "step": "length of a step",
        "cover": "whether it covers",
    }
    assert {entry.name: entry.doc for entry in parameters_of(Told)} == meanings
    for _ in range(2):
        document(Told)
        assert "edge : a number above 0, optional\n        edge of a voxel; if omitted, a tenth.\n" in Told.__doc__
        assert "step : a whole number, default 1\n        length of a step, in voxels.\n" in Told.__doc__
        assert Told.__doc__.count("----------") == 1
        assert Told.__doc__.endswith("Raises\n    ------\n    InputError\n        Never.\n")
    # a class that is looked at after its base has its types
    assert {entry.name: entry.doc for entry in parameters_of(ToldAndMore)} == {"more": "one more"} | meanings


@parameter_class
class Written:
    """What has types in its docstring.

    Parameters
    ----------
    law : {"linear", "hertz"}
        Contact law.
    """

    law: Literal["linear", "hertz"] = parameter("linear")


def test_types_that_are_written_stay():
    before = Written.__doc__
    document(Written)
    assert Written.__doc__ == before
    assert parameters_of(Written)[0].doc == "Contact law"


def test_all_parameters_have_a_meaning_and_all_meanings_a_parameter():
    package = Path(voxgran.__file__).parent
    for file in sorted(package.rglob("*.py")):
        if " = parameter(" not in file.read_text():
            continue
        module = importlib.import_module(".".join(("voxgran", *file.relative_to(package).with_suffix("").parts)))
        for kind in vars(module).values():
            if isinstance(kind, type) and kind.__module__ == module.__name__ and is_parameter_class(kind):
                section = (kind.__doc__ or "").partition("Parameters\n")[2].partition("\n\n")[0]
                listed = re.findall(r"^ {4}(\w+)(?: :|$)", section, re.MULTILINE)
                entries = {entry.name: entry.doc for entry in parameters_of(kind)}
                assert set(listed) <= set(entries), kind
                assert all(entries.values()), kind


@dataclass(frozen=True, kw_only=True, slots=True)
class Bounded:
    share: float = parameter(0.5, doc="share", at_least=0.0, at_most=1.0)
    count: int | None = parameter(None, doc="count", at_least=1)
    size: tuple[float, ...] | float = parameter(1.0, doc="size", unit="length", above=0.0)

    def __post_init__(self):
        check_bounds(self)


@parameter_class
class Plain:
    cover: Literal["touch", "center"] | None = parameter("touch", doc="which voxels")
    along: Literal["x", "y"] | float = parameter("x", doc="along an axis, or at an angle")
    sweeps: int = parameter(10, doc="attempts per grain", at_most=20)


@parameter_class
class Own(Plain):
    def __post_init__(self):
        object.__setattr__(self, "sweeps", 7)


def test_objects_are_checked_by_what_their_class_declares_unless_it_has_a_check_of_its_own():
    assert Plain(cover=None, along=0.5).along == 0.5
    with pytest.raises(InputError, match="cover is 'all': it must be one of touch, center"):
        Plain(cover="all")
    with pytest.raises(InputError, match="sweeps is 21"):
        Plain(sweeps=21)
    assert Own(sweeps=21).sweeps == 7


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"share": 1.5}, "share is 1.5: it must be finite and at least 0 and at most 1"),
        ({"count": 0}, "count is 0: it must be a whole number, at least 1"),
        ({"size": 0.0}, "size is 0"),
        ({"size": [1.0, -1.0]}, "size is -1"),
        ({"size": 1e80}, "another unit of lengths"),
    ],
)
def test_bounds(mapping, words):
    with pytest.raises(InputError, match=words):
        from_mapping(Bounded, mapping, "here")


def test_help_shows_bounds():
    share, count, size = parameters_of(Bounded)
    assert share.type_text == "a number in [0, 1]"
    assert count.type_text == "a whole number at least 1"
    assert size.type_text.endswith("above 0")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: vg.Inlet(center=(20, 20)), r"inlet center is \(20, 20\): it must be a list of 3, each entry a number"),
        (lambda: vg.Inlet(center=("a", 1, 2)), "inlet center is .*: it must be a list of 3"),
        (lambda: vg.Inlet(lengths=3), "inlet lengths is 3: it must be a list of 2"),
        (lambda: vg.Inlet(rate=[1]), r"inlet rate is \[1\]: it must be a number"),
        (lambda: vg.methods.Compress(axes=["x", "y"]), "it must be text; write 'xy'"),
    ],
)
def test_lists_and_texts_are_checked_where_a_class_is_called(make, words):
    with pytest.raises(InputError, match=words):
        make()
