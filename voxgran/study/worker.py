"""A process that computes runs one after another, so that libraries are imported and kernels loaded once."""

import time

from voxgran._base.kernels import telling_of_compilation
from voxgran.scene.processes import Channel
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


def serve(channel: Channel) -> None:
    """Compute the runs that come through a channel, and send back the record of each, with the seconds that it took.

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
