"""The tutorial: its lines at the prompt in an empty folder, and its script (tests/test_pages.py runs its Python)."""

import re
import shlex
from pathlib import Path

import pytest

import voxgran as vg
from voxgran.cli import main

pytestmark = pytest.mark.usefixtures("jagged_pictures")

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "start" / "tutorial.md"


def blocks(kind):
    return re.findall(rf"^```{kind}\n(.*?)^```", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)


def test_the_script_of_the_gallery_is_the_code_of_the_page():
    script = (ROOT / "examples" / "tutorial.py").read_text().replace("folder / ", "")
    for line in "\n".join(blocks("python")).splitlines():
        assert line in script, line


def test_every_picture_is_made_by_the_script():
    script = (ROOT / "examples" / "tutorial.py").read_text()
    pictures = re.findall(r"!\[.{20,}\]\(\.\./figures/(.*?)\)", PAGE.read_text())
    assert pictures == re.findall(r'folder / "(.*?\.png)"', script)
    assert all((ROOT / "docs" / "figures" / name).is_file() for name in pictures)


@pytest.mark.slow
def test_the_lines_at_the_prompt_run_and_give_the_same_bed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (scene,) = blocks("toml")
    (tmp_path / "scene.toml").write_text(scene)
    lines = re.findall(r"^\$ voxgran (.*)$", "\n".join(blocks("console")), flags=re.MULTILINE)
    assert len(lines) == 8
    for line in lines:
        assert main(shlex.split(line)) == 0, line
    assert re.search(r"^share at rest +0\.9[5-9]", capsys.readouterr().out, flags=re.MULTILINE)
    packing = vg.load(tmp_path / "bed" / "packing.vtp")
    assert (packing.count, packing.unit) == (150, "mm")
    # the bed of the Python
    assert f"container_solid_fraction={packing.solid_fraction:.4f}," in PAGE.read_text()
    assert (tmp_path / "bed" / "report.html").is_file()
    assert (tmp_path / "lammps" / "lammps_run.in").is_file()
