"""Kills a run at given moments, for the tests of packing methods: called in a process of its own."""

import os
import signal
import time
from pathlib import Path

from voxgran.packing import driver
from voxgran.packing.draw import Request
from voxgran.packing.pack import prepare_task


def kill_and_resume(request: Request, checkpoint: Path, shares: list[float], chunk: int | None) -> None:
    """Kill a run after each of some shares of its whole time, resuming it each time, and at last let it end.

    `chunk` is the number of attempts per chunk, None adapts it to
    the clock.
    """
    driver.CHECKPOINT_SECONDS = 0.0
    seconds = 0.0
    # the first run loads all kernels, so that no kill is spent on that
    for _ in range(2):
        began = time.monotonic()
        _run(request, driver.Drive())
        seconds = time.monotonic() - began
    how = driver.Drive(checkpoint=checkpoint, resume=True, chunk=chunk)
    for share in shares:
        child = os.fork()
        if not child:
            try:
                _run(request, how)
            finally:
                os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(share * seconds)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    _run(request, how)


def _run(request: Request, how: driver.Drive) -> None:
    """Run a request to its end."""
    task = prepare_task(request)
    driver.drive(task.method, task.problem, how)
