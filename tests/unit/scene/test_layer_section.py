"""The [[layer]] entries of a scene."""

from functools import cache

import pytest

import voxgran as vg
from voxgran._base.errors import InputError, UnknownNameError
from voxgran._base.stopping import Interrupted

# small beds have no bulk
pytestmark = pytest.mark.filterwarnings("ignore:the bulk holds")
LAYERS = [
    {"shape": [{"family": "sphere", "density": 1.0}], "count": 6},
    {
        "shape": [{"family": "box", "density": 2.0, "share": 0.5}, {"family": "sphere", "density": 2.0, "share": 0.5}],
        "count": 5,
        "sizes": {"kind": "fixed", "diameter": 0.8},
    },
]
SCENE = {
    "scene": {"seed": 3},
    "layer": LAYERS,
    "container": {"kind": "box", "lengths": [3, 3, 10]},
    "packing": {"method": "gravity", "friction": 0.3},
    "measure": {"which": ["density"]},
    "output": {"vtk": False, "report": False},
}


@cache
def called():
    upper = [vg.shapes.box(), vg.shapes.sphere()]
    layers = [
        {"shapes": vg.shapes.sphere(), "count": 6, "density": 1.0},
        {"shapes": upper, "count": 5, "density": 2.0, "sizes": vg.sizes.fixed(0.8)},
    ]
    return vg.pack_layers(layers, vg.Box((3, 3, 10)), friction=0.3, seed=3)


def test_a_scene_packs_what_a_call_does(tmp_path):
    scene = vg.Scene.from_mapping(SCENE)
    assert vg.Scene.from_mapping(scene.to_mapping()) == scene
    assert scene.plan().grains == 11
    result = scene.run(tmp_path / "out")
    assert result.packing.position.tobytes() == called().position.tobytes()
    assert result.packing.densities.tolist() == [1.0] * 6 + [2.0] * 5
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"packing.vtp", "statistics.nc", "summary.json"}


def test_shapes_of_layers_name_their_materials(tmp_path):
    shapes = [{**entry, "material": name} for entry, name in zip(LAYERS[1]["shape"], ("soft", "hard"), strict=True)]
    layers = [{**LAYERS[0], "shape": [{**LAYERS[0]["shape"][0], "material": "soft"}]}, {**LAYERS[1], "shape": shapes}]
    materials = [{"name": "soft", "friction": 0.6}, {"name": "hard", "friction": 0.2}]
    rest = {"container": {**SCENE["container"], "material": "hard"}, "packing": {"method": "gravity"}}
    made = (
        vg.Scene.from_mapping({**SCENE, **rest, "layer": layers, "material": materials}).run(tmp_path / "out").packing
    )
    lower = {"shapes": vg.shapes.sphere(), "count": 6, "density": 1.0}
    upper = {"shapes": [vg.shapes.box(), vg.shapes.sphere()], "count": 5, "density": 2.0, "sizes": vg.sizes.fixed(0.8)}
    table = vg.Materials(
        {"soft": {"friction": 0.6}, "hard": {"friction": 0.2}}, shapes=("soft", "soft", "hard"), walls="hard"
    )
    again = vg.pack_layers([lower, upper], vg.Box((3, 3, 10)), friction=table, seed=3)
    assert made.position.tobytes() == again.position.tobytes()
    assert made.provenance["seed"] == 3
    assert made.position.tobytes() != called().position.tobytes()


def test_a_run_that_stops_within_a_layer_goes_on(tmp_path):
    scene, seen = vg.Scene.from_mapping(SCENE), []

    def stop(step):
        seen.append(step)
        if len(seen) == 12:
            raise Interrupted("enough", 2)

    with pytest.raises(Interrupted):
        scene.run(tmp_path / "out", on_step=stop)
    result = scene.run(tmp_path / "out", resume=True)
    assert result.packing.position.tobytes() == called().position.tobytes()
    assert not list((tmp_path / "out").glob("checkpoint*"))


def with_layer(**changes):
    return {**SCENE, "layer": [{**LAYERS[0], **changes}]}


@pytest.mark.parametrize(
    ("scene", "error", "words"),
    [
        ({**SCENE, "layer": {}}, InputError, r"write \[\[layer\]\]"),
        ({**SCENE, "layer": [{"count": 3}]}, InputError, "has no shape"),
        (with_layer(height=3), InputError, "either count or height"),
        (with_layer(count=-3), InputError, "count is -3"),
        (with_layer(cuont=3), UnknownNameError, "count"),
        (with_layer(sizes={"kind": "fixd"}), UnknownNameError, "fixed"),
        ({**SCENE, "sizes": {"kind": "fixed"}}, InputError, r"\[sizes\] and \[\[layer\]\]"),
        ({**SCENE, "packing": {"method": "gravity", "count": 3}}, InputError, r"\[packing\] count and \[\[layer\]\]"),
        ({**SCENE, "output": {"snapshots": 3}}, InputError, "snapshots"),
        (
            {**SCENE, "packing": {"method": "deposition"}, "layer": [{"shape": LAYERS[0]["shape"], "height": 2}]},
            InputError,
            "only method 'gravity'",
        ),
    ],
)
def test_mistakes_are_told(scene, error, words):
    with pytest.raises(error, match=words):
        vg.Scene.from_mapping(scene)
