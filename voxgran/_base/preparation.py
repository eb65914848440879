"""Processor time of what is done once in a process: libraries that are imported, kernels that are compiled or loaded.

Whoever compares the seconds of runs counts it, to leave it out.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass


@dataclass(slots=True)
class Preparation:
    """Processor time of this process that preparation has taken, in seconds."""

    seconds: float = 0.0
    depth: int = 0


_counted: ContextVar[Preparation | None] = ContextVar("counted", default=None)


@contextmanager
def counting_preparation() -> Iterator[Preparation]:
    """Count the preparation that happens meanwhile in this thread (context manager)."""
    count = Preparation()
    token = _counted.set(count)
    try:
        yield count
    finally:
        _counted.reset(token)


@contextmanager
def preparing() -> Iterator[None]:
    """Count what happens meanwhile as preparation, if anybody asks for it (context manager); it may be nested."""
    count = _counted.get()
    if count is None:
        yield
        return
    began = time.process_time()
    count.depth += 1
    try:
        yield
    finally:
        count.depth -= 1
        if not count.depth:
            count.seconds += time.process_time() - began
