"""Bars of progress at a terminal: that of the present stage is shown, and no other."""

import argparse
import contextlib
import io

import pytest
import rich.progress

from voxgran._base.progress import Step
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
    kinds = [type(column) for column in bars[0].columns]
    assert (rich.progress.TimeRemainingColumn in kinds) == timed
