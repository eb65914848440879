"""Lines for a person who waits, where nobody shows the steps."""

import io
import logging
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

import voxgran as vg
from voxgran._base import progress
from voxgran._base.progress import ProgressLines, Step, repeated, reported, silent


class Terminal(io.StringIO):
    """An error stream that is a terminal."""

    def isatty(self) -> bool:
        return True


def at_terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Replace the error stream within a test, since pytest sets its own between fixture and test."""
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    return stream


def settling(text: str) -> Step:
    return Step(stage="settling", done=1, total=0, text=text)


def test_a_line_comes_after_ten_seconds_and_not_before(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = at_terminal(monkeypatch)
    clock = iter((9.9, 10.0, 19.0, 20.5))
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    lines = ProgressLines(began=0.0, told=0.0)
    for text in ("a", "b", "c", "d"):
        lines(settling(text))
    assert terminal.getvalue().splitlines() == [
        "voxgran: settling: b (after 10 s)",
        "voxgran: settling: d (after 20 s)",
    ]


def test_compiling_is_said_at_once_and_one_time(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = at_terminal(monkeypatch)
    lines = ProgressLines()
    for _ in range(3):
        lines(Step(stage="compiling", done=0, total=0, text="kernels (once per machine)"))
    assert terminal.getvalue() == "voxgran: compiling: kernels (once per machine) (after 0 s)\n"


def test_only_who_waits_is_told_and_the_log(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    at_terminal(monkeypatch)
    assert isinstance(reported(None), ProgressLines)
    assert reported(silent) is silent
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    for stream in (io.StringIO(), None):
        monkeypatch.setattr(sys, "stderr", stream)
        assert reported(None) is None
        with caplog.at_level(logging.INFO, "voxgran"):
            lines = reported(None)
            assert isinstance(lines, ProgressLines)
            lines(Step(stage="compiling", done=0, total=0, text="kernels (once per machine)"))
        assert caplog.messages == ["compiling: kernels (once per machine) (after 0 s)"]
        caplog.clear()
    monkeypatch.setitem(sys.modules, "ipykernel", progress)
    assert isinstance(reported(None), ProgressLines)
    # a notebook without an error stream loses the line, not the run
    ProgressLines(told=-1e9)(settling("a"))


def test_a_long_packing_says_what_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = (vg.shapes.sphere(), vg.Box((4, 4, 4)))
    # in a fresh environment kernels are compiled first, which is told too
    vg.pack(*asked, method="rsa", count=3)
    terminal = at_terminal(monkeypatch)
    monkeypatch.setattr(progress, "SECONDS", 0.0)
    vg.pack(*asked, method="rsa", count=3)
    assert terminal.getvalue().startswith("voxgran: packing")
    terminal.truncate(0)
    vg.pack(*asked, method="rsa", count=3, on_step=silent)
    assert "voxgran" not in terminal.getvalue()


def test_a_stage_that_says_nothing_more_is_told_again(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = at_terminal(monkeypatch)
    monkeypatch.setattr(progress, "SECONDS", 0.1)
    with repeated(None) as told:
        told(settling("a"))
        told(settling("b"))
        end = time.monotonic() + 20
        while terminal.getvalue().count("settling: b") < 3 and time.monotonic() < end:
            time.sleep(0.01)
    assert terminal.getvalue().count("settling: b") >= 3
    # nothing is told after the end
    assert "voxgran progress" not in [thread.name for thread in threading.enumerate()]


def test_who_shows_steps_gets_each_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SECONDS", 0.01)
    steps: list[Step] = []
    with repeated(steps.append) as told:
        told(settling("a"))
        time.sleep(0.1)
    assert steps == [settling("a")]
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    with repeated(None) as told:
        assert told is silent


def test_the_end_of_a_run_says_what_it_does(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    terminal = at_terminal(monkeypatch)
    monkeypatch.setattr(progress, "SECONDS", 0.0)
    scene = vg.Scene.from_mapping(
        {
            "shape": [{"family": "sphere"}],
            "container": {"kind": "box", "lengths": [4, 4, 4]},
            "packing": {"method": "rsa", "count": 3},
            "measure": {"which": ["gradation"]},
            "output": {"report": False, "vtk": False, "statistics": False},
        }
    )
    scene.run(tmp_path / "out")
    assert "voxgran: finishing: measuring" in terminal.getvalue()
