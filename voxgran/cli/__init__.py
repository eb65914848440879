"""The command line; signals are noted from its first line on, before any other library is imported."""

import os
import resource
from collections.abc import Sequence

from voxgran._base.stopping import Signals
from voxgran.cli.ending import Program, leave

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return the exit status: 0, 2 for bad input, 1 for failure, 129, 130 and 143 if interrupted.

    The arguments are the words after the name of the program; by default those of this process, which then ends where
    it is interrupted.
    """
    with Program() if arguments is None else Signals() as signals:
        try:
            from voxgran.cli.program import run

            status = run(arguments, signals)
        except (MemoryError, SystemError, ImportError) as error:
            # where there is no memory, Python may lose an exception, and libraries cannot be loaded
            limit, _ = resource.getrlimit(resource.RLIMIT_AS)
            if not isinstance(error, MemoryError) and limit == resource.RLIM_INFINITY:
                raise
            os.write(2, b"voxgran: the memory does not suffice: end other programs, or raise the limit (ulimit -v)\n")
            status = 1
        return leave(status) if arguments is None and signals.number else status
