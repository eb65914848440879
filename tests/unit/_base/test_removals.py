"""Every place of the package that removes, renames or cuts a file or a folder, with what tells it that it may."""

import ast
from pathlib import Path

import voxgran

PACKAGE = Path(voxgran.__file__).parent
#: functions and methods that take something from the disk; `replace` of a path has one argument, that of a text two
CALLS = {"unlink", "rmtree", "rmdir", "remove_tree", "ftruncate", "truncate"}
OF_OS = {"os.remove", "os.replace", "os.rename", "os.removedirs", "os.renames", "shutil.move"}
PLACES = {
    ("app/runs.py", "_ended"): "the file of the growing bed of a run, which it has written itself",
    ("app/serve.py", "serve"): "the page that leads to the app, which it has written under a random name",
    ("app/scan.py", "stop"): "the folder of a packing that is made of a scan, which it has begun itself",
    ("scene/scans.py", "finish"): "the folder of a packing of a scan that could not be made, which it has begun itself",
    ("app/desk.py", "upload"): "an upload that is no shape, which it has written itself under a new name",
    ("_base/checkpoint.py", "remove_checkpoint"): "the file begins as a checkpoint",
    ("_base/compiling/kernel_files.py", "save"): "a draft of its own, with a random name",
    ("_base/compiling/kernel_files.py", "remove_forgotten"): "its name and its first bytes are those of a kernel",
    ("_base/files.py", "written_whole"): "a folder that it has made, if it is empty",
    ("_base/files.py", "_replace"): "a folder whose files are all known by name and content",
    ("_base/files.py", "_remove"): "a draft, by the hash and the random number in its name",
    ("_base/lock.py", "_locked"): "a lock that this process holds",
    ("_base/lock.py", "_sign"): "a lock that this process has just taken",
    ("decks/lammps_states.py", "lammps_states"): "outputs of LAMMPS in a folder that `relax` may overwrite",
    ("decks/relax.py", "remove_state"): "a packing whose provenance says that it was relaxed",
    ("decks/relax.py", "_remove"): "a temporary folder of its own",
    ("io/series.py", "_remove"): "the name of a snapshot, and the seal of a packing",
    ("study/engine.py", "run_study"): "a folder that it has made, if it is empty",
    ("study/runs.py", "remove"): "the time beside a checkpoint: a number",
    ("study/runs.py", "marked"): "the mark of this study, by its text",
}


def test_each_place_that_removes_something_is_known():
    found = set()
    for path in PACKAGE.rglob("*.py"):
        source = path.read_text()
        if not any(f".{name.rpartition('.')[2]}(" in source for name in (*CALLS, *OF_OS)):
            continue
        tree = ast.parse(source)
        functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
                continue
            name, text = node.func.attr, ast.unparse(node.func)
            moves = name in ("replace", "rename") and len(node.args) == 1 and not node.keywords
            if name in CALLS or text in OF_OS or (moves and ast.unparse(node.func.value) != "dataclasses"):
                within = [one for one in functions if one.lineno <= node.lineno <= one.end_lineno]
                name = max(within, key=lambda one: one.lineno).name if within else ""
                found.add((path.relative_to(PACKAGE).as_posix(), name))
    assert found == set(PLACES)
