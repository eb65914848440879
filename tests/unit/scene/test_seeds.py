"""Several seeds in one scene: each a packing of its own, mean and standard error over all."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import CheckpointError, InputError, MissingFileError, PackingWarning
from voxgran.scene.replicates import averaged, packings_of_run

SCENE = """
[scene]
seed = 5
seeds = 3
[[shape]]
family = "sphere"
[container]
kind = "box"
lengths = [3, 3, 4]
[packing]
method = "digital"
solid_fraction = 0.15
voxel_size = 0.2
sweeps = 50
[measure]
which = ["density", "coordination"]
[output]
vtk = false
report = false
snapshots = 4
"""

pytestmark = pytest.mark.filterwarnings("ignore:the bulk holds", "ignore:the solid fraction is")


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return vg.Scene.from_toml(path)


def test_each_seed_is_the_packing_that_it_is_alone(scene, tmp_path):
    result = scene.run(tmp_path / "out")
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["seeds"] == [5, 6, 7]
    assert summary == json.loads(json.dumps(result.summary))
    mapping = scene.to_mapping()
    mapping["scene"] |= {"seed": 6, "seeds": 1}
    alone = vg.Scene.from_mapping(mapping).run(tmp_path / "alone").packing
    second = vg.load(tmp_path / "out" / "seed_6" / "packing.vtp")
    assert second.position.tobytes() == alone.position.tobytes()
    assert second.position.tobytes() != result.packing.position.tobytes()
    heights = [run["solid_fraction"] for run in summary["runs"]]
    assert summary["mean"]["solid_fraction"] == pytest.approx(np.mean(heights))
    assert (tmp_path / "out" / "seed_5" / "snapshots.pvd").is_file()
    assert not (tmp_path / "out" / "seed_6" / "snapshots.pvd").exists()
    tree = vg.load_statistics(tmp_path / "out" / "statistics.nc")
    assert tree.sizes["seed"] == 3
    whole = [run["container_solid_fraction"] for run in summary["runs"]]
    assert tree["solid_fraction"].values.tolist() == whole


@pytest.mark.slow
def test_a_resume_keeps_what_is_complete(scene, tmp_path):
    scene.run(tmp_path / "out")
    stamp = (tmp_path / "out" / "seed_5" / "packing.vtp").stat().st_mtime_ns
    bits = (tmp_path / "out" / "seed_7" / "packing.vtp").read_bytes()
    for name in ("summary.json", "packing.vtp"):
        (tmp_path / "out" / "seed_7" / name).unlink()
    again = scene.run(tmp_path / "out", resume=True)
    assert (tmp_path / "out" / "seed_5" / "packing.vtp").stat().st_mtime_ns == stamp
    assert again.packing.count == vg.load(tmp_path / "out" / "seed_5" / "packing.vtp").count
    old, new = tmp_path / "old.vtp", tmp_path / "out" / "seed_7" / "packing.vtp"
    old.write_bytes(bits)
    assert vg.load(new).position.tobytes() == vg.load(old).position.tobytes()
    mapping = scene.to_mapping()
    mapping["packing"]["sweeps"] = 60
    with pytest.raises(CheckpointError, match="another scene"):
        vg.Scene.from_mapping(mapping).run(tmp_path / "out", resume=True)


def test_the_standard_error_is_that_of_the_mean():
    runs = [{"seed": k, "solid_fraction": value, "verify": {"ok": True}, "stop_reason": "settled"} for k, value in
            enumerate((0.5, 0.6, 0.7, 0.6))]  # fmt: skip
    made = averaged(runs)
    assert made["mean"] == {"solid_fraction": pytest.approx(0.6)}
    assert made["standard_error"]["solid_fraction"] == pytest.approx(math.sqrt(0.02 / 3) / 2)
    assert averaged([runs[1], runs[3]])["standard_error"]["solid_fraction"] == 0.0
    assert math.isnan(averaged(runs[:1])["standard_error"]["solid_fraction"])


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("seeds = 3", "seeds = 0", "seeds is 0"),
        ("seeds = 3", "seeds = 2.5", "seeds"),
        ("snapshots = 4", "snapshots = 1", "at least 2"),
        ("snapshots = 4", "snapshots = -3", "snapshots"),
        ("seeds = 3", "seedz = 3", "did you mean 'seed"),
    ],
)
def test_bad_numbers_are_refused(tmp_path, old, new, words):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.replace(old, new))
    with pytest.raises(InputError, match=words):
        vg.Scene.from_toml(path)


@pytest.mark.slow
def test_the_packings_of_a_run_are_those_of_its_seeds(scene, tmp_path):
    scene.run(tmp_path / "out")
    found = packings_of_run(tmp_path / "out")
    assert [packing.provenance["seed"] for packing in found] == [5, 6, 7]
    # what an earlier run with more seeds has left is not of this one
    summary = tmp_path / "out" / "summary.json"
    summary.write_text(json.dumps({**json.loads(summary.read_text()), "seeds": [6, 5]}))
    assert [packing.provenance["seed"] for packing in packings_of_run(tmp_path / "out")] == [6, 5]
    single = replace(scene, general=replace(scene.general, seeds=1))
    single.run(tmp_path / "single")
    assert [packing.provenance["seed"] for packing in packings_of_run(tmp_path / "single")] == [5]
    single.run(tmp_path / "out", overwrite=True)
    assert len(packings_of_run(tmp_path / "out")) == 1
    # a run that was cut short has no summary
    for name in ("summary.json", "packing.vtp"):
        (tmp_path / "out" / name).unlink()
    (tmp_path / "out" / "seed_10").mkdir()
    (tmp_path / "out" / "seed_6" / "packing.vtp").unlink()
    with pytest.warns(PackingWarning, match=r"seed_(6|10) holds no packing\.vtp: it is left out"):
        assert [packing.provenance["seed"] for packing in packings_of_run(tmp_path / "out")] == [5, 7]


def test_folders_without_packings_are_refused(tmp_path):
    with pytest.raises(MissingFileError, match="is not there: name a folder that 'voxgran run' wrote"):
        packings_of_run(tmp_path / "none")
    with pytest.raises(InputError, match=r"holds no packing: packing\.vtp is missing there and in folders seed_K"):
        packings_of_run(tmp_path)
    for text in ("{", "[1]", '{"seeds": 3}', '{"seeds": [1]}'):
        (tmp_path / "summary.json").write_text(text)
        with pytest.raises(InputError, match=r"no packing: |summary\.json is no JSON"):
            packings_of_run(tmp_path)
