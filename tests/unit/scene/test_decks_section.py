"""Input of engines from scenes: `[output] dem` and `[material]`."""

import pytest
from kit import small_scene

import voxgran as vg
from voxgran._base.errors import InputError, PackingWarning, UnknownNameError
from voxgran.cli import main

SCENE = (
    small_scene("convex_polyhedron", count=5)
    + """[scene]
seed = 1
unit = "mm"
density = 2500
[material]
friction = 0.25
[output]
dem = ["lammps", "yade"]
clump = 4
vtk = false
report = false
statistics = false
"""
)

# small scenes have no bulk to speak of, which is said in a warning
pytestmark = pytest.mark.filterwarnings("ignore:the bulk holds")


def scene(tmp_path, old="", new=""):
    assert old in SCENE
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.replace(old, new) if old else SCENE)
    return vg.Scene.from_toml(path)


def test_a_run_writes_the_input_of_engines(tmp_path):
    made = scene(tmp_path)
    assert "write input for lammps, yade into dem/" in made.plan().computed
    decks = made.run(tmp_path / "out").summary["dem"]
    assert decks == {"lammps": "dem/lammps_run.in", "yade": "dem/yade_run.py"}
    names = {path.name for path in (tmp_path / "out" / "dem").iterdir()}
    assert {"lammps_run.in", "yade_run.py"} <= names
    text = (tmp_path / "out" / "dem" / "lammps_run.in").read_text()
    assert "density 2500 kg/m^3" in text
    assert "friction 0.25" in text
    assert "clump of 4 spheres" in text


@pytest.mark.parametrize(
    ("method", "settle", "section"),
    [
        ("digital", {}, "[settle]"),
        ("digital", {"friction": 0.25}, None),
        # a solid fraction is reached by a friction that is not known yet
        ("digital", {"solid_fraction": 0.6}, None),
        ("digital", {"enabled": False}, None),
        ("gravity", None, "[packing]"),
    ],
)
def test_the_plan_says_where_friction_goes_to_engines_only(method, settle, section, tmp_path):
    made = scene(tmp_path).to_mapping()
    made["packing"] = {"method": method, "count": 5, "gravity": "-z"}
    made["shape"] = [{"family": "sphere"}]
    if settle is not None:
        made["settle"] = settle

    def notes():
        """Return the notes; so few grains have no bulk, which another one says."""
        return [note for note in vg.Scene.from_mapping(made).plan().notes if "bed is expected" not in note]

    told = "that of [material], 0.25, goes into input for engines only"
    assert [told in note and f"give {section} friction = 0.25" in note for note in notes()] == [True] * bool(section)
    # without input for engines, and without a material, nothing is meant otherwise
    made["output"]["dem"] = []
    del made["material"]
    assert notes() == []


def test_the_description_holds_material_and_engines(tmp_path):
    found = scene(tmp_path)
    assert found.material == vg.Material(friction=0.25)
    assert found.output.dem == ("lammps", "yade")
    assert vg.Scene.from_mapping(found.to_mapping()).to_mapping() == found.to_mapping()
    assert "material" not in scene(tmp_path, "[material]\nfriction = 0.25\n", "").to_mapping()


@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ('"yade"]', '"yad"]', UnknownNameError, "did you mean 'yade'"),
        ("friction = 0.25", "fricton = 0.25", UnknownNameError, r"\[material\] key 'fricton'.*'friction'"),
        ("friction = 0.25", "friction = -1", InputError, "friction"),
        ("friction = 0.25", 'law = "hertz"', InputError, "young_modulus"),
        ("clump = 4", "clump = 0", InputError, "clump"),
    ],
)
def test_typing_errors_are_found_before_the_run(tmp_path, old, new, error, message):
    with pytest.raises(error, match=message):
        scene(tmp_path, old, new)


def test_a_container_that_an_engine_has_not_is_refused_before_the_run(tmp_path):
    text = SCENE.replace("lengths = [4, 4, 4]", 'lengths = [4, 4, 4]\nperiodic = "xy"').replace('"yade"', '"kratos"')
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(InputError, match="container is periodic: input for Kratos"):
        vg.Scene.from_toml(tmp_path / "scene.toml")


def test_what_an_engine_cannot_hold_costs_nothing_else(tmp_path):
    text = SCENE.replace("friction = 0.25", "stiffness = 1e-9").replace(', "yade"', "")
    (tmp_path / "scene.toml").write_text(text)
    soft = vg.Scene.from_toml(tmp_path / "scene.toml")
    with pytest.warns(PackingWarning, match="input for lammps is not written: material stiffness"):
        soft.run(tmp_path / "out")
    assert (tmp_path / "out" / "packing.vtp").is_file()
    assert (tmp_path / "out" / "summary.json").is_file()
    assert not (tmp_path / "out" / "dem").exists()


def test_the_prompt_says_it_in_one_line(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(SCENE.replace("friction", "frction"))
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
