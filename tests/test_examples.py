"""Each example runs, and one number of it is pinned."""

import doctest
import importlib
import json
import re
import runpy
from pathlib import Path

import pytest

import voxgran as vg

EXAMPLES = Path(__file__).parents[1] / "examples"

# small scenes have no bulk to speak of, which is said in a warning
pytestmark = pytest.mark.filterwarnings("ignore:the bulk holds")


def printed(name, capsys, monkeypatch, *arguments):
    monkeypatch.setattr("sys.argv", [name, *arguments])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    return capsys.readouterr().out


def test_pack_rocks(tmp_path, capsys, monkeypatch):
    text = printed("pack_rocks.py", capsys, monkeypatch, str(tmp_path))
    assert "grains 60  verified True" in text
    solid = float(re.search(r"([\d.]+)$", text.strip()).group(1))
    assert 0.34 < solid < 0.56
    assert vg.load(tmp_path / "packing.vtp").count == 60


def test_scan_to_shape(tmp_path, capsys, monkeypatch):
    text = printed("scan_to_shape.py", capsys, monkeypatch, str(tmp_path))
    assert float(re.search(r"volume off by ([\d.]+) %", text).group(1)) < 1.0
    assert float(re.search(r"mean residual ([\d.]+) noises", text).group(1)) < 2.0
    assert len(vg.load_cloud(tmp_path / "scan.ply")) > 20_000


def test_directions(tmp_path, capsys, monkeypatch):
    text = printed("directions.py", capsys, monkeypatch, str(tmp_path), "80")
    one_step = dict(re.findall(r"(2D 8|3D 26|2D any|3D any) direction\S*\s+fourth moment: 1 step ([\d.]+)", text))
    # 8 steps: 4 of (1, 0) and 4 of (1, 1); 26: 6, 12 and 8 of (1, 0, 0), (1, 1, 0) and (1, 1, 1)
    assert float(one_step["2D 8"]) == pytest.approx(4 / 3 * (4 * 1 + 4 * 2) / (4 * 1 + 4 * 4), abs=0.01)
    assert float(one_step["3D 26"]) == pytest.approx(5 / 3 * (6 + 12 * 2 + 8 * 3) / (6 + 12 * 4 + 8 * 9), abs=0.01)
    assert float(one_step["2D any"]) == pytest.approx(1.0, abs=0.01)
    assert float(one_step["3D any"]) == pytest.approx(1.0, abs=0.01)
    assert text.count("verified True") == 4
    assert (tmp_path / "directions.svg").exists()


def test_control_studies(tmp_path, capsys, monkeypatch):
    text = printed("control_studies.py", capsys, monkeypatch, str(tmp_path), "90", "600", "1")
    beds = re.findall(r"^(.{14}) (.{12}) bulk (\S+) .* mean height (\S+) ", text, flags=re.MULTILINE)
    bulk, height = ({(row[0].strip(), row[1].strip()): float(row[k]) for row in beds} for k in (2, 3))
    assert len(beds) == len((tmp_path / "control_studies.csv").read_text().splitlines()) - 1 == 15
    assert len({bulk[key] for key in (("feeding rate", "0.05"), ("boundaries", "periodic"), ("shape", "sphere"))}) == 1
    # spheres that rain and are shaken a little; a bed between walls holds less in each layer, and stands higher
    assert 0.42 < bulk["way of feeding", "rain"] < 0.52
    assert height["boundaries", "walls"] > height["boundaries", "periodic"] + 0.4
    assert height["boundaries", "cylinder"] > height["boundaries", "periodic"] + 0.4
    assert (tmp_path / "control_studies.svg").exists()


def test_fit_clump(capsys, monkeypatch):
    text = printed("fit_clump.py", capsys, monkeypatch)
    overlaps = [float(value) for value in re.findall(r"overlap ([\d.]+)", text)]
    assert overlaps[1] > 0.83
    assert overlaps[1] > overlaps[0] + 0.05


@pytest.mark.parametrize(
    ("name", "count", "low", "high"),
    [("disks_in_plane", 120, 0.40, 0.55), ("spheres_in_cylinder", 120, 0.25, 0.30)],
)
def test_scenes(name, count, low, high, tmp_path):
    result = vg.Scene.from_toml(EXAMPLES / f"{name}.toml").run(tmp_path / "out")
    assert result.verification.ok
    assert result.packing.count == count
    assert low < result.packing.solid_fraction < high
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["grains"] == count
    assert vg.load(tmp_path / "out" / "packing.vtp").position.tobytes() == result.packing.position.tobytes()


def test_rocks_scene_leaves_a_page_and_files(tmp_path):
    result = vg.Scene.from_toml(EXAMPLES / "rocks_in_box.toml").run(tmp_path / "out")
    assert result.verification.ok
    assert result.packing.unit == "mm"
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"packing.vtp", "scene.vtm", "statistics.nc", "report.html", "summary.json"} <= names
    assert "checkpoint.voxgran" not in names
    assert "<svg" in (tmp_path / "out" / "report.html").read_text()
    assert result.summary["counters"]["voxelized_shapes"] == 60 * 4


PACKAGE = EXAMPLES.parent / "voxgran"
DOCUMENTED = sorted(
    path.relative_to(EXAMPLES.parent).with_suffix("").as_posix().replace("/", ".").removesuffix(".__init__")
    for path in PACKAGE.rglob("*.py")
    if ">>> " in path.read_text()
)


@pytest.mark.parametrize("name", DOCUMENTED)
def test_examples_in_docstrings_give_what_they_say(name):
    found = doctest.testmod(importlib.import_module(name), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert found.attempted > 0
    assert found.failed == 0
