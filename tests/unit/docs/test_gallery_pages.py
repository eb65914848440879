"""The gallery: headers of the scripts, descriptions of their pictures, and how pictures are collected."""

import ast
import importlib
import os
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.image import imsave

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))
sys.path.insert(0, str(ROOT / "docs"))
GALLERY = importlib.import_module("gallery")
#: calls that write a picture
SAVERS = (
    r"\b(\w+\.savefig|imsave|matplotlib\.image\.imsave|vg\.save_(?:gallery|clump_picture|picture))\((?!clumps, rows_in)"
)


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_has_a_title_a_paragraph_and_described_pictures(path):
    text = path.read_text()
    words = ast.get_docstring(ast.parse(text), clean=False).strip("\n").split("\n")
    assert set(words[1]) == {"="}
    assert len(words[1]) == len(words[0])
    assert words[2] == ""
    assert len(" ".join(words[3:])) > 60
    found = GALLERY.descriptions_in(text)
    assert found
    assert all(len(one) > 20 and one.endswith(".") for one in found)
    # first_contact saves two pictures by one call
    assert len(found) == len(re.findall(SAVERS, text)) + (path.stem == "first_contact")
    assert "__file__" not in text  # a notebook has none
    # cells have text that reStructuredText reads: bold titles and full sentences
    for title in re.findall(r"^# %%\n(.*)$", text, flags=re.MULTILINE):
        assert re.fullmatch(r"# \*\*.+\*\*", title)


def test_the_front_page_lists_every_script_and_every_scene():
    page = (EXAMPLES / "GALLERY_HEADER.rst").read_text()
    assert set(re.findall(r":doc:`(\w+)`", page)) == {path.stem for path in SCRIPTS}
    scenes = {path.relative_to(EXAMPLES).as_posix() for path in EXAMPLES.rglob("*.toml") if "plugin" not in path.parts}
    assert set(re.findall(r"^   \* - ``(.*\.toml)``$", page, flags=re.MULTILINE)) == scenes


def test_descriptions_are_read_over_lines():
    code = "# Picture: One.\nsave()\nfor k in range(2):\n    # Picture: Two lines\n    #   of text.\n    save()\n"
    assert GALLERY.descriptions_in(code) == ["One.", "Two lines of text."]


def test_the_folder_of_a_script_is_emptied(tmp_path, monkeypatch):
    monkeypatch.setattr(GALLERY, "OUTPUT", tmp_path)
    (tmp_path / "directions").mkdir()
    (tmp_path / "directions" / "old.png").write_bytes(b"")
    assert GALLERY.arguments_of({}, {"src_file": "/a/directions.py"}) == [str(tmp_path / "directions")]
    assert not (tmp_path / "directions").exists()


def test_pictures_of_a_cell_are_collected_once(tmp_path, monkeypatch):
    monkeypatch.setitem(
        sys.modules,
        "sphinx_gallery.scrapers",
        SimpleNamespace(figure_rst=lambda files, _, text: f"{Path(files[0]).name}: {text}\n"),
    )
    monkeypatch.setattr(GALLERY, "OUTPUT", tmp_path)
    folder = tmp_path / "one"
    folder.mkdir()
    images = iter([tmp_path / "image_1.png", tmp_path / "image_2.png"])
    given = {"src_file": "one.py", "example_globals": {}, "image_path_iterator": images}
    imsave(folder / "b.png", np.zeros((4, 4, 3), dtype=np.uint8))
    (folder / "a.svg").write_text("<svg/>")
    os.utime(folder / "a.svg", ns=(2**62, 2**62))  # written last
    (folder / "a.csv").write_text("")
    code = "# Picture: First.\n# Picture: Second.\n"
    shown = GALLERY.collect_pictures(("code", code, 1), given, {"src_dir": tmp_path})
    assert shown == "image_1.png: First.\nimage_2.svg: Second.\n"
    assert (tmp_path / "image_2.svg").read_text() == "<svg/>"
    assert GALLERY.collect_pictures(("code", "", 9), given, {"src_dir": tmp_path}) == ""
    with pytest.raises(ValueError, match=r"one\.py wrote 0 pictures and describes 1: each picture needs one comment"):
        GALLERY.collect_pictures(("code", "# Picture: None.\n", 9), given, {"src_dir": tmp_path})


def test_the_cells_that_notebooks_get_are_python():
    names = {}
    before = sys.argv
    try:
        exec(GALLERY.FIRST_CELL, names)
        assert len(sys.argv) == 1
    finally:
        sys.argv = before
    compile(GALLERY.LAST_CELL, "last", "exec")


def test_the_settings_are_names_and_relative_paths():
    for value in GALLERY.SPHINX_GALLERY_CONF.values():
        assert not callable(value)
        assert str(ROOT) not in str(value)


def test_only_the_folder_of_the_scripts_is_a_gallery():
    # sphinx-gallery takes every folder with one of these files for a gallery of its own
    heads = [path for path in EXAMPLES.rglob("*") if path.stem in {"README", "readme", "GALLERY_HEADER"}]
    assert [path.relative_to(EXAMPLES).as_posix() for path in heads] == ["GALLERY_HEADER.rst"]
