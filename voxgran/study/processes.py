"""Runs in processes of this machine: as many as memory allows, each with one thread, and none lost with another."""

import contextlib
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from multiprocessing.connection import wait

from voxgran._base.errors import MissingLibraryError
from voxgran._base.kernels import telling_of_compilation
from voxgran.scene.plan import FINISHING_BYTES
from voxgran.scene.processes import Channel, Process, ending_of, start
from voxgran.study.executor import TRIES, Executor
from voxgran.study.runs import Record, Run, SceneCache, compute

#: libraries take the number of their threads from the environment when they are loaded
_ENVIRONMENT = dict.fromkeys(
    (
        "MKL_NUM_THREADS",
        "NUMBA_NUM_THREADS",
        "NUMEXPR_NUM_THREADS",
        "OMP_NUM_THREADS",
        "OPENBLAS_NUM_THREADS",
        "VECLIB_MAXIMUM_THREADS",
    ),
    "1",
) | {"VTK_SMP_BACKEND_IN_USE": "Sequential"}
#: what a process sends when it can compute, and before and after it compiles a kernel
READY, COMPILING, COMPILED = "ready", "compiling", "compiled"
#: a small scene that loads what most scenes need
FIRST = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [3, 3, 3]},
    "packing": {"method": "rsa", "count": 2},
    "measure": {"which": ["density", "coordination"]},
}
#: seconds of work that a process is given in advance, and the most runs of it
AHEAD_SECONDS, MOST_AHEAD = 0.5, 32
#: seconds between looks at whether the study is asked to stop
TICK = 0.2


def serve(channel: Channel) -> None:
    """Compute the runs that come through a channel, and send back the record of each, with the seconds that it took.

    This is what each process does, so that libraries are imported and kernels loaded once.

    Parameters
    ----------
    channel : Channel
        Gives lists of runs.
    """
    cache = SceneCache()
    with telling_of_compilation(lambda: channel.send(COMPILING), lambda: channel.send(COMPILED)):
        # what is loaded only once is not counted as time of the first run
        compute(Run(key="", cell="", mapping=FIRST, seed=0))
        channel.send(READY)
        while True:
            for run in channel.receive():
                began = time.monotonic()
                record = compute(run, cache)
                channel.send((record, time.monotonic() - began))


@dataclass(slots=True, eq=False)
class _Worker(Process):
    """A process with the runs that it was given, in their order; it has computed the first one for some seconds."""

    given: list[Run] = field(default_factory=list)
    ready: bool = False
    compiling: bool = False
    computed: float = 0.0

    @property
    def memory(self) -> int:
        """Bytes that its runs may take."""
        return max([FINISHING_BYTES, *(run.memory for run in self.given)])


