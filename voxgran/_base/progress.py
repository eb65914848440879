"""Progress of long work, reported through a callback.

Whoever runs it shows it (the command line with rich) or leaves it. Where nobody does, a person who waits at a terminal
or in a notebook is told every ten seconds what happens, and elsewhere the log.
"""

import contextlib
import logging
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Protocol

from voxgran._base.errors import InputError, shown

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Progress of a piece of work."""

    stage: str  # such as ``"packing"``
    done: int  # units of work done
    total: int  # units of work in all; 0 if not known
    text: str = ""  # short line for a person, such as the solid fraction so far


class OnStep(Protocol):
    """A function that is called at each step."""

    def __call__(self, step: Step, /) -> None:
        """Take note of a step."""


#: seconds after which a person who waits is told what happens, and between two lines
SECONDS = 10.0


@dataclass(slots=True)
class ProgressLines:
    """A callback that writes a line on the error stream, or into the log, every ten seconds, and at once that kernels
    are compiled.
    """

    began: float = field(default_factory=time.monotonic)
    told: float = field(default_factory=time.monotonic)
    compiling: bool = False  # whether it was said that kernels are compiled
    logged: bool = False  # whether lines are records of the log

    def __call__(self, step: Step, /) -> None:
        """Write a line if it is due."""
        now = time.monotonic()
        compiles = step.stage == "compiling" and not self.compiling
        if now - self.told < SECONDS and not compiles:
            return
        self.told, self.compiling = now, self.compiling or compiles
        line = f"{step.stage}{f': {step.text}' if step.text else ''} (after {now - self.began:.0f} s)"
        if self.logged:
            log.info(line)
            return
        # where the error stream takes nothing there is nobody to tell
        with contextlib.suppress(OSError, ValueError, AttributeError):
            sys.stderr.write(f"voxgran: {line}\n")
            sys.stderr.flush()


def silent(step: Step, /) -> None:
    """Leave a step unreported, also to a person who waits."""


def reported(on_step: OnStep | None) -> OnStep | None:
    """Return the callback, or if there is none, one that writes lines where a person waits at a terminal or in a
    notebook, and elsewhere into the log, where that takes records of the level INFO.

    Raises
    ------
    InputError
        If it is given and no function.
    """
    if on_step is not None:
        if not callable(on_step):
            raise InputError(f"on_step is {shown(on_step)}: it must be a function of a step; change it")
        return on_step
    watched = "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty())
    return ProgressLines(logged=not watched) if watched or log.isEnabledFor(logging.INFO) else None


def numbered(on_step: OnStep | None, number: int, total: int) -> OnStep | None:
    """Return a callback that says of which of several pieces of work, numbered from 0, a step is."""
    if on_step is None or total == 1:
        return on_step

    def tell(step: Step, /) -> None:
        on_step(replace(step, stage=f"{step.stage} {number + 1}/{total}"))

    return tell


@contextlib.contextmanager
def repeated(on_step: OnStep | None) -> Iterator[OnStep]:
    """Give a callback for stages that report only their beginning (context manager).

    Where lines are written for a person, the last step is passed on every second, so that one is written every ten
    seconds while a stage takes long.
    """
    told = reported(on_step)
    if not isinstance(told, ProgressLines):
        yield told or silent
        return
    last: list[Step] = []
    ended = threading.Event()

    def note(step: Step, /) -> None:
        last[:] = [step]
        told(step)

    def repeat() -> None:
        while not ended.wait(SECONDS / 10):
            if last:
                told(last[0])

    watch = threading.Thread(target=repeat, name="voxgran progress", daemon=True)
    watch.start()
    try:
        yield note
    finally:
        ended.set()
        watch.join()
