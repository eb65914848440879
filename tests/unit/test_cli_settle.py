"""`voxgran settle` and `voxgran equilibrium`: what they write and print, and one line per mistake."""

import contextlib
import dataclasses
import json
import signal

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.checkpoint import load_checkpoint, save_checkpoint
from voxgran._base.config import parameters_of
from voxgran._base.seeds import stream
from voxgran.cli import main
from voxgran.cli.commands import COMMANDS
from voxgran.cli.parser import parse
from voxgran.cli.settling import parameters_given
from voxgran.settling.parameters import Lid, Settling, Shaking

BOX = vg.Box((3, 3, 8), periodic="xy")


def loose(many=12, *, gravity="-z", box=BOX):
    """Return spheres on a loose lattice, moved a little, that do not touch."""
    places = np.stack(np.meshgrid([0.75, 2.25], [0.75, 2.25], np.arange(1, 8, 1.5), indexing="ij"), -1).reshape(-1, 3)
    places = places[np.argsort(places[:, 2], kind="stable")][:many]
    places = places + stream(3, "loose").uniform(-0.1, 0.1, places.shape)
    return vg.Packing.of(vg.make_shape("sphere"), box, position=places, gravity=gravity)


@pytest.fixture
def file(tmp_path):
    vg.save(loose(), tmp_path / "loose.vtp")
    return tmp_path / "loose.vtp"


def complaint(capsys, *words):
    status = main([str(word) for word in words])
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1, lines
    assert lines[0].startswith("voxgran: ")
    return status, lines[0]


def test_a_packing_settles_and_is_written(file, tmp_path, capsys):
    out = tmp_path / "new" / "bed.vtp"
    assert main(["settle", str(file), "-o", str(out), "--friction", "0.3", "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    bed = vg.load(out)
    same = vg.settle(loose(), friction=0.3)
    assert bed.position.tobytes() == same.position.tobytes()
    assert numbers["grains"] == 12
    assert numbers["stop_reason"] == "settled"
    assert numbers["steps"] == bed.provenance["settling"]["steps"] > 0
    assert numbers["share_at_rest"] == bed.forces.share_at_rest
    assert numbers["verify"]["ok"] is True
    assert bed.position[:, 2].mean() < loose().position[:, 2].mean() - 0.1
    assert [path.name for path in out.parent.iterdir()] == ["bed.vtp"]
    words = ["equilibrium", str(out), "--json"]
    assert main(words) == 0
    found = json.loads(capsys.readouterr().out)
    # the friction is that with which the grains settled
    assert found["friction"] == 0.3
    assert found["rests"] is True
    assert len(found["largest_residuals"]) == 10
    # one word, one number: that of the settled bed is that of the proof
    assert found["share_at_rest"] == numbers["share_at_rest"]
    assert main(words[:2]) == 0
    shown = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    of_others = found["share_at_rest_without_rattlers"]
    assert f"share at rest {found['share_at_rest']:.6g} of all grains" in shown
    assert f"share at rest without rattlers {of_others:.6g} of the grains that are no rattlers" in shown
    assert main([*words, "--friction", "0", "--rest", "1"]) == 1
    assert json.loads(capsys.readouterr().out)["friction"] == 0.0


def test_spheres_of_text_settle_and_the_summary_is_readable(tmp_path, capsys):
    rows = [f"{x} {y} {z} 0.5" for x, y, z in loose().position]
    (tmp_path / "spheres.txt").write_text("\n".join(rows) + "\n")
    words = ["settle", str(tmp_path / "spheres.txt"), "-o", str(tmp_path / "bed.vtp"), "--fall-time", "2"]
    assert main(words) == 0
    shown = capsys.readouterr()
    assert "assumed container" in shown.err
    for word in ("steps", "solid fraction", "share at rest", "share of rattlers", "verify", "overlapping pairs 0"):
        assert word in shown.out
    assert main(["equilibrium", str(tmp_path / "bed.vtp")]) in (0, 1)
    text = capsys.readouterr().out
    assert "share at rest" in text
    assert "grain " in text


def test_grains_in_the_air_do_not_rest(file, capsys):
    assert main(["equilibrium", str(file)]) == 1
    text = capsys.readouterr().out
    assert text.startswith("rests                    no")
    assert "rattlers                 none" in text


@pytest.mark.parametrize("direction", ["-x", "+y", "-1,0,0", "0,0,-1", "0.6,0,-0.8"])
def test_a_direction_of_gravity_may_begin_with_a_minus(direction):
    options = parse(["settle", "a.vtp", "--gravity", direction, "-o", "b.vtp"], COMMANDS)
    expected = [float(value) for value in direction.split(",")] if "," in direction else direction
    assert options.gravity == expected
    assert options.output == "b.vtp"


def test_each_parameter_of_settling_has_a_flag():
    words = ["settle", "a.vtp", "-o", "b.vtp"]
    assert parameters_given(parse(words, COMMANDS), Settling) == {}
    given = {"friction": 0.2, "restitution": 0.1, "fall_time": 3, "rest": 0.9, "parts": "hulls", "solid_fraction": 0.6}
    given |= {"porosity": 0.4, "void_ratio": 0.7}
    groups = {"shaking": (Shaking, {"acceleration": 2, "duration": 4}), "lid": (Lid, {"weight": 0.5})}
    assert {*given, *groups} == {item.name for item in parameters_of(Settling)}
    for name, value in given.items():
        words += [f"--{name.replace('_', '-')}", str(value)]
    for name, (cls, values) in groups.items():
        assert set(values) == {item.name for item in parameters_of(cls)}
        for key, value in values.items():
            words += [f"--{name}-{key}", str(value)]
    assert parameters_given(parse(words, COMMANDS), Settling) == given | {
        name: values for name, (_, values) in groups.items()
    }


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (["--frction", "0.3"], "did you mean '--friction'"),
        (["--friction", "-0.3"], "friction is -0.3"),
        (["--friction", "rough"], "friction is 'rough': it must be a number"),
        (["--rest", "2"], "rest is 2"),
        (["--shaking-duration", "0"], "duration is 0"),
        (["--gravity", "x"], "gravity is 'x'"),
        (["--gravity", "-x"], "walled axis"),
        (["--periodic", "xy"], "which voxgran wrote: leave it out"),
    ],
)
def test_mistakes_are_one_line_and_status_2(file, tmp_path, capsys, more, expected):
    status, line = complaint(capsys, "settle", file, "-o", tmp_path / "bed.vtp", *more)
    assert status == 2
    assert expected in line
    assert not (tmp_path / "bed.vtp").exists()


