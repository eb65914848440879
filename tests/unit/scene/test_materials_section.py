"""Several materials of a scene: `[[material]]`, `[material.pair]`, and what shapes and walls are made of."""

import json
import tomllib

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError
from voxgran.study.axes import changed
from voxgran.study.files import canonical_scene

SCENE = """
shape = [{family = "sphere", material = "sand"}, {family = "sphere", count = 1, material = "steel"}]
container = {kind = "box", lengths = [4, 4, 8], material = {z_low = "steel", others = "sand"}}
packing = {method = "gravity", count = 24}
output = {vtk = false, report = false, statistics = false, dem = []}
[[material]]
name = "sand"
friction = 0.6
[material.pair.steel]
friction = 0.2
[[material]]
name = "steel"
friction = 0.3
density = 7800
"""

pytestmark = pytest.mark.filterwarnings("ignore:the bulk holds")


def scene(*changes, text=SCENE):
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return vg.Scene.from_mapping(tomllib.loads(text))


def test_grains_of_a_scene_settle_with_the_friction_of_their_materials(tmp_path):
    made = scene(("friction = 0.6", "friction = 0.6\ndensity = 2600"))
    assert made.material.between("steel", "sand").friction == 0.2
    assert "with friction by materials sand, steel" in str(made.plan())
    bed = made.run(tmp_path / "out").packing
    forces, steel = bed.forces, bed.shape_id == 1
    partner = np.where(forces.j < 0, forces.normal[:, 2] < -0.9, steel[np.maximum(forces.j, 0)])
    expected = np.where(steel[forces.i] & partner, 0.3, np.where(steel[forces.i] | partner, 0.2, 0.6))
    np.testing.assert_array_equal(forces.friction, expected)
    # the density of a material is that of its shapes
    assert bed.density == (2600.0, 7800.0)


def test_a_scene_of_materials_is_read_again():
    made = scene(("friction = 0.6", "friction = 0.6\ndensity = 2600"))
    told = json.loads(json.dumps(made.to_mapping()))
    assert vg.Scene.from_mapping(told).to_mapping() == made.to_mapping()
    assert told["material"][0]["pair"] == {"steel": {"friction": 0.2}}
    assert told["container"]["material"] == {"z_low": "steel", "others": "sand"}
    assert "friction" not in told["packing"]


@pytest.mark.parametrize(("section", "found"), [("[settle]", None), ("[settle]\nfriction = 0.1", 0.1), ("", None)])
def test_the_section_settle_has_the_last_word(section, found):
    made = scene(('"gravity", count = 24', '"digital", count = 24'), ("\ndensity = 7800", ""), text=SCENE + section)
    assert made.settle.friction == (found or made.material)
    assert not made.parameters


def test_grains_are_compressed_with_the_friction_of_their_materials():
    made = scene(
        ('"gravity"', '"rsa"'), ("[4, 4, 8]", '[4, 4, 4], periodic = "xyz"'), ("\ndensity = 7800", ""),
        text=SCENE + "[compress]\n",
    )  # fmt: skip
    assert made.compress.friction == made.material
    assert made.settle is None


@pytest.mark.parametrize(
    ("changes", "error", "said"),
    [
        ([('name = "steel"', 'name = "sand"')], InputError, "given twice"),
        ([(', material = "sand"}', "}")], InputError, r"\[\[shape\]\] sphere has no material"),
        (
            [('count = 1, material = "steel"', 'count = 1, material = "steal"')],
            UnknownNameError,
            "did you mean 'steel'",
        ),
        ([('z_low = "steel"', 'z_low = "glass"')], UnknownNameError, "material of walls"),
        ([("pair.steel", "pair.glass")], UnknownNameError, "material of a pair"),
        ([("[material.pair.steel]\nfriction", "[material.pair.steel]\nfrction")], UnknownNameError, "property of pair"),
        ([("friction = 0.6", "friction = -0.6")], InputError, "friction is -0.6"),
        ([("friction = 0.6", "frction = 0.6")], UnknownNameError, "did you mean 'friction'"),
        ([('name = "steel"\n', "")], InputError, "name is missing"),
    ],
)
def test_bad_materials_are_refused(changes, error, said):
    with pytest.raises(error, match=said):
        scene(*changes)


def test_one_material_has_no_name():
    single = SCENE[: SCENE.index("[[material]]")] + "[material]\nfriction = 0.3\n"
    with pytest.raises(InputError, match=r"write \[\[material\]\] with a name"):
        scene(text=single)


def test_studies_vary_the_friction_of_a_material_and_of_a_pair():
    base = tomllib.loads(SCENE.replace("\ndensity = 7800", ""))
    axes = {"material.0.pair.steel.friction": [0.1, 0.4], "material.1.friction": [0.3, 0.5]}
    study = vg.Study(base=base, axes=axes, seeds=1)
    cells = study.plan().cells
    assert len(cells) == 4
    found = vg.Scene.from_mapping(changed(base, {name: values[1] for name, values in axes.items()})).material
    assert (found.between("sand", "steel").friction, found.between("steel", "steel").friction) == (0.4, 0.5)
    # cells are told apart by the frictions with which their grains settle
    made = [vg.Scene.from_mapping(changed(base, {"material.1.friction": mu})) for mu in (0.3, 0.5)]
    assert canonical_scene(made[0]) != canonical_scene(made[1])
    with pytest.raises(InputError, match=r"the scene has 2 \[\[material\]\]"):
        changed(base, {"material.2.friction": 0.1})
