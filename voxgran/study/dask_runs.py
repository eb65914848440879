"""Runs on a Dask cluster, whatever it is made of: processes of this machine, or jobs of a queueing system."""

import contextlib
import logging
import math
import os
import queue
import time
from collections.abc import Iterator, Sequence
from typing import Any

from voxgran._base.cluster import connected
from voxgran._base.errors import ClusterError, VoxgranError
from voxgran.study.executor import TRIES, Executor
from voxgran.study.runs import Record, Run, compute_with_file

#: seconds between looks at whether the scheduler is still there
TICK = 0.2
#: seconds between looks at how many workers there are
LOOK = 2.0
#: name of the error of a run whose workers were killed several times
KILLED = "KilledWorker"
#: loggers of what Dask says of connections
LOGGERS = ("asyncio", "distributed", "distributed.batched", "distributed.client", "tornado.application")


class DaskRuns(Executor):
    """Computes runs on the workers of a Dask scheduler (context manager), which stays when it ends.

    Parameters
    ----------
    address : str
        Address of the scheduler, such as ``tcp://127.0.0.1:8786``.
    """

    def __init__(self, address: str) -> None:
        self._address = address
        self._client: Any = None
        self._left: dict[str, tuple[Run, Any]] = {}
        self._begun: dict[str, float] = {}
        self._tries: dict[str, int] = {}
        self._stamps: dict[str, int] = {}
        self._threads, self._asked = 0, -math.inf
        self._levels: dict[str, int] = {}

    @property
    def running(self) -> int:
        """How many runs are computed now, as far as it is known."""
        if time.monotonic() - self._asked > LOOK:
            with contextlib.suppress(OSError):
                self._threads = sum(self._client.nthreads().values())
            self._asked = time.monotonic()
        return min(len(self._left), self._threads)

    @property
    def under_way(self) -> list[tuple[Run, float]]:
        """The runs that are computed now, and for how many seconds each has been, if they are begun in their order."""
        now = time.monotonic()
        begun = list(self._left.values())[: self.running]
        return [(run, now - self._begun.setdefault(run.key, now)) for run, _ in begun]

    def __enter__(self) -> "DaskRuns":
        """Connect to the scheduler."""
        self._client = connected(self._address, default=False)
        # of a scheduler that goes away this raises one error, and the library writes pages
        for name in LOGGERS:
            self._levels[name] = logging.getLogger(name).level
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        return self

    def __exit__(self, *_: object) -> None:
        """Cancel what is not finished, and leave the scheduler."""
        with contextlib.suppress(OSError, TimeoutError):
            if self._client.status == "running":
                self._client.cancel([future for _, future in self._left.values()])
            self._client.close(timeout=1)
        for name, level in self._levels.items():
            logging.getLogger(name).setLevel(level)

    def results(self, runs: Sequence[Run]) -> Iterator[tuple[Run, Record, bytes] | None]:
        """Yield what is finished; a run is given anew to the cluster as long as its checkpoint gets further.

        Raises
        ------
        ClusterError
            If the scheduler goes away.
        """
        finished: queue.SimpleQueue[tuple[Run, Any]] = queue.SimpleQueue()
        try:
            for number, run in enumerate(runs):
                self._submit(run, finished, priority=len(runs) - number)
            while self._left:
                try:
                    run, future = finished.get(timeout=TICK)
                except queue.Empty:
                    self._check(lost=self._client.status != "running")
                    yield None
                    continue
                self._check(lost=future.status == "cancelled")
                if type(future.exception()).__name__ == KILLED and self._goes_on(run):
                    self._submit(run, finished, priority=len(runs))
                    continue
                record, packing = _outcome(future)
                del self._left[run.key]
                yield run, record, packing
        except OSError as error:
            # what fails in a run is in its record: this is the connection
            if isinstance(error, VoxgranError):
                raise
            self._check(lost=True)

    def _submit(self, run: Run, finished: "queue.SimpleQueue[tuple[Run, Any]]", *, priority: int) -> None:
        """Give a run to the cluster; it is noted when it is finished."""
        future = self._client.submit(compute_with_file, run, pure=False, priority=priority)
        self._left[run.key] = run, future
        self._begun.pop(run.key, None)
        future.add_done_callback(lambda ended: finished.put((run, ended)))

    def _goes_on(self, run: Run) -> bool:
        """Return whether a run whose workers were killed is given to others: as long as its checkpoint gets further,
        since jobs end at their wall time, and once more where it does not.
        """
        stamp = 0
        with contextlib.suppress(OSError):
            stamp = os.stat(run.checkpoint).st_mtime_ns if run.checkpoint else 0
        further = stamp > self._stamps.get(run.key, 0)
        self._stamps[run.key] = stamp
        self._tries[run.key] = 0 if further else self._tries.get(run.key, 0) + 1
        return self._tries[run.key] < TRIES

    def _check(self, *, lost: bool) -> None:
        """Raise a ClusterError where the scheduler is lost."""
        if lost:
            raise ClusterError(
                f"the Dask scheduler at {self._address} is gone: what is finished is kept; start a scheduler and give "
                "the same command again, which computes the rest"
            )


def _outcome(future: Any) -> tuple[Record, bytes]:
    """Return record and packing of a finished run; of one whose workers have ended, the record that says so."""
    error = future.exception()
    if error is None:
        return future.result()
    if type(error).__name__ == KILLED:
        told = (
            "its Dask workers were killed each time: memory may have run out, or their jobs are too short for a "
            "checkpoint; compute it again with retry=True, at the prompt --retry, and with longer jobs or more memory"
        )
        return Record(failure=told), b""
    return Record(failure=f"its Dask worker failed ({type(error).__name__}: {' '.join(str(error).split())})"), b""
