"""The site is built without a warning, and its pages open from the file system."""

import importlib
import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NEEDED = ("sphinx", "myst_parser", "numpydoc", "pydata_sphinx_theme")
WITHOUT_NETWORK = re.compile(r"""<(?:script|link|img)[^>]+(?:src|href)=["'](?:https?:)?//""")


@pytest.mark.slow
@pytest.mark.skipif(
    not all(map(importlib.util.find_spec, NEEDED)), reason="sphinx is not installed: pip install voxgran[docs]"
)
def test_the_site_is_built_without_a_warning_and_needs_no_network(tmp_path):
    words = ["-W", "--keep-going", "-q", "-b", "html", "-D", "sphinx_gallery_conf.plot_gallery=0"]
    command = [sys.executable, "-m", "sphinx", *words, "-d", str(tmp_path / "cache"), "docs", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    pages = sorted((tmp_path / "site").rglob("*.html"))
    assert len(pages) > 200
    for page in pages:
        text = page.read_text()
        assert not WITHOUT_NETWORK.search(text), page
        for target in re.findall(r'<a[^>]+href="([^"#?]+\.html)', text):
            assert "://" in target or (page.parent / target).exists(), (page, target)
    settling = (tmp_path / "site/guide/settling.html").read_text()
    assert "glossary.html#term-" in settling
    assert (
        "https://numpy.org/doc/stable/glossary.html#term-array_like"
        in (tmp_path / "site/reference/names/voxgran.pack.html").read_text()
    )
    assert "voxgran.Packing.verify" in (tmp_path / "site/reference/names/voxgran.Packing.html").read_text()


def test_the_names_of_other_projects_exist(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "docs")
    table = importlib.import_module("site_inventories").OUTSIDE
    names = [name for _, names in table.values() for role, name, _ in names if role == "py:class" and "." in name]
    assert len(names) > 3
    for name in names:
        module, _, attribute = name.rpartition(".")
        assert hasattr(importlib.import_module(module), attribute), name