def test_files_that_are_missing_there_already_or_of_another_kind_are_told(file, tmp_path, capsys):
    for words, expected in (
        (["settle", file], "-o/--output"),
        (["settle", tmp_path / "none.vtp", "-o", tmp_path / "bed.vtp"], "is not there"),
        (["settle", file, "-o", tmp_path / "bed.xyz"], "has the suffix '.xyz'"),
        (["settle", file, "-o", file], "it is not replaced unasked; give --overwrite, or another name"),
    ):
        status, line = complaint(capsys, *words)
        assert status == 2
        assert expected in line


def test_grains_that_the_output_cannot_hold_are_told_before_they_settle(tmp_path, capsys):
    cubes = vg.Packing.of(vg.make_shape("platonic", solid="cube"), BOX, position=[[1.5, 1.5, 2.0]])
    vg.save(cubes, tmp_path / "cubes.vtp")
    for name in ("bed.txt", "bed.csv"):
        status, line = complaint(capsys, "settle", tmp_path / "cubes.vtp", "-o", tmp_path / name)
        assert status == 2
        assert "text holds only spheres" in line
    assert [path.name for path in tmp_path.iterdir()] == ["cubes.vtp"]


def test_the_checkpoint_of_another_run_is_told(file, tmp_path, capsys, monkeypatch):
    words = ["settle", str(file), "-o", str(tmp_path / "bed.vtp")]
    with monkeypatch.context() as patched:
        patched.setattr("voxgran.cli.settling.progress", stopping_at_step)
        assert main(words) == 143
    capsys.readouterr()
    status, line = complaint(capsys, *words, "--resume", "--friction", "0.3")
    assert status == 2
    assert "belongs to another run" in line
    assert "the options that wrote it, or start anew: without it, or at the prompt with --overwrite" in line
    (kept,) = tmp_path.glob("*.checkpoint.voxgran")
    header, arrays = load_checkpoint(kept)
    arrays.pop("velocity")
    save_checkpoint(kept, header, arrays)
    status, line = complaint(capsys, *words, "--resume")
    assert status == 2
    assert "'velocity' of the checkpoint has nothing, which this version of voxgran keeps" in line


def test_a_packing_without_gravity_needs_a_direction(tmp_path, capsys):
    path = tmp_path / "loose.vtp"
    vg.save(loose(gravity=None), path)
    for command, more in (("settle", ["-o", tmp_path / "bed.vtp"]), ("equilibrium", [])):
        status, line = complaint(capsys, command, path, *more)
        assert status == 2
        assert "--gravity -z" in line
    flat = vg.Packing.of([vg.make_shape("disk")], vg.Disk(2), position=[(0, 0, 0)], gravity=None)
    vg.save(flat, tmp_path / "flat.vtp")
    for command, more in (("settle", ["-o", tmp_path / "bed.vtp"]), ("equilibrium", [])):
        assert "--gravity -y" in complaint(capsys, command, tmp_path / "flat.vtp", *more)[1]
    assert main(["equilibrium", str(path), "--gravity", "-z"]) == 1
    assert main(["settle", str(path), "--gravity", "-z", "-o", str(tmp_path / "bed.vtp"), "-q"]) == 0


