"""Where the command line writes to: devices, pipes, links and names that no file system takes."""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from kit import slow, small_scene
from PIL import Image

import voxgran as vg
from voxgran.cli import main

pytestmark = pytest.mark.usefixtures("jagged_pictures")

FULL = Path("/dev/full")
LONG = "n" * 256
SCENE = (
    small_scene()
    + """[scene]
unit = "mm"
[measure]
which = ["gradation"]
[output]
vtk = false
statistics = false
report = false
"""
)


def typed(*words, unbuffered="", **streams):
    """Run a command in a process of its own."""
    told = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "timeout": 600, **streams}
    told["env"] = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    return subprocess.run([sys.executable, "-m", "voxgran", *words], check=False, **told)


def test_names_that_are_no_text_are_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "\udcff.toml"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("\\udcff.toml: edit it")
    assert Path("\udcff.toml").is_file()


@pytest.mark.skipif(not FULL.exists(), reason="there is no device that is always full")
@pytest.mark.parametrize(
    ("words", "unbuffered"), [(["--version"], ""), slow(["--help"], "1"), slow(["methods"], ""), slow(["methods"], "1")]
)
def test_a_full_disk_is_one_sentence(words, unbuffered):
    with FULL.open("w") as full:
        done = typed(*words, unbuffered=unbuffered, stdout=full)
    assert done.returncode == 1
    assert done.stderr == (
        "voxgran: the output cannot be written (No space left on device): free space or choose another place\n"
    )
    with FULL.open("w") as full:
        assert typed(*words, unbuffered=unbuffered, stdout=full, stderr=full).returncode == 1


def test_a_reader_who_leaves_early_hears_nothing():
    command = f"{sys.executable} -m voxgran methods | head -1"
    done = subprocess.run(["bash", "-c", command], check=False, capture_output=True, text=True, timeout=600)
    assert done.stdout == "packing methods\n"
    assert done.stderr == ""
    assert done.returncode == 0


