"""Scenes whose grains have rough skins."""

import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError

pytestmark = pytest.mark.usefixtures("jagged_pictures")

REST = {
    "container": {"kind": "box", "lengths": [4, 4, 4]},
    "packing": {"method": "rsa", "count": 4},
    "measure": {"which": ["grains"]},
    "output": {"vtk": False, "statistics": False, "report": False},
}


def scene(shape):
    return vg.Scene.from_mapping({"shape": [shape], **REST})


def test_rough_grains_are_packed(tmp_path):
    table = {"rms": 0.01, "method": "patir", "seed": 3}
    one = scene({"family": "sphere", "count": 2, "roughen": table})
    assert one.plan().computed[0] == "give 2 of the shapes a rough skin"
    packing = one.run(tmp_path / "out").packing
    seeds = vg.seeds_of_shapes(3, 2)
    wanted = [vg.roughen(vg.make_shape("sphere"), rms=0.01, method="patir", seed=seed) for seed in seeds]
    assert list(packing.shapes) == wanted
    assert packing.verify().ok
    assert packing.provenance["scene"]["shape"][0]["roughen"] == table
    assert vg.Scene.from_mapping(packing.provenance["scene"]).shapes == one.shapes


@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        (0.02, InputError, r"it must be a table, such as \{ rms = 0.02 \}"),
        ({"rms": -1}, InputError, "rms is -1"),
        ({"hurts": 0.8}, UnknownNameError, "did you mean 'hurst'"),
        ({"seed": 0.5}, InputError, "roughen seed is 0.5"),
    ],
)
def test_wrong_keys_are_explained(value, error, message):
    with pytest.raises(error, match=message):
        scene({"family": "sphere", "roughen": value})
