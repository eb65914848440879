"""The seed of the generator of Open3D, and its silenced output."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from voxgran._base.lazy import load


def seed_open3d(seed: int) -> None:
    """Seed the generator of Open3D, which is global to the process."""
    open3d = load("open3d")
    open3d.utility.random.seed(seed % 2**31)


@contextmanager
def without_stderr() -> Iterator[None]:
    """Suppress what compiled code, such as the Poisson reconstruction, writes to the standard error without logging."""
    try:
        kept = os.dup(2)
    except OSError:
        # it is closed
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
