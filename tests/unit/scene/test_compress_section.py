"""The section [compress] of a scene: its keys, what is refused, a run that is interrupted, and studies."""

import json
import signal

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import InputError, Interrupted, UnknownNameError
from voxgran.scene.run import COMPRESSING
from voxgran.settling.parameters import Compression
from voxgran.testing.packing_methods import bits_of

SCENE = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [5, 5, 5], "periodic": "xyz"},
    "packing": {"method": "rsa", "count": 60},
    "compress": {"friction": 0.3, "stress": [1.0, 1.0, 1.2]},
    "measure": {"which": ["density", "compression"]},
    "output": {"report": False, "vtk": False},
}


def scene(**sections):
    return vg.Scene.from_mapping({**SCENE, **sections})


def test_a_scene_compresses_what_it_has_packed(tmp_path):
    made = scene().run(tmp_path / "out", on_step=None)
    packing = made.packing
    assert packing.stop_reason == "compressed"
    assert np.diag(packing.forces.stress) == pytest.approx((1.0, 1.0, 1.2), rel=0.01)
    loose = vg.pack(vg.shapes.sphere(), vg.Box((5, 5, 5), periodic="xyz"), "rsa", count=60)
    again = vg.compress(loose, friction=0.3, stress=(1.0, 1.0, 1.2))
    assert np.array_equal(packing.position, again.position)
    assert not (tmp_path / "out" / COMPRESSING).exists()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert any("compress them" in line for line in summary["plan"]["computed"])
    # the scene in the file says how
    assert (
        vg.Scene.from_mapping(vg.load(tmp_path / "out" / "packing.vtp").provenance["scene"]).compress
        == scene().compress
    )


def test_keys_are_those_of_compression():
    assert scene().compress == Compression(friction=0.3, stress=(1.0, 1.0, 1.2))
    assert scene(compress={}).compress == Compression()
    assert vg.Scene.from_mapping({k: v for k, v in SCENE.items() if k != "compress"}).compress is None
    assert vg.Scene.from_mapping(scene().to_mapping()).to_mapping() == scene().to_mapping()


def test_the_method_has_these_keys_itself():
    with pytest.raises(InputError, match="write these keys in \\[packing\\]"):
        scene(packing={"method": "compress", "count": 60})
    given = {key: value for key, value in SCENE.items() if key != "compress"}
    made = vg.Scene.from_mapping({**given, "packing": {"method": "compress", "count": 60, "height": 4, "axes": "z"}})
    assert any("to a height of 4" in line for line in made.plan().computed)


@pytest.mark.parametrize(
    ("given", "error", "words"),
    [
        ({"frction": 0.3}, UnknownNameError, "did you mean 'friction'"),
        ({"friction": -1}, InputError, "friction"),
        ({"axes": "q"}, InputError, "each once"),
        ({"stress": [1, 2]}, InputError, "it must be one number, or 3"),
    ],
)
def test_mistakes_are_told(given, error, words):
    with pytest.raises(error, match=words):
        scene(compress=given)


def test_a_run_that_stops_while_grains_are_compressed_goes_on(tmp_path):
    whole = scene().run(tmp_path / "whole", on_step=None).packing

    def stop(step):
        if step.stage == "compressing" and step.done > 20 * 60:
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(Interrupted):
        scene().run(tmp_path / "out", on_step=stop)
    assert (tmp_path / "out" / COMPRESSING).exists()
    assert bits_of(scene().run(tmp_path / "out", resume=True, on_step=None).packing) == bits_of(whole)


@pytest.mark.slow
@pytest.mark.usefixtures("forked_workers")
def test_a_study_varies_the_friction_of_a_compression(tmp_path):
    base = {name: given for name, given in SCENE.items() if name != "output"}
    study = vg.Study(base={**base, "measure": {"which": ["density"]}}, axes={"compress.friction": [0.05, 0.5]}, seeds=1)
    found = study.run(tmp_path / "out", workers=1).dataset["solid_fraction"]
    slippery, rough = found.mean("seed").values.tolist()
    assert slippery > rough > 0.5
