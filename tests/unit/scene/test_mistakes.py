"""Mistakes of a scene are found together, and keys of another section are named."""

from typing import Any

import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError


def scene(**sections: Any) -> vg.Scene:
    usual = {
        "shape": [{"family": "sphere"}],
        "container": {"kind": "box", "lengths": [4, 4, 4]},
        "packing": {"method": "gravity", "count": 3},
    }
    return vg.Scene.from_mapping(usual | sections)


@pytest.mark.parametrize(
    ("section", "key", "right"),
    [
        ("packing", "seed", r"\[scene\]"),
        ("packing", "vtk", r"\[output\]"),
        ("scene", "method", r"\[packing\]"),
        ("measure", "report", r"\[output\]"),
        ("output", "which", r"\[measure\]"),
    ],
)
def test_a_key_of_another_section_names_that_section(section: str, key: str, right: str) -> None:
    given = {"packing": {"method": "gravity", "count": 3}, "scene": {}, "measure": {}, "output": {}}[section]
    with pytest.raises(UnknownNameError, match=rf"\[{section}\] key '{key}' is unknown: it is a key of {right}"):
        scene(**{section: {**given, key: 1}})


def test_unknown_keys_of_packing_list_those_of_every_method_once() -> None:
    with pytest.raises(UnknownNameError, match="did you mean 'shaking'") as caught:
        scene(packing={"method": "gravity", "count": 3, "shakin": 1})
    listed = str(caught.value).partition("known are ")[2].split(", ")
    assert {"count", "method", "solid_fraction", "start", "shaking"} <= set(listed)
    assert len(listed) == len(set(listed))


def test_mistakes_of_several_sections_are_told_together() -> None:
    with pytest.raises(InputError) as caught:
        scene(
            scene={"sed": 1},
            shape=[{"family": "spere"}],
            container={"kind": "bx", "lengths": [4, 4, 4]},
            sizes={"share_by": "mass"},
            packing={"method": "gravty", "count": 3},
            measure={"which": ["rdff"]},
            material={"frction": 1},
            output={"snapshot": 3},
        )
    text = str(caught.value)
    assert text.startswith("the scene has 8 mistakes: (1) [scene] key 'sed'")
    for typed in ("spere", "bx", "mass", "gravty", "rdff", "frction", "snapshot"):
        assert f"'{typed}'" in text
    assert "\n" not in text


@pytest.mark.parametrize("method", ["digital", "digitl"])
def test_mistakes_of_what_becomes_of_the_grains_are_told_with_the_others(method: str) -> None:
    with pytest.raises(InputError, match=r"the scene has \d mistakes") as caught:
        scene(
            container={"kind": "box", "lengths": [4, 4, -4]},
            packing={"method": method, "count": 3},
            settle={"frictoin": 0.5},
            compress={"friction": -1},
            material={"yung": 1e7},
        )
    told = str(caught.value)
    assert all(name in told for name in ("'frictoin'", "[compress] friction is -1", "'yung'", "[container]"))
    assert ("'digitl'" in told) == (method == "digitl")


def test_a_value_that_breaks_a_rule_names_its_section() -> None:
    with pytest.raises(InputError, match=r"^\[settle\] friction is 9"):
        scene(packing={"method": "digital", "count": 3}, settle={"friction": 9.0})


def test_missing_sections_are_told_together() -> None:
    with pytest.raises(InputError, match=r"2 mistakes: \(1\) \[\[shape\]\] is missing.*\(2\) \[container\] is missing"):
        vg.Scene.from_mapping({"packing": {"method": "rsa", "count": 3}})
    with pytest.raises(UnknownNameError, match="'sape' is unknown: did you mean 'shape'"):
        vg.Scene.from_mapping({"sape": [], "packing": {"method": "rsa", "count": 3}})


def test_one_mistake_keeps_its_own_error() -> None:
    with pytest.raises(UnknownNameError, match=r"^\[scene\] key 'sed' is unknown: did you mean 'seed'"):
        scene(scene={"sed": 1})


def test_values_of_sizes_and_containers_name_their_section() -> None:
    with pytest.raises(InputError, match=r"^\[container\] lengths has shape \(2,\)"):
        scene(container={"kind": "box", "lengths": [5, 5]})
    with pytest.raises(InputError, match=r"^\[sizes\] high is 0.5: it must be finite and above 1.5"):
        scene(sizes={"kind": "uniform", "low": 1.5, "high": 0.5})
    with pytest.raises(
        InputError, match=r"\[output\] dem is 'lamps': it must be a list, each entry text; write \['lamps'\]"
    ):
        scene(output={"dem": "lamps"})
