"""Threads of a call: kernels whose rows do not depend on each other run on blocks of them at the same time.

Functions with an argument `threads` open a team, and the kernels that are called meanwhile find it, so that nothing
between them passes a number on. Without a team, as in packing methods, one thread does all. Kernels release the GIL.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import TypeVar

from voxgran._base.arrays import as_count
from voxgran._base.kernels import Kernel
from voxgran._base.machine import processor_count

Result = TypeVar("Result")


@dataclass(slots=True)
class _Team:
    """Number of threads of a call, and what runs them, made when it is first needed."""

    count: int = 1
    pool: ThreadPoolExecutor | None = field(default=None)

    def run(self, jobs: Sequence[Callable[[], Result]]) -> list[Result]:
        """Call functions, at most `count`, at the same time, and return what they return."""
        if self.pool is None:
            self.pool = ThreadPoolExecutor(self.count)
        begun = [self.pool.submit(copy_context().run, job) for job in jobs[1:]]
        try:
            first = jobs[0]()
        finally:
            # no thread goes on where a signal ends the call
            wait(begun)
        return [first, *(job.result() for job in begun)]


_team: ContextVar[_Team | None] = ContextVar("team", default=None)


@contextmanager
def using_threads(threads: int | None) -> Iterator[None]:
    """Let the kernels that are called meanwhile run on several threads (context manager).

    None stands for the threads of the call around this one; without one, for as many as there are processors, or for
    the number in the variable ``OMP_NUM_THREADS`` of the environment where that is smaller.

    Raises
    ------
    InputError
        If `threads` is no whole number above 0.
    """
    if threads is None and _team.get() is not None:
        yield
        return
    team = _Team(_most_threads() if threads is None else as_count(threads, "threads", at_least=1))
    token = _team.set(team)
    try:
        yield
    finally:
        _team.reset(token)
        if team.pool is not None:
            team.pool.shutdown()


def thread_count() -> int:
    """Return how many threads kernels may use at this place."""
    team = _team.get()
    return 1 if team is None else team.count


def in_blocks(work: Kernel, count: int, *arguments: object, least: int = 1, begin: int = 0) -> None:
    """Call a kernel with these arguments and the first and last row + 1 of each block of `count` rows from `begin` on.

    Blocks have at least `least` rows, of which the work is worth a thread; there are as many blocks as threads.
    """
    at_once([partial(work, *arguments, begin + first, begin + last) for first, last in blocks_of(count, least)])


def blocks_of(count: int, least: int, parts: int = 1) -> list[tuple[int, int]]:
    """Return the first and last row + 1 of blocks of `count` rows, of at least `least` rows.

    There are as many blocks as threads, or `parts` for each where rows differ in their work.
    """
    threads = thread_count()
    blocks = max(min(parts * threads if threads > 1 else 1, count // least), 1)
    return list(pairwise(count * b // blocks for b in range(blocks + 1)))


def at_once(jobs: Sequence[Callable[[], Result]]) -> list[Result]:
    """Call functions at the same time, not more than there are threads, and return what they return, in their order."""
    team = _team.get()
    if team is None or len(jobs) <= 1:
        return [job() for job in jobs]
    return team.run(jobs)


def _most_threads() -> int:
    """Return the number of threads of calls that name none."""
    asked = os.environ.get("OMP_NUM_THREADS", "")
    return min(processor_count(), int(asked) or 1) if asked.isdecimal() else processor_count()