class Processes(Executor):
    """Computes runs in processes (context manager): they start on entry, and end with it.

    Parameters
    ----------
    workers : int
        How many processes.
    memory : int
        Bytes that they may take together, as planned.
    """

    def __init__(self, workers: int, memory: int) -> None:
        self._most, self._limit = workers, memory
        self._workers: list[_Worker] = []
        self._waiting: list[Run] = []
        self._tries: dict[str, int] = {}
        self._pace = 0.0
        self._failed_starts = 0

    @property
    def running(self) -> int:
        """How many runs are computed now."""
        return sum(bool(worker.given) for worker in self._workers)

    @property
    def compiling(self) -> bool:
        """Whether a process compiles kernels now."""
        return any(worker.compiling for worker in self._workers)

    @property
    def loading(self) -> bool:
        """Whether all processes with runs still load libraries."""
        busy = [worker for worker in self._workers if worker.given]
        return bool(busy) and not any(worker.ready for worker in busy)

    @property
    def under_way(self) -> list[tuple[Run, float]]:
        """The runs that are computed now, and for how many seconds each has been, without loading and compiling."""
        return [(worker.given[0], worker.computed) for worker in self._workers if worker.given]

    def __enter__(self) -> "Processes":
        """Start the processes, all or none."""
        try:
            for _ in range(max(1, min(self._most, self._limit // FINISHING_BYTES))):
                self._workers.append(_started())
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """End all processes at once."""
        for worker in self._workers:
            worker.end()
        self._workers.clear()

    def results(self, runs: Sequence[Run]) -> Iterator[tuple[Run, Record, bytes] | None]:
        """Yield what is finished; runs are begun in their order as far as there is memory.

        Raises
        ------
        MissingLibraryError
            If no process can be started.
        """
        self._waiting, looked = list(runs), time.monotonic()
        while self._waiting or self.running:
            for worker in self._workers:
                self._give(worker)
            came = wait([worker.connection for worker in self._workers], timeout=TICK)
            looked, before = time.monotonic(), looked
            for worker in self._workers:
                if worker.given and worker.ready and not worker.compiling:
                    worker.computed += looked - before
            # before what came is noted, so that the processes are seen as they were meanwhile
            yield None
            for worker in [one for one in self._workers if one.connection in came]:
                yield from self._heard(worker)

    def _heard(self, worker: _Worker) -> Iterator[tuple[Run, Record, bytes]]:
        """Yield what a process has sent, or what is to be said of the run with which it has ended."""
        try:
            while worker.connection.poll():
                message = worker.connection.recv()
                if message in (COMPILING, COMPILED):
                    worker.compiling = message == COMPILING
                    continue
                if message == READY:
                    worker.ready, self._failed_starts = True, 0
                    continue
                run, (record, seconds), worker.compiling = worker.given.pop(0), message, False
                worker.computed = 0.0
                # the pace of the last dozen of runs
                self._pace += (seconds - self._pace) / 12
                self._give(worker)
                yield run, record, b""
        except (EOFError, OSError):
            yield from self._lost(worker)

    def _lost(self, worker: _Worker) -> Iterator[tuple[Run, Record, bytes]]:
        """Start another process for one that has ended; only the run that it was computing counts as begun."""
        worker.end()
        code = worker.process.returncode
        self._workers.remove(worker)
        if not worker.ready:
            self._failed_starts += 1
            if self._failed_starts > TRIES:
                raise MissingLibraryError(
                    f"{sys.executable} cannot import voxgran in a second process ({ending_of(code)}): runs are "
                    "computed in such processes; install it for this Python, or free memory"
                )
        elif worker.given:
            run = worker.given[0]
            self._tries[run.key] = self._tries.get(run.key, 0) + 1
            if self._tries[run.key] >= TRIES:
                del worker.given[0]
                yield run, Record(failure=_killed(code)), b""
        self._waiting[:0] = worker.given
        self._workers.append(_started())

    def _give(self, worker: _Worker) -> None:
        """Give a process runs for the next half second: the longest ones that memory is left for."""
        ahead = int(min(MOST_AHEAD, max(1.0, AHEAD_SECONDS / self._pace))) if self._pace else 1
        # towards the end all processes share what is left
        ahead = max(1, min(ahead, len(self._waiting) // len(self._workers)))
        if len(worker.given) > ahead // 2:
            return
        others = sum(one.memory for one in self._workers if one is not worker)
        chosen: list[Run] = []
        for run in self._waiting:
            if len(worker.given) + len(chosen) >= ahead:
                break
            # alone a run is begun though idle processes take a part of the limit
            alone = not worker.given and not chosen and self.running == 0
            if alone or others + max(worker.memory, run.memory) <= self._limit:
                chosen.append(run)
        if chosen:
            keys = {run.key for run in chosen}
            self._waiting = [run for run in self._waiting if run.key not in keys]
            worker.given += chosen
            with contextlib.suppress(OSError):
                # a process that has just ended is noticed when it is heard of next
                worker.connection.send(chosen)


def _started() -> _Worker:
    """Return a new process."""
    return start(serve, _Worker, _ENVIRONMENT)


def _killed(code: int) -> str:
    """Return the sentence for a run that has ended with its process each time."""
    return (
        f"its process was {ending_of(code)}, {TRIES} times: memory may have run out, or a library has crashed; compute "
        "it again with retry=True, at the prompt --retry, and fewer workers"
    )
