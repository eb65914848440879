"""Bad command lines: each flag of each command, in turn, gets each of thirty values that break naive code.

A command ends with an exit status and one line for each complaint, never with an error of Python or of a library.
`GOOD` has a command line of each command that is fine; those that take minutes, or change the machine, are left out.
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
import pytest

import voxgran as vg
from voxgran.cli import main
from voxgran.cli.commands import COMMANDS
from voxgran.cli.parser import make_parser

VALUES = (
    *(
        "",
        " ",
        "no",
        "true",
        "null",
        "nan",
        "inf",
        "-inf",
        "0",
        "-1",
        "2.5",
        "1e400",
        "5e-324",
        "1e308",
        "999999999999",
    ),
    *("--", "-", "[]", "{}", "[[1,2],[3]]", '{"a": 1}', ",", "a,b", "1,2,3,4,5", "/", "/dev/null", "/proc/self/mem"),
    *("a\0b", "\udcff", "é", "x" * 5000, "[" * 100_000, "1" * 5000, "%s", "$(x)", "-z"),
)

GOOD = {
    "init": ["new.toml"],
    "plan": ["scene.toml"],
    "verify": ["bed.vtp"],
    "settle": ["bed.vtp", "-o", "settled.vtp"],
    "compress": ["bed.vtp", "-o", "specimen.vtp"],
    "equilibrium": ["bed.vtp"],
    "measure": ["bed.vtp", "--which", "contacts"],
    "picture": ["bed.vtp", "-o", "bed.png", "--window", "60,60"],
    "image": ["info", "labels.npy"],
    "twin": ["many.vtp", "--protocol", "expand", "--voxel-size", "0.4", "-o", "twins"],
    "labels": ["labels.npy", "--voxel-size", "1"],
    "segment": ["labels.npy", "--threshold", "0", "--min-size", "1", "--voxel-size", "1"],
    "learn": ["many.vtp", "-o", "shapes.nc"],
    "shape": ["solid_union"],
    "repair": ["mesh.stl"],
    "tile": ["bed.vtp", "--repeats", "1", "-o", "tiled.vtp"],
    "simplify": ["mesh.stl", "--faces", "12"],
    "cloud": ["cloud.ply", "--method", "alpha"],
    "clump": ["mesh.stl", "--spheres", "2"],
    "export": ["bed.vtp", "-o", "deck"],
    "engines": [],
    "methods": [],
    "data": [],
}
#: a run, a page or an engine for each value takes minutes; what they are given is checked by what the others call
LEFT_OUT = {"run", "study", "report", "compare", "relax", "doctor", "demo", "app"}
#: flags that name what is written: absolute paths are left out, which would be written to
WRITTEN = {"--output", "--checkpoint", "--picture", "--gallery"}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Return a folder with the files that commands read, which is the present one."""
    monkeypatch.chdir(tmp_path)
    box = vg.make_shape("box", lengths=(1, 1, 1))
    vg.save_shape(box, "mesh.stl")
    vg.Packing.of(
        [vg.make_shape("sphere")], vg.Box((4, 4, 4)), position=[(1, 1, 0.5), (3, 3, 0.5)], gravity=(0.0, 0.0, -1.0)
    ).save("bed.vtp")
    rocks = vg.make_shapes("convex_polyhedron", count=12)
    vg.pack(rocks, vg.Box((3, 3, 3), periodic="xyz"), "expand", count=12, solid_fraction=0.3).save("many.vtp")
    vg.save_cloud(vg.Cloud.of(vg.sample_surface(box, spacing=0.1)), "cloud.ply")
    labels = np.zeros((6, 6, 6), dtype=int)
    labels[1:4, 2:5, 2:4] = 1
    np.save("labels.npy", labels)
    Path("scene.toml").write_text(
        '[[shape]]\nfamily = "sphere"\n[container]\nkind = "box"\nlengths = [4, 4, 4]\n'
        '[packing]\nmethod = "rsa"\ncount = 2\n'
    )
    return tmp_path


def flags_of(command, words):
    """Return the flags of a command that take a value."""
    top = make_parser([command, *words], COMMANDS)
    subparsers = next(action for action in top._actions if isinstance(action, argparse._SubParsersAction))
    actions = subparsers.choices[command]._actions
    return [action.option_strings[-1] for action in actions if action.option_strings and action.nargs != 0]


def without(words, flag):
    """Return the words without a flag and its value."""
    at = words.index(flag) if flag in words else len(words)
    return words[:at] + words[at + 2 :]


def test_all_commands_are_tried():
    assert GOOD.keys() | LEFT_OUT == COMMANDS.keys()


@pytest.mark.slow
@pytest.mark.parametrize("command", GOOD)
def test_bad_flags(command, place, capsys):
    words = GOOD[command]
    assert main([command, *words, "--overwrite", "-q"]) == 0
    capsys.readouterr()
    for flag in flags_of(command, words):
        short = {"--output": "-o"}.get(flag, flag)
        for value in VALUES:
            if flag in WRITTEN and value.startswith("/"):
                continue
            with warnings.catch_warnings(action="ignore"):
                status = main([command, *without(without(words, flag), short), f"{flag}={value}", "--overwrite", "-q"])
            told = capsys.readouterr()
            assert status in (0, 1, 2), (flag, value)
            assert all(line.startswith("voxgran: ") for line in told.err.splitlines()), (flag, value, told.err)
            assert all(len(line) < 1000 for line in told.err.splitlines()), (flag, value)
            # a packing that does not bear a stress is an answer, not a mistake
            assert status == 0 or told.err or (command, flag) == ("equilibrium", "--stress"), (flag, value)
