"""Pages of methods and families, made from the registries: each entry has one, with all parts and all parameters."""

import importlib
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from kit import slow

import voxgran as vg
from voxgran._base.config import parameters_of
from voxgran.clumps.method import clump_registry
from voxgran.packing.method import method_registry
from voxgran.shapes.family import families

pytestmark = pytest.mark.usefixtures("jagged_pictures")

DOCS = Path(__file__).parents[3] / "docs"
sys.path.insert(0, str(DOCS))
PAGES = importlib.import_module("methods_pages")
CASES = importlib.import_module("method_cases")
ENTRIES = [(kind, name) for kind in PAGES.KINDS for name in kind.registry().names()]
REGISTRIES = {"packing": method_registry, "clumps": clump_registry, "shapes": families}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("docs") / "methods"
    written = PAGES.write_pages(folder, pictures=False)
    assert len(written) == len(ENTRIES) + len(PAGES.KINDS) + 1
    return folder


def test_every_entry_has_an_example_and_no_example_lacks_an_entry():
    for kind in PAGES.KINDS:
        assert set(kind.cases) == set(REGISTRIES[kind.folder]().names())


@pytest.mark.parametrize(("kind", "name"), ENTRIES, ids=lambda value: getattr(value, "folder", value))
def test_a_page_has_all_parts(folder, kind, name):
    page = (folder / kind.folder / f"{name}.md").read_text()
    entry = REGISTRIES[kind.folder]().get(name)
    assert page.startswith(f"# {name}\n")
    parts = re.split(r"^## (.*)$", page, flags=re.MULTILINE)
    contents = dict(zip(parts[1::2], parts[2::2], strict=True))
    assert list(contents) == ["When to take it", "Example", "Parameters", "Cost and error", "Source"]
    assert all(len(text.strip()) > 10 for text in contents.values())
    assert "Not measured" not in contents["Cost and error"]
    assert entry.summary[1:].rstrip(".") in parts[0]
    assert re.search(r"doi:(\S+?)(?=[;,]|$)", entry.source) is None or "https://doi.org/10." in contents["Source"]
    assert "```python" in contents["Example"]
    # the same parameters as in the registry, in the same order
    rows = re.findall(r"^\| `(\w+)` \| (.*?) \| (.*?) \| (.*?) \| (.*) \|$", contents["Parameters"], re.MULTILINE)
    items = parameters_of(entry.parameters)
    assert [row[0] for row in rows] == [item.name for item in items]
    for (_, kind_of, default, unit, meaning), item in zip(rows, items, strict=True):
        assert (kind_of, unit, meaning) == (item.type_text, item.unit, item.doc)
        assert default in {"", "must be given", f"`{item.default!r}`"}
    for target in re.findall(r"\]\((\.\./\.\./[^)#]+)\)", page):
        assert (DOCS / "methods" / kind.folder / target).resolve().is_file(), target


def test_an_index_shows_the_pictures_that_are_there(tmp_path):
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "clumps_optimal.png").touch()
    clumps = PAGES.KINDS[1]
    page = PAGES.index_of(clumps, tmp_path)
    # not as raw HTML, whose files Sphinx does not copy
    assert re.findall(r"!\[.*?\)", page) == ["![optimal](../pictures/clumps_optimal.png)"]
    assert "<img" not in page


def test_indexes_list_every_entry(folder):
    for kind in PAGES.KINDS:
        page = (folder / kind.folder / "index.md").read_text()
        assert re.findall(r"\]\((\w+)\.md\)", page) == list(REGISTRIES[kind.folder]().names())


@pytest.mark.parametrize("name", list(CASES.PACKING))
def test_scenes_of_the_examples_are_those_of_the_calls(name, tmp_path):
    case = CASES.PACKING[name]
    text = PAGES.packing_scene(name, case)
    assert tomllib.loads(text)["packing"] == {"method": name, **case.options}
    (tmp_path / "scene.toml").write_text(text)
    scene = vg.Scene.from_toml(tmp_path / "scene.toml")
    assert scene.plan() is not None
    found = {}
    # all but the call of `pack`
    exec("\n".join(PAGES.packing_call(name, case).splitlines()[:-1]), found)
    assert np.asarray(found["container"].bounds) == pytest.approx(np.asarray(scene.container.bounds), rel=1e-12)
    assert found["shape"].name == case.shape["family"]


@pytest.mark.filterwarnings("ignore:the bulk holds")
@pytest.mark.parametrize("name", [slow("digital_fill"), slow("expand"), "rsa"])
def test_calls_of_the_examples_give_the_packings_of_their_scenes(name, tmp_path):
    scene = PAGES.packing_scene(name, CASES.PACKING[name])
    (tmp_path / "scene.toml").write_text(f"{scene}\n[output]\nreport = false\nstatistics = false\n")
    found = {}
    exec(PAGES.packing_call(name, CASES.PACKING[name]), found)
    result = vg.Scene.from_toml(tmp_path / "scene.toml").run(tmp_path / "out")
    assert result.verification.ok
    assert result.packing.position.tobytes() == found["packing"].position.tobytes()


def test_a_machine_that_cannot_draw_gets_pages_without_pictures(tmp_path, monkeypatch):
    def no_screen(*_, **__):
        raise RuntimeError("no EGL")

    monkeypatch.setattr(PAGES, "picture_packing", no_screen)
    packing = PAGES.KINDS[0]
    with pytest.warns(UserWarning, match="no pictures: no EGL"):
        assert not PAGES._draw(packing, "expand", CASES.PACKING["expand"], tmp_path / "expand.png")
    assert PAGES._picture(packing, "expand", tmp_path) == []


def test_pages_that_do_not_change_are_not_written_again(tmp_path):
    path = PAGES._write(tmp_path / "page.md", "a")
    before = path.stat().st_mtime_ns
    PAGES._write(path, "a")
    assert path.stat().st_mtime_ns == before


def test_the_generator_runs_from_another_folder(tmp_path):
    code = f"import sys; sys.path.insert(0, {str(DOCS)!r}); import methods_pages; print(len(methods_pages.KINDS))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "3"
