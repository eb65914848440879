"""The package of examples/plugin and the examples of the page on extensions pass the suites, as if installed."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from kit import install

import voxgran as vg

ROOT = Path(__file__).parents[2]
PLUGIN = ROOT / "examples" / "plugin"
PAGE = (ROOT / "docs" / "contribute" / "extending.md").read_text()
PROJECT = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]
TESTS = ("test_voxgran_cubic.py", "test_voxgran_bowl.py")
#: number of tests in the suite of each kind that its page names; the last are skipped
KINDS = {"wedge": (5, 0), "mean_height": (5, 0), "ring": (7, 1), "table": (9, 2)}

USE_OF_RING = """
import voxgran as vg

packing = {"method": "digital", "count": 3}
mapping = {"shape": [{"family": "sphere"}], "container": {"kind": "ring", "size": 1.5}, "packing": packing}
mapping["settle"], mapping["output"] = {"enabled": False}, dict.fromkeys(("vtk", "report", "statistics"), False)
bed = vg.Scene.from_mapping(mapping).run("out").packing
for name in ("bed.vtp", "bed.txt"):
    bed.save(name)
    assert vg.load(name).container.size == 1.5
"""


def run(folder, *command):
    """Run a module of Python in a folder whose packages are found; return its output."""
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(
        [sys.executable, "-m", *command], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


USE_OF_PLUGIN = """
assert packing.count == 20
assert vg.verify(packing).ok
assert packing.stop_reason == "count"
assert bed.count == 40
assert vg.verify(bed).ok

from voxgran.cli import main

def test_it_is_known_at_the_prompt(capsys):
    main(["methods"]), main(["methods", "cubic"])
    told = capsys.readouterr().out
    assert "grains on the sites of a simple cubic lattice" in told
    assert "at least 0" in told
"""


def suites_of(folder, more=""):
    """Run the tests of a folder after the lines that its page shows, and more; return what pytest tells of each."""
    example = re.search(r"```python\n(.*?)```", (PLUGIN / "about.md").read_text(), flags=re.DOTALL)[1]
    (folder / "test_use.py").write_text(example + USE_OF_PLUGIN + more)
    return run(folder, "pytest", "-v", "-p", "no:dash", "-p", "no:cacheprovider")


def check_plugin(found):
    """Look at what the tests of the plugin have given."""
    assert len(re.findall(rf"^({'|'.join(TESTS)})::.* PASSED", found, re.MULTILINE)) == 22, found
    assert "test_use.py::test_it_is_known_at_the_prompt PASSED" in found
    assert "the suites: 20 tests" in (PLUGIN / "about.md").read_text()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with the plugin and the examples of the page, as if installed."""
    made = tmp_path_factory.mktemp("installed")
    for path in PLUGIN.glob("*.py"):
        (made / path.name).write_text(path.read_text())
    install(made, "voxgran_example", PROJECT["entry-points"])
    blocks = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    groups = dict(re.findall(r"`voxgran\.[a-z.]+\.(\w+)` \| `(voxgran\.\w+)`", PAGE))
    for name in KINDS:
        at = next(k for k, block in enumerate(blocks) if f'name="{name}"' in block or f'= "{name}", 3' in block)
        (made / f"{name}.py").write_text(blocks[at])
        (made / f"test_{name}.py").write_text(blocks[at + 1])
        entry = next(group for kind, group in groups.items() if f"registration = {kind}(" in blocks[at])
        install(made, "voxgran-ring" if name == "ring" else name, {entry: {name: f"{name}:registration"}})
    return made


@pytest.fixture(scope="module")
def found(folder):
    """Return what pytest tells of all tests of that folder, which one process runs."""
    return suites_of(folder, USE_OF_RING)


@pytest.mark.slow
def test_the_plugin_works_by_its_entry_point(folder, found):
    check_plugin(found)
    for name in ("bed.vtp", "bed.txt"):
        with pytest.raises(vg.VoxgranError, match="is of the package 'voxgran-ring', which is not installed: install"):
            vg.load(folder / name)


@pytest.mark.dist
def test_the_plugin_works_after_pip_has_installed_it(tmp_path):
    if "VOXGRAN_DIST" not in os.environ:
        pytest.skip("pip fetches the build backend: make test-dist")
    run(tmp_path, "pip", "install", "--quiet", "--no-deps", "--target", str(tmp_path), str(PLUGIN))
    assert {path.name for path in tmp_path.iterdir()} >= {
        "voxgran_cubic.py",
        "voxgran_bowl.py",
        "voxgran_example-1.0.dist-info",
    }
    for path in PLUGIN.glob("test_*.py"):
        (tmp_path / path.name).write_text(path.read_text())
    check_plugin(suites_of(tmp_path))


def test_the_examples_of_the_page_pass_their_suites(found):
    for name, counts in KINDS.items():
        told = (len(re.findall(rf"^test_{name}\.py::.* {word}", found, re.MULTILINE)) for word in ("PASSED", "SKIPPED"))
        assert tuple(told) == counts, found


def test_the_table_of_the_page_names_the_groups_that_the_registries_read():
    from voxgran.containers.model import container_registry
    from voxgran.decks.engine import engine_registry
    from voxgran.measures.model import measure_registry
    from voxgran.packing.method import method_registry
    from voxgran.shapes.family import families

    for registry in (container_registry(), engine_registry(), measure_registry(), method_registry(), families()):
        entry = f"`{registry.entry.__module__}.{registry.entry.__name__}`"
        assert f"| {registry.kind} | {entry} | `{registry.group}` |" in PAGE
