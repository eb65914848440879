"""The Python of the pages runs as it is written, in an empty folder, without files of a checkout."""

import re
from pathlib import Path

import pytest

import voxgran as vg
from voxgran._base.errors import EngineError

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted((ROOT / "docs").glob("guide/*.md"))
#: blocks that need files of the reader, or a cluster
NOT_RUN = ("scene.toml", "study.toml", "dask_jobqueue", "labels.tif")


def blocks_of(page):
    """Return the blocks of Python of a page that can be run."""
    found = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    return [block for block in found if not any(word in block for word in NOT_RUN)]


def test_the_first_lines_of_the_readme_print_what_it_says(tmp_path, monkeypatch, capsys):
    page = ROOT / "README.md"
    block = blocks_of(page)[0]
    told = re.search(r"^```text\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    assert 'packing.plot(color_by="coordination")' in block
    monkeypatch.chdir(tmp_path)
    exec(block.replace('packing.plot(color_by="coordination")', "None"), {})
    assert capsys.readouterr().out == told.group(1)


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.stem)
def test_pages_name_no_files_of_a_checkout(page):
    for block in blocks_of(page):
        assert not re.search(r"""load\w*\(["'](data/|eros|bennu|itokawa|bunny|\w+\.obj)""", block), block


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::voxgran._base.errors.PackingWarning")
@pytest.mark.parametrize("page", [page for page in PAGES if blocks_of(page)], ids=lambda page: page.stem)
def test_the_python_of_pages_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for block in blocks_of(page):
        try:
            exec(compile(block, page.name, "exec"), names)
        except EngineError as error:
            pytest.skip(str(error))
    assert names["vg"] is vg
