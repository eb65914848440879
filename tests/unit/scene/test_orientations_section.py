"""The section [orientations] of a scene."""

import json

import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError
from voxgran.cli import main

SCENE = {
    "shape": [{"family": "ellipsoid", "semi_axes": [0.4, 0.4, 1.0]}],
    "orientations": {"kind": "watson", "axis": "z", "kappa": 4},
    "container": {"kind": "box", "lengths": [6, 6, 6]},
    "packing": {"method": "rsa", "count": 8},
    "measure": {"which": ["fabric"]},
    "output": {"vtk": False, "report": False},
}


def test_a_scene_packs_what_a_call_does(tmp_path):
    scene = vg.Scene.from_mapping(SCENE)
    assert scene.orientations == vg.orientations.watson("z", 4)
    assert vg.Scene.from_mapping(scene.to_mapping()).orientations == scene.orientations
    result = scene.run(tmp_path / "out")
    called = vg.pack(
        vg.shapes.ellipsoid(semi_axes=(0.4, 0.4, 1.0)), vg.Box((6, 6, 6)), "rsa", count=8,
        orientations=vg.orientations.watson("z", 4),
    )  # fmt: skip
    assert result.packing.orientation.tobytes() == called.orientation.tobytes()
    assert vg.Scene.from_mapping({k: v for k, v in SCENE.items() if k != "orientations"}).orientations is None


def test_the_parameter_of_that_name_is_one_of_the_method(tmp_path):
    packing = {"method": "digital_rsa", "count": 4, "orientations": 2, "voxel_size": 0.2}
    plain = {**{k: v for k, v in SCENE.items() if k != "orientations"}, "packing": packing}
    result = vg.Scene.from_mapping(plain).run(tmp_path / "out")
    assert result.packing.provenance["parameters"]["orientations"] == 2
    with pytest.raises(InputError, match=r"\[orientations\] and \[packing\] orientations"):
        vg.Scene.from_mapping({**SCENE, "packing": packing})


@pytest.mark.parametrize(
    ("section", "error", "words"),
    [
        ({"kind": "watson", "axis": "z"}, InputError, r"\[orientations\] kappa is missing"),
        ({"axis": "z"}, InputError, r"\[orientations\] kind is missing"),
        ({"kind": "watson", "axis": "z", "kapa": 4}, UnknownNameError, "kappa"),
        ({"kind": "tensor", "matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}, InputError, "trace 3"),
        ("watson", InputError, r"\[orientations\]"),
    ],
)
def test_mistakes_are_told(section, error, words):
    with pytest.raises(error, match=words):
        vg.Scene.from_mapping({**SCENE, "orientations": section})


def test_the_prompt_lists_them(capsys):
    assert main(["methods", "orientations", "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)["orientations"]) == set(vg.orientations.orientation_kinds())
