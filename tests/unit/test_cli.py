"""The command line: one line per mistake, the right exit status, nothing lost."""

import csv
import importlib.metadata
import json
import os
import re
import signal
import subprocess
import sys
import textwrap
import time
import typing
import warnings
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from kit import slow

import voxgran as vg
import voxgran.cli.doctor as examination
import voxgran.cli.warm as beforehand
from voxgran._base.config import parameters_of
from voxgran._base.seeds import stream
from voxgran.cli import bits, flags, main
from voxgran.cli.commands import COMMANDS
from voxgran.cli.parser import name_flags
from voxgran.clumps.method import clump_registry
from voxgran.contacts.manifolds.finders import kinds_of
from voxgran.contacts.manifolds.rows import CONVEX, OUTLINE, SPHERE, SURFACE
from voxgran.decks.simulation import LONGEST
from voxgran.decks.write import KINDS
from voxgran.geometry import morton
from voxgran.packing.grains import ColorBy
from voxgran.packing.method import method_registry
from voxgran.settling import balance, impulses, projected_gradient
from voxgran.shapes.family import families
from voxgran.shapes.winding import winding_numbers

# small scenes have no bulk to speak of, which is said in a warning
pytestmark = [pytest.mark.filterwarnings("ignore:.*the bulk holds"), pytest.mark.usefixtures("jagged_pictures")]


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.toml"
    assert main(["init", str(path)]) == 0
    text = path.read_text().replace("count = 100", "count = 10\nvoxel_size = 0.125\nsweeps = 200\ncycles = 1")
    # tests of settling are those of test_cli_settle.py and of scene/test_settle_section.py
    text = text.replace("friction = 0.5", "enabled = false")
    path.write_text(
        text.replace("lengths = [5, 5, 8]", "lengths = [3, 3, 4]").replace("report = true", "report = false")
    )
    return path


def complaint(capsys, *words):
    status = main(list(words))
    captured = capsys.readouterr()
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    assert lines[0].startswith("voxgran: ")
    return status, lines[0]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("export a.vtp -o out --engine lammps --engine yade", "--engine is given twice"),
        ("verify a.vtp --unit=mm --unit=m", "--unit is given twice"),
        ("report a.vtp -o a.html --output b.html", "--output is given beside -o"),
        ("report a.vtp --interactive --no-interactive", "--no-interactive is given beside --interactive"),
        ("clump a.stl --spheres 5 --max-spheres 6", "--max-spheres is given beside --spheres"),
        ("shape box --lengths 1,1,1 --lengths 2,2,2", "--lengths is given twice"),
        ("shape sphere -o a.stl --format obj", "--format is obj without --count"),
        ("settle a.vtp -o b.vtp --friction 0.1 --friction 0.2", "--friction is given twice"),
    ],
)
def test_no_flag_is_replaced_or_passed_over_silently(capsys, words, told):
    status, line = complaint(capsys, *words.split())
    assert status == 2
    assert told in line


@pytest.mark.parametrize("words", ["measure a.vtp --which", "verify a.vtp --tolerance", "export a.vtp -o out --engine"])
def test_two_dashes_are_no_value(capsys, words):
    status, line = complaint(capsys, *f"{words}=--".split())
    assert status == 2
    assert f"argument {words.split()[-1]}: expected a value, not '--'" in line


def test_long_values_are_shortened(capsys):
    for words in ("verify a.vtp --tolerance=", "repair a.stl --bodies=", "measure a.vtp --", "data -o="):
        status, line = complaint(capsys, *f"{words}{'x' * 5000}".split())
        assert status == 2
        assert len(line) < 400


def test_flags_that_may_be_repeated(scene, tmp_path, capsys):
    assert main(["plan", str(scene), "-q", "-q"]) == 0
    bed = tmp_path / "bed.vtp"
    vg.Packing.of([vg.make_shape("sphere")], vg.Box((4, 4, 4)), position=[(1, 1, 1)]).save(bed)
    capsys.readouterr()
    assert main(["measure", str(bed), "--which", "contacts", "--which", "coordination"]) == 0
    assert "mean coordination number" in capsys.readouterr().out


@pytest.mark.parametrize("rest", ["nan", "1.5", "-0.1", "inf"])
def test_a_share_is_one(tmp_path, capsys, rest):
    bed = tmp_path / "bed.vtp"
    vg.Packing.of([vg.make_shape("sphere")], vg.Box((4, 4, 4)), position=[(1, 1, 0.5)]).save(bed)
    status, line = complaint(capsys, "equilibrium", str(bed), "--gravity", "-z", f"--rest={rest}")
    assert (status, f"--rest is {rest}" in line or f"rest is {rest}" in line) == (2, True), line


