"""Scene files: what they mean, what they cost, and what is wrong with them."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import (
    CheckpointError,
    FileFormatError,
    GrainTooLargeError,
    InputError,
    InUseError,
    MissingFileError,
    OutputExistsError,
    TooLargeError,
    UnknownNameError,
)
from voxgran._base.lock import FOLDER_LOCK
from voxgran.scene.run import summary_of

SCENE = """
[scene]
seed = 1
unit = "mm"
[[shape]]
family = "sphere"
[sizes]
kind = "fixed"
diameter = 1.0
[container]
kind = "box"
lengths = [3, 3, 4]
[packing]
method = "digital"
count = 8
voxel_size = 0.1
sweeps = 100
[output]
vtk = false
report = false
"""

# small scenes have no bulk to speak of, which is said in a warning
pytestmark = [pytest.mark.filterwarnings("ignore:the bulk holds"), pytest.mark.usefixtures("jagged_pictures")]


@pytest.fixture
def write(tmp_path):
    def writing(old="", new="", text=SCENE):
        assert old in text
        path = tmp_path / "scene.toml"
        path.write_text(text.replace(old, new) if old else text)
        return path

    return writing


def test_a_scan_in_a_unit_of_its_own_is_converted_in_plan_and_run(write, tmp_path):
    edge = vg.make_shape("box", diameter=1000.0)
    vg.save_shape(edge, tmp_path / "edge.stl")
    scene = vg.Scene.from_toml(write('family = "sphere"', 'file = "edge.stl"\nunit = "um"'))
    scene = replace(scene, sizes=None)
    assert scene.plan().solid_fraction == pytest.approx(8 * edge.volume / 1e9 / 36, rel=1e-6)
    assert scene.run(tmp_path / "out").packing.diameters == pytest.approx(1.0, rel=1e-6)
    with pytest.raises(UnknownNameError, match=r"\[\[shape\]\] unit 'furlong' is unknown"):
        vg.Scene.from_toml(write('family = "sphere"', 'file = "edge.stl"\nunit = "furlong"'))


def test_scene_runs_and_comes_back(write, tmp_path):
    scene = vg.Scene.from_toml(write())
    result = scene.run(tmp_path / "out")
    assert result.packing.count == 8
    assert result.verification.ok
    assert result.packing.unit == "mm"
    again = vg.Scene.from_mapping(scene.to_mapping())
    assert again.to_mapping() == scene.to_mapping()
    other = again.run(tmp_path / "again")
    assert other.packing.position.tobytes() == result.packing.position.tobytes()


def test_plan_says_what_the_run_does(write, tmp_path):
    scene = vg.Scene.from_toml(write())
    plan = scene.plan()
    assert plan.grains == 8
    assert "digital" in str(plan)
    assert any("report" in step for step in plan.skipped)
    result = scene.run(tmp_path / "out")
    assert result.summary["counters"]["attempts"] <= plan.attempts
    assert result.summary["plan"]["grains"] == 8


def test_plan_loads_neither_numba_nor_open3d_nor_vtk(write, tmp_path):
    code = (
        "import sys, voxgran as vg; print(*(vg.Scene.from_toml(path).plan() for path in sys.argv[1:])); "
        "sys.exit(any(name in sys.modules for name in ('numba', 'open3d', 'vtkmodules', 'pyvista')))"
    )
    texts = SCENE, SCENE.replace('family = "sphere"', 'family = "solid_union"')
    paths = [write(text=text).rename(tmp_path / f"{number}.toml") for number, text in enumerate(texts)]
    run = subprocess.run([sys.executable, "-c", code, *paths], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_plan_refuses_what_cannot_fit_in_memory(write):
    path = write("voxel_size = 0.1", "voxel_size = 0.0002")
    with pytest.raises(TooLargeError, match="GiB"):
        vg.Scene.from_toml(path).plan()


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ("voxel_size = 0.1", "voxel_sizee = 0.1", UnknownNameError, "did you mean 'voxel_size'"),
        ('method = "digital"', 'method = "digitl"', UnknownNameError, "did you mean 'digital'"),
        ('method = "digital"', "", InputError, "has no method:"),
        ('method = "digital"', 'metod = "digital"', InputError, "has no method but 'metod': a scene"),
        ("[packing]", "[pakcing]", UnknownNameError, "did you mean 'packing'"),
        ('family = "sphere"', 'family = "spere"', UnknownNameError, "did you mean 'sphere'"),
        ('kind = "fixed"', 'kind = "fixd"', UnknownNameError, "did you mean 'fixed'"),
        ('kind = "box"', 'kind = "bx"', UnknownNameError, "did you mean 'box'"),
        ("lengths = [3, 3, 4]", "lengths = [3, -3, 4]", InputError, "-3"),
        ("lengths = [3, 3, 4]", "lenghts = [3, 3, 4]", UnknownNameError, "did you mean 'lengths'"),
        ("diameter = 1.0", "diameter = 0.0", InputError, "diameter"),
        ("diameter = 1.0", "diameter = nan", InputError, "diameter"),
        ("seed = 1", "seed = -1", InputError, "seed"),
        ("count = 8", "count = 1.5", InputError, "count"),
        ("seed = 1", "seed = ", FileFormatError, "TOML"),
        ('family = "sphere"', 'file = "none.stl"', MissingFileError, "none.stl"),
        ('family = "sphere"', 'family = "sphere"\nfile = "a.stl"', InputError, "give one of file, family and model"),
        ("report = false", "report = false\ndem = ['lamps']", UnknownNameError, "dem"),
        ('family = "sphere"', 'family = ["sphere"]', UnknownNameError, "shape family .'sphere'. is unknown"),
    ],
)
def test_mistakes_are_named(write, old, new, error, words):
    with pytest.raises(error, match=words):
        vg.Scene.from_toml(write(old, new))


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"shape": 3}, r"\[shape\] is 3: write \[\[shape\]\], once per shape"),
        ({"shape": [3]}, r"\[\[shape\]\] is 3: it must be a section"),
        ({"container": 4}, r"\[container\] is 4: it must be a section; write \[container\] above its keys"),
        ({"packing": 5}, r"\[packing\] is 5: it must be a section"),
        ({"measure": {"which": "density"}}, r"\[measure\] which is 'density': it must be a list of names"),
    ],
)
def test_sections_of_other_types_are_refused(changed, words):
    box, packing = {"kind": "box", "lengths": [4, 4, 4]}, {"method": "rsa", "count": 2}
    with pytest.raises(InputError, match=words):
        vg.Scene.from_mapping({"shape": [{"family": "sphere"}], "container": box, "packing": packing, **changed})


def test_grains_that_cannot_fit(write):
    with pytest.raises(GrainTooLargeError, match="none can fit"):
        vg.Scene.from_toml(write("diameter = 1.0", "diameter = 9.0")).plan()
    with pytest.raises(InputError, match="times the volume"):
        vg.Scene.from_toml(write("count = 8", "count = 800")).plan()


def test_results_are_not_replaced_unasked(write, tmp_path):
    scene = vg.Scene.from_toml(write())
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "mine.txt").write_text("mine")
    with pytest.raises(OutputExistsError, match="not empty"):
        scene.run(folder)
    scene.run(folder, overwrite=True)
    assert (folder / "mine.txt").read_text() == "mine"


def test_a_scene_goes_on_from_a_packing_file(write, tmp_path):
    first = vg.Scene.from_toml(write()).run(tmp_path / "first").packing
    path = write('method = "digital"\ncount = 8', 'method = "digital"\ncount = 2\nstart = "first/packing.vtp"')
    scene = vg.Scene.from_toml(path)
    assert scene.plan().grains == 10
    result = scene.run(tmp_path / "second")
    assert result.packing.count == first.count + 2
    assert result.verification.ok
    with pytest.raises(MissingFileError):
        vg.Scene.from_toml(write('count = 2\nstart = "first/packing.vtp"', 'start = "none.vtp"', text=path.read_text()))


def test_what_is_complete_is_not_packed_again(write, tmp_path):
    scene = vg.Scene.from_toml(write())
    first = scene.run(tmp_path / "out")
    stamp = (tmp_path / "out" / "packing.vtp").stat().st_mtime_ns
    again = scene.run(tmp_path / "out", resume=True)
    assert (tmp_path / "out" / "packing.vtp").stat().st_mtime_ns == stamp
    assert again.packing.position.tobytes() == first.packing.position.tobytes()
    assert again.summary["solid_fraction"] == first.summary["solid_fraction"]
    other = vg.Scene.from_toml(write("count = 8", "count = 7"))
    with pytest.raises(CheckpointError, match="another scene"):
        other.run(tmp_path / "out", resume=True)
    for text in ("{", "[" * 10**5, "[1]"):
        (tmp_path / "out" / "summary.json").write_text(text)
        with pytest.raises(FileFormatError, match=r"summary\.json cannot be read as a \.json file"):
            scene.run(tmp_path / "out", resume=True)


@pytest.mark.parametrize("seeds", ["", "\nseeds = 2"])
def test_two_runs_in_one_folder_are_noticed(write, tmp_path, seeds):
    """The second one is told of the first, and costs it nothing; what a dead one left is no obstacle."""
    out = tmp_path / "out"
    scene = vg.Scene.from_toml(write("seed = 1", f"seed = 1{seeds}"))
    refused = []

    def second(step):
        if refused:
            return
        files = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
        for way in ({}, {"overwrite": True}, {"resume": True}):
            with pytest.raises(
                InUseError, match=rf"out is in use by process {os.getpid()} on .* since .*: wait for it"
            ):
                scene.run(out, **way)
            refused.append(way)
        assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == files

    scene.run(out, on_step=second)
    assert refused
    assert not list(tmp_path.rglob("*.lock"))
    (out / FOLDER_LOCK).write_text('{"pid": 1, "host": "dead"}')
    scene.run(out, resume=True)
    assert not list(tmp_path.rglob("*.lock"))


def test_a_folder_that_holds_the_lock_of_a_dead_run_alone_is_empty(write, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / FOLDER_LOCK).touch()
    vg.Scene.from_toml(write()).run(out)
    assert not (out / FOLDER_LOCK).exists()


def test_a_folder_that_only_can_be_read_is_read(write, tmp_path):
    """What is complete needs no lock."""
    scene = vg.Scene.from_toml(write())
    scene.run(tmp_path / "out")
    stamp = (tmp_path / "out").stat().st_mtime_ns
    scene.run(tmp_path / "out", resume=True)
    assert (tmp_path / "out").stat().st_mtime_ns == stamp


def test_the_summary_has_contacts_and_rattlers():
    ticks = np.arange(3) + 0.5
    position = np.stack(np.meshgrid(ticks, ticks, ticks), axis=-1).reshape(-1, 3)
    packing = vg.Packing.of([vg.make_shape("sphere")], vg.Box((3, 3, 3), periodic="xyz"), position=position)
    summary = summary_of(packing, vg.verify(packing), vg.measure(packing))
    assert summary["mean_coordination_number"] == summary["coordination_without_rattlers"] == 6.0
    assert summary["share_of_rattlers"] == 0.0
    assert summary["contact_anisotropy"] == pytest.approx(0.0, abs=1e-9)
    few = packing[:1]
    told = summary_of(few, vg.verify(few), vg.measure(few, ["coordination", "fabric"]))
    assert told["share_of_rattlers"] == 1.0
    assert not {"coordination_without_rattlers", "contact_anisotropy"} & set(told)
