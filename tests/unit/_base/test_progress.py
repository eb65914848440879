"""Lines for a person who waits, where nobody shows the steps."""

import io
import sys
from types import SimpleNamespace

import pytest

import voxgran as vg
from voxgran._base import progress
from voxgran._base.progress import ProgressLines, Step, reported, silent


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


def test_only_who_waits_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    at_terminal(monkeypatch)
    assert isinstance(reported(None), ProgressLines)
    assert reported(silent) is silent
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)
    for stream in (io.StringIO(), None):
        monkeypatch.setattr(sys, "stderr", stream)
        assert reported(None) is None
    monkeypatch.setitem(sys.modules, "ipykernel", progress)
    assert isinstance(reported(None), ProgressLines)
    # a notebook without an error stream loses the line, not the run
    ProgressLines(told=-1e9)(settling("a"))


def test_a_long_packing_says_what_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = at_terminal(monkeypatch)
    monkeypatch.setattr(progress, "SECONDS", 0.0)
    asked = (vg.shapes.sphere(), vg.Box((4, 4, 4)))
    vg.pack(*asked, method="rsa", count=3)
    assert terminal.getvalue().startswith("voxgran: packing")
    terminal.truncate(0)
    vg.pack(*asked, method="rsa", count=3, on_step=silent)
    assert "voxgran" not in terminal.getvalue()