def test_the_whole_way(scene, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["plan", str(scene), "--json"]) == 0
    assert main(["run", str(scene), "-o", str(out), "--json"]) == 0
    capsys.readouterr()
    assert main(["verify", str(out / "packing.vtp"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["ok"] is True
    assert main(["measure", str(out / "packing.vtp"), "--which", "density", "--json"]) == 0
    assert 0 < json.loads(capsys.readouterr().out)["solid_fraction"] < 1
    status, line = complaint(capsys, "run", str(scene), "-o", str(out))
    assert status == 2
    assert "not empty" in line
    assert main(["run", str(scene), "-o", str(out), "--overwrite", "-q"]) == 0


def test_many_shapes_with_a_table_and_a_gallery(tmp_path, capsys):
    folder, picture = tmp_path / "grains", tmp_path / "grains.png"
    words = ["shape", "convex_polyhedron", "--count", "11", "--points", "8,20", "-o", str(folder), "--format", "ply"]
    assert main([*words, "--gallery", str(picture), "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["shapes"] == 11
    assert len(list(folder.glob("*.ply"))) == 11
    assert picture.read_bytes().startswith(b"\x89PNG")
    with open(folder / "shapes.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["file"] for row in rows] == sorted(path.name for path in folder.glob("*.ply"))
    again = vg.make_shape("convex_polyhedron", seed=int(rows[10]["seed"]), points=(8, 20))
    assert vg.load_shape(folder / rows[10]["file"]).volume == pytest.approx(again.volume)
    assert float(rows[10]["sphericity"]) == vg.describe(again, "sphericity").sphericity.item()
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert main(words) == 2
    assert "is not empty: name another folder, or ask with --overwrite" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    (folder / "notes.txt").write_text("mine")
    (folder / "other.ply").write_bytes(b"mine")
    fewer = ["shape", "torus", "--count", "2", "-o", str(folder), "--overwrite"]
    capsys.readouterr()
    assert main(fewer) == 0
    told = capsys.readouterr().err
    assert "holds 12 other shapes, such as convex_polyhedron_00.ply, which shapes.csv does not list: they stay" in told
    left = {path.name for path in folder.iterdir()}
    assert left == {path.name for path in before} | {"notes.txt", "other.ply", "torus_0.stl", "torus_1.stl"}


def test_shapes_and_clumps(tmp_path, capsys):
    mesh, spheres = tmp_path / "grain.stl", tmp_path / "rock.csv"
    assert main(["shape", "solid_union", "--seed", "7", "--solids", "3,4", "-o", str(mesh), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["diameter"] == pytest.approx(1.0)
    words = ["clump", str(mesh), "--spheres", "5", "-o", str(spheres)]
    picture = tmp_path / "rock.png"
    assert main([*words, "--picture", str(picture), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["spheres"] == 5
    assert main([*words, "--overwrite"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"^surface max +0\.\d+ of the equivalent diameter$", shown, re.M)
    assert re.search(r"^volume +\S+ of that of the solid$", shown, re.M)
    rows = spheres.read_text().splitlines()
    assert rows[0] == "x,y,z,r"
    assert sum(not row.startswith("#") for row in rows) == 6
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert vg.load_shape(spheres).volume == pytest.approx(vg.load_shape(mesh).volume)
    assert main([*words, "--overwrite", "--target", "iou", "--value", "0.5", "--mode", "inscribed", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["iou"] >= 0.5


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--spheres", "0"], "is 0: it must be a whole number, at least 1"),
        (["--spheres", "5", "--target", "iou", "--value", "0.99"], "is not reached with up to 5 spheres; the best is"),
        (["--method", "optimul"], "did you mean 'optimal'"),
        (["--mode", "inscribd"], "mode is 'inscribd'"),
        (["--min-radus", "0.1"], "did you mean '--min-radius'"),
        (["-o", "rock.stl"], "rock.stl has the suffix '.stl': clumps are kept as"),
        (["-o", "FOLDER/there.csv"], "there.csv"),
        (["--picture", "rock.jpg"], "pictures are kept as .png"),
    ],
)
def test_clumps_that_cannot_be(words, text, tmp_path, capsys):
    mesh, there = tmp_path / "grain.stl", tmp_path / "there.csv"
    vg.save_shape(vg.make_shape("box"), mesh)
    there.write_text("kept")
    status, line = complaint(capsys, "clump", str(mesh), *(word.replace("FOLDER", str(tmp_path)) for word in words))
    assert status == 2
    assert text in line
    assert there.read_text() == "kept"


def test_numbers_in_json_are_whole_or_null(tmp_path, capsys):
    packing = vg.Packing.of([vg.shapes.sphere()], vg.Box((2, 2, 2)), position=[[1, 1, 1]])
    packing.save(tmp_path / "one.vtp")
    assert main(["measure", str(tmp_path / "one.vtp"), "--json"]) == 0
    text = capsys.readouterr().out
    assert "NaN" not in text
    found = json.loads(text)
    assert found["count"] == 1
    assert isinstance(found["count"], int)
    assert None in found.values()


def test_numbers_have_the_units_of_the_packing_and_arrays_a_file(tmp_path, capsys):
    path = str(tmp_path / "bed.vtp")
    box = vg.Box((4, 4, 4))
    vg.Packing.of(vg.shapes.sphere(radius=0.5), box, position=[(1, 1, 1), (3, 3, 2.9)], unit="mm").save(path)

    def said(*words):
        assert main([*words]) == 0
        return [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]

    lines = said("measure", path, "--which", "density")
    assert {"mean diameter 1 mm", "container volume 64 mm^3"} <= set(lines)
    # six solid fractions of the bed a diameter
    assert any(line.startswith("specific surface 0.1099") and line.endswith("mm^-1") for line in lines), lines
    assert not any("of density" in line for line in lines)
    told = ["deepest 0 mean diameters", "escaped 0", "touching at 1", "tolerance 1e-09 mean diameters"]
    assert said("verify", path)[2:] == told
    lines = said("measure", path, "--which", "profile", "--which", "gradation")
    assert lines == ["count 2", "of gradation, profile there are arrays only: write them with -o FILE.nc or FILE.csv"]
    out = str(tmp_path / "bed.nc")
    assert said("measure", path, "--which", "profile", "-o", out) == ["count 2", out]


def test_the_prompt_begins_with_the_numbers_of_a_bed_below_its_surface(tmp_path, capsys):
    path = str(tmp_path / "bed.vtp")
    position = [(x, y, z) for x in (0.5, 1.5) for y in (0.5, 1.5) for z in (0.5, 1.5, 2.5)]
    spheres = vg.shapes.sphere(radius=0.5)
    bed = vg.Packing.of(spheres, vg.Box((2, 2, 30)), position=position, gravity="-z")
    bed.save(path)
    assert main(["measure", path, "--which", "density", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert list(found)[:5] == ["solid_fraction", "porosity", "region", "container_solid_fraction", "container_porosity"]
    assert (found["region"], found["solid_fraction"]) == ("bed", found["bed_solid_fraction"])
    assert found["porosity"] == 1 - found["solid_fraction"]
    assert found["container_solid_fraction"] == pytest.approx(bed.solid_fraction)
    assert found["solid_fraction"] > 8 * found["container_solid_fraction"]
    # what is read first of a packing says whose solid fraction it is
    assert repr(bed) == "Packing(12 grains, container_solid_fraction=0.0524, count)"
    assert repr(replace(bed, gravity=None)) == "Packing(12 grains, solid_fraction=0.0524, count)"


def test_a_bed_that_is_sorted_by_size_is_warned_of(tmp_path, capsys):
    position = [[1, 1, k + 0.5] for k in range(60)]
    sizes = [0.5 + 0.005 * k for k in range(60)]
    box = vg.Box((2, 2, 60))
    for name, scale in (("sorted", sizes), ("mixed", sizes[::2] + sizes[1::2][::-1])):
        vg.Packing.of(vg.shapes.sphere(radius=0.5), box, position=position, scale=scale).save(tmp_path / f"{name}.vtp")
        assert main(["measure", str(tmp_path / f"{name}.vtp"), "--which", "segregation"]) == 0
        shown = capsys.readouterr()
        assert "segregation" in shown.out
        assert ("voxgran: warning: large grains lie above small ones" in shown.err) == (name == "sorted")


def test_one_method_in_json_has_its_parameters(capsys):
    assert main(["methods", "digital", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["packing methods"]["digital"]
    assert found["summary"]
    assert "doi" in found["source"]
    assert found["parameters"]["lid"]["default"] is False
    for name in ("inscribed", "box", "density"):
        assert main(["methods", name, "--json"]) == 0
    assert main(["methods", "--json"]) == 0


def test_methods_are_listed(capsys):
    assert main(["methods"]) == 0
    text = capsys.readouterr().out
    for word in (
        "digital",
        "control_point",
        "solid_union",
        "inscribed",
        "voxel_size",
        "doi:10.1016",
        "only on request",
    ):
        assert word in text
    assert "\ncores " in text


def test_one_method_is_shown_alone(capsys):
    assert main(["methods", "rsa"]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("packing methods\n")
    assert "tries" in shown
    assert "digital" not in shown.split()
    assert "shape families" not in shown
    assert main(["methods", "rsaa", "--json"]) != 0
    assert "did you mean 'rsa'" in capsys.readouterr().err


@pytest.mark.parametrize("columns", ["80", "200"])
def test_methods_list_the_allowed_values_of_each_choice(columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    assert main(["methods"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= min(int(columns), 120)
    text = " ".join(" ".join(lines).split())
    for registry in (method_registry(), clump_registry(), families()):
        for item in (item for name in registry.names() for item in parameters_of(registry.get(name).parameters)):
            unit = f" {item.unit}" if item.unit not in ("", "length") and item.unit not in item.doc else ""
            assert f"{item.name} {item.doc} ({item.type_text}{unit}; " in text
    for choice in ("'loose', 'dense'; default 'loose'", "'-z', '+z', 'none' or a list of 3", "'4d'; default 'classic'"):
        assert choice in text
    assert "None" not in text
    assert "Generating, Reproducing and Packaging of Random Volumes for Discrete Element Analysis of" in text


@pytest.mark.exact_start("doctor compares the bits of ten jobs with the reference")
def test_doctor_is_content(capsys):
    assert main(["doctor", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["all_good"] is True


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["rnu"], "did you mean 'run'"),
        (["run"], "file"),
        (["run", "none.toml"], "none.toml"),
        (["verify", "none.vtp"], "none.vtp"),
        (["shape", "sphre"], "did you mean 'sphere'"),
        (["shape", "sphere", "--diameter", "-1"], "diameter"),
        (["shape", "sphere", "--diametre", "1"], "did you mean '--diameter'"),
        (["shape", "sphere", "more"], "'more' is one argument too many"),
        (["shape", "sphere", "--count", "-1"], "count is -1: it must be a whole number, at least 0"),
        (["shape", "sphere", "--count", "3", "-o", "a.stl"], "many shapes are written to a folder; name one, and"),
        (["shape", "sphere", "--seed", "one"], "--seed is 'one': it must be a whole number; see"),
        (["verify", "a.vtp", "--tolerance", "1mm"], "--tolerance is '1mm': it must be a number; see"),
        (["shape", "sphere", "--gallery", "a.jpg"], "pictures are kept as .png"),
        (["pack", "scene.toml"], "did you mean 'run'"),
        (["plan", "scene.toml", "--jsn"], "did you mean '--json'"),
    ],
)
def test_mistakes_are_one_line_and_status_2(words, expected, capsys):
    status, line = complaint(capsys, *words)
    assert status == 2
    assert expected in line


def test_scenes_and_packings_that_are_mistaken_for_each_other_are_told(scene, tmp_path, capsys):
    assert "holds a scene and no packing" in complaint(capsys, "measure", str(scene))[1]
    (tmp_path / "bed.vtp").touch()
    assert "is a packing and no scene" in complaint(capsys, "run", str(tmp_path / "bed.vtp"))[1]


def test_a_misspelt_family_key_is_told(scene, capsys):
    scene.write_text(scene.read_text().replace("family =", "famly ="))
    assert "did you mean 'family'" in complaint(capsys, "plan", str(scene))[1]


def test_messages_name_the_flags_of_the_prompt(tmp_path, capsys):
    np.save(tmp_path / "image.npy", np.pad(np.ones((5, 5, 5), dtype=np.int64), 2))
    words = ["labels", str(tmp_path / "image.npy")]
    assert "--voxel-size is missing" in complaint(capsys, *words)[1]
    assert "--voxel-size is -1:" in complaint(capsys, *words, "--voxel-size", "-1")[1]
    given = SimpleNamespace(stress=None, clump=None, law=None)
    told = "give stress=1e5, clump=20 or law='linear', not method='jam'; stress is (1, 2)"
    right = "give --stress 1e5, --clump 20 or --law linear, not method='jam'; stress is (1, 2)"
    assert name_flags(told, given) == right
    told = "packing.gravity is None, and packing.unit is 'm': give stress=-1.5"
    assert name_flags(told, given) == "the packing has no gravity, and unit of the packing is 'm': give --stress -1.5"
    given = SimpleNamespace(seed=0, x=1, max_hole=2)
    for told in (
        "packing.nc is not there",
        "/max_hole/seed=3/a.nc",
        "seed=3.png, a max_hole.nc",
        "'x=2*y+1' and 'x=3'",
    ):
        assert name_flags(told, given) == told


def test_bad_files_are_one_line_and_status_2(tmp_path, capsys):
    bad = tmp_path / "bad.vtp"
    bad.write_bytes(b"<VTKFile type='PolyData'><broken")
    for name, content in (("bad.vtp", None), ("bad.stl", b"\0" * 90), ("bad.xyz", b"solid")):
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        words = ["clump", str(path)] if name != "bad.vtp" else ["verify", str(path)]
        assert complaint(capsys, *words)[0] == 2


def test_a_damaged_checkpoint_is_refused(scene, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    (out / "checkpoint.voxgran").write_bytes(b"voxgran checkpoint 1 abc 3\nxyz")
    status, line = complaint(capsys, "run", str(scene), "-o", str(out), "--resume")
    assert status == 2
    assert "damaged" in line


def test_every_command_has_help(capsys):
    for name in COMMANDS:
        with pytest.raises(SystemExit) as stop:
            main([name, "--help"])
        assert stop.value.code == 0
    assert "usage" in capsys.readouterr().out


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), slow(signal.SIGTERM, 143)])
def test_signals_leave_a_checkpoint_and_the_command_that_resumes(scene, tmp_path, number, status):
    endless = scene.read_text().replace("sweeps = 200", "sweeps = 1000000000")
    scene.write_text(endless.replace("report = false", "report = false\nsnapshots = 2"))
    out = tmp_path / "out"
    run = subprocess.Popen(
        [sys.executable, "-m", "voxgran", "run", str(scene), "-o", str(out)], stderr=subprocess.PIPE, text=True
    )
    # attempts are made once a snapshot is there
    deadline = time.monotonic() + 300
    while not (out / "snapshots.pvd").exists() and run.poll() is None and time.monotonic() < deadline:
        time.sleep(0.05)
    run.send_signal(number)
    _, errors = run.communicate(timeout=60)
    assert run.returncode == status
    assert "--resume" in errors
    assert "Traceback" not in errors
    assert (out / "checkpoint.voxgran").exists()


def test_a_second_run_in_one_folder_is_refused_in_one_line(scene, tmp_path, capsys):
    scene.write_text(scene.read_text().replace("sweeps = 200", "sweeps = 1000000000"))
    out = tmp_path / "out"
    words = ["run", str(scene), "-o", str(out)]
    run = subprocess.Popen([sys.executable, "-m", "voxgran", *words], stderr=subprocess.PIPE, text=True)
    try:
        deadline, lock = time.monotonic() + 120, out / ".voxgran.lock"
        while not (lock.exists() and lock.stat().st_size) and time.monotonic() < deadline:
            time.sleep(0.1)
        for more in ([], ["--overwrite"], ["--resume"]):
            status, line = complaint(capsys, *words, *more)
            assert status == 2
            assert f"in use by process {run.pid} " in line
        assert run.poll() is None
    finally:
        run.terminate()
        run.communicate(timeout=60)
    assert not lock.exists()


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0, reason="only root can mount a small disk")
def test_a_full_disk_is_one_line(scene, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=16k", "none", str(disk)], check=False).returncode:
        pytest.skip("no small disk can be mounted here")
    try:
        run = subprocess.run(
            [sys.executable, "-m", "voxgran", "run", str(scene), "-o", str(disk / "out")],
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 1
        assert "cannot be written" in run.stderr
        assert "Traceback" not in run.stderr
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_simplify(data_dir, tmp_path, capsys):
    out, scan = tmp_path / "small.stl", str(data_dir / "itokawa_lp.obj")
    assert main(["simplify", scan, "--faces", "300", "-o", str(out), "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    small = vg.load_shape(out)
    assert numbers["faces_before"] == len(vg.load_shape(scan).faces)
    assert len(small.faces) == numbers["faces"] <= 300
    assert numbers["diameter"] == pytest.approx(small.diameter, rel=1e-6)
    assert 0 < numbers["mean_distance"] < numbers["largest_distance"] < 0.05 * small.diameter
    before = out.read_bytes()
    for faces, wrong in (
        ("300", "is there already"),
        ("2", "it must be a whole number, at least 4"),
        ("many", "--faces"),
    ):
        over = () if faces == "300" else ("--overwrite",)
        status, line = complaint(capsys, "simplify", scan, "--faces", faces, "-o", str(out), *over)
        assert (status, wrong in line) == (2, True), line
    assert out.read_bytes() == before


@pytest.mark.parametrize("words", [("simplify", "--faces", "9"), ("cloud",), ("repair",)])
def test_outputs_are_checked_before_the_input_is_read(words, tmp_path, capsys):
    command, *rest = words
    there, scan = tmp_path / "there.stl", str(tmp_path / "none.ply")
    there.write_bytes(b"x")
    status, line = complaint(capsys, command, scan, *rest, "-o", str(tmp_path / "rock.foo"))
    assert (status, "surfaces are kept as .obj, .off, .ply, .stl, .vtp; choose one of these" in line) == (2, True), line
    status, line = complaint(capsys, command, scan, *rest, "-o", str(there))
    # solids that are mended may be several, with other names
    assert (status, ("none.ply" if command == "repair" else "is there already") in line) == (2, True), line


@pytest.mark.parametrize(
    ("command", "ending"), [("report", ".html"), ("compare", ".html"), ("measure", ".nc"), ("labels", ".vtp")]
)
def test_pages_and_statistics_are_checked_before_the_input_is_read(command, ending, tmp_path, capsys):
    there = tmp_path / f"there{ending}"
    there.write_bytes(b"x")
    beds = [str(tmp_path / name) for name in ("one.vtp", "two.vtp")[: 1 + (command == "compare")]]
    status, line = complaint(capsys, command, *beds, "-o", str(tmp_path / "out.pdf"))
    assert (status, f"are kept as {ending}" in line) == (2, True), line
    status, line = complaint(capsys, command, *beds, "-o", str(there))
    assert (status, "is there already" in line) == (2, True), line


def test_a_scan_is_mended_and_told(tmp_path, data_dir, capsys):
    out = tmp_path / "bunny.ply"
    assert main(["repair", str(data_dir / "bunny_dirty.ply"), "-o", str(out)]) == 0
    text = capsys.readouterr().out
    assert "closed 15 holes" in text
    assert "volume change" in text
    assert out.is_file()
    assert main(["repair", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["done"] == ["nothing: the mesh is good as it is"]
    status, line = complaint(capsys, "repair", str(data_dir / "bunny_dirty.ply"), "--max-hole", "0.01")
    assert status == 2
    assert line.endswith("; raise --max-hole")
    status, line = complaint(capsys, "clump", str(data_dir / "bunny_dirty.ply"))
    assert status == 2
    assert line.endswith("open edges: a grain must be a closed surface; use 'voxgran repair'")
    assert complaint(capsys, "repair", str(data_dir / "bunny_dirty.ply"), "-o", str(out))[0] == 2


def test_spheres_of_another_program_are_checked_and_what_was_assumed_is_said(tmp_path, capsys):
    path = tmp_path / "spheres.csv"
    path.write_text("x [mm],y [mm],z [mm],diameter [mm]\n1,1,1,1\n2.5,1,1,1\n")
    assert main(["verify", str(path), "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["ok"] is True
    assert "assumed container: the box around the spheres" in captured.err
    assert main(["verify", str(path), "--periodic", "x", "--json"]) == 0
    capsys.readouterr()
    assert complaint(capsys, "verify", str(path), "--periodic", "q")[0] == 2


def test_a_label_image_becomes_a_packing_and_two_are_compared(tmp_path, capsys):
    image = np.zeros((20, 12, 12), np.uint8)
    image[2:8, 3:9, 3:9], image[11:18, 3:9, 3:9] = 1, 2
    np.save(tmp_path / "scan.npy", image)
    for name, size in (("a", "0.1"), ("b", "0.2")):
        words = [
            "labels",
            str(tmp_path / "scan.npy"),
            "--voxel-size",
            size,
            "-o",
            str(tmp_path / f"{name}.vtp"),
            "--json",
        ]
        assert main(words) == 0
        assert json.loads(capsys.readouterr().out)["grains"] == 2
    out = tmp_path / "c.html"
    assert main(["compare", str(tmp_path / "a.vtp"), f"other={tmp_path / 'b.vtp'}", "-o", str(out)]) == 0
    assert "other" in out.read_text()
    capsys.readouterr()
    assert complaint(capsys, "labels", str(tmp_path / "scan.npy"))[0] == 2
    for command in ("labels", "segment"):
        status, line = complaint(capsys, command, str(tmp_path / "scan.npy"), "--dask", "nowhere")
        assert status == 1
        assert re.search("no Dask scheduler at nowhere|distributed cannot be loaded", line)


def test_an_image_is_described_and_its_voxels_may_have_three_edges(tmp_path, capsys):
    image = np.zeros((20, 12, 6), np.uint8)
    image[2:8, 3:9, 1:4], image[11:18, 3:9, 0:3] = 1, 2
    vg.save_image(image, tmp_path / "scan.vti", voxel_size=(0.1, 0.1, 0.2))
    np.save(tmp_path / "scan.npy", image)
    assert main(["image", "info", str(tmp_path / "scan.vti"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["voxel_size"] == pytest.approx([0.1, 0.1, 0.2])
    assert told["lengths"] == pytest.approx([2.0, 1.2, 1.2])
    assert (told["values"], told["labels"], told["cut_by_border"]) == ("labels", 2, 1)
    assert main(["image", "info", str(tmp_path / "scan.npy")]) == 0
    assert "give --voxel-size" in capsys.readouterr().out
    for words in (["scan.vti"], ["scan.npy", "--voxel-size", "0.1,0.1,0.2"]):
        assert main(["labels", str(tmp_path / words[0]), *words[1:], "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["solid_fraction"] == pytest.approx(234 / 1440, rel=1e-6)
    for wrong in ("0.1,0.1", "0,1,1", "abc"):
        status, line = complaint(capsys, "labels", str(tmp_path / "scan.npy"), "--voxel-size", wrong)
        assert status == 2
        assert "every edge must be a finite number above 0; give one or three" in line
    noise = stream(0, "grey").normal(100, 20, (8, 8, 8))
    np.save(tmp_path / "grey.npy", noise)
    assert main(["image", "info", str(tmp_path / "grey.npy")]) == 0
    assert "make labels of them with voxgran segment" in capsys.readouterr().out


def test_an_image_in_blocks_is_described_segmented_and_becomes_a_packing(tmp_path, monkeypatch, capsys):
    pytest.importorskip("zarr")
    image = np.zeros((20, 12, 6), np.uint8)
    image[2:8, 3:9, 1:4], image[11:18, 3:9, 0:3] = 1, 2
    path = str(tmp_path / "scan.zarr")
    vg.save_image(image, path, voxel_size=(0.1, 0.1, 0.2), unit="mm")
    assert main(["image", "info", path, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["values"], told["labels"], told["greatest"], told["unit"]) == ("labels", 2, 2, "mm")
    assert main(["labels", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["solid_fraction"] == pytest.approx(234 / 1440, rel=1e-6)
    words = ["segment", path, "--threshold", "0.5", "--min-size", "8"]
    assert main([*words, "-o", str(tmp_path / "labels.zarr"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["grains"] == 2
    assert np.array_equal(np.asarray(vg.open_image(tmp_path / "labels.zarr")), image)
    monkeypatch.setattr("voxgran.cli.images.MOST_READ", image.size - 1)
    monkeypatch.setattr("zarr.Array.__getitem__", None)
    assert main(["image", "info", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["values"] == "not read, since they are more than 1439"


def test_small_grains_of_a_grey_image_are_kept_where_they_are_asked_for(tmp_path, capsys):
    """Segmenting left grains of fewer than 64 voxels out, whatever --min-size said."""
    image = np.zeros((12, 12, 22), np.float32)
    image[1:9, 1:9, 1:9], image[1:4, 1:4, 12:15] = 1.0, 1.0
    np.save(tmp_path / "grey.npy", image)
    words = ["labels", str(tmp_path / "grey.npy"), "--voxel-size", "1", "--segment", "--gravity", "none", "--json"]
    for more, grains in (([], 1), (["--min-size", "8"], 2), (["--min-size", "28"], 1)):
        assert main([*words, *more]) == 0
        assert json.loads(capsys.readouterr().out)["grains"] == grains


def saved(path, *, seed):
    """Write a small packing of spheres and return its path."""
    generator, spheres = stream(seed, "cli"), vg.make_shape("sphere")
    packing = vg.Packing.of(
        *([spheres], vg.Box((6, 6, 6))),
        position=generator.uniform(1, 5, (8, 3)),
        scale=generator.uniform(0.3, 0.6, 8),
        provenance={"seed": seed},
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    vg.save(packing, path)
    return str(path)


@pytest.mark.slow
def test_folders_of_runs_are_compared(tmp_path, capsys):
    for seed in range(3):
        saved(tmp_path / "loose" / f"seed_{seed}" / "packing.vtp", seed=seed)
    for folder, seed in (("dense", 7), ("other", 8)):
        saved(tmp_path / folder / "packing.vtp", seed=seed)
    out, twin = tmp_path / "c.html", tmp_path / "c.json"
    words = [str(tmp_path / "loose"), str(tmp_path / "dense" / "packing.vtp"), f"b={tmp_path / 'other'}"]
    with warnings.catch_warnings(action="default"):
        assert main(["compare", *words, "-o", str(out)]) == 0
    groups = json.loads(twin.read_text())["groups"]
    assert [(group["name"], group["packings"]) for group in groups] == [("loose", 3), ("dense", 1), ("b", 1)]
    assert "warning: loose, seed 2: the bulk holds" in capsys.readouterr().err
    # the same name makes a group of both only where it was given
    words = [f"b={tmp_path / 'dense'}", f"b={tmp_path / 'other'}", str(tmp_path / "loose")]
    assert main(["compare", *words, "-o", str(out), "--overwrite"]) == 0
    groups = json.loads(twin.read_text())["groups"]
    assert [(group["name"], group["packings"]) for group in groups] == [("b", 2), ("loose", 3)]
    before = out.read_bytes()
    same = [str(saved(tmp_path / name / "x.vtp", seed=9 + k)) for k, name in enumerate("ab")]
    assert main(["compare", *same, "-o", str(tmp_path / "d.html")]) == 0
    assert [group["name"] for group in json.loads((tmp_path / "d.json").read_text())["groups"]] == same
    capsys.readouterr()
    (tmp_path / "nothing").mkdir()
    for wrong, said in (("nothing", "holds no packing"), ("none", "is not there")):
        status, line = complaint(capsys, "compare", words[0], str(tmp_path / wrong), "-o", str(out), "--overwrite")
        assert status == 2
        assert said in line
    assert out.read_bytes() == before


def test_what_is_assumed_of_spheres_is_said_of_each_file(tmp_path, capsys):
    for name in ("a", "b"):
        (tmp_path / f"{name}.csv").write_text("x,y,z,diameter\n1,1,1,1\n2.5,1,1,1\n")
    words = [str(tmp_path / "a.csv"), str(tmp_path / "b.csv"), "-o", str(tmp_path / "c.html")]
    assert main(["compare", *words]) == 0
    assert f"{tmp_path / 'b.csv'}: assumed container" in capsys.readouterr().err


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_shells_complete_commands_and_flags(shell, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--print-completion", shell])
    assert stop.value.code == 0
    script = capsys.readouterr().out
    for word in ("repair", "compare", "voxgran", *(["--resume"] if shell != "tcsh" else [])):
        assert word in script


#: words, and how many modules of other rooms than the prompt they load at the most
LOADED = [(["--version"], 8), (["--help"], 8), (["run", "--help"], 8)]


@pytest.mark.parametrize(("words", "most"), LOADED, ids=str)
def test_the_prompt_loads_what_it_shows(words, most):
    """No NumPy, and no module of the package but those of the prompt and a few that its errors and signals need."""
    program = (
        "import sys\nfrom voxgran.cli import main\n"
        f"try:\n    main({words})\nexcept SystemExit:\n    pass\n"
        "print(*sys.modules, file=sys.stderr)"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    loaded = told.stderr.split()
    assert "numpy" not in loaded
    assert "shtab" not in loaded
    own = [name for name in loaded if name.startswith("voxgran.") and not name.startswith("voxgran.cli")]
    assert len(own) <= most, own


def test_no_help_loads_numpy():
    """Nor any class whose parameters it shows: their texts stand in a table, which `make stubs` compares."""
    program = (
        "import contextlib, sys\nfrom voxgran.cli import main\nfrom voxgran.cli.commands import COMMANDS\n"
        "lines = [[name] for name in COMMANDS] + [['shape', 'solid_union'], ['clump', '--method', 'cluster']]\n"
        "for words in lines:\n"
        "    with contextlib.suppress(SystemExit):\n        main([*words, '--help'])\n"
        "    print(*words, sorted({'numpy', 'numba', 'scipy'} & sys.modules.keys()), file=sys.stderr)"
    )
    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert [line for line in told.stderr.splitlines() if not line.endswith(" []")] == []
    assert "--friction" in told.stdout
    assert "--target" in told.stdout


def test_choices_of_flags_are_those_of_the_package():
    assert typing.get_args(ColorBy) == flags.COLORS
    assert flags.KINDS == KINDS
    assert flags.LONGEST == LONGEST


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_of_each_command_ends_with_an_example(name, capsys):
    with pytest.raises(SystemExit):
        main([name, "--help"])
    assert f"voxgran {name}" in capsys.readouterr().out.partition("example:")[2]


def test_doctor_names_a_remedy_for_what_is_missing(monkeypatch, capsys):
    monkeypatch.setattr(examination, "PICTURE", "import sys; sys.exit(3)")
    monkeypatch.setattr(examination, "LITTLE_SPACE", 2**80)
    monkeypatch.setattr(examination, "_floors", lambda: {"numpy": "999.0"})
    assert main(["doctor"]) == 1
    text = capsys.readouterr().out
    assert "pip install -U 'numpy>=999.0'" in text
    assert "apt-get install -y libgl1" in text
    assert "free space" in text
    assert text.strip().endswith("what is marked <- needs mending")


@pytest.mark.exact_start("doctor compares the bits of ten jobs with the reference")
def test_doctor_lists_extras_and_what_they_lack(monkeypatch, capsys):
    lines = ["numpy>=2.0", 'nothere[mpi]>=1.0; extra == "lammps"', 'NumPy>=2.0; extra == "images"', 'x; extra == "dev"']
    monkeypatch.setattr(importlib.metadata, "requires", lambda name: lines)
    assert main(["doctor"]) == 0
    text = capsys.readouterr().out
    assert re.search(r"(?m)^\[images\] +installed$", text)
    assert re.search(r"(?m)^\[lammps\] +lacks nothere: pip install 'voxgran\[lammps\]'$", text)
    assert "[dev]" not in text
    assert text.rstrip().endswith("all good, without the extras [lammps]")


@pytest.mark.exact_start("doctor compares the bits of ten jobs with the reference")
def test_doctor_tells_other_bits(monkeypatch, capsys):
    monkeypatch.setitem(bits.REFERENCE, "clump", "0" * 16)
    monkeypatch.setattr(bits, "VERSIONS", {"numpy": importlib.metadata.version("numpy")})
    assert main(["doctor"]) == 1
    text = capsys.readouterr().out
    assert "1 of 10 small jobs differ from the reference: clump   <-" in text
    # other versions may have other bits
    monkeypatch.setattr(bits, "VERSIONS", {"numpy": "1.0"})
    assert main(["doctor"]) == 0
    assert (
        f"clump (made with other versions than numpy {importlib.metadata.version('numpy')})" in capsys.readouterr().out
    )


@pytest.mark.slow
def test_doctor_compiles_beforehand(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv("VOXGRAN_CACHE", str(tmp_path))
    monkeypatch.setattr(beforehand, "cache_folder", lambda: tmp_path / "kernels")
    scene = partial(winding_numbers, np.ones((1, 3, 3)), np.zeros((1, 3)))
    refused = partial(beforehand.pack_few, "rsa", "disk")
    monkeypatch.setattr(beforehand, "scenes", lambda: [scene, refused])
    monkeypatch.setattr(beforehand, "PROCESSES", 1)
    assert main(["doctor", "--warm", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kernels"] == 1
    assert main(["doctor", "--warm"]) == 0
    text = capsys.readouterr()
    assert text.out.startswith("nothing was left to compile")
    assert "compiling kernels (once per machine)" in text.err
    steps = []
    assert beforehand.warm(steps.append).kernels == 0
    assert [(step.stage, step.done, step.total) for step in steps] == [("compiling", 1, 2), ("compiling", 2, 2)]


@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
def test_each_method_and_kind_of_shape_is_compiled_beforehand():
    tasks = [task for task in beforehand.scenes() if isinstance(task, partial)]
    packed = {task.args for task in tasks if task.func is beforehand.pack_few}
    assert packed == {(method, family) for method in vg.packing_methods() for family in beforehand.FAMILIES}
    for method in vg.packing_methods():
        # what is refused has no kernels, and nobody would see it
        beforehand.pack_few(method, "sphere")
    for method, more in beforehand.ASKED.items():
        beforehand.pack_few(method, "sphere", **more)
    beforehand.overlap_few()
    settled = {task.args[0] for task in tasks if task.func is beforehand.settle_few}
    kinds = {SPHERE, CONVEX, SURFACE, OUTLINE}
    assert set(kinds_of([vg.make_shape(family) for family in settled]).tolist()) == kinds


@pytest.mark.slow
def test_each_family_of_shapes_is_compiled_beforehand(monkeypatch, tmp_path):
    made = {task.args[0] for task in beforehand.scenes() if getattr(task, "func", None) is beforehand.make_few}
    assert made == set(vg.shape_families()) - {"learned"}  # it needs a model
    code = """
        import voxgran as vg
        from voxgran._base.kernels import cache_folder
        from voxgran.cli.warm import make_few
        make_few("random_growth")
        kernels = len(list(cache_folder().glob("*.kernel")))
        vg.make_shape("random_growth", seed=2, power=2.0, cubes=300)
        vg.make_shape("random_growth", seed=3, aspect=(3, 2, 1))
        print(kernels, len(list(cache_folder().glob("*.kernel"))))
    """
    environment = {**os.environ, "VOXGRAN_CACHE": str(tmp_path)}
    words = [sys.executable, "-c", textwrap.dedent(code)]
    before, after = subprocess.run(words, env=environment, check=True, capture_output=True, text=True).stdout.split()
    assert int(before) == int(after) >= 2


def test_several_seeds_are_shown_with_their_scatter(scene, tmp_path, capsys):
    scene.write_text(scene.read_text().replace("seed = 1", "seed = 1\nseeds = 2").replace("vtk = true", "vtk = false"))
    assert main(["run", str(scene), "-o", str(tmp_path / "out")]) == 0
    text = capsys.readouterr().out
    assert "standard error" in text
    assert "seeds                    1, 2" in text


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["init", "x.toml", "--over"], "--overwrite"),
        (["study", "study.toml", "-o", "out", "--dry"], "--dry-run"),
        (["shape", "torus", "--see", "3"], "--seed"),
        (["clump", "rock.stl", "--meth", "optimal"], "--method"),
    ],
)
def test_flags_are_written_out(words, meant, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    status, line = complaint(capsys, *words)
    assert (status, f"did you mean {meant!r}?" in line) == (2, True), line
    assert not list(tmp_path.iterdir())


def test_short_flags_may_stand_together(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    _, line = complaint(capsys, "plan", "missing.toml", "-qv")
    assert "missing.toml is not there" in line


def test_the_kernels_of_beds_of_many_grains_are_compiled_beforehand():
    used = (balance._visit, impulses._act, projected_gradient._project_blocks, projected_gradient._add_up)
    for one in used:
        one._compiled = None
    beforehand.settle_many()
    assert all(one._compiled.signatures for one in used)
    assert (morton.MANY, projected_gradient.MANY) == (20_000, 100_000)
