"""The class of trade-offs, their registry, the clock that they share, and the programs that they compare with.

Those programs, the peers, lie in the folder ``bench_peers`` of the source repository and are not installed.
"""

import importlib.util
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np

from voxgran._base.registry import Registry

LOG = logging.getLogger(__name__)
#: folder of the peers in a checkout of the source repository
PEERS = Path(__file__).parents[2] / "bench_peers"


@dataclass(frozen=True, slots=True, kw_only=True)
class TradeOff:
    """One registered trade-off.

    Attributes
    ----------
    name, summary : str
        Name and one line.
    run : callable
        Folder to the files written there: rows and a figure.
    """

    name: str
    summary: str
    run: Callable[[Path], tuple[Path, ...]]


def trade_offs() -> Registry[TradeOff]:
    """Return the registry of trade-offs."""
    return Registry("trade-off", "voxgran.bench.tradeoffs", TradeOff, group="voxgran.trade_offs")


def peers_of(name: str) -> ModuleType | None:
    """Return the module of peer programs of a trade-off; None, with a warning in the log, outside of a checkout.

    Parameters
    ----------
    name : str
        Name of a file in ``bench_peers``, without its suffix.
    """
    spec = importlib.util.spec_from_file_location(f"bench_peers_{name}", PEERS / f"{name}.py")
    if spec is None or spec.loader is None or not (PEERS / f"{name}.py").is_file():
        LOG.warning("the peers of this trade-off are in the source repository only: their rows are left out")
        return None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def least_seconds(work: Callable[[], object], *, repeats: int = 3, processor: bool = False) -> float:
    """Return the least time of a few calls, after one that is not counted (it compiles and loads).

    Parameters
    ----------
    work : callable
        What is timed.
    repeats : int
        Number of calls that are counted.
    processor : bool
        Whether processor time, summed over threads, is taken instead of wall time.
    """
    clock = time.process_time if processor else time.perf_counter
    work()
    times = []
    for _ in range(repeats):
        began = clock()
        work()
        times.append(clock() - began)
    return min(times)


def calibration() -> float:
    """Return the seconds of a fixed loop, by which rows from different machines compare: sorting a million numbers."""
    numbers = np.sin(np.arange(1_000_000) * 12.9898)
    return least_seconds(lambda: np.sort(numbers), repeats=5)
