"""Parameter classes from mappings and back."""

from dataclasses import dataclass
from typing import Literal

import pytest

from voxgran._base.config import from_mapping, parameter, parameters_of, to_mapping
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
        ({"name": 3}, "must be text"),
        ({"name": "a", "sweeps": 1.5}, "whole number"),
        ({"name": "a", "sweeps": True}, "whole number"),
        ({"name": "a", "cover": "touchh"}, "'touch', 'center'"),
        ({"name": "a", "range": [1.0]}, "list of 2"),
        ({"name": "a", "voxel_size": "big"}, "a number or left out"),
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
