"""A process that computes runs one after another, so that libraries are imported and kernels loaded once."""

import os
import queue
import signal
import threading
import time
from multiprocessing.connection import Connection
from typing import Any

from voxgran._base.kernels import telling_of_compilation
from voxgran.study.runs import Run, SceneCache, compute

#: what a worker sends when it can compute, and before and after it compiles a kernel
READY, COMPILING, COMPILED = "ready", "compiling", "compiled"
#: a small scene that loads what most scenes need
FIRST = {
    "shape": [{"family": "sphere"}],
    "container": {"kind": "box", "lengths": [3, 3, 3]},
    "packing": {"method": "rsa", "count": 2},
    "measure": {"which": ["density", "coordination"]},
}


def serve(descriptor: int) -> None:
    """Compute the runs that come through a socket until it is closed, and send back the record of each, with the
    seconds that it took.

    Parameters
    ----------
    descriptor : int
        Number of the open socket.
    """
    # who has started it ends it: Ctrl-C in the terminal is for that process
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    connection = Connection(descriptor)
    runs: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(connection, runs), daemon=True).start()
    cache = SceneCache()
    with telling_of_compilation(lambda: _send(connection, COMPILING), lambda: _send(connection, COMPILED)):
        # what is loaded only once is not counted as time of the first run
        compute(Run(key="", cell="", mapping=FIRST, seed=0))
        _send(connection, READY)
        while True:
            run = runs.get()
            began = time.monotonic()
            record = compute(run, cache)
            _send(connection, (record, time.monotonic() - began))


def _receive(connection: Connection, runs: "queue.SimpleQueue[Any]") -> None:
    """Queue what comes, and end this process at once, whatever it computes, when nobody waits for it any more."""
    while True:
        try:
            for run in connection.recv():
                runs.put(run)
        except (EOFError, OSError):
            os.kill(os.getpid(), signal.SIGKILL)


def _send(connection: Connection, what: Any) -> None:
    """Send something; end this process when nobody receives it."""
    try:
        connection.send(what)
    except OSError:
        os.kill(os.getpid(), signal.SIGKILL)
