"""`voxgran study`: what it prints and writes, how it is stopped and goes on, and one line per mistake."""

import contextlib
import csv
import json
import os
import re
import signal
import subprocess
import sys
import time

import pytest
from kit import slow, small_scene

import voxgran as vg
from voxgran.cli import main

pytestmark = pytest.mark.usefixtures("jagged_pictures")

SCENE = (
    small_scene(count=5)
    + """[measure]
which = ["density"]
"""
)
STUDY = """
scene = "scene.toml"
seeds = 2
[axes]
"packing.count" = [4, 9]
"""
#: enough runs to be stopped in the middle
LONG = STUDY.replace("[4, 9]", "[4, 5, 6, 7]").replace("seeds = 2", "seeds = 200")


@pytest.fixture
def file(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path / "study.toml"


def test_a_study_is_planned_run_and_shown(file, tmp_path, capsys, here):
    out = tmp_path / "out"
    words = ["study", str(file), "-o", str(out), "--workers", "1"]
    assert main([*words, "--dry-run"]) == 0
    text = capsys.readouterr().out
    assert "2 cells with 2 seeds each: packing.count 2" in text
    assert "0 done, 0 failed, 4 to compute" in text
    assert not out.exists()
    assert main([*words, "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers == {"runs": 4, "computed": 4, "failed": 0, "ended_full": 0, "not_verified": 0, "warned": 4}
    assert main([*words, "--resume"]) == 0
    text = capsys.readouterr().out
    assert re.search(r"^ +9 +2/2 +2 +9 +0\.0736\d? ", text, re.M)
    assert "results in" in text
    assert re.search(r"^computed +0$", text, re.M)
    assert "full:" not in text
    assert main([*words, "--dry-run", "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert [cell["done"] for cell in plan["cells"]] == [2, 2]
    assert float(vg.load_statistics(out / "study.nc")["count"].sel({"packing.count": 9, "seed": 1})) == 9


def test_runs_that_ended_full_are_counted(file, tmp_path, capsys, here):
    scene = SCENE.replace("rsa", "deposition") + "[settle]\nenabled = false\n"
    (tmp_path / "scene.toml").write_text(scene)
    file.write_text(STUDY.replace("[4, 9]", "[4, 100]"))
    out = tmp_path / "out"
    assert main(["study", str(file), "-o", str(out), "--workers", "1"]) == 0
    text = capsys.readouterr().out
    assert re.search(r"^packing.count +seeds +full +warned +count", text, re.M)
    assert re.search(r"^ +4 +2/2 +0 +2 +4 ", text, re.M)
    assert re.search(r"^ +100 +2/2 +2 +2 +[1-9]\d ", text, re.M)
    assert re.search(r"^full: runs that ended where nothing more had room", text, re.M)
    assert re.search(r"^ended full +2$", text, re.M)
    assert re.search(r"^warned: 2 of 4 runs, such as: .*\bof 100\b", text, re.M), text
    assert re.search(r"^warned +4$", text, re.M)
    page = (out / "study.html").read_text()
    assert "<th>full</th>" in re.sub(r"<th[^>]*>", "<th>", page)
    assert "Full: runs that ended" in page
    with (out / "cells.csv").open() as lines:
        assert [row["full"] for row in csv.DictReader(lines)] == ["0", "2"]


def complaints(text):
    """Return the lines of an error stream without those of progress, of which a busy machine writes some."""
    return [line for line in text.splitlines() if not re.search(r" \(after \d+ s\)$", line)]


def test_failures_are_told_and_give_status_1(file, tmp_path, capsys, here):
    file.write_text(STUDY + '"container.lengths" = [[4, 4, 4], [0.5, 0.5, 0.5]]\n')
    assert main(["study", str(file), "-o", str(tmp_path / "out"), "--workers", "1"]) == 1
    told = capsys.readouterr()
    assert "0/2" in told.out
    # what failed is no packing that could be verified, and what no run has measured has no column
    assert re.search(r"^not verified +0$", told.out, re.M)
    assert "bed_solid_fraction" not in told.out
    (line,) = complaints(told.err)
    assert line.startswith("voxgran: 4 of 8 runs failed: ")


@pytest.mark.parametrize(
    ("words", "text", "told"),
    [
        ([], STUDY.replace("packing.count", "packing.cuont"), "did you mean 'count'"),
        ([], STUDY.replace("packing.count", "cuont"), "axis 'cuont' is unknown"),
        ([], STUDY.replace("scene.toml", "sene.toml"), "sene.toml is not there"),
        ([], "seeds = 3", "neither scene nor base"),
        (["--workers", "0"], STUDY, "workers is 0"),
        (["--memory", "much"], STUDY, "memory is 'much'"),
        (["--wokers", "3"], STUDY, "did you mean '--workers'"),
    ],
)
def test_mistakes_are_one_line_and_status_2(file, tmp_path, capsys, words, text, told):
    file.write_text(text)
    assert main(["study", str(file), "-o", str(tmp_path / "out"), *words]) == 2
    line = capsys.readouterr().err
    assert told in line
    assert len(line.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def started(file, out):
    """Return a study that runs in a process of its own, once it has finished a few runs, and the processes of it."""
    file.write_text(LONG)
    command = [sys.executable, "-m", "voxgran", "study", str(file), "-o", str(out), "--workers", "2"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    until = time.monotonic() + 120
    while time.monotonic() < until and len(list(out.glob("cells/*.json"))) < 3:
        time.sleep(0.01)
    with open(f"/proc/{process.pid}/task/{process.pid}/children", encoding="ascii") as found:
        workers = [int(number) for number in found.read().split()]
    assert len(workers) == 2
    return process, workers


def ended(numbers):
    """Return whether processes end within ten seconds."""
    until = time.monotonic() + 10
    while time.monotonic() < until and any(os.path.exists(f"/proc/{number}/exe") for number in numbers):
        time.sleep(0.05)
    return not any(os.path.exists(f"/proc/{number}/exe") for number in numbers)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), slow(signal.SIGTERM, 143)])
def test_a_study_that_is_stopped_says_how_to_go_on(file, tmp_path, capsys, number, status):
    out = tmp_path / "out"
    process, workers = started(file, out)
    began = time.monotonic()
    process.send_signal(number)
    _, told = process.communicate(timeout=60)
    seconds = time.monotonic() - began
    assert process.returncode == status
    assert seconds < 2.0
    first, second = complaints(told)
    assert re.fullmatch(r"voxgran: stopped after \d+ of 800 runs, which are kept: .*", first)
    assert second == f"voxgran: to go on: voxgran study {file} -o {out} --workers 2"
    assert ended(workers)
    assert not list(out.glob("cells/.*"))
    kept = len(list(out.glob("cells/*.json")))
    assert main(["study", str(file), "-o", str(out), "--dry-run"]) == 0
    assert f"{kept} done, 0 failed, {800 - kept} to compute" in capsys.readouterr().out


@contextlib.contextmanager
def stopping_at_once(options, *, timed):
    """Ask the process to stop at the first step, in place of showing progress."""
    yield lambda step: signal.raise_signal(signal.SIGTERM)


def test_a_study_that_is_stopped_before_its_first_run_says_how_to_go_on(file, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("voxgran.cli.studies.progress", stopping_at_once)
    words = ["study", str(file), "-o", str(tmp_path / "out"), "--workers", "1"]
    assert main([*words, "--overwrite"]) == 143
    assert capsys.readouterr().err.splitlines() == [
        "voxgran: stopped before the first of 4 runs was finished: the same command computes them",
        f"voxgran: to go on: voxgran {' '.join(words)}",
    ]


@pytest.mark.slow
def test_the_processes_of_a_study_that_is_killed_end(file, tmp_path):
    process, workers = started(file, tmp_path / "out")
    process.kill()
    process.communicate()
    assert ended(workers)
    # the folder is free again
    file.write_text(STUDY)
    assert main(["study", str(file), "-o", str(tmp_path / "out"), "--workers", "1"]) == 0
