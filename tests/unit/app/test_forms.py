"""Forms of scenes: what a file says survives them, each kind has its fields, and texts are values of TOML."""

import json
import tomllib
from pathlib import Path

import pytest

import voxgran as vg
from voxgran.app import forms
from voxgran.containers.model import container_registry
from voxgran.packing.method import method_registry
from voxgran.scene.checked_sections import read_toml
from voxgran.shapes.family import families

pytest.importorskip("tomli_w")

EXAMPLES = Path(__file__).parents[3] / "examples"
SCENES = sorted(path.name for path in EXAMPLES.glob("*.toml") if not path.name.startswith("study"))


def plain(mapping):
    """Return a mapping as JSON, in which tuples are lists."""
    return json.loads(json.dumps(mapping))


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_survives_its_forms(name):
    given = read_toml(EXAMPLES / name)
    made = forms.rest_of(given) | forms.mapping_of(forms.forms_of(given))
    assert vg.Scene.from_mapping(made, folder=EXAMPLES).to_mapping() == vg.Scene.from_toml(EXAMPLES / name).to_mapping()
    # what a file leaves out stays out
    assert plain(made) == plain({key: value for key, value in given.items() if value != {}})


@pytest.mark.parametrize(
    "value", [1, 0.25, True, "lognormal", [3, 6], [[0, 0], [1.5, 2]], {"min": 1, "max": 2.5}, ["x", "y"], "a b"]
)
def test_a_value_survives_its_text(value):
    field = {"text": forms.text_of(value), "word": isinstance(value, str)}
    assert forms.value_of(field) == value


def test_a_text_that_is_no_toml_is_a_word():
    assert forms.value_of({"text": "sixty", "word": False}) == "sixty"
    assert forms.value_of({"text": "12", "word": True}) == "12"
    assert forms.value_of({"text": "[x]", "word": True}) == "[x]"


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("0.1\n0.2\n0.4\n", [0.1, 0.2, 0.4]),
        ("0,1\n0,25", [0.1, 0.25]),
        ("0.1\t0.2\t0.4", [0.1, 0.2, 0.4]),
        ("1\t2\n3\t4", [[1, 2], [3, 4]]),
        ("0.5", 0.5),
        ("0,5", 0.5),
        ("[1, 2]", [1, 2]),
        ("1,2,3", [1, 2, 3]),
        ("0.063,12.5\n2,100", [[0.063, 12.5], [2, 100]]),
        ("opening\tpassing\n0,063\t12,5 %\n2\t100 %", [[0.063, 12.5], [2, 100]]),
        ("opening;passing\n0,063;12,5\n2;100", [[0.063, 12.5], [2, 100]]),
        ("one\ntwo", "one\ntwo"),
    ],
)
def test_columns_of_a_spreadsheet_are_pasted(text, value):
    assert forms.value_of({"text": text, "word": False}) == value


def test_the_columns_of_a_pasted_table_go_to_fields_of_their_own():
    form = next(form for form in forms.forms_of({"sizes": {"kind": "sieve"}}) if form["name"] == "sizes")
    fields = {field["name"]: field for field in form["fields"]}
    fields["openings"]["text"] = "opening\tpassing\n0,063\t12,5\n2\t100"
    assert forms.spread(form)
    assert forms.mapping_of([form])["sizes"] == {"kind": "sieve", "openings": [0.063, 2], "passing": [12.5, 100]}
    assert not forms.spread(form)
    # three columns have no room from the second field on, and the rows of other lists stay rows
    fields["retained"]["text"] = "1\t2\n3\t4"
    assert not forms.spread(form)
    assert fields["openings"]["text"] == "0.063\n2.0"
    fields["openings"]["text"] = "0,063\t12,5\n2"
    assert not forms.spread(form)


def kinds():
    """Return section and kind of each form that a registry gives."""
    found = [("shape", "family", name) for name in families().names()]
    found += [("container", "kind", name) for name in container_registry().names()]
    return found + [("packing", "method", name) for name in method_registry().names()]


@pytest.mark.parametrize(("section", "key", "kind"), kinds())
def test_each_kind_has_its_fields(section, key, kind):
    given = {section: [{key: kind}] if section == "shape" else {key: kind}}
    form = next(form for form in forms.forms_of(given) if form["name"] == section)
    assert form["kind"] == kind
    names = [field["name"] for field in form["fields"]]
    assert names
    assert len(set(names)) == len(names)
    # an empty form is the kind alone
    made = forms.mapping_of([form])[section]
    assert (made[0] if section == "shape" else made) == {key: kind}


def test_fields_say_meaning_unit_choices_and_default():
    form = next(form for form in forms.forms_of({"settle": {}}) if form["name"] == "settle")
    assert form["on"]
    fields = {field["name"]: field for field in form["fields"]}
    assert fields["friction"]["meaning"]
    assert fields["enabled"]["choices"] == ["true", "false"]
    assert tomllib.loads(f"v = {fields['rest']['default']}")["v"] > 0


@pytest.mark.parametrize("container", [{}, {"container": {"kind": "box", "lengths": [9, 9, 9]}}])
@pytest.mark.parametrize("protocol", [{}, {"protocol": "compress", "friction": 0.2}])
def test_a_twin_survives_its_form_alone(container, protocol):
    given = {"twin": {"sample": "scan.vtp", "count": 9} | protocol, "output": {"report": False}} | container
    made = forms.forms_of(given)
    form = next(form for form in made if form["name"] == "twin")
    assert form["on"]
    names = {field["name"] for field in form["fields"]}
    assert {"sample", "voxel_size"} <= names
    assert ("friction" in names) == bool(protocol)
    assert forms.scene_of(forms.rest_of(given) | forms.mapping_of(made)) == given
    # what was in the other sections is there again without the twin
    next(form for form in made if form["name"] == "shape")["on"] = True
    assert "shape" not in forms.scene_of(forms.mapping_of(made))
    form["on"] = False
    assert {"shape", "packing", "container"} <= forms.scene_of(forms.mapping_of(made)).keys()


def test_shapes_are_added_and_sections_switched_off():
    spheres = [{"family": "sphere"}] * 2
    made = forms.forms_of({"shape": spheres, "container": {"kind": "box"}, "sizes": {"kind": "uniform"}})
    next(form for form in made if form["name"] == "sizes")["on"] = False
    told = forms.mapping_of(made)
    assert told["shape"] == [{"family": "sphere"}, {"family": "sphere"}]
    assert "sizes" not in told


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ([5, 5, 8], "[5, 5, 8]"),
        ([[0, 0.5], ["a, ]", True]], '[[0, 0.5], ["a, ]", true]]'),
        ({"radius": 1.5, "a b": []}, '{ radius = 1.5, "a b" = [] }'),
        ({}, "{}"),
    ],
)
def test_lists_and_tables_stand_on_one_line(value, text):
    assert forms.text_of(value) == text
    assert forms.value_of({"text": text, "word": False}) == value
