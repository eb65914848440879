"""What a trade-off is, the registry that finds them, and the clock they share."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from voxgran._base.registry import Registry


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
