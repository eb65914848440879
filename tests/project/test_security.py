"""The promises of SECURITY.md about files of strangers that no other test holds."""

import ast
import io
import pickle
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

import voxgran as vg
from voxgran._base.errors import VoxgranError

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "voxgran"
FILES = sorted(path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py"))
#: pickles of our own: compiled kernels in the cache of the user, and requests between the processes of a test
PICKLES = {"_base/compiling/kernel_files.py", "testing/kill.py", "testing/packing_methods.py"}
#: modules that run, or restore, what a file holds
RUNNING = {"cloudpickle", "code", "dill", "joblib", "jsonpickle", "marshal", "pickle", "runpy", "shelve", "yaml"}
UNPACKING = {"extract", "extractall", "unpack_archive"}
#: what a hostile file would do
TOUCH = "import pathlib; pathlib.Path({!r}).touch()"


def dangers(tree, name):
    """Find what could execute a file, or write what an archive names."""
    found = []
    for node in ast.walk(tree):
        modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        modules += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            last = called.split(".")[-1]
            first = node.args[:1] if last in {"load", "import_module"} else []
            modules += [one.value for one in first if isinstance(one, ast.Constant)]
            words = {word.arg: word.value for word in node.keywords}
            if called in {"eval", "exec", "compile", "os.system", "os.popen"} or last in UNPACKING:
                found.append(f"line {node.lineno}: {called}")
            if called in {"np.load", "numpy.load"} and ast.unparse(words.get("allow_pickle", node)) != "False":
                found.append(f"line {node.lineno}: {called} without allow_pickle=False")
            if "shell" in words and ast.unparse(words["shell"]) != "False":
                found.append(f"line {node.lineno}: {called} by a shell")
            if last == "Environment" and ast.unparse(words.get("autoescape", node)) != "True":
                found.append(f"line {node.lineno}: {called} without autoescape=True")
        roots = {str(module).split(".")[0] for module in modules} & RUNNING
        if roots and name not in PICKLES:
            found.append(f"line {node.lineno}: imports {', '.join(sorted(roots))}")
    return found


@pytest.mark.parametrize(
    "source",
    [
        "eval('1')",
        "exec(text)",
        "os.system(text)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "subprocess.run(text, shell=True)",
        "import pickle",
        "from yaml import load",
        "load('dill').loads(text)",
        "archive.extractall(folder)",
        "jinja2.Environment(loader=loader)",
    ],
)
def test_what_executes_files_is_found(source):
    assert dangers(ast.parse(source), "io/sample.py") != []


def test_harmless_calls_are_not_found():
    harmless = "np.load(p, allow_pickle=False)\nre.compile(p)\nload('scipy')\njinja2.Environment(autoescape=True)"
    assert dangers(ast.parse(harmless), "io/sample.py") == []


@pytest.mark.parametrize("name", FILES)
def test_nothing_in_a_file_is_executed(name):
    assert dangers(ast.parse((PACKAGE / name).read_text()), name) == []


def test_templates_take_only_figures_as_markup():
    templates = list(PACKAGE.rglob("*.j2"))
    assert templates
    for path in templates:
        text = path.read_text()
        assert "autoescape" not in text
        # matplotlib escapes what it writes (tests/unit/report/test_plots.py)
        assert set(re.findall(r"\{\{[^}]*\|\s*safe\b[^}]*\}\}", text)) <= {"{{ figure.svg | safe }}"}, path.name


class Hostile:
    """An object whose pickle makes a file when it is read."""

    def __init__(self, mark):
        self.mark = str(mark)

    def __reduce__(self):
        return exec, (TOUCH.format(self.mark),)


READERS = [
    lambda path: vg.load_labels(path, voxel_size=1.0),
    vg.load_image,
    vg.load_shape,
    vg.load,
    lambda path: vg.load_cloud(path),
]


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".vtp", ".nc", ".stl", ".csv", ".xyz", ".pkl", ".toml"])
def test_pickled_objects_are_refused(suffix, tmp_path):
    mark, path = tmp_path / "touched", tmp_path / f"hostile{suffix}"
    held = np.array([Hostile(mark)], dtype=object)
    if suffix == ".npy":
        np.save(path, held, allow_pickle=True)
    elif suffix == ".npz":
        np.savez(path, held, allow_pickle=True)
    else:
        path.write_bytes(pickle.dumps(Hostile(mark)))
    for read in READERS:
        with pytest.raises(VoxgranError):
            read(path)
    with pytest.raises(VoxgranError):
        vg.Scene.from_toml(path)
    assert not mark.exists()
    # the file is as hostile as it should be
    if suffix == ".npy":
        np.load(path, allow_pickle=True)
        assert mark.exists()


def test_archives_that_grow_without_bound_are_refused(tmp_path):
    path, body = tmp_path / "bomb.npz", io.BytesIO()
    np.save(body, np.zeros((100, 100, 100), dtype=np.int64))
    with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_BZIP2) as archive:
        archive.writestr("labels.npy", body.getvalue())
    assert path.stat().st_size < body.tell() / 10_000
    with pytest.raises(VoxgranError, match=r"compressed by method 12: .*DEFLATE \(8\); save it again"):
        vg.load_image(path)


def test_arrays_that_state_more_than_they_hold_are_refused(tmp_path):
    path, body = tmp_path / "lie.npz", io.BytesIO()
    np.lib.format.write_array_header_1_0(body, {"descr": "<i8", "fortran_order": False, "shape": (10**12,)})
    with zipfile.ZipFile(path, "w", compression=zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("labels.npy", body.getvalue())
    with pytest.raises(VoxgranError):
        vg.load_image(path)


def test_entities_of_xml_that_grow_are_refused(tmp_path):
    rows = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 12))
    head = f'<?xml version="1.0"?><!DOCTYPE VTKFile [<!ENTITY a0 "0 0 0 ">{rows}]>'
    (tmp_path / "laughs.vtp").write_text(f'{head}<VTKFile type="PolyData">&a11;</VTKFile>')
    for read in (vg.load, vg.load_shape):
        with pytest.raises(VoxgranError):
            read(tmp_path / "laughs.vtp")
