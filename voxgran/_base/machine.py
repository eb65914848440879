"""What this process may use of the machine: memory and processors, as limits of a container allow, and libraries."""

import contextlib
import importlib.metadata
import os
import re
import time
from functools import cache
from pathlib import Path

import numpy as np

from voxgran._base.lazy import load
from voxgran._base.seeds import stream

#: where a control group states its limit of memory, new and old layout
LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


def memory_limit() -> int:
    """Return how many bytes this process may use: those of the machine, or of its control group where that is less."""
    whole = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    for name in LIMITS:
        try:
            whole = min(whole, int(Path(name).read_text(encoding="ascii")))
        except (OSError, ValueError):
            # no such layout, or the word "max"
            continue
    return whole


def processor_count() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def forget_peak() -> None:
    """Let the system count the largest memory of this process anew, where it can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_memory() -> int:
    """Return the largest memory of this process since :func:`forget_peak`, in bytes."""
    with contextlib.suppress(OSError):
        if found := re.search(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text(encoding="ascii")):
            return 1024 * int(found[1])
    resource = load("resource")
    # in kilobytes on Linux, in bytes on macOS
    return int(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss) * (1024 if os.uname().sysname == "Linux" else 1)


def installed_versions(*names: str) -> dict[str, str]:
    """Return the versions of those of the distributions that are installed."""
    return {name: version for name in names if (version := _version_of(name))}


@cache
def _version_of(name: str) -> str:
    """Return the version of a distribution, read from its files once, or nothing where it is not installed."""
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        return importlib.metadata.version(name)
    return ""


@cache
def yardstick() -> float:
    """Return the CPU seconds of a sum over 2^20 numbers in a random order on this machine, the least of 5, by which
    times of other machines are scaled. They are found once.
    """
    order = stream(0, "yardstick").permutation(2**20)
    numbers, times = np.ones(2**20), []
    for _ in range(5):
        began = time.process_time()
        np.cumsum(numbers[order])
        times.append(time.process_time() - began)
    return min(times)