@pytest.mark.parametrize("name", [LONG, f"{LONG}/inner", "a\0b", "\ud800"])
@pytest.mark.parametrize("words", [["init"], ["run", "scene.toml", "-o"], ["verify"], ["shape", "box", "-o"]])
def test_names_that_no_file_system_takes(name, words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    ending = ".stl" if words[0] == "shape" else ""
    assert main([*words, name + ending]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "path is " in said
    assert len(said) < 300
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def test_a_link_to_nothing_makes_what_it_names(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("scene.toml").write_text(SCENE)
    os.symlink("elsewhere/results", "out")
    os.symlink("elsewhere/grain.stl", "grain.stl")
    assert main(["run", "scene.toml", "-o", "out", "-q"]) == 0
    assert (tmp_path / "elsewhere" / "results" / "packing.vtp").is_file()
    assert main(["shape", "box", "-o", "grain.stl"]) == 0
    assert Path("grain.stl").is_symlink()
    assert (tmp_path / "elsewhere" / "grain.stl").is_file()
    # what stands at the end of a link is there
    assert main(["shape", "box", "-o", "grain.stl"]) == 2


def test_the_output_may_be_a_stream():
    done = typed("init", "/dev/stdout")
    assert done.returncode == 0
    assert done.stdout.startswith("# A scene of voxgran")
    assert done.stderr == ""


@pytest.mark.parametrize("value", ["1" + "0" * 400, "1" + "0" * 5000, "[" * 100_000, "5e-324", "1e400", "nan"])
def test_numbers_that_are_typed_or_written_are_refused_in_a_short_sentence(value, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["shape", "sphere", "--diameter", value]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert len(said) < 300
    Path("scene.toml").write_text(SCENE.replace("[4, 4, 4]", f"[{value}, 4, 4]"))
    assert main(["plan", "scene.toml"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert len(said) < 300


def test_a_flag_that_is_unknown_names_one_alike_without_its_dashes_or_none(capsys):
    for words, said in (
        (["clump", "rock.stl", "-n", "20"], "did you mean '--max-spheres'?"),
        (["export", "bed.vtp", "-o", "run", "--spheres", "20"], "did you mean '--clump'?"),
        (["verify", "bed.vtp", "--tolerence", "1"], "did you mean '--tolerance'?"),
    ):
        assert main(words) == 2
        assert said in capsys.readouterr().err
    assert main(["init", "--method", "gravity"]) == 2
    assert "flag of init '--method' is unknown: known are --json" in capsys.readouterr().err


def test_a_measure_beside_the_file_names_its_flag(capsys):
    assert main(["measure", "bed.vtp", "voids"]) == 2
    assert "'voids' is one argument too many; write --which voids" in capsys.readouterr().err


def test_measures_become_a_table_and_the_fabric_tensor_is_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    grain = vg.make_shape("ellipsoid", semi_axes=(2, 1, 1))
    places = [[2, 2, 2], [4, 2, 2]]
    vg.Packing.of([grain], vg.Box((6, 6, 6), periodic="xyz"), position=places, scale=[0.5, 0.5]).save("bed.vtp")
    assert main(["measure", "bed.vtp", "--which", "fabric", "-o", "bed.csv"]) == 0
    assert "fabric tensor of contact normals 1, 0, 0; 0, 0, 0; 0, 0, 0" in capsys.readouterr().out
    with open("bed.csv", newline="") as file:
        rows = {(row["group"], row["variable"], row["place"]): row for row in csv.DictReader(file)}
    assert rows["/", "count", ""]["value"] == "2"
    row = rows["/fabric", "second_order", "vector=contact_normals;i=0;j=0"]
    assert (float(row["value"]), row["units"]) == (1.0, "1")
    assert main(["measure", "bed.vtp", "-o", "bed.csv"]) == 2
    assert main(["measure", "bed.vtp", "-o", "bed.txt"]) == 2


def test_a_grey_image_is_segmented_at_the_prompt(tmp_path, capsys):
    pytest.importorskip("skimage")
    grey = np.full((16, 16, 16), 10, dtype=np.uint8)
    grey[4:10, 4:10, 4:10] = 200
    np.save(tmp_path / "grey.npy", grey)
    words = ["labels", str(tmp_path / "grey.npy"), "--voxel-size", "0.5", "--segment", "--surface", "voxel", "--json"]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["grains"] == 1
    assert found["solid_fraction"] == pytest.approx((6 / 16) ** 3)


def test_labels_are_written_at_the_prompt_with_what_is_in_doubt(tmp_path, monkeypatch, capsys):
    pytest.importorskip("skimage")
    monkeypatch.chdir(tmp_path)
    x, y, z = np.indices((44, 26, 26))
    # a waist of 0.8 of the spheres
    grey = 200 * np.minimum((x - 13) ** 2, (x - 27) ** 2) + 200 * ((y - 13) ** 2 + (z - 13) ** 2) < 200 * 11.7**2
    np.save("grey.npy", grey * 200)
    words = ["segment", "grey.npy", "--threshold", "100"]
    assert main([*words, "--voxel-size", "0.5", "-o", "labels.vti", "--picture", "slices.png", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {name: found[name] for name in ("grains", "threshold", "suspects", "perhaps_one", "perhaps_several")} == {
        "grains": 2,
        "threshold": 100.0,
        "suspects": 1,
        "perhaps_one": ["1 and 2"],
        "perhaps_several": [],
    }
    assert found["separation"] == pytest.approx(0.1 * 0.5 * 11.7, rel=0.1)
    kept = vg.load_image("labels.vti")
    expected = vg.segment(vg.load_image("grey.npy"), threshold=100, voxel_size=0.5)
    assert np.array_equal(kept.values, expected.labels)
    assert kept.voxel_size == (0.5, 0.5, 0.5)
    with Image.open("slices.png") as picture:
        assert picture.size[0] > 1000
    # three edges of a voxel, and one grain where the separation is long
    assert main([*words, "--voxel-size", "0.5,0.5,1", "--separation", "4", "-o", "labels.npy", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["perhaps_several"] == ["1"]
    assert np.load("labels.npy").max() == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["-o", "labels.png"], "has the suffix '.png'"),
        (["--voxel-size", "1,2"], "--voxel-size is [1, 2]"),
        (["--picture", "slices.jpg"], "has the suffix '.jpg'"),
        (["--threshold", "mean"], "threshold is 'mean'"),
        (["-o", "there.npy"], "there.npy"),
    ],
)
def test_bad_words_of_segment_are_one_line(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    np.save("grey.npy", np.zeros((4, 4, 4)))
    (tmp_path / "there.npy").write_text("mine")
    assert main(["segment", "grey.npy", *words]) == 2
    assert said in capsys.readouterr().err
    assert (tmp_path / "there.npy").read_text() == "mine"


def test_a_packing_becomes_a_picture_at_the_prompt(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=12, seed=1).save("bed.vtp")
    assert main(["picture", "bed.vtp", "--window", "240,180"]) == 0
    assert capsys.readouterr().out == "bed.png\n"
    assert main(["picture", "bed.vtp", "-o", "cut.png", "--color-by", "height", "--cut", "--no-legend"]) == 0
    drawn = {path.stem: np.asarray(Image.open(path))[..., :3] for path in tmp_path.glob("*.png")}
    # pictures of the usual 900 x 900 pixels are drawn smaller in these tests
    assert {name: picture.shape for name, picture in drawn.items()} == {"bed": (180, 240, 3), "cut": (300, 300, 3)}
    vg.save_picture(vg.load("bed.vtp"), "same.png", color_by="height", cut=True, legend=False)
    assert np.array_equal(drawn["cut"], np.asarray(Image.open("same.png"))[..., :3])


def test_a_picture_that_cannot_be_is_refused_before_the_packing_is_read(tmp_path, capsys):
    there = tmp_path / "there.png"
    there.write_text("mine")
    for words, said in ((["-o", str(there)], "is there already"), (["-o", "bed.jpg"], "has the suffix '.jpg'")):
        assert main(["picture", "missing.vtp", *words]) == 2
        assert said in capsys.readouterr().err
    vg.pack(vg.shapes.sphere(), vg.Box((4, 4, 4)), "rsa", count=2).save(tmp_path / "bed.vtp")
    for window in ("900", "900,0", "2,3,4"):
        assert main(["picture", str(tmp_path / "bed.vtp"), "--window", window]) == 2
        assert "window is" in capsys.readouterr().err
    for guess in ("show", "plot", "view", "draw", "figure"):
        assert main([guess, "bed.vtp"]) == 2
        assert "did you mean 'picture'?" in capsys.readouterr().err