@contextlib.contextmanager
def stopping_at_step(options, number=5):
    """Ask the process to stop at a step, in place of showing progress."""
    seen = []

    def stop(step):
        seen.append(step)
        if len(seen) == number:
            signal.raise_signal(signal.SIGTERM)

    yield stop


def test_an_interrupt_leaves_a_checkpoint_and_the_command_that_goes_on(file, tmp_path, capsys, monkeypatch):
    words = ["settle", str(file), "-o", str(tmp_path / "bed.vtp"), "--shaking-duration", "2"]
    with monkeypatch.context() as patched:
        patched.setattr("voxgran.cli.settling.progress", stopping_at_step)
        assert main([*words, "--overwrite"]) == 143
    lines = capsys.readouterr().err.strip().splitlines()
    assert "resume from" in lines[0]
    assert lines[1] == f"voxgran: to go on: voxgran {' '.join(words)} --resume"
    assert len(lines) == 2
    assert (tmp_path / "bed.checkpoint.voxgran").exists()
    status, line = complaint(capsys, *words)
    assert status == 2
    assert "is the checkpoint of an interrupted run: go on with --resume, or start anew with --overwrite" in line
    assert main([*words, "--resume"]) == 0
    whole = vg.settle(loose(), shaking={"duration": 2})
    assert vg.load(tmp_path / "bed.vtp").position.tobytes() == whole.position.tobytes()
    assert not list(tmp_path.glob("*checkpoint*"))


def test_compress_writes_a_specimen_that_equilibrium_proves(tmp_path, capsys):
    loose, specimen = tmp_path / "loose.vtp", tmp_path / "specimen.vtp"
    vg.save(vg.pack(vg.make_shape("sphere"), vg.Box((5, 5, 5), periodic="xyz"), "rsa", count=60), loose)
    assert (
        main(["compress", str(loose), "-o", str(specimen), "--friction", "0.3", "--stress", "1,1,1.2", "--json"]) == 0
    )
    found = json.loads(capsys.readouterr().out)
    assert found["stop_reason"] == "compressed"
    assert found["stress_z"] == pytest.approx(1.2, rel=0.01)
    assert found["void_ratio"] == pytest.approx(1 / found["solid_fraction"] - 1)
    assert not list(tmp_path.glob("*.checkpoint.voxgran"))
    assert main(["equilibrium", str(specimen), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["friction"] == 0.3
    assert main(["equilibrium", str(specimen), "--stress", "1,1,9", "--json"]) == 1
    assert main(["equilibrium", str(loose)]) == 2
    assert "--stress" in capsys.readouterr().err


def test_compress_refuses_a_stress_of_two_numbers_and_keeps_what_is_there(tmp_path, capsys):
    loose, there = tmp_path / "loose.vtp", tmp_path / "there.vtp"
    vg.save(vg.pack(vg.make_shape("sphere"), vg.Box((5, 5, 5), periodic="xyz"), "rsa", count=9), loose)
    there.write_text("kept")
    assert main(["compress", str(loose), "-o", str(there)]) == 2
    assert main(["compress", str(loose), "-o", str(there), "--stress", "1,2", "--overwrite"]) == 2
    assert there.read_text() == "kept"
    assert "it must be one number, or 3" in capsys.readouterr().err


def test_equilibrium_takes_the_materials_with_which_a_bed_came_to_rest(tmp_path, capsys):
    file, sphere = tmp_path / "bed.vtp", vg.make_shape("sphere")
    materials = vg.Materials({"a": {"friction": 0.6}, "b": {"friction": 0.2}}, shapes=["a", "b"], walls="a")
    bed = vg.pack([sphere, sphere], vg.Box((3, 3, 6)), "gravity", count=20, friction=materials)
    vg.save(bed, file)
    assert main(["equilibrium", str(file), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["friction"] == 0.6
    assert found["share_at_rest"] == vg.equilibrium(bed, materials).attrs["share_at_rest"] >= 0.95
    # without them the friction has to be given
    vg.save(dataclasses.replace(bed, provenance={}), file, overwrite=True)
    assert main(["equilibrium", str(file)]) == 2
    assert "or --friction 0.5" in capsys.readouterr().err
    assert main(["equilibrium", str(file), "--friction", "0.6"]) == 0
