"""Bars of progress at a terminal: that of the present stage is shown, and no other."""

import argparse
import contextlib
import io
import time

import pytest
import rich.progress

from voxgran._base.progress import Step, repeated
from voxgran.cli.terminal import progress


class Terminal(io.StringIO):
    """An error stream with a person before it."""

    def isatty(self):
        return True


@pytest.fixture
def bars(monkeypatch):
    """Return the bars that are made."""
    made = []

    class Noted(rich.progress.Progress):
        def __init__(self, *columns, **options):
            super().__init__(*columns, **options)
            made.append(self)

    monkeypatch.setattr(rich.progress, "Progress", Noted)
    return made


def steps(*told, **how):
    """Tell steps, as stage, done and total, at a terminal."""
    options = argparse.Namespace(quiet=False, json=False)
    with contextlib.redirect_stderr(Terminal()), progress(options, **how) as on_step:
        for stage, done, total in told:
            on_step(Step(stage=stage, done=done, total=total))


def visible(bars):
    return [(task.description, task.completed) for task in bars[0].tasks if task.visible]


def test_a_stage_that_another_one_follows_is_not_shown_any_more(bars):
    # settling ends where grains rest, which is long before its last step
    steps(("packing", 9, 9), ("settling", 7, 100), ("finishing", 0, 5), ("surfaces", 99, 100), ("finishing", 2, 5))
    assert visible(bars) == [("finishing", 2)]


def test_a_stage_that_comes_back_is_shown_again(bars):
    steps(("compiling", 0, 0), ("packing", 1, 9), ("compiling", 0, 0), ("packing", 2, 9))
    assert visible(bars) == [("packing", 2)]


@pytest.mark.parametrize("timed", [True, False])
def test_what_tells_its_time_has_no_other_time_beside_it(bars, timed):
    steps(("runs", 1, 9), timed=timed)
    texts = [getattr(column, "text_format", "") for column in bars[0].columns]
    assert ("{task.fields[left]}" in texts) == timed


@pytest.mark.parametrize(("total", "told"), [(5, False), (1000, True)])
def test_a_few_steps_tell_no_time(bars, total, told):
    """Those of finishing a scene take from milliseconds to a minute."""
    steps(("finishing", 0, total), ("finishing", 1, total), ("finishing", 2, total))
    assert bool(bars[0].tasks[0].fields["left"]) == told


@pytest.mark.parametrize(("given", "told"), [({}, True), ({"quiet": True}, False), ({"json": True}, False)])
def test_a_log_has_a_line_every_ten_seconds_also_of_a_stage_that_says_nothing_more(monkeypatch, given, told):
    options = argparse.Namespace(**{"quiet": False, "json": False, **given})
    log = io.StringIO()
    with contextlib.redirect_stderr(log), progress(options) as on_step:
        on_step(Step(stage="compiling", done=0, total=0))
        assert log.getvalue() == ""
        monkeypatch.setattr("voxgran._base.progress.SECONDS", 0.05)
        with repeated(on_step) as say:
            say(Step(stage="finishing", done=1, total=5, text="measuring"))
            time.sleep(0.3)
    assert ("voxgran: finishing: measuring (after" in log.getvalue()) == told
    assert (log.getvalue().count("\n") > 1) == told
